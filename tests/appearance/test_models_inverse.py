"""Appearance models backwards: formulas, one unknown for Hunt, and the numerical inverse."""

import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, apart, colours, spectral_mixtures
from tests.support.errors import raises
from volspec.appearance.models import APPEARANCE_MODELS, hunt, nayatani95, rlab
from volspec.appearance.models.numeric import find_root, invert
from volspec.errors import ShapeError


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
@pytest.mark.parametrize("where", CONDITIONS)
def test_continued_undoes_forward_up_to_the_spectral_locus(name, where):
    conditions, model = CONDITIONS[where], APPEARANCE_MODELS[name]
    # CIECAM02 gives the bluest mixtures no lightness.
    lasers = [] if name == "CIECAM02" else [spectral_mixtures()]
    XYZ = np.concatenate([colours(conditions.white_XYZ), *lasers])
    seen = model.forward(XYZ, conditions)
    error = apart(model.continued(seen.J, seen.C, seen.h, conditions), XYZ)
    i = int(np.argmax(error))
    # Digits lost to the opponent sums and powers; measured below 2e-10.
    assert error[i] <= 1e-9, (name, where, XYZ[i], error[i])


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


@pytest.mark.parametrize("helson_judd", [False, True])
@pytest.mark.parametrize("p", [-1.0, 0.0, 0.6])
def test_hunt_with_settings_goes_both_ways(helson_judd, p):
    settings = hunt.HuntSettings(
        N_b=25.0, L_AS=30.0, p=p, proximal_XYZ=(30.0, 25.0, 20.0), helson_judd=helson_judd
    )
    for conditions in CONDITIONS.values():
        XYZ = colours(conditions.white_XYZ, count=500)[:-1]
        seen = hunt.forward(XYZ, conditions, settings)
        back = hunt.continued(seen.J, seen.C, seen.h, conditions, settings)
        assert apart(back, XYZ).max() <= 1e-9


def test_nayatani_with_settings_goes_both_ways():
    settings = nayatani95.NayataniSettings(E_or=3000.0, n=3.0)
    for conditions in CONDITIONS.values():
        XYZ = colours(conditions.white_XYZ, count=500)
        seen = nayatani95.forward(XYZ, conditions, settings)
        back = nayatani95.continued(seen.J, seen.C, seen.h, conditions, settings)
        assert apart(back, XYZ).max() <= 1e-9


def test_nayatani_strength_of_chroma_is_above_0_at_every_hue():
    """E_s(θ) of eq. 116-118 is a denominator in the inverse."""
    assert nayatani95._strength(np.linspace(0.0, 360.0, 3601)).min() > 0.3


def test_root_finds_every_crossing_to_the_last_digits():
    levels = np.linspace(-7.9, 60.0, 1001)
    found = find_root(
        lambda x: x**3 - levels, np.full_like(levels, -2.0), np.full_like(levels, 4.0)
    )
    np.testing.assert_allclose(found, np.cbrt(levels), rtol=1e-14, atol=1e-15)
    assert np.isnan(find_root(lambda x: x**2 + 1.0, np.array([-1.0]), np.array([1.0]))).all()


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_shapes_are_kept_and_wrong_ones_refused(name):
    conditions, model = CONDITIONS["room under A"], APPEARANCE_MODELS[name]
    for shape in ((), (0,), (2, 3)):
        seen = model.forward(np.full((*shape, 3), 20.0), conditions)
        assert seen.J.shape == seen.C.shape == seen.h.shape == seen.H.shape == shape
        assert seen.defined.shape == shape and seen.defined.dtype == bool and np.all(seen.defined)
    with np.errstate(invalid="ignore"):
        assert not model.forward([np.nan, 20.0, 20.0], conditions).defined
    assert model.inverse(50.0, np.zeros((2, 3)), 40.0, conditions).shape == (2, 3, 3)
    with raises(ShapeError, "shape"):
        model.forward(np.zeros((4, 2)), conditions)
    with raises(ShapeError, "shape"):
        model.inverse(np.zeros(3), np.zeros(2), 0.0, conditions)
