"""Whether a scene would load and its lights be shown, and all that is wrong where not.

TOML -> [checking] -> volspec scene check
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from volspec.errors import SceneError
from volspec.relight import RelightSpec
from volspec.scene.file import SceneFile
from volspec.scene.lights import NamedLight
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
    """Look up all that a scene names, its volume too, without casting it.

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


def require_lux(
    lights: Iterable[NamedLight], seen: RelightSpec, path: str | os.PathLike[str]
) -> None:
    """Refuse, before the cast, lights that cannot be held against each other.

    A scene of such lights loads: it can be cast, and be seen at the other level.

    Parameters
    ----------
    lights : iterable of NamedLight
        Those that will shine.
    seen : RelightSpec
    path : path
        The scene's, for the message.

    Raises
    ------
    SceneError
        If the level is absolute, and one of them has no lux.
    """
    if seen.level != "absolute":
        return
    for light in lights:
        if light.rig.illuminance_lux is None:
            raise SceneError(
                f"{os.fspath(path)}: [[light]] {light.name}: has no illuminance_lux, which "
                '[viewing] level = "absolute" asks of all lights; give it, or level = "relative"'
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
