"""The window's layout: panels docked at the right, the picture in what is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import commands, compare, cuts, menus, overlays, slices, viewing
from volspec.viewer.ui import lights_panel as lights
from volspec.viewer.ui import palette_panel as palette
from volspec.viewer.ui import transfer_panel as transfer
from volspec.viewer.ui.context import UiContext

Draw = Callable[[ViewState, UiContext], ViewState | None]


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel.

    Parameters
    ----------
    title : str
    draw : callable
    place : {"upper", "lower", "left"}
        Where it is docked at first.
    """

    title: str
    draw: Draw
    place: str


PANEL_WIDTH = 350
# Of panels at the left.
_LEFT_WIDTH = 260
# Of the window's width, for all panels.
_MOST = 0.5
# The lights' share of the height; below stand the others as tabs.
_UPPER = 0.51
# Frames until docked windows stand where they belong.
_LAG = 2
_PANELS = (
    Panel("Lights", lights.draw, "upper"),
    Panel("Viewing", viewing.draw, "lower"),
    Panel("Transfer", transfer.draw, "lower"),
    Panel("Cuts", cuts.draw, "lower"),
    Panel("Slices", slices.draw, "left"),
    Panel("Palette", palette.draw, "lower"),
)
# The panel that is in front of the tabs at first.
_FIRST = "Viewing"
_OVERLAYS = (
    compare.draw_error_map,
    compare.draw_divide,
    overlays.draw_probe,
    menus.draw_keys,
    cuts.draw_handles,
    overlays.draw_cube,
    overlays.draw_scale,
    commands.draw,
)
_DOCKED = (
    imgui.DockNodeFlags_.passthru_central_node | imgui.DockNodeFlags_.no_docking_over_central_node
)


class Docks:
    """Docks the panels when they are first drawn; where the user puts them later is theirs."""

    def __init__(self) -> None:
        self._frames = 0
        # Docks beside the picture, and where panels were open in the frame before.
        self._sides: dict[str, int] = {}
        self._open: set[str] = set()
        self._narrowed = False

    @property
    def settled(self) -> bool:
        """Whether the areas hold: imgui lays out what the frame before has asked for."""
        return self._frames > _LAG

    def picture(self, ui: UiContext, panels: bool) -> tuple[int, int, int, int]:
        """Lay the dock out; x, y, width and height of what is left for the picture.

        Parameters
        ----------
        ui : UiContext
        panels : bool
            Whether they will be drawn; a dock that stands empty would be given up.
        """
        space = imgui.dock_space_over_viewport(imgui.get_id("dock"), flags=_DOCKED)
        if panels:
            if self._frames == 0:
                self._dock(space, ui)
            self._frames += 1
            self._share(ui)
        node = imgui.internal.dock_builder_get_central_node(space)
        area = int(node.pos.x), int(node.pos.y), int(node.size.x), int(node.size.y)
        ui.areas["picture"] = area
        return area

    def panels(self, state: ViewState, ui: UiContext) -> ViewState:
        """Draw those that are open; the state that comes out."""
        self._open = set()
        for panel in _PANELS:
            if panel.title not in state.interface.panels:
                continue
            self._open.add("left" if panel.place == "left" else "right")
            if ui.front == panel.title:
                ui.front = ""
                imgui.set_next_window_focus()
            shown, kept = imgui.begin(panel.title, True, imgui.WindowFlags_.no_collapse)
            if shown:
                state = panel.draw(state, ui) or state
            imgui.end()
            if not kept:
                rest = state.interface.panels - {panel.title}
                state = replace(state, interface=replace(state.interface, panels=rest))
        if self._frames == 1:
            imgui.set_window_focus(_FIRST)
        for overlay in _OVERLAYS:
            state = overlay(state, ui) or state
        return state

    @staticmethod
    def open_panels(state: ViewState) -> list[str]:
        """Titles of the panels that are open, in their order."""
        return [panel.title for panel in _PANELS if panel.title in state.interface.panels]

    @staticmethod
    def bars(state: ViewState, ui: UiContext) -> ViewState:
        """The menu at the top and the line at the bottom; `picture` gets what they leave."""
        menus.draw_status(state, ui)
        return menus.draw_menu(state, ui) or state

    def _share(self, ui: UiContext) -> None:
        """Leave the picture half of a window that has become narrow; undo it in a wide one."""
        builder = imgui.internal
        room = _MOST * imgui.get_main_viewport().work_size.x
        open_ = [dock for side, dock in self._sides.items() if side in self._open]
        nodes = [node for dock in open_ if (node := builder.dock_builder_get_node(dock))]
        wide = sum(node.size.x for node in nodes)
        wanted = ui.px(PANEL_WIDTH) if len(nodes) == 1 else wide
        if wide > room + 1:
            self._narrowed = True
        elif self._narrowed and wide < min(wanted, room) - 1:
            wide, room = wide, min(wanted, room)
        else:
            self._narrowed = self._narrowed and wide < wanted - 1
            return
        for node in nodes:
            builder.dock_builder_set_node_size(node.id_, (node.size.x * room / wide, node.size.y))

    def _dock(self, space: int, ui: UiContext) -> None:
        builder = imgui.internal
        viewport = imgui.get_main_viewport()
        share = min(ui.px(PANEL_WIDTH) / max(viewport.work_size.x, 1.0), _MOST)
        builder.dock_builder_remove_node_child_nodes(space)
        right = builder.dock_builder_split_node(space, imgui.Dir.right, share)
        left_share = min(ui.px(_LEFT_WIDTH) / max(viewport.work_size.x * (1 - share), 1.0), 0.4)
        left = builder.dock_builder_split_node(right.id_at_opposite_dir, imgui.Dir.left, left_share)
        self._sides = {"right": right.id_at_dir, "left": left.id_at_dir}
        lower = builder.dock_builder_split_node(right.id_at_dir, imgui.Dir.down, 1 - _UPPER)
        places = {
            "upper": lower.id_at_opposite_dir,
            "lower": lower.id_at_dir,
            "left": left.id_at_dir,
        }
        # The tabs have their own.
        no_close = imgui.internal.DockNodeFlagsPrivate_.no_close_button
        for node in places.values():
            builder.dock_builder_get_node(node).local_flags |= no_close
        for panel in _PANELS:
            builder.dock_builder_dock_window(panel.title, places[panel.place])
        builder.dock_builder_finish(space)
