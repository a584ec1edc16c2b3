"""Compare spectral bases with the exact answer under a sodium lamp.

You should see a mean ΔE of 1.8 with three channels, 0.2 with five and 0 with seven, and 04-*.png
that look alike. The materials themselves as channels are exact.
"""

import numpy as np

import volspec as vs
from volspec.appearance.display import colour_space
from volspec.appearance.models.cielab import cielab, delta_E_2000

space, sodium = colour_space("sRGB"), vs.light("HP1")


def frame_Lab(name: str, scene: vs.Scene) -> np.ndarray:
    frame = vs.relight(scene.render(size=(192, 192)), sodium, scene.relight)
    vs.write_frame(f"04-{name}.png", frame)
    return cielab(space.decode(frame / 255.0) @ space.XYZ_from_RGB.T, space.white_XYZ)


path = "data/scenes/engine.toml"
exact = frame_Lab("exact", vs.Scene.load(path, {"method": "materials"}))
for size in (3, 5, 7):
    found = frame_Lab(f"{size}", vs.Scene.load(path, {"size": size}))
    error = delta_E_2000(exact, found)
    print(f"{size} channels: mean ΔE {error.mean():.2f}, largest {error.max():.2f}")
