"""Which keys of a table are worth a line in a file, and their values as TOML has them.

base -> [written] -> scenes, palettes
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from volspec._tables.base import Table

# Below it whole numbers are short.
_EXACT = 1e15


def plain(value: Any) -> Any:
    """A table's values in TOML's types; keys equal to their defaults left out."""
    if isinstance(value, Table):
        return {key: plain(getattr(value, key)) for key in written_keys(value)}
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    # As people write them; every such field takes whole numbers.
    if isinstance(value, float) and value.is_integer() and abs(value) < _EXACT:
        return int(value)
    return value


def written_keys(table: Table) -> list[str]:
    """The keys that a file needs to say."""
    return [key for key in all_keys(table) if is_written(table, key)]


def all_keys(table: Table) -> list[str]:
    """In the order in which they are written: what tells a row from others goes first."""
    return list(dict.fromkeys((*table.row_keys, *type(table).model_fields)))


def is_written(table: Table, key: str, given: bool = False) -> bool:
    """Whether a key is worth a line; a default is where a file has it and the table set it."""
    value, field = getattr(table, key), type(table).model_fields[key]
    if value is None:
        return False
    if field.is_required() or value != field.get_default(call_default_factory=True):
        return True
    return given and key in table.model_fields_set
