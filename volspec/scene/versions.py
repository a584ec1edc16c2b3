"""The version of a scene's file, and the way from older ones.

    TOML -> [versions] -> SceneFile

A key that is added with a default needs no new version. One is for what would be refused, or mean
something else: then `MIGRATIONS` gets the step that leads to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping
from types import MappingProxyType
from typing import Any

from volspec.errors import SceneError

Migration = Callable[[MutableMapping[str, Any]], None]
"""Changes a file's tables in place, so that it serves a document with comments as well."""
FIRST = 1
"""What a file without ``version`` is: those of the first release had no such key."""
MIGRATIONS: Mapping[int, Migration] = MappingProxyType({})
"""From each version to the one after it."""


def newest() -> int:
    """The version that is written, and the last one read."""
    return max(MIGRATIONS, default=FIRST - 1) + 1


def migrate(data: MutableMapping[str, Any]) -> None:
    """Bring a file's tables to the newest version, in place.

    Raises
    ------
    SceneError
        If its version is none, or one of a later volspec.
    """
    version = data.get("version", FIRST)
    if not isinstance(version, int) or isinstance(version, bool) or version < FIRST:
        raise SceneError(f"version: is {version!r:.40}; give a whole number from {FIRST}")
    if version > newest():
        raise SceneError(
            f"version: is {version}, this volspec reads up to {newest()}; install a later one"
        )
    for step in range(version, newest()):
        MIGRATIONS[step](data)
        data["version"] = step + 1
