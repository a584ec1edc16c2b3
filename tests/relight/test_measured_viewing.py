"""`Viewing.adapting`: pictures with known answers for what an eye before them is adapted to."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import raises, refuses
from tests.support.relighting import box_basis
from tests.support.scenes import BALL, write_scene_text
from volspec.appearance import Viewing
from volspec.appearance.adaptation_grid import ViewTransformGrid
from volspec.appearance.measured import adapting_fields, measured_conditions
from volspec.appearance.models.cam import CamTransform
from volspec.appearance.spec import MODELS, PER_PIXEL
from volspec.errors import ImageError, SceneError, ViewingError
from volspec.raycast.image import CoefficientImage
from volspec.relight import Illumination, LightRig, Relighter, RelightSpec
from volspec.relight.measured_viewing import ViewingMeter
from volspec.scene import Scene, stored_relight_spec
from volspec.spectra import light
from volspec.spectra.photometry import white_XYZ

# Flat reflectances are flat in this basis, so that exact mode has their Y to rounding.
BASIS = box_basis()
LUX_1000 = 1000.0 / math.pi


def greys(factors: Any, alpha: float = 1.0, fov_deg: float | None = 40.0) -> CoefficientImage:
    """A picture of flat greys, Y in percent, that cover the backdrop by their alpha."""
    Y = np.asarray(factors, np.float32)
    opacity = np.full(Y.shape, alpha, np.float32)
    coefficients = np.repeat(Y[..., None] * alpha / 100.0, BASIS.size, axis=-1)
    coefficients = coefficients.astype(np.float32)
    return CoefficientImage(coefficients, opacity, opacity, BASIS, fov_deg=fov_deg)


def lit(image: CoefficientImage, name: str = "A", **spec: Any) -> Illumination:
    return Illumination.of(image.basis, light(name), RelightSpec(mode="exact", **spec))


def seen(image: CoefficientImage, viewing: Viewing, **spec: Any) -> Viewing:
    """The viewing with what was measured in the picture."""
    return ViewingMeter().measure_viewing(image, lit(image, viewing=viewing, **spec))[0]


def frame(image: CoefficientImage, viewing: Viewing, **others: Any) -> np.ndarray:
    spec = RelightSpec(viewing, **{"mode": "exact", **others})
    with Relighter(image, "numpy") as relighter:
        return relighter.frame(light("A"), spec, np.float32)


PICTURE, PIXEL = Viewing(adapting="picture"), Viewing(adapting="pixel")


@pytest.mark.parametrize("shape", [(64, 96), (1, 1), (3, 200), (510, 333)])
@pytest.mark.parametrize("alpha", [1.0, 0.25])
def test_a_uniform_picture_before_a_backdrop_like_it_has_its_Y(shape, alpha):
    image = greys(np.full(shape, 30.0), alpha)
    found = seen(image, PICTURE, backdrop=0.3)
    # float32 coefficients.
    assert found.adapting == "given"
    assert found.Y_b == pytest.approx(30.0, rel=1e-6)
    assert pytest.approx(0.3 * LUX_1000, rel=1e-6) == found.L_A
    for field, expected in zip(
        ViewingMeter().maps(image, lit(image, viewing=PIXEL, backdrop=0.3)),
        (30.0, 0.3 * LUX_1000),
        strict=True,
    ):
        assert field.shape == shape
        np.testing.assert_allclose(field, expected, rtol=1e-6)


def test_half_a_picture_of_black_halves_background_and_adapting_field():
    Y = np.zeros((128, 128))
    Y[:, :64] = 60.0
    found = seen(greys(Y), PICTURE, backdrop=0.3)
    assert found.Y_b == pytest.approx(30.0, rel=1e-6)
    assert pytest.approx(0.3 * LUX_1000, rel=1e-6) == found.L_A
    # Per pixel: 22° from the other half and from the edge, the background is of one Y.
    Y_b, _ = ViewingMeter().maps(greys(Y, fov_deg=90.0), lit(greys(Y), viewing=PIXEL, backdrop=0.0))
    assert Y_b[64, 38] == pytest.approx(60.0, rel=1e-6)
    assert Y_b[64, 89] == pytest.approx(0.0, abs=1e-6)
    assert Y_b[48:80, 63:65].mean(axis=1) == pytest.approx(30.0, abs=0.1)


def test_what_lies_outside_of_the_picture_is_the_backdrop():
    # A picture of 1° is all inside of the inner cone.
    found = seen(greys(np.full((32, 32), 90.0), fov_deg=1.0), PICTURE, backdrop=0.05)
    assert found.Y_b == pytest.approx(5.0, rel=1e-6)
    assert pytest.approx(0.05 * LUX_1000, rel=1e-6) == found.L_A


def test_measuring_at_a_stride_is_the_measurement_of_every_pixel():
    coarse = np.random.default_rng(2).random((11, 17)) * 100.0
    Y = np.kron(coarse, np.ones((40, 40)))
    image = greys(Y, fov_deg=50.0)
    white = white_XYZ(light("A"))
    whole = measured_conditions(Y, white, 50.0, LUX_1000, outside=20.0)
    found = seen(image, PICTURE)
    # A third of the pixels along each side; measured 0.02 of Y, 0.04 cd/m².
    assert found.Y_b == pytest.approx(whole.Y_b, abs=0.1)
    assert pytest.approx(whole.L_A, abs=0.1) == found.L_A
    maps = ViewingMeter().maps(image, lit(image, viewing=PIXEL))
    exact = adapting_fields(Y, 50.0, LUX_1000, outside=20.0)
    # Cells of 2.4° in place of 1.6°, and hard edges; measured 2.2 of Y, 0.14 cd/m².
    assert np.abs(maps[0] - exact[0]).max() < 3.0
    assert np.abs(maps[1] - exact[1]).max() < 0.5


@pytest.mark.parametrize("model", MODELS)
def test_a_uniform_picture_looks_as_with_its_numbers_given(model):
    image = greys(np.full((24, 36), 35.0), fov_deg=90.0)
    given = Viewing(model=model, Y_b=35.0)
    ways = ("picture", "pixel") if model in PER_PIXEL else ("picture",)
    for adapting in ways:
        measured = dataclasses.replace(given, adapting=adapting, Y_b=20.0)
        shown = frame(image, measured, backdrop=0.35)
        np.testing.assert_allclose(shown, frame(image, given, backdrop=0.35), atol=1e-6)


@pytest.mark.parametrize("adapting", ["picture", "pixel"])
def test_an_L_A_that_is_given_is_not_measured(adapting):
    image = greys(np.full((24, 36), 35.0))
    viewing = Viewing(adapting=adapting, L_A=3.0)
    given = Viewing(L_A=3.0, Y_b=35.0)
    shown = frame(image, viewing, backdrop=0.35)
    np.testing.assert_allclose(shown, frame(image, given, backdrop=0.35), atol=1e-6)


def test_exposure_and_level_are_the_cameras_and_not_the_eyes():
    image = greys(np.full((24, 36), 30.0))
    rig = LightRig((light("A"),), illuminance_lux=(500.0,))
    for level, exposure in (("relative", 4.0), ("absolute", 1.0), ("absolute", 0.1)):
        viewing = dataclasses.replace(PICTURE, exposure=exposure, illuminance_lux=2000.0)
        spec = RelightSpec(viewing, "exact", 0.3, level)
        found, _ = ViewingMeter().measure_viewing(image, Illumination.of(BASIS, rig, spec))
        assert found.Y_b == pytest.approx(30.0, rel=1e-6)
        assert pytest.approx(0.3 * 500.0 / math.pi, rel=1e-6) == found.L_A


def test_the_viewings_field_of_view_comes_before_the_images():
    Y = np.full((64, 64), 5.0)
    Y[24:40, 24:40] = 95.0
    near, far = (greys(Y, fov_deg=fov_deg) for fov_deg in (60.0, 10.0))
    asked = dataclasses.replace(PICTURE, fov_deg=10.0)
    assert seen(near, asked) == dataclasses.replace(seen(far, PICTURE), fov_deg=10.0)
    assert abs(seen(near, PICTURE).Y_b - seen(far, PICTURE).Y_b) > 10.0


@pytest.mark.parametrize("model", MODELS)
def test_a_black_picture_has_no_nan(model):
    ways = ("picture", "pixel") if model in PER_PIXEL else ("picture",)
    for adapting in ways:
        viewing = Viewing(model=model, adapting=adapting)
        shown = frame(greys(np.zeros((16, 24))), viewing, backdrop=0.0)
        # Hunt's black is not 0 to an eye in the dark.
        assert np.isfinite(shown).all() and shown.min() >= 0.0 and shown.max() <= 1.0
        if model in PER_PIXEL:
            assert not shown.any()


@pytest.mark.parametrize("adapting", ["picture", "pixel"])
def test_glints_and_nan_among_coefficients_give_no_nan(adapting):
    image = greys(np.full((64, 64), 20.0), fov_deg=80.0)
    image.coefficients[10:30, 10:30] = 3e38
    image.coefficients[5, 5] = np.nan
    image.coefficients[40:60, 40:60] = -1e9
    for D in (None, 0.0):
        shown = frame(image, Viewing(adapting=adapting, D=D))
        assert np.isfinite(shown).all() and shown.min() >= 0.0 and shown.max() <= 1.0
    # Ten whites at most.
    assert seen(image, dataclasses.replace(PICTURE, fov_deg=80.0)).Y_b < 1000.0


@pytest.mark.parametrize("model", PER_PIXEL)
@pytest.mark.parametrize("change", [{}, {"D": 0.4}, {"discount": True}, {"surround": 0.07}])
def test_a_fields_nodes_are_the_models_own_transforms(model, change):
    viewing = Viewing(model=model, adapting="pixel", **change)
    white = white_XYZ(light("A"))
    L_A, Y_b = np.meshgrid([0.0, 1e-7, 0.01, 5.0, 300.0, 1e10], [0.0, 1e-3, 4.0, 20.0, 99.0, 900.0])
    field = ViewTransformGrid.of(viewing, white, Y_b, L_A)
    for node in np.ndindex(L_A.shape):
        own = dataclasses.replace(viewing, adapting="given", L_A=L_A[node], Y_b=Y_b[node])
        alone = CamTransform.for_viewing(model, own.conditions(white), viewing.display.conditions)
        numbers = field.numbers[node].reshape(3, 4)
        np.testing.assert_allclose(numbers[:, :3].T, alone.response_from_XYZ, rtol=1e-10)
        fourth = alone.scene_achromatic, alone.lightness_power, alone.chroma_gain
        np.testing.assert_allclose(numbers[:, 3], fourth, rtol=1e-10)


@pytest.mark.parametrize("stored", ["200", '"wide"', "{"])
def test_a_file_with_another_field_of_view_is_refused(tmp_path: Path, stored: str):
    image = greys(np.full((4, 4), 20.0))
    image.save(tmp_path / "image.exr")
    with OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        header = {**file.header(), "volspec:fov_deg": stored}
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    header.pop("channels")
    OpenEXR.File(header, channels).write(str(tmp_path / "image.exr"))
    with raises(ImageError, "damaged") as caught:
        CoefficientImage.load(tmp_path / "image.exr")
    assert "image.exr" in str(caught.value)


SCENE = f"""{BALL}[basis]
name = "general-7"
[[light]]
name = "lamp"
spectrum = "A"
[camera]
fov_deg = 33.3
[viewing]
adapting = "picture"
fov_deg = 25.0
[output]
width = 24
height = 24
"""


def test_a_scene_file_asks_for_it_and_its_pictures_remember(tmp_path: Path):
    scene = Scene.load(write_scene_text(tmp_path, SCENE, 16))
    assert (scene.relight.viewing.adapting, scene.relight.viewing.fov_deg) == ("picture", 25.0)
    image = scene.render()
    image.save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr")
    # A camera with perspective leaves its field of view, and files keep it.
    assert image.fov_deg == again.fov_deg == 33.3
    assert stored_relight_spec(again).viewing == scene.relight.viewing
    assert json.loads(again.notes["viewing"])["fov_deg"] == 25.0
    parallel = SCENE.replace("fov_deg = 33.3", "orthographic = true")
    (tmp_path / "scene.toml").write_text(parallel, encoding="utf-8")
    flat = Scene.load(tmp_path / "scene.toml").render()
    flat.save(tmp_path / "flat.exr")  # as files of before there were any
    with OpenEXR.File(str(tmp_path / "flat.exr")) as file:
        assert "volspec:fov_deg" not in file.header()
    assert flat.fov_deg is CoefficientImage.load(tmp_path / "flat.exr").fov_deg is None
    (tmp_path / "scene.toml").write_text(SCENE.replace('"picture"', '"pixels"'), encoding="utf-8")
    with raises(SceneError, "unknown", "viewing.adapting"):
        Scene.load(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"adapting": "pictures"}, "unknown Viewing.adapting"),
        ({"adapting": "pixel", "model": "RLAB"}, "conflict Viewing.adapting"),
        ({"fov_deg": 180.0}, "range Viewing.fov_deg"),
        ({"fov_deg": "wide"}, "type Viewing.fov_deg"),
    ],
)
def test_a_viewing_that_cannot_be_is_refused(change, fault):
    refuses(lambda: Viewing(**change), fault, ViewingError)


@pytest.mark.parametrize("viewing", [PICTURE, PIXEL])
def test_without_a_field_of_view_the_remedy_is_named(viewing):
    image = greys(np.full((8, 8), 20.0), fov_deg=None)
    with raises(ViewingError, "missing", "Viewing.fov_deg"):
        frame(image, viewing)
    assert np.isfinite(frame(image, dataclasses.replace(viewing, fov_deg=30.0))).all()


def test_there_are_no_measured_conditions_without_a_picture():
    with raises(ViewingError, field="Viewing.adapting"):
        PICTURE.conditions((95.0, 100.0, 109.0))
    with raises(ViewingError, field="Viewing.adapting"):
        _ = PICTURE.adapting_luminance
    assert Viewing(adapting="picture", L_A=7.0).adapting_luminance == 7.0


def test_a_white_without_lightness_at_some_node_is_refused():
    # D = 0 leaves a violet's white as it is, and its achromatic response below 0.
    viewing = Viewing(adapting="pixel", D=0.0, model="CAM16")
    nodes = np.full((2, 2), 20.0)
    with raises(ViewingError, "impossible", "viewing conditions"):
        ViewTransformGrid.of(viewing, np.array([1.0, 100.0, 1e6]), nodes, nodes)
