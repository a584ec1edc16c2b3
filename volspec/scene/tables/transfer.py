"""``[transfer]``: points, regions, labels or surfaces, and the function that they define.

tables, materials, basis -> [transfer] -> TransferFunction | TransferFunction2D | …
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Field, Tag

from volspec.basis import Basis
from volspec.errors import SceneError
from volspec.scene.tables.specs import fault
from volspec.settings import Hint, NotNegative, Pair, Unit, read_table, settings
from volspec.spectra import Spectrum
from volspec.transfer import (
    Isosurfaces,
    Label,
    LabelFunction,
    Mix,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)

KINDS = ("points", "regions", "labels", "surfaces")
# A name or a mix, discriminated by form, so that a message is about the intended one.
Material = Annotated[
    Annotated[str, Tag("<value>")] | Annotated[dict[str, float], Tag("<table>")],
    Discriminator(lambda v: "<table>" if isinstance(v, dict) else "<value>"),
    Hint("a name, or a mix { name = fraction, … }", whole=True),
]


@dataclass(frozen=True, slots=True)
class LookSpec:
    """Fields of every row: opacity and material."""

    opacity: Annotated[float, Field(examples=[0.5])]
    """0 to 1, over the reference step; for surfaces, of the surface."""
    material: Annotated[Material, Field(examples=["bone"])]
    """A name, or fractions by name that sum to at most 1; the rest is black."""

    @property
    def material_weights(self) -> Mapping[str, float]:
        """Fractions by material, even if there is only one."""
        return {self.material: 1.0} if isinstance(self.material, str) else self.material


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class PointSpec(LookSpec):
    """Row of ``points`` or ``surfaces``."""

    row_keys: ClassVar = ("value",)
    value: Annotated[float, Field(examples=[100])]
    """Increasing; two points with the same value make a step."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class RegionSpec(LookSpec):
    """Row of ``regions``; see `volspec.Region`."""

    row_keys: ClassVar = ("values", "gradients")
    values: Annotated[Pair, Field(examples=[[60, 130]])]
    """From, to."""
    gradients: Annotated[Pair, Field(examples=[[20, 200]])]
    """From, to; value per mm, from 0; to may be inf."""
    softness: float = 0.25
    """Fraction of each side's half-width, 0 to 1, over which opacity falls to 0."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class LabelSpec(LookSpec):
    """Row of ``labels``."""

    row_keys: ClassVar = ("label",)
    label: Annotated[int, Field(examples=[1])]
    """Its number in the file, from 0; labels left out are transparent."""
    name: str = ""
    """Such as liver, for lists of labels."""
    visible: bool = True
    """False hides the label, which keeps its opacity."""


LabelName = Annotated[
    int | str | Annotated[tuple[int | str, ...], Field(strict=False, min_length=1)],
    Hint("a number, a name, or a list of them", whole=True),
]


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class MaskLabelSpec:
    """``[[transfer.label]]``: what has one of some labels of the mask, or some of its values."""

    row_keys: ClassVar = ("label",)
    label: Annotated[LabelName, Field(examples=["liver"])] | None = None
    """Number or name in the field of labels, or several; those left out have the field's own
    points."""
    values: Pair | None = None
    """Instead of labels: values of the field, from and to, for a function of two fields."""
    points: Annotated[tuple[PointSpec, ...], Field(strict=False, min_length=1)] | None = None
    """A curve over the masked field's values, instead of its own."""
    shown: bool = True
    """False hides what has the label; needs no points."""

    def __post_init__(self) -> None:
        if self.points is None and self.shown:
            raise fault("points", "missing", "give points, or shown = false", "missing")
        if self.label is None and self.values is None:
            raise fault("label", "missing", "give label or values", "missing")
        if self.label is not None and self.values is not None:
            raise fault("label", "given with values", "give one of them")
        if self.values is not None and not self.values[0] < self.values[1]:
            raise fault("values", f"{list(self.values)} is empty", "give from < to", "range")

    @property
    def labels(self) -> tuple[Label, ...]:
        """All labels of the row, or its band of values."""
        if self.values is not None:
            return (self.values,)
        assert self.label is not None
        return self.label if isinstance(self.label, tuple) else (self.label,)


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class TransferSpec:
    """``[transfer]``: one kind of function, and the length to which opacities refer."""

    points: Annotated[tuple[PointSpec, ...], Field(strict=False, min_length=1)] | None = None
    """A curve over values."""
    gradient_opacity: Annotated[tuple[Pair, ...], Field(strict=False, min_length=1)] | None = None
    """With points: pairs of gradient magnitude (value per mm, increasing) and opacity factor, 0 to
    1; emphasises boundaries."""
    regions: Annotated[tuple[RegionSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Rectangles of values and gradients."""
    labels: Annotated[tuple[LabelSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Opacity and material per label of a segmentation."""
    surfaces: Annotated[tuple[PointSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Isosurfaces, up to eight; rows as points."""
    reference_step_mm: Annotated[float, Unit("mm")] | None = None
    """Length to which opacities refer; default: the smallest spacing. Not with surfaces."""
    weight: NotNegative = 1.0
    """Factor of the extinction; with points."""
    shown: bool = True
    """False hides the field; with points."""
    mask: str | None = None
    """Name of the volume's field whose labels choose the points; with points."""
    label: Annotated[tuple[MaskLabelSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Points by label of the mask."""

    @classmethod
    def transparent(cls) -> TransferSpec:
        """Return the table of an empty volume, whose material may be any."""
        return cls(points=(PointSpec(opacity=0.0, material="", value=0.0),))

    @property
    def kind(self) -> str:
        """Kind of function given, one of `KINDS`."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    def __post_init__(self) -> None:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise fault(
                "",
                f"{' and '.join(kinds)} are given" if kinds else "none is given",
                f"give one of {', '.join(KINDS)}",
                "conflict" if kinds else "missing",
            )
        if self.gradient_opacity is not None and self.points is None:
            raise fault("gradient_opacity", f"only for points, not {kinds[0]}", "leave it out")
        if self.reference_step_mm is not None and self.surfaces is not None:
            raise fault("reference_step_mm", "surfaces have no thickness", "leave it out")
        self._check_mask()
        numbers: set[int] = set()
        for i, row in enumerate(self.labels or ()):
            if row.label in numbers:
                problem = f"{row.label} is given twice"
                raise fault(f"labels[{i}].label", problem, "leave out one", "duplicate")
            numbers.add(row.label)

    def _check_mask(self) -> None:
        if self.mask is not None and self.points is None:
            raise fault("mask", f"only for points, not {self.kind}", "leave it out")
        if self.mask is not None and self.gradient_opacity is not None:
            raise fault("mask", "not with gradient_opacity", "leave out one of them")
        for one, other in (("mask", "label"), ("label", "mask")):
            if getattr(self, one) is not None and getattr(self, other) is None:
                raise fault(other, f"missing, which {one} needs", f"give {other}", "missing")
        labels: set[Label] = set()
        for i, row in enumerate(self.label or ()):
            for label in row.labels:
                if label in labels:
                    problem = f"{label!r} is given twice"
                    raise fault(f"label[{i}].label", problem, "leave out one", "duplicate")
                labels.add(label)

    @classmethod
    def of(cls, transfer: Transfer) -> TransferSpec:
        """Return the table of a transfer function."""
        rows: list[dict[str, Any]]
        if isinstance(transfer, TransferFunction2D):
            kind = "regions"
            rows = [{f.name: getattr(row, f.name) for f in fields(row)} for row in transfer.regions]
        elif isinstance(transfer, LabelFunction):
            kind, looks = "labels", transfer.labels.items()
            rows = [
                {"label": label, "opacity": opacity, "material": mix}
                | ({"name": transfer.names[label]} if label in transfer.names else {})
                | ({"visible": False} if label in transfer.hidden else {})
                for label, (opacity, mix) in looks
            ]
        else:
            kind = "points" if isinstance(transfer, TransferFunction) else "surfaces"
            points = getattr(transfer, kind)
            rows = [{"value": float(v), "opacity": float(o), "material": m} for v, o, m in points]
        extras = {
            name: value
            for name in ("gradient_opacity", "reference_step_mm")
            if (value := getattr(transfer, name, None)) is not None
        }
        table = [row | {"material": _mix_as_written(row["material"])} for row in rows]
        return read_table(cls, {kind: table, **extras}, SceneError)

    def visible_mixes(self) -> Iterator[tuple[float, Mapping[str, float]]]:
        """Weigh the mixes: opacity times the range of values that each covers."""
        if self == self.transparent():
            return
        if self.points is not None:
            yield from _visible_points(self.points)
        for by_label in self.label or ():
            if by_label.points is not None and by_label.shown:
                yield from _visible_points(by_label.points)
        for region in self.regions or ():
            yield region.opacity * (region.values[1] - region.values[0]), region.material_weights
        for row in (*(self.labels or ()), *(self.surfaces or ())):
            yield row.opacity, row.material_weights

    def function(
        self, materials: Mapping[str, Spectrum], filters: Mapping[str, Spectrum], basis: Basis
    ) -> Transfer:
        """Make the transfer function.

        Raises TransferError for a number out of range or an unknown material.
        """
        step = self.reference_step_mm
        if self == self.transparent():
            return TransferFunction([(0.0, 0.0, next(iter(materials)))], materials, basis)
        if self.regions is not None:
            regions = [Region(**asdict(row)) for row in self.regions]
            return TransferFunction2D(regions, materials, basis, step)
        if self.labels is not None:
            looks = {row.label: (row.opacity, row.material) for row in self.labels}
            names = {row.label: row.name for row in self.labels}
            hidden = frozenset(row.label for row in self.labels if not row.visible)
            return LabelFunction(looks, materials, basis, step, names, hidden)
        looks_at = _looks(self.points or self.surfaces or ())
        if self.surfaces is not None:
            return Isosurfaces(looks_at, materials, basis)
        return TransferFunction(
            *(looks_at, materials, basis, step), self.gradient_opacity, filters or None
        )

    def mask_function(
        self, row: MaskLabelSpec, materials: Mapping[str, Spectrum], basis: Basis
    ) -> TransferFunction | None:
        """Make the transfer function of a row of ``label``; None if it is hidden.

        Raises TransferError as `function`.
        """
        if row.points is None or not row.shown:
            return None
        return TransferFunction(_looks(row.points), materials, basis, self.reference_step_mm)


def _looks(rows: Sequence[PointSpec]) -> list[tuple[float, float, Mix]]:
    return [(row.value, row.opacity, row.material) for row in rows]


def _mix_as_written(mix: Mix) -> str | dict[str, float]:
    """Return a mix as written in a file: a single material by its name alone."""
    if isinstance(mix, str):
        return mix
    fractions = {name: float(fraction) for name, fraction in mix.items()}
    return next(iter(fractions)) if list(fractions.values()) == [1.0] else fractions


def _visible_points(points: Sequence[PointSpec]) -> Iterator[tuple[float, Mapping[str, float]]]:
    span = points[-1].value - points[0].value or 1.0
    for point in points:  # a sharp step covers no range of values, yet is visible
        yield point.opacity * span / len(points), point.material_weights
    for left, right in pairwise(points):
        for point in (left, right):
            yield point.opacity * (right.value - left.value) / 2, point.material_weights
