"""Transforms that change over the picture: the shader, its NumPy twin and colour-science."""

import dataclasses

import numpy as np
import pytest

from tests.support.fixtures import slow_each
from tests.support.relight_reference import relight_reference
from tests.support.relighting import COARSE, assert_drawn_alike_by_webgl_2, box_basis, ciede2000
from volspec.appearance import Display, Viewing, view_transform
from volspec.appearance.adaptation_grid import ViewTransformGrid
from volspec.appearance.spec import PER_PIXEL
from volspec.image.model import CoefficientImage
from volspec.relight import Relighter, RelightSpec, relight
from volspec.spectra import PAPERS_GRID, light
from volspec.spectra.photometry import white_XYZ

pytestmark = [pytest.mark.usefixtures("needs_gl"), COARSE]
LIGHTS = ("A", "D65", "FL2")


def patches(height: int = 150, width: int = 200, fov_deg: float = 70.0) -> CoefficientImage:
    """Patches of random colours, from black to white, half of them thin; very uneven light."""
    rng = np.random.default_rng(8)
    # Boxes from 380 to 780 nm make other colours, of which Hunt's table misses .115 on average.
    basis = box_basis(grid=PAPERS_GRID)
    coarse = rng.random((6, 8, basis.size)) ** 3 * rng.random((6, 8, 1)) ** 2
    coarse[:2, :3], coarse[-2:, -3:] = 0.0, 1.0
    rows, columns = np.arange(height) * 6 // height, np.arange(width) * 8 // width
    alpha = rng.random((6, 8))[rows][:, columns]
    alpha = np.where(alpha > 0.5, 1.0, alpha).astype(np.float32)
    fine = coarse[rows][:, columns] * rng.uniform(0.7, 1.0, (height, width, 1))
    coefficients = (fine * alpha[..., None]).astype(np.float32)
    return CoefficientImage(coefficients, alpha, alpha, basis, fov_deg=fov_deg)


def both(image: CoefficientImage, name: str, viewing: Viewing) -> tuple[np.ndarray, np.ndarray]:
    shown, truth = (
        relight(image, light(name), viewing, dtype=np.float32, backend=backend)
        for backend in ("gl", "numpy")
    )
    return shown, truth


@pytest.mark.parametrize("model", PER_PIXEL)
@pytest.mark.parametrize("name", ["A", *slow_each(*LIGHTS[1:])])
def test_the_shader_draws_a_field_as_numpy_does(model, name):
    for change in ({}, {"surround": "dim", "D": 0.6}, {"illuminance_lux": 2.0}):
        shown, truth = both(patches(), name, Viewing(model=model, adapting="pixel", **change))
        error = ciede2000(shown, truth, what=f"{model}, {name}, {change}")
        # The goal is 0.05 and 0.3; llvmpipe leaves 1e-4 and 2e-3. Weights of 8 bits, which
        # devices may filter textures with, add 3e-4 and 5e-3 (in NumPy).
        assert error.mean() <= 0.005 and error.max() <= 0.05


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (300, 2), (31, 33), (129, 65)])
def test_pictures_of_any_size_have_a_field(size):
    shown, truth = both(patches(*size), "A", Viewing(adapting="pixel"))
    assert np.abs(shown - truth).max() < 2e-4


@pytest.mark.parametrize("model", PER_PIXEL)
@pytest.mark.parametrize("display", [{"gamut": "reduce"}, {"gamut": "reduce", "mark": True}])
def test_a_field_ends_in_the_displays_own_mapping(model, display):
    viewing = Viewing(model=model, adapting="pixel", display=Display(**display))
    shown, truth = both(patches(), "A", viewing)
    plain, _ = both(patches(), "A", dataclasses.replace(viewing, display=Display()))
    assert np.abs(shown - plain).max() > 0.03
    error = ciede2000(shown, truth, what=f"{model}, {display}")
    if "mark" in display:  # what lies on the cube's faces to rounding may be hatched or not
        assert np.mean(error > 0.1) < 1e-3
    else:  # a halving that fell otherwise, docs/viewing.md
        assert error.mean() <= 0.005 and error.max() <= 0.1


@pytest.mark.parametrize("name", LIGHTS)
def test_between_nodes_a_field_is_near_conditions_of_every_pixel(name):
    image, viewing = patches(), Viewing(adapting="pixel")
    shown = relight(image, light(name), viewing, dtype=np.float32, backend="numpy")
    truth = relight_reference(image, light(name), RelightSpec(viewing))
    error = ciede2000(shown, truth, what=name)
    # Straight lines between transforms, not between conditions: measured 0.002 and 0.12.
    assert error.mean() <= 0.01 and error.max() <= 0.3


@pytest.mark.parametrize("model", PER_PIXEL)
def test_a_pixel_on_a_node_has_the_transform_of_its_own_conditions(model):
    viewing, white = Viewing(model=model, adapting="pixel"), white_XYZ(light("A"))
    rng = np.random.default_rng(1)
    Y_b, L_A = rng.uniform(0, 90, (3, 3)), rng.uniform(0, 300, (3, 3))
    # The middle one of 5 rows and 7 columns lies on the middle of 3 by 3 nodes.
    field = ViewTransformGrid.of(viewing, white, Y_b, L_A)
    XYZ = rng.uniform(0, 100, (5, 7, 3))
    own = dataclasses.replace(viewing, adapting="given", Y_b=Y_b[1, 1], L_A=L_A[1, 1])
    alone = view_transform(own, white).apply(XYZ[2, 3])
    np.testing.assert_allclose(field.interpolate((5, 7)).apply(XYZ)[2, 3], alone, rtol=1e-9)
    # Three pixels to a gap: the middle one lies halfway between nodes.
    power = field.numbers[..., 7]
    halves = field.interpolate((6, 6)).lightness_power[1::3, 1::3]
    mean = (power[1:, 1:] + power[1:, :-1] + power[:-1, 1:] + power[:-1, :-1]) / 4
    np.testing.assert_allclose(halves, mean, rtol=1e-12)


@pytest.mark.parametrize("model", PER_PIXEL)
def test_an_even_field_is_the_transform_of_its_numbers(model):
    grey, one = np.full((40, 60, 5), 0.35, np.float32), np.ones((40, 60), np.float32)
    image = CoefficientImage(grey, one, one, box_basis(), fov_deg=50.0)
    given = Viewing(model=model, Y_b=35.0)
    measured = (dataclasses.replace(given, adapting=way, Y_b=20.0) for way in ("picture", "pixel"))
    with Relighter(image, "gl") as relighter:
        expected, *frames = (
            relighter.frame(light("A"), RelightSpec(each, "exact", 0.35))
            for each in (given, *measured)
        )
    assert all(np.array_equal(frame, expected) for frame in frames)


def test_a_field_takes_no_table_and_leaves_the_next_frame_alone():
    image, pixel = patches(), Viewing(adapting="pixel")
    frames = []
    for table in (False, True):
        with Relighter(image, "gl", lut3d=table) as relighter:
            before = relighter.frame(light("A"))
            frames.append(relighter.frame(light("A"), pixel, dtype=np.float32))
            assert np.array_equal(relighter.frame(light("A")), before)
    assert np.array_equal(*frames)


def test_another_cast_is_measured_anew():
    images = patches(fov_deg=70.0), patches(fov_deg=15.0)
    frames = []
    with Relighter(images[0], "gl") as relighter:
        for image in images:
            relighter.update(image)
            frames.append(relighter.frame(light("A"), Viewing(adapting="pixel")))
    assert not np.array_equal(*frames)
    alone = relight(images[1], light("A"), Viewing(adapting="pixel"), backend="gl")
    assert np.array_equal(frames[1], alone)


def test_same_source_draws_the_same_field_as_webgl_2(monkeypatch):
    given = patches(), light("A"), Viewing(adapting="pixel")
    assert_drawn_alike_by_webgl_2(lambda: relight(*given, backend="gl"), monkeypatch)
