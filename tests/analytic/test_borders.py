"""Planes of one normal, floors in full light: where a volume ends, is missing, or is coarse."""

import numpy as np
import pytest

from tests.support.fixtures import slow
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.pipeline import raycast
from volspec.raycast import Ambient, Directional, LightGroup, RaycastSpec
from volspec.spectra import reflectance
from volspec.transfer import Isosurfaces, LabelFunction, TransferFunction
from volspec.volume import Volume

BASIS = SpectralBasis.load("general-7")
WHITE = {"white": reflectance("grey:1")}
NORMAL = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
SUN = np.array([0.0, -0.6, 0.8])


def level(value: float) -> Isosurfaces:
    return Isosurfaces([(value, 1.0, "white")], WHITE, BASIS)


def sun(towards: np.ndarray, *, shadows: bool = False) -> tuple[LightGroup, ...]:
    return (LightGroup("sun", (Directional(tuple(map(float, towards)), shadows=shadows),)),)


def shades(volume: Volume, transfer, camera: Camera, size=(60, 60), **settings):
    """Return the brightness of opaque pixels, and the picture."""
    usual = {"ambient": 0.0, "diffuse": 1.0, "flat_gradient": 0.0, "alpha_stop": 1.0}
    image = raycast(volume, transfer, camera, size, RaycastSpec(**{**usual, **settings}))
    return (image.coefficients / BASIS.white).mean(-1)[image.alpha > 0.99], image


def plane(
    shape: tuple[int, int, int], spacing: tuple[float, float, float]
) -> tuple[Volume, Camera]:
    """Return a field linear in the world, and a view along its gradient, of 0 in its middle."""
    volume = Volume(np.zeros(shape, np.float32), spacing_mm=spacing)
    z, y, x = np.indices(shape)
    places = np.stack([x, y, z], axis=-1) * spacing
    middle = volume.corners_mm.mean(axis=0)
    values = (places - middle) @ NORMAL
    reach = float(np.ptp(volume.corners_mm, axis=0).max())
    camera = Camera(tuple(middle - 5 * reach * NORMAL), tuple(middle), (0, 1, 0), height_mm=reach)
    return Volume(values.astype(np.float32), spacing_mm=spacing), camera


@pytest.mark.parametrize("spacing", [(1, 1, 1), (1, 1, 20), (3, 0.2, 1)])
@pytest.mark.parametrize("crop", [None, ((2, 11), (0, 9.5), (3, 15))])
def test_a_linear_field_has_one_shade_up_to_its_borders(spacing, crop):
    volume, camera = plane((16, 14, 12), spacing)
    shade, _ = shades(volume, level(0), camera, groups=sun(SUN), step_mm=0.05, crop_voxels=crop)
    assert shade.size
    np.testing.assert_allclose(shade, abs(SUN @ NORMAL), atol=2e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.float32])
def test_borders_have_the_whole_gradient_in_every_type_and_narrow_volumes(dtype):
    """Rows of three voxels are stored wider."""
    ramp = np.broadcast_to(np.arange(3)[:, None, None] * 10, (3, 4, 3)).astype(dtype)
    camera = Camera((1, 1.5, -40), (1, 1.5, 0), (0, 1, 0), height_mm=3)
    shade, _ = shades(Volume(ramp), level(7), camera, groups=sun(SUN))
    np.testing.assert_allclose(shade, 0.8, atol=1e-3)


def test_missing_voxels_neither_bend_normals_nor_make_walls():
    volume, camera = plane((24, 24, 24), (1, 1, 1))
    values = volume.values.copy()
    z, y, x = np.indices(values.shape) - 11.5
    values[x**2 + y**2 + z**2 > 81] = np.nan
    with pytest.warns(match="NaN"):
        ball = Volume(values)
    shade, image = shades(ball, level(0), camera, groups=sun(SUN), step_mm=0.05)
    np.testing.assert_allclose(shade, abs(SUN @ NORMAL), atol=2e-3)
    middle_mm = 5 * 23.0
    np.testing.assert_allclose(image.first_mm[image.alpha > 0.99], middle_mm, atol=0.1)


@pytest.mark.filterwarnings("ignore:.*(NaN|picture is empty)")
@pytest.mark.parametrize("preintegrated", [True, False])
def test_no_values_are_made_up_towards_missing_voxels(preintegrated):
    values = np.full((24, 24, 24), 2.0, np.float32)
    values[0, 0, 0], values[::4, ::4, 4::4] = 1.0, np.nan  # the range begins at 1, out of view
    points = [(1.1, 0.0, "white"), (1.2, 1.0, "white"), (1.3, 0.0, "white")]
    camera = Camera((-50, 14, 17), (12, 12, 12), height_mm=6)
    curve, how = TransferFunction(points, WHITE, BASIS), {"preintegrated": preintegrated}
    _, image = shades(Volume(values), curve, camera, step_mm=0.3, **how)
    assert not image.alpha.any()


def test_the_gradient_of_a_ramp_counts_whole_at_its_ends():
    ramp = np.broadcast_to(np.arange(8) * 10.0, (8, 8, 8)).astype(np.float32)
    points = [(-1, 0.1, "white"), (200, 0.1, "white")]
    steep = TransferFunction(points, WHITE, BASIS, gradient_opacity=[(7, 0), (7.5, 1)])
    camera = Camera((-50, 3.5, 3.5), (3.5, 3.5, 3.5), height_mm=4)
    _, image = shades(Volume(ramp), steep, camera, (5, 5), step_mm=0.02)
    np.testing.assert_allclose(image.alpha[2, 2], 1 - 0.9**7, atol=1e-3)


@pytest.mark.parametrize("tilt_deg", [0, slow(45), 75])
@pytest.mark.parametrize("spacing", [(1, 1, 1), slow((0.7, 0.7, 3)), (1, 1, 20), (3, 1, 1)])
@pytest.mark.parametrize("physical", [False, True])
@pytest.mark.parametrize("kind", ["level", "curve", "labels", slow("preintegrated")])
def test_an_opaque_floor_is_in_full_light(kind, physical, spacing, tilt_deg):
    floor = np.zeros((14, 32, 32), np.uint8)
    floor[:5] = 100
    step = [(0, 0, "white"), (80, 0, "white"), (80, 1, "white"), (100, 1, "white")]
    labels = LabelFunction({100: (1, "white")}, WHITE, BASIS)
    curve = TransferFunction(step, WHITE, BASIS)
    transfer = {"level": level(80), "labels": labels}.get(kind, curve)
    volume = Volume(floor, spacing_mm=spacing)
    x, y, z = volume.corners_mm.mean(axis=0)
    camera = Camera((x, y - 1, z + 500), (x, y, 0), (0, 1, 0), height_mm=8)
    tilt = np.radians(tilt_deg)
    light = np.array([0.6 * np.sin(tilt), 0.8 * np.sin(tilt), np.cos(tilt)])
    how = {"physical_light": physical, "preintegrated": kind == "preintegrated"}
    given = volume, transfer, camera, (9, 9)
    shade, _ = shades(*given, groups=sun(light, shadows=True), **how)
    np.testing.assert_allclose(shade / light[2], 1.0, atol=0.02)
    sky = (LightGroup("sky", (Ambient(occlusion=True, radius_mm=10),)),)
    shade, _ = shades(*given, groups=sky, **how, ambient=1.0)
    np.testing.assert_allclose(shade, 1.0, atol=0.02)


def test_a_ball_of_an_isosurface_is_as_bright_from_opposite_sides():
    grid = np.moveaxis(np.indices((32, 32, 32)), 0, -1) - 15.5
    volume = Volume((100 - np.linalg.norm(grid, axis=-1)).astype(np.float32))
    light = LightGroup("l", (Directional((0, 0, 1), frame="camera", shadows=True),))
    means = []
    for azimuth, elevation in ((135, 35.264), (-45, -35.264)):
        camera = Camera.orbit(volume, azimuth_deg=azimuth, elevation_deg=elevation)
        means.append(
            shades(volume, level(92), camera, groups=(light,), physical_light=True)[0].mean()
        )
    np.testing.assert_allclose(means[0], means[1], rtol=2e-3)
