"""Cast an array of your own: a gyroid with walls of two colours.

You should see 09-gyroid.png: a labyrinth of walls, red on one side and blue on the other.
"""

import numpy as np

import volspec as vs

x, y, z = np.meshgrid(*3 * [np.linspace(-2.5 * np.pi, 2.5 * np.pi, 96)], indexing="ij")
values = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
volume = vs.Volume.of(values.astype(np.float32))
materials = {name: vs.reflectance_from_colour(name) for name in ("firebrick", "steelblue")}
points = [
    (-0.4, 0.0, "firebrick"),
    (-0.2, 0.8, "firebrick"),
    (0.0, 0.0, "firebrick"),
    (0.2, 0.8, "steelblue"),
    (0.4, 0.0, "steelblue"),
]
transfer = vs.TransferFunction(points, materials, vs.SpectralBasis.load("general-7"))
image = vs.raycast(volume, transfer, vs.Camera.orbit(volume), size=(320, 320))
vs.write_frame("09-gyroid.png", vs.relight(image, vs.light("D65")))
