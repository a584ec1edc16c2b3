"""Weak points of a ray loop: leaps, faces, units, extreme values."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.errors import raises
from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import FLAT, METAL_BASIS, METALS, metal_function, ramp, turned
from tests.twins.test_raycast import TOLERANCE
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source, asset
from volspec.camera import Camera
from volspec.errors import OpenCLError
from volspec.large import Raycaster
from volspec.pipeline import raycast
from volspec.raycast import Ambient, Directional, LightGroup, RaycastSpec, reference
from volspec.raycast.gpu import TILES
from volspec.raycast.launch import light_volume
from volspec.raycast.launch.kernel_arguments import CAST
from volspec.transfer import (
    FieldFunctions,
    Isosurfaces,
    Mask,
    Region,
    TransferFunction2D,
    TransferTable,
)
from volspec.volume import Volume, phantom

# A curve that sees single voxels.
SPARSE = ramp(0.8, channels=1, entries=1024)
# Both sides of brick borders (bricks are 4 voxels), the first and the last index.
BORDERS = st.sampled_from([0, 1, 7, 8, 9, 15, 16, 17, 23, 24, 31, 32])


@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    voxels=st.lists(st.tuples(BORDERS, BORDERS, BORDERS), min_size=1, max_size=3),
    view=st.tuples(st.integers(0, 360), st.integers(-90, 90)),
    orthographic=st.booleans(),
)
def test_no_visible_voxel_is_leapt_over(voxels, view, orthographic):
    """The reference takes every step, the kernel leaps; single voxels at brick borders agree.

    A leap may drop what lies within float32 rounding of a border, where a lone voxel's opacity
    starts from 0: 1e-3 of full scale bounds it, measured 2e-4.
    """
    values = np.zeros((33, 33, 33), np.float32)
    values[tuple(np.transpose(voxels))] = 1
    volume = Volume(values)
    camera = turned(volume, *view, zoom=1.6, orthographic=orthographic)
    ours = Raycaster(volume).cast(SPARSE, camera, (28, 28), FLAT)
    true = reference.cast(volume, SPARSE, camera, (28, 28), FLAT)
    assert np.abs(ours[1] - true[1]).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e-12, 1e12, 1e-3, 1e6])
def test_the_picture_does_not_depend_on_the_unit_of_length(unit):
    volume, table = phantom.ball(20), ramp(0.3)
    scaled = Volume(volume.values, spacing_mm=(unit,) * 3)
    there = dataclasses.replace(table, reference_step_mm=unit)
    one, other = (
        Raycaster(v).cast(t, Camera.orbit(v), (32, 32), RaycastSpec(specular=0.3))
        for v, t in ((volume, table), (scaled, there))
    )
    for a, b in zip(one[:2], other[:2], strict=True):
        assert np.abs(a - b).max() < TOLERANCE
    seen = one.alpha > 0.01
    assert np.allclose(one.depth_mm[seen] * unit, other.depth_mm[seen], rtol=1e-4)


SUN = LightGroup("sun", (Directional((1, 1, 1), shadows=True), Ambient(occlusion=True)))
SETTINGS: dict[str, dict[str, Any]] = {
    "curve": {},
    "surfaces": {},
    "fields": {},
    "gradients": {},
    "regions": {},
    "shadows": {"groups": SUN},
    "preintegrated": {"preintegrated": True},
    "maximum": {"mode": "maximum"},
    "average": {"mode": "average"},
}


def in_units(kind: str, value: float, mm: float) -> np.ndarray:
    """Return the coefficients of a body with missing voxels, in units of values and of length."""
    body = phantom.ball(20).values * np.float32(value)
    body[:3] = np.nan
    lattice = {"spacing_mm": (mm, 1.5 * mm, mm)}
    other = Volume(np.roll(phantom.ball(20).values * np.float32(value), 5), **lattice, name="b")
    volume = Volume(body, **lattice, fields=[other] if kind == "fields" else [])
    looks = (0.1, 0.0, "gold"), (0.4, 0.1, "gold"), (0.4, 0.5, "copper"), (0.9, 0.9, "copper")
    rows = [(value * at, *look) for at, *look in looks]
    curve, steep = metal_function(*rows, reference_step_mm=mm), 0.1 * value / mm
    region = Region((0.2 * value, 0.8 * value), (0.1 * steep, np.inf), 0.6, "gold")
    masked = {"": Mask("b", {(rows[1][0], value): None})}
    transfer = {
        "gradients": dataclasses.replace(curve, gradient_opacity=[(0.2 * steep, 0), (steep, 1)]),
        "regions": TransferFunction2D([region], METALS, METAL_BASIS, mm),
        "surfaces": Isosurfaces([rows[1], rows[3]], METALS, METAL_BASIS),
        "fields": FieldFunctions({"": curve, "b": curve}, masks=masked),
    }.get(kind, curve)
    spec = RaycastSpec(specular=0.3, step_mm=mm / 2, **SETTINGS[kind])
    return raycast(volume, transfer, Camera.orbit(volume), (24, 24), spec).coefficients


@pytest.mark.filterwarnings("ignore:.*NaN")
@pytest.mark.parametrize("power", [-133, 126, slow(-79)])
@pytest.mark.parametrize("kind", [*list(SETTINGS)[:3], *slow_each(*list(SETTINGS)[3:])])
def test_the_picture_does_not_depend_on_the_units_of_values_and_length(kind, power):
    """Also where float32 has no reciprocals, no sums, and few digits: 16 of 2^-133."""
    truth, found = in_units(kind, 1.0, 1.0), in_units(kind, 2.0**power, 2.0 ** (power // 4))
    assert truth.max() > 0.05 and np.abs(truth - found).max() < TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_voxels_beyond_2_gi_are_cast(dtype):
    """A ball in the last corner of 1300³ voxels looks as it does alone."""
    size = 1300
    ball = (200 * phantom.ball(40).values).astype(dtype)
    corner = size - len(ball)
    values = np.zeros((size,) * 3, dtype)  # pages that are not written take no memory
    largest = Compute.open().info.max_allocation_bytes
    if values.nbytes > largest:
        pytest.skip(f"the device's largest buffer has {largest} bytes of {values.nbytes}")
    values[corner:, corner:, corner:] = ball
    whole, alone = Volume(values), Volume(ball)
    moved = whole.world_from_index @ (corner, corner, corner, 1) - alone.world_from_index[:, 3]
    table = dataclasses.replace(ramp(0.3), domain=(0.0, 200.0))
    near, spec = Camera.orbit(alone), RaycastSpec(specular=0.3)
    position, target = (tuple(at + moved[:3]) for at in (near.position_mm, near.target_mm))
    far = dataclasses.replace(near, position_mm=position, target_mm=target)
    a = Raycaster(alone).cast(table, near, (48, 48), spec)
    b = Raycaster(whole).cast(table, far, (48, 48), spec)
    assert a.alpha.max() > 0.9
    assert np.abs(a.alpha - b.alpha).max() < 5e-4 and np.abs(a[0] - b[0]).max() < 5e-4


@pytest.mark.parametrize("specular", [0.0, 0.3])
@pytest.mark.parametrize("offset", [1e4, 1e6, -1e6])
def test_values_far_from_0_keep_their_digits(offset, specular):
    """Floats in steps of 1/16 around an offset, of a range of 1, are as the reference has them."""
    values = np.rint(16 * phantom.ball(20).values) / 16
    volume = Volume((values + offset).astype(np.float32))
    table = dataclasses.replace(ramp(0.3), domain=(offset + 0.05, offset + 1.0))
    given = table, Camera.orbit(volume), (32, 32), RaycastSpec(specular=specular)
    found, truth = Raycaster(volume).cast(*given), reference.cast(volume, *given)
    for a, b in zip(found[:2], truth[:2], strict=True):
        assert np.abs(a - b).max() < TOLERANCE


def test_structs_are_as_large_for_the_compiler_as_for_numpy():
    structs = {struct.name: struct for struct in (CAST, *light_volume.STRUCTS)}
    sizes = "".join(f"x[{n}] = sizeof({name}); " for n, name in enumerate(structs))
    text = "".join(struct.declaration for struct in structs.values())
    text += f"__kernel void f(__global int *x) {{ {sizes}}}"
    compute, found = Compute.open(), np.zeros(len(structs), np.int32)
    buffer = compute.output(found.nbytes)
    kernel = compute.kernel(Source(text, ("<prelude>", "f.cl")), "f")
    compute.download(buffer, found, kernel(compute.queue, (1,), None, buffer))
    assert found.tolist() == [struct.dtype.itemsize for struct in structs.values()]


def test_lanes_are_numbered_row_by_row_in_their_tile():
    """`TILES` and LANE_X, LANE_Y of lanes.clh say the same."""
    text = Path(asset("kernels/include/lanes.clh")).read_text(encoding="utf-8")
    for lanes, (width, height) in TILES.items():
        assert width * height == lanes
        if lanes > 1:
            y, x = np.divmod(np.arange(lanes), width)
            for axis, numbers in (("X", x), ("Y", y)):
                assert f"LANE_{axis} ((float{lanes})({', '.join(map(str, numbers))}))" in text


ONE = Source("__kernel void f(__global int *x) { x[0] = 1; }\n", ("<prelude>", "f.cl"))


def test_an_empty_program_names_the_cache_it_came_from():
    """A compiler that was killed leaves one there, and PoCL uses it."""
    with raises(OpenCLError, "damaged"):
        Compute.open().kernel(ONE, "raycast")


def test_a_cached_program_of_another_cpu_is_built_again(monkeypatch):
    """Intel's runtime calls it an invalid binary, and pyopencl then asks for a variable."""

    def build(*args: object, **settings: object) -> None:
        raise RuntimeError("clBuildProgram failed: INVALID_BINARY")

    monkeypatch.delenv("PYOPENCL_CACHE_FAILURE_FATAL", raising=False)
    monkeypatch.setattr("pyopencl.characterize.has_src_build_cache", lambda device: False)
    monkeypatch.setattr("pyopencl.cache._create_built_program_from_source_cached", build)
    assert Compute.open().kernel(ONE, "f").function_name == "f"


RANGES = {"int16": (-32768, 32767), "uint16": (0, 65535)}


def worst(volume: Volume, spec: RaycastSpec, lanes: int) -> float:
    """Greatest difference of kernel and reference over the greatest coefficient."""
    at = np.linspace(0.0, 1.0, 256)
    colours = np.stack([0.1 + 0.8 * at, 0.8 - 0.5 * at], 1)
    table = TransferTable(volume.range, np.full(256, 0.2), colours, 1.0)
    given = table, Camera.orbit(volume), (40, 40), spec
    ours = Raycaster(volume, lanes=lanes).cast(*given).coefficients
    truth = reference.cast(volume, *given)[0]
    return float(np.abs(ours - truth).max() / truth.max())


@pytest.mark.parametrize("dtype", RANGES)
@pytest.mark.parametrize("flat", [0.0, 1e-4, 0.02])
@pytest.mark.parametrize("lanes", [slow(1), 8])
def test_stripes_of_two_byte_voxels_have_no_gradient_across(dtype, flat, lanes):
    """Their gradients are made of whole numbers: rounded weights alone made .3 of what is seen."""
    values = np.full((12, 12, 12), RANGES[dtype][0] // 2, dtype)
    values[:, :, ::2] = RANGES[dtype][1] // 2
    spec = RaycastSpec(specular=0.5, flat_gradient=flat)
    assert worst(Volume(values), spec, lanes) < 5e-5


@pytest.mark.slow
@pytest.mark.parametrize("dtype", RANGES)
@pytest.mark.parametrize("shininess", [24, 63, 64, 1024])
def test_noise_of_the_whole_range_is_as_glossy(dtype, shininess):
    for seed in range(3):
        low, high = RANGES[dtype]
        values = np.random.default_rng(seed).integers(low, high, (3, 5, 7), dtype, endpoint=True)
        assert worst(Volume(values), RaycastSpec(specular=1.0, shininess=shininess), 8) < 2e-4
