"""The error map: CIEDE2000 pixel by pixel, drawn with a scale."""

from typing import Any

import numpy as np
import pytest
from PIL import ImageDraw

from tests.support.errors import refuses
from tests.support.images import image
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.display import DEFAULT_MODE
from volspec.basis.report import basis_report
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.relight import ErrorMap, LightRig, error_map
from volspec.spectra import light, reflectance, reflectance_set, white_XYZ

BASIS = SpectralBasis.load("general-7")
TEST = reflectance_set("test")


def chart(alpha: float = 1.0) -> CoefficientImage:
    """The 84 test reflectances as an image of 7 rows and 12 columns."""
    return image(alpha * BASIS.analyse(TEST).reshape(7, 12, 7), BASIS, np.full((7, 12), alpha))


def test_the_map_is_the_report_of_what_the_basis_makes_of_the_pixels():
    """Opaque pixels: the same numbers as `report` gives for the synthesised reflectances."""
    lamp = light("FL4")
    made = BASIS.synthesise(BASIS.analyse(TEST))
    possible = (made >= 0).all(axis=1)  # a report takes nothing below 0
    assert possible.sum() > 60
    truth = basis_report(BASIS, [lamp], made[possible])
    found = error_map(chart(), lamp)
    assert found.delta_e.shape == (7, 12) and found.delta_e.dtype == np.float32
    errors = found.delta_e.ravel()[possible]
    assert np.allclose(errors, truth.pairs.delta_e[DEFAULT_MODE][0], atol=1e-4)
    figures = found.delta_e.mean(), *np.percentile(found.delta_e, (95, 99.9)), found.delta_e.max()
    assert (found.mean, found.p95, found.p999, found.max) == pytest.approx(figures)


def test_the_exact_picture_and_materials_have_no_error():
    assert error_map(chart(), light("FL4"), mode="exact").max == 0
    painted = image([[[0.7, 0.1]]], MaterialBasis({"gold": reflectance("gold")}))
    assert error_map(painted, light("HP1")).max == 0


def test_errors_fade_with_opacity_and_an_empty_picture_has_none():
    """Behind a veil the backdrop, which is exact, is most of the colour."""
    lamp = light("FL4")
    assert error_map(chart(0.2), lamp).mean < error_map(chart(), lamp).mean
    empty = error_map(chart(0.0), lamp)
    assert (empty.mean, empty.p95, empty.max) == (0, 0, 0)
    assert empty.image().any()


def test_one_call_gives_an_image_with_its_scale():
    """You should see the map at the left, a bar with five numbers at the right, figures below."""
    with Relighter(chart(), backend="numpy") as relighter:
        found = relighter.error_map(LightRig((light("FL4"), light("A"))))
    picture = found.image()
    assert picture.shape == (148 + 58, 540, 3) and picture.dtype == np.uint8
    heat = found.heat()
    assert np.array_equal(picture[:7, :12], heat)
    worst = np.unravel_index(found.delta_e.argmax(), found.delta_e.shape)
    assert heat[worst].sum() == heat.sum(axis=-1).max()
    assert "FL4+A" in str(found)


def test_the_scale_says_which_colour_is_which_error(monkeypatch):
    """You should see the bar black at 0, the lowest number, and pale yellow at 2, the highest."""
    written: dict[str, float] = {}
    plain = ImageDraw.ImageDraw.text

    def noted(draw: ImageDraw.ImageDraw, xy: tuple, text: str, *rest: Any, **more: Any) -> None:
        if text.replace(".", "").isdigit():
            assert rest[2] == "ls", "a number's baseline; its middle is next to its colour"
            ascent, descent = rest[1].getmetrics()
            written[text] = xy[1] - (ascent - descent) / 2
        plain(draw, xy, text, *rest, **more)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", noted)
    # 248 rows: the numbers are 50 rows apart, on whole ones.
    drawn = ErrorMap(np.zeros((248, 10), np.float32), np.ones((248, 10), np.float32)).image(2.0)
    assert sorted(written, key=written.__getitem__) == ["2", "1.5", "1", "0.5", "0"]
    for text, y in written.items():
        one = np.ones((1, 1), np.float32)
        colour = ErrorMap(float(text) * one, one).heat(2.0)[0, 0]
        # One of 256 colours further where a float32 falls on the other side.
        assert np.abs(drawn[int(y), 10 + 20].astype(int) - colour).max() <= 4, text
    bar = drawn[int(written["2"]) : int(written["0"]) + 1, 10 + 20].astype(int).sum(axis=-1)
    assert (np.diff(bar) <= 0).all() and bar[0] > 600 and bar[-1] < 10


def test_a_half_transparent_pixel_s_error_is_that_before_its_backdrop():
    lamp, half, found = light("FL4"), chart(0.5), []
    white, modes = white_XYZ(lamp), ("exact", DEFAULT_MODE)
    XYZ = [half.coefficients @ BASIS.colour_matrix(lamp, mode).T for mode in modes]
    for backdrop in (0.0, 0.2, 0.9):
        found.append(error_map(half, lamp, backdrop=backdrop).delta_e)
        Lab = [cielab(each + 0.5 * backdrop * white, white) for each in XYZ]
        # float32 figures of a few units.
        assert np.allclose(found[-1], delta_E_2000(*Lab), atol=1e-5)
    assert (found[0] > found[-1]).all(), "light from behind washes errors out"


def test_maps_are_compared_on_one_scale():
    assert FLAT.top == 0.5
    assert (FLAT.heat(0.5) == FLAT.heat(0.1)).all(), "beyond the scale is its end"
    assert FLAT.heat(2.0).sum() < FLAT.heat(0.5).sum()


def test_a_sample_is_every_nth_pixel_of_the_map():
    whole, part = (error_map(chart(), light("FL4"), every=every) for every in (1, 3))
    assert np.array_equal(part.delta_e, whole.delta_e[::3, ::3])


def test_a_map_may_be_of_another_difference():
    usual, other = (
        error_map(chart(), light("FL4"), difference=name) for name in ("CIEDE2000", "CAM16-UCS")
    )
    assert 0.3 < other.mean / usual.mean < 3.0 and other.mean != usual.mean
    assert "ΔE00 mean" in str(usual) and "ΔE′ mean" in str(other)
    assert error_map(chart(), light("FL4"), "exact", difference="CAM16-UCS").max == 0


FLAT = ErrorMap(np.full((4, 4), 0.5, np.float32), np.ones((4, 4), np.float32), "D65")


def closed() -> Relighter:
    with Relighter(chart(), "numpy") as relighter:
        return relighter


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: closed().error_map(light("A")), "state Relighter"),
        (lambda: FLAT.image(0), "range error map.top"),
        (lambda: FLAT.image(float("nan")), "range error map.top"),
        (lambda: error_map(chart(), light("FL4"), difference="CIE94"), "unknown difference"),
        (lambda: error_map(chart(), light("FL4"), against="layers"), "unknown error map.against"),
        (lambda: error_map(chart(), light("A"), against="cast", opacities={}), "unsupported "),
    ],
)
def test_maps_that_cannot_be_drawn_are_refused(make, fault):
    refuses(make, fault)
