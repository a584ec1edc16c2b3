"""The palette's table of materials under lights, and the ranges of values of a material.

state -> [palette_table] -> Table, Palette -> panels, designs
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from volspec.appearance.spec import Viewing
from volspec.errors import PaletteError, VolspecError, one_line
from volspec.palette import Cell, CellReport, Design, Palette, PaletteSpectrum
from volspec.palette.cells import cell_reports
from volspec.palette.model import Place
from volspec.palette.state import State
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra import light as find_light
from volspec.transfer import Transfer, TransferFunction
from volspec.transfer.mixes import Mix, Point
from volspec.viewer.model import light_rows
from volspec.viewer.model.light_rows import LightRow, Rows, brightest_row
from volspec.viewer.model.materials import clip_spectrum, with_material_basis, with_reflectances
from volspec.viewer.model.palette_targets import (
    LIGHT,
    REFLECTANCE,
    STAY,
    DesignTargets,
    Member,
    PaletteState,
    clipped,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import MOST_PARTS


@dataclass(frozen=True, slots=True)
class Range:
    """Points in a row that have one material.

    Parameters
    ----------
    low, high : float
        Values of the first and the last.
    material : str
        Or several, as a mix is written.
    first, last : int
        Numbers of the points.
    """

    low: float
    high: float
    material: str
    first: int
    last: int


def material_ranges(curve: TransferFunction) -> tuple[Range, ...]:
    """The materials in the order of their values."""
    found: list[Range] = []
    for number, (value, _, mix) in enumerate(curve.points):
        name = _named(mix)
        if found and found[-1].material == name:
            found[-1] = replace(found[-1], high=value, last=number)
        else:
            found.append(Range(value, value, name, number, number))
    return tuple(found)


def with_material_range(
    curve: TransferFunction, low: float, high: float, material: str
) -> TransferFunction:
    """A material for all values from ``low`` to ``high``; opacities stay.

    At both ends stand two points of one value, so that the material begins and ends there at once.
    As it is where the material is unknown, the range is empty, or there are too many points.
    """
    if material not in curve.materials or not low < high:
        return curve
    points = list(curve.points)
    before = [point for point in points if point[0] < low]
    after = [point for point in points if point[0] > high]
    inside = [(v, o, material) for v, o, _ in points if low < v < high]
    # At a step there are several points of one value: what holds below it, and above.
    start = [point for point in points if point[0] == low] or [_at(points, low)]
    end = [point for point in points if point[0] == high] or [_at(points, high)]
    first, last = (low, start[-1][1], material), (high, end[0][1], material)
    left = [start[0]] if before and _named(start[0][2]) != material else []
    right = [end[-1]] if after and _named(end[-1][2]) != material else []
    made = [*before, *left, first, *inside, last, *right, *after]
    return curve if len(made) > MOST_PARTS[TransferFunction] else replace(curve, points=made)


def with_range_material(curve: TransferFunction, number: int, material: str) -> TransferFunction:
    """Another material for one of the `material_ranges`; its points keep value and opacity."""
    own = material_ranges(curve)
    if material not in curve.materials or not 0 <= number < len(own):
        return curve
    first, last = own[number].first, own[number].last
    points = [
        (v, o, material if first <= i <= last else mix)
        for i, (v, o, mix) in enumerate(curve.points)
    ]
    return replace(curve, points=points)


def _named(mix: Mix) -> str:
    if isinstance(mix, str):
        return mix
    shares = [(name, share) for name, share in mix.items() if share > 0]
    if len(shares) == 1 and shares[0][1] == 1.0:
        return shares[0][0]
    return " + ".join(f"{share:.0%} {name}" for name, share in shares)


def _at(points: list[Point], value: float) -> Point:
    """The curve at a value, as a point: opacity and mix run linearly between points."""
    values = [point[0] for point in points]
    opacity = float(np.interp(value, values, [point[1] for point in points]))
    after = int(np.searchsorted(values, value))
    one, two = points[max(after - 1, 0)], points[min(after, len(points) - 1)]
    if _named(one[2]) == _named(two[2]) or two[0] <= one[0]:
        return value, opacity, two[2]
    share = (value - one[0]) / (two[0] - one[0])
    mixed: dict[str, float] = {}
    for mix, part in ((one[2], 1.0 - share), (two[2], share)):
        for name, own in ({mix: 1.0} if isinstance(mix, str) else mix).items():
            mixed[name] = mixed.get(name, 0.0) + part * own
    return value, opacity, {name: min(own, 1.0) for name, own in mixed.items() if own > 0}


# Of a light that is designed freely: what the eye sees well, and times an even light's power.
BAND_NM, MOST_POWER = (420.0, 680.0), 8.0
_NONE = Cell("black")

Columns = tuple[tuple[str, Spectrum], ...]


@dataclass(frozen=True, slots=True)
class Table:
    """The table as the panel shows it.

    Parameters
    ----------
    rows, columns : tuple of str
    spectra : {(kind, name): Spectrum}
    cells : {(row, column): CellReport}
        What is wanted and what is seen.
    complaint : str
        Why there are no cells.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    spectra: Mapping[Member, Spectrum]
    cells: Mapping[Place, CellReport]
    complaint: str = ""

    @property
    def errors(self) -> tuple[float, ...]:
        """ΔE of all that was wished for, without what is only to stay."""
        return self._errors(lambda weight: weight > STAY)

    @property
    def drifts(self) -> tuple[float, ...]:
        """ΔE of what is only to stay."""
        return self._errors(lambda weight: weight <= STAY)

    def _errors(self, counts: Callable[[float], bool]) -> tuple[float, ...]:
        cells = self.cells.values()
        return tuple(c.error for c in cells if c.error is not None and counts(c.weight))

    def place(self, index: int) -> Place | None:
        """A cell by its number, row by row; None where there is none."""
        if not 0 <= index < len(self.rows) * len(self.columns):
            return None
        row, column = divmod(index, len(self.columns))
        return self.rows[row], self.columns[column]

    def index(self, place: Place) -> int:
        """`place` undone."""
        return self.rows.index(place[0]) * len(self.columns) + self.columns.index(place[1])


def table_of(state: ViewState) -> Table:
    """The table of a state; kept until spectra, viewing or targets change."""
    return _table(state.transfer, lit_columns(state), state.relight, state.palette.targets)


def lit_columns(state: ViewState) -> Columns:
    """Each light's name and what it sends to a surface that faces every source."""
    grid, shares = state.document.grid, tuple(state.shading.shares().items())
    names = column_names(state.lights)
    return tuple(
        (name, row.rig.lights[0] if len(row.rig.lights) == 1 else _mixed(row.rig, shares, grid))
        for name, row in zip(names, state.lights, strict=True)
    )


@lru_cache(maxsize=64)
def _mixed(rig: LightRig, shares: tuple[tuple[str, float], ...], grid: SpectralGrid) -> Spectrum:
    """What a surface that faces every source gets of several lights."""
    try:
        return rig.facing(dict(shares)).mixed(grid)
    except VolspecError:  # of groups that this scene has not got
        return rig.mixed(grid)


@lru_cache(maxsize=16)
def _table(transfer: Transfer, lights: Columns, spec: RelightSpec, targets: DesignTargets) -> Table:
    rows, names = tuple(transfer.materials), tuple(name for name, _ in lights)
    spectra = {(REFLECTANCE, name): spectrum for name, spectrum in transfer.materials.items()}
    spectra |= {(LIGHT, name): spectrum for name, spectrum in lights}
    cells = _known(targets.cells, rows, names)
    # Any open row makes it a palette, whose state is what is shown now.
    members = tuple(
        PaletteSpectrum(name, transfer.materials[name], open=True, upper=None) for name in rows
    )
    given = tuple(PaletteSpectrum(name, spectrum) for name, spectrum in lights)
    try:
        palette = Palette(
            *(
                members,
                given,
                cells or {(rows[0], names[0]): _NONE},
                unmeasured_viewing(spec.viewing),
            ),
            transfer.basis.grid,
        )
        reports, _ = cell_reports(State.start(palette), cells)
    except VolspecError as error:
        return Table(rows, names, spectra, {}, one_line(error))
    return Table(rows, names, spectra, {report.place: report for report in reports})


def unmeasured_viewing(viewing: Viewing) -> Viewing:
    """A viewing without what is measured in each picture, as no palette has one."""
    return replace(viewing, adapting="given", fov_deg=None)


def _known(
    cells: Mapping[Place, Cell], rows: tuple[str, ...], names: tuple[str, ...]
) -> dict[Place, Cell]:
    """Cells whose material and light are there: a light may have been removed, or renamed."""

    def there(place: Place | None) -> bool:
        return place is None or (place[0] in rows and place[1] in names)

    return {at: cell for at, cell in cells.items() if there(at) and there(cell.other)}


def palette_of(state: ViewState) -> Palette:
    """What is to be designed: open spectra begin where they are, or anew.

    Raises
    ------
    PaletteError
        If nothing is open or wanted, or targets contradict each other.
    SpectrumError
        If a lamp is unknown.
    """
    board, transfer = state.palette, state.transfer
    targets, grid = board.targets, state.document.grid
    if transfer.basis.observer_deg != 2:
        raise PaletteError("palette: the scene sees with the 10° observer; palettes with that of 2")
    reflectances = tuple(
        PaletteSpectrum(
            *(name, None if is_open and board.from_scratch else spectrum, is_open),
            upper=1.0,
            constant=is_open and name in targets.constant,
        )
        for name, spectrum in transfer.materials.items()
        for is_open in [(REFLECTANCE, name) in targets.open]
    )
    lights = tuple(
        _light(name, spectrum, row_is_single and (LIGHT, name) in targets.open, board, grid)
        for (name, spectrum), row_is_single in zip(
            lit_columns(state), (len(row.rig.lights) == 1 for row in state.lights), strict=True
        )
    )
    names = tuple(transfer.materials), column_names(state.lights)
    return Palette(
        *(
            reflectances,
            lights,
            _known(targets.cells, *names),
            unmeasured_viewing(state.relight.viewing),
        ),
        grid,
        targets.criteria,
    )


def _light(
    name: str, spectrum: Spectrum, is_open: bool, board: PaletteState, grid: SpectralGrid
) -> PaletteSpectrum:
    if not is_open:
        return PaletteSpectrum(name, spectrum)
    begin = None if board.from_scratch else spectrum
    if lamps := board.targets.lamps.get(name):
        mixture = tuple(find_light(lamp, grid) for lamp in lamps)
        return PaletteSpectrum(name, begin, True, mixture=mixture)
    return PaletteSpectrum(name, begin, True, upper=MOST_POWER, band_nm=BAND_NM)


def initial_spectrum(grid: SpectralGrid, number: int) -> Spectrum:
    """What a new light begins with: a wave, another for each number."""
    light = PaletteSpectrum("new", open=True, band_nm=BAND_NM)
    others = tuple(PaletteSpectrum(f"{n}", open=True, band_nm=BAND_NM) for n in range(number))
    grey = PaletteSpectrum("grey", open=True)
    state = State.start(Palette((grey,), (*others, light), {("grey", "new"): _NONE}, grid=grid))
    unit = 100.0 / float(state.Q[1].sum())
    return Spectrum(grid.wavelengths_nm, state.E[-1] / unit, "new")


def with_free_spectrum(state: ViewState, member: Member) -> DesignTargets:
    """Wishes with a spectrum open: what it shows now stays wanted, where nothing else is."""
    targets, table = state.palette.targets, table_of(state)
    if member in targets.open:
        return targets
    side = 0 if member[0] == REFLECTANCE else 1
    cells = dict(targets.cells)
    for place, report in table.cells.items():
        if place[side] == member[1] and place not in cells:
            cells[place] = Cell(colour=clipped(report.obtained), weight=STAY)
    return replace(targets, cells=cells, open=targets.open | {member})


def with_design(state: ViewState, made: Design, targets: DesignTargets) -> ViewState:
    """The state with the spectra of a design for these targets."""
    palette = made.palette
    reflectances = {
        row.name: clip_spectrum(made.reflectance(row.name), 1.0)
        for row in palette.reflectances
        if row.open
    }
    lights = {row.name: clip_spectrum(made.light(row.name)) for row in palette.lights if row.open}
    return replace(
        state,
        transfer=with_reflectances(with_material_basis(state.transfer), reflectances),
        lights=with_lights(state.lights, lights),
        palette=PaletteState(state.palette.targets, targets),
    )


def wizard_place(state: ViewState) -> Place:
    """The material and the light that wizards are about: of the chosen cell, else what shines."""
    rows, names = tuple(state.transfer.materials), column_names(state.lights)
    row, column = state.interface.pick.place or ("", "")
    lit = names[brightest_row(state.lights)]
    return row if row in rows else rows[-1], column if column in names else lit


def new_name(state: ViewState) -> str:
    """For a light that is to be designed."""
    taken = column_names(state.lights)
    number = next(n for n in range(1, len(taken) + 2) if f"new {n}" not in taken)
    return f"new {number}"


def column_names(rows: Rows) -> tuple[str, ...]:
    """What a palette calls the lights: their names, numbered where two have one."""
    names: list[str] = []
    for row in rows:
        name, number = row.name, 2
        while name in names:
            name, number = f"{row.name} ({number})", number + 1
        names.append(name)
    return tuple(names)


def with_lights(rows: Rows, changes: Mapping[str, Spectrum]) -> Rows:
    """Lights with other spectra, by their `column_names`; their lux and weights stay."""
    for index, name in enumerate(column_names(rows)):
        if name in changes and len(rows[index].rig.lights) == 1:
            rig = replace(rows[index].rig, lights=(changes[name],))
            rows = light_rows.with_changes(rows, index, rig=rig, kelvin=None)
    return rows


def with_new_light(rows: Rows, name: str, label: str, spectrum: Spectrum) -> Rows:
    """One more light, which then shines alone; as they are where there is no room."""
    if len(rows) >= light_rows.MOST_ROWS:
        return rows
    row = LightRow(name, label, LightRig((spectrum,)))
    return light_rows.only_row((*rows, row), len(rows))
