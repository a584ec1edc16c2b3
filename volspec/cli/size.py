"""A picture's size as options take it: WIDTHxHEIGHT."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter


def sides(size: str) -> tuple[int, int]:
    """WIDTHxHEIGHT as numbers.

    Raises
    ------
    ValueError
        If it is something else, or a side is 0.

    Examples
    --------
    >>> sides("1024x768")
    (1024, 768)
    """
    width, by, height = size.lower().partition("x")
    if not (by and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise ValueError(f"{size!r} is no WIDTHxHEIGHT, such as 1024x768")
    return int(width), int(height)


def _require_size(_: Any, size: str | None) -> None:
    """A cyclopts validator."""
    if size is not None:
        sides(size)


Sized = Parameter(validator=_require_size, allow_leading_hyphen=True)
"""Of an option that is such a size."""
Size = Annotated[str | None, Sized]
"""The option, where it may be left out."""
