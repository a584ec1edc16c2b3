"""Isosurfaces: a ray meets a material where the value passes a level.

volume -> [surfaces] -> raycast -> relight -> appearance
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from volspec.basis import Basis
from volspec.errors import TransferError
from volspec.spectra import Spectrum
from volspec.transfer.mixes import (
    Point,
    check_materials,
    checked_point,
    listed,
    rows_of_channels,
)
from volspec.transfer.table import MAX_SURFACES, SurfaceTable

_WHO = "isosurfaces"


@dataclass(frozen=True, slots=True, eq=False)
class Isosurfaces:
    """Surfaces of equal value, with opacity and material mix; kept by rising value.

    Parameters
    ----------
    surfaces : sequence of (value, opacity, material or {material: share})
        One to eight of different values. Opacities 0…1 are of the surface itself, whatever
        the step.
    materials : {name: Spectrum}
        Reflectances the surfaces name.
    basis : SpectralBasis or MaterialBasis

    Raises
    ------
    TransferError
        If there is no surface, or more than eight, two have one value, an opacity is outside
        0…1, or a material is unknown (the nearest names are given).

    Examples
    --------
    >>> from volspec.basis import SpectralBasis
    >>> from volspec.spectra import reflectance
    >>> skull = Isosurfaces(
    ...     [(1200, 1.0, "gold"), (300, 0.2, "copper")],
    ...     {name: reflectance(name) for name in ("copper", "gold")},
    ...     SpectralBasis.load("general-7"))
    >>> skull.bake(smallest_spacing_mm=1).values.tolist()
    [300.0, 1200.0]
    """

    surfaces: Sequence[Point]
    materials: Mapping[str, Spectrum]
    basis: Basis

    def __post_init__(self) -> None:
        surfaces = listed(_WHO, "surfaces", self.surfaces, "(value, opacity, material)")
        if len(surfaces) > MAX_SURFACES:
            raise TransferError(
                f"{_WHO}: {len(surfaces)} surfaces, at most {MAX_SURFACES} can be cast; "
                "leave some out"
            )
        check_materials(_WHO, self.materials, self.basis)
        checked = sorted(
            (
                checked_point(f"{_WHO}: surface {i}", surface, self.materials)
                for i, surface in enumerate(surfaces, start=1)
            ),
            key=lambda surface: surface[0],
        )
        for lower, upper in pairwise(checked):
            if lower[0] == upper[0]:
                raise TransferError(
                    f"{_WHO}: two surfaces have value {lower[0]:g}; leave out one", code="conflict"
                )
        object.__setattr__(self, "surfaces", tuple(checked))

    def __repr__(self) -> str:
        return f"Isosurfaces({len(self.surfaces)} surfaces, {', '.join(self.materials)})"

    def bake(self, smallest_spacing_mm: float) -> SurfaceTable:
        """The surfaces' table.

        Parameters
        ----------
        smallest_spacing_mm : float
            Not used, a surface has no thickness; here so that every kind bakes alike.

        Returns
        -------
        SurfaceTable
        """
        shares, channels = rows_of_channels(
            [mix for _, _, mix in self.surfaces], self.materials, self.basis
        )
        return SurfaceTable(
            values=np.array([value for value, _, _ in self.surfaces]),
            opacity=np.array([opacity for _, opacity, _ in self.surfaces]),
            shares=shares,
            channels=channels,
            white=self.basis.white,
        )
