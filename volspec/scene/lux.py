"""Whether lights say how bright they are, where the level asks for it.

lights, [viewing] -> [lux] -> plan, pages
"""

from __future__ import annotations

import os
from collections.abc import Iterable

from volspec.errors import SceneError
from volspec.relight import RelightSpec
from volspec.scene.lights import NamedLight


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
