"""Labels of a segmentation: which are shown, and the search among them.

panel, commands -> [labels] -> LabelFunction
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

from volspec.transfer import LabelFunction, Transfer
from volspec.viewer.model.edit import Command, edit
from volspec.viewer.model.state import ViewState


@edit
def toggle_label(state: ViewState, label: int) -> ViewState:
    """Show or hide a label; its opacity stays."""
    function = state.transfer
    if not isinstance(function, LabelFunction) or label not in function.labels:
        return state
    return _with_hidden(state, function.hidden ^ {label})


@edit
def show_only(state: ViewState, label: int) -> ViewState:
    """Hide all labels but one; show all if it is the only one shown."""
    function = state.transfer
    if not isinstance(function, LabelFunction) or label not in function.labels:
        return state
    hidden = function.labels.keys() - {label}
    return _with_hidden(state, () if function.hidden == hidden else hidden)


def show_all(state: ViewState) -> ViewState:
    """Show all labels."""
    return _with_hidden(state, ())


def hide_all(state: ViewState) -> ViewState:
    """Hide all labels."""
    function = state.transfer
    return _with_hidden(state, function.labels if isinstance(function, LabelFunction) else ())


def invert(state: ViewState) -> ViewState:
    """Show the hidden labels, and hide the others."""
    function = state.transfer
    if not isinstance(function, LabelFunction):
        return state
    return _with_hidden(state, function.labels.keys() - function.hidden)


def _with_hidden(state: ViewState, hidden: Iterable[int]) -> ViewState:
    function = state.transfer
    if not isinstance(function, LabelFunction) or function.hidden == frozenset(hidden):
        return state
    return replace(state, transfer=replace(function, hidden=frozenset(hidden)))


def label_title(transfer: Transfer, label: int) -> str:
    """Return a label's number, and its name if it has one."""
    name = transfer.names.get(label, "") if isinstance(transfer, LabelFunction) else ""
    return f"{label} {name}".strip()


# Called in every frame.
@lru_cache(maxsize=4)
def matching_labels(function: LabelFunction, search: str) -> tuple[int, ...]:
    """Return the indices of the labels whose number or name contains all words of a search."""
    words = search.casefold().split()
    titles = (label_title(function, label).casefold() for label in function.labels)
    return tuple(i for i, title in enumerate(titles) if all(word in title for word in words))


COMMANDS = (
    Command("labels-show", "Transfer", "Labels: show all", (), show_all),
    Command("labels-hide", "Transfer", "Labels: hide all", (), hide_all),
    Command("labels-invert", "Transfer", "Labels: swap shown and hidden", (), invert),
)
