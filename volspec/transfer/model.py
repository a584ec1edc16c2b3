"""Spectral transfer function: value -> opacity and a mix of materials.

    volume -> [transfer] -> raycast -> relight -> appearance

Opacity and reflectance are interpolated linearly between points and constant beyond the first and
the last; at two points of one value they step, and the value itself has the second. Baking analyses
the materials in the basis and samples the curve into a table, with entries on the points; the
raycaster reads only that table, which has channels instead of reflectances.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from volspec.basis import Basis, SpectralBasis
from volspec.errors import TransferError, VolspecWarning
from volspec.spectra import Spectrum
from volspec.transfer import mixtures
from volspec.transfer.mixtures import Point
from volspec.transfer.table import Array, Entries, TransferTable

_WHO = "TransferFunction"
# Entries over values; a table with gradients also has rows, and must still fit in a cache.
_SIZES, _SIZES_WITH_GRADIENT, _ROWS = (1024, 65536), (1024, 4096), (64, 256)
# Points this near an entry, in entries, are on it.
_ON_ENTRY = 1e-6
# Digits of points, below the span's first, in which a common measure is looked for.
_DIGITS = 8
# Of other points: the longest table by the shortest, and an opacity that nobody sees.
_MAX_LONGER, _UNSEEN = 6, 2e-5


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """Points of value, opacity per reference step and material mix.

    Parameters
    ----------
    points : sequence of (value, opacity, material or {material: weight})
        At least one; values must not decrease (two points of equal value make a step).
        Opacities 0…1. Weights are ≥ 0 and sum to at most 1 (the rest is black).
    materials : {name: Spectrum}
        Reflectances of the materials in the points.
    basis : SpectralBasis or MaterialBasis
    reference_step_mm : float, optional
        Length to which opacity refers; the volume's smallest spacing if omitted.
    gradient_opacity : sequence of (gradient magnitude, factor), optional
        Factors, 0…1, applied to the opacity per reference step, by gradient magnitude in value per
        millimetre; gradients rise, factors are linear in between. Makes boundaries visible.
    filters : {material: Spectrum}, optional
        Spectral absorption: the transmission, 0…1, of a material at opacity 1; a reference
        step transmits 1 − opacity (1 − filter), channel by channel. Materials without a filter
        absorb all wavelengths alike. Needs a SpectralBasis and no ``gradient_opacity``.

    Raises
    ------
    TransferError
        If there are no points, an opacity is outside 0…1, values decrease, a material is
        unknown (the nearest names are given), or gradients or filters are out of range.

    Examples
    --------
    >>> from volspec.spectra import reflectance
    >>> metals = {name: reflectance(name) for name in ("copper", "gold")}
    >>> function = TransferFunction(
    ...     [(60, 0.0, "copper"), (90, 0.5, {"gold": 0.7, "copper": 0.3})],
    ...     metals, SpectralBasis.load("general-7"))
    >>> table = function.bake(smallest_spacing_mm=0.5)
    >>> table.domain, table.opacity.shape, table.material_weights[-1].tolist()
    ((60.0, 90.0), (1024,), [0.3, 0.7])
    """

    points: Sequence[Point]
    materials: Mapping[str, Spectrum]
    basis: Basis
    reference_step_mm: float | None = None
    gradient_opacity: Sequence[tuple[float, float]] | None = None
    filters: Mapping[str, Spectrum] | None = None

    def __post_init__(self) -> None:
        points = mixtures.checked_list(f"{_WHO}.points", self.points, "(value, opacity, material)")
        mixtures.check_materials(_WHO, self.materials, self.basis)
        checked = tuple(
            mixtures.checked_point(f"{_WHO}.points[{i}]", point, self.materials)
            for i, point in enumerate(points)
        )
        for i, (left, right) in enumerate(pairwise(checked), start=1):
            if right[0] < left[0]:
                raise TransferError.refused(
                    f"{_WHO}.points[{i}].value",
                    right[0],
                    f"sort the points by value, the previous one has {left[0]:g}",
                    "range",
                )
        object.__setattr__(self, "points", checked)
        step = mixtures.checked_step(_WHO, self.reference_step_mm)
        object.__setattr__(self, "reference_step_mm", step)
        if self.gradient_opacity is not None:
            object.__setattr__(self, "gradient_opacity", _checked_factors(self.gradient_opacity))
        if self.filters is not None:
            filters = mixtures.checked_filters(_WHO, self.filters, self.materials, self.basis)
            if filters and self.gradient_opacity is not None:
                raise TransferError(
                    "filters and gradient_opacity cannot be combined",
                    "give one of them",
                    code="conflict",
                    field=_WHO,
                )
            object.__setattr__(self, "filters", filters)

    def __repr__(self) -> str:
        return f"TransferFunction({len(self.points)} points, {', '.join(self.materials)})"

    def bake(
        self, smallest_spacing_mm: float, size: int | None = None, rows: int | None = None
    ) -> TransferTable:
        """Sample the curve into a table over the span of the points.

        Parameters
        ----------
        smallest_spacing_mm : float
            Smallest spacing of the volume, used if the function has no reference step.
        size : int, optional
            Number of entries; by default 1024 to 65536, or to 4096 with ``gradient_opacity``, by
            the distance of the closest points, and so that entries lie on the points. Warns if
            points are too close even for that. A step at an end takes an entry more.
        rows : int, optional
            Number of rows of a table with gradients; by default 64 to 256, chosen likewise.

        Returns
        -------
        TransferTable
            Opacity (N,), or (G, N) with ``gradient_opacity``.
        """
        values = np.array([value for value, _, _ in self.points])
        own_mixes = [mix for _, _, mix in self.points]
        weights, channels = mixtures.weights_and_channels(own_mixes, self.materials, self.basis)
        weights = np.column_stack([[opacity for _, opacity, _ in self.points], weights])
        used = mixtures.used_materials(own_mixes)
        spectra = {name: curve for name, curve in (self.filters or {}).items() if name in used}
        filters = None
        if spectra and isinstance(self.basis, SpectralBasis):
            filters = mixtures.filter_rows(own_mixes, spectra, self.basis)
        top, factors = None, None
        if self.gradient_opacity is not None:
            gradients, of_gradients = np.array(self.gradient_opacity).T
            top = float(gradients[-1])
            if rows is None:
                rows = _table_size("gradients", gradients, of_gradients[:, None], 0.0, _ROWS)
            factors = np.interp(np.linspace(0, top, rows), gradients, of_gradients)
        low, high = values[0], values[-1]
        if low == high:  # a single value, but a table needs two ends
            high = low + (abs(low) or 1.0)
        limits = _SIZES if factors is None else _SIZES_WITH_GRADIENT
        if size is None:
            size = _table_size("points", values, weights[:, :1], low, limits)
        places = _places(values, low, high, size)
        # A step at an end needs an entry on its other side.
        entry = (high - low) / (size - 1)
        steps = np.diff(places) == 0
        if steps.any() and places[0] == places[1] == 0:
            low, size, places = low - entry, size + 1, places + 1
        if steps.any() and places[-1] == places[-2] == size - 1:
            high, size = high + entry, size + 1

        def entries(side: Literal["left", "right"]) -> Entries:
            sampled = _sample(size, places, weights, side)
            opacity, mixes = sampled[:, 0], sampled[:, 1:]
            if factors is not None:
                opacity = factors[:, None] * opacity
                # Copied, since the device reads the memory as laid out.
                mixes = np.ascontiguousarray(np.broadcast_to(mixes, (len(factors), *mixes.shape)))
            if filters is None:
                return Entries(opacity, mixes, None)
            weighted = _sample(size, places, filters, side)
            # A mean of rows within 0…1 may leave this range by rounding.
            return Entries(opacity, mixes, (weighted[:, :-1] / weighted[:, -1:]).clip(0, 1))

        opacity, mixes, passed = entries("right")
        return TransferTable(
            domain=(float(low), float(high)),
            opacity=opacity,
            material_weights=mixes,
            channels=channels,
            reference_step_mm=self.reference_step_mm or smallest_spacing_mm,
            white=self.basis.white,
            gradient_top=top,
            filters=passed,
            left=entries("left") if steps.any() else None,
        )


def _checked_factors(pairs: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    item, field = "(gradient magnitude, factor)", f"{_WHO}.gradient_opacity"
    checked: list[tuple[float, float]] = []
    for i, pair in enumerate(mixtures.checked_list(field, pairs, item)):
        gradient, factor = mixtures.checked_parts(f"{field}[{i}]", pair, item)
        gradient = mixtures.checked_number(f"{field}[{i}].gradient", gradient)
        remedy = ""
        if not (math.isfinite(gradient) and gradient >= 0):
            remedy = "give 0 or more, value per mm"
        elif checked and gradient <= checked[-1][0]:
            remedy = f"sort by gradient, the previous one is {checked[-1][0]:g}"
        if remedy:
            raise TransferError.refused(f"{field}[{i}].gradient", gradient, remedy, "range")
        checked.append((gradient, mixtures.checked_fraction(f"{field}[{i}].factor", factor)))
    if checked[-1][0] == 0:
        raise TransferError("ends at gradient 0", "add one above 0", code="range", field=field)
    return tuple(checked)


def _sample(size: int, places: Array, rows: Array, side: Literal["left", "right"]) -> Array:
    """Interpolate (P, C) rows at (P,) places to the limits of entries, (size, C), from a side."""
    entries = np.arange(size)
    after = np.searchsorted(places, entries, side)
    a, b = (i.clip(0, len(places) - 1) for i in (after - 1, after))
    gap = places[b] - places[a]
    fraction = np.divide(entries - places[a], gap, out=np.zeros(size), where=gap > 0)[:, None]
    return np.asarray(rows[a] + fraction * (rows[b] - rows[a]))


def _places(values: Array, low: float, high: float, size: int) -> Array:
    """Return the points' places in a table's entries; steps are moved to the nearest one."""
    places = (values - low) / (high - low) * (size - 1)
    nearest = np.rint(places)
    steps = np.diff(values) == 0
    on_step = np.append(steps, False) | np.insert(steps, 0, False)
    return np.where(on_step | (np.abs(places - nearest) < _ON_ENTRY), nearest, places)


def _table_size(noun: str, points: Array, curve: Array, low: float, limits: tuple[int, int]) -> int:
    """Return the number of entries: at least four between the closest points, and on the points.

    ``curve`` is (P, C), the table's values at the points; from ``low`` to the first it is level.
    """
    if low < points[0]:
        points, curve = np.insert(points, 0, low), np.insert(curve, 0, curve[0], axis=0)
    gaps = np.diff(points, prepend=low)
    if not (gaps > 0).any():
        return limits[0]
    i = int(np.where(gaps > 0, gaps, np.inf).argmin())
    span = points[-1] - low
    if span > limits[1] * gaps[i]:
        warnings.warn(
            f"{_WHO}: {noun} at {points[i - 1]:g} and {points[i]:g} are too close for the span "
            f"{low:g}…{points[-1]:g} and may be missed; leave out the outer {noun}",
            VolspecWarning,
            stacklevel=3,
        )
    fewest, cap = int(np.clip(np.ceil(4 * span / gaps[i]), limits[0] - 1, limits[1] - 1)), limits[1]
    # Whole numbers, or decimals, have a common measure.
    decade = 10.0 ** max(math.floor(math.log10(span)), -300)  # less has no reciprocal
    for digits in range(_DIGITS):
        scaled = (points - low) / decade * 10.0**digits
        integers = np.rint(scaled)
        if np.abs(scaled - integers).max() < 1e-9 * scaled[-1]:
            cells = int(integers[-1]) // int(np.gcd.reduce(integers.astype(np.int64)))
            times = min(-(-fewest // cells), (cap - 1) // cells)
            if times > 0:
                return cells * times + 1
            break
    # Otherwise the smallest size for which a kink between entries costs next to nothing, or least.
    sizes = np.arange(fewest, min(_MAX_LONGER * fewest, cap))
    places = (points - low)[:, None] / span * sizes
    if (np.diff(points) == 0).any():  # steps move to an entry: to the nearest ones of all
        fewest = int(np.searchsorted(sizes, 2 * fewest))
        return int(sizes[np.abs(places - np.rint(places)).max(axis=0)[:fewest].argmin()]) + 1
    beside = places - np.floor(places)
    bends = _bends(points, curve)
    loss = (bends[:, None] * beside * (1 - beside)).max(axis=0) * (span / sizes)
    return int(sizes[loss.argmin() if loss.min() > _UNSEEN else (loss <= _UNSEEN).argmax()]) + 1


def _bends(points: Array, curve: Array) -> Array:
    """Return (P,) changes of slope of a curve (P, C) at its points, the largest of its columns."""
    slopes = np.diff(curve, axis=0) / np.diff(points)[:, None]
    bends = np.zeros(len(points))
    bends[1:-1] = np.abs(np.diff(slopes, axis=0)).max(axis=1)
    return bends
