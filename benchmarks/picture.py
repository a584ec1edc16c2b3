"""Is the picture the same as VTK's? Grey materials, shaded, against the fixed-point mapper.

Compares linear greys over black, without sRGB: our channel under flat white with VTK's picture.
Settings are matched where possible: ambient and diffuse weights, no highlight (VTK uses one view
direction for all pixels), no fade at small gradients, and the end of rays. Compared twice: as a
user sees it, and without two differences, the direction of the headlight (parallel rays) and VTK's
stretch of the picture by 1/511 on the screen (our field of view is reduced equally).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.cast import SIZE
from benchmarks.measure import Figure
from benchmarks.scenes import BenchScene, bench_scene
from benchmarks.vtk_peer import ALPHA_STOP, fixed_point
from volspec.camera import Camera
from volspec.export import write_frame
from volspec.pipeline import Raycaster
from volspec.raycast import RaycastSpec
from volspec.transfer import TransferTable

GREY = 0.8
ASKED_DB = 32
FOLDER = Path("build")
SPEC = RaycastSpec(ambient=0.3, diffuse=0.7, flat_gradient=0, alpha_stop=ALPHA_STOP)


def psnr(ours: ArrayLike, peer: ArrayLike) -> float:
    """Return the peak signal-to-noise ratio of two pictures in 0…1, dB.

    >>> round(psnr([0.0, 1.0], [0.1, 0.9]), 6)
    20.0
    """
    error = np.mean((np.asarray(ours, np.float64) - np.asarray(peer, np.float64)) ** 2)
    return float(-10 * np.log10(error)) if error else math.inf


def grey_table(scene: BenchScene) -> TransferTable:
    """Return a table with the scene's opacities, one grey and one channel."""
    table = scene.transfer.bake(min(scene.volume.spacing_mm))
    grey = np.full((len(table.opacity), 1), GREY)
    return TransferTable(table.domain, table.opacity, grey, table.reference_step_mm)


def parallel(camera: Camera) -> Camera:
    """Return the camera with parallel rays and the same view size at its target."""
    distance = np.linalg.norm(np.subtract(camera.target_mm, camera.position_mm))
    return replace(
        camera, height_mm=float(2 * distance * math.tan(math.radians(camera.fov_deg) / 2))
    )


def pictures(
    scene: BenchScene, ours: Camera, peers: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return linear greys of both sides, (H, W) each."""
    table = grey_table(scene)
    grey = [(value, opacity, (GREY,) * 3) for value, opacity, _ in scene.transfer.points]
    peer = fixed_point(scene.volume, grey, table.reference_step_mm, peers, SIZE, SPEC)
    peer.draw()
    channels = Raycaster(scene.volume).cast(table, ours, SIZE, SPEC)[0]
    return channels[..., 0].astype(np.float64), peer.picture()[..., 1] / 255


def figures() -> Iterator[Figure]:
    """Yield PSNR of engine and foot; write pictures and four times |difference| to ``build/``."""
    for name in ("engine", "foot"):
        try:
            scene = bench_scene(name)
        except FileNotFoundError as error:
            yield Figure(f"picture/{name}", None, ASKED_DB, unit="dB", note=str(error))
            continue
        straight = parallel(scene.camera)
        stretched = replace(straight, height_mm=straight.height_mm * (1 - 1 / SIZE[1]))
        for label, ours, peers in (
            ("", scene.camera, scene.camera),
            ("/matched", stretched, straight),
        ):
            pair = pictures(scene, ours, peers)
            row = np.concatenate([*pair, 4 * np.abs(pair[0] - pair[1])], axis=1)
            grey = (np.clip(row, 0, 1) * 255).round().astype(np.uint8)
            FOLDER.mkdir(exist_ok=True)
            write_frame(
                FOLDER / f"picture-{name}{label.replace('/', '-')}.png",
                np.repeat(grey[..., None], 3, axis=2),
            )
            asked = None if label else ASKED_DB
            yield Figure(f"picture/{name}{label}", psnr(*pair), asked, unit="dB")
