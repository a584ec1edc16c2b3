"""The views of a page: a scene cast from its camera, or from a circle of cameras.

scene -> [views] -> page
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volspec.export.page.build import PageView
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera
from volspec.raycast.bands import Progress
from volspec.scene import Scene

MOST_VIEWS = 360


def scene_views(
    scene: Scene,
    count: int = 1,
    *,
    size: tuple[int, int] | None = None,
    device: str | None = None,
    progress: Progress | None = None,
) -> Iterator[PageView]:
    """Cast a scene from all around.

    Parameters
    ----------
    scene : Scene
    count : int
        Cameras on a circle around the scene's ``up``, the scene's own the first.
    size : (width, height), optional
        In place of the scene's.
    device : str, optional
        Part of an OpenCL device's name.
    progress : callable, optional
        Called with the finished share, 0…1.

    Yields
    ------
    PageView
    """
    volume = scene.volume()
    caster = Raycaster(volume, device=device)
    camera = scene.camera(volume)
    pixels = size or (scene.file.output.width, scene.file.output.height)
    for i in range(count):
        turned = turned_camera(camera, scene.file.camera.up, 360.0 * i / count)
        image = raycast(
            *(volume, scene.transfer, turned, pixels, scene.raycast),
            caster=caster,
            progress=None if progress is None else _part(progress, i, count),
        )
        yield PageView(image, 360.0 * i / count)


def _part(progress: Progress, i: int, count: int) -> Progress:
    """The progress of one view of several."""
    return lambda share: progress((i + share) / count)


def turned_camera(camera: Camera, axis: tuple[float, float, float], degrees: float) -> Camera:
    """A camera carried around its target, counter-clockwise seen from the axis' end.

    >>> camera = Camera((0, -2, 1), (0, 0, 1))
    >>> [round(x) for x in turned_camera(camera, (0, 0, 1), 90).position_mm]
    [2, 0, 1]
    """
    if degrees == 0:
        return camera
    from scipy.spatial.transform import Rotation

    unit = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    turn = Rotation.from_rotvec(math.radians(degrees) * unit)
    target = np.asarray(camera.target_mm)
    place = target + turn.apply(np.asarray(camera.position_mm) - target)
    return replace(camera, position_mm=tuple(place), up=tuple(turn.apply(camera.up)))
