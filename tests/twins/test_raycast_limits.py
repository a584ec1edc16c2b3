"""Where a ray loop goes wrong: leaps, faces, units, extreme values."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.errors import raises
from tests.twins.test_raycast import TOLERANCE, assert_alike
from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import Struct
from volspec._gpu.sources import Source, asset
from volspec.errors import OpenCLError
from volspec.raycast import Camera, RaycastSpec, light_volume, reference
from volspec.raycast.gpu import Raycaster
from volspec.raycast.packed import CAST
from volspec.transfer import TransferTable
from volspec.volume import Volume, phantom

# Alpha without shading, and a curve that sees single voxels.
FLAT = RaycastSpec(ambient=1, diffuse=0)
SPARSE = TransferTable((0.0, 1.0), np.linspace(0, 0.8, 1024), np.ones((1024, 1)), 1.0)


def sparse_volume(voxels: list[tuple[int, int, int]], size: int = 33) -> Volume:
    values = np.zeros((size, size, size), np.float32)
    for voxel in voxels:
        values[voxel] = 1
    return Volume(values)


# Both sides of brick borders (bricks are 4 voxels), the first and the last index.
BORDERS = st.sampled_from([0, 1, 7, 8, 9, 15, 16, 17, 23, 24, 31, 32])


@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    voxels=st.lists(st.tuples(BORDERS, BORDERS, BORDERS), min_size=1, max_size=3),
    view=st.tuples(st.integers(0, 360), st.integers(-90, 90)),
    orthographic=st.booleans(),
)
def test_no_visible_voxel_is_leapt_over(
    voxels: list[tuple[int, int, int]], view: tuple[int, int], orthographic: bool
) -> None:
    """The reference takes every step, the kernel leaps; single voxels at brick borders agree.

    A leap may drop what lies within float32 rounding of a border, where a lone voxel's opacity
    starts from 0: 1e-3 of full scale bounds it, measured 2e-4.
    """
    volume = sparse_volume(voxels)
    camera = Camera.orbit(
        volume, azimuth_deg=view[0], elevation_deg=view[1], zoom=1.6, orthographic=orthographic
    )
    ours = Raycaster(volume).cast(SPARSE, camera, (40, 40), FLAT)
    true = reference.cast(volume, SPARSE, camera, (40, 40), FLAT)
    assert np.abs(ours[1] - true[1]).max() < 1e-3


@pytest.mark.parametrize("lanes", [1, 8])
def test_rays_that_lie_in_a_face_see_it(lanes: int) -> None:
    """Parallel rays along the faces' planes: 0/0 in the clipping, inside by definition."""
    volume = Volume(np.ones((9, 9, 9), np.float32))
    camera = Camera((4, 4, 100), (4, 4, 4), up=(0, 1, 0), height_mm=9)
    table = TransferTable((0.0, 2.0), np.full(64, 0.3), np.ones((64, 1)), 1.0)
    ours = Raycaster(volume, lanes=lanes).cast(table, camera, (9, 9), FLAT)
    assert ours[1].min() > 0.9, "the border ring is culled"
    assert_alike(volume, table, camera, FLAT, size=(9, 9), lanes=lanes)


@pytest.mark.parametrize("unit", [1e-12, 1e-3, 1e6, 1e12])
def test_the_picture_does_not_depend_on_the_unit_of_length(unit: float) -> None:
    volume = phantom.ball(20)
    table = TransferTable((0.0, 1.0), np.linspace(0, 0.3, 256), np.ones((256, 2)), 1.0)
    scaled = Volume(volume.values, spacing_mm=(unit,) * 3)
    there = dataclasses.replace(table, reference_step_mm=unit)
    pictures = [
        Raycaster(v).cast(t, Camera.orbit(v), (32, 32), RaycastSpec(specular=0.3))
        for v, t in ((volume, table), (scaled, there))
    ]
    for a, b in zip(pictures[0][:2], pictures[1][:2], strict=True):
        assert np.abs(a - b).max() < TOLERANCE
    seen = pictures[0][1] > 0.01
    assert np.allclose(pictures[0][2][seen] * unit, pictures[1][2][seen], rtol=1e-4)


@pytest.mark.parametrize("unit", [1e-30, 1e-12, 1e12, 1e30])
def test_the_picture_does_not_depend_on_the_unit_of_the_values(unit: float) -> None:
    volume = phantom.ball(20)
    table = TransferTable((0.0, 1.0), np.linspace(0, 0.3, 256), np.ones((256, 2)), 1.0)
    scaled = Volume((volume.values * unit).astype(np.float32))
    there = dataclasses.replace(table, domain=(0.0, unit))
    camera, spec = Camera.orbit(volume), RaycastSpec(specular=0.3)
    a, b = (Raycaster(v).cast(t, camera, (32, 32), spec)[0] for v, t in
            ((volume, table), (scaled, there)))  # fmt: skip
    assert np.isfinite(b).all() and np.abs(a - b).max() < TOLERANCE


def test_faint_media_keep_their_opacity_and_depth() -> None:
    """Under flat white light the channels of a white medium are its alpha, however faint."""
    volume = phantom.slab(16, 16)
    table = TransferTable((0.0, 2.0), np.full(64, 1e-8), np.ones((64, 1)), 1.0)
    colour, alpha, depth, _ = Raycaster(volume).cast(table, Camera.orbit(volume), (16, 16), FLAT)
    assert alpha[8, 8] > 0 and np.isfinite(depth[8, 8])
    assert np.allclose(colour[..., 0], alpha, rtol=1e-5)


def test_a_constant_volume_casts_without_a_gradient() -> None:
    volume = Volume(np.full((5, 5, 5), 3.0, np.float32))
    table = TransferTable((0.0, 4.0), np.full(64, 0.2), np.ones((64, 2)), 1.0)
    assert_alike(volume, table, Camera.orbit(volume), RaycastSpec(specular=0.5), size=(16, 16))


@pytest.mark.parametrize("struct", [CAST, *light_volume.STRUCTS], ids=lambda each: each.name)
def test_structs_are_as_large_for_the_compiler_as_for_numpy(struct: Struct) -> None:
    compute = Compute.open()
    text = f"{struct.declaration}__kernel void f(__global int *x) {{ *x = sizeof({struct.name}); }}"
    found, buffer = np.zeros(1, np.int32), compute.output(4)
    kernel = compute.kernel(Source(text, ("<prelude>", "f.cl")), "f")
    compute.download(buffer, found, kernel(compute.queue, (1,), None, buffer))
    assert found == struct.dtype.itemsize


def test_lanes_are_numbered_row_by_row_in_their_tile() -> None:
    """`TILES` and LANE_X, LANE_Y of lanes.clh say the same."""
    from volspec.raycast.gpu import TILES

    text = Path(asset("kernels/include/lanes.clh")).read_text(encoding="utf-8")
    for lanes, (width, height) in TILES.items():
        assert width * height == lanes
        if lanes > 1:
            x = ", ".join(str(i % width) for i in range(lanes))
            y = ", ".join(str(i // width) for i in range(lanes))
            assert f"LANE_X ((float{lanes})({x}))" in text
            assert f"LANE_Y ((float{lanes})({y}))" in text


def test_an_empty_program_names_the_cache_it_came_from() -> None:
    """A compiler that was killed leaves one there, and PoCL uses it."""
    source = Source("__kernel void f(__global int *x) { x[0] = 1; }\n", ("<prelude>", "f.cl"))
    with raises(OpenCLError, "damaged"):
        Compute.open().kernel(source, "raycast")


def test_a_cached_program_of_another_cpu_is_built_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Intel's runtime refuses it as an invalid binary, and pyopencl then asks for a variable."""

    def refuse(*args: object, **settings: object) -> None:
        raise RuntimeError("clBuildProgram failed: INVALID_BINARY")

    monkeypatch.delenv("PYOPENCL_CACHE_FAILURE_FATAL", raising=False)
    monkeypatch.setattr("pyopencl.characterize.has_src_build_cache", lambda device: False)
    monkeypatch.setattr("pyopencl.cache._create_built_program_from_source_cached", refuse)
    source = Source("__kernel void f(__global int *x) { x[0] = 1; }\n", ("<prelude>", "f.cl"))
    assert Compute.open().kernel(source, "f").function_name == "f"
