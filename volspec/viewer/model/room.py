"""The room around a volume: the eye's conditions in it, and edits of its paints.

panel, commands -> [room] -> SceneRoom of the state -> relight
"""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import encode_sRGB, linear_sRGB_from_XYZ
from volspec.basis import SpectralBasis
from volspec.palette import parse_colour
from volspec.relight import RelightSpec
from volspec.scene.tables import CameraSpec
from volspec.spectra import (
    LUMINOUS_EFFICACY,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
)
from volspec.viewer.model import light_rows
from volspec.viewer.model.edit import Command, Edited, edit, refusable
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View, clamp

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

Array = NDArray[np.float64]
Codes = tuple[float, float, float]
PANEL = "Room"
NONE = "This scene has no room; in its file, [room] puts the volume into one"
LIGHTS = "The room lights the volume; its file has the lamps, and the Room panel the paints"
ALL_WALLS, WALLS = "walls", ("left", "right", "front", "back")
# The largest code of a paint: none reflects everything.
_BRIGHTEST = 254


def shown_spec(state: ViewState) -> RelightSpec:
    """Return the viewing conditions of the picture: in a room, those of an eye in it."""
    if state.room is None:
        return state.relight
    return _spec_in_room(state.relight, state.room, state.view)


# Few, as each keeps a room; always the same object, as caches compare specs by identity.
@lru_cache(maxsize=8)
def _spec_in_room(spec: RelightSpec, room: SceneRoom, view: View) -> RelightSpec:
    return replace(spec, viewing=room.viewing(spec.viewing, CameraSpec(**asdict(view))))


def with_room_light(old: ViewState, new: ViewState) -> Edited:
    """Return a state without changes of the light sources, which are the room's."""
    if new.room is None or new.shading.groups == old.shading.groups:
        return Edited(new)
    shading = replace(new.shading, groups=old.shading.groups)
    return Edited(replace(new, shading=shading, lights=old.lights), LIGHTS)


def light_names(state: ViewState) -> tuple[str, ...]:
    """Return the groups that lights may shine from: light groups, or the room's lamps."""
    if state.room is not None:
        return state.room.response.names
    return tuple(group.name for group in state.shading.groups)


def solve_radiosity(state: ViewState) -> ViewState:
    """Return the state with its room solved, which takes a fraction of a second."""
    return state if state.room is None else replace(state, room=state.room.solved())


def has_walls(state: ViewState) -> bool:
    """Return True if the room is seen: a basis of materials has no channels for it."""
    basis = state.transfer.basis
    return state.room is not None and state.room.spec.walls and isinstance(basis, SpectralBasis)


def paintable(room: SceneRoom) -> tuple[str, ...]:
    """Return the surfaces to paint; the four walls are one, unless their paints differ."""
    inside = room.response.solved.room
    names = [name for name in inside.mesh.names if name not in inside.exitances]
    sides = [inside.reflectance(name) for name in WALLS if name in names]
    if len(sides) < len(WALLS) or any(not np.array_equal(sides[0], side) for side in sides):
        return tuple(names)
    return (ALL_WALLS, *(name for name in names if name not in WALLS))


def reflectance_of(room: SceneRoom, surface: str) -> Spectrum:
    """Return the paint of a surface, one of `paintable`."""
    name = WALLS[0] if surface == ALL_WALLS else surface
    nm = room.grid.wavelengths_nm
    return Spectrum(nm, room.response.solved.room.reflectance(name), paint_text(room, surface))


def paint_text(room: SceneRoom, surface: str) -> str:
    """Return a paint's notation; empty if it is that of the room's file."""
    return room.spec.paint.get(surface, "")


def paint_codes(room: SceneRoom, surface: str) -> Codes:
    """Return a paint's sRGB codes, 0 to 1, as it was chosen: under D65."""
    text = paint_text(room, surface)
    if text.startswith("#"):
        red, green, blue = np.clip(parse_colour(text), 0.0, 1.0).tolist()
    else:
        XYZ = XYZ_from_spectra(light("D65", room.grid), reflectance_of(room, surface))
        red, green, blue = np.clip(encode_sRGB(linear_sRGB_from_XYZ(XYZ)), 0.0, 1.0).tolist()
    return red, green, blue


def seen_XYZ(room: SceneRoom, rows: light_rows.Rows) -> Array | None:
    """Return the mean colours (S, 3) of `paintable` surfaces in the picture; None in the dark.

    Y = 100 for a perfect diffuser that faces all groups of the room's light on the volume.
    """
    lamps, facing = light_rows.light_rig(rows), light_rows.facing_light(rows, room)
    if lamps is None or facing is None or not facing.total_lux:
        return None
    mesh, surfaces = room.response.solved.mesh, paintable(room)
    members = [WALLS if surface == ALL_WALLS else (surface,) for surface in surfaces]
    masks = np.array([np.isin(mesh.names, names) for names in members], np.float64)
    areas = masks @ mesh.surface_areas.sum(axis=1)
    light = np.array([masks @ (mesh.surface_areas @ lamp) for lamp in room.response.irradiance])
    means = np.einsum("lsb,lb->sb", light, room.spectra(lamps)) / areas[:, None]
    paints = [reflectance_of(room, surface).values for surface in surfaces]
    scale = 100.0 * LUMINOUS_EFFICACY / facing.total_lux
    return np.asarray(scale * (np.array(paints) * means) @ colour_matching_functions(room.grid).T)


@refusable
def paint(state: ViewState, surface: str, text: str) -> ViewState:
    """Paint a surface; the light that follows is an estimate until the room is solved."""
    room = state.room
    if room is None or not text.strip() or text.strip() == paint_text(room, surface):
        return state
    return replace(state, room=room.with_paint({surface: text.strip()}, estimate=True))


@edit
def pick(state: ViewState, surface: str, codes: tuple[float, float, float]) -> ViewState:
    """Paint a surface with a colour by its sRGB codes, 0 to 1, under D65."""
    rounded = (round(255.0 * clamp(code, 0.0, 1.0)) for code in codes)
    text = "#" + "".join(f"{min(code, _BRIGHTEST):02x}" for code in rounded)
    return paint(state, surface, text).state


def reset(state: ViewState) -> ViewState:
    """Restore all paints of the file."""
    return replace(state, room=state.document.room)


def _reset(state: ViewState) -> Edited:
    if state.room is None:
        return Edited(state, NONE)
    return Edited(reset(state))


COMMANDS = (
    Command("reset-paints", "Light", "Reset the room's paints", (), _reset, words="wall colour"),
)
