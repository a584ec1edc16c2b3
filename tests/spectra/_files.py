"""Files of spectra that several tests write."""

from pathlib import Path

from tests.support.errors import raises
from volspec.errors import SpectrumError, VolspecError


def saved(folder: Path, name: str, text: str | bytes) -> str:
    """Write a file; return its path."""
    path = folder / name
    if isinstance(text, str):
        text = text.encode("latin-1" if "ü" in text else "utf-8")
    path.write_bytes(text)
    return str(path)


def constant(level: object, start: int = 380, stop: int = 780, step: int = 10) -> str:
    """Return a table with one level at every 10 nm."""
    return "".join(f"{w},{level}\n" for w in range(start, stop + 1, step))


def fails(make, folder: Path, fault: str, error: type[VolspecError] = SpectrumError) -> None:
    """Assert that a call with a folder raises an error of "code", or of "code field"."""
    code, _, field = fault.partition(" ")
    with raises(error, code, field or None):
        make(folder)
