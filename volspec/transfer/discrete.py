"""Transfer functions over single values: labels of a segmentation, and isosurfaces.

volume -> [discrete] -> raycast -> relight -> appearance
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from volspec.basis import Basis
from volspec.errors import TransferError
from volspec.spectra import Spectrum
from volspec.transfer import mixtures
from volspec.transfer.mixtures import Mix, Point
from volspec.transfer.table import MAX_LABEL, MAX_SURFACES, SurfaceTable, TransferTable


@dataclass(frozen=True, slots=True, eq=False)
class LabelFunction:
    """Labels and their opacity per reference step and material mix.

    Parameters
    ----------
    labels : {label: (opacity, material or {material: weight})}
        Whole numbers from 0; omitted labels are transparent.
    materials, basis, reference_step_mm
        As in `TransferFunction`.
    names : {label: name}, optional
        Names of labels; others have none.
    hidden : set of label, optional
        Labels that are transparent, but keep their opacity.

    Raises
    ------
    TransferError
        If there are no labels, a label is not such a number, an opacity is outside 0…1, or a
        material is unknown (the nearest names are given).

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
    names: Mapping[int, str] = field(default_factory=dict)
    hidden: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        if not self.labels:
            remedy = "give {label: (opacity, material)}, at least one"
            raise TransferError.refused("LabelFunction.labels", self.labels, remedy, "missing")
        mixtures.check_materials("LabelFunction", self.materials, self.basis)
        step = mixtures.checked_step("LabelFunction", self.reference_step_mm)
        checked = dict(self._checked(label, look) for label, look in self.labels.items())
        object.__setattr__(self, "labels", checked)
        names = {int(label): str(name) for label, name in self.names.items() if name}
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "hidden", frozenset(self.hidden) & checked.keys())
        object.__setattr__(self, "reference_step_mm", step)

    def _checked(self, label: Any, look: Any) -> tuple[int, tuple[float, Mix]]:
        is_whole = isinstance(label, int | np.integer) and not isinstance(label, bool)
        if not is_whole or label < 0:
            raise TransferError(
                f"label {label!r:.20} is {'out of range' if is_whole else 'not a whole number'}",
                "give 0 or more",
                code="range" if is_whole else "type",
                field="LabelFunction.labels",
                given=label,
            )
        field = f"LabelFunction.labels[{label}]"
        opacity, mix = mixtures.checked_parts(field, look, "(opacity, material or mix)")
        opacity = mixtures.checked_fraction(f"{field}.opacity", opacity)
        return int(label), (opacity, mixtures.checked_mix(f"{field}.material", mix, self.materials))

    def __repr__(self) -> str:
        return f"LabelFunction({len(self.labels)} labels, {', '.join(self.materials)})"

    def bake(self, smallest_spacing_mm: float, numbers: Sequence[int] = ()) -> TransferTable:
        """Make a table with one entry per label, up to the greatest; see `TransferFunction.bake`.

        Weights of transparent entries are 0. If voxels hold other values than the labels' numbers,
        ``numbers`` are these by value (`Volume.numbers`).
        """
        values = {number: value for value, number in enumerate(numbers)}
        values = values or {label: label for label in self.labels if label <= MAX_LABEL}
        # Labels that are switched off add no materials, as these would slow the cast.
        visible = [
            label
            for label, (opacity, _) in self.labels.items()
            if opacity > 0 and label not in self.hidden and label in values
        ]
        baked = visible or list(self.labels)[:1]
        rows, channels = mixtures.weights_and_channels(
            [self.labels[label][1] for label in baked], self.materials, self.basis
        )
        last = max(values.values(), default=1) or 1
        opacity, weights = np.zeros(last + 1), np.zeros((last + 1, rows.shape[1]))
        indices = [values[label] for label in visible]
        opacity[indices] = [self.labels[label][0] for label in visible]
        weights[indices] = rows[: len(visible)]
        return TransferTable(
            domain=(0.0, float(last)),
            opacity=opacity,
            material_weights=weights,
            channels=channels,
            reference_step_mm=self.reference_step_mm or smallest_spacing_mm,
            white=self.basis.white,
            labels=True,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Isosurfaces:
    """Surfaces of equal value with opacity and material mix, sorted by value.

    Parameters
    ----------
    surfaces : sequence of (value, opacity, material or {material: weight})
        One to eight, with different values. Opacity, 0…1, is that of the whole surface and does
        not depend on the step.
    materials, basis
        As in `TransferFunction`.

    Raises
    ------
    TransferError
        If there are no surfaces, or more than eight, two have the same value, an opacity is
        outside 0…1, or a material is unknown (the nearest names are given).

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
        field = "Isosurfaces.surfaces"
        surfaces = mixtures.checked_list(field, self.surfaces, "(value, opacity, material)")
        if len(surfaces) > MAX_SURFACES:
            raise TransferError(
                f"{len(surfaces)} surfaces, at most {MAX_SURFACES} can be cast",
                "leave some out",
                code="size",
                field=field,
                given=surfaces,
            )
        mixtures.check_materials("Isosurfaces", self.materials, self.basis)
        checked = sorted(
            (
                mixtures.checked_point(f"{field}[{i}]", surface, self.materials)
                for i, surface in enumerate(surfaces)
            ),
            key=lambda surface: surface[0],
        )
        for lower, upper in pairwise(checked):
            if lower[0] == upper[0]:
                raise TransferError(
                    f"two surfaces have value {lower[0]:g}",
                    "leave out one",
                    code="duplicate",
                    field=field,
                    given=surfaces,
                )
        object.__setattr__(self, "surfaces", tuple(checked))

    def __repr__(self) -> str:
        return f"Isosurfaces({len(self.surfaces)} surfaces, {', '.join(self.materials)})"

    def bake(self, smallest_spacing_mm: float) -> SurfaceTable:
        """Make the surfaces' table; opacity does not depend on the spacing."""
        weights, channels = mixtures.weights_and_channels(
            [mix for _, _, mix in self.surfaces], self.materials, self.basis
        )
        return SurfaceTable(
            values=np.array([value for value, _, _ in self.surfaces]),
            opacity=np.array([opacity for _, opacity, _ in self.surfaces]),
            material_weights=weights,
            channels=channels,
            white=self.basis.white,
        )
