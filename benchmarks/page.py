"""Write what scripts measured into ``docs/benchmarks.md``, between two marker comments."""

from __future__ import annotations

from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks.md"


def between(text: str, name: str) -> str:
    """What stands between the markers of a name.

    >>> between("a <!-- t -->b<!-- /t --> c", "t")
    'b'
    """
    start, end = _markers(name)
    if text.count(start) != 1 or text.count(end) != 1:
        raise ValueError(f"the page needs one {start} and one {end}")
    return text.split(start)[1].split(end)[0]


def replaced(text: str, name: str, content: str) -> str:
    """The text with other content between the markers."""
    start, end = _markers(name)
    return text.replace(start + between(text, name) + end, start + content + end)


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->", f"<!-- /{name} -->"
