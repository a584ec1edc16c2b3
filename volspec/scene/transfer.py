"""``[transfer]``: points, regions, labels or surfaces, and the function they make.

tables, materials, basis -> [transfer] -> TransferFunction | TransferFunction2D | …
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from volspec._tables import Pair, Table
from volspec.basis import Basis
from volspec.spectra import Spectrum
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)

KINDS = ("points", "regions", "labels", "surfaces")
# A name or a mix, told apart by their form, so that a message is about the one that is meant.
Material = Annotated[
    Annotated[str, Tag("<name>")] | Annotated[dict[str, float], Tag("<mix>")],
    Discriminator(lambda given: "<mix>" if isinstance(given, dict) else "<name>"),
]


class LookTable(Table):
    """What every row has: how opaque, and of what."""

    opacity: Annotated[float, Field(examples=[0.5])]
    """0 to 1, over the reference step; a surface's for the surface."""
    material: Annotated[Material, Field(examples=["bone"])]
    """A name, or shares by name that sum to at most 1; the rest is black."""

    @property
    def shares(self) -> Mapping[str, float]:
        """The mix by material, also where there is only one."""
        return {self.material: 1.0} if isinstance(self.material, str) else self.material


class PointTable(LookTable):
    """One of ``points`` or ``surfaces``."""

    row_keys = ("value",)
    value: Annotated[float, Field(examples=[100])]
    """Rising; two points of one value make a step."""


class RegionTable(LookTable):
    """One of ``regions``; see `volspec.Region`."""

    row_keys = ("values", "gradients")
    values: Annotated[Pair, Field(examples=[[60, 130]])]
    """From, to."""
    gradients: Annotated[Pair, Field(examples=[[20, 200]])]
    """From, to; value per mm, from 0; to may be inf."""
    softness: float = 0.25
    """Share of each side's half-width over which opacity falls to 0."""


class LabelTable(LookTable):
    """One of ``labels``."""

    row_keys = ("label",)
    label: Annotated[int, Field(examples=[1])]
    """0 to 65535; labels left out are transparent."""


class TransferTable(Table):
    """``[transfer]``: one kind of function, and the length over which an opacity holds."""

    points: Annotated[list[PointTable], Field(min_length=1)] | None = None
    """A curve over values."""
    gradient_opacity: Annotated[list[Pair], Field(min_length=1)] | None = None
    """With points: magnitude (value per mm, rising) and factor of the opacity, pair by pair."""
    regions: Annotated[list[RegionTable], Field(min_length=1)] | None = None
    """Rectangles of values and gradients."""
    labels: Annotated[list[LabelTable], Field(min_length=1)] | None = None
    """Of a segmentation."""
    surfaces: Annotated[list[PointTable], Field(min_length=1)] | None = None
    """Isosurfaces, up to eight."""
    reference_step_mm: float | None = None
    """Length over which an opacity holds; left out, the smallest spacing."""

    @property
    def kind(self) -> str:
        """Which of `KINDS` is given."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @model_validator(mode="after")
    def _one_kind(self) -> TransferTable:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            what = f"{' and '.join(given)} are given" if given else "none is given"
            raise ValueError(f"give one of {', '.join(KINDS)}; {what}")
        if self.gradient_opacity is not None and self.points is None:
            raise ValueError(f"gradient_opacity is for points, not {given[0]}; leave it out")
        if self.reference_step_mm is not None and self.surfaces is not None:
            raise ValueError("surfaces have no thickness; leave out reference_step_mm")
        seen: set[int] = set()
        for row in self.labels or ():
            if row.label in seen:
                raise ValueError(f"labels: {row.label} is given twice; leave out one")
            seen.add(row.label)
        return self

    def seen(self) -> Iterator[tuple[float, Mapping[str, float]]]:
        """How much of each mix is seen: its opacity, times the values it covers."""
        if self.points is not None:
            yield from _seen_points(self.points)
        for region in self.regions or ():
            yield region.opacity * (region.values[1] - region.values[0]), region.shares
        for row in (*(self.labels or ()), *(self.surfaces or ())):
            yield row.opacity, row.shares

    def function(
        self, materials: Mapping[str, Spectrum], filters: Mapping[str, Spectrum], basis: Basis
    ) -> Transfer:
        """The transfer function.

        Raises
        ------
        TransferError
            If a number is out of range or a material is unknown.
        """
        step = self.reference_step_mm
        if self.regions is not None:
            regions = [Region(**row.model_dump()) for row in self.regions]
            return TransferFunction2D(regions, materials, basis, step)
        if self.labels is not None:
            looks = {row.label: (row.opacity, row.material) for row in self.labels}
            return LabelFunction(looks, materials, basis, step)
        rows = self.points or self.surfaces or ()
        looks_at = [(row.value, row.opacity, row.material) for row in rows]
        if self.surfaces is not None:
            return Isosurfaces(looks_at, materials, basis)
        return TransferFunction(
            *(looks_at, materials, basis, step), self.gradient_opacity, filters or None
        )


def _seen_points(points: Sequence[PointTable]) -> Iterator[tuple[float, Mapping[str, float]]]:
    span = max(points[-1].value - points[0].value, 1e-12)
    for point in points:  # a sharp step covers no values, yet is seen
        yield point.opacity * span / len(points), point.shares
    for left, right in pairwise(points):
        for point in (left, right):
            yield point.opacity * (right.value - left.value) / 2, point.shares
