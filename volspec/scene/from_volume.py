"""Scene for a volume or a mesh alone: labels or a preset, lights and a framed camera.

Volume, preset -> [from_volume] -> SceneFile
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import is_remote
from volspec.camera import Orbit, radius_mm, slice_view
from volspec.errors import SceneError, VolspecWarning
from volspec.raycast import framing
from volspec.scene.file import SceneFile
from volspec.scene.tables.specs import BasisSpec, CameraSpec
from volspec.scene.tables.transfer import TransferSpec
from volspec.settings import plain, read_table
from volspec.spectra import DEFAULT_GRID
from volspec.spectra.library import rebase_light, sent_names
from volspec.transfer import (
    OWN,
    FieldFunctions,
    Transfers,
    channel_functions,
    label_function,
    presets,
)
from volspec.volume import Volume
from volspec.volume.files import Query

if TYPE_CHECKING:
    from volspec.mesh import Mesh

# Spectra and labels of the default lights by name. The LEDs are as white as daylight, and change
# colours more: the engine's by CIEDE2000 14, mean of all presets, A and FL2 by 4, HP1 by 7.
LIGHTS = {
    "D65": ("D65", "daylight"),
    "A": ("A", "tungsten lamp"),
    "FL2": ("FL2", "cool fluorescent"),
    "HP1": ("HP1", "sodium lamp"),
    "LEDs yellow": (
        "led:430*0.0109+led:510*0.0829+led:570*0.906",
        "white of violet, green and yellow LEDs",
    ),
    "LEDs red": (
        "led:470*0.0674+led:510*0.645+led:670*0.288",
        "white of blue, green and deep red LEDs",
    ),
}
# Significant digits of fitted numbers.
_DIGITS = 5


def volume_file(
    address: str,
    steps: Sequence[Volume],
    preset: presets.Preset | None,
    lights: Sequence[str] = (),
    camera: Orbit | None = None,
) -> SceneFile:
    """Return a scene's file for a volume, relative to the volume's folder.

    Parameters
    ----------
    address : str
        Path of the volume, with its details after a question mark.
    steps : sequence of Volume
        The voxels; of a series all time steps.
    preset : presets.Preset, optional
        Materials and transfer function; default: the volume's labels, or its fields.
    lights : sequence of str, optional
        In `volspec.light`'s notation, with files relative to the current folder; default: daylight,
        tungsten, fluorescent, sodium, and two whites of LEDs.
    camera : Orbit, optional
        Direction, field of view and projection; default: the default of scenes, or straight at a
        single slice.
    """
    transfer: Transfers
    volume = steps[0]
    if preset is None and not volume.labels and volume.fields:
        transfer, materials = channel_functions(steps, DEFAULT_GRID)
    elif preset is None:
        transfer, materials = label_function(volume, DEFAULT_GRID)
    else:
        transfer = presets.fit_preset(preset, volume, presets.histogram_of(steps), DEFAULT_GRID)
        materials = preset.materials
    path = volume_path(address)
    details = address.partition("?")[2] if address != str(Query.of(address).path) else ""
    file = address.partition("?")[0] if is_remote(address) else path.name
    tables: dict[str, Any] = {
        "volume": {"file": file + ("?" + details if details else "")},
    }
    if assumed := volume.metadata.assumed:
        tables["volume"]["assumed"] = list(assumed)
    if isinstance(transfer, FieldFunctions):
        specs = {name: TransferSpec.of(function) for name, function in transfer.functions.items()}
        tables["transfer"] = plain(specs.pop(OWN))
        tables["field"] = [{"name": n, "transfer": plain(spec)} for n, spec in specs.items()]
    else:
        tables["transfer"] = plain(TransferSpec.of(transfer))
    # On the voxel steps of labels, highlights are noise.
    camera = camera or slice_view(volume)
    return _new_file(tables, path, materials, 0.3 if preset else 0.0, lights, camera)


def mesh_file(path: Path, lights: Sequence[str] = (), camera: Orbit | None = None) -> SceneFile:
    """Return a scene's file for a mesh alone, in its own colours, or else of copper.

    Parameters are those of `volume_file`.
    """
    row: dict[str, Any] = {"file": path.name, "material": "copper", "own_colours": True}
    if path.suffix.lower() in (".gltf", ".glb"):  # in metres, and y is up
        row |= {"unit_mm": 1000.0, "turn_deg": (90.0, 0.0, 0.0)}
    tables = {"mesh": [row]}
    return _new_file(tables, path, {"copper": "copper"}, 0.3, lights, camera)


def of_own_colours(file: SceneFile, surfaces: Sequence[Mesh]) -> SceneFile:
    """Return the file with a basis for its meshes' colours, or, with a warning, of copper."""
    if all(mesh.materials for mesh in surfaces):
        text = "has no colours, and is shown as copper; change that in the [[material]] of"
        name = file.mesh[0].name
        warnings.warn(f"{name}: {text} `volspec scene new {name}`", VolspecWarning, stacklevel=3)
        return replace(file, mesh=tuple(replace(row, own_colours=False) for row in file.mesh))
    return replace(file, basis=BasisSpec())


def _new_file(
    tables: Mapping[str, Any],
    path: Path,
    materials: Mapping[str, str],
    specular: float,
    lights: Sequence[str],
    camera: Orbit | None,
) -> SceneFile:
    """Return a file with ``tables``, titled as the file that it is for."""
    # Files of lights are relative to the current folder, the scene's paths to that file's.
    spectra = {
        name: (rebase_light(text, Path.cwd(), path.parent), "")
        for name, text in zip(sent_names(lights), lights, strict=True)
    }
    rows = spectra or LIGHTS
    document: dict[str, Any] = {
        "title": path.name,
        **tables,
        "material": [{"name": k, "reflectance": v} for k, v in materials.items()],
        # Exact under any light: no fitted basis holds the lines of LEDs.
        "basis": {"method": "materials"},
        "raycast": {"ambient": 0.2, "diffuse": 0.8, "specular": specular, "jitter": 1.0},
        "light": [
            {"name": name, "spectrum": spectrum} | ({"label": label} if label else {})
            for name, (spectrum, label) in rows.items()
        ],
        "camera": plain(CameraSpec(**asdict(camera))) if camera else {},
        "viewing": {"backdrop": 0.05},
    }
    return read_table(SceneFile, document, SceneError)


def fit_frame(file: SceneFile, volume: Volume, points_mm: NDArray[np.float64]) -> SceneFile:
    """Return the file with its orbit framing points (N, 3) in a square."""
    fitted: CameraSpec = framing.fit_points(file.camera, volume, points_mm, 1.0)
    digits = _DIGITS - 1 - math.floor(math.log10(radius_mm(volume)))
    x, y, z = (round(coordinate, digits) for coordinate in fitted.target_mm or ())
    zoom = float(f"{fitted.zoom:.{_DIGITS}g}")
    return replace(file, camera=replace(fitted, zoom=zoom, target_mm=(x, y, z)))


def volume_path(address: str) -> Path:
    """Return the absolute path of a volume's address, without its details.

    That of a URL is in the current folder.
    """
    path = Query.of(address).path
    return Path(os.path.abspath(path.name if is_remote(address) else path))
