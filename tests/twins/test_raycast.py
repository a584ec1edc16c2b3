"""The raycast kernel against its float64 reference, pixel by pixel."""

import dataclasses

import numpy as np
import pytest

from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import FLAT, fog, oblique_world
from volspec.camera import Camera
from volspec.large import Raycaster
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.row_batches import Result
from volspec.transfer import SurfaceTable, TransferTable
from volspec.volume import Volume, load_volume, phantom

# Full scale is 1. Positions carry float32 rounding of a few 1e-5 voxels, and the steepest edge
# of these transfer functions turns that into some 2e-5 of opacity; measured 2e-5.
TOLERANCE = 1e-4


def assert_alike(
    volume: Volume,
    table: TransferTable | SurfaceTable,
    camera: Camera,
    spec: RaycastSpec,
    size: tuple[int, int] = (40, 40),
    grazing: int = 0,
    tolerance: float = TOLERANCE,
    plateaus: bool = False,
    **settings: int,
) -> Result:
    """Compare every pixel but the ``grazing`` worst; the message shows the worst of the rest.

    With ``plateaus`` the greatest value may lie in several places: depths are not compared.
    """
    ours = Raycaster(volume, **settings).cast(table, camera, size, spec)
    true = reference.cast(volume, table, camera, size, spec)
    assert true[1].max() > 0.05, "the camera misses the volume: nothing is compared"
    missed = np.abs(ours[0] - true[0]).max(axis=2) > tolerance
    alike = ~missed if missed.sum() <= grazing else np.ones_like(missed)
    for name, a, b in zip(("coefficients", "alpha"), ours, true, strict=False):
        off = np.abs(a - b).reshape(*alike.shape, -1).max(axis=2)
        off[~alike] = 0
        worst = np.unravel_index(off.argmax(), off.shape)
        assert np.isfinite(a).all()
        assert off.max() < tolerance, f"{name}{worst}: kernel {a[worst]}, reference {b[worst]}"
    seen = (true[1] > 0.01) & alike
    assert plateaus or np.allclose(ours[2][seen], true[2][seen], atol=2e-2)
    return ours


def two_channels(values: list[float], opacity: list[float]) -> TransferTable:
    """Opacity of some values, and colours that change from the first to the last."""
    at = np.linspace(values[0], values[-1], 1024)
    weights = np.stack([np.linspace(0.1, 0.9, 1024), np.linspace(0.8, 0.3, 1024)], axis=1)
    return TransferTable((at[0], at[-1]), np.interp(at, values, opacity), weights, 1.0)


@pytest.mark.parametrize("lanes", [1, *slow_each(4, 8)])
def test_engine_matches_reference_at_every_packet_width(
    engine, engine_table, three_channels, lanes
):
    """One ray has its channels in vectors of eight."""
    table, spec = engine_table if lanes == 1 else three_channels, RaycastSpec(specular=0.3)
    assert_alike(engine, table, Camera.orbit(engine), spec, lanes=lanes)


# Axis views have rays parallel to faces, whose clipping divides 0 by 0.
VIEWS = [{"azimuth_deg": 90, "elevation_deg": 0}, {"orthographic": True, "zoom": 1.5}]
MORE_VIEWS = [{"azimuth_deg": 0, "elevation_deg": e} for e in (0, 90)]
MORE_VIEWS += [{"azimuth_deg": a, "elevation_deg": e} for a, e in ((200, 60), (77, -35))]


@pytest.mark.parametrize("view", [*VIEWS, *slow_each(*MORE_VIEWS)], ids=str)
def test_engine_matches_reference_from_every_side(engine, three_channels, view):
    assert_alike(engine, three_channels, Camera.orbit(engine, **view), RaycastSpec())


def test_flat_pictures_and_those_from_inside_the_volume_match_reference(engine, three_channels):
    assert_alike(engine, three_channels, Camera.orbit(engine), FLAT)
    inside = Camera((130.0, 120.0, 60.0), (200.0, 160.0, 40.0), fov_deg=70)
    assert_alike(engine, three_channels, inside, RaycastSpec())


def test_oblique_anisotropic_volume_matches_reference():
    """Shear, rotation and unequal spacing: gradients must be taken in the world."""
    values = phantom.ball(24).values * 200
    volume = Volume(values.astype(np.int16) - 50, world_from_index=oblique_world())
    table = two_channels([-40, 0, 100, 150], [0, 0.05, 0.1, 0.4])
    assert_alike(volume, table, Camera.orbit(volume, azimuth_deg=50), RaycastSpec(specular=0.5))


@pytest.mark.parametrize(
    ("dtype", "channels"),
    [(np.uint16, 2), slow(np.uint8, 24), slow(np.int16, 3), slow(np.float32, 9)],
)
def test_every_voxel_type_and_channel_count(dtype, channels):
    volume = Volume((phantom.ball(20).values * 120).astype(dtype))
    at, white = np.linspace(0, 1, 1024), np.linspace(0, 1, channels)
    weights = np.stack([np.abs(np.sin(at * (k + 2))) for k in range(channels)], axis=1)
    table = TransferTable((0.0, 120.0), 0.3 * at, weights, 1.0, white=white)
    assert_alike(volume, table, Camera.orbit(volume), RaycastSpec(specular=0.4), size=(21, 17))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mrbrain", "aneurism", "foot"])
def test_other_real_volumes_match_reference(volumes, name):
    """Dense, nearly empty, and with unequal spacing; skipped where the files are not."""
    volume = load_volume(volumes / f"{name}.nrrd")
    table = two_channels([30, 60, 200], [0, 0.05, 0.4])
    camera = Camera.orbit(volume, azimuth_deg=-40, elevation_deg=15, zoom=1.5)
    assert_alike(volume, table, camera, RaycastSpec(), size=(40, 32))


@pytest.mark.parametrize("shape", [(2, 2, 2), (2, 9, 9), (17, 8, 9)])
def test_thin_tiny_and_constant_volumes_match_reference(shape):
    volume, table = Volume(np.full(shape, 1, np.uint8)), fog(0.4, channels=2, share=0.5)
    assert_alike(volume, table, Camera.orbit(volume), RaycastSpec(specular=0.3), size=(24, 24))


def test_bands_with_progress_give_the_same_picture(engine, three_channels):
    caster, given = Raycaster(engine), (three_channels, Camera.orbit(engine), (100, 260))
    shares: list[float] = []
    whole = caster.cast(*given, RaycastSpec())
    banded = caster.cast(*given, RaycastSpec(tile_ms=0.1), shares.append)
    assert all(np.array_equal(a, b) for a, b in zip(whole, banded, strict=True))
    assert shares == sorted(shares) and shares[-1] == 1 and len(shares) > 8


def test_light_before_the_cast_equals_light_after_it(engine, three_channels):
    """cast(e ∘ s) = e ∘ cast(s) for flat opacity: the promise of post-illumination (METHOD §3).

    Both sides sum the same positive terms in the same order and differ by float32 rounding:
    64 visible terms of relative error 6e-8 bound it at 4e-6 of full scale; measured 2e-6.
    """
    light = np.random.default_rng(1).uniform(0.1, 3.0, 3)
    caster, how = Raycaster(engine), (Camera.orbit(engine), (256, 256), RaycastSpec())
    lit = dataclasses.replace(three_channels, channels=three_channels.channels * light)
    before, after = caster.cast(lit, *how)[0], caster.cast(three_channels, *how)[0] * light
    assert np.abs(before - after).max() < 4e-6 * np.abs(after).max()
