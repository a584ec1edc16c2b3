"""A bounded convex quadratic problem over named blocks of unknowns, and its optimum.

    criteria -> [problem] -> design

    minimise  Σ w² |Σ_b A_b x_b - t|²     over terms
    with      lower <= x_b <= upper, and Σ_b C_b x_b = d

Blocks that no term ties together are solved apart. clarabel finds the optimum, or shows which
equations contradict each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import PaletteError

Array = NDArray[np.float64]

# Of the certificate's largest multiplier: equations below have no part in the contradiction.
_INVOLVED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Unknowns that belong together: a spectrum's, or a free colour.

    Parameters
    ----------
    size : int
    lower, upper : (size,) float64
        Infinite where there is no bound.
    """

    size: int
    lower: Array
    upper: Array


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """Rows that are wanted to hold: Σ_b A_b x_b = target.

    Parameters
    ----------
    parts : {block: (k, n_b)}
    target : (k,)
    weight : float
        Infinite: they must hold.
    label : str
        What a message calls them.
    """

    parts: Mapping[str, Array]
    target: Array
    weight: float
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """What the solver found.

    Parameters
    ----------
    values : {block: (n_b,)}
    cost : float
        The weighted sum of squares.
    residual : float
        Largest violation of the conditions of optimality (Karush, Kuhn, Tucker), relative to the
        problem's numbers.
    """

    values: Mapping[str, Array]
    cost: float
    residual: float


def solve(blocks: Mapping[str, Block], terms: Sequence[Term]) -> Optimum:
    """The optimum.

    Raises
    ------
    PaletteError
        If terms that must hold contradict each other or the bounds.
    """
    values: dict[str, Array] = {}
    cost = residual = 0.0
    for names in _components(blocks, terms):
        own = [term for term in terms if names & term.parts.keys()]
        part = _solve_together({name: blocks[name] for name in blocks if name in names}, own)
        values |= part.values
        cost, residual = cost + part.cost, max(residual, part.residual)
    return Optimum(values, cost, residual)


def _components(blocks: Mapping[str, Block], terms: Sequence[Term]) -> list[set[str]]:
    groups = [{name} for name in blocks]
    for term in terms:
        tied = [group for group in groups if group & term.parts.keys()]
        if len(tied) > 1:
            groups = [group for group in groups if group not in tied] + [set().union(*tied)]
    return groups


def _rows(blocks: Mapping[str, Block], term: Term) -> Array:
    zero = np.zeros
    return np.hstack(
        [term.parts.get(name, zero((term.target.size, b.size))) for name, b in blocks.items()]
    )


def _solve_together(blocks: Mapping[str, Block], terms: Sequence[Term]) -> Optimum:
    import clarabel
    from scipy import sparse

    size = sum(block.size for block in blocks.values())
    lower = np.concatenate([block.lower for block in blocks.values()])
    upper = np.concatenate([block.upper for block in blocks.values()])
    soft = [term for term in terms if np.isfinite(term.weight)]
    hard = [term for term in terms if not np.isfinite(term.weight)]
    M = np.vstack([np.zeros((0, size)), *(term.weight * _rows(blocks, term) for term in soft)])
    y = np.concatenate([np.zeros(0), *(term.weight * term.target for term in soft)])
    C = np.vstack([np.zeros((0, size)), *(_rows(blocks, term) for term in hard)])
    d = np.concatenate([np.zeros(0), *(term.target for term in hard)])
    above, below = np.isfinite(lower), np.isfinite(upper)
    eye = np.eye(size)
    A = np.vstack([C, -eye[above], eye[below]])
    b = np.concatenate([d, -lower[above], upper[below]])
    # Beside the terms nothing counts: this only keeps what they leave open finite.
    P = 2.0 * M.T @ M + 1e-12 * max(1.0, float(np.trace(M.T @ M))) / size * eye
    q = -2.0 * M.T @ y
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1  # one answer on any machine
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    cones = [clarabel.ZeroConeT(len(d)), clarabel.NonnegativeConeT(len(b) - len(d))]
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(P)), q, sparse.csc_matrix(A), b, cones, settings
    ).solve()
    z = np.asarray(found.z)
    if "Infeasible" in str(found.status):
        raise PaletteError(_contradiction(hard, z[: len(d)]))
    x = np.asarray(found.x)
    if not np.isfinite(x).all():
        raise PaletteError(f"palette: the solver gave up ({found.status}); lower the weights")
    x = np.clip(x, lower, upper)
    scale = 1.0 + max(np.abs(P @ x).max(initial=0.0), np.abs(q).max(initial=0.0))
    slack = b - A @ x
    residual = max(
        float(np.abs(P @ x + q + A.T @ z).max(initial=0.0)) / scale,
        float(np.abs(slack[: len(d)]).max(initial=0.0)),
        float(np.abs(slack[len(d) :] * z[len(d) :]).max(initial=0.0)) / scale,
    )
    ends = np.cumsum([block.size for block in blocks.values()])[:-1]
    values = dict(zip(blocks, np.split(x, ends), strict=True))
    return Optimum(values, float(((M @ x - y) ** 2).sum()), residual)


def _contradiction(hard: Sequence[Term], multipliers: Array) -> str:
    """Names the terms that a certificate of infeasibility leans on."""
    ends = np.cumsum([term.target.size for term in hard])[:-1]
    sizes = [float(np.abs(part).max(initial=0.0)) for part in np.split(multipliers, ends)]
    largest = max(sizes, default=0.0)
    guilty = [t.label for t, size in zip(hard, sizes, strict=True) if size > _INVOLVED * largest]
    named = ", ".join(dict.fromkeys(guilty)) or "what must hold"
    return (
        f"palette: no spectrum within its bounds meets {named} exactly; give them finite weights, "
        "free one of them, or raise the exposure"
    )
