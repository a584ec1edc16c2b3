"""Whether a scene would load, be shown and be exported, and all that is wrong where not.

TOML -> [checking] -> volspec scene check
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from volspec.errors import SceneError
from volspec.export.keyed import keyframe_faults
from volspec.export.plan import plan_export
from volspec.scene.file import SceneFile
from volspec.scene.lux import require_lux
from volspec.scene.model import Scene
from volspec.scene.reading import SceneFaults, scene_data, scene_file
from volspec.scene.resolve import Resolver


@dataclass(frozen=True, slots=True)
class Checked:
    """What there is in a scene, or what is wrong with it.

    Parameters
    ----------
    path : str
    errors : tuple of str
        A line each: file, field, value, remedy. Empty where the scene loads and can be shown.
    materials, lights : int
        How many; settings of lights, not rows.
    volume : (width, height, depth), optional
        Voxels.
    basis : str
        Its name.
    reason : str
        Why the scene is cast with it.
    """

    path: str
    errors: tuple[str, ...] = ()
    materials: int = 0
    lights: int = 0
    volume: tuple[int, int, int] | None = None
    basis: str = ""
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"path": self.path, "ok": not self.errors, **asdict(self)}


def check_scene(path: str | os.PathLike[str]) -> Checked:
    """Look up all that a scene names, its volume too, and plan its export, without casting it.

    Where several things are wrong, all are told that can be: of a file whose tables are wrong
    nothing is looked up.
    """
    name = os.fspath(path)
    try:
        file = scene_file(scene_data(path), path)
    except SceneFaults as error:
        return Checked(name, tuple(error.lines))
    except SceneError as error:
        return Checked(name, (str(error),))
    errors = _lost(file, Path(path))
    scene, volume = None, None
    try:
        volume = Resolver(file, Path(path)).volume()
    except SceneError as error:
        errors.append(str(error))
    if volume is not None and not errors:
        try:
            scene = Scene(file, path)
            scene.camera(volume)
            require_lux(scene.lights, scene.relight, path)
            errors += keyframe_faults(scene, volume)
            if not errors:
                plan_export(scene, volume, scene.file.export)
        except SceneError as error:
            errors.append(str(error))
    if scene is None or volume is None or errors:
        return Checked(name, tuple(errors))
    return Checked(
        name,
        materials=len(scene.materials),
        lights=len(scene.lights),
        volume=volume.shape_xyz,
        basis=scene.basis.name,
        reason=scene.basis_reason,
    )


def _lost(file: SceneFile, path: Path) -> list[str]:
    """Names that lead nowhere, and numbers out of range, row by row."""
    errors: list[str] = []
    names = Resolver(file, path, faults=errors)
    grid = names.grid(names.shipped_basis())
    names.reflectances("reflectance", grid)
    names.reflectances("filter", grid)
    names.lights(grid, names.raycast())
    names.viewing()
    return errors
