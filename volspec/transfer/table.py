"""Baked transfer functions: tables of opacity, material weights and channels, and their integrals.

    volume -> [transfer] -> raycast -> relight -> appearance

Every entry mixes K rows of channels by weights. The raycaster accumulates the K weights and
multiplies them by the channels once per pixel, so that the cost of a cast does not depend on M.

Pre-integration: a step whose value goes linearly from v₀ to v₁ takes the mean of extinction, and of
extinction times weights, over all values in between, so that no value of a steep transfer function
is skipped. The mean is the difference of running integrals over the table, divided by the
distance of the two values [1].

References
----------
[1] Engel, Kraus, Ertl (2001), "High-quality pre-integrated volume rendering using
    hardware-accelerated pixel shading", Graphics Hardware 2001, 9-16. doi:10.1145/383507.383515
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import ShapeError, TransferError

Rows = NDArray[np.float32]
Array = NDArray[np.float64]

# Limits of the kernels' tables and image headers. Rays sum weights of materials; channels are made
# of them at the end of a ray, so that many cost memory alone.
MAX_CHANNELS = 128
MAX_MATERIALS = 31
MAX_SURFACES = 8
MAX_LABEL = 65535
# Least transmittance of a step; otherwise the extinction of an opaque entry would be infinite.
MIN_TRANSMITTANCE = 1e-6
# For positions nearer than this, in entries, the difference of integrals is mostly rounding.
NEAREST_POSITIONS = 1 / 64


def power_of_two(minimum: float, limits: tuple[int, int]) -> int:
    """Return a table's size: a power of two of at least ``minimum``, clipped to limits.

    >>> power_of_two(3000, (1024, 65536)), power_of_two(3000, (64, 256))
    (4096, 256)
    """
    low, high = limits
    return int(np.clip(2.0 ** np.ceil(np.log2(np.clip(minimum, low, high))), low, high))


class Entries(NamedTuple):
    """A table's arrays at its entries, or their limits from below."""

    opacity: Array
    material_weights: Array
    filters: Array | None

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Shapes of the arrays that are there."""
        return [array.shape for array in self if array is not None]


class OneField:
    """Base of tables of one field: what `FieldTables`, of several, has as well."""

    __slots__ = ()
    channels: NDArray[np.float64]
    masks: ClassVar[Mapping[str, Any]] = {}

    @property
    def size(self) -> int:
        """M, the channels of the picture."""
        return self.channels.shape[1]

    def by_field(self, name: str) -> Mapping[str, tuple[Self, ...]]:
        """Return the tables by field, of which there is one, and by row of its mask."""
        return {name: (self,)}

    def changed(self, change: Callable[[Any, str], Any], name: str = "") -> Any:
        """Return what a function makes of every table and the name of its field."""
        return change(self, name)

    def split_fields(self) -> list[Self]:
        """Return the tables of each field alone."""
        return [self]


@dataclass(frozen=True, slots=True, eq=False)
class TransferTable(OneField):
    """A transfer function over values, or over values and gradients.

    Between entries j and j + 1, everything is linear from entry j to the left limit of the next.

    Parameters
    ----------
    domain : (float, float)
        Values of the first and the last entry; values outside take the nearest end.
    opacity : (N,) or (G, N)
        Opacity per reference step, 0…1.
    material_weights : (N, K) or (G, N, K)
        Weights of the K rows of ``channels``; not premultiplied by opacity.
    reference_step_mm : float
        Length to which ``opacity`` refers.
    white : (M,), optional
        Channels of the perfect diffuser, the colour of highlights; ones if omitted.
    channels : (K, M), optional
        Channels of the materials; if omitted, the identity: the weights are channels.
    gradient_top : float, optional
        Gradient magnitude, value per millimetre, of the last of the G rows; the first has 0.
    filters : (N, M), optional
        Spectral absorption: channels of the transmission at opacity 1; a reference step
        transmits 1 − opacity (1 − filter). If omitted, 0: all wavelengths are absorbed alike.
    labels : bool
        True if entry i is for label i, without interpolation between entries.
    left : Entries, optional
        Limits from below, which differ from the entries where the function steps; none by default.

    Raises
    ------
    TransferError
        If the shapes of the arrays do not match or a number is out of range.
    """

    domain: tuple[float, float]
    opacity: NDArray[np.float64]
    material_weights: NDArray[np.float64]
    reference_step_mm: float
    # None only in the constructor's call: both are always set after __post_init__.
    white: NDArray[np.float64] = None  # type: ignore[assignment]
    channels: NDArray[np.float64] = None  # type: ignore[assignment]
    gradient_top: float | None = None
    filters: NDArray[np.float64] | None = None
    labels: bool = False
    left: Entries | None = None

    def __post_init__(self) -> None:
        low, high = self.domain
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise TransferError.refused(
                "TransferTable.domain", self.domain, "give (low, high)", "range"
            )
        opacity, weights = _set_array(self, "opacity"), _set_array(self, "material_weights")
        two = self.gradient_top is not None
        if opacity.ndim != 1 + two or min(opacity.shape) < 2:
            raise _shape_error(
                self, "opacity", "(N,), or (G, N) with gradient_top, of 2 or more entries"
            )
        _check_range(self, "opacity")
        if weights.ndim != opacity.ndim + 1 or weights.shape[:-1] != opacity.shape:
            raise _shape_error(self, "material_weights", f"{(*opacity.shape, 'K')}, as opacity")
        for name, number in (
            ("reference_step_mm", self.reference_step_mm),
            ("gradient_top", 1.0 if self.gradient_top is None else self.gradient_top),
        ):
            if not (math.isfinite(number) and number > 0):
                raise TransferError.refused(f"TransferTable.{name}", number, "give > 0", "range")
        M = _set_channels(self)
        if self.labels and (two or (low, high) != (0, len(opacity) - 1)):
            raise TransferError(
                f"domain is {self.domain} and opacity has shape {opacity.shape}",
                "expected (0, N - 1) and (N,)",
                code="shape",
                field="TransferTable.labels",
            )
        if self.filters is not None:
            expected = (opacity.shape[-1], M)
            if _set_array(self, "filters").shape != expected or two or self.labels:
                raise _shape_error(self, "filters", f"{expected}, over values alone")
            _check_range(self, "filters")
        if self.left is not None:
            entries = Entries(self.opacity, self.material_weights, self.filters)
            if entries.shapes != self.left.shapes:
                raise TransferError(
                    "differs in shape from the entries",
                    "give limits of opacity, material_weights and filters",
                    code="shape",
                    field="TransferTable.left",
                )

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """(…, M) channels of the reflectance at every entry, not premultiplied."""
        return self.material_weights @ self.channels

    @property
    def left_limits(self) -> TransferTable:
        """Table whose entries are the left limits of this one's."""
        if self.left is None:
            return self
        opacity, weights, filters = self.left
        return replace(self, opacity=opacity, material_weights=weights, filters=filters, left=None)

    @property
    def opacity_key(self) -> tuple[Any, ...]:
        """Value that is equal for tables of equal opacities and filters."""
        scale = self.domain, self.labels, self.reference_step_mm, self.gradient_top
        arrays = self.opacity, self.left_limits.opacity, self.filters
        return *scale, *(None if array is None else array.tobytes() for array in arrays)

    def for_scaled_values(self, scale: float) -> TransferTable:
        """Return the table for a field whose values are multiplied by a scale, unless labels."""
        if scale == 1.0 or self.labels:
            return self
        low, high = self.domain
        top = None if self.gradient_top is None else self.gradient_top * scale
        return replace(self, domain=(low * scale, high * scale), gradient_top=top)

    @property
    def entries_per_value(self) -> float:
        """Table entries per unit of value; `TransferError` if they exceed float32's range."""
        low, high = self.domain
        scale = (self.opacity.shape[-1] - 1) / (high - low)
        if scale > np.finfo(np.float32).max:
            raise TransferError(
                f"spans {high - low:g}, too little for float32",
                "multiply the volume's values",
                code="range",
                field="TransferTable.domain",
                given=self.domain,
            )
        return scale

    def step_opacity(self, step_mm: float) -> NDArray[np.float64]:
        """Opacity of one step: 1 − (1 − opacity)^(step / reference step)."""
        return 1 - (1 - self.opacity) ** (step_mm / self.reference_step_mm)

    def step_transmittance(self, step_mm: float) -> NDArray[np.float64]:
        """(N, M) transmittance of one step, channel by channel, with ``filters``."""
        filters = 0.0 if self.filters is None else self.filters
        transmittance = 1 - self.opacity[:, None] * (1 - filters)
        return transmittance ** (step_mm / self.reference_step_mm)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTable(OneField):
    """Isosurfaces at S levels, each with opacity and reflectance.

    Parameters
    ----------
    values : (S,)
        Levels, rising.
    opacity : (S,)
        A surface's own opacity, 0…1; 1 ends the ray.
    material_weights, channels, white
        (S, K), (K, M), (M,) as in `TransferTable`, and so are the errors.
    """

    values: NDArray[np.float64]
    opacity: NDArray[np.float64]
    material_weights: NDArray[np.float64]
    # None as in TransferTable.
    channels: NDArray[np.float64] = None  # type: ignore[assignment]
    white: NDArray[np.float64] = None  # type: ignore[assignment]
    labels: ClassVar[bool] = False
    filters: ClassVar[None] = None
    left: ClassVar[None] = None

    def __post_init__(self) -> None:
        values, opacity = _set_array(self, "values"), _set_array(self, "opacity")
        weights = _set_array(self, "material_weights")
        if values.ndim != 1 or not 1 <= len(values) <= MAX_SURFACES or (np.diff(values) <= 0).any():
            raise TransferError.refused(
                "SurfaceTable.values",
                values.tolist(),
                f"give 1 to {MAX_SURFACES} rising values",
                "range",
            )
        count = len(values)
        if opacity.shape != (count,):
            raise _shape_error(self, "opacity", f"({count},), as values")
        if weights.ndim != 2 or len(weights) != count:
            raise _shape_error(self, "material_weights", f"({count}, K), as values")
        _check_range(self, "opacity")
        _set_channels(self)

    @property
    def opacity_key(self) -> tuple[Any, ...]:
        """Value that is equal for tables of equal opacities."""
        return self.values.tobytes(), self.opacity.tobytes()

    def for_scaled_values(self, scale: float) -> SurfaceTable:
        """Return the table for a field whose values are multiplied by a scale."""
        return replace(self, values=self.values * scale)


def _set_array(table: TransferTable | SurfaceTable, name: str) -> NDArray[np.float64]:
    """Convert a field to a finite float64 array."""
    array = np.asarray(getattr(table, name), dtype=np.float64)
    if not np.isfinite(array).all():
        raise TransferError(
            "contains NaN or infinite numbers", code="range", field=f"{type(table).__name__}.{name}"
        )
    object.__setattr__(table, name, array)
    return array


def _set_channels(table: TransferTable | SurfaceTable) -> int:
    """Fill in and check ``channels`` and ``white``; return M."""
    K = table.material_weights.shape[-1]
    if table.channels is None:
        object.__setattr__(table, "channels", np.eye(K))
    channels = _set_array(table, "channels")
    if channels.ndim != 2 or len(channels) != K:
        raise _shape_error(table, "channels", f"({K}, M), one row per material weight")
    M = channels.shape[1]
    if table.white is None:
        object.__setattr__(table, "white", np.ones(M))
    if _set_array(table, "white").shape != (M,):
        raise _shape_error(table, "white", f"({M},), as channels")
    return M


def _check_range(table: TransferTable | SurfaceTable, name: str) -> None:
    array = getattr(table, name)
    if not ((array >= 0) & (array <= 1)).all():
        raise TransferError("must be 0…1", code="range", field=f"{type(table).__name__}.{name}")


def _shape_error(table: TransferTable | SurfaceTable, name: str, expected: str) -> TransferError:
    return TransferError(
        f"has shape {getattr(table, name).shape}",
        f"expected {expected}",
        code="shape",
        field=f"{type(table).__name__}.{name}",
    )


def integral_rows(table: TransferTable, step_mm: float) -> tuple[Rows, Rows, Rows, Rows]:
    """Return the kernel's rows: running integrals over the entries, rates, and their increments.

    With τ_j = −log(max(1 − α_j, 1e-6)), the extinction of a whole step at entry j, and
    c_j = [τ_j, τ_j w_j1, …, τ_j w_jK], linear from an entry to the left limit b_{j+1} of the next,
    the integral over entry positions from 0 to j + f is I_j + f (c_j + f rise_j / 2), 0 ≤ f ≤ 1.

    Parameters
    ----------
    table : TransferTable
        A table over values alone, not of labels.
    step_mm : float
        Length of a whole step.

    Returns
    -------
    rows_hi, rows_lo : (N, 1 + K) float32
        I_j = Σ_{i<j} (c_i + b_{i+1}) / 2 as a sum of two, since a single float32 would lose small
        segments far along a long table.
    rates, rises : (N, 1 + K) float32
        c_j, and b_{j+1} − c_j, 0 in the last row.

    Raises
    ------
    TransferError
        If the table has gradients or labels, or the step is not above 0.

    Examples
    --------
    >>> table = TransferTable((0, 2), [0, 0.5, 0.5], [[1], [1], [1]], reference_step_mm=1)
    >>> hi, lo, rates, rises = integral_rows(table, step_mm=1)
    >>> [f"{integral:.4f}" for integral in hi[:, 0]], [f"{rate:.4f}" for rate in rates[:, 0]]
    (['0.0000', '0.3466', '1.0397'], ['0.0000', '0.6931', '0.6931'])
    """
    c, b = _extinctions(table, step_mm)
    integral = _integral(c, b)
    high = integral.astype(np.float32)
    low = (integral - high).astype(np.float32)
    rises = np.append(b[1:] - c[:-1], np.zeros_like(c[:1]), axis=0)
    return high, low, c.astype(np.float32), rises.astype(np.float32)


def segment_means(
    table: TransferTable, step_mm: float, front_values: ArrayLike, back_values: ArrayLike
) -> Array:
    """Return means over the values between the ends of segments: the kernel's NumPy twin.

    Parameters
    ----------
    table, step_mm
        As for `integral_rows`.
    front_values, back_values : (R,)
        Values at a segment's ends, in any order. Values outside the domain take its nearest end.

    Returns
    -------
    (R, 1 + K) float64
        Means of the extinction of a whole step, alone and times each weight. Ends nearer than
        1/64 entry take the values at their midpoint.

    Raises
    ------
    ShapeError
        If fronts and backs are not both (R,).
    TransferError
        As for `integral_rows`.

    Examples
    --------
    >>> table = TransferTable((0, 2), [0, 0.5, 0.5], [[1], [1], [1]], reference_step_mm=1)
    >>> segment_means(table, 1, [0, 1.5, 1], [2, 1.5, 9]).round(4).tolist()
    [[0.5199, 0.5199], [0.6931, 0.6931], [0.6931, 0.6931]]
    """
    c, rim = _extinctions(table, step_mm)
    fronts, backs = (np.asarray(v, dtype=np.float64) for v in (front_values, back_values))
    if fronts.ndim != 1 or fronts.shape != backs.shape:
        raise ShapeError(
            f"segment_means: fronts have shape {fronts.shape}, backs {backs.shape}; "
            "both must be (R,)"
        )
    low, high = table.domain
    last = len(c) - 1
    a, b = ((v - low) / (high - low) * last for v in (fronts, backs))
    integral = _integral(c, rim)
    gathered = _integral_at(c, rim, integral, b) - _integral_at(c, rim, integral, a)
    distinct = np.abs(b - a) >= NEAREST_POSITIONS
    mean = gathered / np.where(distinct, b - a, 1)[:, None]
    j, f = _split((a + b) / 2, last)
    middle = c[j] + f * (rim[j + 1] - c[j])
    return np.where(distinct[:, None], mean, middle)


def _extinctions(table: TransferTable, step_mm: float) -> tuple[Array, Array]:
    """Return c and b (N, 1 + K): extinction of a whole step, alone and times each weight."""
    if table.gradient_top is not None or table.labels:
        kind = "labels" if table.labels else "gradients"
        raise TransferError(
            f"preintegration: the table has {kind}; give a transfer function over values alone",
            code="unsupported",
        )
    if not (math.isfinite(step_mm) and step_mm > 0):
        raise TransferError.refused("preintegration.step_mm", step_mm, "give mm above 0", "range")

    def of(limits: TransferTable) -> Array:
        tau = 0.0 - np.log(np.maximum(1 - limits.step_opacity(step_mm), MIN_TRANSMITTANCE))
        return tau[:, None] * np.column_stack([np.ones(len(tau)), limits.material_weights])

    return of(table), of(table.left_limits)


def _integral(c: Array, b: Array) -> Array:
    """Return the (N, C) integral from position 0 to every entry, linear in between."""
    integral = np.zeros_like(c)
    np.cumsum((c[:-1] + b[1:]) / 2, axis=0, out=integral[1:])
    return integral


def _integral_at(c: Array, b: Array, integral: Array, position: Array) -> Array:
    """Return the (R, C) integral from 0 to any position, with the ends' rates beyond the table."""
    last = len(c) - 1
    j, f = _split(position, last)
    inside = integral[j] + f * (c[j] + f * (b[j + 1] - c[j]) / 2)
    below, above = np.minimum(position, 0)[:, None], np.maximum(position - last, 0)[:, None]
    return inside + below * c[0] + above * c[-1]


def _split(position: Array, last: int) -> tuple[NDArray[np.intp], Array]:
    """Return the entry (R,) and fraction (R, 1) of positions clipped to the table."""
    clipped = position.clip(0, last)
    j = np.minimum(clipped.astype(np.intp), last - 1)
    return j, (clipped - j)[:, None]
