"""Effects of light on materials: hide one in daylight, make two alike, show a difference.

    panel, picture's menu -> [effects] -> wizards -> state, a comparison, sentences

Each ends in a comparison, before and after a divide: daylight and the light that gives it away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from volspec.appearance.models import delta_E_2000
from volspec.errors import PaletteError
from volspec.relight import LightRig
from volspec.scene import Scene
from volspec.spectra import light
from volspec.transfer import MAX_MATERIALS
from volspec.viewer.model import lights, palette_results, palette_table
from volspec.viewer.model.edit import edit
from volspec.viewer.model.light_rows import MAX_ROWS, LightRow, Rows, only_row, unused_name
from volspec.viewer.model.materials import can_be_exact, with_material_basis
from volspec.viewer.model.palette_edits import with_pick
from volspec.viewer.model.state import ViewState
from volspec.wizard import DiscriminatingLight, Redesigned, displayed_Lab, reveal, show_difference

DIFFERENCE = "difference"
# Requests to the app with this argument end in a comparison.
EFFECT = "effect"
_DAYLIGHTS = ("D65", "D50", "D55", "D60", "D75", "ID50", "ID65", "C")
# CIEDE2000 from which on differences are called so.
_WORDS = ((1.0, "invisible"), (3.0, "hardly visible"), (8.0, "visible"))
# Differences that no light makes as great as this are designed.
_CLEAR, _DESIGNED = 8.0, 20.0


def daylight_row(rows: Rows) -> int | None:
    """Return the index of the first daylight; None if there is none."""
    for index, row in enumerate(rows):
        text = row.texts[0] if len(row.texts) == 1 else None
        if text and (text in _DAYLIGHTS or text.startswith("daylight:")):
            return index
    return None


@edit
def prepare(state: ViewState, materials: tuple[str, ...]) -> ViewState:
    """Pick one or two materials and daylight, which is added if missing, for a wizard."""
    if not set(materials) <= set(state.transfer.materials):
        return state
    if daylight_row(state.lights) is None:
        state = lights.add(state, "D65").state
    index = daylight_row(state.lights)
    if index is None:
        return state
    place = materials[0], palette_table.column_names(state.lights)[index]
    several = frozenset(materials)
    return with_pick(state, place=place, materials=several, within="", black=False, like="")


def find_difference(state: ViewState) -> DiscriminatingLight | Redesigned:
    """Return a light that shows the two picked materials' difference, found or designed.

    Lamps of the library and mixtures of LEDs come first; if they show little, a light and the
    first material, which keeps its colour in daylight, are designed together. Takes seconds.

    Raises VolspecError if there is none.
    """
    if not can_be_exact(state.transfer):
        raise PaletteError(
            f"A difference needs materials as channels: at most {MAX_MATERIALS}, none with a "
            "filter; remove the others in the scene file",
            code="unsupported",
        )
    scene, (one, daylight) = palette_results.wizard_scene(state), palette_table.wizard_place(state)
    two = next(name for name in state.interface.pick.materials if name != one)
    telling = show_difference(scene, one, two, under=daylight)
    if telling.delta_e >= _CLEAR:
        return telling
    new = palette_table.new_name(state)
    return reveal(scene, one, under=new, like=daylight, distance=_DESIGNED)


def with_light(state: ViewState, telling: DiscriminatingLight) -> ViewState:
    """Return the state with a found light, alone; nothing changes if there is no room for it."""
    rows = state.lights
    if len(rows) >= MAX_ROWS:
        return state
    name, label = telling.text, ""
    if telling.is_mixture:
        peaks = [part.partition("*")[0].removeprefix("led:") for part in telling.text.split("+")]
        name, label = "LEDs", f"white of LEDs at {', '.join(peaks)} nm"
    name = unused_name(name, {row.name for row in rows})
    rig = LightRig((light(telling.text, state.document.grid),))
    row = LightRow(name, label, rig, texts=(telling.text,))
    new = replace(state, transfer=with_material_basis(state.transfer))
    return lights.with_last(new, only_row((*rows, row), len(rows)))


@dataclass(frozen=True, slots=True)
class EffectOutcome:
    """Two materials in daylight, before and after, and under the light that shows them best."""

    pair: tuple[str, str]
    daylight: int  # index of a row of lights,
    telling: int  # and of the other one
    before: float  # CIEDE2000 in daylight
    after: float
    revealed: float  # under the telling light


def outcome(begun: ViewState, state: ViewState, kind: str) -> EffectOutcome | None:
    """Return what an effect on the picked materials did; None without daylight or another light."""
    rows, daylight = state.lights, daylight_row(state.lights)
    names = list(state.transfer.materials)
    first, _ = palette_table.wizard_place(begun)
    picked = [name for name in begun.interface.pick.materials if name != first]
    if daylight is None or len(rows) < 2 or first not in names or len(names) < 2:
        return None
    old, new = palette_results.wizard_scene(begun), palette_results.wizard_scene(state)
    candidates = [name for name in (picked or names) if name != first]
    distances = {other: _delta_e(new, daylight, first, other) for other in candidates}
    # A hidden material is compared with the one that it is hidden in.
    second = min(distances, key=distances.__getitem__)
    other_lights = [index for index in range(len(rows)) if index != daylight]
    if kind == DIFFERENCE:
        other_lights = [len(rows) - 1]
    telling = max(other_lights, key=lambda index: _delta_e(new, index, first, second))
    return EffectOutcome(
        (first, second),
        daylight,
        telling,
        _delta_e(old, daylight, first, second),
        distances[second],
        _delta_e(new, telling, first, second),
    )


def _delta_e(scene: Scene, index: int, one: str, two: str) -> float:
    """Return CIEDE2000 of two materials under one of a scene's lights."""
    names = list(scene.materials)
    Lab = displayed_Lab(scene, scene.lights[index])
    return float(delta_E_2000(Lab[names.index(one)], Lab[names.index(two)]))


def with_comparison(state: ViewState, effect: EffectOutcome) -> ViewState:
    """Return the state with daylight right of a divide, and the telling light left of it."""
    rows = state.lights
    new = replace(state, lights=only_row(rows, effect.telling), divide=0.5)
    return lights.choose(replace(new, other=only_row(rows, effect.daylight)), effect.telling)


def sentences(effect: EffectOutcome, rows: Rows) -> tuple[str, ...]:
    """Return an outcome in plain words."""
    one, two = effect.pair
    now, before = describe(effect.after), describe(effect.before)
    change = f"ΔE {effect.after:.1f}, {now}"
    if abs(effect.after - effect.before) >= 0.05:
        change = f"ΔE {effect.before:.1f} before ({before}), {effect.after:.1f} now ({now})"
    row = rows[effect.telling]
    name = f"{row.name} ({row.label})" if row.label and row.label != row.name else row.name
    return (
        f"In daylight, {one} and {two}: {change}",
        f"Under {name}: ΔE {effect.revealed:.1f}, {describe(effect.revealed)}",
    )


def describe(delta_e: float) -> str:
    """Return how visible a difference is.

    >>> [describe(delta_e) for delta_e in (0.3, 2.0, 5.0, 20.0)]
    ['invisible', 'hardly visible', 'visible', 'obvious']
    """
    return next((word for limit, word in _WORDS if delta_e < limit), "obvious")
