"""Wizards: hide, reveal, merge or keep a scene's materials.

    Scene -> scene_palette -> [operations] -> design -> result

A wizard designs the reflectances of its materials, and a light if a new one is wanted; the rest of
the scene is given. Colours that must not change are compared with the original material, which has
its own row.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, sections 4.4 and 5.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from volspec.appearance.display import DeficiencyName, colour_space
from volspec.appearance.models import delta_E_2000
from volspec.errors import Code, PaletteError, SceneError
from volspec.palette import (
    Apart,
    Cell,
    Criteria,
    Design,
    DesignReport,
    Palette,
    PaletteSpectrum,
    Place,
    Triple,
    design,
)
from volspec.scene import Scene
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra import light as find_light
from volspec.wizard.result import NewLight, Redesigned, redesign
from volspec.wizard.scene_palette import ScenePalette, original_name

Cells = dict[Place, Cell]

# Soft-constraint weight instead of an equality if a light is free too, as equalities would fix the
# light at its initial value.
_HEAVY = 10.0
# Weight of the other lights when materials are merged and split.
_OTHER_LIGHTS = 0.5
# Weight of colours that the user gave.
_GIVEN = 4.0
# Weights of colours that should stay, tried until the target is reached.
_STAY, _STAY_NEW_LIGHT = (math.inf, 10.0, 3.0, 1.0, 0.3), (3.0, 0.3)
# Distances of a constant colour from the original, in display codes.
_BOXES = (0.0, 0.03, 0.1, 0.25)
# ΔE below which colours count as equal.
_ALIKE = 1.0
# Distances are designed in CIELAB, in which saturated colours are further apart than in CIEDE2000.
_MARGINS = (1.5, 3.0)
# Iterations; designs with a free light need more.
_ITERATIONS, _ITERATIONS_NEW_LIGHT = 6, 12
# Bounds of a free light: the band that the eye sees well, and multiples of equal-energy power.
_BAND_nm, _MAX_POWER = (420.0, 680.0), 8.0
# Periods of the waves that its design starts from.
_WAVES_NM = (60.0, 45.0, 110.0)
# ΔE below which no other start is tried.
_GOOD = 0.5
# CIELAB of colours that differ only in hue: light, and within sRGB for every hue.
_LIGHTNESS, _CHROMA, _FIRST_DEG = 65.0, 45.0, 30.0


def hide(
    scene: Scene,
    material: str,
    *,
    under: str,
    within: str | None = None,
    black: bool = False,
    like: str | None = None,
    lamps: Sequence[str] = (),
) -> Redesigned:
    """Make a material look like another one under a light, or black.

    Under the scene's other lights it keeps its colour as far as possible.

    Parameters
    ----------
    scene : Scene
    material : str
        Material to hide.
    under : str
        A light of the scene; or, with ``like``, the name of a new one.
    within : str, optional
        Material to look like; by default the most visible neighbour in the transfer function.
    black : bool
        True for a metameric black, which reflects nothing under that light. It has a colour under
        other lights only if that light has gaps in its spectrum, so a new light is needed.
    like : str, optional
        A light of the scene. ``under`` is then designed too, and shows the other materials in the
        colours that they have under ``like``.
    lamps : sequence of str
        Real lights; the new one is a sum of these.

    Returns
    -------
    Redesigned

    Raises
    ------
    SceneError
        If a material or light is unknown, or there is no other material.
    PaletteError
        If the viewing's model has no inverse in closed form.

    Examples
    --------
    >>> import volspec as vs
    >>> scene = vs.Scene.load("data/scenes/engine.toml")
    >>> hidden = vs.hide(scene, "inserts", under="A")
    >>> hidden.delta_e("A", "inserts", "block") < 1
    True
    """
    palette = ScenePalette(scene)
    palette.require_material(material)
    host, refusal = None, ""
    if not black:
        host = palette.surrounding_material(material) if within is None else within
        palette.require_material(host)
        palette.other_materials(material)
        if host == material:
            refusal = f"{material!r} cannot be hidden in itself; name another material"
    elif within is not None:
        refusal = f"{material!r} cannot be both black and like {within!r}; give one of them"
    if refusal:
        raise SceneError(refusal, code="conflict", field="within", given=within)
    target = TargetLight.of(palette, under, like, lamps)
    problem = DesignProblem(palette, (material,), target)
    weight = _HEAVY if black or target.new else math.inf
    cells = problem.keep_colours(1.0) | problem.keep_other_materials()
    for column in target.columns:
        cells[material, column] = (
            Cell("black", weight=weight)
            if host is None
            else Cell("same", other=(host, column), weight=weight)
        )
    return problem.redesign(problem.design(cells))


def reveal(
    scene: Scene,
    material: str,
    *,
    under: str,
    distance: float = 20.0,
    like: str | None = None,
    lamps: Sequence[str] = (),
    deficiency: Sequence[DeficiencyName] = (),
) -> Redesigned:
    """Make a material differ from all others under a light.

    Under the scene's other lights it keeps its colours; exactly if the distance can be reached that
    way, else as far as possible.

    Parameters
    ----------
    scene : Scene
    material : str
    under : str
        A light of the scene; or, with ``like``, the name of a new one.
    distance : float
        Sufficient CIEDE2000 from every other material.
    like, lamps
        As in `hide`.
    deficiency : sequence of {"protan", "deutan", "tritan"}
        Colour-vision deficiencies to viewers with which the material must differ as much, too.

    Returns
    -------
    Redesigned

    Raises
    ------
    SceneError
        If a material or light is unknown, or there is no other material.
    PaletteError
        If the distance cannot be reached; the message states the largest one reached.
    """
    palette = ScenePalette(scene)
    names = palette.other_materials(material)
    if not 0.0 < distance <= 100.0:
        raise SceneError.refused("distance", distance, "give a ΔE above 0, up to 100", "range")
    target = TargetLight.of(palette, under, like, lamps)
    problem = DesignProblem(palette, (material,), target)
    rows = _apart_rows(material, names, target.columns, deficiency)
    pairs = [((material, column), (one, column)) for one in names for column in target.columns]
    furthest = 0.0
    for candidate in _distinct_designs(problem, material, names, distance, rows):
        smallest = min(
            _cell_distance(candidate, *pair, name)
            for pair, name in product(pairs, ("none", *deficiency))
        )
        furthest = max(furthest, smallest)
        if smallest >= distance:
            redesigned = problem.redesign(candidate)
            if min(redesigned.delta_e(under, material, one) for one in names) >= distance:
                return redesigned
    refusal = f"{material!r} gets no further than ΔE {furthest:.1f} from the others under"
    remedy = f"give a smaller distance{'' if target.new else ', or a new light'}"
    refusal = f"{refusal} {under!r}, not {distance:g}"
    raise PaletteError(refusal, remedy, code="impossible", field="distance", given=distance)


def _apart_rows(
    material: str,
    other_names: Sequence[str],
    columns: Sequence[str],
    deficiency: Sequence[DeficiencyName],
) -> tuple[Apart, ...]:
    """Return rows by which viewers with deficiencies distinguish a material from the others."""
    if not deficiency:
        return ()
    try:
        row = Apart(light=tuple(columns), deficiency=tuple(deficiency))
    except PaletteError as error:
        deficiencies = tuple(deficiency)
        raise SceneError.refused("deficiency", deficiencies, error.remedy, error.code) from None
    return tuple(replace(row, reflectance=(material, other)) for other in other_names)


def _distinct_designs(
    problem: DesignProblem,
    material: str,
    other_names: Sequence[str],
    distance: float,
    rows: Sequence[Apart],
) -> Iterator[Design]:
    """Yield designs with a material distinct from others; designs that change least come first."""
    target = problem.target
    weights = _STAY_NEW_LIGHT if target.new else _STAY
    for weight, margin, other in product(weights, _MARGINS, other_names):
        far = min(margin * distance, 100.0)
        distinct = {
            (material, column): Cell("distinct", other=(other, column), distance=far)
            for column in target.columns
        }
        cells = problem.keep_colours(weight) | problem.keep_other_materials() | distinct
        try:
            yield from problem.designs(cells, tuple(replace(row, distance=far) for row in rows))
        except PaletteError:  # exact cells may contradict each other; softer ones follow
            if math.isfinite(weight):
                raise


def merge(
    scene: Scene,
    materials: Sequence[str],
    *,
    under: str,
    split: str | None = None,
    colours: Sequence[Triple] = (),
    average: bool = False,
    lamps: Sequence[str] = (),
) -> Redesigned:
    """Give materials the same colour under a light, and different colours under a new one.

    Parameters
    ----------
    scene : Scene
    materials : sequence of str
        Two or more.
    under : str
        Light of the scene under which they have the same colour.
    split : str, optional
        Name of a new light under which they differ; by default there is no new light.
    colours : sequence of (red, green, blue)
        Display codes under the new light; by default hues as far apart as possible.
    average : bool
        True for the mean of their colours under ``under``; else the solver picks the colour.
    lamps : sequence of str
        Real lights; the new one is a sum of these.

    Returns
    -------
    Redesigned

    Raises
    ------
    SceneError
        If a material or light is unknown, there are fewer than two, or not as many colours.
    PaletteError
        If the viewing's model has no inverse in closed form.
    """
    palette = ScenePalette(scene)
    names = tuple(dict.fromkeys(palette.require_material(name) for name in materials))
    if len(names) < 2:
        refusal = f"{', '.join(names) or 'nothing'} alone cannot be merged; name at least two"
        raise SceneError(refusal, code="missing", field="materials", given=materials)
    if colours and (split is None or len(colours) != len(names)):
        remedy = "split, a new light" if split is None else f"{len(names)}, one per material"
        refusal = f"{len(colours)} colours are given; give {remedy}"
        code: Code = "missing" if split is None else "shape"
        raise SceneError(refusal, code=code, field="colours", given=colours)
    one = TargetLight.of(palette, under, None, ())
    target = one if split is None else TargetLight.of(palette, split, under, lamps)
    problem = DesignProblem(palette, names, target)
    codes = palette.display_codes()
    cells = problem.keep_colours(_OTHER_LIGHTS) | problem.keep_other_materials()
    for column in one.columns:
        merged = Cell("free", group=f"merged {column}", weight=math.inf)
        if average:
            red, green, blue = np.mean([codes[name, column] for name in names], axis=0).tolist()
            merged = Cell(colour=(red, green, blue), weight=_HEAVY)
        cells |= {(name, column): merged for name in names}
    if split is not None:
        targets = tuple(colours) or _distinct_colours(len(names))
        for name, colour in zip(names, targets, strict=True):
            cells[name, split] = Cell(colour=colour, weight=_GIVEN if colours else 1.0)
    return problem.redesign(problem.design(cells))


def keep(scene: Scene, material: str) -> Redesigned:
    """Give a material the same colour under all lights of the scene: colour constancy.

    This is the colour under the scene's first light, or one near it if that is impossible.

    Raises
    ------
    SceneError
        If the material is unknown.
    PaletteError
        If no colour near the material's own can be the same under every light.
    """
    palette = ScenePalette(scene)
    palette.require_material(material)
    columns = [column.name for column in palette.columns()]
    problem = DesignProblem(palette, (material,), TargetLight((columns[0],)))
    places = [(material, column) for column in columns]
    first = np.array(palette.display_codes()[places[0]])
    for box in _BOXES:
        low, high = (tuple(np.clip(first + d, 0.0, 1.0).tolist()) for d in (-box, box))
        # Not exact: constant under two lights is then nearly constant under their mixtures, too.
        free = Cell("free", group="constant", weight=_HEAVY, low=low, high=high)
        trial = problem.design(dict.fromkeys(places, free))
        if max((_cell_distance(trial, places[0], p) for p in places[1:]), default=0.0) < _ALIKE:
            return problem.redesign(trial)
    refusal = f"no colour near that of {material!r} is the same under {', '.join(columns)}"
    remedy = "give a greyer material, or leave out the light that shows the fewest colours"
    raise PaletteError(refusal, remedy, code="impossible", field="material", given=material)


@dataclass(frozen=True, slots=True, eq=False)
class TargetLight:
    """Light that a wizard works for: one of the scene, or a new one to be designed."""

    columns: tuple[str, ...]  # in the palette
    like: tuple[str, ...] = ()  # columns that a new light should resemble
    new: NewLight | None = None

    @classmethod
    def of(
        cls, palette: ScenePalette, name: str, like: str | None, lamps: Sequence[str]
    ) -> TargetLight:
        """Return a light of the scene, or with ``like`` a new one, possibly a mixture of lamps."""
        if like is None:
            if lamps:
                refusal = f"{', '.join(lamps)} are for a new light"
                remedy = "say which light of the scene it is like"
                raise SceneError(refusal, remedy, code="conflict", field="lamps", given=lamps)
            hint = "; for a new light, say with --like which of these it should look like"
            return cls(tuple(palette.light_columns(palette.light(name, hint=hint))))
        palette.require_new_light(name)
        mixture = tuple(find_light(lamp, palette.grid) for lamp in lamps)
        # The eye hardly sees the ends of the spectrum, so power there would grow without limit.
        band, upper = (None, None) if mixture else (_BAND_nm, _MAX_POWER)
        member = PaletteSpectrum(name, free=True, upper=upper, band_nm=band, mixture=mixture)
        resembled = palette.light(like, "like")
        return cls((name,), tuple(palette.light_columns(resembled)), NewLight(member, resembled))


@dataclass(frozen=True, slots=True, eq=False)
class DesignProblem:
    """Materials of a scene to be designed, and the light that they are designed for."""

    palette: ScenePalette
    materials: tuple[str, ...]
    target: TargetLight

    def keep_colours(self, weight: float) -> Cells:
        """Return cells that keep the materials' original colours under all other lights."""
        return {
            (name, column.name): Cell(
                "same", other=(original_name(name), column.name), weight=weight
            )
            for name in self.materials
            for column in self.palette.columns()
            if column.name not in self.target.columns
        }

    def keep_other_materials(self) -> Cells:
        """Return cells that show the other materials under a new light as under ``like``."""
        return {
            (name, self.target.columns[0]): Cell("same", other=(name, self.target.like[0]))
            for name in self.palette.scene.materials
            if self.target.new and name not in self.materials
        }

    def design(self, cells: Cells) -> Design:
        """Return the best design."""
        best, lowest = None, math.inf
        for candidate in self.designs(cells):
            report = DesignReport.of(candidate)
            if best is None or report.cost["colours"] < lowest:
                best, lowest = candidate, report.cost["colours"]
            if report.max < _GOOD:
                break
        assert best is not None  # there is always one
        return best

    def designs(self, cells: Cells, apart_rows: tuple[Apart, ...] = ()) -> Iterator[Design]:
        """Yield designs from several initial lights, as alternation finds only local optima."""
        palette, light = self.palette, self.target.new
        originals = {original_name(name) for name in self.materials}
        compared = any(cell.other and cell.other[0] in originals for cell in cells.values())
        rows, columns = palette.rows(self.materials, originals=compared), palette.columns()
        criteria = Criteria(rounds=_ITERATIONS if light is None else _ITERATIONS_NEW_LIGHT)
        starts = [()] if light is None else ((start,) for start in _starts(light, palette.grid))
        for new in starts:
            lights = (*columns, *new)
            parts = rows, lights, cells, palette.viewing, palette.grid, criteria
            yield design(Palette(*parts, apart=apart_rows), again=True)

    def redesign(self, solution: Design) -> Redesigned:
        """Put a design into the scene."""
        return redesign(self.palette.scene, solution, self.materials, self.target.new)


def _starts(light: NewLight, grid: SpectralGrid) -> Iterator[PaletteSpectrum]:
    """Yield a new light with initial waves of several periods; a mixture of lamps as it is."""
    if light.member.mixture:
        yield light.member
        return
    wavelengths = grid.wavelengths_nm
    for period, phase in product(_WAVES_NM, (0.5, 0.0)):
        wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * ((wavelengths - grid.start_nm) / period + phase))
        inside = (wavelengths >= _BAND_nm[0]) & (wavelengths <= _BAND_nm[1])
        start = Spectrum(wavelengths, wave * inside, light.member.name)
        yield replace(light.member, spectrum=start)


def _cell_distance(solution: Design, one: Place, other: Place, deficiency: str = "none") -> float:
    """Return CIEDE2000 between two cells on the display, to a viewer with a deficiency."""
    models = solution.state.colour_models()
    RGB = solution.state.RGB(models)
    places = map(solution.palette.index, (one, other))
    Lab = [models[j].simulated_Lab(RGB[i, j], deficiency) for i, j in places]
    return float(delta_E_2000(Lab[0], Lab[1]))


def _distinct_colours(count: int) -> tuple[Triple, ...]:
    """Return the display codes of hues as far apart as possible, of one lightness.

    >>> len(set(_distinct_colours(5)))
    5
    """
    space = colour_space("sRGB")
    hues = math.radians(_FIRST_DEG) + 2.0 * math.pi * np.arange(count) / count
    fy = (_LIGHTNESS + 16.0) / 116.0
    fx, fz = fy + _CHROMA * np.cos(hues) / 500.0, fy - _CHROMA * np.sin(hues) / 200.0
    XYZ = space.white_XYZ * np.stack([fx, np.full(count, fy), fz], axis=-1) ** 3
    codes = space.encode(np.clip(XYZ @ space.RGB_from_XYZ.T, 0.0, 1.0))
    return tuple((r, g, b) for r, g, b in codes.tolist())
