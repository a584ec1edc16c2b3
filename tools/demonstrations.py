"""Draw the thumbnails of the viewer's demonstrations: a strip of one scene's lights each.

data/scenes -> Scene -> [demonstrations] -> data/demonstrations/*.jpg

``python -m tools.demonstrations`` makes them again.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from volspec._gpu.sources import asset
from volspec.pipeline import Relighter
from volspec.scene import Scene
from volspec.viewer.work.demonstrations import DEMONSTRATIONS

# Of one frame; the cast is larger by the second number.
_SIZE, _LARGER = (384, 288), 2


def main() -> None:
    """Draw all strips."""
    for demonstration in DEMONSTRATIONS:
        scene = Scene.load(demonstration.path)
        image = scene.render(size=(_SIZE[0] * _LARGER, _SIZE[1] * _LARGER))
        lights = {light.name: light.rig for light in scene.lights}
        with Relighter(image) as relighter:
            frames = [relighter.frame(lights[name], scene.relight) for name in demonstration.lights]
        small = [np.asarray(Image.fromarray(frame).resize(_SIZE)) for frame in frames]
        path = asset(demonstration.thumbnail)
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(np.hstack(small)).save(path, quality=88)
        print(path)


if __name__ == "__main__":
    main()
