"""Text of files as values: JSON and TOML that anyone may have written.

    errors -> [_parse] -> spectra, basis, palette, scene, export, viewer

Python's parsers go as deep as a text is nested and make integers of any length; both end in errors
far from the file: RecursionError in whatever walks the value, OverflowError in NumPy. Here they are
refused where the text is read. What callers catch is a `ValueError` in one line.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from volspec.errors import InputError, quoted

MOST_LEVELS = 64
"""Levels of lists and tables in a file; ours have up to ten."""
_INTEGERS = range(-(2**63), 2**63)  # TOML's, and what NumPy holds
_TOO_DEEP = f"it is nested too deeply, more than {MOST_LEVELS} levels"


def parse_json(text: Any) -> Any:
    """Return what a JSON text says.

    Raises
    ------
    ValueError
        If it is no JSON, nested too deeply, or holds an integer beyond 64 bits.

    Examples
    --------
    >>> parse_json('{"a": [1, 2.5]}')
    {'a': [1, 2.5]}
    >>> parse_json("[" * 9999)
    Traceback (most recent call last):
    ValueError: it is nested too deeply, more than 64 levels
    """
    if not isinstance(text, str):
        raise ValueError(f"expected text, got {type(text).__name__}")
    return _checked(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises
    ------
    ValueError
        As `parse_json`.
    """
    tables: dict[str, Any] = _checked(tomllib.loads, text)
    return tables


def read_text(path: str | os.PathLike[str], error: type[InputError], what: str) -> str:
    """Return the text of a file; a mark of byte order is none of it.

    Parameters
    ----------
    path : path
    error : type
        What to raise.
    what : str
        What to give instead of another file, as ``"a scene file (.toml)"``.

    Raises
    ------
    InputError
        Of the given class, if the file is missing, unreadable or no UTF-8.
    """
    name = os.fspath(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise error(f"{name}: no such file; check the path", code="not-found") from None
    except IsADirectoryError:
        raise error(f"{name}: is a folder; give {what}") from None
    except UnicodeDecodeError as fault:
        if 0 in fault.object:
            raise error(f"{name}: is no text; give {what}") from None
        raise error(
            f"{name}: is not UTF-8 text ({fault.reason} at byte {fault.start}); give {what}, and "
            "save it as UTF-8"
        ) from None
    except OSError as fault:
        raise error(
            f"{name}: cannot be read: {fault.strerror or fault}; check the path and its "
            "permissions",
            code="damaged",
        ) from fault
    except ValueError:  # a NUL character
        raise error(f"{name!r} is no path; give {what}") from None


def _checked(parse: Callable[[str], Any], text: str) -> Any:
    try:
        value = parse(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    level: list[Any] = [[value]]
    for _ in range(MOST_LEVELS + 1):
        level = [each for holder in level for each in _held(holder)]
        if not level:
            return value
    raise ValueError(_TOO_DEEP)


def _held(holder: Any) -> list[Any]:
    """Return the lists and tables in one; refuse integers that no number of ours can be."""
    if not isinstance(holder, dict | list):
        return []
    values = holder.values() if isinstance(holder, dict) else holder
    held = []
    for value in values:
        if isinstance(value, dict | list):
            held.append(value)
        elif isinstance(value, int) and value not in _INTEGERS:
            raise ValueError(f"{quoted(value)} is beyond 64 bits; write it as 1e30, say")
    return held
