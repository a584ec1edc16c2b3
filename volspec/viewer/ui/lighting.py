"""The lighting panel: the cast's light sources and surface, and handles that aim lamps."""

from __future__ import annotations

import math
from functools import lru_cache, partial

from imgui_bundle import imgui

from volspec.camera import radius_mm
from volspec.raycast import Ambient, Directional, Point, Source, Spot
from volspec.relight import LightRig
from volspec.spectra import Spectrum
from volspec.viewer.model import lighting, lighting_aim
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.cuts import nearest_handle
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import lights_library
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.form import Form, FormField, draw_field, draw_fields
from volspec.viewer.ui.light_look import fill_box, raw_colour
from volspec.viewer.ui.quality import CAST
from volspec.viewer.ui.widgets import (
    ACCENT,
    BLACK,
    WHITE,
    as_one_line,
    describe_field,
    lit_button,
    over_picture,
    pack_colour,
    shorten,
    wrap_text,
)

_ADD = "add a light source"
_LABELS = 92
_IN_ROOM = (
    "The room lights the volume: its lamps are in Lights, its paints in Room. "
    "Directions and shadows follow from the room."
)
_HEADLIGHT = "The camera sees no shadow of a headlight"
_LOG = imgui.SliderFlags_.logarithmic
_WEIGHTS = FormField("ambient", "Ambient", (0.0, 2.0)), FormField("diffuse", "Diffuse", (0.0, 2.0))
_GLOSS = (
    FormField("specular", "Specular", (0.0, 2.0)),
    FormField("shininess", "Shininess", (1, 256), is_logarithmic=True),
    FormField("flat_gradient", "Flat gradient", (0.0, 0.3), "%.3f"),
)
_CONE = FormField("cone_deg", "Cone", (0.5, 89.0)), FormField("edge_deg", "Edge", (0.0, 45.0))
SETTINGS = tuple(widget.label for widget in (*_WEIGHTS, *_GLOSS))
"""Labels of the items that `UiContext.item` can focus."""
_ENTER = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
_INTENSITY = 4.0  # the greatest on a slider
_NAMES = {
    "directional light": "Directional",
    "point light": "Point",
    "spot": "Spot",
    "headlight": "Headlight",
    "sky": "Ambient",
}
# The sun of a handle: radius of its disc, and the rays' ends, in pixels at 96 dpi.
_DISC, _RAYS = 6.0, (8.5, 12.0)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    if state.room is not None:
        wrap_text(_IN_ROOM, imgui.Col_.text_disabled)
        new = _surface_of_room(state, ui)
        imgui.pop_style_var()
        return None if new is state else new
    new = _buttons(state, ui)
    index = 0
    for number, group in enumerate(state.shading.groups):
        imgui.push_id(number)
        new = _group(new, state, ui, number)
        for source in group.sources:
            imgui.push_id(index)
            new = _source(new, state, ui, index, source)
            imgui.pop_id()
            index += 1
        imgui.pop_id()
    imgui.push_item_width(-ui.px(_LABELS))
    new = _details(new, state, ui)
    imgui.separator_text("Surface")
    new = draw_fields(new, ui, CAST, *_WEIGHTS, *_GLOSS)
    imgui.pop_item_width()
    imgui.pop_style_var()
    return None if new is state else new


def _buttons(state: ViewState, ui: UiContext) -> ViewState:
    new = state
    if imgui.button("Add"):
        imgui.open_popup(_ADD)
    ui.note("add source", "Add a light source to the picture; the others are dimmed")
    if imgui.begin_popup(_ADD):
        for kind in lighting.KINDS:
            title = {"sky": "Sky (ambient light)"}.get(kind, kind.capitalize())
            if imgui.menu_item(title, "", False)[0]:
                new = ui.edited(new, partial(lighting.add_source, kind=kind))
            ui.note(f"add {kind}")
        imgui.end_popup()
    imgui.same_line()
    dark = state.interface.dark
    for name, title in (("shadows", "Shadows"), ("occlusion", "Occlusion"), ("lights", "Handles")):
        command = BY_NAME[name]
        on = command.on is not None and command.on(state)
        if lit_button(title, on, dark):
            new = ui.run(new, command)
        ui.note(f"all {name}", command.title)
        imgui.same_line()
    imgui.new_line()
    return new


def _group(new: ViewState, state: ViewState, ui: UiContext, group: int) -> ViewState:
    """Draw a group's name and its spectrum, which opens the library."""
    name = state.shading.groups[group].name
    imgui.set_next_item_width(ui.px(132))
    entered, text = imgui.input_text("##name", name, _ENTER)
    ui.note(f"light group {group}", "Light group: sources that share a spectrum")
    if entered:
        new = ui.edited(new, partial(lighting.rename_group, group=group, name=text))
    imgui.same_line()
    x, y = imgui.get_cursor_screen_pos()
    width, height = imgui.get_content_region_avail().x, imgui.get_frame_height()
    notation = lighting.group_text(state, group)
    side = ui.px(13)
    label = shorten(notation or "dark", width - side - ui.px(26))
    if imgui.button(f"     {label}###spectrum", (width, 0)):
        imgui.open_popup(lights_library.POPUP)
    ui.note(f"group spectrum {group}", f"Spectrum of this group: {as_one_line(notation)}")
    spectrum = lighting.group_spectrum(state, group)
    if spectrum is not None:
        box = x + ui.px(7), y + (height - side) / 2, side, side
        fill_box(box, raw_colour(_rig(spectrum)), ui.px(3))
    return lights_library.draw(new, ui, partial(lighting.set_spectrum, group=group))


def _source(
    new: ViewState, state: ViewState, ui: UiContext, index: int, source: Source
) -> ViewState:
    """Draw a source's kind, intensity, and buttons."""
    kind, dark = lighting.kind_name(source), state.interface.dark
    imgui.dummy((ui.px(4), 0))
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    label = _NAMES[kind]
    is_chosen = lighting.chosen_source(state) == index
    if imgui.selectable(f"{label}##kind", is_chosen, 0, (ui.px(88), 0))[0]:
        new = lighting.choose_source(new, index)
    ui.note(f"source {index}", str(type(source).__doc__).partition("\n")[0])
    imgui.same_line()
    side = imgui.get_frame_height()
    imgui.set_next_item_width(imgui.get_content_region_avail().x - 2 * side - ui.px(16))
    top = max(_INTENSITY, source.intensity)
    changed, value = imgui.slider_float("##intensity", source.intensity, 0.0, top, "%.2f")
    ui.note(f"intensity {index}", "Intensity")
    if changed:
        new = lighting.choose_source(new, index)
        new = lighting.set_source(new, "intensity", value, index)
    imgui.same_line()
    name, on = "occlusion" if kind == "sky" else "shadows", lighting.is_blocked(source)
    imgui.begin_disabled(kind == "headlight")
    if lit_button(name[0].upper(), on, dark, (side, 0)):
        new = lighting.set_source(new, name, not on, index)
    imgui.end_disabled()
    text = _HEADLIGHT if kind == "headlight" else describe_field(type(source), name)
    ui.note(f"blocking {index}", text, greyed=True)
    imgui.same_line()
    if imgui.button("×", (side, 0)):
        new = ui.edited(new, partial(lighting.remove_source, index=index))
    ui.note(f"remove source {index}")
    return new


def _details(new: ViewState, state: ViewState, ui: UiContext) -> ViewState:
    """Draw the settings of the chosen source."""
    index = lighting.chosen_source(state)
    placed = lighting_aim.list_sources(state.shading)[index]
    source, groups = placed.source, state.shading.groups
    name = f"{groups[placed.group].name}: {_NAMES[lighting.kind_name(source)]}"
    imgui.separator_text(as_one_line(name))
    angles = lighting_aim.angles_deg(state, source)
    if angles is not None:
        azimuth, elevation = angles
        changed, value = imgui.slider_float("Azimuth", azimuth, -180.0, 180.0, "%.0f°")
        ui.note("light azimuth", "Around the up axis, as the camera's orbit counts it")
        if changed:
            new = lighting.aim(new, index, value, elevation)
        changed, value = imgui.slider_float("Elevation", elevation, -90.0, 90.0, "%.0f°")
        ui.note("light elevation")
        if changed:
            new = lighting.aim(new, index, azimuth, value)
    reach = radius_mm(state.document.volume)
    form = Form(lambda _: source, partial(lighting.set_source, index=index))
    if isinstance(source, Point):
        mm, limits = lighting_aim.distance_mm(state, source), (0.1 * reach, 10 * reach)
        changed, value = imgui.slider_float("Distance", mm, *limits, "%.4g mm", _LOG)
        ui.note("light distance", "From the volume's middle")
        if changed:
            new = lighting.set_distance(new, index, value)
        new = draw_field(
            new, ui, form, FormField("falloff_mm", "Falloff", (0.0, 5 * reach), none="none")
        )
    if isinstance(source, Spot):
        for widget in _CONE:
            new = draw_field(new, ui, form, widget)
    if isinstance(source, Ambient):
        radius = FormField("radius_mm", "Radius", (0.0, reach), none="automatic")
        new = draw_field(new, ui, form, radius, disabled=not source.occlusion)
    if isinstance(source, Directional | Point):
        pressed, _ = imgui.checkbox("Moves with the camera", source.frame == "camera")
        ui.note("light frame", describe_field(type(source), "frame"))
        if pressed:
            new = lighting.toggle_frame(new, index)
    return _regroup(new, state, ui, index, placed.group)


def _regroup(new: ViewState, state: ViewState, ui: UiContext, index: int, group: int) -> ViewState:
    """Draw the list that moves a source to another group, if there is another."""
    names = [as_one_line(entry.name) for entry in state.shading.groups]
    if len(state.shading.groups[group].sources) > 1:
        names.append("a group of its own")
    if len(names) < 2:
        return new
    picked, to = imgui.combo("Light group", group, names)
    ui.note("source group", "Sources of one group share a spectrum")
    return ui.edited(new, partial(lighting.move_source, index=index, group=to)) if picked else new


def _surface_of_room(state: ViewState, ui: UiContext) -> ViewState:
    """Draw what the room leaves to choose."""
    imgui.separator_text("Surface")
    imgui.push_item_width(-ui.px(_LABELS))
    new = draw_fields(state, ui, CAST, *_GLOSS)
    imgui.pop_item_width()
    return new


@lru_cache(maxsize=128)
def _rig(spectrum: Spectrum) -> LightRig:
    """Return a spectrum's rig; always the same object, as the colour cache requires."""
    return LightRig((spectrum,))


def draw_handles(state: ViewState, ui: UiContext) -> None:
    """Draw a sun for each lamp, hollow behind the volume, and the ring of directions."""
    projection = ui.projection(state)
    handles = lighting_aim.list_handles(state, projection)
    if not handles:
        return
    hovered = None
    if not imgui.get_io().want_capture_mouse:
        mouse = imgui.get_mouse_pos()
        hovered = nearest_handle(handles, (mouse.x, mouse.y), ui.scale)
    sources = lighting_aim.list_sources(state.shading)
    middle, radius = lighting_aim.ring(projection)
    with over_picture(ui) as draw_list:
        if any(not isinstance(sources[lamp.index].source, Point) for lamp in handles):
            shade, line = pack_colour(BLACK, 0.35), pack_colour(WHITE, 0.35)
            draw_list.add_circle(middle, radius, shade, 96, ui.px(2.5))
            draw_list.add_circle(middle, radius, line, 96, ui.px(1))
        for handle in handles:
            source = sources[handle.index].source
            is_accented = handle == hovered or handle.index == lighting.chosen_source(state)
            colour = pack_colour(ACCENT[True] if is_accented else WHITE, 0.95)
            _sun(draw_list, ui, handle.place, colour, lighting_aim.is_behind(state, source))
            x, y = handle.place
            ui.areas[f"{handle.name} {handle.index}"] = int(x) - 2, int(y) - 2, 4, 4


def _sun(
    draw_list: imgui.ImDrawList,
    ui: UiContext,
    place: tuple[float, float],
    colour: int,
    hollow: bool,
) -> None:
    """Draw a disc with rays, with a dark outline so that it is visible on any picture."""
    (x, y), shade = place, pack_colour(BLACK, 0.6)
    inner, outer = (ui.px(length) for length in _RAYS)
    for layer, width in ((shade, ui.px(4)), (colour, ui.px(1.8))):
        for i in range(8):
            across, down = math.cos(i * math.pi / 4), math.sin(i * math.pi / 4)
            ends = (x + inner * across, y + inner * down), (x + outer * across, y + outer * down)
            draw_list.add_line(*ends, layer, width)
    draw_list.add_circle_filled(place, ui.px(_DISC + 1.5), shade)
    if hollow:
        draw_list.add_circle(place, ui.px(_DISC - 1), colour, 0, ui.px(2))
    else:
        draw_list.add_circle_filled(place, ui.px(_DISC), colour)
