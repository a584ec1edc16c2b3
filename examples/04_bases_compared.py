"""Compare spectral bases with the exact answer under a sodium lamp.

You should see a mean ΔE of 1.6 with three channels, 0.2 with five and 0 with seven if light and
surface are multiplied channel by channel (with a warning that three are few), and nearly 0 with any
if a matrix is fitted to the lamp, as by default: it holds fewer materials than channels. The
pictures 04-*.png look alike. The materials themselves as channels are exact.
"""

from dataclasses import replace

import numpy as np

import volspec as vs
from volspec.appearance.display.monitors import colour_space
from volspec.appearance.models.lab import cielab, delta_E_2000

space, sodium = colour_space("sRGB"), vs.light("HP1")


def frame_Lab(name: str, image: vs.CoefficientImage, spec: vs.RelightSpec) -> np.ndarray:
    frame = vs.relight(image, sodium, spec)
    vs.write_frame(f"04-{name}.png", frame)
    return cielab(space.decode(frame / 255.0) @ space.XYZ_from_RGB.T, space.white_XYZ)


def cast(**basis: object) -> vs.CoefficientImage:
    made = vs.Scene.load("data/scenes/engine.toml", basis)
    # All in the same step, which is otherwise chosen for each picture.
    return made.render(size=(192, 192), spec=replace(made.raycast, step_mm=0.5))


scene = vs.Scene.load("data/scenes/engine.toml")
exact = frame_Lab("exact", cast(method="materials"), scene.relight)
images = {n: cast(size=n) for n in (3, 5, 7)}
for mode in ("componentwise", "fitted"):
    for size, image in images.items():
        found = frame_Lab(f"{mode}-{size}", image, replace(scene.relight, mode=mode))
        error = delta_E_2000(exact, found)
        print(f"{size} channels, {mode}: mean ΔE {error.mean():.2f}, largest {error.max():.2f}")
