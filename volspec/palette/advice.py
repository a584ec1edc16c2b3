"""What would help a design: tried, and said with the figures that came out.

design -> [advice] -> report
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volspec.errors import InputError
from volspec.palette.cells import CellReport
from volspec.palette.colours import hexadecimal
from volspec.palette.members import PaletteSpectrum
from volspec.palette.model import Cell, Palette, Place
from volspec.palette.report import DesignReport
from volspec.palette.solve import Design, design

VISIBLE = 1.0
"""A CIEDE2000 that side by side is just seen."""
_MOST = 3
_ROUNDS = 4
_WEIGHT, _EXPOSURE = 4.0, 1.5
# What is not better by this share, and by this ΔE, is not worth a sentence.
_SHARE, _LEAST = 0.1, 0.05


def suggestions(made: Design) -> tuple[str, ...]:
    """Sentences: the worst cells weighted, freed or out of reach, and a brighter light.

    Each is the only change of the palette as it was given, designed anew: its figures are what
    the user gets who makes it. What does not help is not said.
    """
    palette, now, said = made.state.palette, DesignReport.of(made), []
    if now.max <= VISIBLE:
        return ()
    rounds = palette.criteria.rounds
    longer = replace(palette.criteria, rounds=rounds + _ROUNDS)
    further = _report(replace(palette, criteria=longer))
    if further and _helps(now.mean, further.mean):
        said.append(
            f"rounds {longer.rounds} instead of {rounds} bring the mean ΔE from {now.mean:.2f} "
            f"to {further.mean:.2f}"
        )
    ranked = sorted((c for c in now.cells if c.error is not None), key=lambda c: -(c.error or 0.0))
    worst = [cell for cell in ranked if (cell.error or 0.0) > VISIBLE][:_MOST]
    said += [sentence for cell in worst for sentence in _of_cell(made, now, cell)]
    return (*said, *_of_exposure(palette, now))


def _report(palette: Palette) -> DesignReport | None:
    try:
        return DesignReport.of(design(palette))
    except InputError:  # what is tried may be impossible, or begin with a light that is none
        return None


def _of_cell(made: Design, now: DesignReport, cell: CellReport) -> Iterator[str]:
    palette = made.state.palette
    where, error = f"({cell.reflectance}, {cell.light})", cell.error or 0.0
    if nearest := _out_of_reach(made.palette, cell):
        wish = "" if cell.wanted is None else f" {hexadecimal(cell.wanted)}"
        yield (
            f"{where}:{wish} is beyond what its bounds allow at exposure {now.exposure:g}, even "
            f"by itself; the nearest is {hexadecimal(nearest.obtained)}, ΔE {nearest.error:.1f}"
        )
    own = palette.cells.get(cell.place)
    if own is None:  # a constant row wants it
        return
    if not nearest and math.isfinite(own.weight):
        more = replace(own, weight=_WEIGHT * own.weight)
        after = _report(replace(palette, cells={**palette.cells, cell.place: more}))
        if after and _helps(error, after.cell(cell.place).error):
            rest, then = _rest(now, cell.place), _rest(after, cell.place)
            yield (
                f"{where}: weight {more.weight:g} instead of {own.weight:g} brings ΔE {error:.1f} "
                f"to {after.cell(cell.place).error:.1f}; the others' mean goes from {rest:.2f} to "
                f"{then:.2f}"
            )
    yield from _freed(palette, now, cell.place, where)


def _freed(palette: Palette, now: DesignReport, place: Place, where: str) -> Iterator[str]:
    cells: dict[Place, Cell] = {at: cell for at, cell in palette.cells.items() if at != place}
    after = _report(replace(palette, cells=cells)) if cells else None
    if after and _helps(before := _rest(now, place), then := _rest(after, place)):
        yield f"{where}: left free, the others' mean ΔE falls from {before:.2f} to {then:.2f}"


def _rest(report: DesignReport, place: Place) -> float:
    errors = [c.error for c in report.cells if c.error is not None and c.place != place]
    return float(np.mean(errors)) if errors else 0.0


def _out_of_reach(palette: Palette, cell: CellReport) -> CellReport | None:
    """What comes nearest where nothing but this colour is asked of its spectrum; None if it is met.

    A reflectance is sought under the light as it is designed: the solid of object colours. Only
    where it stands a light is sought on it.
    """
    own = palette.cells.get(cell.place)
    if own is None or own.kind not in ("colour", "black"):
        return None
    row = palette.member("reflectance", cell.reflectance)
    column = palette.member("light", cell.light)
    if row.open:
        row = replace(row, constant=False)
        column = PaletteSpectrum(column.name, column.spectrum)
    alone = replace(
        palette,
        reflectances=(row,),
        lights=(column,),
        cells={cell.place: replace(own, weight=1.0)},
        criteria=replace(palette.criteria, smoothness=0.0, subspace=0.0, rounds=2 * _ROUNDS),
    )
    found = _report(alone)
    if found is None or found.max <= VISIBLE:
        return None
    return found.cell(cell.place)


def _of_exposure(palette: Palette, now: DesignReport) -> Iterator[str]:
    bright = [s.name for s in now.spectra if s.kind == "reflectance" and s.at_upper]
    if not bright:
        return
    exposure = float(f"{_EXPOSURE * now.exposure:.3g}")
    after = _report(palette.with_exposure(exposure))
    if after and _helps(now.mean, after.mean):
        yield (
            f"exposure {exposure:g} instead of {now.exposure:g} brings the mean ΔE from "
            f"{now.mean:.2f} to {after.mean:.2f}: {', '.join(bright)} reach their upper bound"
        )


def _helps(before: float, after: float | None) -> bool:
    return after is not None and after < (1.0 - _SHARE) * before and before - after > _LEAST
