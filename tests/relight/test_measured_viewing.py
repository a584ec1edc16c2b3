"""`Viewing.adapting`: pictures with known answers for what an eye before them is adapted to."""

import dataclasses
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import refuses
from tests.support.images import image as image_of
from tests.support.relighting import COARSE, assert_in_range, box_basis
from tests.support.scenes import BALL, write_scene_text
from volspec.appearance import Viewing
from volspec.appearance.adaptation_grid import ViewTransformGrid
from volspec.appearance.measured import adapting_fields, measured_conditions
from volspec.appearance.models import model
from volspec.appearance.models.cam import CamTransform
from volspec.appearance.models.hunt import HuntSettings
from volspec.appearance.models.nayatani95 import NayataniSettings
from volspec.appearance.models.numeric import nearest_inverse
from volspec.appearance.spec import MODELS, PER_PIXEL
from volspec.errors import ViewingError
from volspec.image.model import CoefficientImage
from volspec.relight import Illumination, LightRig, Relighter, RelightSpec, relight
from volspec.relight.measured_viewing import ViewingMeter
from volspec.scene import Scene, stored_relight_spec
from volspec.spectra import light
from volspec.spectra.photometry import white_XYZ

# Flat reflectances are flat in this basis, so that exact mode has their Y to rounding.
BASIS = box_basis()
pytestmark = COARSE
LUX_1000 = 1000.0 / math.pi


def greys(factors: Any, alpha: float = 1.0, fov_deg: float | None = 40.0) -> CoefficientImage:
    """A picture of flat greys, Y in percent, that cover the backdrop by their alpha."""
    Y = np.asarray(factors, np.float32)
    coefficients = np.repeat(Y[..., None] * alpha / 100.0, BASIS.size, axis=-1)
    return image_of(coefficients, BASIS, np.full(Y.shape, alpha), fov_deg=fov_deg)


def lit(image: CoefficientImage, name: str = "A", **spec: Any) -> Illumination:
    return Illumination.of(image.basis, light(name), RelightSpec(mode="exact", **spec))


def seen(image: CoefficientImage, viewing: Viewing, **spec: Any) -> Viewing:
    """The viewing with what was measured in the picture."""
    return ViewingMeter().measure_viewing(image, lit(image, viewing=viewing, **spec))[0]


def frame(image: CoefficientImage, viewing: Viewing, **others: Any) -> np.ndarray:
    spec = RelightSpec(viewing, **{"mode": "exact", **others})
    return relight(image, light("A"), spec, dtype=np.float32, backend="numpy")


PICTURE, PIXEL = Viewing(adapting="picture"), Viewing(adapting="pixel")
DIM = np.full((8, 8), 20.0)


@pytest.mark.parametrize("shape", [(64, 96), (1, 1), (3, 200), (510, 333)])
@pytest.mark.parametrize("alpha", [1.0, 0.25])
def test_a_uniform_picture_before_a_backdrop_like_it_has_its_Y(shape, alpha):
    image = greys(np.full(shape, 30.0), alpha)
    found = seen(image, PICTURE, backdrop=0.3)
    # float32 coefficients.
    assert found.adapting == "given"
    expected = 30.0, 0.3 * LUX_1000
    assert (found.Y_b, found.L_A) == pytest.approx(expected, rel=1e-6)
    maps = ViewingMeter().maps(image, lit(image, viewing=PIXEL, backdrop=0.3))
    for own, number in zip(maps, expected, strict=True):
        assert own.shape == shape
        np.testing.assert_allclose(own, number, rtol=1e-6)


def test_half_a_picture_of_black_halves_background_and_adapting_field():
    Y = np.zeros((128, 128))
    Y[:, :64] = 60.0
    found = seen(greys(Y), PICTURE, backdrop=0.3)
    assert (found.Y_b, found.L_A) == pytest.approx((30.0, 0.3 * LUX_1000), rel=1e-6)
    # Per pixel: 22° from the other half and from the edge, the background is of one Y.
    Y_b, _ = ViewingMeter().maps(greys(Y, fov_deg=90.0), lit(greys(Y), viewing=PIXEL, backdrop=0.0))
    assert Y_b[64, 38] == pytest.approx(60.0, rel=1e-6)
    assert Y_b[64, 89] == pytest.approx(0.0, abs=1e-6)
    assert Y_b[48:80, 63:65].mean(axis=1) == pytest.approx(30.0, abs=0.1)


def test_what_lies_outside_of_the_picture_is_the_backdrop():
    # A picture of 1° is all inside of the inner cone.
    found = seen(greys(np.full((32, 32), 90.0), fov_deg=1.0), PICTURE, backdrop=0.05)
    assert (found.Y_b, found.L_A) == pytest.approx((5.0, 0.05 * LUX_1000), rel=1e-6)


def test_measuring_at_a_stride_is_the_measurement_of_every_pixel():
    coarse = np.random.default_rng(2).random((11, 17)) * 100.0
    Y = np.kron(coarse, np.ones((40, 40)))
    image = greys(Y, fov_deg=50.0)
    whole = measured_conditions(Y, white_XYZ(light("A")), 50.0, LUX_1000, outside=20.0)
    found = seen(image, PICTURE)
    # A third of the pixels along each side; measured 0.02 of Y, 0.04 cd/m².
    assert (found.Y_b, found.L_A) == pytest.approx((whole.Y_b, whole.L_A), abs=0.1)
    maps = ViewingMeter().maps(image, lit(image, viewing=PIXEL))
    exact = adapting_fields(Y, 50.0, LUX_1000, outside=20.0)
    # Cells of 2.4° in place of 1.6°, and hard edges; measured 2.2 of Y, 0.14 cd/m².
    assert np.abs(maps[0] - exact[0]).max() < 3.0
    assert np.abs(maps[1] - exact[1]).max() < 0.5


def measured_ways(model: str) -> tuple[str, ...]:
    return ("picture", "pixel") if model in PER_PIXEL else ("picture",)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("L_A", [None, 3.0])
def test_a_uniform_picture_looks_as_with_its_numbers_given(model, L_A):
    """An L_A that is given is not measured."""
    image = greys(np.full((24, 36), 35.0), fov_deg=90.0)
    given = Viewing(model=model, Y_b=35.0, L_A=L_A)
    expected = frame(image, given, backdrop=0.35)
    for adapting in measured_ways(model):
        measured = dataclasses.replace(given, adapting=adapting, Y_b=20.0)
        np.testing.assert_allclose(frame(image, measured, backdrop=0.35), expected, atol=1e-6)


def test_exposure_and_level_are_the_cameras_and_not_the_eyes():
    image = greys(np.full((24, 36), 30.0))
    rig = LightRig((light("A"),), illuminance_lux=(500.0,))
    for level, exposure in (("relative", 4.0), ("absolute", 1.0), ("absolute", 0.1)):
        viewing = dataclasses.replace(PICTURE, exposure=exposure, illuminance_lux=2000.0)
        spec = RelightSpec(viewing, "exact", 0.3, level)
        found, _ = ViewingMeter().measure_viewing(image, Illumination.of(BASIS, rig, spec))
        assert (found.Y_b, found.L_A) == pytest.approx((30.0, 0.3 * 500.0 / math.pi), rel=1e-6)


def test_the_viewings_field_of_view_comes_before_the_images():
    Y = np.full((64, 64), 5.0)
    Y[24:40, 24:40] = 95.0
    near, far = (greys(Y, fov_deg=fov_deg) for fov_deg in (60.0, 10.0))
    asked = dataclasses.replace(PICTURE, fov_deg=10.0)
    assert seen(near, asked) == dataclasses.replace(seen(far, PICTURE), fov_deg=10.0)
    assert abs(seen(near, PICTURE).Y_b - seen(far, PICTURE).Y_b) > 10.0


@pytest.mark.parametrize("model", MODELS)
def test_a_black_picture_has_no_nan(model):
    for adapting in measured_ways(model):
        viewing = Viewing(model=model, adapting=adapting)
        shown = frame(greys(np.zeros((16, 24))), viewing, backdrop=0.0)
        # Hunt's black is not 0 to an eye in the dark.
        assert_in_range(shown)
        if model in PER_PIXEL:
            assert not shown.any()


@pytest.mark.parametrize("adapting", ["picture", "pixel"])
def test_glints_and_nan_among_coefficients_give_no_nan(adapting):
    image = greys(np.full((64, 64), 20.0), fov_deg=80.0)
    image.coefficients[10:30, 10:30] = 3e38
    image.coefficients[5, 5] = np.nan
    image.coefficients[40:60, 40:60] = -1e9
    for D in (None, 0.0):
        assert_in_range(frame(image, Viewing(adapting=adapting, D=D)))
    # Ten whites at most.
    assert seen(image, dataclasses.replace(PICTURE, fov_deg=80.0)).Y_b < 1000.0


def assert_nodes_are_transforms(viewing: Viewing, **fields: np.ndarray) -> None:
    """Compare each node of a grid with the model's own transform in its conditions."""
    white = white_XYZ(light("A"))
    grid = ViewTransformGrid.of(viewing, white, *fields.values())
    for node in np.ndindex(grid.numbers.shape[:2]):
        conditions = {name: values[node] for name, values in fields.items()}
        own = dataclasses.replace(viewing, adapting="given", **conditions)
        given = own.conditions(white), viewing.display.conditions
        alone = CamTransform.for_viewing(viewing.model, *given)
        numbers = grid.numbers[node].reshape(3, 4)
        np.testing.assert_allclose(numbers[:, :3].T, alone.response_from_XYZ, rtol=1e-10)
        fourth = alone.scene_achromatic, alone.lightness_power, alone.chroma_gain
        np.testing.assert_allclose(numbers[:, 3], fourth, rtol=1e-10)


@pytest.mark.parametrize("model", PER_PIXEL)
@pytest.mark.parametrize("change", [{}, {"D": 0.4}, {"discount": True}, {"surround": 0.07}])
def test_a_fields_nodes_are_the_models_own_transforms(model, change):
    L_A, Y_b = np.meshgrid([0.0, 1e-7, 0.01, 5.0, 300.0, 1e10], [0.0, 1e-3, 4.0, 20.0, 99.0, 900.0])
    viewing = Viewing(model=model, adapting="pixel", **change)
    assert_nodes_are_transforms(viewing, Y_b=Y_b, L_A=L_A)


def test_nodes_of_a_measured_surround_are_the_models_own_transforms():
    S_R = np.array([[0.0, 0.05], [0.13, 0.9]])
    Y_b, L_A = np.full_like(S_R, 20.0), np.full_like(S_R, 60.0)
    viewing = Viewing(adapting="pixel", surround="measured")
    assert_nodes_are_transforms(viewing, Y_b=Y_b, L_A=L_A, surround=S_R)


SCENE = f"""{BALL}[basis]
name = "general-7"
[[light]]
name = "lamp"
spectrum = "A"
[camera]
fov_deg = 33.3
[viewing]
adapting = "picture"
adopted_white = "scene"
fov_deg = 25.0
[output]
width = 24
height = 24
"""


def test_a_scene_file_asks_for_it_and_its_pictures_remember(tmp_path):
    scene = Scene.load(write_scene_text(tmp_path, SCENE, 16))
    asked = Viewing(adapting="picture", adopted_white="scene", fov_deg=25.0)
    assert scene.relight.viewing == asked
    image = scene.render()
    image.save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr")
    # A camera with perspective leaves its field of view, and files keep it.
    assert image.fov_deg == again.fov_deg == 33.3
    assert stored_relight_spec(again).viewing == asked
    assert json.loads(again.notes["viewing"])["fov_deg"] == 25.0
    parallel = SCENE.replace("fov_deg = 33.3", "orthographic = true")
    (tmp_path / "scene.toml").write_text(parallel, encoding="utf-8")
    flat = Scene.load(tmp_path / "scene.toml").render()
    flat.save(tmp_path / "flat.exr")  # as files of before there were any
    with OpenEXR.File(str(tmp_path / "flat.exr")) as file:
        assert "volspec:fov_deg" not in file.header()
    assert flat.fov_deg is CoefficientImage.load(tmp_path / "flat.exr").fov_deg is None


def conditions(**settings: Any) -> Callable[[], object]:
    """Conditions of a white, which a picture is needed for."""
    return lambda: Viewing(**settings).conditions((95.0, 100.0, 109.0))


def violet() -> object:
    """D = 0 leaves a violet's white as it is, and its achromatic response below 0."""
    viewing, nodes = Viewing(adapting="pixel", D=0.0, model="CAM16"), np.full((2, 2), 20.0)
    return ViewTransformGrid.of(viewing, np.array([1.0, 100.0, 1e6]), nodes, nodes)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: Viewing(adapting="pictures"), "unknown Viewing.adapting"),
        (lambda: Viewing(adapting="pixel", model="RLAB"), "conflict Viewing.adapting"),
        (lambda: Viewing(fov_deg=180.0), "range Viewing.fov_deg"),
        (lambda: Viewing(surround="measure"), "unknown Viewing.surround"),
        (lambda: Viewing(adopted_white="sceen"), "unknown Viewing.adopted_white"),
        (lambda: Viewing(adopted_white=(0.95, 1.0, 1.09)), "type Viewing.adopted_white"),
        (conditions(adapting="picture"), "conflict Viewing.adapting"),
        (conditions(surround="measured"), "conflict Viewing.surround"),
        (conditions(adopted_white="scene"), "conflict Viewing.adopted_white"),
        (lambda: PICTURE.adapting_luminance, "conflict Viewing.adapting"),
        (lambda: frame(greys(DIM, fov_deg=None), PICTURE), "missing Viewing.fov_deg"),
        (lambda: frame(greys(DIM, fov_deg=None), PIXEL), "missing Viewing.fov_deg"),
        (violet, "impossible viewing conditions"),
    ],
)
def test_a_viewing_that_cannot_be_is_refused(make, fault):
    refuses(make, fault, ViewingError)


def test_what_is_given_needs_no_picture():
    assert Viewing(adapting="picture", L_A=7.0).adapting_luminance == 7.0
    for change in ({"surround": "measured"}, {"adopted_white": "scene"}):
        assert Viewing(**change).unmeasured() == Viewing()
    for viewing in (PICTURE, PIXEL):
        shown = frame(greys(DIM, fov_deg=None), dataclasses.replace(viewing, fov_deg=30.0))
        assert np.isfinite(shown).all()


SURROUND = Viewing(surround="measured")


def test_the_surround_is_the_field_s_luminance_over_the_white_s():
    for backdrop in (0.0, 0.05, 0.3):
        found = seen(greys(np.full((32, 48), 100.0 * backdrop)), SURROUND, backdrop=backdrop)
        assert found.surround == pytest.approx(backdrop, abs=1e-6)
        assert (found.Y_b, found.L_A) == (20.0, None), "as given"
    # Of a picture of 1° only its backdrop is 11° away; a lamp in view is no brighter than white.
    found = seen(greys(np.zeros((8, 8)), fov_deg=1.0), SURROUND, backdrop=0.1)
    assert found.surround == pytest.approx(0.1, abs=1e-6)
    assert seen(greys(np.full((8, 8), 900.0), fov_deg=170.0), SURROUND).surround == 1.0
    both = dataclasses.replace(SURROUND, adapting="picture", L_A=3.0)
    found = seen(greys(np.full((32, 48), 15.0)), both, backdrop=0.15)
    assert (found.surround, found.L_A) == (pytest.approx(0.15, abs=1e-6), 3.0)


@pytest.mark.usefixtures("needs_gl")
@pytest.mark.parametrize("backend", ["numpy", "gl"])
@pytest.mark.parametrize("adapting", ["given", "picture", "pixel"])
def test_a_uniform_picture_looks_as_with_its_surround_given(adapting, backend):
    image = greys(np.full((24, 36), 12.0), fov_deg=90.0)
    given = Viewing(surround=0.12, Y_b=12.0)
    asked = dataclasses.replace(given, adapting=adapting, surround="measured")
    specs = (RelightSpec(viewing, "exact", 0.12) for viewing in (asked, given))
    with Relighter(image, backend) as relighter:
        shown, expected = (relighter.frame(light("A"), spec, np.float32) for spec in specs)
    np.testing.assert_allclose(shown, expected, atol=2e-4 if backend == "gl" else 1e-6)


RIG = LightRig((light("A"), light("D65")), (1.0, 3.0), groups=("key", "fill"))


def two_groups(key: Any, fill: Any, fov_deg: float = 120.0) -> CoefficientImage:
    """A picture of white surfaces, by the light that each group casts on them."""
    layers = np.concatenate([np.repeat(Y[..., None], BASIS.size, -1) for Y in (key, fill)], -1)
    return image_of(layers, BASIS, groups={"key": 0.5, "fill": 0.5}, fov_deg=fov_deg)


def scene_white(image: CoefficientImage, backdrop: float = 0.0, **viewing: Any) -> np.ndarray:
    spec = RelightSpec(Viewing(adopted_white="scene", **viewing), "exact", backdrop)
    lit = Illumination.of(BASIS, RIG, spec, image.groups)
    return np.array(ViewingMeter().measure_viewing(image, lit)[0].adopted_white)


@pytest.mark.parametrize("adapting", ["given", "picture"])
def test_the_white_of_the_scene_is_that_of_the_light_on_what_is_seen(adapting):
    some, none = np.full((24, 24), 0.3), np.zeros((24, 24))
    key, fill = (white_XYZ(each) for each in RIG.lights)
    # Facing both, a surface is lit as the white of the light is.
    both = Illumination.of(BASIS, RIG, RelightSpec(), {"key": 0.5, "fill": 0.5}).white_XYZ
    for lit_by, expected in (((some, none), key), ((none, some), fill), ((some, some), both)):
        found = scene_white(two_groups(*lit_by), adapting=adapting)
        assert found == pytest.approx(expected, rel=1e-5)
    # Its backdrop is most of the field.
    assert scene_white(two_groups(some, none, 0.2), 0.5) == pytest.approx(both, rel=1e-5)
    # The light of both counts by its power: a quarter of it is from the key.
    mixed = scene_white(two_groups(some, some / 2))
    assert mixed == pytest.approx((key + 1.5 * fill) / 2.5, rel=1e-5)
    assert scene_white(two_groups(none, none)).tolist() == "light", "nothing is lit"


def test_surfaces_near_the_line_of_sight_and_white_ones_count_most():
    key, fill = np.zeros((64, 64)), np.full((64, 64), 0.5)
    key[24:40, 24:40], fill[24:40, 24:40] = 0.5, 0.0
    own = [white_XYZ(each) for each in RIG.lights]

    def share(image: CoefficientImage) -> float:
        """The key's part of the white, by X over Y, which lies on the line between both."""
        X, near, far = scene_white(image)[0], own[0][0], own[1][0]
        return float((X - far) / (near - far))

    middle, aside = share(two_groups(key, fill)), np.roll(key, 24, 1)
    assert middle > 2 * share(two_groups(aside, 0.5 - aside)) > 0
    assert share(two_groups(key, fill / 10)) > middle


def test_a_white_that_is_given_is_adapted_to():
    image = greys(np.full((8, 8), 40.0))
    tungsten = tuple(white_XYZ(light("A")).tolist())
    assert np.array_equal(frame(image, Viewing(adopted_white=tungsten)), frame(image, Viewing()))
    daylight = Viewing(adopted_white=(95.05, 100.0, 108.88), D=1.0)
    R, _, B = frame(image, daylight)[4, 4]
    assert R > 1.5 * B, "an eye that is adapted to daylight sees tungsten as orange"


@pytest.mark.slow
@pytest.mark.usefixtures("needs_gl")
@pytest.mark.parametrize("backend", ["numpy", "gl"])
def test_inputs_of_hunt_s_and_nayatani_s_models_reach_the_frames(backend):
    image = greys(np.full((4, 4), 40.0))
    hunt, nayatani = HuntSettings(N_b=25.0, helson_judd=True), NayataniSettings(n=3.0)
    for name, field, settings in (("Hunt", "hunt", hunt), ("Nayatani95", "nayatani", nayatani)):
        viewing = Viewing(model=name, **{field: settings})
        scene = viewing.conditions(white_XYZ(light("A")))
        look = model(name).forward(0.4 * np.array(scene.white_XYZ), scene, settings=settings)
        XYZ = nearest_inverse(model(name), look.J, look.C, look.h, viewing.display.conditions)
        space = viewing.display.colours
        expected = np.clip(space.encode(XYZ @ space.RGB_from_XYZ.T), 0.0, 1.0)
        specs = (RelightSpec(each, "exact") for each in (viewing, Viewing(name)))
        with Relighter(image, backend) as relighter:
            shown, usual = (relighter.frame(light("A"), s, np.float32)[2, 2] for s in specs)
        # A LUT is off by half a code.
        np.testing.assert_allclose(shown, expected, atol=1e-5 if backend == "numpy" else 3e-3)
        assert np.abs(usual - expected).max() > 0.01
