"""Widgets for fields of settings: sliders, lists and boxes, whose tips are the fields' docstrings.

    settings, state -> [form] -> panels

A panel lists the `FormField`s that it shows; type, choices, range and unit are the settings'.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, get_args

from imgui_bundle import imgui

from volspec.settings import choices, hints, number_limits, plain_fields, unit_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import describe_field, focus_if_wanted, pick


@dataclass(frozen=True, slots=True)
class Form:
    """Settings of a state, and the edit that sets a field of them by its name."""

    read: Callable[[ViewState], Any]
    change: Callable[[ViewState, str, Any], ViewState]


@dataclass(frozen=True, slots=True)
class FormField:
    """A field of settings, and how its widget shows it."""

    name: str
    label: str
    limits: tuple[float, float] | None = (0.0, 1.0)
    """Ends of the slider, beyond which numbers can be typed; None: no slider, but a number."""
    text: str = ""
    """imgui's format of a number; default: with the field's unit."""
    none: str = ""
    """Text for None: the choice of no other, or what a slider shows at its left end."""
    titles: Mapping[str, str] = field(default_factory=dict)
    """Texts of choices, by value."""
    is_logarithmic: bool = False
    speed: float = 0.0
    """Change of a number that is dragged by a pixel, instead of a slider's."""
    key: str = ""
    """Name of the widget's rectangle; default: its label."""
    tip: str = ""
    """Text of the tooltip, with {} for the field's docstring; default: only that."""


def list_fields(cls: Any, *placed: str) -> tuple[FormField, ...]:
    """Return the fields of settings that a panel does not place, each with a plain widget."""
    return tuple(
        FormField(
            name,
            name if name != name.lower() else name.replace("_", " ").capitalize(),
            number_limits(hint := hints(cls)[name]),
            none="automatic" if type(None) in get_args(hint) else "",
        )
        for name in plain_fields(cls, *placed)
    )


def draw_fields(state: ViewState, ui: UiContext, form: Form, *fields: FormField) -> ViewState:
    """Draw the widgets of fields below each other; return the edited state."""
    for entry in fields:
        state = draw_field(state, ui, form, entry)
    return state


def draw_field(
    state: ViewState,
    ui: UiContext,
    form: Form,
    entry: FormField,
    *,
    now: Any = None,
    names: Collection[str] = (),
    disabled: bool = False,
) -> ViewState:
    """Draw the widget of a field; return the edited state.

    ``now`` is shown instead of the field's value, and ``names`` instead of its choices.
    """
    spec = form.read(state)
    cls: Any = type(spec)
    hint = hints(cls)[entry.name]
    value = getattr(spec, entry.name) if now is None else now
    words = names or (*([entry.none] if entry.none else ()), *choices(hint))
    focus_if_wanted(entry.label, ui)
    imgui.begin_disabled(disabled)
    if isinstance(value, bool):
        edited: tuple[bool, Any] = imgui.checkbox(entry.label, value)
    elif names or choices(hint):
        edited = _draw_choice(entry, value, words)
    else:
        edited = _draw_number(entry, value, hint)
    imgui.end_disabled()
    text = (entry.tip or "{}").replace("{}", describe_field(cls, entry.name))
    ui.note(entry.key or entry.label.lower(), text, greyed=disabled)
    changed, new = edited
    return form.change(state, entry.name, new) if changed else state


def _draw_choice(entry: FormField, value: Any, words: Collection[str]) -> tuple[bool, str | None]:
    """Draw a list of choices; return True and the value that was picked, if any."""
    titles = {entry.titles.get(word, word): word for word in words}
    now = entry.none if value is None else entry.titles.get(value, value)
    if not isinstance(now, str):
        now = " ".join(f"{number:.3g}" for number in (now if isinstance(now, tuple) else (now,)))
    picked = pick(entry.label, now, titles)
    new = titles.get(picked or "")
    return picked is not None, None if new == entry.none else new


def _draw_number(entry: FormField, value: Any, hint: Any) -> tuple[bool, Any]:
    """Draw a slider or a field for a number, or three; return True and it if it changed."""
    if entry.limits is None:
        return imgui.input_int(entry.label, int(value or 0))
    low, high = entry.limits
    flags = imgui.SliderFlags_.logarithmic if entry.is_logarithmic else 0
    if isinstance(value, tuple):
        moved, xyz = imgui.drag_float3(entry.label, list(value), entry.speed, low, high, entry.text)
        return moved, tuple(xyz)
    if entry.speed:
        return imgui.drag_float(entry.label, value, entry.speed, low, high, entry.text, flags)
    if isinstance(value, int):
        return imgui.slider_int(entry.label, value, int(low), int(high), entry.text or "%d", flags)
    unit = unit_of(hint)
    text = entry.text or (f"%.4g {unit}" if unit else "%.2f")
    position, text = (low, entry.none) if value is None else (value, text)
    changed, new = imgui.slider_float(entry.label, position, low, high, text, flags)
    is_none = entry.none and (new <= low or new < number_limits(hint)[0])
    return changed, None if is_none else new
