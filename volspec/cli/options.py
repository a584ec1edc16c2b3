"""Options of commands, derived from the fields of settings: type, choices, range, unit and help.

    settings -> [options] -> classes of options -> cyclopts, commands

A class of options names the fields that its command can set; each becomes an option with the same
name, and the first sentence of the field's docstring as its help.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union, get_origin

from cyclopts import Group, Parameter

from volspec.cli.arguments import parse_triple
from volspec.cli.shell import as_written
from volspec.errors import InputError
from volspec.settings import alternatives, descriptions, hints, words_for


class Options:
    """Options of a command, by the fields of settings that they set; None if not given.

    Subclasses are frozen dataclasses whose fields become options of a command that takes one.
    """

    names: ClassVar[Mapping[str, str]] = {}
    """Options by field."""
    owners: ClassVar[Mapping[str, type]] = {}
    """Settings classes by field."""
    optional: ClassVar[frozenset[str]] = frozenset()
    """Fields that are None if their option is off."""

    if TYPE_CHECKING:

        def __init__(self, **given: Any) -> None: ...
        def __getattr__(self, name: str) -> Any: ...

    def __init_subclass__(
        cls,
        group: Group,
        of: Mapping[type, Collection[str]],
        names: Mapping[str, str] | None = None,
        off: Collection[str] = (),
        negative: str | None = None,
    ) -> None:
        """Add an option for each field of settings classes, ``of``: {class: fields}.

        ``names`` are options that are not named as their field; the fields ``off`` also take that
        word, for None; ``negative`` is as of `cyclopts.Parameter`, for switches.
        """
        owners = {name: owner for owner, field_names in of.items() for name in field_names}
        cls.owners, cls.optional = {**cls.owners, **owners}, cls.optional | {*off}
        cls.names = {**cls.names, **{name: option_name(name) for name in owners}, **(names or {})}
        annotations = {}
        for name, owner in owners.items():
            kinds = alternatives(hints(owner)[name])
            is_text = any(
                hint not in (int, float, bool) and get_origin(hint) is not Literal for hint in kinds
            )
            kind: Any = str if is_text else Union[tuple(kinds)]  # noqa: UP007  # of a list
            is_number = kind in (int, float)
            words = [_first_sentence(owner, name, cls.names)]
            if is_number:
                phrase = words_for(hints(owner)[name]).removesuffix(", or leave it out")
                words.append(f"{phrase[0].upper()}{phrase[1:]}{', or off' * (name in off)}.")
            parameter = Parameter(
                cls.names[name],
                converter=as_written if kind not in (bool, str) else None,
                group=group,
                help=" ".join(words),
                negative=negative if kind is bool else None,
                show_choices=get_origin(kind) is Literal,
            )
            kind = kind | Literal["off"] if name in off else kind
            annotations[name] = Annotated[kind | None, parameter]
            setattr(cls, name, None)
        cls.__annotations__ = {**annotations, **inspect.get_annotations(cls)}
        dataclass(frozen=True, kw_only=True)(cls)
        Parameter(name="*", group=group)(cls)

    def given(self, owner: type | None = None) -> dict[str, Any]:
        """Return the options that were given, by field: of a settings class, or all of them."""
        names = [name for name in self.names if owner in (None, self.owners.get(name))]
        values = {name: value for name in names if (value := getattr(self, name)) is not None}
        return {name: self._value(name, value) for name, value in values.items()}

    def _value(self, name: str, value: Any) -> Any:
        """Return a field's value: three numbers if they are written as a text, None if off."""
        if isinstance(value, str) and name in self.owners:
            kinds = alternatives(hints(self.owners[name])[name])
            if any(get_origin(kind) is tuple for kind in kinds):
                return parse_triple(value) or value
        return None if name in self.optional and value == "off" else value

    def given_names(self, *without: str) -> list[str]:
        """Return the names of the options that were given, ``without`` those of some fields."""
        return [self.names[name] for name in self.given() if name not in without]


def option_name(field: str) -> str:
    """Return the name of a field's option; letters of physics keep their underscore.

    >>> option_name("fov_deg"), option_name("L_A")
    ('--fov-deg', '--L_A')
    """
    return f"--{field if field != field.lower() else field.replace('_', '-')}"


def require_with(options: Sequence[str], needed: str, example: str = "") -> None:
    """Refuse options that have no meaning without another one, such as an ``example`` of it."""
    if options:
        raise InputError(
            f"{' and '.join(options)} without {needed}",
            f"add {example or needed}, or leave it out",
            code="conflict",
        )


def _first_sentence(owner: type, field: str, names: Mapping[str, str]) -> str:
    """Return the first sentence of a field's docstring, with options instead of their fields."""
    text = descriptions(owner)[field]
    sentence = re.split(r"(?<=\.) (?=[A-Z])", text.replace("``", ""), maxsplit=1)[0]
    return re.sub(r"\w+_\w+", lambda word: names.get(word[0], word[0]), sentence)
