"""What stands after the question mark of a volume's name: ``FOLDER?series=3&spacing=1,1,2``.

load_volume -> [query] -> readers
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qsl

from volspec.errors import VolspecWarning, VolumeError


@dataclass(frozen=True, slots=True)
class Query:
    """The options a volume was named with.

    Parameters
    ----------
    path : Path
        What they are of; used in messages.
    options : {str: str}
        As they were written.

    Examples
    --------
    >>> query = Query.of("stack.tif?spacing=0.5,0.5,2&channel=1")
    >>> query.path.name, query.spacing_mm, query.index("channel", 3, "channels")
    ('stack.tif', (0.5, 0.5, 2.0), 1)
    """

    path: Path
    options: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str) -> Query:
        """Split a name at its question mark; one that is there as a whole has no options.

        Raises
        ------
        VolumeError
            If there is no path, or an option is given twice.
        """
        path, _, query = text.partition("?")
        if query and Path(text).exists():
            return cls(Path(text))
        if not path:
            raise VolumeError(
                "volume: the name is empty; give a file or a folder, as . for this one"
            )
        options: dict[str, str] = {}
        for key, value in parse_qsl(query, keep_blank_values=True):
            if key in options:
                raise VolumeError(f"{path}: {key}= is given twice; give it once")
            options[key] = value
        return cls(Path(path), options)

    @property
    def name(self) -> str:
        """The path's last part, for an example of a query in a message."""
        return self.path.name or str(self.path)

    def allow(self, *known: str) -> None:
        """Refuse options other than these.

        Raises
        ------
        VolumeError
        """
        if unknown := sorted(set(self.options) - set(known)):
            raise VolumeError(
                f"{self.path}: unknown option {unknown[0]!r}; known are {', '.join(known)}"
            )

    @property
    def spacing_mm(self) -> tuple[float, float, float] | None:
        """``spacing=x,y,z`` in millimetres; None where it is left out.

        Raises
        ------
        VolumeError
            If it is not three numbers; whether they are positive, the volume checks.
        """
        given = self.options.get("spacing")
        if given is None:
            return None
        try:
            x, y, z = (float(number) for number in given.split(","))
        except ValueError as error:
            raise VolumeError(
                f"{self.path}: spacing={given} cannot be read; write millimetres along x, y, z "
                f"as in {self.name}?spacing=0.65,0.65,2"
            ) from error
        return x, y, z

    def index(self, key: str, count: int, what: str) -> int:
        """Which of several is meant: ``channel=N``, ``time=N``, counted from 0.

        Parameters
        ----------
        key : str
        count : int
            How many there are; of one it need not be said.
        what : str
            What they are, in the plural.

        Raises
        ------
        VolumeError
            If it is left out, or not one of them.
        """
        given = self.options.get(key)
        if given is None and count == 1:
            return 0
        if count == 1 and given != "0":
            raise VolumeError(f"{self.path}: {key}={given}, but there is one only; leave it out")
        if given is None or not given.isdecimal() or int(given) >= count:
            wrong = "" if given is None else f" and {key}={given} is none of them"
            raise VolumeError(
                f"{self.path}: holds {count} {what}{wrong}, a volume is one; choose it as "
                f"{self.name}?{key}=0 … {count - 1}"
            )
        return int(given)


def tell(messages: Sequence[str]) -> None:
    """Warn the caller of `load_volume`; a reader that it calls does so itself, at its end."""
    for message in messages:
        warnings.warn(message, VolspecWarning, stacklevel=4)
