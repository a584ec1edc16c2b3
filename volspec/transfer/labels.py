"""A transfer function of labels: what each part of a segmentation looks like.

segmentation -> [labels] -> raycast -> relight -> appearance
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from volspec.basis import Basis
from volspec.errors import TransferError
from volspec.spectra import Spectrum
from volspec.transfer.mixes import (
    Mix,
    check_materials,
    checked_mix,
    checked_step,
    fraction,
    rows_of_channels,
)
from volspec.transfer.table import MAX_LABEL, TransferTable

_WHO = "label function"


@dataclass(frozen=True, slots=True, eq=False)
class LabelFunction:
    """Labels and their opacity per reference step and material mix.

    Parameters
    ----------
    labels : {label: (opacity, material or {material: share})}
        Whole numbers of 0 to 65535; labels left out are transparent.
    materials : {name: Spectrum}
        Reflectances the labels name.
    basis : SpectralBasis or MaterialBasis
    reference_step_mm : float, optional
        Length over which an opacity holds; the volume's smallest spacing when left out.

    Raises
    ------
    TransferError
        If there is no label, one is no such number, an opacity is outside 0…1, or a material
        is unknown (the nearest names are given).

    Examples
    --------
    >>> from volspec.basis import SpectralBasis
    >>> from volspec.spectra import reflectance
    >>> organs = LabelFunction(
    ...     {2: (0.9, "gold"), 5: (0.1, "copper")},
    ...     {name: reflectance(name) for name in ("copper", "gold")},
    ...     SpectralBasis.load("general-7"))
    >>> organs.bake(smallest_spacing_mm=1).opacity.tolist()
    [0.0, 0.0, 0.9, 0.0, 0.0, 0.1]
    """

    labels: Mapping[int, tuple[float, Mix]]
    materials: Mapping[str, Spectrum]
    basis: Basis
    reference_step_mm: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.labels, Mapping) or not self.labels:
            raise TransferError.refused(
                f"{_WHO}: labels",
                self.labels,
                "give {label: (opacity, material)}, at least one",
                "range",
            )
        check_materials(_WHO, self.materials, self.basis)
        checked = dict(self._checked(label, look) for label, look in self.labels.items())
        object.__setattr__(self, "labels", checked)
        object.__setattr__(self, "reference_step_mm", checked_step(_WHO, self.reference_step_mm))

    def _checked(self, label: Any, look: Any) -> tuple[int, tuple[float, Mix]]:
        where = f"{_WHO}: label {label!r:.20}"
        if isinstance(label, bool) or not isinstance(label, int | np.integer):
            raise TransferError(f"{where} is no whole number; give 0 to {MAX_LABEL}")
        if not 0 <= label <= MAX_LABEL:
            raise TransferError(f"{where} is out of range; give 0 to {MAX_LABEL}")
        try:
            opacity, mix = look
        except (TypeError, ValueError):
            raise TransferError.refused(
                where, look, "expected (opacity, material or mix)"
            ) from None
        opacity = fraction(where, "opacity", opacity)
        return int(label), (opacity, checked_mix(where, mix, self.materials))

    def __repr__(self) -> str:
        return f"LabelFunction({len(self.labels)} labels, {', '.join(self.materials)})"

    def bake(self, smallest_spacing_mm: float) -> TransferTable:
        """A table with one entry a label, up to the greatest.

        Parameters
        ----------
        smallest_spacing_mm : float
            The volume's, used where the function has no reference step of its own.

        Returns
        -------
        TransferTable
            Of `labels`; shares of what is transparent are 0.
        """
        # A label that is switched off brings no material, which would slow the cast.
        seen = [label for label, (opacity, _) in self.labels.items() if opacity > 0]
        shown = seen or list(self.labels)[:1]
        rows, channels = rows_of_channels(
            [self.labels[label][1] for label in shown], self.materials, self.basis
        )
        last = max(1, *self.labels)
        opacity, shares = np.zeros(last + 1), np.zeros((last + 1, rows.shape[1]))
        opacity[seen] = [self.labels[label][0] for label in seen]
        shares[seen] = rows[: len(seen)]
        return TransferTable(
            domain=(0.0, float(last)),
            opacity=opacity,
            shares=shares,
            channels=channels,
            reference_step_mm=self.reference_step_mm or smallest_spacing_mm,
            white=self.basis.white,
            labels=True,
        )
