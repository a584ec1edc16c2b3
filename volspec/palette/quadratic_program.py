"""Solve a bounded convex quadratic program over named blocks of variables.

    linearisation -> [quadratic_program] -> optimisation

    minimise  Σ w² |Σ_b A_b x_b - t|²     over terms
    with      lower <= x_b <= upper, and Σ_b C_b x_b = d

Blocks that no term connects are solved separately. clarabel finds the optimum, or a certificate
that some equations and bounds contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from volspec.errors import PaletteError

Array = NDArray[np.float64]

# A term whose multiplier is below this fraction of the largest is not part of a contradiction.
_INVOLVED = 1e-3
# If q's largest number is below this fraction of P's, the problem is scaled by P.
_MIN_q = 1e-3
# Residual below which no second solve is needed: a hundredth of the promised accuracy.
_ACCURATE = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class EquationBlock:
    """Variables of one spectrum or one free colour; bounds (size,), infinite if unbounded."""

    size: int
    lower: Array
    upper: Array


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """Weighted equations: Σ_b A_b x_b = target."""

    parts: Mapping[str, Array]  # {block: (k, n_b)}
    target: Array  # (k,)
    weight: float  # infinite: an equality constraint
    label: str  # name in messages


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """Solution of a quadratic program.

    The residual is the largest violation of the Karush-Kuhn-Tucker conditions, relative to the
    problem's scale.
    """

    values: Mapping[str, Array]  # {block: (n_b,)}
    cost: float  # the weighted sum of squares
    residual: float


def solve(blocks: Mapping[str, EquationBlock], terms: Sequence[Term]) -> Optimum:
    """Minimise the weighted terms within the bounds; raise PaletteError if none can be met."""
    values: dict[str, Array] = {}
    cost = residual = 0.0
    for names in _connected_blocks(blocks, terms):
        linked = [term for term in terms if not names.isdisjoint(term.parts)]
        part = _solve_connected({name: blocks[name] for name in blocks if name in names}, linked)
        values |= part.values
        cost, residual = cost + part.cost, max(residual, part.residual)
    return Optimum(values, cost, residual)


def _connected_blocks(blocks: Mapping[str, EquationBlock], terms: Sequence[Term]) -> list[set[str]]:
    groups = [{name} for name in blocks]
    for term in terms:
        if len(term.parts) > 1:
            joined = [group for group in groups if not group.isdisjoint(term.parts)]
            groups = [group for group in groups if group not in joined] + [set().union(*joined)]
    return groups


@dataclass(frozen=True, slots=True, eq=False)
class _Quadratic:
    """Minimise xᵀPx/2 + qᵀx with A x + s = b: s = 0 in the first rows, s >= 0 in the others.

    Rows of A: the equations C x = d, then equal, lower and upper bounds.
    """

    P: Array  # (n, n)
    q: Array  # (n,); P and q have a common scale, so that q is about 1
    C: Array  # (k, n)
    d: Array  # (k,)
    lower: Array  # (n,)
    upper: Array  # (n,)

    @classmethod
    def from_terms(
        cls, blocks: Mapping[str, EquationBlock], places: Mapping[str, slice], terms: Iterable[Term]
    ) -> _Quadratic:
        """Assemble the normal equations of the soft terms, and the rows of the hard ones."""
        size = sum(block.size for block in blocks.values())
        P, q = np.zeros((size, size)), np.zeros(size)
        C, d = [np.zeros((0, size))], [np.zeros(0)]
        for term in terms:
            if math.isinf(term.weight):
                rows = np.zeros((len(term.target), size))
                for name, A in term.parts.items():
                    rows[:, places[name]] = A
                C.append(rows)
                d.append(term.target)
                continue
            twice = 2.0 * term.weight**2
            for name, A in term.parts.items():
                scaled = twice * A.T
                q[places[name]] -= scaled @ term.target
                for other, B in term.parts.items():
                    P[places[name], places[other]] += scaled @ B
        # The solver's tolerances are absolute: scale, so that small weights work as well as large.
        scale = max(float(np.abs(q).max()), _MIN_q * float(np.abs(P).max())) or 1.0
        P, q = P / scale, q / scale
        # Negligible against every term; it only keeps undetermined variables finite.
        P[np.diag_indices(size)] += 1e-12 * max(1.0, 0.5 * float(np.trace(P))) / size
        lower = np.concatenate([block.lower for block in blocks.values()])
        upper = np.concatenate([block.upper for block in blocks.values()])
        return cls(P, q, np.concatenate(C), np.concatenate(d), lower, upper)

    @property
    def bounded(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Indices of the variables with equal bounds, with a lower, and with an upper bound."""
        fixed = self.lower == self.upper
        above, below = np.isfinite(self.lower) & ~fixed, np.isfinite(self.upper) & ~fixed
        return np.flatnonzero(fixed), np.flatnonzero(above), np.flatnonzero(below)

    def minimise(self, refine: bool) -> tuple[str, Array, Array]:
        """Return clarabel's status, x, and multipliers z in the order of A's rows."""
        import clarabel
        from scipy import sparse

        fixed, above, below = self.bounded
        upper_half = np.nonzero(np.triu(self.P))
        P = sparse.csc_matrix((self.P[upper_half], upper_half), self.P.shape)
        row, column = np.nonzero(self.C)
        places = np.concatenate([column, fixed, above, below])
        bounds = len(fixed) + len(above) + len(below)
        rows = np.concatenate([row, len(self.d) + np.arange(bounds)])
        ones = np.ones(bounds)
        ones[len(fixed) : len(fixed) + len(above)] = -1.0
        numbers = np.concatenate([self.C[row, column], ones])
        A = sparse.csc_matrix((numbers, (rows, places)), (len(self.d) + bounds, len(self.q)))
        b = np.concatenate([self.d, self.lower[fixed], -self.lower[above], self.upper[below]])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1  # the same answer on any machine
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        settings.iterative_refinement_enable = refine
        equations = len(self.d) + len(fixed)
        cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(len(b) - equations)]
        solution = clarabel.DefaultSolver(P, self.q, A, b, cones, settings).solve()
        return str(solution.status), np.asarray(solution.x), np.asarray(solution.z)

    @property
    def feasible(self) -> bool:
        """True if some x within the bounds satisfies the equations."""
        return "Infeasible" not in self.minimise(refine=True)[0]

    def without_bound(self, side: str, place: slice) -> _Quadratic:
        """Return the program without the ``"lower"`` or ``"upper"`` bounds in a place."""
        bound = getattr(self, side).copy()
        bound[place] = -math.inf if side == "lower" else math.inf
        return replace(self, **{side: bound})

    def split_multipliers(self, z: Array) -> tuple[Array, Array, Array]:
        """Return the multipliers of the equations (k,) and of the lower and upper bounds (n,)."""
        fixed, above, below = self.bounded
        of_equations, of_fixed, of_lower, of_upper = np.split(
            z, np.cumsum([len(self.d), len(fixed), len(above)])
        )
        low, high = np.zeros(len(self.q)), np.zeros(len(self.q))
        low[above], high[below] = of_lower, of_upper
        low[fixed], high[fixed] = np.maximum(-of_fixed, 0.0), np.maximum(of_fixed, 0.0)
        return of_equations, low, high

    def residual(self, x: Array, z: Array) -> float:
        """Return the largest violation of the optimality conditions by an x within bounds."""
        of_equations, low, high = self.split_multipliers(z)
        Px = self.P @ x
        scale = 1.0 + max(np.abs(Px).max(initial=0.0), np.abs(self.q).max(initial=0.0))
        gradient = Px + self.q + self.C.T @ of_equations - low + high
        # An infinite bound has no multiplier.
        slack_low = np.where(np.isfinite(self.lower), x - self.lower, 0.0)
        slack_high = np.where(np.isfinite(self.upper), self.upper - x, 0.0)
        negative = np.minimum(low, 0.0), np.minimum(high, 0.0)
        violations = (gradient, low * slack_low, high * slack_high, *negative)
        dual = max(float(np.abs(one).max(initial=0.0)) for one in violations)
        return max(dual / float(scale), float(np.abs(self.C @ x - self.d).max(initial=0.0)))


def _solve_connected(blocks: Mapping[str, EquationBlock], terms: Sequence[Term]) -> Optimum:
    ends = list(accumulate((block.size for block in blocks.values()), initial=0))
    places = {name: slice(ends[n], ends[n + 1]) for n, name in enumerate(blocks)}
    quadratic = _Quadratic.from_terms(blocks, places, terms)
    for refine in (False, True):
        status, x, z = quadratic.minimise(refine)
        x = np.clip(x, quadratic.lower, quadratic.upper)
        residual = quadratic.residual(x, z)
        if status == "Solved" and residual < _ACCURATE:
            break
    if "Infeasible" in status:
        raise _contradiction(quadratic, z, places, terms)
    if not math.isfinite(residual):
        raise PaletteError(f"the solver gave up ({status}); lower the weights", code="impossible")
    values = {name: x[place] for name, place in places.items()}
    return Optimum(values, _cost(values, terms), residual)


def _cost(values: Mapping[str, Array], terms: Iterable[Term]) -> float:
    cost = 0.0
    for term in terms:
        if not math.isinf(term.weight):
            off = sum((A @ values[name] for name, A in term.parts.items()), -term.target)
            cost += term.weight**2 * float(off @ off)
    return cost


def _contradiction(
    quadratic: _Quadratic, z: Array, places: Mapping[str, slice], terms: Iterable[Term]
) -> PaletteError:
    """Return an error that names the contradicting terms and the bounds worth widening."""
    of_equations, low, high = quadratic.split_multipliers(z)
    hard = [term for term in terms if math.isinf(term.weight)]
    parts = np.split(of_equations, np.cumsum([len(term.target) for term in hard])[:-1])
    sizes = [float(np.abs(part).max()) for part in parts]
    exact = [term.label for term, size in zip(hard, sizes, strict=True) if _is_unmet(size, sizes)]
    sides = [
        (many[place].max(initial=0.0), side, name)
        for name, place in places.items()
        for side, many in (("lower", low), ("upper", high))
    ]
    sizes = [size for size, _, _ in sides]
    widen = [
        f"the {side} bound of {name}"
        for size, side, name in sides
        if _is_unmet(size, sizes) and quadratic.without_bound(side, places[name]).feasible
    ]
    remedy = "give finite weights, free one of them, or change the exposure"
    return PaletteError(
        f"no spectrum within its bounds meets {', '.join(dict.fromkeys(exact))} exactly",
        f"widen {' or '.join(widen)}, {remedy}" if widen else remedy,
        code="impossible",
    )


def _is_unmet(size: float, sizes: Sequence[float]) -> bool:
    return size > _INVOLVED * max(sizes)
