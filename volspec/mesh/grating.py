"""Gratings: light of each wavelength goes to directions of its own.

directions of the light and the eye -> [grating] -> reflectances (K, N) -> caster

The orders of reference [1], eq. 9, are smeared by the waviness of the surface and the size of the
light: a Gaussian in the cosines of direction along the surface takes the delta functions' place.
dα dβ = cos θ dω, so what is diffracted is neither more nor less than the light that arrives.

References
----------
[1] Wang, Xu & Sun (2004), "Practical Construction of Reflectances for Spectral Rendering".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec.errors import MeshError
from volspec.settings import Unit, Vector, settings
from volspec.spectra import SpectralGrid

Array = NDArray[np.float64]
# Peaks farther away than this many widths are left out.
_REACH = 5.0
# Where less of the direction across the lines is in the surface, there are no lines.
_MIN_ACROSS = 0.03
# Wavelengths that are seen begin here; lines nearer than half of them diffract nothing.
_VISIBLE_NM = 400.0
# Places across the stripes at which `Grating.spectra` are taken, for each direction.
_PLACES = 96
# Stripes of lines further apart are not seen apart.
Spacing = Annotated[float, Field(gt=0.0, le=1000.0), Unit("µm")]


@settings(MeshError)
@dataclass(frozen=True, slots=True, kw_only=True)
class Grating:
    """``grating``: fine lines on a surface, such as the tracks of a disc, which diffract light."""

    spacing_um: Spacing
    """Distance between lines; 1.6 for a compact disc, 0.74 for a DVD."""
    cross_um: Spacing | None = None
    """Distance between lines of a second set, across the first."""
    across: Vector | None = None
    """Direction across the lines, in the file's axes; if left out, lines are circles about
    ``centre``."""
    centre: Vector = (0.0, 0.0, 0.0)
    """Middle of the circles, in the file's axes and units."""
    orders: Annotated[int, Field(ge=1, le=9)] = 3
    """Highest order, to either side; all have the same part of the light."""
    part: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    """Part of the light that is diffracted; the material reflects the rest."""
    spread_deg: Annotated[float, Field(ge=0.05, le=30.0), Unit("degrees")] = 1.0
    """Width (standard deviation) of the stripes: waviness of the surface, size of the light."""

    def __post_init__(self) -> None:
        if self.across is not None and not any(self.across):
            raise MeshError.refused("across", self.across, "give a direction", "range")
        for key in ("spacing_um", "cross_um"):
            spacing = getattr(self, key)
            if spacing is not None and 2e3 * spacing < _VISIBLE_NM:
                raise MeshError(
                    f"lines {spacing:g} µm apart are finer than half of any wavelength that is "
                    "seen: they have no orders",
                    f"give {_VISIBLE_NM / 2e3:g} or more, or leave the grating out",
                    code="range",
                    field=key,
                    given=spacing,
                )

    def placed(self, unit_mm: float, rotation: Array, move_mm: Array) -> Grating:
        """Return the grating of a mesh that is scaled, turned and moved."""
        centre = tuple(np.array(self.centre) * unit_mm @ rotation.T + move_mm)
        across = None if self.across is None else tuple(np.array(self.across) @ rotation.T)
        return replace(self, centre=centre, across=across)

    def spectra(self, grid: SpectralGrid) -> Array:
        """Return (R, N) reflectances that the eye may see, the highest band of each 1.

        They are taken along the orders of either set of lines, and between them.
        """
        flat = replace(self, across=(1.0, 0.0, 0.0))
        s = np.linspace(0.0, 2.0, _PLACES)
        turns = [0.0] if self.cross_um is None else np.radians([0.0, 20.0, 45.0, 70.0, 90.0])
        q = np.concatenate([s[:, None] * (np.cos(a), np.sin(a), 0.0) for a in turns])
        normals = np.tile((0.0, 0.0, 1.0), (len(q), 1))
        _, reflected = flat.reflectance(grid, normals, normals, q)
        return reflected / reflected.max(axis=1, keepdims=True)

    def frames(self, points_mm: Array, normals: Array) -> tuple[Array, Array]:
        """Return unit vectors (K, 3) of a surface, across and along its lines; 0 without lines."""
        centre = np.array(self.centre)
        across = points_mm - centre if self.across is None else np.array([self.across])
        norm = np.linalg.norm(across, axis=1, keepdims=True)
        across = (
            across
            - np.einsum("kc,kc->k", across * np.ones_like(normals), normals)[:, None] * normals
        )
        length = np.linalg.norm(across, axis=1, keepdims=True)
        across = np.where(length > _MIN_ACROSS * norm, across / np.maximum(length, 1e-30), 0.0)
        return across, np.cross(normals, across)

    def reflectance(
        self, grid: SpectralGrid, points_mm: Array, normals: Array, q: Array
    ) -> tuple[NDArray[np.intp], Array]:
        """Return the points (R,) that diffract towards the eye, and their reflectances (R, N).

        ``q`` (K, 3) is the sum of the directions to the light and to the eye, [1]'s with the other
        sign, which swaps the orders of either side. 1 is what a white surface reflects.
        """
        # Imported late: scenes without gratings know the settings, too.
        from scipy.special import ndtr

        across, parallel = self.frames(points_mm, normals)
        s, t = (np.einsum("kc,kc->k", q, axis) for axis in (across, parallel))
        width = np.radians(self.spread_deg)
        edges = np.append(
            grid.wavelengths_nm - grid.step_nm / 2.0, grid.wavelengths_nm[-1] + grid.step_nm / 2.0
        )
        cross = [0] if self.cross_um is None else range(-self.orders, self.orders + 1)
        orders = [(j, k) for j in range(-self.orders, self.orders + 1) for k in cross]
        total = np.zeros((len(q), grid.size))
        for j, k in orders:
            # Cosines per nanometre; the two deltas' product is a Gaussian of the wavelength.
            a = j / (1e3 * self.spacing_um)
            b = k / (1e3 * self.cross_um) if self.cross_um is not None else 0.0
            square = a * a + b * b
            if not square:
                rows = np.flatnonzero(s * s + t * t < (_REACH * width) ** 2)
                total[rows] += np.exp(-0.5 * (s[rows] ** 2 + t[rows] ** 2) / width**2)[:, None]
                continue
            peak = (s * a + t * b) / square
            off, narrow = np.maximum(s * s + t * t - peak**2 * square, 0.0), width / square**0.5
            reach = _REACH * narrow
            visible = (peak > edges[0] - reach) & (peak < edges[-1] + reach)
            rows = np.flatnonzero(visible & (off < (_REACH * width) ** 2))
            bands = np.diff(ndtr((edges - peak[rows, None]) / narrow), axis=1) / grid.step_nm
            height = np.exp(-0.5 * off[rows] / width**2) * narrow * np.sqrt(2.0 * np.pi)
            total[rows] += height[:, None] * bands
        total[~across.any(axis=1)] = 0.0
        # π: of a BRDF, what a white surface reflects is 1/π.
        total *= np.pi * self.part / len(orders) / (2.0 * np.pi * width**2)
        rows = np.flatnonzero(total.any(axis=1))
        return rows, total[rows]
