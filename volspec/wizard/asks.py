"""The wizards: a scene's materials hidden, revealed, merged, kept.

    Scene -> drawing -> wish -> [asks] -> design -> Redesigned

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, sections 4.4 and 5.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

from volspec.errors import PaletteError, SceneError
from volspec.palette import Cell, Design
from volspec.scene import Scene
from volspec.wizard.colours import Colour, apart, distinct_colours, shown_codes
from volspec.wizard.drawing import Drawing
from volspec.wizard.result import Redesigned, redesigned
from volspec.wizard.wish import Wish, WishedLight

# What must hold while a light is designed too: heavy, as exact would leave the light no way.
_HEAVY = 10.0
# How much the other lights count where materials are merged and split.
_ASIDE = 0.5
# How much colours count that were given, not chosen here.
_GIVEN = 4.0
# How firmly colours that stay are held, until what is asked for is reached.
_HOLDS, _HOLDS_LIGHT = (math.inf, 10.0, 3.0, 1.0, 0.3), (3.0, 0.3)
# How far a constant colour may lie from the one it had, in the display's codes.
_BOXES = (0.0, 0.03, 0.1, 0.25)
# ΔE that an eye does not see, and below which colours count as one.
_ALIKE = 1.0
# Saturated colours lie further apart in CIELAB, which is asked for, than in CIEDE2000.
_MARGINS = (1.5, 3.0)


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
    """Make a material look like another one under a light, or like nothing.

    Under the scene's other lights it keeps its colour as far as it can.

    Parameters
    ----------
    scene : Scene
    material : str
        The one to be hidden.
    under : str
        A light of the scene; or, with ``like``, the name of a new one.
    within : str, optional
        The material that it then looks like; by default the most seen one next to it in the
        transfer function.
    black : bool
        In its place: it reflects nothing under that light, a metameric black. Only a light with
        gaps in its spectrum leaves it any colour elsewhere, so that it wants a new light.
    like : str, optional
        A light of the scene. ``under`` is then designed along, and shows the other materials in
        the colours that they have under this one.
    lamps : sequence of str
        Real lights, whose sum the new one is to be.

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
    drawing = Drawing(scene)
    drawing.material(material)
    host = None
    if not black:
        host = drawing.host(material) if within is None else drawing.material(within)
        drawing.beside(material)
        if host == material:
            raise SceneError(f"{scene.path}: {material!r} cannot hide in itself; name another")
    elif within is not None:
        raise SceneError(f"{scene.path}: {material!r} is either black or like {within!r}; choose")
    about = WishedLight.of(drawing, under, like, lamps)
    wish = Wish(drawing, (material,), about)
    weight = _HEAVY if black or about.new else math.inf
    cells = wish.keep(1.0) | wish.resemble()
    for column in about.columns:
        looks = Cell("black", weight=weight)
        if host is not None:
            looks = Cell("same", other=(host, column), weight=weight)
        cells[material, column] = looks
    return redesigned(scene, wish.design(cells), (material,), about.new)


def reveal(
    scene: Scene,
    material: str,
    *,
    under: str,
    distance: float = 20.0,
    like: str | None = None,
    lamps: Sequence[str] = (),
) -> Redesigned:
    """Make a material stand out from all others under a light.

    Under the scene's other lights it keeps its colours; exactly, if that leaves it what is asked
    for, else as far as it does.

    Parameters
    ----------
    scene : Scene
    material : str
    under : str
        A light of the scene; or, with ``like``, the name of a new one.
    distance : float
        CIEDE2000 from every other material that is enough.
    like, lamps
        As `hide`.

    Returns
    -------
    Redesigned

    Raises
    ------
    SceneError
        If a material or light is unknown, or there is no other material.
    PaletteError
        If the distance cannot be reached: the message says what can be.
    """
    drawing = Drawing(scene)
    others = drawing.beside(material)
    if not 0.0 < distance <= 100.0:
        raise SceneError.refused(
            f"{scene.path}: distance", distance, "give a ΔE above 0, up to 100", "range"
        )
    about = WishedLight.of(drawing, under, like, lamps)
    wish = Wish(drawing, (material,), about)
    furthest = 0.0
    for made in _revealing(wish, material, others, distance):
        places = [((material, column), (one, column)) for one in others for column in about.columns]
        least = min(apart(made, *pair) for pair in places)
        furthest = max(furthest, least)
        if least >= distance:
            found = redesigned(scene, made, (material,), about.new)
            if min(found.delta_e(under, material, one) for one in others) >= distance:
                return found
    raise PaletteError(
        f"{scene.path}: {material!r} comes no further than ΔE {furthest:.1f} from the "
        f"others under {under!r}, {distance:g} is asked for; ask for less"
        + ("" if about.new else ", or for a new light")
    )


def _revealing(
    wish: Wish, material: str, others: Sequence[str], distance: float
) -> Iterator[Design]:
    """Designs that part a material from others, the firmest hold on its other colours first."""
    about = wish.about
    holds = _HOLDS_LIGHT if about.new else _HOLDS
    for hold, margin, other in product(holds, _MARGINS, others):
        far = min(margin * distance, 100.0)
        parted = {
            (material, column): Cell("distinct", other=(other, column), distance=far)
            for column in about.columns
        }
        try:
            yield from wish.designs(wish.keep(hold) | wish.resemble() | parted)
        except PaletteError:  # exact cells may contradict each other; softer ones follow
            if math.isfinite(hold):
                raise


def merge(
    scene: Scene,
    materials: Sequence[str],
    *,
    under: str,
    split: str | None = None,
    colours: Sequence[Colour] = (),
    average: bool = False,
    lamps: Sequence[str] = (),
) -> Redesigned:
    """Give materials one colour under a light, and colours of their own under a new one.

    Parameters
    ----------
    scene : Scene
    materials : sequence of str
        Two or more.
    under : str
        The light of the scene under which they are one.
    split : str, optional
        Name of the new light, which parts them; without it none is made.
    colours : sequence of (red, green, blue)
        What they show under it, the display's codes; by default hues as far apart as can be.
    average : bool
        The one colour is the mean of theirs; else the solver picks it.
    lamps : sequence of str
        Real lights, whose sum the new one is to be.

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
    drawing = Drawing(scene)
    names = tuple(dict.fromkeys(drawing.material(name) for name in materials))
    if len(names) < 2:
        raise SceneError(f"{scene.path}: {', '.join(names) or 'nothing'} alone cannot be merged")
    if colours and (split is None or len(colours) != len(names)):
        what = "a light to part them" if split is None else f"{len(names)} colours, one a material"
        raise SceneError(f"{scene.path}: {len(colours)} colours are given; give {what}")
    one = WishedLight.of(drawing, under, None, ())
    about = one if split is None else WishedLight.of(drawing, split, under, lamps)
    wish = Wish(drawing, names, about)
    codes = shown_codes(drawing)
    cells = wish.keep(_ASIDE) | wish.resemble()
    for column in one.columns:
        own = [codes[name, column] for name in names]
        met = Cell("free", group=f"merged {column}", weight=math.inf)
        if average:
            red, green, blue = (sum(values) / len(own) for values in zip(*own, strict=True))
            met = Cell(colour=(red, green, blue), weight=_HEAVY)
        cells |= {(name, column): met for name in names}
    if split is not None:
        wanted = tuple(colours) or distinct_colours(len(names))
        for name, colour in zip(names, wanted, strict=True):
            cells[name, split] = Cell(colour=colour, weight=_GIVEN if colours else 1.0)
    return redesigned(scene, wish.design(cells), names, about.new)


def keep(scene: Scene, material: str) -> Redesigned:
    """Give a material one colour under all lights of the scene: colour constancy.

    The colour is that under the scene's first light, or near it where that cannot be.

    Parameters
    ----------
    scene : Scene
    material : str

    Returns
    -------
    Redesigned

    Raises
    ------
    SceneError
        If the material is unknown.
    PaletteError
        If no colour near its own is the same under every light.
    """
    drawing = Drawing(scene)
    drawing.material(material)
    columns = [column.name for column in drawing.lights()]
    wish = Wish(drawing, (material,), WishedLight((columns[0],)))
    first = shown_codes(drawing)[material, columns[0]]
    for box in _BOXES:
        low, high = ([min(max(c + d, 0.0), 1.0) for c in first] for d in (-box, box))
        # Not exact: under a mix of two other lights what is the same under both nearly is, too.
        free = Cell("free", group="constant", weight=_HEAVY, low=_triple(low), high=_triple(high))
        made = wish.design({(material, column): free for column in columns})
        if _spread(made, material, columns) < _ALIKE:
            return redesigned(scene, made, (material,), None)
    raise PaletteError(
        f"{scene.path}: no colour near that of {material!r} is the same under "
        f"{', '.join(columns)}; give it a greyer one, or leave out the light with least colours"
    )


def _triple(values: Sequence[float]) -> Colour:
    red, green, blue = values
    return red, green, blue


def _spread(made: Design, material: str, columns: Sequence[str]) -> float:
    """Largest ΔE between the first light and another."""
    first = columns[0]
    return max((apart(made, (material, first), (material, c)) for c in columns[1:]), default=0.0)
