"""What is remembered from one run to the next: the user's folder for it, and files opened lately.

files opened -> [recent] -> menu, command palette
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from volspec._files import write_whole
from volspec._parse import parse_json
from volspec.errors import InputError

STATE_VARIABLE = "VOLSPEC_STATE"
MOST_FILES = 10


def state_folder() -> Path:
    """Where sessions and the list stand: ``VOLSPEC_STATE``, else the system's place for such."""
    from platformdirs import user_state_path

    return Path(os.environ.get(STATE_VARIABLE) or user_state_path("volspec", appauthor=False))


def address(path: str) -> str:
    """A file's name, with what follows a question mark, that holds in any folder."""
    file, mark, query = path.partition("?")
    return os.path.abspath(file) + mark + query


@dataclass(frozen=True, slots=True)
class RecentFile:
    """One row of the list.

    Parameters
    ----------
    path : str
    there : bool
        Whether there was a file when the list was last made.
    """

    path: str
    there: bool

    @property
    def label(self) -> str:
        """Name and folder."""
        file = Path(self.path.partition("?")[0])
        return f"{file.name}   {_short(file.parent)}"


class RecentFiles:
    """The list, the newest first.

    Parameters
    ----------
    folder : Path
        Where it is kept. What cannot be read or written there is done without.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / "recent.json"

    def rows(self) -> tuple[RecentFile, ...]:
        """As it stands in the file, which other windows write too."""
        try:
            data = parse_json(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return ()
        paths = [path for path in data if isinstance(path, str)] if isinstance(data, list) else []
        return tuple(
            RecentFile(path, os.path.exists(path.partition("?")[0])) for path in paths[:MOST_FILES]
        )

    def add(self, path: str) -> None:
        """A file that has been opened."""
        path = address(path)
        paths = [path, *(row.path for row in self.rows() if row.path != path)]
        self._write(paths[:MOST_FILES])

    def clear(self) -> None:
        """Forget all."""
        self._write([])

    def _write(self, paths: list[str]) -> None:
        try:
            with write_whole(self._file) as temporary:
                temporary.write_text(json.dumps(paths, indent=1), encoding="utf-8")
        except (InputError, OSError):
            return


def _short(folder: Path) -> str:
    """With ``~`` for the user's own folder, and not too long a beginning."""
    try:
        text = f"~/{folder.relative_to(Path.home())}".removesuffix("/.")
    except (ValueError, RuntimeError):
        text = str(folder)
    return text if len(text) <= 48 else f"…{text[-47:]}"
