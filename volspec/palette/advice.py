"""Suggest changes to a palette: each is tried, and reported with the figures it achieves.

design, measures -> [advice] -> report
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volspec.errors import InputError
from volspec.palette.measures import CellReport, DesignMeasures
from volspec.palette.model import Cell, Palette, Place, hexadecimal
from volspec.palette.optimisation import Design, design
from volspec.palette.variables import PaletteSpectrum

VISIBLE = 1.0
"""CIEDE2000 just visible side by side."""
_MAX_CELLS = 3
_MORE_ITERATIONS = 4
_WEIGHT_FACTOR, _EXPOSURE_FACTOR = 4.0, 1.5
# An improvement by less than this fraction, or by less than this ΔE, is not suggested.
_MIN_FRACTION, _MIN_dE = 0.1, 0.05


def suggestions(design: Design) -> tuple[str, ...]:
    """Return sentences: more iterations, worst cells weighted, freed or out of reach, more light.

    Each change is tried on its own on the given palette, so the figures are what the user will
    get. Changes that do not help are left out. This takes about ten times as long as the design.

    Parameters
    ----------
    design : Design

    Returns
    -------
    tuple of str
        Empty if no cell differs visibly from its target.

    Examples
    --------
    >>> import volspec as vs
    >>> vs.suggestions(vs.design(vs.load_palette("data/palettes/figure-2.toml")))
    ()
    """
    palette, now = design.state.palette, DesignMeasures.measured(design)
    if now.max <= VISIBLE:
        return ()
    sentences = list(_with_iterations(palette, now))
    ranked = sorted((c for c in now.cells if c.error is not None), key=lambda c: -(c.error or 0.0))
    worst = [cell for cell in ranked if (cell.error or 0.0) > VISIBLE][:_MAX_CELLS]
    sentences += [sentence for cell in worst for sentence in _for_cell(design, now, cell)]
    return (*sentences, *_with_exposure(palette, now))


def _report(palette: Palette) -> DesignMeasures | None:
    try:
        return DesignMeasures.measured(design(palette, again=True))
    except InputError:  # a trial may be impossible, or start from a light without luminance
        return None


def _helps(before: float, after: float | None) -> bool:
    if after is None:
        return False
    return after < (1.0 - _MIN_FRACTION) * before and before - after > _MIN_dE


def _with_iterations(palette: Palette, now: DesignMeasures) -> Iterator[str]:
    rounds = palette.criteria.rounds
    longer = replace(palette.criteria, rounds=rounds + _MORE_ITERATIONS)
    after = _report(replace(palette, criteria=longer))
    if after and _helps(now.mean, after.mean):
        yield (
            f"rounds {longer.rounds} instead of {rounds} bring the mean ΔE from {now.mean:.2f} "
            f"to {after.mean:.2f}"
        )


def _with_exposure(palette: Palette, now: DesignMeasures) -> Iterator[str]:
    bright = [s.name for s in now.spectra if s.kind == "reflectance" and s.at_upper]
    if not bright:
        return
    exposure = float(f"{_EXPOSURE_FACTOR * now.exposure:.3g}")
    after = _report(palette.with_exposure(exposure))
    if after and _helps(now.mean, after.mean):
        yield (
            f"exposure {exposure:g} instead of {now.exposure:g} brings the mean ΔE from "
            f"{now.mean:.2f} to {after.mean:.2f}: {', '.join(bright)} reach their upper bound"
        )


def _for_cell(solution: Design, now: DesignMeasures, cell: CellReport) -> Iterator[str]:
    palette = solution.state.palette
    where, error = f"({cell.reflectance}, {cell.light})", cell.error or 0.0
    if nearest := _nearest_if_out_of_reach(solution.palette, cell):
        target = "" if cell.wanted is None else f" {hexadecimal(cell.wanted)}"
        yield (
            f"{where}:{target} is out of reach at exposure {now.exposure:g}, even alone; the "
            f"nearest is {hexadecimal(nearest.obtained)}, ΔE {nearest.error:.1f}"
        )
    spec = palette.cells.get(cell.place)
    if spec is None:  # implied by a constant row
        return
    if not nearest and math.isfinite(spec.weight):
        more = replace(spec, weight=_WEIGHT_FACTOR * spec.weight)
        after = _report(replace(palette, cells={**palette.cells, cell.place: more}))
        if after and _helps(error, after.cell(cell.place).error):
            old, then = _mean_of_others(now, cell.place), _mean_of_others(after, cell.place)
            yield (
                f"{where}: weight {more.weight:g} instead of {spec.weight:g} brings ΔE {error:.1f} "
                f"to {after.cell(cell.place).error:.1f}; the others' mean goes from {old:.2f} to "
                f"{then:.2f}"
            )
    yield from _without_cell(palette, now, cell.place, where)


def _without_cell(palette: Palette, now: DesignMeasures, place: Place, where: str) -> Iterator[str]:
    cells: dict[Place, Cell] = {key: cell for key, cell in palette.cells.items() if key != place}
    after = _report(replace(palette, cells=cells)) if cells else None
    if after and _helps(
        before := _mean_of_others(now, place), then := _mean_of_others(after, place)
    ):
        yield f"{where}: without it, the others' mean ΔE falls from {before:.2f} to {then:.2f}"


def _mean_of_others(report: DesignMeasures, place: Place) -> float:
    errors = [c.error for c in report.cells if c.error is not None and c.place != place]
    return float(np.mean(errors)) if errors else 0.0


def _nearest_if_out_of_reach(palette: Palette, cell: CellReport) -> CellReport | None:
    """Return the nearest colour if the cell cannot be met even alone; None if it can.

    A free reflectance is designed under the light as already designed, within the solid of object
    colours. The light is designed only if the reflectance is given.
    """
    spec = palette.cells.get(cell.place)
    if spec is None or spec.kind not in ("colour", "black"):
        return None
    row = palette.member("reflectance", cell.reflectance)
    column = palette.member("light", cell.light)
    if row.free:
        row = replace(row, constant=False)
        column = PaletteSpectrum(column.name, column.spectrum)
    criteria = replace(palette.criteria, smoothness=0.0, subspace=0.0, rounds=2 * _MORE_ITERATIONS)
    alone = replace(
        palette,
        reflectances=(row,),
        lights=(column,),
        cells={cell.place: replace(spec, weight=1.0)},
        criteria=criteria,
        apart=(),
    )
    report = _report(alone)
    if report is None or report.max <= VISIBLE:
        return None
    return report.cell(cell.place)
