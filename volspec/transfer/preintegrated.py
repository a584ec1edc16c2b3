"""Running integrals of a table: the mean of a transfer function over a step, in two reads.

    table -> [preintegrated] -> raycast

A step whose value goes from v₀ to v₁ linearly sees every value between them. What it gathers
is the mean of extinction, and of extinction times shares, over them: the difference of running
integrals over the table, divided by the distance of the two values [1]. So no value of a steep
transfer function is jumped over.

References
----------
[1] Engel, Kraus, Ertl (2001), "High-quality pre-integrated volume rendering using
    hardware-accelerated pixel shading", Graphics Hardware 2001, 9-16. doi:10.1145/383507.383515
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import ShapeError, TransferError
from volspec.transfer.table import TransferTable

Rows = NDArray[np.float32]
Array = NDArray[np.float64]

# What an opaque entry lets through a step; its extinction would be infinite.
LEAST_TRANSMITTANCE = 1e-6
# Nearer positions than this, in entries, have a difference of integrals that is mostly rounding.
NEAREST_POSITIONS = 1 / 64


def integral_rows(table: TransferTable, step_mm: float) -> tuple[Rows, Rows, Rows, Rows]:
    """What the kernel reads: running integrals over the entries, and what they grow by.

    With τ_j = −log(max(1 − α_j, 1e-6)), the extinction of a whole step at entry j, and
    c_j = [τ_j, τ_j s_j1, …, τ_j s_jK], linear between entries, the integral over entry
    positions from 0 to j + f is I_j + f (c_j + f rise_j / 2), 0 ≤ f ≤ 1.

    Parameters
    ----------
    table : TransferTable
        Over values alone, not of labels.
    step_mm : float
        Length of a whole step.

    Returns
    -------
    rows_hi, rows_lo : (N, 1 + K) float32
        I_j = Σ_{i<j} (c_i + c_{i+1}) / 2 as a sum of two: one float32 would lose what small
        segments far along a long table gather.
    rates : (N, 1 + K) float32
        c_j.
    rises : (N, 1 + K) float32
        c_{j+1} − c_j; 0 in the last row.

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
    c = _extinctions(table, step_mm)
    integral = _integral(c)
    high = integral.astype(np.float32)
    low = (integral - high).astype(np.float32)
    rises = np.diff(c, axis=0, append=c[-1:])
    return high, low, c.astype(np.float32), rises.astype(np.float32)


def segment_means(
    table: TransferTable, step_mm: float, front_values: ArrayLike, back_values: ArrayLike
) -> Array:
    """The truth for the kernel: means over the values between the two ends of segments.

    Parameters
    ----------
    table : TransferTable
        Over values alone, not of labels.
    step_mm : float
        Length of a whole step.
    front_values, back_values : (R,)
        Values at a segment's ends, in any order. What lies outside the domain counts as the
        nearest end.

    Returns
    -------
    (R, 1 + K) float64
        Mean extinction of a whole step, and of extinction times each share. Ends nearer than
        1/64 entry take the values in their middle.

    Raises
    ------
    ShapeError
        If fronts and backs are not (R,) both.
    TransferError
        As `integral_rows`.

    Examples
    --------
    >>> table = TransferTable((0, 2), [0, 0.5, 0.5], [[1], [1], [1]], reference_step_mm=1)
    >>> segment_means(table, 1, [0, 1.5, 1], [2, 1.5, 9]).round(4).tolist()
    [[0.5199, 0.5199], [0.6931, 0.6931], [0.6931, 0.6931]]
    """
    c = _extinctions(table, step_mm)
    fronts, backs = (np.asarray(v, dtype=np.float64) for v in (front_values, back_values))
    if fronts.ndim != 1 or fronts.shape != backs.shape:
        raise ShapeError(
            f"segment_means: fronts have shape {fronts.shape}, backs {backs.shape}; "
            "expected (R,) both"
        )
    low, high = table.domain
    last = len(c) - 1
    a, b = ((v - low) / (high - low) * last for v in (fronts, backs))
    integral = _integral(c)
    gathered = _integral_at(c, integral, b) - _integral_at(c, integral, a)
    apart = np.abs(b - a) >= NEAREST_POSITIONS
    mean = gathered / np.where(apart, b - a, 1)[:, None]
    j, f = _split((a + b) / 2, last)
    middle = c[j] + f * (c[j + 1] - c[j])
    return np.where(apart[:, None], mean, middle)


def _extinctions(table: TransferTable, step_mm: float) -> Array:
    """(N, 1 + K) c: extinction of a whole step, and times each share."""
    if table.gradient_top is not None or table.labels:
        kind = "labels" if table.labels else "gradients"
        raise TransferError(
            f"preintegration: the table is of {kind}; it needs a transfer function of values alone"
        )
    if not (math.isfinite(step_mm) and step_mm > 0):
        raise TransferError.refused("preintegration.step_mm", step_mm, "give mm above 0", "range")
    tau = 0.0 - np.log(np.maximum(1 - table.step_opacity(step_mm), LEAST_TRANSMITTANCE))
    return tau[:, None] * np.column_stack([np.ones(len(tau)), table.shares])


def _integral(c: Array) -> Array:
    """(N, C) from position 0 to every entry, c linear in between."""
    integral = np.zeros_like(c)
    np.cumsum((c[:-1] + c[1:]) / 2, axis=0, out=integral[1:])
    return integral


def _integral_at(c: Array, integral: Array, position: Array) -> Array:
    """(R, C) from 0 to any position; beyond the ends the end's rate goes on."""
    last = len(c) - 1
    j, f = _split(position, last)
    inside = integral[j] + f * (c[j] + f * (c[j + 1] - c[j]) / 2)
    below, above = np.minimum(position, 0)[:, None], np.maximum(position - last, 0)[:, None]
    return inside + below * c[0] + above * c[-1]


def _split(position: Array, last: int) -> tuple[NDArray[np.intp], Array]:
    """Entry (R,) and fraction (R, 1) of positions, held to the table."""
    held = position.clip(0, last)
    j = np.minimum(held.astype(np.intp), last - 1)
    return j, (held - j)[:, None]
