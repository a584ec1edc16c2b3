"""Light groups: each has its own light, and switching one off never darkens the picture."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import refuses
from tests.support.relighting import grouped_cast
from volspec.basis import MODES, Basis
from volspec.relight import Illumination, error_map
from volspec.spectra import XYZ_from_spectra, colour_matching_functions, white_XYZ

A, D65, FL2 = map(vs.light, ("A", "D65", "FL2"))
GENERAL = vs.SpectralBasis.load("general-7")
PAINTS = vs.MaterialBasis({name: vs.reflectance(name) for name in ("gold", "copper")})
SHARES = {"key": 0.7, "fill": 0.2, "rim": 0.1}


def cast(basis: Basis = GENERAL, shares: dict[str, float] = SHARES) -> vs.CoefficientImage:
    return grouped_cast(shares, basis)


def lit(image: vs.CoefficientImage, rig: vs.Spectrum | vs.LightRig, **how: object) -> Illumination:
    return Illumination.of(image.basis, rig, vs.RelightSpec(**how), image.groups)


def XYZ(image: vs.CoefficientImage, rig: vs.Spectrum | vs.LightRig, **how: object) -> np.ndarray:
    return lit(image, rig, **how).scene_XYZ(image.coefficients, image.alpha)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("basis", [GENERAL, PAINTS], ids=["spectra", "materials"])
def test_groups_are_the_sum_of_pictures_of_one_group_each(basis, mode):
    image = cast(basis)
    lights, lux = dict(zip(SHARES, (A, D65, FL2), strict=True)), (300.0, 800.0, 50.0)
    how = {"mode": mode, "level": "absolute", "backdrop": 0.0}
    together = XYZ(image, vs.LightRig(tuple(lights.values()), (), lux, tuple(lights)), **how)
    total = np.zeros_like(together)
    for (name, lamp), own_lux in zip(lights.items(), lux, strict=True):
        alone = vs.CoefficientImage(image.layer(name), image.alpha, image.depth_mm, basis)
        total += XYZ(alone, vs.LightRig((lamp,), illuminance_lux=(own_lux,)), **how)
    np.testing.assert_allclose(together, total, rtol=1e-12)


@pytest.mark.parametrize("mode", MODES)
def test_lights_of_several_groups_add_up_with_their_backdrop(mode):
    image = cast()
    how = {"mode": mode, "level": "absolute", "backdrop": vs.reflectance("ColorChecker/red")}
    lux, groups = (300.0, 800.0, 50.0), ("key", "fill", "rim")

    def under(*weights: float) -> np.ndarray:
        return XYZ(image, vs.LightRig((A, D65, FL2), weights, lux, groups), **how)

    parts = under(1, 0, 0), under(0, 0.5, 0), under(0, 0, 2)
    np.testing.assert_allclose(under(1, 0.5, 2), sum(parts), rtol=1e-12)


@pytest.mark.parametrize("weights", [w for w in itertools.product((0, 1), repeat=3) if any(w)])
@pytest.mark.parametrize("mode", MODES)
def test_white_that_faces_every_source_is_the_adopted_white(mode, weights):
    """Y = 100 whatever is switched off: the first pixel is that diffuser."""
    image = cast()
    rig = vs.LightRig((A, D65, FL2), weights, groups=("key", "fill", "rim"))
    # XYZ of a sum of lights: by the luminous energies in which they reach the surface.
    Y = np.array([colour_matching_functions(GENERAL.grid)[1] @ E.values for E in (A, D65, FL2)])
    part = Y * weights * list(SHARES.values())
    white = part @ [white_XYZ(E) for E in (A, D65, FL2)] / part.sum()
    found = lit(image, rig, mode=mode)
    np.testing.assert_allclose(found.white_XYZ, white, rtol=1e-12)
    assert found.white_XYZ[1] == pytest.approx(100, rel=1e-12)
    # float32 coefficients.
    np.testing.assert_allclose(XYZ(image, rig, mode=mode)[0, 0], white, rtol=1e-6)


def test_exact_mode_is_all_bands_where_each_group_has_its_own_light():
    shares, names = {"key": 0.6, "fill": 0.4}, ("ColorChecker/orange", "ColorChecker/blue sky")
    S = GENERAL.synthesise(GENERAL.analyse([vs.reflectance(name) for name in names]))
    facing = np.array([[0.9, 0.1], [0.2, 1.0]])[:, None] * list(shares.values())
    coefficients = (facing[..., None] * GENERAL.analyse(S)[:, None, None]).reshape(2, 1, -1)
    one = np.ones((2, 1), np.float32)
    image = vs.CoefficientImage(coefficients.astype("f4"), one, one, GENERAL, groups=shares)
    E = np.array([A.values, 2 * FL2.values])
    Q = colour_matching_functions(GENERAL.grid)
    kappa = 100 / (Q[1] @ (np.array(list(shares.values())) @ E))
    truth = kappa * ((facing[:, 0] @ E) * S) @ Q.T
    rig = vs.LightRig((A, FL2), (1, 2), groups=("key", "fill"))
    # float32 coefficients, and rows that meet each light's white exactly.
    np.testing.assert_allclose(XYZ(image, rig, mode="exact")[:, 0], truth, rtol=1e-5)


def merged(image: vs.CoefficientImage) -> vs.CoefficientImage:
    """Return the image of one group that has the light of all."""
    total = sum(image.layer(name) for name in SHARES)
    return vs.CoefficientImage(total, image.alpha, image.depth_mm, GENERAL)


def test_a_light_of_no_group_shines_from_all():
    image = cast()
    everywhere = vs.LightRig((A, A, A), groups=("key", "fill", "rim"))
    for rig in (A, vs.LightRig((A,)), vs.LightRig((A,), groups=("",))):
        np.testing.assert_allclose(XYZ(image, rig), XYZ(image, everywhere), rtol=1e-12)
    # Sums of float32 coefficients.
    np.testing.assert_allclose(XYZ(merged(image), A), XYZ(image, A), rtol=1e-6)
    both = vs.LightRig((A, FL2), groups=("", "key"))
    listed = vs.LightRig((A, FL2, A, A), groups=("key", "key", "fill", "rim"))
    np.testing.assert_allclose(XYZ(image, both), XYZ(image, listed), rtol=1e-12)


def test_a_group_without_light_stays_dark():
    image = cast()
    matrix = lit(image, vs.LightRig((A, D65), (1, 0), groups=("key", "fill"))).XYZ_from_channels
    assert matrix[:, :7].any() and not matrix[:, 7:].any()
    only = lit(image, vs.LightRig((A,), groups=("key",)))
    assert np.array_equal(only.XYZ_from_channels, matrix)


def test_lux_is_what_a_light_gives_from_all_groups():
    all_lux, own_lux = 1500.0, 0.7 * 1000 + 0.2 * 500
    cases = ((), all_lux), (("key", "fill"), own_lux), (("", "rim"), 1000 + 0.1 * 500)
    for groups, expected in cases:
        rig = vs.LightRig((A, D65), illuminance_lux=(1000.0, 500.0), groups=groups)
        found = lit(cast(), rig, level="absolute", viewing=vs.Viewing(illuminance_lux=2000.0))
        assert found.illuminance_lux == pytest.approx(expected)
        white = XYZ_from_spectra(rig.facing(SHARES).mixed(GENERAL.grid), np.ones(GENERAL.grid.size))
        backdrop = 0.2 * white * expected / 2000
        np.testing.assert_allclose(found.backdrop_XYZ, backdrop, rtol=1e-12)


def test_a_dim_group_alone_looks_dim_at_relative_level():
    found = lit(cast(), vs.LightRig((A, D65), (1, 0), (1000.0, 1000.0), ("fill", "key")))
    assert found.white_XYZ[1] == pytest.approx(100)
    assert found.viewing.illuminance_lux == pytest.approx(200)


def test_the_error_map_of_groups_is_that_of_their_sum_where_one_light_shines():
    image = cast()
    found, truth = (error_map(each, vs.light("FL4")) for each in (image, merged(image)))
    # Sums of float32 coefficients.
    np.testing.assert_allclose(found.delta_e, truth.delta_e, atol=1e-3)
    rig = vs.LightRig((vs.light("FL4"), A), groups=("key", "rim"))
    assert error_map(image, rig).max > 0
    assert error_map(image, rig, mode="exact").max == 0


UNLIT = cast(shares={"key": 1.0, "off": 0.0})
DARK = vs.LightRig((A, A), (), (0.0, 1.0), ("key", "off"))
KEY = vs.LightRig((A,), groups=("key",))
NIGHT = vs.Spectrum([390, 710], [0.0, 0.0], name="night")


def of_rig(*lights: vs.Spectrum, **rig: object) -> Callable[[], object]:
    return lambda: lit(cast(), vs.LightRig(lights, **rig))


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (of_rig(A, groups=("kye",)), "unknown "),
        (of_rig(A, A, groups=("key", "sun")), "unknown "),
        (of_rig(A, A, groups=("key",)), "shape LightRig.groups"),
        (of_rig(A, groups="key"), "type LightRig.groups"),
        (of_rig(A, groups=(3,)), "type LightRig.groups[0]"),
        (of_rig(A, weights=(0,), groups=("key",)), "impossible LightRig.weights"),
        (of_rig(A, NIGHT), "conflict "),
        (of_rig(A, NIGHT, groups=("key", "fill")), "conflict "),
        (lambda: lit(UNLIT, vs.LightRig((A,), groups=("off",))), "invalid "),
        (lambda: lit(UNLIT, DARK), "impossible LightRig.illuminance_lux"),
        (lambda: lit(cast(), KEY, level="absolute"), "missing LightRig.illuminance_lux"),
    ],
)
def test_groups_that_do_not_fit_are_refused(make, fault):
    refuses(make, fault)
