"""The palette's table of materials under lights, and the materials of ranges of values.

state -> [palette_table] -> Table, Palette -> panels, designs
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import numpy as np

from volspec.errors import PaletteError, VolspecError, one_line
from volspec.palette import (
    Apart,
    ApartReport,
    Cell,
    CellReport,
    Design,
    DesignState,
    Palette,
    PaletteSpectrum,
    Place,
    apart_reports,
    report_cells,
)
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra import light as find_light
from volspec.transfer import Mix, Point, Transfer, TransferFunction, mix_weights
from volspec.viewer.model import light_rows
from volspec.viewer.model.light_rows import Rows
from volspec.viewer.model.materials import clip_spectrum, with_material_basis, with_reflectances
from volspec.viewer.model.palette_targets import (
    LIGHT,
    REFLECTANCE,
    STAY,
    DesignTargets,
    Member,
    PaletteState,
    clip_codes,
)
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import MAX_PARTS


@dataclass(frozen=True, slots=True)
class Range:
    """Values of consecutive points with the same material, or the same weighted mix."""

    low: float
    high: float
    material: str


def material_ranges(curve: TransferFunction) -> tuple[Range, ...]:
    """Return the materials of a curve in the order of their values."""
    return tuple(
        Range(points[0][0], points[-1][0], _mix_name(points[0][2])) for points in _runs(curve)
    )


def _runs(curve: TransferFunction) -> list[list[Point]]:
    """Return the points of each of the `material_ranges`."""
    return [list(run) for _, run in groupby(curve.points, lambda point: _mix_name(point[2]))]


def with_material_range(
    curve: TransferFunction, low: float, high: float, material: str
) -> TransferFunction:
    """Assign a material to all values from ``low`` to ``high``; opacities stay.

    Two points of equal value at each end make the change sharp. Nothing changes if the material is
    unknown, the range is empty, or there would be too many points.
    """
    if material not in curve.materials or not low < high:
        return curve
    points = list(curve.points)
    before = [point for point in points if point[0] < low]
    after = [point for point in points if point[0] > high]
    inside = [(v, o, material) for v, o, _ in points if low < v < high]
    # At a step, several points have the same value: the first applies below it, the last above.
    start = [point for point in points if point[0] == low] or [_interpolate(points, low)]
    end = [point for point in points if point[0] == high] or [_interpolate(points, high)]
    first, last = (low, start[-1][1], material), (high, end[0][1], material)
    left = [start[0]] if before and _mix_name(start[0][2]) != material else []
    right = [end[-1]] if after and _mix_name(end[-1][2]) != material else []
    merged = [*before, *left, first, *inside, last, *right, *after]
    return curve if len(merged) > MAX_PARTS[TransferFunction] else replace(curve, points=merged)


def with_range_material(curve: TransferFunction, number: int, material: str) -> TransferFunction:
    """Assign a material to one of the `material_ranges`; values and opacities stay."""
    runs = _runs(curve)
    if material not in curve.materials or not 0 <= number < len(runs):
        return curve
    runs[number] = [(value, opacity, material) for value, opacity, _ in runs[number]]
    return replace(curve, points=[point for run in runs for point in run])


def _mix_name(mix: Mix) -> str:
    weights = [(name, weight) for name, weight in mix_weights(mix).items() if weight > 0]
    if len(weights) == 1 and weights[0][1] == 1.0:
        return weights[0][0]
    return " + ".join(f"{weight:.0%} {name}" for name, weight in weights)


def _interpolate(points: list[Point], value: float) -> Point:
    """Return the curve's point at a value: opacity and mix are linear between points."""
    values = [point[0] for point in points]
    opacity = float(np.interp(value, values, [point[1] for point in points]))
    after = int(np.searchsorted(values, value))
    one, two = points[max(after - 1, 0)], points[min(after, len(points) - 1)]
    if _mix_name(one[2]) == _mix_name(two[2]) or two[0] <= one[0]:
        return value, opacity, two[2]
    t = (value - one[0]) / (two[0] - one[0])
    first, second = mix_weights(one[2]), mix_weights(two[2])
    weights = {
        name: min((1.0 - t) * first.get(name, 0.0) + t * second.get(name, 0.0), 1.0)
        for name in {**first, **second}
    }
    return value, opacity, {name: weight for name, weight in weights.items() if weight > 0}


# Limits of a freely designed light: the wavelengths of high visibility, and the greatest power
# of a band relative to the mean.
_BAND_NM, _MAX_POWER = (420.0, 680.0), 8.0
_NONE = Cell("black")

Columns = tuple[tuple[str, Spectrum], ...]


@dataclass(frozen=True, slots=True)
class PaletteTable:
    """Materials under lights, as the panel shows them."""

    rows: tuple[str, ...]  # names of materials
    columns: tuple[str, ...]  # names of lights
    spectra: Mapping[Member, Spectrum]
    cells: Mapping[Place, CellReport]  # target and obtained colours by row and column
    complaint: str = ""  # error message if there are no cells
    apart: tuple[ApartReport, ...] = ()  # materials to be distinguished

    @property
    def errors(self) -> tuple[float, ...]:
        """ΔE of all targets, without cells that should only keep their colour."""
        cells = self.cells.values()
        return tuple(c.error for c in cells if c.error is not None and c.weight > STAY)

    @property
    def drifts(self) -> tuple[float, ...]:
        """ΔE of cells that should only keep their colour."""
        cells = self.cells.values()
        return tuple(c.error for c in cells if c.error is not None and c.weight <= STAY)

    def place(self, index: int) -> Place | None:
        """Return the cell with a number, row by row; None if there is none."""
        if not 0 <= index < len(self.rows) * len(self.columns):
            return None
        row, column = divmod(index, len(self.columns))
        return self.rows[row], self.columns[column]

    def index(self, place: Place) -> int:
        """Return the number of a cell, the inverse of `place`."""
        return self.rows.index(place[0]) * len(self.columns) + self.columns.index(place[1])


def colour_table(state: ViewState) -> PaletteTable:
    """Return the table of a state, cached while spectra, viewing and targets stay the same."""
    return _table(state.transfer, lit_columns(state), shown_spec(state), state.palette.targets)


def lit_columns(state: ViewState) -> Columns:
    """Return each light's name, and its spectrum on a surface that faces every source."""
    grid, group_shares = state.document.grid, tuple(state.shading.shares().items())
    names = column_names(state.lights)
    spectra = []
    for row in state.lights:
        facing = None
        if state.room is not None:
            facing = light_rows.facing_light((replace(row, weight=1.0, muted=False),), state.room)
        rig = facing or row.rig
        one = len(rig.lights) == 1
        spectra.append(rig.lights[0] if one else _mixed_spectrum(rig, group_shares, grid))
    return tuple(zip(names, spectra, strict=True))


def may_design(state: ViewState, index: int) -> bool:
    """Return True if a light's spectrum may be designed: it is one, and no room changes it."""
    return state.room is None and len(state.lights[index].rig.lights) == 1


@lru_cache(maxsize=64)
def _mixed_spectrum(
    rig: LightRig, group_shares: tuple[tuple[str, float], ...], grid: SpectralGrid
) -> Spectrum:
    """Return the sum of several lights on a surface that faces every source."""
    try:
        return rig.facing(dict(group_shares)).mixed(grid)
    except VolspecError:  # its groups are not in this scene
        return rig.mixed(grid)


@lru_cache(maxsize=16)
def _table(
    transfer: Transfer, lights: Columns, spec: RelightSpec, targets: DesignTargets
) -> PaletteTable:
    rows, names = tuple(transfer.materials), tuple(name for name, _ in lights)
    spectra = {(REFLECTANCE, name): spectrum for name, spectrum in transfer.materials.items()}
    spectra |= {(LIGHT, name): spectrum for name, spectrum in lights}
    cells = _existing_cells(targets.cells, rows, names)
    # A palette needs a free row; its starting state is the current one.
    members = tuple(
        PaletteSpectrum(name, transfer.materials[name], free=True, upper=None) for name in rows
    )
    lamps = tuple(PaletteSpectrum(name, spectrum) for name, spectrum in lights)
    some_cells = cells or {(rows[0], names[0]): _NONE}
    try:
        viewing = spec.viewing.unmeasured()
        distinct = _existing_apart(targets.apart, rows, names)
        palette = Palette(members, lamps, some_cells, viewing, transfer.basis.grid, apart=distinct)
        begun = DesignState.start(palette)
        reports, _ = report_cells(begun, cells)
        pairs = tuple(apart_reports(begun, cells))
    except VolspecError as error:
        return PaletteTable(rows, names, spectra, {}, one_line(error))
    by_place = {report.place: report for report in reports}
    return PaletteTable(rows, names, spectra, by_place, apart=pairs)


def _existing_cells(
    cells: Mapping[Place, Cell], rows: tuple[str, ...], names: tuple[str, ...]
) -> dict[Place, Cell]:
    """Return the cells whose materials and lights still exist."""

    def exists(place: Place) -> bool:
        return place[0] in rows and place[1] in names

    return {key: cell for key, cell in cells.items() if exists(key) and exists(cell.other or key)}


def _existing_apart(
    distinct: tuple[Apart, ...], rows: tuple[str, ...], names: tuple[str, ...]
) -> tuple[Apart, ...]:
    """Return the rows with the materials and lights that still exist."""
    name_maps = {name: name for name in rows}, {name: name for name in names}
    return tuple(existing for row in distinct if (existing := row.renamed(*name_maps)) is not None)


def palette_from_state(state: ViewState) -> Palette:
    """Return a state's targets as a palette to design.

    Raises PaletteError if nothing is free or has a target, or targets contradict each other;
    SpectrumError if a lamp is unknown.
    """
    board, transfer, grid = state.palette, state.transfer, state.document.grid
    targets = board.targets
    if transfer.basis.observer_deg != 2:
        uses = f"the scene uses the {transfer.basis.observer_deg}° observer"
        raise PaletteError(f"palette: {uses}; palettes need the 2° one", code="unsupported")
    reflectances, lights = [], []
    for name, spectrum in transfer.materials.items():
        is_open = (REFLECTANCE, name) in targets.free
        begin = None if is_open and board.from_scratch else spectrum
        constant = is_open and name in targets.constant
        reflectances.append(PaletteSpectrum(name, begin, is_open, upper=1.0, constant=constant))
    for index, (name, spectrum) in enumerate(lit_columns(state)):
        begin = None if board.from_scratch else spectrum
        if not may_design(state, index) or (LIGHT, name) not in targets.free:
            member = PaletteSpectrum(name, spectrum)
        elif lamps := targets.lamps.get(name):
            mixture = tuple(find_light(lamp, grid) for lamp in lamps)
            member = PaletteSpectrum(name, begin, True, mixture=mixture)
        else:
            member = PaletteSpectrum(name, begin, True, upper=_MAX_POWER, band_nm=_BAND_NM)
        lights.append(member)
    names = tuple(transfer.materials), column_names(state.lights)
    return Palette(
        *(tuple(reflectances), tuple(lights), _existing_cells(targets.cells, *names)),
        *(shown_spec(state).viewing.unmeasured(), grid, targets.criteria),
        apart=_existing_apart(targets.apart, *names),
    )


def initial_spectrum(grid: SpectralGrid, number: int) -> Spectrum:
    """Return the spectrum that a new light starts from: a wave that differs with the number."""
    lights = tuple(PaletteSpectrum(f"{n}", free=True, band_nm=_BAND_NM) for n in range(number + 1))
    grey = PaletteSpectrum("grey", free=True)
    state = DesignState.start(
        Palette((grey,), lights, {("grey", lights[-1].name): _NONE}, grid=grid)
    )
    unit = 100.0 / float(state.Q[1].sum())
    return Spectrum(grid.wavelengths_nm, state.E[-1] / unit, "new")


def with_free_spectrum(state: ViewState, member: Member) -> DesignTargets:
    """Return the targets with a spectrum freed; its other cells should keep their colours."""
    targets, table = state.palette.targets, colour_table(state)
    if member in targets.free:
        return targets
    side = 0 if member[0] == REFLECTANCE else 1
    cells = dict(targets.cells)
    for place, report in table.cells.items():
        if place[side] == member[1] and place not in cells:
            cells[place] = Cell(colour=clip_codes(report.obtained), weight=STAY)
    return replace(targets, cells=cells, free=targets.free | {member})


def with_design(state: ViewState, design: Design, targets: DesignTargets) -> ViewState:
    """Return the state with the spectra of a design for these targets."""
    palette = design.palette
    reflectances = {
        s.name: clip_spectrum(design.reflectance(s.name), 1.0)
        for s in palette.reflectances
        if s.free
    }
    lights = {s.name: clip_spectrum(design.light(s.name)) for s in palette.lights if s.free}
    return replace(
        state,
        transfer=with_reflectances(with_material_basis(state.transfer), reflectances),
        lights=with_lights(state.lights, lights),
        palette=PaletteState(state.palette.targets, targets),
    )


def wizard_place(state: ViewState) -> Place:
    """Return the cell for wizards: the chosen one, or the last row under the brightest light."""
    rows, names = tuple(state.transfer.materials), column_names(state.lights)
    row, column = state.interface.pick.place or ("", "")
    brightest = names[light_rows.brightest_row(state.lights)]
    return row if row in rows else rows[-1], column if column in names else brightest


def new_name(state: ViewState) -> str:
    """Return an unused name for a light to design."""
    taken = column_names(state.lights)
    return next(name for n in range(1, len(taken) + 2) if (name := f"new {n}") not in taken)


def column_names(rows: Rows) -> tuple[str, ...]:
    """Return the names of lights, numbered if several have the same."""
    names: list[str] = []
    for row in rows:
        names.append(light_rows.unused_name(row.name, names))
    return tuple(names)


def with_lights(rows: Rows, changes: Mapping[str, Spectrum]) -> Rows:
    """Replace the spectra of lights, given by their `column_names`; lux and weights stay."""
    for index, name in enumerate(column_names(rows)):
        if name in changes and len(rows[index].rig.lights) == 1:
            rig = replace(rows[index].rig, lights=(changes[name],))
            rows = light_rows.with_changes(rows, index, rig=rig, kelvin=None)
    return rows


def with_designed_light(rows: Rows, name: str, label: str, spectrum: Spectrum) -> Rows:
    """Add a light, which then shines alone; nothing changes if there is no room."""
    if len(rows) >= light_rows.MAX_ROWS:
        return rows
    row = light_rows.LightRow(name, label, LightRig((spectrum,)))
    return light_rows.only_row((*rows, row), len(rows))
