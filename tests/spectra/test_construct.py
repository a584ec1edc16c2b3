"""Reflectances made for colours: exact, within 0 to 1, near the true ones under other lights."""

import pickle

import numpy as np
import pytest

from tests.spectra._files import fails
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.errors import VolspecWarning
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    light,
    reflectance,
    reflectance_names,
    white_XYZ,
    write_spectrum,
)
from volspec.spectra.construct import reflectance_from_colour, reflectances_from_colours
from volspec.spectra.construct.base import (
    ROUTES,
    BaseSpectra,
    MadeReflectances,
    base_spectra,
    bouguer,
)
from volspec.spectra.construct.colours import XYZ_from_sRGB, colour_XYZ
from volspec.spectra.construct.search import (
    Tetrahedra,
    clip_to_hull,
    locate_tetrahedra,
    search_octants,
    select_distinct,
    smoothest_reflectances,
)
from volspec.spectra.construct.upsampling import METHODS

BANDS, FINE = DEFAULT_GRID.size, SpectralGrid(400, 700, 5)
D65, A = light("D65"), light("A")
WHITE = white_XYZ(D65)
Q = XYZ_from_spectra(D65, np.eye(BANDS)).T
CHECKER = [name for name in reflectance_names() if name.startswith("ColorChecker/")]
TRUE = np.array([reflectance(name).values for name in CHECKER])
# A cube around the origin, its corners by the bits x + 2y + 4z.
CUBE = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)


def errors(made: np.ndarray, true: np.ndarray, lamp: Spectrum) -> np.ndarray:
    white = white_XYZ(lamp)
    return delta_E_2000(*(cielab(XYZ_from_spectra(lamp, S), white) for S in (made, true)))


@pytest.mark.parametrize(
    ("method", "under_A"), [("delaunay", 0.6), ("tetrahedron", 1.0), ("smoothest", 1.5)]
)
def test_colour_checker_is_exact_and_nearly_true_under_A(method, under_A):
    """24 patches, none in the base: measured .497, .860 and 1.357 under A; .011 under D65 is
    Jakob's, these are exact to 1e-12."""
    made = reflectances_from_colours(XYZ_from_spectra(D65, TRUE), method).values
    assert made.min() >= 0 and made.max() <= 1
    assert errors(made, TRUE, D65).mean() < 1e-6
    assert errors(made, TRUE, A).mean() < under_A


def test_all_of_sRGB_is_within_0_and_1_and_exact():
    """The cube's corners are far outside of the base spectra."""
    levels = np.linspace(0, 1, 6)
    XYZ = XYZ_from_sRGB(np.stack(np.meshgrid(levels, levels, levels), axis=-1), WHITE)
    made = reflectances_from_colours(XYZ)
    assert made.values.shape == (6, 6, 6, BANDS)
    assert made.values.min() >= 0 and made.values.max() <= 1
    # The solver meets constraints to 1e-10 of white.
    assert np.abs(XYZ_from_spectra(D65, made.values) - XYZ).max() < 1e-6
    assert set(made.counts()) == {"delaunay", "extended"}


def test_the_colour_checker_is_in_no_base():
    base = base_spectra()
    assert not [name for name in base.names if "ColorChecker" in name or "ISO 17321" in name]
    assert len(base) == 2 + 5 * 533 + 120
    measured = np.array([not name.startswith("grey ") for name in base.names])
    apart = np.sqrt(((base.values[measured, None] - TRUE[None]) ** 2).mean(-1))
    assert apart.min() > 0.004  # the Academy's copies of the chart are not in the library


def test_a_ramp_of_grey_has_no_contours_under_another_light():
    encoded = np.arange(256) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    ramp = reflectances_from_colours(linear[:, None] * WHITE).values
    Lab = cielab(XYZ_from_spectra(A, ramp), white_XYZ(A))
    steps = delta_E_2000(Lab[1:], Lab[:-1])
    # sRGB's own steps are .35; next to black base colours are merged, and a cast stays.
    assert np.median(steps) < 0.35 and steps.max() < 1.3
    assert np.hypot(*Lab[40:, 1:].T).max() < 1.3


def test_a_mixture_is_its_base_spectra_by_their_shares():
    made = reflectances_from_colours([28, 26, 20])
    mix = made.mix()
    assert len(mix) == 4 and sum(mix.values()) == pytest.approx(1)
    values = dict(zip(made.base.names, made.base.values, strict=True))
    mixed = sum(share * values[name] for name, share in mix.items())
    np.testing.assert_allclose(made.values, mixed, atol=1e-12)
    assert list(mix.values()) == sorted(mix.values(), reverse=True)


def test_the_five_tetrahedra_of_the_paper_fill_a_cube():
    inside = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    vertices, shares = search_octants(CUBE, inside)
    assert (vertices >= 0).all()
    mixed = np.einsum("nk,nki->ni", shares, CUBE[vertices])
    # The nearest colour of each octant is searched.
    assert (search_octants(np.vstack([3.0 * CUBE, CUBE]), inside[:9])[0] >= 8).all()
    np.testing.assert_allclose(mixed, inside, atol=1e-12)


def test_an_empty_octant_leaves_the_search_open_and_delaunay_finds():
    without_B = np.delete(CUBE, 1, axis=0)  # the tetrahedron ABCF lacks a corner
    near_B, near_D = np.array([[0.5, -0.5, -0.4]]), np.array([[-0.5, 0.5, -0.4]])
    assert (search_octants(without_B, near_B)[0] == -1).all()
    assert (search_octants(without_B, near_D)[0] >= 0).all()
    assert (locate_tetrahedra(Tetrahedra.of(CUBE), near_B)[0] >= 0).all()


def test_what_the_search_misses_goes_to_delaunay_and_is_counted():
    XYZ = XYZ_from_sRGB(np.random.default_rng(2).uniform(0.1, 0.9, (200, 3)), WHITE)
    paper, delaunay = reflectances_from_colours(XYZ, "tetrahedron"), reflectances_from_colours(XYZ)
    assert set(paper.counts()) == {"tetrahedron", "delaunay", "extended"}
    # Every colour in the hull is found by the one or the other.
    outside = ROUTES.index("extended")
    assert ((paper.route == outside) == (delaunay.route == outside)).all()
    missed = paper.route == ROUTES.index("delaunay")
    np.testing.assert_array_equal(paper.values[missed], delaunay.values[missed])


def test_colours_across_the_edge_of_the_base_have_neighbouring_spectra():
    """Plainly smoothest ones would be 1.5 apart under A, measured; these by the step's size."""
    colours = XYZ_from_sRGB(np.random.default_rng(5).uniform(0, 1, (60, 3)), WHITE)
    beyond = colours[reflectances_from_colours(colours).route == ROUTES.index("extended")]
    base = XYZ_from_spectra(D65, base_spectra().values) / WHITE
    on_edge = clip_to_hull(Tetrahedra.of(base[select_distinct(base)]), beyond / WHITE) * WHITE
    inner = reflectances_from_colours(on_edge)
    outer = reflectances_from_colours(on_edge + 1e-3 * (beyond - on_edge))
    assert np.median(inner.route) == ROUTES.index("delaunay")
    apart = errors(inner.values, outer.values, A)
    assert apart.mean() < 0.1 and apart.max() < 0.5


def test_a_base_without_greys_leaves_the_smoothest():
    reds = BaseSpectra(tuple("abcd"), np.array([TRUE[14] ** p for p in (1, 2, 3)] + [TRUE[15]]))
    assert reflectances_from_colours([20, 25, 60], base=reds).counts() == {"smoothest": 1}


def test_smoothest_of_a_grey_is_flat():
    values, reached = smoothest_reflectances(np.array([0.3 * WHITE]), Q)
    np.testing.assert_allclose(values[0], 0.3, atol=1e-5)
    assert reached.all()


def test_beyond_white_the_nearest_is_white():
    with pytest.warns(VolspecWarning):
        made = reflectance_from_colour(1.3 * WHITE)
    np.testing.assert_allclose(made.values, 1, atol=1e-6)
    assert made.notes["constructed"] == "nearest"


def test_a_yellow_too_bright_gets_the_nearest_colour_there_is():
    wanted = np.array([85.0, 95.0, 10.0])
    made = reflectances_from_colours(wanted)
    assert made.counts() == {"nearest": 1}
    values = made.values
    assert values.min() >= 0 and values.max() <= 1

    # No step towards any other reflectance comes nearer: the first-order condition.
    slope = 2 * ((Q @ values - wanted) / WHITE**2) @ Q
    best_step = np.where(slope > 0, -values, 1 - values)
    assert slope @ best_step > -1e-5
    assert (((Q @ values - wanted) / WHITE) ** 2).sum() > 1e-3


def test_a_colour_is_meant_under_its_light_and_observer():
    for lamp, observer in ((A, 2), (light("FL11"), 10), (light("planck:2000"), 2)):
        XYZ = 0.6 * XYZ_from_spectra(lamp, TRUE, observer) + 0.1 * white_XYZ(lamp, observer)
        made = reflectances_from_colours(XYZ, light=lamp, observer_deg=observer)
        np.testing.assert_allclose(XYZ_from_spectra(lamp, made.values, observer), XYZ, atol=1e-6)


def test_light_of_one_wavelength_still_has_reflectances():
    """All colours lie on a line: there is no tetrahedron, but a smoothest reflectance."""
    sodium = DEFAULT_GRID.wavelengths_nm.tolist().index(590)
    lamp = Spectrum(DEFAULT_GRID.wavelengths_nm, np.eye(BANDS)[sodium], "sodium")
    made = reflectances_from_colours(0.4 * white_XYZ(lamp), light=lamp)
    assert made.counts() == {"smoothest": 1}
    assert made.values[sodium] == pytest.approx(0.4, abs=1e-6)


def test_another_grid_holds_its_own_reflectances():
    made, lamp = reflectance_from_colour("teal", grid=FINE), light("D65", FINE)
    assert made.grid == FINE
    wanted = colour_XYZ("teal", white_XYZ(lamp))
    np.testing.assert_allclose(XYZ_from_spectra(lamp, made), wanted, atol=1e-6)


def test_one_by_one_is_all_at_once_and_twice_the_same():
    XYZ = XYZ_from_spectra(D65, TRUE[:6]).reshape(2, 3, 3)
    once, again = reflectances_from_colours(XYZ), reflectances_from_colours(XYZ)
    np.testing.assert_array_equal(once.values, again.values)
    singly = [reflectances_from_colours(colour).values for colour in XYZ.reshape(-1, 3)]
    np.testing.assert_allclose(once.values.reshape(-1, BANDS), singly, atol=1e-12)
    assert reflectances_from_colours(np.empty((0, 3))).values.shape == (0, BANDS)


def test_solving_tells_how_far_it_is():
    fractions: list[float] = []
    XYZ = XYZ_from_sRGB(np.linspace([1, 0, 0], [1, 0.1, 0], 70), WHITE)
    reflectances_from_colours(XYZ, "smoothest", progress=fractions.append)
    assert fractions == sorted(fractions) and fractions[-1] == 1


def test_bouguer_keeps_the_hue_and_eq_6_as_printed_has_the_complementary():
    red = reflectance("ColorChecker/red").values

    def hue(S):
        return np.arctan2(*cielab(XYZ_from_spectra(D65, S), WHITE)[:0:-1])

    assert abs(hue(bouguer(red, 2.0)) - hue(red)) < np.radians(15)
    turned = (hue(bouguer(red, 1.0, complementary=True)) - hue(red)) % (2 * np.pi)
    assert abs(turned - np.pi) < np.radians(30)
    np.testing.assert_allclose(bouguer(bouguer(red, 2), 0.5), red, atol=1e-12)


def test_a_base_may_be_ones_own():
    base = base_spectra(powers=(2,), complementary=(1,))
    assert len(base) == 2 + 3 * 533 + 120 and base.names[-121].startswith("10^(-1 Vrhel/")
    names = ("black", "white", "red", "blue")
    paints = BaseSpectra(names, [[0] * BANDS, [1] * BANDS, TRUE[14], TRUE[12]])
    mix = reflectances_from_colours(XYZ_from_spectra(D65, paints.values).mean(0), base=paints).mix()
    assert mix == pytest.approx(dict.fromkeys(names, 0.25))
    assert pickle.loads(pickle.dumps(paints)).names == names


@pytest.mark.parametrize("method", ["otsu-2018", "Mallett 2019", "smits-1999", "Jakob 2019"])
def test_other_methods_go_by_name(method):
    made = reflectances_from_colours(XYZ_from_spectra(D65, TRUE[[1, 21]]), method)
    assert made.counts() == {"recovered": 2}
    assert made.values.min() >= 0 and made.values.max() <= 1
    assert errors(made.values, TRUE[[1, 21]], D65).max() < 3


@pytest.mark.not_quick
def test_meng_is_exact_on_our_grid():
    XYZ = XYZ_from_spectra(D65, TRUE[1])
    paint = reflectance_from_colour(XYZ, "meng-2015")
    np.testing.assert_allclose(XYZ_from_spectra(D65, paint), XYZ, atol=1e-4)
    assert paint.notes["constructed"] == "meng-2015" and "meng-2015" in METHODS


def test_white_is_white_under_every_light():
    for name in ("D65", "A", "FL2"):
        np.testing.assert_allclose(reflectance_from_colour("#fff", light=name).values, 1, atol=1e-6)
    np.testing.assert_allclose(colour_XYZ("Black", WHITE), 0)
    np.testing.assert_allclose(colour_XYZ("Light Blue", WHITE), colour_XYZ("#ADD8E6", WHITE))
    np.testing.assert_allclose(colour_XYZ("20, 21, 22", WHITE), [20, 21, 22])


BASE = base_spectra()
HARDLY_ABOVE_1 = np.full((4, BANDS), 1) + np.array([[0, 0, 0, 5e-7]]).T


def mismatched() -> MadeReflectances:
    made = reflectances_from_colours([20, 20, 20])
    return MadeReflectances(made.values, made.route, made.vertices, np.zeros(3), made.base)


@pytest.mark.parametrize(
    ("fault", "make"),
    [
        *(
            (code, lambda f, colour=colour: reflectance_from_colour(colour))
            for colour, code in (
                ("tomatoe", "unknown"),
                ("#12345", "syntax"),
                ("1 2", "shape"),
                ([20, -1, 3], "range"),
                ([255, 128, 0], "range"),
                ([1, 2], "shape"),
                ([[1, 2, 3]] * 2, "shape"),
                ([1, "a", 3], "type"),
            )
        ),
        ("unknown", lambda f: reflectance_from_colour("red", "delauny")),
        ("unknown", lambda f: reflectance_from_colour("red", light="D56")),
        # A sodium lamp has no blue, so that Z is too much where Y is not.
        ("range", lambda f: reflectance_from_colour([41, 35, 12], light="LPS")),
        ("range", lambda f: reflectances_from_colours([[1, 2, 3], [1, 2, -3]])),
        ("shape", lambda f: reflectances_from_colours([1, 2])),
        ("conflict", lambda f: reflectances_from_colours([1, 2, 3], grid=FINE, base=BASE)),
        ("range length", lambda f: base_spectra(powers=(0,))),
        ("range", lambda f: bouguer([1.5], 2)),
        ("shape", lambda f: BaseSpectra(("a", "b"), np.zeros((3, BANDS)))),
        ("range", lambda f: BaseSpectra(tuple("abcd"), HARDLY_ABOVE_1)),
        ("shape", lambda f: mismatched()),
        ("unsupported", lambda f: write_spectrum(D65, f / "paint.txt")),
    ],
)
def test_no_colour_is_refused(tmp_path, make, fault):
    fails(make, tmp_path, fault)


def test_a_written_spectrum_is_read_as_a_material(tmp_path):
    paint = reflectance_from_colour("#c08040")
    write_spectrum(paint, tmp_path / "paint.csv")
    back = reflectance(str(tmp_path / "paint.csv"))
    np.testing.assert_allclose(back.values, paint.values, atol=1e-9)
    assert back.notes.items() >= paint.notes.items()
    assert reflectance_from_colour("red").notes["constructed"] == "extended"
