"""Parse JSON and TOML from untrusted files.

    errors -> [_parse] -> spectra, basis, palette, scene, export, viewer

Python's parsers accept any nesting depth and integers of any length, which cause errors far from
the file: RecursionError in code that walks the value, OverflowError in NumPy. Both are refused
here with a one-line `ValueError`.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from volspec._confine import require_inside
from volspec._files import nearest_file
from volspec.errors import InputError, quote

MAX_LEVELS = 64
"""Greatest nesting of lists and tables in a file; volspec's own have up to ten."""
_INTEGERS = range(-(2**63), 2**63)  # the range of TOML, and of NumPy's int64
_TOO_DEEP = f"it is nested too deeply, more than {MAX_LEVELS} levels"


def parse_json(text: Any) -> Any:
    """Parse a JSON text.

    Raises ValueError if it is not JSON, nested too deeply, or has an integer beyond 64 bits.

    >>> parse_json('{"a": [1, 2.5]}')
    {'a': [1, 2.5]}
    >>> parse_json("[" * 9999)
    Traceback (most recent call last):
    ValueError: it is nested too deeply, more than 64 levels
    """
    if not isinstance(text, str):
        raise ValueError(f"expected text, got {type(text).__name__}")
    return _parse_bounded(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text; raises as `parse_json`."""
    tables: dict[str, Any] = _parse_bounded(tomllib.loads, text)
    return tables


def toml_remedy(error: ValueError, text: str) -> str:
    """Return the remedy for an error of `parse_toml`, from the line that it names.

    >>> text = "zoom = 1,5"
    >>> try:
    ...     parse_toml(text)
    ... except ValueError as error:
    ...     toml_remedy(error, text)
    'write decimals with a point: 1.5 instead of 1,5'
    """
    message = str(error)
    place = re.search(r"at line (\d+)", message)
    if place is None:
        return "complete the end of the file" if "end of document" in message else "correct it"
    line = text.split("\n")[int(place[1]) - 1].strip()
    comma = re.search(r"=\s*([-+]?\d+),(\d+)", line)
    if message.startswith("Cannot "):
        name = re.match(r"\[+([^\[\]]+)", line)
        if name is None:
            return "give the key once"
        return f"leave out one, or head each row of a list with [[{name[1].strip()}]]"
    if comma:
        integer, part = comma.groups()
        return f"write decimals with a point: {integer}.{part} instead of {integer},{part}"
    word = re.search(r"(\w+\s*=\s*)([A-Za-z#/.][^\"'{}\[\],=]*)$", line)
    if word:
        return f'put text in quotes: {word[1]}"{word[2].strip()}"'
    return f"correct this line: {quote(line, 60)}"


class _NoEntities(ElementTree.TreeBuilder):
    """XML builder that refuses a document type, because its entities could fill the memory."""

    def doctype(self, *_: object) -> None:
        raise ValueError("it declares a document type")


def parse_xml(content: str | bytes) -> ElementTree.Element:
    """Parse XML; raises ValueError if it is damaged or declares a document type."""
    try:
        return ElementTree.fromstring(content, ElementTree.XMLParser(target=_NoEntities()))
    except (ElementTree.ParseError, LookupError) as error:  # LookupError: an unknown encoding
        raise ValueError(str(error)) from error


def read_text(path: str | os.PathLike[str], error: type[InputError], kind: str) -> str:
    """Read a text file without its byte order mark.

    Raises ``error`` if it is missing, unreadable or not UTF-8; ``kind`` is the expected kind of
    file in the message, such as ``"a scene file (.toml)"``.
    """
    name = os.fspath(path)
    require_inside(path, error)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        guess = nearest_file(Path(path))
        raise error(f"{name}: no such file; {guess}check the path", code="not-found") from None
    except IsADirectoryError:
        raise error(f"{name}: is a folder; give {kind}", code="type") from None
    except UnicodeDecodeError as fault:
        if fault.object[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise error(f"{name}: is UTF-16 text; save it as UTF-8", code="syntax") from None
        if 0 in fault.object:
            raise error(f"{name}: is not text; give {kind}", code="type") from None
        raise error(
            f"{name}: is not UTF-8 text ({fault.reason} at byte {fault.start}); give {kind}, and "
            "save it as UTF-8",
            code="syntax",
        ) from None
    except OSError as fault:
        raise error(
            f"{name}: cannot be read: {fault.strerror or fault}; check the path and its "
            "permissions",
            code="damaged",
        ) from fault
    except ValueError:  # a NUL character
        raise error(f"{name!r} is not a path; give {kind}", code="syntax") from None


def _parse_bounded(parse: Callable[[str], Any], text: str) -> Any:
    try:
        value = parse(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    level: list[Any] = [[value]]
    for _ in range(MAX_LEVELS + 1):
        level = [child for container in level for child in _children(container)]
        if not level:
            return value
    raise ValueError(_TOO_DEEP)


def _children(container: Any) -> list[Any]:
    """Return the lists and tables in a container; refuse integers beyond 64 bits."""
    if not isinstance(container, dict | list):
        return []
    values = container.values() if isinstance(container, dict) else container
    children = []
    for value in values:
        if isinstance(value, dict | list):
            children.append(value)
        elif isinstance(value, int) and value not in _INTEGERS:
            raise ValueError(f"{quote(value)} is beyond 64 bits; write it as 1e30, say")
    return children
