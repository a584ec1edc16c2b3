"""Memory is released: lights, pictures, casts and scenes no longer in use take none.

Counted are the blocks of Python's allocator, which depend neither on the machine nor on what else
it does; `make trust` holds resident memory to the same (``benchmarks/drift.py``).
"""

import gc
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import volspec as vs
from tests.support.images import image
from volspec._gpu.opencl import MAX_KERNELS
from volspec._gpu.sources import asset
from volspec.image import CoefficientImage
from volspec.pipeline import Raycaster, raycast
from volspec.relight import LightRig, Relighter, RelightSpec
from volspec.scene import Scene


@pytest.fixture(scope="module")
def grey() -> CoefficientImage:
    return image(np.full((6, 5, 7), 0.5), vs.SpectralBasis.load("general-7"))


def blocks_left_by(call: Callable[[int], object], calls: int) -> float:
    """Return the blocks that a call with a number of its own leaves behind.

    The least of four series, after one to warm up: what happens once is no leak.
    """
    blocks = []
    for number in range(5 * calls):
        if number % calls == 0:
            gc.collect()
            blocks.append(sys.getallocatedblocks())
        call(number)
    gc.collect()
    blocks.append(sys.getallocatedblocks())
    return min(later - before for before, later in pairwise(blocks[1:])) / calls


@pytest.mark.slow
def test_other_lights_and_viewings_take_no_memory(grey, backend):
    first = {"gl": 2000, "numpy": 2005}[backend]

    def change(number: int) -> None:
        lamp, sky = vs.light(f"planck:{first + 10 * number}"), f"daylight:{3000 + first + number}"
        rig = LightRig((lamp, vs.light(sky)), (1.0, 0.1 + number))
        viewing = vs.Viewing(illuminance_lux=100.0 + number, exposure=1.0 + number / 1000)
        relighter.frame(rig, RelightSpec(viewing, backdrop=number / 1000))

    with Relighter(grey, backend) as relighter:
        # A cache takes a key, an entry and an array for each, or more.
        assert blocks_left_by(change, 20) < 2


@pytest.mark.slow
@pytest.mark.parametrize("end", [Relighter.close, lambda _: gc.collect()])
def test_relighters_that_were_closed_or_collected_take_no_memory(grey, backend, end):
    # A context that is made for each leaves 900 blocks in moderngl 5.13.
    assert blocks_left_by(lambda _: end(Relighter(grey, backend)), 4) < 100


@pytest.mark.slow
def test_casts_with_other_functions_and_views_take_no_memory(half_engine):
    caster = Raycaster(half_engine)
    basis, copper = vs.SpectralBasis.load("general-7"), {"copper": vs.reflectance("copper")}
    transfer = vs.TransferFunction([(60, 0.0, "copper"), (200, 0.3, "copper")], copper, basis)

    def cast(number: int) -> None:
        paler = replace(transfer, points=[(60, 0.0, "copper"), (200 - number / 3, 0.2, "copper")])
        camera = vs.Camera.orbit(half_engine, azimuth_deg=float(number))
        spec = vs.RaycastSpec(step_mm=1.0, alpha_stop=1.0 - number / 1000)
        raycast(half_engine, paler, camera, (16, 16), spec, caster=caster)

    # NumPy's and pyopencl's own lists take sixty casts to fill.
    assert blocks_left_by(cast, 60) < 5
    assert len(caster._compute._kernels) < MAX_KERNELS
    # The bricks' codes, the empty light volume's buffer, and on GPUs a copy of the voxels.
    assert len(caster._compute._allocated) == (2 if caster._compute.info.is_cpu else 3)


@pytest.mark.slow
def test_scenes_that_were_loaded_cast_and_relit_take_no_memory():
    def load(number: int) -> None:
        scene = Scene.load(asset("data/scenes/engine.toml"))
        volume = scene.volume()
        small = scene.render(volume, size=(16, 16), caster=Raycaster(volume))
        with Relighter(small) as relighter:
            relighter.frame(vs.light(f"planck:{3000 + number}"))

    # Of PoCL's build log and pyopencl's about 40.
    assert blocks_left_by(load, 1) < 200
