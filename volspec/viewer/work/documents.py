"""Scenes and volumes opened, and the device that casts them.

    path -> [documents] -> Document

A device's own threads give way to the window's, where both want the same cores.
"""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from volspec.errors import OpenCLError, VolspecWarning, one_line
from volspec.pipeline import Raycaster
from volspec.scene import Scene
from volspec.spectra import reflectance_names
from volspec.viewer.model.camera import View
from volspec.viewer.model.camera_edits import fitted
from volspec.viewer.model.document import Document, demo, plain_scene
from volspec.viewer.model.paths import check_name
from volspec.volume import Volume, load_volume

T = TypeVar("T")

# Of 19: a cast gets a tenth of a core that the window wants, too.
_NICE = 10


def opened(path: str | None, device: str | None = None) -> Document:
    """Open a scene file, or a volume with a scene made for it; None is the bundled demo.

    Raises
    ------
    VolspecError
        If it cannot be read, or the device that is named cannot cast.
    """
    view = None
    if path is not None:
        check_name(path)
    if path is None:
        scene = Scene.load(demo())
        volume = scene.volume()
    elif path.lower().endswith(".toml"):
        scene = Scene.load(path)
        volume = scene.volume()
    else:
        volume = load_volume(path)
        scene = Scene(plain_scene(path, volume), path.partition("?")[0])
        # No window is known yet: a square that has the picture's height.
        view = fitted(View(), volume, scene.transfer, scene.raycast, 1.0)
    # Presets take their materials from it, when somebody waits for them.
    threading.Thread(target=reflectance_names, daemon=True).start()
    caster, fault = make_caster(volume, device)
    return Document.of(scene, volume, caster, view, fault)


def make_caster(volume: Volume, device: str | None) -> tuple[Raycaster | None, str]:
    """Make what casts a volume; or None, and why this machine cannot.

    Raises
    ------
    OpenCLError
        If the device that is named cannot.
    """
    try:
        return yielding(lambda: Raycaster(volume, device=device)), ""
    except OpenCLError as error:
        if device is not None:
            raise
        warnings.warn(one_line(error), VolspecWarning, stacklevel=2)
        return None, one_line(error)


def yielding(make: Callable[[], T]) -> T:
    """What a function makes, whose own threads, which outlive it, give way.

    Linux gives a thread the priority of the one that starts it; elsewhere nothing changes.

    >>> yielding(lambda: 6 * 7)
    42
    """
    with ThreadPoolExecutor(1, "volspec-yielding", initializer=_give_way) as pool:
        return pool.submit(make).result()


def _give_way() -> None:
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
