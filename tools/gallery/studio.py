"""Parts shared by all pictures of the gallery: volumes, lamps, casting and showing."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import volspec as vs
from benchmarks.scenes import ROOT, chest, chest_organs, stored
from tools.gallery.synthetic import cells, tracer
from volspec.pipeline import Raycaster

Picture = NDArray[np.uint8]
SIZE = (1600, 1200)  # cast; a picture has half of it
SHARED = ("BASIS", "KEY", "FILL", "SKY", "STUDIO", "materials", "cast", "show")  # printed

BASIS = vs.SpectralBasis.load("general-7")
KEY = vs.LightGroup("key", (vs.Directional((-1, 1.2, 1), frame="camera", shadows=True),))
FILL = vs.LightGroup("fill", (vs.Directional((1.5, 0.2, 1), frame="camera", intensity=0.3),))
SKY = vs.LightGroup("sky", (vs.Ambient(occlusion=True),))
STUDIO = vs.RaycastSpec(groups=(KEY, FILL, SKY), ambient=0.35, specular=0.25, jitter=1)


def materials(**names: str) -> dict[str, vs.Spectrum]:
    """Reflectances of the library."""
    return {key: vs.reflectance(name) for key, name in names.items()}


@dataclass(slots=True)
class Clock:
    """Seconds of the casts since it was last read."""

    casts: list[float] = field(default_factory=list)
    device: str = ""

    def read(self) -> list[float]:
        """Return the seconds, and start again."""
        seconds, self.casts = self.casts, []
        return seconds


CLOCK = Clock()


def cast(
    volume: vs.Volume,
    transfer: Any,
    camera: vs.Camera,
    spec: vs.RaycastSpec = STUDIO,
    size: tuple[int, int] | None = None,
    meshes: Sequence[vs.MeshCaster] = (),
) -> vs.CoefficientImage:
    """Cast and note the time: of march and lamps, the volume being on the device already."""
    caster = Raycaster(volume)
    # Compiles the kernel, which is kept from then on.
    small = (32, 24)
    vs.raycast(volume, transfer, camera, small, spec, caster=Raycaster(volume), behind=meshes)
    start = time.perf_counter()
    shown = size or SIZE
    image = vs.raycast(volume, transfer, camera, shown, spec, caster=caster, behind=meshes)
    CLOCK.casts.append(time.perf_counter() - start)
    CLOCK.device = caster.device
    return image


def show(
    image: vs.CoefficientImage,
    light: vs.Spectrum | vs.LightRig | str = "D65",
    exposure: float = 1.1,
    backdrop: float = 0.008,
) -> Picture:
    """Relight, and take the mean of two by two pixels."""
    light = vs.light(light) if isinstance(light, str) else light
    spec = vs.RelightSpec(vs.Viewing(exposure=exposure), backdrop=backdrop)
    return halved(vs.relight(image, light, spec, np.float32))


def halved(codes: NDArray[Any]) -> Picture:
    """Mean of two by two pixels of sRGB, 0…1: of light, not of codes."""
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    height, width, _ = linear.shape
    mean = linear.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    coded = np.where(mean <= 0.0031308, mean * 12.92, 1.055 * mean ** (1 / 2.4) - 0.055)
    return (coded * 255).round().astype(np.uint8)


def engine_scene() -> vs.Scene:
    """The demo's scene, with its metameric pair."""
    return vs.Scene.load(ROOT / "data" / "scenes" / "engine.toml")


def _frog() -> vs.Volume:
    import pyvista

    return vs.load_volume(Path(pyvista.__file__).parent / "examples" / "frog_tissues.vti")


READERS: dict[str, Callable[[], vs.Volume]] = {
    "engine": lambda: vs.load_volume(ROOT / "data" / "engine.nrrd"),
    "frog": _frog,
    "chest": chest,
    "organs": chest_organs,
    "cells": cells,
    "tracer": tracer,
    **{name: stored(name) for name in ("foot", "aneurism", "mrbrain")},
}


@dataclass(frozen=True, slots=True)
class Feature:
    """A section of the page.

    Parameters
    ----------
    title : str
    make : callable
        Takes the volumes that its arguments name; gives {label: picture}.
    """

    title: str
    make: Callable[..., dict[str, Picture]]

    @property
    def name(self) -> str:
        """Name in file names and ``--only``."""
        return self.make.__name__.replace("_", "-")

    @property
    def volumes(self) -> tuple[str, ...]:
        """Names in `READERS`."""
        return tuple(inspect.signature(self.make).parameters)
