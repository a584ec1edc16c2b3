"""What pydantic complains of, in the words of the file: field, value, remedy; one line each.

ValidationError -> [messages] -> SceneError, PaletteError
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from volspec._tables.base import Table
from volspec._toml import toml_text
from volspec.errors import nearest


def explained(error: ValidationError, root: type[Table]) -> str:
    """The first complaint in one line; an unknown key goes before what it made miss."""
    return faults(error, root)[0]


def faults(error: ValidationError, root: type[Table]) -> list[str]:
    """Every complaint in a line of its own.

    Parameters
    ----------
    error : ValidationError
    root : type of Table
        What the whole file was read as.
    """
    found: dict[str, list[tuple[_Place, Any]]] = {}
    for one in error.errors():
        place = _Place.of(one["loc"], root)
        # Of several tries at one value, a number and a word, say.
        found.setdefault(f"{one['type'] == 'missing'} {place.field}", []).append((place, one))
    groups = sorted(found.values(), key=lambda group: group[0][1]["type"] != "extra_forbidden")
    lines = []
    meant: set[str] = set()
    for group in groups:
        place, first = group[0]
        if first["type"] == "extra_forbidden":
            meant |= {f"{place.parent}{guess}" for guess in _guesses(place)}
        if first["type"] != "missing" or place.field not in meant:
            lines.append(_line(place, [one for _, one in group]))
    return list(dict.fromkeys(lines))


@dataclass(frozen=True, slots=True)
class _Place:
    """Where pydantic complains."""

    words: tuple[str, ...]
    # The tables that may stand there; of a missing or unknown key those that it belongs to.
    tables: tuple[type[Table], ...]
    key: FieldInfo | None

    @property
    def field(self) -> str:
        return ".".join(self.words)

    @property
    def parent(self) -> str:
        return "".join(f"{word}." for word in self.words[:-1])

    @classmethod
    def of(cls, loc: Sequence[int | str], root: type[Table]) -> _Place:
        """As a user would write it: pydantic also says which kind of a value it tried."""
        words: list[str] = []
        tables: list[type[Table]] = [root]
        key: FieldInfo | None = None
        tried = False
        for part in loc:
            if isinstance(part, int):
                words.append(str(part + 1))
            elif tried or part.startswith("<"):
                tried = False
            elif len(tables) > 1:
                tables = [table for table in tables if _kind(table) == part]
            else:
                words.append(part)
                key = tables[0].model_fields.get(part)
                if key is not None:
                    tables = _tables_in(key.annotation) or tables
                    tried = _is_tried(key)
        return cls(tuple(words), tuple(tables), key)


def _line(place: _Place, errors: Sequence[Any]) -> str:
    first = errors[0]
    field = place.field
    if first["type"] == "extra_forbidden":
        known = list(place.tables[0].model_fields)
        guess = nearest(place.words[-1], known)
        return f"{field}: unknown key; {guess}known: {', '.join(known)}"
    if first["type"].startswith("union_tag"):
        kinds = [_kind(table) for table in place.tables]
        tag = first["ctx"].get("tag")
        what = f"is {tag!r}; {nearest(tag, kinds)}give" if tag else "is missing; give"
        return f"{field}: kind {what} {', '.join(kinds)}"
    if len(place.words) == 1 and first["type"] in ("missing", "too_short"):
        is_list = place.key is not None and get_origin(place.key.annotation) is list
        return f"there is no {f'[[{field}]]' if is_list else f'[{field}]'}; add one"
    if first["type"] == "missing":
        return _missing(place, first)
    what = first["msg"].removeprefix("Value error, ")
    if first["type"].startswith("model_"):
        what = "give a table, { key = value, … }"
    for other in errors[1:]:
        what += ", or " + other["msg"].removeprefix("Input should be ")
    if not field:
        return what
    told = first["type"] == "value_error" and isinstance(first["input"], dict)
    return f"{field}: {what}" + ("" if told else f" (it is {first['input']!r:.60})")


def _missing(place: _Place, error: Any) -> str:
    word = place.words[-1]
    if word.isdecimal():
        given = error["input"]
        return f"{place.parent[:-1]}: number {word} is missing; add it (it is {given!r:.60})"
    examples = place.key.examples if place.key is not None else None
    shown = toml_text(examples[0]) if examples else "…"
    return f"{place.parent[:-1]}: {word} is missing; add {word} = {' '.join(shown.split())}"


def _guesses(place: _Place) -> list[str]:
    """What a misspelt key may mean."""
    known = place.tables[0].model_fields
    return [name for name in known if repr(name) in nearest(place.words[-1], known)]


def _is_tried(key: FieldInfo) -> bool:
    """Whether pydantic tries kinds of value in turn, whose names it then tells."""
    if get_origin(key.annotation) not in (Union, UnionType) or key.discriminator is not None:
        return False
    kinds = [kind for kind in get_args(key.annotation) if kind is not type(None)]
    return len(kinds) > 1 and not any("<value>" in str(kind) for kind in kinds)


def _kind(table: type[Table]) -> str:
    """The word that tells a table from others at its place."""
    return str(get_args(table.model_fields["kind"].annotation)[0])


def _tables_in(annotation: Any) -> list[type[Table]]:
    if inner := get_args(annotation):
        return [table for part in inner for table in _tables_in(part)]
    return [annotation] if isinstance(annotation, type) and issubclass(annotation, Table) else []
