"""Appearance models backwards: formulas, one unknown for Hunt, and the numerical inverse."""

from dataclasses import replace

import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, D65, apart, colours, spectral_mixtures
from tests.appearance.test_models_edges import ENDS
from tests.support.fixtures import slow_each
from volspec.appearance import ViewingConditions
from volspec.appearance.models import APPEARANCE_MODELS, hunt, nayatani95, rlab
from volspec.appearance.models.lab import cielab
from volspec.appearance.models.numeric import find_root, invert, nearest_inverse
from volspec.appearance.scene_to_display import ModelTransform


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_continued_undoes_forward_up_to_the_spectral_locus(name):
    for where, conditions in CONDITIONS.items():
        model = APPEARANCE_MODELS[name]
        # CIECAM02 gives the bluest mixtures no lightness.
        lasers = [] if name == "CIECAM02" else [spectral_mixtures()]
        XYZ = np.concatenate([colours(conditions.white_XYZ, 3000), *lasers])
        seen = model.forward(XYZ, conditions)
        error = apart(model.invert_beyond(seen.J, seen.C, seen.h, conditions), XYZ)
        i = int(np.argmax(error))
        # Digits lost to the opponent sums and powers; measured below 2e-10.
        assert error[i] <= 1e-9, (name, where, XYZ[i], error[i])


@pytest.mark.not_quick
@pytest.mark.parametrize("name", APPEARANCE_MODELS)
@pytest.mark.parametrize("where", ["television", "light box, white around"])
def test_numerical_inverse_undoes_forward(name, where):
    conditions, model = CONDITIONS[where], APPEARANCE_MODELS[name]
    XYZ = colours(conditions.white_XYZ, count=60)[:-1]
    seen = model.forward(XYZ, conditions)
    back = invert(model.forward, seen.J, seen.C, seen.h, conditions)
    found = np.isfinite(back).all(axis=-1)
    # Chroma has no slope at a neutral, nor Nayatani's where lightness is 0: few get lost.
    assert np.count_nonzero(~found) <= 3, XYZ[~found]
    assert apart(back[found], XYZ[found]).max() <= 1e-9
    assert invert(model.forward, *np.zeros((3, 0)), conditions).shape == (0, 3)


def test_numerical_inverse_is_nan_where_nothing_looks_so():
    conditions = CONDITIONS["office under D65"]
    # RLAB's lightness has no bounds; Hunt's ends where the cones are saturated.
    assert np.isnan(invert(hunt.forward, 1e5, 20.0, 40.0, conditions, iterations=10)).all()
    assert np.isnan(hunt.inverse(1e5, 20.0, 40.0, conditions)).all()
    assert np.isnan(nayatani95.inverse(0.0, 20.0, 40.0, conditions)).all()


@pytest.mark.parametrize("source", CONDITIONS)
@pytest.mark.parametrize("target", ["television", "cinema", "room under A"])
def test_rlab_s_view_transform_is_inverse_after_forward(source, target):
    here, there = CONDITIONS[source], CONDITIONS[target]
    XYZ = colours(here.white_XYZ, count=2000)
    seen = rlab.forward(XYZ, here)
    two_steps = rlab.inverse(seen.J, seen.C, seen.h, there)
    transform = rlab.view_transform(here, there)
    np.testing.assert_allclose(transform.apply(XYZ), two_steps, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(transform.undo(two_steps), XYZ, rtol=1e-10, atol=1e-10)


HUNT = hunt.HuntSettings(N_b=25.0, L_AS=30.0, proximal_XYZ=(30.0, 25.0, 20.0))


@pytest.mark.parametrize(
    ("each", "settings"),
    [
        *(
            (hunt, replace(HUNT, p=p, helson_judd=effect))
            for p in (-1.0, 0.0, 0.6)
            for effect in (False, True)
        ),
        (nayatani95, nayatani95.NayataniSettings(E_or=3000.0, n=3.0)),
    ],
)
def test_models_with_settings_go_both_ways(each, settings):
    for conditions in CONDITIONS.values():
        XYZ = colours(conditions.white_XYZ, count=500)[:-1]
        seen = each.forward(XYZ, conditions, settings)
        back = each.invert_beyond(seen.J, seen.C, seen.h, conditions, settings)
        assert apart(back, XYZ).max() <= 1e-9


def test_nayatani_strength_of_chroma_is_above_0_at_every_hue():
    """E_s(θ) of eq. 116-118 is a denominator in the inverse."""
    assert nayatani95._strength(np.linspace(0.0, 360.0, 3601)).min() > 0.3


def test_root_finds_every_crossing_to_the_last_digits():
    levels = np.linspace(-7.9, 60.0, 1001)
    ends = np.full_like(levels, -2.0), np.full_like(levels, 4.0)
    found = find_root(lambda x: x**3 - levels, *ends)
    np.testing.assert_allclose(found, np.cbrt(levels), rtol=1e-14, atol=1e-15)
    assert np.isnan(find_root(lambda x: x**2 + 1.0, np.array([-1.0]), np.array([1.0]))).all()


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_shapes_are_kept(name):
    conditions, model = CONDITIONS["room under A"], APPEARANCE_MODELS[name]
    for shape in ((), (0,), (2, 3)):
        seen = model.forward(np.full((*shape, 3), 20.0), conditions)
        assert seen.J.shape == seen.C.shape == seen.h.shape == seen.H.shape == shape
        assert seen.defined.shape == shape and seen.defined.dtype == bool and np.all(seen.defined)
    with np.errstate(invalid="ignore"):
        assert not model.forward([np.nan, 20.0, 20.0], conditions).defined
    assert model.inverse(50.0, np.zeros((2, 3)), 40.0, conditions).shape == (2, 3, 3)


OFFICE, *OTHERS = CONDITIONS
SCENE = ViewingConditions(D65, 63.66)
DIM = ViewingConditions(D65, 0.1)


@pytest.mark.not_quick
@pytest.mark.parametrize("each", [hunt, nayatani95])
@pytest.mark.parametrize("where", [OFFICE, *slow_each(*OTHERS), *sorted(ENDS.keys() - CONDITIONS)])
def test_every_finite_colour_has_a_finite_one_on_every_display(each, where):
    rng = np.random.default_rng(1)
    XYZ = np.concatenate([rng.uniform(-size, size, (10, 3)) for size in (1e5, 100.0, 1e-6, 0.0)])
    for display in ENDS.values():
        shown = ModelTransform(each, each.forward, ENDS[where], display).apply(XYZ)
        assert np.isfinite(shown).all(), display


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_what_the_inverse_knows_is_not_touched(name):
    model = APPEARANCE_MODELS[name]
    seen = model.forward(colours(D65, 500), SCENE)
    plain = model.invert_beyond(seen.J, seen.C, seen.h, SCENE)
    near = nearest_inverse(model, seen.J, seen.C, seen.h, SCENE)
    np.testing.assert_array_equal(near, plain)
    one = nearest_inverse(model, seen.J[3], seen.C[3], seen.h[3], SCENE)
    np.testing.assert_allclose(one, plain[3], rtol=1e-12)


def largest_step(shown):
    """Along ramps (R, N, 3), in CIELAB; what is brighter than the display is cut as it cuts."""
    Lab = cielab(np.clip(shown, 0.0, np.asarray(D65)), D65)
    return np.linalg.norm(np.diff(Lab, axis=1), axis=-1).max(axis=1)


@pytest.mark.not_quick
def test_hunt_on_a_dim_display_has_no_jump_where_its_inverse_ends():
    """Paths from grey to blues and to black: finer steps are smaller ones, as for no jump."""
    ends = np.array([[20.0, -2.0, 110.0], [15.0, 1.0, 90.0], [10.1, 2.2, 50.0], [0.0, 0.0, 0.0]])
    start = 0.2 * np.asarray(D65)

    def ramps(count):
        return start + np.linspace(0.0, 1.0, count)[:, None] * (ends[:, None, :] - start)

    transform = ModelTransform(hunt, hunt.forward, SCENE, DIM)
    seen = hunt.forward(ramps(2001), SCENE)
    known = np.isfinite(hunt.invert_beyond(seen.J, seen.C, seen.h, DIM)).all(axis=-1)
    assert not known.all(axis=1).any() and known.any(axis=1).all()
    coarse, fine = (largest_step(transform.apply(ramps(n))) for n in (2001, 16001))
    # Eight times as many steps, of a fifth; jumps would stay. By black one of L* .2 does.
    assert np.all(fine <= np.maximum(0.2 * coarse, 0.3)), (coarse, fine)


def test_hue_stays_and_lightness_where_a_grey_has_it():
    seen = hunt.forward([15.0, 1.0, 90.0], SCENE)
    near = hunt.forward(nearest_inverse(hunt, seen.J, seen.C, seen.h, DIM), DIM)
    assert near.C < seen.C
    assert float(near.h) == pytest.approx(float(seen.h), abs=1e-6)
    assert float(near.J) == pytest.approx(float(seen.J), abs=1e-6)
