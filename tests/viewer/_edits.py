"""Edits of the viewer's state with arguments drawn by their types."""

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

from volspec.viewer import model
from volspec.viewer.model.edit import Edited
from volspec.viewer.model.state import ViewState

MODULES = [import_module(f"volspec.viewer.model.{m.name}") for m in iter_modules(model.__path__)]
NUMBERS = st.floats(-2, 30) | st.floats(-1e9, 1e9) | st.sampled_from([0.0, math.nan, math.inf])
INDICES = st.integers(-2, 12)


def edits_of(*modules: Any) -> dict[str, Callable[..., Any]]:
    """Return edits by module and name: functions that `volspec.viewer.model.edit` makes total."""
    return {
        f"{module.__name__.rpartition('.')[2]}.{name}": each
        for module in modules
        for name, each in vars(module).items()
        if hasattr(each, "__wrapped__")
        and each.__module__ == module.__name__
        and next(iter(inspect.signature(each).parameters), "") == "state"
    }


@dataclass(frozen=True)
class Drawn:
    """An edit with its arguments."""

    name: str
    given: tuple[Any, ...]

    def __call__(self, state: ViewState) -> ViewState:
        found = _EDITS[self.name](state, *self.given)
        return found.state if isinstance(found, Edited) else found


def drawn(words: tuple[str, ...], *modules: Any) -> st.SearchStrategy[Drawn]:
    """Draw any edit with any arguments, of which texts are among ``words``."""
    names = sorted(edits_of(*modules))
    numbers, indices = st.tuples(*[NUMBERS] * 4), st.tuples(INDICES, INDICES)
    return st.builds(
        with_arguments, st.sampled_from(names), numbers, indices, st.sampled_from(words)
    )


def with_arguments(
    name: str, numbers: tuple[float, ...], indices: tuple[int, ...], word: str
) -> Drawn:
    """Return an edit with arguments by their types."""
    some, which, given = iter(numbers), iter(indices), list[Any]()
    for kind in _types(name):
        if kind is int:
            given.append(next(which))
        elif kind is bool:
            given.append(next(some) > 0)
        elif get_origin(kind) is Literal:
            choices = get_args(kind)
            given.append(choices[next(which) % len(choices)])
        elif kind is str:
            given.append(word)
        elif get_origin(kind) is tuple:
            given.append(tuple(next(some) for _ in get_args(kind)))
        else:
            given.append(next(some))
    return Drawn(name, tuple(given))


_EDITS = edits_of(*MODULES)


@cache
def _types(name: str) -> tuple[Any, ...]:
    """Return the types of an edit's arguments after the state."""
    hints = get_type_hints(_EDITS[name].__wrapped__)
    return tuple(hints[each] for each in list(inspect.signature(_EDITS[name]).parameters)[1:])
