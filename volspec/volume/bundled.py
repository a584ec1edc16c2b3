"""Volumes that are always there, by name: they ship with volspec or with a package it needs.

name -> [bundled] -> file
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

from volspec._files import is_remote
from volspec._gpu import asset

_ASSETS = {"engine": "data/engine.nrrd", "head": "data/mrbrain.nrrd"}
# Labels of the tissues of the Whole Frog Project.
_OF_PYVISTA = {"frog": "examples/frog_tissues.vti"}


def bundled_volume(name: str) -> Path | None:
    """Return the file of a bundled volume; None if there is none of that name.

    >>> bundled_volume("engine").name, bundled_volume("engine.nrrd")
    ('engine.nrrd', None)
    """
    if name in _ASSETS:
        return asset(_ASSETS[name])
    if name not in _OF_PYVISTA:
        return None
    # Not imported: that takes a second.
    package = find_spec("pyvista")
    folders = package.submodule_search_locations if package else None
    path = Path(next(iter(folders or [""]))) / _OF_PYVISTA[name]
    return path if path.is_file() else None


def is_bundled(path: Path) -> bool:
    """Return True for the file of a bundled volume."""
    return path in [bundled_volume(name) for name in (*_ASSETS, *_OF_PYVISTA)]


def locate_volume(address: str, folder: str | os.PathLike[str] = "") -> str:
    """Return where a volume's address leads, given relative to a folder.

    The name of a bundled volume leads to its file, unless the folder has a file of that name.

    >>> Path(locate_volume("head")).name, locate_volume("ct.nrrd?spacing=1,1,2", "data")
    ('mrbrain.nrrd', 'data/ct.nrrd?spacing=1,1,2')
    """
    if is_remote(address):
        return address
    name, mark, options = address.partition("?")
    bundled = bundled_volume(name)
    if bundled is None or Path(folder, name).exists():
        return os.path.join(folder, address)
    return f"{bundled}{mark}{options}"
