"""Names of spectra that lead to files, as they read from another folder.

lights, files -> [moved] -> palettes and scenes written elsewhere
"""

from __future__ import annotations

import os
from pathlib import Path

from volspec.spectra.files import split_address
from volspec.spectra.lights import light_terms


def moved_light(text: str, folder: Path, to: Path) -> str:
    """A light's name, mixes too, as it reads from another folder.

    Parameters
    ----------
    text : str
        As `volspec.light` takes it.
    folder, to : path
        What relative names in it start from, and shall start from.

    Raises
    ------
    SpectrumError
        If a part of a mix is unknown.
    """
    terms = light_terms(text, folder)
    names = [moved_address(name, folder, to) for name, _ in terms]
    if names == [name for name, _ in terms]:
        return text
    return "+".join(
        name if weight == 1.0 else f"{name}*{weight!r}"
        for name, (_, weight) in zip(names, terms, strict=True)
    )


def moved_address(text: str, folder: Path, to: Path) -> str:
    """``FILE#selector`` as it reads from another folder; other names as they are."""
    if (address := split_address(text)) is None:
        return text
    return moved_file(address[0], folder, to) + text[len(address[0]) :]


def moved_file(file: str, folder: Path, to: Path) -> str:
    """A file's name as it reads from another folder; absolute ones stay."""
    if os.path.isabs(file):
        return file
    # Of a folder behind a link, `..` is what stands above the folder, not above the link.
    return Path(os.path.relpath(folder.resolve() / file, to.resolve())).as_posix()
