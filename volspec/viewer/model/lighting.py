"""Light sources of a cast: edits, commands and the handles that aim them in the picture.

    panel, mouse, commands -> [lighting] -> light groups of the RaycastSpec -> cast

A source that is added gets a light group of its own, and thus may get a spectrum of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Place, Projection, radius_mm
from volspec.errors import InputError
from volspec.raycast import Ambient, Directional, Headlight, LightGroup, Point, Source, Spot
from volspec.spectra import Spectrum
from volspec.viewer.model import light_parts, light_rows, lighting_aim
from volspec.viewer.model.cuts import CutHandle, with_overlays
from volspec.viewer.model.edit import (
    Command,
    Edited,
    bind,
    edit,
    refusable,
    switch,
    with_field,
    with_interface,
)
from volspec.viewer.model.lighting_aim import Placed, list_sources
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp, vector

Groups = tuple[LightGroup, ...]
# Names of the kinds of sources, as given to new groups.
KINDS: Mapping[str, type[Source]] = {
    "directional light": Directional,
    "point light": Point,
    "spot": Spot,
    "headlight": Headlight,
    "sky": Ambient,
}
# A new source's fraction of all light; the other sources are dimmed, so that the exposure stays.
_FRACTIONS = {Directional: 0.6, Point: 0.6, Spot: 0.6, Headlight: 0.5, Ambient: 0.35}
# Of a new spot.
_CONE_DEG = 6.0
# A new lamp shines from the upper left of the eye: right, up, back.
_UPPER_LEFT = (-0.6, 0.7, 0.55)
_DIGITS = 3
MAX_INTENSITY = 1e6
FLASHLIGHT = "flashlight"
"""Command, and the tool while the mouse carries one."""
# The least and greatest distance of a point light, in radii of the volume.
_NEAREST, FURTHEST = 0.01, 10.0


def kind_name(source: Source) -> str:
    """Return the name of a source's kind."""
    return next(name for name, kind in KINDS.items() if type(source) is kind)


def chosen_source(state: ViewState) -> int:
    """Return the index of the chosen source."""
    return min(max(state.interface.source, 0), len(list_sources(state.shading)) - 1)


def is_blocked(source: Source) -> bool:
    """Return True if the volume blocks a source's light: shadows, or ambient occlusion."""
    return any(getattr(source, name, False) for name in ("shadows", "occlusion"))


@refusable
def add_source(state: ViewState, kind: str) -> ViewState:
    """Add a light source of a kind as a group of its own, and choose it.

    The other sources are dimmed by as much light as it brings. It shines with the spectrum of each
    light of the list.
    """
    if kind not in KINDS:
        return state
    source, shading = _new_source(state, kind), state.shading
    weight = shading.ambient if isinstance(source, Ambient) else shading.diffuse
    total, fraction = sum(shading.strengths().values()), _FRACTIONS[KINDS[kind]]
    groups = shading.groups
    if total > 0 and weight > 0:
        source = replace(source, intensity=round(min(fraction * total / weight, 1e3), _DIGITS))
        groups = _scale_intensity(groups, 1 - fraction)
    name = light_rows.unused_name(kind, {group.name for group in groups})
    new = _with_groups(state, (*groups, LightGroup(name, (source,))), new_group=name)
    return choose_source(new, len(list_sources(new.shading)) - 1)


def _new_source(state: ViewState, kind: str) -> Source:
    axes = lighting_aim.camera_axes(state)
    if KINDS[kind] is Directional:
        return Directional(vector(np.asarray(_UPPER_LEFT) @ axes), shadows=True)
    if KINDS[kind] is Point:
        # Before the volume, in sight.
        camera = state.view.camera(state.document.volume)
        back = min(1.2 * radius_mm(state.document.volume), 0.5 * camera.distance_mm)
        half = math.tan(math.radians(camera.fov_deg) / 2) * (camera.distance_mm - back)
        side = 0.5 * (half if camera.height_mm is None else camera.height_mm / 2)
        offset = np.array([-side, side, back]) @ axes
        return Point(vector(np.asarray(camera.target_mm) + offset), shadows=True)
    if KINDS[kind] is Spot:
        # A flashlight in the hand, right of the eye and below.
        hand = np.array([0.3, -0.2, 0.0]) * radius_mm(state.document.volume)
        target = lighting_aim.in_camera(state, state.document.volume.corners_mm.mean(axis=0))
        return Spot(vector(hand), "camera", target_mm=vector(target), cone_deg=_CONE_DEG)
    return Headlight() if KINDS[kind] is Headlight else Ambient(occlusion=True)


def _scale_intensity(groups: Groups, factor: float) -> Groups:
    """Return the groups with every intensity multiplied."""

    def scaled(source: Source) -> Source:
        dimmed = min(round(source.intensity * factor, _DIGITS), MAX_INTENSITY)
        return replace(source, intensity=dimmed)

    return tuple(
        replace(group, sources=tuple(scaled(source) for source in group.sources))
        for group in groups
    )


@refusable
def remove_source(state: ViewState, index: int) -> ViewState:
    """Remove a light source, and its group if that is empty; the others take over its light."""
    placed, shading = list_sources(state.shading), state.shading
    if not 0 <= index < len(placed):
        return state
    if len(placed) == 1:
        raise InputError("The last light source cannot be removed; add another first", code="size")
    total = sum(shading.strengths().values())
    groups = _without(shading.groups, placed[index])
    remaining = sum(replace(shading, groups=groups).strengths().values())
    if remaining > 0 and total > 0:
        groups = _scale_intensity(groups, total / remaining)
    return choose_source(_with_groups(state, groups), max(index - 1, 0))


def _without(groups: Groups, placed: Placed) -> Groups:
    """Return the groups without a source, and without its group if that would be empty."""
    group = groups[placed.group]
    sources = light_rows.without_item(group.sources, placed.number)
    if not sources:
        return light_rows.without_item(groups, placed.group)
    return light_rows.with_item(groups, placed.group, replace(group, sources=sources))


@edit
def choose_source(state: ViewState, index: int) -> ViewState:
    """Choose a light source, and show the handles of all."""
    if not 0 <= index < len(list_sources(state.shading)):
        return state
    return with_overlays(with_interface(state, source=index), lights=True)


@edit
def set_source(state: ViewState, name: str, value: object, index: int) -> ViewState:
    """Set a field of a light source, if it has it."""
    return _with_source(state, index, lambda source: with_field(source, name, value))


@edit
def aim(state: ViewState, index: int, azimuth_deg: float, elevation_deg: float) -> ViewState:
    """Set the direction of a lamp, as `lighting_aim.angles_deg` returns it."""
    azimuth = math.radians(math.fmod(azimuth_deg, 360.0))
    elevation = math.radians(clamp(elevation_deg, -90.0, 90.0))
    flat = math.cos(elevation)
    towards = np.array([flat * math.sin(azimuth), math.sin(elevation), flat * math.cos(azimuth)])

    def change(source: Source) -> Source:
        direction = towards @ lighting_aim.axes_from_angles(state, source)
        if isinstance(source, Directional):
            return replace(source, towards=vector(direction))
        if isinstance(source, Point):
            reach = lighting_aim.distance_mm(state, source)
            return _placed_at(state, source, reach * direction)
        return source

    return _with_source(state, index, change)


@edit
def set_distance(state: ViewState, index: int, mm: float) -> ViewState:
    """Set the distance of a point light from the volume's middle."""
    reach = radius_mm(state.document.volume)

    def change(source: Source) -> Source:
        direction = lighting_aim.direction(state, source)
        if not isinstance(source, Point) or direction is None:
            return source
        return _placed_at(state, source, clamp(mm, _NEAREST * reach, FURTHEST * reach) * direction)

    return _with_source(state, index, change)


def _placed_at(state: ViewState, source: Point, offset: NDArray[np.float64]) -> Point:
    place = lighting_aim.middle_mm(state, source) + offset
    return replace(source, position_mm=vector(place))


def drag_handle(
    state: ViewState, start: ViewState, handle: CutHandle, place: Place, projection: Projection
) -> ViewState:
    """Move a lamp whose handle is dragged to a place; ``start`` is the state when it began."""
    source = list_sources(start.shading)[handle.index].source
    to = lighting_aim.unproject_handle(start, source, place, projection)
    if to is None:
        return state
    return set_source(state, lighting_aim.handle_field(source), vector(to), handle.index)


@edit
def carry(state: ViewState, place: Place, projection: Projection) -> ViewState:
    """Aim the flashlight at a place in the window, at the depth of the volume's middle."""
    index = _flashlight(state)
    if index is None:
        return state
    middle = state.document.volume.corners_mm.mean(axis=0)
    u, v, depth = (float(value) for value in projection.to_window(middle))
    mm = projection.mm_per_px * max(depth, 0.0)
    shift_mm = np.array([(place[0] - u) * mm, (v - place[1]) * mm, 0.0])
    target = lighting_aim.in_camera(state, middle) + shift_mm
    return set_source(state, "target_mm", vector(target), index)


def _flashlight(state: ViewState) -> int | None:
    """Return the index of the spot that moves with the camera, the chosen one first; or None."""
    spots = [
        index
        for index, lamp in enumerate(list_sources(state.shading))
        if isinstance(lamp.source, Spot) and lamp.source.frame == "camera"
    ]
    return min(spots, key=lambda index: index != chosen_source(state), default=None)


def toggle_flashlight(state: ViewState) -> Edited:
    """Let the mouse carry a flashlight, which is added if there is none, or lay it down."""
    if state.interface.tool == FLASHLIGHT:
        return Edited(with_interface(state, tool=""))
    added = Edited(state) if _flashlight(state) is not None else add_source(state, "spot")
    tool = "" if added.message else FLASHLIGHT
    return added._replace(state=with_interface(added.state, tool=tool, tool_points=()))


@edit
def toggle_frame(state: ViewState, index: int) -> ViewState:
    """Let a lamp move with the camera, or stay with the volume; it stays where it is for now."""
    axes, eye = lighting_aim.camera_axes(state), lighting_aim.eye_mm(state)

    def change(source: Source) -> Source:
        if isinstance(source, Directional):
            if source.frame == "world":
                towards = vector(axes @ np.asarray(source.towards))
                return replace(source, towards=towards, frame="camera")
            return replace(source, towards=vector(np.asarray(source.towards) @ axes), frame="world")
        if isinstance(source, Point):
            is_world = source.frame == "world"
            placed: dict[str, Any] = {
                name: vector(axes @ (p - eye) if is_world else p @ axes + eye)
                for name in ("position_mm", "target_mm")
                if (p := np.asarray(getattr(source, name, None))).size == 3
            }
            return replace(source, frame="camera" if is_world else "world", **placed)
        return source

    return _with_source(state, index, change)


@refusable
def rename_group(state: ViewState, group: int, name: str) -> ViewState:
    """Rename a light group; a name that is taken gets a number."""
    groups, name = state.shading.groups, " ".join(name.split())
    if not 0 <= group < len(groups) or name in ("", groups[group].name):
        return state
    taken = {entry.name for entry in light_rows.without_item(groups, group)}
    renamed = replace(groups[group], name=light_rows.unused_name(name, taken))
    groups = light_rows.with_item(groups, group, renamed)
    return _with_groups(state, groups, {state.shading.groups[group].name: renamed.name})


@refusable
def move_source(state: ViewState, index: int, group: int) -> ViewState:
    """Move a light source to another group, or to a new one of its own after the last."""
    lamps, groups = list_sources(state.shading), state.shading.groups
    if not 0 <= index < len(lamps) or not 0 <= group <= len(groups) or group == lamps[index].group:
        return state
    source, new_group = lamps[index].source, ""
    if group == len(groups):
        if len(groups[lamps[index].group].sources) == 1:
            return state
        new_group = light_rows.unused_name(kind_name(source), {other.name for other in groups})
        groups = (*groups, LightGroup(new_group, (source,)))
    else:
        grown = replace(groups[group], sources=(*groups[group].sources, source))
        groups = light_rows.with_item(groups, group, grown)
    groups = _without(groups, lamps[index])
    new = _with_groups(state, groups, new_group=new_group)
    number = next(i for i, lamp in enumerate(list_sources(new.shading)) if lamp.source is source)
    return choose_source(new, number)


@refusable
def set_spectrum(state: ViewState, group: int, text: str) -> ViewState:
    """Give a light group a spectrum of its own in the light that shines, in its notation."""
    groups = state.shading.groups
    if not 0 <= group < len(groups) or not state.lights:
        return state
    index, name = shining_row(state), groups[group].name
    before = state.lights[index]
    rig = before.rig
    if "" in rig.groups and len(groups) > 1:
        state = light_parts.split_part(state, index)
    elif not {"", name} & {*rig.groups}:
        state = light_parts.add_part(state, index, name)
    rig = state.lights[index].rig
    part = rig.groups.index(name if name in rig.groups else "")
    new, problem, _ = light_parts.respell(state, index, part, text)
    if problem:
        raise InputError(problem)
    row = new.lights[index]
    # A name that says more than the spectra stays.
    if row.name not in (*before.texts, _title(before)) or None in row.texts:
        return new
    new = light_parts.put_row(new, index, row, _title(row))
    palette = new.palette.with_light_renamed(row.name, new.lights[index].name)
    return replace(new, palette=palette)


def _title(row: light_rows.LightRow) -> str:
    """Return the notations of a light's spectra."""
    return " + ".join(dict.fromkeys(text for text in row.texts if text))


def shining_row(state: ViewState) -> int:
    """Return the index of the chosen light if it shines, else of the brightest."""
    weights = light_rows.effective_weights(state.lights)
    index = state.interface.light
    return index if weights[index] > 0 else light_rows.brightest_row(state.lights)


def group_text(state: ViewState, group: int) -> str:
    """Return the notation of a group's spectrum in the light that shines; empty if it is dark."""
    row = state.lights[shining_row(state)]
    parts = dict(zip(row.rig.groups, row.texts, strict=True))
    text = parts.get(state.shading.groups[group].name, parts.get("", ""))
    return "drawn" if text is None else text


def group_spectrum(state: ViewState, group: int) -> Spectrum | None:
    """Return a group's spectrum in the light that shines; None if it is dark."""
    rig = state.lights[shining_row(state)].rig
    parts = dict(zip(rig.groups, rig.lights, strict=True))
    return parts.get(state.shading.groups[group].name, parts.get(""))


def _with_groups(
    state: ViewState, groups: Groups, names: Mapping[str, str] | None = None, new_group: str = ""
) -> ViewState:
    """Set the light groups, and let the lights shine from them.

    ``names`` has the new names of groups. Spectra of groups that are gone are removed; group
    ``new_group`` gets the first spectrum of each light.
    """
    now = {group.name for group in groups}
    gone = {group.name for group in state.shading.groups} - now
    new_names = dict.fromkeys(gone, "") | {**(names or {})}

    def regrouped(rows: light_rows.Rows) -> light_rows.Rows:
        return tuple(light_rows.rename_row_groups(row, new_names, new_group) for row in rows)

    return replace(
        state,
        shading=replace(state.shading, groups=groups),
        lights=regrouped(state.lights),
        other=None if state.other is None else regrouped(state.other),
        saved_lights=tuple(
            replace(light, lights=regrouped(light.lights)) for light in state.saved_lights
        ),
        fade=None,
    )


def _with_source(state: ViewState, index: int, change: Callable[[Source], Source]) -> ViewState:
    """Change one source."""
    lamps, groups = list_sources(state.shading), state.shading.groups
    if not 0 <= index < len(lamps):
        return state
    placed = lamps[index]
    group = groups[placed.group]
    sources = light_rows.with_item(group.sources, placed.number, change(placed.source))
    groups = light_rows.with_item(groups, placed.group, replace(group, sources=sources))
    return replace(state, shading=replace(state.shading, groups=groups))


def _toggle_all(state: ViewState, name: str, missing: str) -> Edited:
    """Turn shadows or occlusion of all sources that can have it on or off; if none, add one."""
    sources = [placed.source for placed in list_sources(state.shading)]
    indices = [index for index, source in enumerate(sources) if hasattr(source, name)]
    if not indices:
        return add_source(state, missing)
    on = not _any_blocked(state, name)
    for index in indices:
        state = set_source(state, name, on, index)
    return Edited(state)


def _any_blocked(state: ViewState, name: str) -> bool:
    return any(getattr(placed.source, name, False) for placed in list_sources(state.shading))


def _add(name: str, title: str, words: str) -> Command:
    """Return the command that adds a source of a kind."""
    command = f"add-{name.partition(' ')[0]}"
    return Command(command, "Render", title, (), bind(add_source, name), words=words)


COMMANDS = (
    _add("directional light", "Add a directional light", "lamp sun key light source shadow"),
    _add("point light", "Add a point light", "lamp bulb light source near"),
    _add("spot", "Add a spot", "lamp cone torch flashlight light source"),
    Command(
        FLASHLIGHT,
        "Render",
        "Flashlight",
        (),
        toggle_flashlight,
        lambda state: state.interface.tool == FLASHLIGHT,
        "torch spot mouse carry aim light",
    ),
    _add("headlight", "Add a headlight", "camera light source front"),
    _add("sky", "Add a sky", "ambient light dome environment fill occlusion source"),
    Command(
        "remove-source",
        "Render",
        "Remove the chosen light source",
        (),
        lambda state: remove_source(state, chosen_source(state)),
        words="delete lamp",
    ),
    Command(
        "shadows",
        "Render",
        "Shadows",
        (),
        lambda state: _toggle_all(state, "shadows", "directional light"),
        lambda state: _any_blocked(state, "shadows"),
        "cast shadow lighting",
    ),
    Command(
        "occlusion",
        "Render",
        "Ambient occlusion",
        (),
        lambda state: _toggle_all(state, "occlusion", "sky"),
        lambda state: _any_blocked(state, "occlusion"),
        "AO ambient shading sky lighting",
    ),
    switch(
        "interface.overlays.lights",
        "lights",
        "Render",
        "Handles of lights",
        words="aim direction move lamp",
    ),
)
