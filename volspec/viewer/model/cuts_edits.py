"""Edits and commands of the crop box and the clip planes.

mouse, keys -> [cuts_edits] -> RaycastSpec
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from volspec.viewer.model import cuts
from volspec.viewer.model.camera import Vector, vector
from volspec.viewer.model.edit import Change, Command, edit, refusable
from volspec.viewer.model.state import ViewState

# Beyond this no volume reaches, and float64 keeps its digits.
_MOST = 1e9


@edit
def move_crop(state: ViewState, face: int, at: float) -> ViewState:
    """Move a face of the crop box, in voxels."""
    at = min(max(at, -_MOST), _MOST)
    volume = state.document.volume
    return replace(state, shading=cuts.cropped(state.shading, volume, face, at))


@edit
def shift_plane(state: ViewState, index: int, mm: float) -> ViewState:
    """Move a clip plane along its normal."""
    volume = state.document.volume
    return replace(state, shading=cuts.shifted(state.shading, volume, index, mm))


@edit
def tilt_plane(state: ViewState, index: int, azimuth: float, elevation: float) -> ViewState:
    """Turn a clip plane's normal to a direction, in degrees."""
    volume, elevation = state.document.volume, min(max(elevation, -90.0), 90.0)
    tilted = cuts.tilted(state.shading, volume, index, azimuth, elevation)
    return replace(state, shading=tilted)


@edit
def flip_plane(state: ViewState, index: int) -> ViewState:
    """Cut away the other side of a plane."""
    return replace(state, shading=cuts.flipped(state.shading, index))


@edit
def remove_plane(state: ViewState, index: int) -> ViewState:
    """Remove a clip plane."""
    return replace(state, shading=cuts.changed(state.shading, index, None))


@edit
def choose_plane(state: ViewState, index: int) -> ViewState:
    """Choose the clip plane that has handles."""
    if not 0 <= index < len(state.shading.clip_planes):
        return state
    return with_aids(state, plane=index)


def move_handle(state: ViewState, handle: cuts.Handle, x: float, y: float) -> ViewState:
    """Move what a handle holds to where `cuts.dragged` has it."""
    match handle.name:
        case "crop":
            return move_crop(state, handle.index, x)
        case "plane-shift":
            return shift_plane(state, handle.index, x)
        case _:
            return tilt_plane(state, handle.index, x, y)


def with_aids(state: ViewState, **changes: Any) -> ViewState:
    """Other things over the picture."""
    aids = replace(state.interface.aids, **changes)
    return replace(state, interface=replace(state.interface, aids=aids))


def flipped(name: str) -> Change:
    """Shows or hides something over the picture."""
    return lambda state: with_aids(state, **{name: not getattr(state.interface.aids, name)})


@refusable
def add_plane(state: ViewState, normal: Vector) -> ViewState:
    """Add a clip plane through the volume's middle, and choose it."""
    shading = cuts.with_plane(state.shading, state.document.volume, normal)
    chosen = with_aids(state, plane=len(shading.clip_planes) - 1, planes=True)
    return replace(chosen, shading=shading)


def _facing(state: ViewState) -> Vector:
    """What is before the middle is cut away."""
    return vector(state.view.camera(state.document.volume).frame()[2])


def _along(axis: int) -> Callable[[ViewState], Vector]:
    """Across an axis of the voxels, which are those of the slices."""
    return lambda state: vector(state.document.volume.world_from_index[:3, axis])


def _adding(
    name: str, title: str, keys: tuple[str, ...], normal: Callable[[ViewState], Vector]
) -> Command:
    """A command that adds a plane with the normal that a state gives."""
    return Command(name, "Cut", title, keys, lambda state: add_plane(state, normal(state)))


def _uncropped(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, crop_voxels=None))


def _planeless(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, clip_planes=()))


def _of_chosen(change: Callable[[ViewState, int], ViewState]) -> Change:
    """An edit of the plane that has handles."""
    return lambda state: change(state, state.interface.aids.plane)


COMMANDS = (
    Command("crop", "Cut", "Crop box", ("c",), flipped("crop"), lambda s: s.interface.aids.crop),
    Command("reset-crop", "Cut", "Undo the crop", ("ctrl+shift+x",), _uncropped),
    _adding("plane-facing", "Add a clip plane facing you", ("p",), _facing),
    *(
        _adding(f"plane-{axis}", f"Add a clip plane across {axis}", (), _along(i))
        for i, axis in enumerate("xyz")
    ),
    Command("flip-plane", "Cut", "Flip the clip plane", (), _of_chosen(flip_plane)),
    Command("remove-plane", "Cut", "Remove the clip plane", (), _of_chosen(remove_plane)),
    Command("remove-planes", "Cut", "Remove all clip planes", (), _planeless),
    Command(
        *("planes", "Cut", "Clip planes' handles", (), flipped("planes")),
        lambda s: s.interface.aids.planes,
    ),
)
