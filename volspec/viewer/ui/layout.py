"""The window's layout: panels docked at the right, the picture in the rest."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from volspec.basis import MaterialBasis
from volspec.image import CoefficientImage
from volspec.viewer.model.commands import has_panel
from volspec.viewer.model.opacities import PANEL as OPACITY
from volspec.viewer.model.room import PANEL
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import (
    commands,
    cuts,
    effects,
    lighting,
    measure,
    menus,
    meshes,
    messages,
    opacities,
    overlays,
    quality,
    room,
    slices,
    start,
    time_bar,
    viewing,
)
from volspec.viewer.ui import lights_panel as lights
from volspec.viewer.ui import palette_panel as palette
from volspec.viewer.ui import transfer_panel as transfer
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import as_one_line, wrap_text

_RIGHT_WIDTH, _LEFT_WIDTH = 350, 260
# The greatest fraction of the window's width that all panels together may take.
_MAX = 0.5
# The lights' fraction of the height; the other panels are tabs below.
_UPPER = 0.51
# Frames until docked windows are in place.
_LAG = 2
# Title, function and initial dock of each panel.
_PANELS = (
    ("Lights", lights.draw, "upper"),
    ("Viewing", viewing.draw, "lower"),
    (PANEL, room.draw, "lower"),
    ("Meshes", meshes.draw, "lower"),
    ("Transfer", transfer.draw, "lower"),
    (OPACITY, opacities.draw, "lower"),
    ("Cuts", cuts.draw, "lower"),
    ("Slices", slices.draw, "left"),
    ("Palette", palette.draw, "lower"),
    ("Lighting", lighting.draw, "lower"),
    ("Quality", quality.draw, "lower"),
    ("Messages", messages.draw, "lower"),
    ("Measure", measure.draw, "lower"),
)
_OVERLAYS = (
    overlays.draw_error_map,
    overlays.draw_divide,
    overlays.draw_probe,
    menus.draw_keys,
    cuts.draw_handles,
    lighting.draw_handles,
    overlays.draw_cube,
    overlays.draw_scale,
    time_bar.draw,
    measure.draw_annotations,
    effects.draw_picture_menu,
    start.draw,
    commands.draw,
)
# Overlays of places in the picture, which pictures next to each other have twice.
_OF_PLACES = (
    *(overlays.draw_error_map, overlays.draw_divide, cuts.draw_handles, lighting.draw_handles),
    *(overlays.draw_scale, measure.draw_annotations),
)
# Overlays and panels of what was settled by the cast.
_OF_VOLUME = cuts.draw_handles, lighting.draw_handles, overlays.draw_cube, overlays.draw_scale
_OF_CAST = ("Meshes", "Transfer", "Cuts", "Slices", "Lighting", "Quality")
_D = imgui.DockNodeFlags_
_DOCKED = _D.passthru_central_node | _D.no_docking_over_central_node


def _explanation(title: str, state: ViewState) -> str:
    """Return why a panel is empty while a cast image is open; empty if it is not."""
    image = state.document.image
    if image is None:
        return ""
    if title == "Palette" and not isinstance(image.basis, MaterialBasis):
        return (
            "The image's channels are not its materials, so their reflectances cannot change. "
            'Cast the scene with [basis] method = "materials" to edit them here.'
        )
    if title not in _OF_CAST:
        return ""
    scene = image.notes.get("scene", "")
    return (
        "View, materials, cuts and shading belong to the cast, which this image is the result of. "
        f"Open its scene{f' “{as_one_line(scene)}”' * bool(scene)} to change them; lights and "
        "viewing change here."
    )


def fit_area(area: tuple[int, int, int, int], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the largest area of a shape in the middle of another.

    >>> fit_area((10, 0, 300, 100), (50, 50))
    (110, 0, 100, 100)
    """
    x, y, width, height = area
    scale = min(width / size[0], height / size[1])
    fit_width, fit_height = max(round(scale * size[0]), 1), max(round(scale * size[1]), 1)
    return x + (width - fit_width) // 2, y + (height - fit_height) // 2, fit_width, fit_height


class Docks:
    """Docks the panels when they are first drawn; the user may move them later."""

    def __init__(self) -> None:
        self._frames = 0
        self._sides: dict[str, int] = {}  # the docks left and right of the picture
        self._open: set[str] = set()  # those with panels in the previous frame
        self._narrowed = False

    @property
    def settled(self) -> bool:
        """True if the areas are valid: imgui's layout follows requests a frame later."""
        return self._frames > _LAG

    def picture(
        self, ui: UiContext, panels: bool, image: CoefficientImage | None
    ) -> tuple[int, int, int, int]:
        """Lay out the docks; return x, y, width and height of the picture's area.

        An ``image`` fills the room as far as its shape allows.
        """
        space = imgui.dock_space_over_viewport(imgui.get_id("dock"), flags=_DOCKED)
        if panels:  # imgui removes a dock that stays empty
            if self._frames == 0:
                self._dock(space, ui)
            self._frames += 1
            self._limit_width(ui)
        node = imgui.internal.dock_builder_get_central_node(space)
        area = int(node.pos.x), int(node.pos.y), int(node.size.x), int(node.size.y)
        if image is not None:
            area = fit_area(area, image.size)
        ui.areas["picture"] = area
        return area

    def panels(self, state: ViewState, ui: UiContext) -> ViewState:
        """Draw the open panels and the overlays; return the edited state."""
        self._open = set()
        for title, draw, place in _PANELS:
            if title not in state.interface.panels or not has_panel(state, title):
                continue
            self._open.add("left" if place == "left" else "right")
            if ui.front == title:
                ui.front = ""
                imgui.set_next_window_focus()
            visible, stays = imgui.begin(title, True, imgui.WindowFlags_.no_collapse)
            if visible and (text := _explanation(title, state)):
                wrap_text(text, imgui.Col_.text_disabled)
            elif visible:
                state = draw(state, ui) or state
            imgui.end()
            if not stays:
                remaining = state.interface.panels - {title}
                state = replace(state, interface=replace(state.interface, panels=remaining))
        if self._frames == 1:
            imgui.set_window_focus(PANEL if state.room else "Viewing")  # in front of the others
        hidden: list[object] = [] if state.document.image is None else [*_OF_VOLUME]
        hidden += _OF_PLACES if ui.results.side_by_side else ()
        for overlay in _OVERLAYS:
            if overlay not in hidden:
                state = overlay(state, ui) or state
        return state

    @staticmethod
    def open_panels(state: ViewState) -> list[str]:
        """Return the titles of the open panels, in their order."""
        return [
            title
            for title, _, _ in _PANELS
            if title in state.interface.panels and has_panel(state, title)
        ]

    def _limit_width(self, ui: UiContext) -> None:
        """Leave half of a narrowed window to the picture; restore the panels when it is widened."""
        builder = imgui.internal
        room = _MAX * imgui.get_main_viewport().work_size.x
        open_ = [dock for side, dock in self._sides.items() if side in self._open]
        nodes = [node for dock in open_ if (node := builder.dock_builder_get_node(dock))]
        width = sum(node.size.x for node in nodes)
        target = ui.px(_RIGHT_WIDTH) if len(nodes) == 1 else width
        if width > room + 1:
            self._narrowed = True
        elif self._narrowed and width < min(target, room) - 1:
            room = min(target, room)
        else:
            self._narrowed = self._narrowed and width < target - 1
            return
        for node in nodes:
            builder.dock_builder_set_node_size(node.id_, (node.size.x * room / width, node.size.y))

    def _dock(self, space: int, ui: UiContext) -> None:
        builder = imgui.internal
        viewport = imgui.get_main_viewport()
        fraction = min(ui.px(_RIGHT_WIDTH) / max(viewport.work_size.x, 1.0), _MAX)
        builder.dock_builder_remove_node_child_nodes(space)
        right = builder.dock_builder_split_node(space, imgui.Dir.right, fraction)
        left_share = min(ui.px(_LEFT_WIDTH) / max(viewport.work_size.x * (1 - fraction), 1.0), 0.4)
        left = builder.dock_builder_split_node(right.id_at_opposite_dir, imgui.Dir.left, left_share)
        self._sides = {"right": right.id_at_dir, "left": left.id_at_dir}
        lower = builder.dock_builder_split_node(right.id_at_dir, imgui.Dir.down, 1 - _UPPER)
        places = {
            "upper": lower.id_at_opposite_dir,
            "lower": lower.id_at_dir,
            "left": left.id_at_dir,
        }
        # The tabs have close buttons of their own.
        no_close = imgui.internal.DockNodeFlagsPrivate_.no_close_button
        for node in places.values():
            builder.dock_builder_get_node(node).local_flags |= no_close
        for title, _, place in _PANELS:
            builder.dock_builder_dock_window(title, places[place])
        builder.dock_builder_finish(space)
