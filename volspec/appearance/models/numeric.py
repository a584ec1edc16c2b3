"""Numeric inverses: a root finder in one unknown, and the inverse of any model, in three.

    model.forward; J, C, h -> [invert] -> XYZ
    model.invert_beyond; J, C, h -> [nearest_inverse] -> XYZ

References
----------
[1] Chandrupatla (1997), "A new hybrid quadratic/bisection algorithm for finding the zero of a
    nonlinear function", Advances in Engineering Software 28(3), 145-149.
[2] Nocedal & Wright (2006), *Numerical Optimization*, section 10.3 (Levenberg-Marquardt).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.models.base import Appearance, Array, Model, broadcast, opponents
from volspec.appearance.models.cam import ciecam02
from volspec.appearance.surround import ViewingConditions

_EPSILON = float(np.finfo(np.float64).eps)
# Near the limits of a model's responses XYZ grow without bound; a display's white is 1.
_WITHIN_WHITES = 1000.0
# An error of 2^-12 of the way, in lightness or chroma, is not noticeable.
_HALVINGS = 12
# In glare, bleaching in Hunt's model leaves no light grey without chroma: try darker ones.
_GREYS = (0.2, 0.05, 0.01, 0.0)


def find_root(
    function: Callable[[Array], Array], low: Array, high: Array, iterations: int = 100
) -> Array:
    """Find the zero of an elementwise function between two ends, for all elements at once [1].

    About ten evaluations suffice for smooth functions. NaN if both ends have the same sign.
    """
    a, b = np.array(high, dtype=np.float64), np.array(low, dtype=np.float64)
    f_a, f_b = function(a), function(b)
    bracketed = (f_a <= 0.0) != (f_b <= 0.0)
    bracketed |= (f_a == 0.0) | (f_b == 0.0)
    c, f_c, t = a.copy(), f_a.copy(), np.full_like(a, 0.5)
    with np.errstate(all="ignore"):
        for _ in range(iterations):
            x = a + t * (b - a)
            f_x = function(x)
            same = np.sign(f_x) == np.sign(f_a)
            c, f_c = np.where(same, a, b), np.where(same, f_a, f_b)
            b, f_b = np.where(same, b, a), np.where(same, f_b, f_a)
            a, f_a = x, f_x
            best = np.where(np.abs(f_a) < np.abs(f_b), a, b)
            min_step = 2.0 * _EPSILON * np.abs(best) / np.abs(b - a)
            done = (min_step > 0.5) | (f_a == 0.0) | (f_b == 0.0) | ~bracketed
            if done.all():
                break
            xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
            smooth = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            guess = f_a / (f_b - f_a) * f_c / (f_b - f_c)
            guess += (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
            t = np.where(smooth & np.isfinite(guess), guess, 0.5)
            min_step = np.minimum(min_step, 0.5)
            t = np.where(done, 0.0, np.clip(t, min_step, 1.0 - min_step))
    best = np.where(np.abs(f_a) < np.abs(f_b), a, b)
    return np.where(bracketed, best, np.nan)


def nearest_inverse(
    model: Model, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
) -> Array:
    """Invert a model; colours without an inverse are moved towards grey until one exists.

    At constant hue, lightness moves towards a 20 % grey's until an achromatic XYZ has it, then
    chroma towards 0 until there is an inverse within 1000 times the white. The colours of a display
    thus continue without a jump, as 3-D LUTs need. NaN only for numbers that are not finite.
    """
    look = broadcast(model.NAME, J, C, h)
    white = np.asarray(conditions.white_XYZ)

    def valid(j: Array, c: Array, hue: Array) -> NDArray[np.bool_]:
        XYZ = model.invert_beyond(j, c, hue, conditions)
        # Comparisons with NaN are False.
        return np.asarray(np.all(np.abs(XYZ) <= _WITHIN_WHITES * white, axis=-1))

    XYZ = model.invert_beyond(*look, conditions)
    undefined = np.asarray(~np.isfinite(XYZ).all(axis=-1))
    if undefined.any():
        j, c, hue = (values[undefined] for values in look)
        greys = model.forward(np.outer(_GREYS, white), conditions).J
        grey = greys[np.argmax(valid(greys, 0.0 * greys, 0.0 * greys))]
        ray = j - grey
        j = grey + ray * _longest(lambda t, i: valid(grey + t * ray[i], 0.0 * t, hue[i]), len(j))
        c = c * _longest(lambda t, i: valid(j[i], t * c[i], hue[i]), len(j))
        XYZ[undefined] = model.invert_beyond(j, c, hue, conditions)
    return XYZ


def _longest(valid: Callable[[Array, NDArray[np.intp]], NDArray[np.bool_]], count: int) -> Array:
    """Return the largest ``valid`` fraction of each way, (N,) from 0 to 1, by bisection."""
    fraction = np.ones(count)
    rows = np.flatnonzero(~valid(fraction, np.arange(count)))
    low, high = np.zeros(len(rows)), np.ones(len(rows))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = valid(middle, rows)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    fraction[rows] = low
    return fraction


def invert(
    forward: Callable[[Array, ViewingConditions], Appearance],
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    tolerance: float = 1e-10,
    iterations: int = 60,
) -> Array:
    """Invert any model from its forward alone.

    Levenberg-Marquardt [2] on the cube root of XYZ over the white, with damping per pixel, starting
    from CIECAM02's inverse; pixels that fail restart nearer to grey. NaN if the largest error of J
    and the two parts of C never falls below ``tolerance``.
    """
    target = opponents("numeric inverse", J, C, h).reshape(-1, 3)
    J, C, h = broadcast("numeric inverse", J, C, h)
    C = np.maximum(C, 0.0)
    white = np.asarray(conditions.white_XYZ)

    def miss(u: Array, rows: NDArray[np.intp]) -> Array:
        look = forward(u**3 * white, conditions)
        vector = opponents("numeric inverse", look.J, look.C, look.h)
        return np.nan_to_num(vector - target[rows], nan=1e9)

    u = np.full_like(target, np.nan)
    for start in _starts(J, C, h, conditions):
        rows = np.flatnonzero(np.isnan(u).any(axis=-1))
        if len(rows) == 0:
            break
        u[rows] = _solve(miss, np.asarray(start).reshape(-1, 3)[rows], rows, tolerance, iterations)
    return (u**3 * white).reshape(*J.shape, 3)


def _starts(J: Array, C: Array, h: Array, conditions: ViewingConditions) -> Iterator[Array]:
    """Yield cube roots of XYZ / white to start from: CIECAM02's, halfway to grey, greys."""
    J = np.clip(J, 1.0, 120.0)
    XYZ = ciecam02.inverse(J, np.minimum(C, 120.0), h, conditions)
    neutral = ciecam02.inverse(J, np.zeros_like(J), h, conditions)
    XYZ = np.where(np.isfinite(XYZ), XYZ, neutral)
    near = np.clip(np.cbrt(XYZ / conditions.white_XYZ), 0.01, 2.0)
    yield near
    grey = np.broadcast_to(near[..., 1:2], near.shape)
    yield 0.5 * (near + grey)
    yield grey
    yield np.full_like(near, 0.5)


def _solve(
    miss: Callable[[Array, NDArray[np.intp]], Array],
    u: Array,
    rows: NDArray[np.intp],
    tolerance: float,
    iterations: int,
) -> Array:
    """Run Levenberg-Marquardt from u, (N, 3); NaN if it does not reach the tolerance."""
    u, r = u.copy(), miss(u, rows)
    damping = np.full(len(u), 1e-3)
    left = np.arange(len(u))
    for _ in range(iterations):
        # Steps continue below the tolerance, since each doubles the digits. A pixel that improves
        # with no damping is as near as it can be.
        near = np.abs(r[left]).max(axis=-1, initial=0.0) <= 1e-4 * tolerance
        left = left[~near & (damping[left] < 1e12)]
        if len(left) == 0:
            break
        tried = u[left] + _step(u[left], r[left], damping[left], rows[left], miss)
        r_tried = miss(tried, rows[left])
        better = np.linalg.norm(r_tried, axis=-1) < np.linalg.norm(r[left], axis=-1)
        accepted = left[better]
        u[accepted], r[accepted] = tried[better], r_tried[better]
        damping[left] *= np.where(better, 0.05, 8.0)
        damping = np.maximum(damping, 1e-16)
    converged = np.abs(r).max(axis=-1, initial=0.0) <= tolerance
    return np.where(converged[:, None], u, np.nan)


def _step(
    u: Array,
    r: Array,
    damping: Array,
    rows: NDArray[np.intp],
    miss: Callable[[Array, NDArray[np.intp]], Array],
) -> Array:
    """Return one damped Gauss-Newton step, (N, 3); slopes are central differences."""
    size = 1e-5 * np.maximum(np.abs(u), 0.05)
    columns = []
    for i in range(3):
        offset = size[:, i : i + 1] * np.eye(3)[i]
        columns.append(
            (miss(u + offset, rows) - miss(u - offset, rows)) / (2.0 * size[:, i : i + 1])
        )
    slopes = np.stack(columns, axis=-1)
    transposed = slopes.swapaxes(-1, -2)
    normal = transposed @ slopes
    diagonal = np.einsum("...ii->...i", normal)
    # A pixel's own scale keeps the matrix invertible where a response has no slope.
    floor = 1e-14 * diagonal.max(axis=-1, keepdims=True) + 1e-30
    normal = normal + np.eye(3) * (damping[:, None] * diagonal + floor)[:, None, :]
    return -np.linalg.solve(normal, (transposed @ r[..., None]))[..., 0]
