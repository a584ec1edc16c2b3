"""Measure distances and angles in the picture, and label points of it.

clicks, panel -> [measure] -> state
"""

from __future__ import annotations

from dataclasses import replace

from volspec.errors import InputError
from volspec.scene.tables import ANGLE, DISTANCE, LABEL, MAX_LETTERS, Annotation
from volspec.settings import Vector
from volspec.viewer.model.edit import Command, bind, edit, refusable, with_interface, with_values
from volspec.viewer.model.light_rows import with_changes, without_item
from volspec.viewer.model.state import ViewState

MAX_POINTS = 99
# Points that a tool picks, by its name.
TOOLS = {"distance": DISTANCE, "angle": ANGLE, "label": LABEL}
_NEW_TEXT = "label"
PANEL = "Measure"


@edit
def start(state: ViewState, tool: str) -> ViewState:
    """Start picking points with a tool, or stop if it is in use."""
    if tool not in TOOLS or state.interface.tool == tool:
        return stop(state)
    return with_interface(show(state), tool=tool, tool_points=())


@edit
def show(state: ViewState) -> ViewState:
    """Show the panel that lists the annotations."""
    return with_interface(state, panels=state.interface.panels | {PANEL})


@edit
def stop(state: ViewState) -> ViewState:
    """Stop picking points."""
    return with_interface(state, tool="", tool_points=())


@refusable
def pick(state: ViewState, point_mm: Vector) -> ViewState:
    """Pick a point; the last point of a tool adds its annotation, and the tool stays in use."""
    needed = TOOLS.get(state.interface.tool)
    if needed is None:
        return state
    points = (*state.interface.tool_points[: needed - 1], point_mm)
    if len(points) < needed:
        return with_interface(state, tool_points=points)
    if len(state.annotations) >= MAX_POINTS:
        raise InputError(f"The limit is {MAX_POINTS} annotations; remove one first", code="size")
    added = Annotation(points_mm=points, text=_NEW_TEXT if needed == LABEL else "")
    return replace(with_interface(state, tool_points=()), annotations=(*state.annotations, added))


@refusable
def rename(state: ViewState, index: int, text: str) -> ViewState:
    """Set an annotation's text; it keeps its own if the new one is too long, or a label's empty."""
    text = " ".join(text.split())
    if len(text) > MAX_LETTERS:
        raise InputError(
            f"An annotation has up to {MAX_LETTERS} letters, not {len(text)}; shorten it",
            code="size",
        )
    return with_values(state, annotations=with_changes(state.annotations, index, text=text))


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove an annotation."""
    return with_values(state, annotations=without_item(state.annotations, index))


@edit
def remove_all(state: ViewState) -> ViewState:
    """Remove all annotations."""
    return replace(state, annotations=())


def hint(state: ViewState) -> str:
    """Return what to click next; empty if no tool is in use."""
    tool = state.interface.tool
    # A session may have points of another tool.
    picked = min(len(state.interface.tool_points), TOOLS.get(tool, 1) - 1)
    if not tool:
        return ""
    if tool == "label":
        return "Click the point to label; Esc ends"
    if tool not in TOOLS:
        return f"The mouse carries the {tool}; a click or Esc lays it down"
    steps = ("first", "second") if tool == "distance" else ("first", "middle", "last")
    return f"Click the {steps[picked]} point of the {tool}; Esc ends"


def _tool(name: str, title: str, words: str) -> Command:
    return Command(
        f"measure-{name}",
        "View",
        title,
        (),
        bind(start, name),
        lambda state: state.interface.tool == name,
        words=words,
    )


COMMANDS = (
    _tool("distance", "Measure a distance", "ruler length mm size"),
    _tool("angle", "Measure an angle", "degrees protractor"),
    _tool("label", "Add a label", "annotate annotation text note arrow"),
    Command(
        "measure-remove",
        "View",
        "Remove all measurements and labels",
        (),
        remove_all,
        words="clear",
    ),
)
