"""Layout of additions to a TOML document.

[_toml] -> palettes, scenes

tomlkit preserves a document's text. Additions are laid out here: lists with one row per line, long
lists of numbers eight per line, and new keys below the last key, above the next table's comments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tomlkit.items import Item

_A_LINE = 8


def toml_text(value: Any) -> str:
    """Return a value as TOML: text, number, list or inline table.

    >>> toml_text({"value": 90.0, "material": "bone", "up": (0, 0, 1)})
    '{ value = 90.0, material = "bone", up = [0, 0, 1] }'
    """
    import tomlkit

    if isinstance(value, Mapping):
        if not value:
            return "{}"
        return "{ " + ", ".join(f"{key_text(k)} = {toml_text(v)}" for k, v in value.items()) + " }"
    if not isinstance(value, list | tuple):
        return tomlkit.item(value).as_string()
    if any(isinstance(entry, Mapping) for entry in value):
        return "[\n" + "".join(f"    {toml_text(entry)},\n" for entry in value) + "]"
    if len(value) <= _A_LINE:
        return "[" + ", ".join(map(toml_text, value)) + "]"
    lines = [value[start : start + _A_LINE] for start in range(0, len(value), _A_LINE)]
    return "[\n" + "".join(f"    {', '.join(map(toml_text, line))},\n" for line in lines) + "]"


def key_text(key: str) -> str:
    """Return a key as TOML, quoted if necessary."""
    import tomlkit

    return tomlkit.key(key).as_string()


def toml_item(value: Any) -> Item:
    """Return a value as a tomlkit item, laid out by `toml_text`."""
    import tomlkit

    parsed: Any = tomlkit.parse(f"x = {toml_text(value)}\n")["x"]
    return parsed


def set_key(table: Any, key: str, value: Any) -> None:
    """Set a key of a document's table; a new key goes below the last key.

    tomlkit itself would put it below the comments above the next table.
    """
    item = toml_item(value)
    if key in table:
        table[key] = item
        return
    body = getattr(getattr(table, "value", None), "body", None)
    names = [name for name, node in body or () if name is not None and not _is_table(node)]
    if not names or table.is_inline_table():
        table[key] = item
    else:
        table.value._insert_after(names[-1], key, item)


def bind_comments(document: Any) -> None:
    """Attach the comments above each header to that header, so that they move with the table.

    tomlkit attaches them to the previous table, as its last lines.
    """
    from tomlkit.items import Comment, Null, Whitespace

    run: list[tuple[list[Any], int]] = []  # blank lines and comments since the last key
    first = True
    for body, index, header in _walk(document):
        if header is None:
            blank = isinstance(body[index][1], Comment | Whitespace)
            run = [*run, (body, index)] if blank else []
            first = first and blank
            continue
        # The first comments in a file are about the file.
        if not first:
            leading = _leading(run)
            above = "".join(b[i][1].as_string() for b, i in leading)
            header.trivia.indent = above + header.trivia.indent
            for b, i in leading:
                b[i] = (None, Null())
        run, first = [], False


def _leading(run: Sequence[tuple[list[Any], int]]) -> list[tuple[list[Any], int]]:
    """Return the comments directly above a header, and the blank lines before them."""
    from tomlkit.items import Comment

    start = len(run)
    while start and isinstance(run[start - 1][0][run[start - 1][1]][1], Comment):
        start -= 1
    while start and not isinstance(run[start - 1][0][run[start - 1][1]][1], Comment):
        start -= 1
    return list(run[start:])


def _walk(container: Any) -> Iterator[tuple[list[Any], int, Any]]:
    """Yield a document's items in order: (body, index, None), or a table's header as third."""
    from tomlkit.items import AoT, Table

    body = container.body
    for index, (_, item) in enumerate(body):
        if isinstance(item, Table):
            if not item.is_super_table():
                yield body, index, item
            yield from _walk(item.value)
        elif isinstance(item, AoT):
            for row in item.body:
                yield body, index, row
                yield from _walk(row.value)
        else:
            yield body, index, None


def _is_table(item: Any) -> bool:
    from tomlkit.items import AoT, Table

    return isinstance(item, AoT | Table)
