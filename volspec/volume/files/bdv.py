"""BigDataViewer's projects: an ``.xml`` file that names its HDF5 or N5, and sizes of voxels.

    project.xml -> [bdv] -> hdf5, n5

References
----------
[1] BigDataViewer, https://imagej.net/plugins/bdv: a setup is a channel, an angle or a tile.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from volspec.errors import VolumeError

# Most projects in a folder, and bytes of one, that are searched for a file's.
_MOST_PROJECTS, _MOST_BYTES = 32, 1 << 26


@dataclass(frozen=True, slots=True)
class Project:
    """Data of a project, and names and voxels of its setups by their numbers."""

    data: Path
    names: dict[int, str]
    sizes: dict[int, tuple[list[float], str]]  # along x, y, z, and their unit


def read_project(path: Path) -> Project | None:
    """Return a project; None if the file is none."""
    root: Any = None
    with suppress(OSError, ElementTree.ParseError):
        root = ElementTree.parse(path).getroot() if path.stat().st_size < _MOST_BYTES else None
    loader = None if root is None else root.find("SequenceDescription/ImageLoader")
    if loader is None:
        return None
    named = loader.findtext("hdf5") or loader.findtext("n5") or ""
    data = path.parent / (root.findtext("BasePath") or ".").strip() / named.strip()
    project = Project(data, {}, {})
    for setup in root.iter("ViewSetup"):
        with suppress(ValueError):
            number = int(setup.findtext("id", ""))
            project.names[number] = setup.findtext("name", "").strip()
            size = [float(text) for text in setup.findtext("voxelSize/size", "").split()]
            if len(size) == 3 and min(size) > 0:
                project.sizes[number] = size, setup.findtext("voxelSize/unit", "").strip()
    return project


def project_of(data: Path) -> Project | None:
    """Return the project next to a file or folder that names it; None if there is none."""
    same = data.with_suffix(".xml")
    others = sorted(islice(data.parent.glob("*.xml"), _MOST_PROJECTS))
    for path in (same, *others):
        project = read_project(path) if path.is_file() else None
        if project is not None and project.data.resolve() == data.resolve():
            return project
    return None


def data_of(path: Path) -> Path:
    """Return the HDF5 or N5 of a project; refuse what is none, or has none."""
    project = read_project(path)
    if project is None or project.data.suffix.lower() not in (".h5", ".hdf5", ".n5"):
        raise VolumeError(
            f"{path}: is no BigDataViewer project with an HDF5 or N5",
            "give the volume's own file, or save the project's as HDF5 in Fiji (BigStitcher, "
            "Resave as HDF5)",
            code="unsupported",
        )
    if not project.data.exists():
        raise VolumeError(
            f"{path}: its voxels are in {project.data}, which is not there",
            f"copy it into {project.data.parent}",
            code="not-found",
        )
    return project.data
