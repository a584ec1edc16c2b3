"""The views of a page: a scene cast from its camera, or from a circle of cameras.

scene -> [views] -> page
"""

from __future__ import annotations

from collections.abc import Iterator

from volspec.export.moved import turned
from volspec.export.page.build import PageView
from volspec.pipeline import Raycaster, raycast
from volspec.raycast.bands import Progress
from volspec.scene import Scene
from volspec.scene.export import TurntableTable

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
    pixels = size or (scene.file.output.width, scene.file.output.height)
    for i, camera in enumerate(turned(scene, volume, TurntableTable(frames=count))):
        image = raycast(
            *(volume, scene.transfer, camera, pixels, scene.raycast),
            caster=caster,
            progress=None if progress is None else _part(progress, i, count),
        )
        yield PageView(image, 360.0 * i / count)


def _part(progress: Progress, i: int, count: int) -> Progress:
    """The progress of one view of several."""
    return lambda share: progress((i + share) / count)
