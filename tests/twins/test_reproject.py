"""The reprojection kernel against its NumPy twin."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import METAL_BASIS, METALS
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.layers import OpacityLayers
from volspec.image.reproject import Reprojector, Warp, reproject_reference
from volspec.relight.stereo import ShiftedCamera

# Measured 2e-6, but for points so close to the border of a slice of depth that float32 puts them
# into the next one.
TOLERANCE, MOVED = 2e-5, 0.005
SIZE = 40, 30
HERE = Camera((3.0, -100.0, 20.0), (0.0, 0.0, 0.0))


def layered(
    camera: Camera, groups: int = 1, layers: int = 4, solid: bool = False
) -> CoefficientImage:
    """An image of random layers around the camera's target, some of them unused.

    If ``solid``, the last layer is of surfaces, also behind unused ones.
    """
    rng = np.random.default_rng(3)
    shape = SIZE[1], SIZE[0], layers
    depth = camera.distance_mm + np.sort(rng.uniform(-20, 20, shape), axis=2)
    used = np.arange(layers) < rng.integers(0, layers + 1, shape[:2])[..., None]
    used[..., -1] |= solid & (depth[..., -1] > camera.distance_mm + 5)
    arrays = (
        rng.uniform(0, 1, (*shape, 2)) * used[..., None],
        rng.uniform(0.2, 1, (*shape, groups, 2)),
        rng.uniform(0, 0.2, (*shape, groups)),
        np.where(used, depth, np.inf),
    )
    layers = OpacityLayers(*(each.astype(np.float32) for each in arrays), solid=solid)
    flat, zero = np.zeros((*shape[:2], 3 * groups), "f4"), np.zeros(shape[:2], "f4")
    names = {f"light {n}": 1 / groups for n in range(groups)}
    own = {"groups": names, "camera": camera, "opacity_layers": layers}
    return CoefficientImage(flat, zero, zero, METAL_BASIS, **own)


PARALLEL = replace(HERE, height_mm=60.0)
TURNED = replace(HERE, position_mm=(12.0, -97.0, 26.0))
NEARER = replace(HERE, position_mm=(1.0, -60.0, 10.0))


@pytest.mark.parametrize(
    ("source", "target", "size", "groups"),
    [
        (HERE, TURNED, SIZE, 1),
        (HERE, replace(TURNED, height_mm=50.0), (20, 16), 1),
        (PARALLEL, replace(TURNED, height_mm=60.0), SIZE, 1),
        (HERE, ShiftedCamera(TURNED.position_mm, TURNED.target_mm, shift=0.1), SIZE, 1),
        # Magnified, and rows of two float8.
        slow(HERE, NEARER, (64, 48), 2),
        slow(PARALLEL, TURNED, SIZE, 3),
    ],
    ids=["turned", "to parallel", "parallel", "shifted", "nearer", "from parallel"],
)
@pytest.mark.parametrize(
    ("scales", "solid"), [((0.0, 3.0), False), slow((1, 1), False), slow((0, 3), True)]
)
def test_the_kernel_splats_what_its_twin_does(source, target, size, groups, scales, solid):
    image = layered(source, groups, solid=solid)
    ours = Reprojector(image).view(target, dict(zip(METALS, scales, strict=True)), size)
    warp = Warp.of(source, SIZE, target, size)
    true = reproject_reference(image.opacity_layers, list(scales), warp)
    assert true.alpha.max() > 0.3
    off = np.abs(ours.coefficients - true.coefficients).max(axis=2)
    off = np.maximum(off, np.abs(ours.alpha - true.alpha))
    assert np.mean(off > TOLERANCE) < MOVED
    assert np.abs(ours.alpha - true.alpha).max() < TOLERANCE
    seen = true.alpha > 0.01
    assert np.median(np.abs(ours.depth_mm[seen] - true.depth_mm[seen])) < 1e-3
    assert np.array_equal(np.isinf(ours.depth_mm), true.alpha < 1e-9)


def test_tiles_of_gpus_and_of_cpus_make_the_same_picture(monkeypatch):
    reprojector = Reprojector(layered(HERE))
    long = reprojector.view(TURNED)
    monkeypatch.setattr(Reprojector, "_tile", lambda self, warp: (16, 16))
    square = reprojector.view(TURNED)
    assert np.array_equal(long.coefficients, square.coefficients)
    assert np.array_equal(long.alpha, square.alpha)


@pytest.mark.parametrize("parts", [3, *slow_each(1, 16)])
def test_the_same_view_is_the_recomposed_picture(parts):
    image = layered(HERE)
    same = Reprojector(image, parts=parts).view(HERE, {"gold": 0.5})
    true = image.opacity_layers.recompose([1.0, 0.5])
    assert np.abs(same.coefficients - true.channels.reshape(same.coefficients.shape)).max() < 1e-4
    assert np.abs(same.alpha - true.alpha).max() < 1e-4
