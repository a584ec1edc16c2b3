"""Cuts, fog and focus by distance from the camera, and stereo, of pictures with layers of opacity.

panel, menu -> [depth] -> ViewState.depth, Interface.stereo -> recompose, reproject
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

from volspec.basis import MaterialBasis
from volspec.camera import radius_mm
from volspec.errors import InputError
from volspec.image import F_NUMBER, MAX_MATERIALS, CoefficientImage, DepthEffects, axis_cosine
from volspec.raycast import RaycastSpec
from volspec.relight import Layout, Look, Stereo
from volspec.viewer.model import opacities
from volspec.viewer.model.edit import Command, bind, edit, refusable, with_interface
from volspec.viewer.model.materials import with_material_basis
from volspec.viewer.model.quality import LAYERS, can_layer, cast_spec, opacity_scales
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

# Depth of the volume over the visibility, at most.
MAX_FOG = 8.0
# Openings of the lens over the distance of its focus, that is one over the f-number.
APERTURES = 1 / 100, 1 / 4


def limits_mm(state: ViewState) -> tuple[float, float]:
    """Return the distances between which the picture has layers."""
    image = state.document.image
    if image is not None and image.opacity_layers is not None:
        return image.opacity_layers.range_mm
    volume = state.document.volume
    distance, radius = state.view.camera(volume).distance_mm, radius_mm(volume)
    return max(0.0, distance - radius), distance + radius


def can_be_set(state: ViewState) -> bool:
    """Return True if the picture can have these effects, also if first its basis changes."""
    spectral = not isinstance(state.transfer.basis, MaterialBasis)
    more_surfaces = state.fields or state.meshes or state.room or state.document.image is not None
    return can_layer(state) or (
        spectral and not more_surfaces and 0 < len(opacities.names(state)) <= MAX_MATERIALS
    )


def shown_depth(state: ViewState) -> DepthEffects:
    """Return the effects that the window shows at once: without a focus, which takes too long."""
    return replace(focused_depth(state), focus_mm=None, aperture_mm=None)


def focused_depth(state: ViewState) -> DepthEffects:
    """Return the effects that the window shows once nothing moves."""
    if not can_layer(state):
        return DepthEffects()
    if can_focus(state):
        return state.depth
    return replace(state.depth, focus_mm=None, aperture_mm=None)


def shown_look(state: ViewState) -> Look:
    """Return opacities and effects that the window shows at once."""
    return Look(opacities=opacity_scales(state), depth=shown_depth(state))


def picture_look(state: ViewState) -> Look:
    """Return the look of a saved picture: what is shown at rest, of both eyes without a focus."""
    layout, spec, scales = shown_stereo(state), shown_spec(state), opacity_scales(state)
    if layout:
        return Look(spec, {}, scales, shown_depth(state), Stereo(layout))
    return Look(spec, {}, scales, focused_depth(state))


def needs_layers(state: ViewState) -> bool:
    """Return True if a picture needs layers, for effects of depth or both eyes."""
    return focused_depth(state).changes or bool(shown_stereo(state))


def picture_spec(state: ViewState) -> RaycastSpec:
    """Return the settings of a picture's cast, with layers for effects of depth and both eyes."""
    spec = cast_spec(state)
    return replace(spec, layers=spec.layers or LAYERS) if needs_layers(state) else spec


def left_out(state: ViewState) -> str:
    """Return the effects that the state has, but its picture cannot have; empty if none."""
    drawn, effects, cut = focused_depth(state), state.depth, "cut by distance"
    names = {"near_mm": cut, "far_mm": cut, "fog_mm": "fog", "focus_mm": "focus"}
    omitted = (name for key, name in names.items() if getattr(effects, key) != getattr(drawn, key))
    return ", ".join(dict.fromkeys(omitted))


def can_focus(state: ViewState) -> bool:
    """Return True if the camera has the perspective that a lens needs."""
    image = state.document.image
    return not state.view.orthographic if image is None else image.fov_deg is not None


def distance_mm(image: CoefficientImage, pixel: tuple[int, int]) -> float:
    """Return the expected depth of a pixel along the camera's axis."""
    x, y = pixel
    return float(image.depth_mm[y, x] * axis_cosine(image.size, image.fov_deg)[y, x])


def aperture_mm(state: ViewState) -> float:
    """Return the opening of the lens, given or by default; 0 without a focus."""
    focus = state.depth.focus_mm or 0.0
    return state.depth.aperture_mm or focus / F_NUMBER


def fog(state: ViewState) -> float:
    """Return the volume's depth over the visibility in fog."""
    near, far = limits_mm(state)
    return 0.0 if state.depth.fog_mm is None else (far - near) / state.depth.fog_mm


@edit
def set_cut(state: ViewState, near_mm: float, far_mm: float) -> ViewState:
    """Hide what is nearer or farther; at the ends of `limits_mm` nothing is cut."""
    min_mm, max_mm = limits_mm(state)
    near = clamp(near_mm, min_mm, math.nextafter(max_mm, 0))
    far = clamp(far_mm, math.nextafter(near, math.inf), max_mm)
    cut = replace(
        state.depth,
        near_mm=near if near > min_mm else 0.0,
        far_mm=far if far < max_mm else None,
    )
    return _with(state, cut)


@edit
def set_fog(state: ViewState, times: float) -> ViewState:
    """Fill the picture with fog, whose visibility is the volume's depth over a number; 0 for none.

    It begins where the volume does.
    """
    min_mm, max_mm = limits_mm(state)
    times = clamp(times, 0.0, MAX_FOG)
    fog_mm = (max_mm - min_mm) / times if times > 0 else None
    start = min_mm if fog_mm is not None else 0.0
    foggy = replace(state.depth, fog_mm=fog_mm, fog_from_mm=start)
    return _with(state, foggy)


@edit
def set_focus(state: ViewState, focus_mm: float | None) -> ViewState:
    """Focus a lens at a distance, as wide as it is; None for a pinhole, with all in focus."""
    if focus_mm is None:
        return _with(state, replace(state.depth, focus_mm=None, aperture_mm=None))
    return _with(state, replace(state.depth, focus_mm=clamp(focus_mm, *limits_mm(state))))


@edit
def set_aperture(state: ViewState, aperture_mm: float) -> ViewState:
    """Open the lens so wide."""
    min_mm, max_mm = (part * (state.depth.focus_mm or 0.0) for part in APERTURES)
    if not 0 < min_mm < max_mm:
        return state
    return _with(state, replace(state.depth, aperture_mm=clamp(aperture_mm, min_mm, max_mm)))


@edit
def reset(state: ViewState) -> ViewState:
    """Show everything, in focus and without fog."""
    return replace(state, depth=DepthEffects()) if state.depth.changes else state


def _with(state: ViewState, depth: DepthEffects) -> ViewState:
    if depth == state.depth:
        return state
    return replace(state, depth=depth, transfer=with_material_basis(state.transfer))


def shown_stereo(state: ViewState) -> Layout | Literal[""]:
    """Return the layout of both eyes' pictures; empty if one is shown."""
    possible = can_layer(state) and not state.interface.error_map
    return state.interface.stereo if possible else ""


@refusable
def set_stereo(state: ViewState, layout: Layout) -> ViewState:
    """Show both eyes' pictures, or one again if they are; materials become the channels."""
    if layout == state.interface.stereo:
        return with_interface(state, stereo="")
    if not can_be_set(state):
        raise InputError(
            "Stereo is made of layers of opacity, which this picture cannot have",
            "see the Opacity panel",
            code="unsupported",
        )
    new = with_interface(state, stereo=layout, error_map=False)
    if state.document.image is None:
        new = replace(new, transfer=with_material_basis(state.transfer))
    return new


def _stereo_command(layout: Layout) -> Command:
    return Command(
        f"stereo-{layout}",
        "View",
        f"Stereo: {layout.replace('-', ' ')}",
        (),
        bind(set_stereo, layout),
        lambda state: state.interface.stereo == layout,
        words=f"3-D eyes glasses red cyan {layout}",
    )


COMMANDS = _stereo_command("anaglyph"), _stereo_command("side-by-side")
