"""Crop box and clip planes: the panel with their numbers, and the handles over the picture."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from volspec.camera import Place, Projection, radius_mm
from volspec.raycast import MAX_PLANES, ClipPlane, framing
from volspec.viewer.model import cuts
from volspec.viewer.model.slices import outline_index
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import ACCENT, BLACK, WHITE, over_picture, pack_colour

Colour = tuple[float, float, float, float]
# A handle's radius; pixels at 96 dpi.
_SIZE = 5.5
# Drawing order: where handles overlap, a press grips the one drawn last.
_ORDER = ("crop", "plane-shift", "plane-tilt")
_WHITE, _DIM = (*WHITE, 0.85), (*WHITE, 0.3)
# Colours of the slices across x, y and z.
SLICE_COLOURS = ((0.86, 0.42, 0.40), (0.45, 0.75, 0.45), (0.45, 0.62, 0.92))


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the panel."""
    return _planes(_crop(state, ui), ui)


def _crop(state: ViewState, ui: UiContext) -> ViewState:
    overlays, volume = state.interface.overlays, state.document.volume
    pressed, _ = imgui.checkbox("Crop box in the picture", overlays.crop)
    ui.note("crop box")
    new = ui.run(state, "crop") if pressed else state
    imgui.same_line(imgui.get_content_region_avail().x - ui.px(52))
    imgui.begin_disabled(state.shading.crop_voxels is None)
    if imgui.button("Reset##crop", (ui.px(64), 0)):
        new = ui.run(new, "reset-crop")
    imgui.end_disabled()
    crop = framing.crop_bounds(state.shading, volume)
    imgui.push_item_width(-ui.px(24))
    for axis, (name, (low, high)) in enumerate(zip("xyz", crop, strict=True)):
        last = volume.shape_xyz[axis] - 1.0
        scale = max(last / 400, 0.05), 0.0, last, "%.0f", "%.0f"
        changed, new_low, new_high = imgui.drag_float_range2(name, low, high, *scale)
        ui.note(f"crop {name}")
        if changed and new_low != low:
            new = cuts.move_crop(new, 2 * axis, new_low)
        if changed and new_high != high:
            new = cuts.move_crop(new, 2 * axis + 1, new_high)
    imgui.pop_item_width()
    return new


def _planes(state: ViewState, ui: UiContext) -> ViewState:
    new, planes = state, state.shading.clip_planes
    imgui.separator_text("Clip planes")
    pressed, _ = imgui.checkbox("Handles", state.interface.overlays.planes)
    if pressed:
        new = ui.run(new, "planes")
    imgui.begin_disabled(len(planes) >= MAX_PLANES)
    for name, title, note in (
        ("plane-facing", "+ facing", "A plane through the middle; cuts away the front"),
        *((f"plane-{axis}", f"+ {axis}", f"A plane across voxel axis {axis}") for axis in "xyz"),
    ):
        imgui.same_line()
        if imgui.button(title):
            new = ui.run(new, name)
        ui.note(name, note)
    imgui.end_disabled()
    if not planes:
        imgui.text_disabled("No planes yet")
    for i, plane in enumerate(planes):
        new = _row(new, ui, i, plane)
    return new


def _row(state: ViewState, ui: UiContext, index: int, plane: ClipPlane) -> ViewState:
    """Draw one plane of the list: its distance, and the buttons that flip and remove it."""
    volume = state.document.volume
    imgui.push_id(index)
    if imgui.radio_button(f"{index + 1}", state.interface.overlays.plane == index):
        state = cuts.choose_plane(state, index)
    imgui.same_line()
    x, y, z = plane.normal
    imgui.set_next_item_width(-ui.px(92))
    reach, now = radius_mm(volume), cuts.distance_mm(plane, volume)
    changed, distance_mm = imgui.slider_float("##at", now, -reach, reach, "%.1f mm")
    ui.note(f"plane {index}", f"From the volume's middle, along ({x:.2f}, {y:.2f}, {z:.2f})")
    if changed:
        state = cuts.shift_plane(state, index, distance_mm)
    imgui.same_line()
    if imgui.button("Flip"):
        state = cuts.flip_plane(state, index)
    ui.note(f"flip {index}")
    imgui.same_line()
    if imgui.button("×", (-1, 0)):
        state = cuts.remove_plane(state, index)
    ui.note(f"remove {index}")
    imgui.pop_id()
    return state


def draw_handles(state: ViewState, ui: UiContext) -> None:
    """Draw the box, the planes and the slices' outlines with their handles over the picture."""
    volume, overlays = state.document.volume, state.interface.overlays
    planes = overlays.planes and bool(state.shading.clip_planes)
    outlines = overlays.outlines and "Slices" in state.interface.panels
    if not (overlays.crop or planes or outlines):
        return
    projection = ui.projection(state)
    crop = framing.crop_bounds(state.shading, volume)
    with over_picture(ui):
        if outlines:
            for axis, fraction in enumerate(state.interface.slices.at):
                corners = framing.world_mm(volume, outline_index(volume, axis, fraction))
                _polygon(corners, projection, (*SLICE_COLOURS[axis], 0.9), ui)
        if overlays.crop:
            for start, end, hidden in cuts.box_edges(crop, volume, projection):
                _line(start, end, _DIM if hidden else _WHITE, ui)
        if planes:
            corners = cuts.box_corners_mm(crop, volume)
            for i, plane in enumerate(state.shading.clip_planes):
                point, normal = np.asarray(plane.point_mm), np.asarray(plane.normal)
                colour = ACCENT[True] if i == overlays.plane else _WHITE
                _polygon(cuts.outline_mm(point, normal, corners), projection, colour, ui)
        _draw_handles(state, projection, ui)


def _draw_handles(state: ViewState, projection: Projection, ui: UiContext) -> None:
    handles, hovered = cuts.list_handles(state, projection, ui.scale), None
    if not imgui.get_io().want_capture_mouse:
        mouse = imgui.get_mouse_pos()
        hovered = cuts.nearest_handle(handles, (mouse.x, mouse.y), ui.scale)
    draw_list = imgui.get_background_draw_list()
    shade = pack_colour(BLACK, 0.6)
    middles = {handle.index: handle.place for handle in handles if handle.name == "plane-shift"}
    for handle in (h for name in _ORDER for h in reversed(handles) if h.name == name):
        colour = pack_colour(ACCENT[True] if handle == hovered else (*WHITE, 0.95))
        size = ui.px(_SIZE * (1.25 if handle == hovered else 1.0))
        x, y = handle.place
        if handle.name == "plane-tilt":
            _line(middles[handle.index], handle.place, _WHITE, ui)
        draw_list.add_circle_filled((x, y), size + ui.px(1.5), shade)
        if handle.name == "plane-tilt":
            draw_list.add_circle((x, y), size - ui.px(1), colour, 0, ui.px(2))
        else:
            draw_list.add_circle_filled((x, y), size, colour)
        ui.areas[f"{handle.name} {handle.index}"] = int(x) - 2, int(y) - 2, 4, 4


def _polygon(corners: cuts.Array, projection: Projection, colour: Colour, ui: UiContext) -> None:
    for drawn in projection.segments(corners, np.roll(corners, -1, axis=0)):
        if drawn is not None:
            _line(*drawn, colour, ui)


def _line(start: Place, end: Place, colour: Colour, ui: UiContext) -> None:
    """Draw a line with a dark outline, so that it is visible on any picture."""
    draw_list = imgui.get_background_draw_list()
    draw_list.add_line(start, end, pack_colour(BLACK, 0.45 * colour[3]), ui.px(3.0))
    draw_list.add_line(start, end, pack_colour(colour), ui.px(1.4))
