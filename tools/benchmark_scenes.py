"""Draw the five benchmark scenes under daylight: ``python -m tools.benchmark_scenes``.

Writes ``docs/images/benchmarks.png``: unshaded above, shaded below.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from benchmarks.measure import PAGE
from benchmarks.scenes import SPECS, BenchScene, bench_scenes
from volspec.pipeline import Raycaster, raycast, relight
from volspec.relight import RelightSpec
from volspec.spectra import light

TILE = (240, 240)


def sheet() -> np.ndarray:
    """Return the sheet, with a column per scene and a row per shading."""
    daylight, columns = light("D65"), []
    for scene in bench_scenes():
        if not isinstance(scene, BenchScene):
            raise FileNotFoundError(f"{scene[0]}: {scene[1]}")
        caster = Raycaster(scene.volume)
        casts = [
            raycast(scene.volume, scene.transfer, scene.camera, TILE, spec, caster=caster)
            for spec in SPECS.values()
        ]
        columns.append(
            np.concatenate([relight(c, daylight, RelightSpec(backdrop=0.05)) for c in casts])
        )
    return np.concatenate(columns, axis=1)


if __name__ == "__main__":
    # A palette of 256 colours keeps the repository small.
    picture = Image.fromarray(sheet()).quantize(256, dither=Image.Dither.NONE)
    picture.save(PAGE.parent / "images" / "benchmarks.png", optimize=True)
