"""Colours that no base spectra surround: a smooth reflectance, or the nearest possible.

    [outside] -> construct

Between the hull of the base colours and the object-colour solid (every reflectance within 0 to 1)
lies what surfaces could have. Of all those of a colour the one with the least second differences
is taken, its own or those of its departure from a mixture at the hull's edge. Beyond the solid
there is none; then the nearest colour's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# XYZ / 100. Constraints are met to 1e-9 and better; a colour missed by more is out of the solid.
_REACHED = 1e-6
_TOLERANCE = 1e-10
# How much smoothness weighs where the colour itself cannot be met: it only settles ties.
_TIES = 1e-7


def smoothest(
    XYZ: Array,
    Q: Array,
    start: Array | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """The smoothest reflectances of colours: min |D2 (x - start)|^2, Q x = XYZ, 0 <= x <= 1.

    Parameters
    ----------
    XYZ : (n, 3) float64
        Y = 100 for white.
    Q : (3, N) float64
        From reflectances to XYZ, the light included.
    start : (n, N) float64, optional
        What to depart from smoothly; a flat spectrum when left out.
    progress : function of a share 0 to 1, optional

    Returns
    -------
    values : (n, N) float64
        Within 0 to 1.
    reached : (n,) bool
        False where no reflectance has the colour: the values are those of the nearest one that
        has, in X/X_n, Y/Y_n, Z/Z_n.
    """
    solve = _smoothest_solver(Q / 100.0)
    values = np.empty((len(XYZ), Q.shape[1]))
    reached = np.ones(len(XYZ), dtype=bool)
    for row, colour in enumerate(XYZ / 100.0):
        x = solve(colour, None if start is None else start[row])
        if np.abs(Q @ x / 100.0 - colour).max() > _REACHED:
            x = _nearest(Q, 100.0 * colour)
            reached[row] = np.abs(Q @ x / 100.0 - colour).max() <= _REACHED
        values[row] = x
        if progress is not None and (row % 64 == 63 or row + 1 == len(XYZ)):
            progress((row + 1) / len(XYZ))
    return values, reached


def _second_differences(size: int) -> Array:
    return np.diff(np.eye(size), 2, axis=0) if size > 2 else np.diff(np.eye(size), axis=0)


def _smoothest_solver(Q: Array) -> Callable[[Array, Array | None], Array]:
    """One interior-point solver for all colours: only its two right sides change."""
    N = Q.shape[1]
    D = _second_differences(N)
    P, q = 2.0 * D.T @ D, np.zeros(N)
    solver, b = _solver(P, q, Q)

    def solve(colour: Array, start: Array | None) -> Array:
        b[:3] = colour
        solver.update(q=q if start is None else -P @ start, b=b)
        return np.clip(solver.solve().x, 0.0, 1.0)

    return solve


def _nearest(Q: Array, colour: Array) -> Array:
    """min |(Q x - colour) / white|^2 within 0 to 1."""
    white = Q.sum(1)
    rows, target = Q / white[:, None], colour / white
    D = _second_differences(Q.shape[1])
    solver, _ = _solver(2.0 * (rows.T @ rows + _TIES * D.T @ D), -2.0 * rows.T @ target, None)
    return np.clip(solver.solve().x, 0.0, 1.0)


def _solver(P: Array, q: Array, equal: Array | None) -> tuple[Any, Array]:
    """A clarabel solver of min x'Px/2 + q'x within 0 to 1, and its right-hand side."""
    import clarabel
    from scipy.sparse import csc_matrix

    N = len(P)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # it would forbid a new right-hand side
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    rows = [-np.eye(N), np.eye(N)]
    b = np.concatenate([np.zeros(N), np.ones(N)])
    cones = [clarabel.NonnegativeConeT(2 * N)]
    if equal is not None:
        rows.insert(0, equal)
        b = np.concatenate([np.zeros(len(equal)), b])
        cones.insert(0, clarabel.ZeroConeT(len(equal)))
    A = csc_matrix(np.vstack(rows))
    return clarabel.DefaultSolver(csc_matrix(np.triu(P)), q, A, b, cones, settings), b
