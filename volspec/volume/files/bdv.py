"""BigDataViewer's projects: an ``.xml`` file that names its HDF5 or N5, and sizes of voxels.

    project.xml -> [bdv] -> hdf5, n5

References
----------
[1] BigDataViewer, https://imagej.net/plugins/bdv: a setup is a channel, an angle or a tile.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from volspec._confine import is_inside, require_links_inside
from volspec._parse import parse_xml
from volspec.errors import VolumeError
from volspec.volume.files.query import Query

# Most projects in a folder, and bytes of one, that are searched for a file's.
_MAX_PROJECTS, _MAX_BYTES = 32, 1 << 26
Size = tuple[tuple[float, float, float], str]
"""Lengths of a voxel along x, y, z, and their unit."""


@dataclass(frozen=True, slots=True)
class Project:
    """Data of a project, and names and voxels of its setups by their numbers."""

    data: Path
    names: dict[int, str] = field(default_factory=dict)
    sizes: dict[int, Size] = field(default_factory=dict)


def _read(path: Path) -> Project | None:
    """Return a project; None if the file is none."""
    root: Any = None
    with suppress(OSError, ValueError):
        root = parse_xml(path.read_bytes()) if path.stat().st_size < _MAX_BYTES else None
    loader = None if root is None else root.find("SequenceDescription/ImageLoader")
    if loader is None:
        return None
    named = loader.findtext("hdf5") or loader.findtext("n5") or ""
    project = Project(path.parent / (root.findtext("BasePath") or ".").strip() / named.strip())
    for setup in root.iter("ViewSetup"):
        with suppress(ValueError):
            number = int(setup.findtext("id", ""))
            project.names[number] = setup.findtext("name", "").strip()
            x, y, z = (float(text) for text in setup.findtext("voxelSize/size", "").split())
            if all(0 < length < math.inf for length in (x, y, z)):
                unit = setup.findtext("voxelSize/unit", "").strip()
                project.sizes[number] = (x, y, z), unit
    return project


def choose_view(query: Query, views: Mapping[tuple[str, str], str]) -> tuple[str, Size | None]:
    """Return the array of the setup and time that the query selects, and its voxels' size.

    ``views`` are the arrays by setup and time; sizes are those of the project that names the data.
    """
    data, project = query.path, Project(query.path)
    projects = sorted(islice(data.parent.glob("*.xml"), _MAX_PROJECTS))
    for path in (data.with_suffix(".xml"), *projects):
        candidate = _read(path) if path.is_file() and is_inside(path) else None
        if candidate is not None and candidate.data.resolve() == data.resolve():
            project = candidate
            break
    setups, times = (sorted({view[k] for view in views}, key=int) for k in (0, 1))
    names = [project.names.get(int(setup), "") for setup in setups]
    time = times[query.index("time", len(times), "time steps")]
    setup = setups[query.index("channel", len(setups), "channels (setups)", names)]
    query.end_choices()
    if (setup, time) not in views:
        raise VolumeError(
            f"{data}: has no voxels of setup {setup} at time {time}; choose others",
            code="not-found",
        )
    return views[setup, time], project.sizes.get(int(setup))


def data_of(path: Path) -> Path:
    """Return the HDF5 or N5 of a project; refuse what is none, or has none."""
    project = _read(path)
    if project is None or project.data.suffix.lower() not in (".h5", ".hdf5", ".n5"):
        raise VolumeError(
            f"{path}: is no BigDataViewer project with an HDF5 or N5",
            "give the volume's own file, or save the project's as HDF5 in Fiji (BigStitcher, "
            "Resave as HDF5)",
            code="unsupported",
        )
    require_links_inside(project.data, VolumeError)
    if not project.data.exists():
        raise VolumeError(
            f"{path}: its voxels are in {project.data}, which is not there",
            f"copy it into {project.data.parent}",
            code="not-found",
        )
    return project.data
