"""Domain of a model: a mask for every colour, inside which the inverse returns the colour."""

import numpy as np
import pytest

from tests.appearance._models import ACES, CONDITIONS, apart, colours, cube, spectral_mixtures
from tests.appearance.test_models_edges import ENDS
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.models import APPEARANCE_MODELS, cam16, ciecam02
from volspec.appearance.models.base import opponents
from volspec.appearance.models.cam import CamConditions, compress

# Models whose formulas take powers of what may turn negative.
CAMS = ("CIECAM02", "CAM16")
# Y = 100 for white: Rec. 2020, and ACES AP0 with its imaginary blue.
REC_2020, ACES_AP0 = (space.XYZ_from_RGB.T for space in (SPACES["Rec. 2020"], ACES))


def everything(conditions):
    """(N, 3): cubes, surfaces down to nothing, lasers, and anything around them."""
    rng = np.random.default_rng(6)
    return np.concatenate(
        [
            cube(9) @ REC_2020,
            cube(9) @ ACES_AP0,
            colours(conditions.white_XYZ, 1000),
            spectral_mixtures(1500),
            rng.uniform(-50.0, 150.0, (1500, 3)),
            rng.random((1500, 3)) * 10.0 ** rng.uniform(-6.0, 2.3, (1500, 1)),
        ]
    )


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_what_is_defined_comes_back(name):
    for where, conditions in CONDITIONS.items():
        model = APPEARANCE_MODELS[name]
        XYZ = everything(conditions)
        seen = model.forward(XYZ, conditions)
        assert seen.defined.dtype == bool and seen.defined.shape == XYZ.shape[:-1]
        back = model.inverse(seen.J, seen.C, seen.h, conditions)
        error = np.where(seen.defined, apart(back, XYZ), 0.0)
        i = int(np.argmax(error))
        # Digits lost to opponent sums and powers; measured 1e-12.
        assert error[i] <= 1e-9, (name, where, XYZ[i], back[i], error[i])


@pytest.mark.parametrize("name", CAMS)
def test_surfaces_black_and_rec_2020_lie_within(name):
    for conditions in CONDITIONS.values():
        for XYZ in (colours(conditions.white_XYZ), cube() @ REC_2020, np.zeros(3)):
            assert np.all(APPEARANCE_MODELS[name].forward(XYZ, conditions).defined)


def published_sums(XYZ, conditions, name):
    """A / N_bb (eq. 35) and the sum under t (eq. 34) as printed, with the 0.1 of eq. 28."""
    a = compress(XYZ @ CamConditions.of_viewing(conditions, name).response_from_XYZ().T) + 0.1
    return a @ [2.0, 1.0, 0.05] - 0.305, a @ [1.0, 1.0, 1.05]


@pytest.mark.parametrize("name", CAMS)
def test_what_is_not_defined_is_nan_as_published(name):
    """Powers of negative numbers, all but 1 in 500 of the widest colours: ours has two floors."""
    for conditions in CONDITIONS.values():
        rng = np.random.default_rng(8)
        XYZ = np.concatenate(
            [cube() @ REC_2020, cube() @ ACES_AP0, rng.uniform(-50, 150, (5000, 3))]
        )
        defined = APPEARANCE_MODELS[name].forward(XYZ, conditions).defined
        A, total = published_sums(XYZ, conditions, name)
        with np.errstate(invalid="ignore"):
            nan = np.isnan(A**0.5 * total**-0.9)
        nan[0] = nan[17**3] = False  # black: A = 0
        assert not defined[nan].any()
        assert (~defined & ~nan).mean() < 2e-3
        assert 10 < np.count_nonzero(nan[17**3 : 2 * 17**3]) < 100


@pytest.mark.parametrize("each", [ciecam02, cam16])
def test_inverse_of_what_nothing_looks_like_is_nan(each):
    conditions = CONDITIONS["office under D65"]
    nothing = [(-1.0, 0.0, 0.0), (0.0, 5.0, 40.0), (50.0, 1e4, 250.0), (1e6, 0.0, 0.0)]
    for J, C, h in nothing:
        assert np.isnan(each.inverse(J, C, h, conditions)).all(), (J, C, h)
    assert np.isnan(each.inverse(np.nan, 0.0, 0.0, conditions)).all()
    np.testing.assert_array_equal(each.inverse(0.0, 0.0, 77.0, conditions), np.zeros(3))


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_inverse_gives_what_is_defined_and_looks_so_or_nan(name):
    """Appearances down to the faintest and to the most chromatic."""
    for conditions in ENDS.values():
        model, rng = APPEARANCE_MODELS[name], np.random.default_rng(3)
        J, C, h = rng.uniform([0.0, 0.0, 0.0], [140.0, 200.0, 360.0], (3000, 3)).T
        J[:400], C[200:800] = 10.0 ** rng.uniform(-9, 0, 400), 10.0 ** rng.uniform(-6, 1, 600)
        back = model.inverse(J, C, h, conditions)
        known = np.isfinite(back).all(axis=-1)
        assert 0.03 < known.mean() < 1.0
        seen = model.forward(back[known], conditions)
        assert seen.defined.all()
        asked, found = opponents(name, J, C, h)[known], opponents(name, seen.J, seen.C, seen.h)
        off = np.abs(found - asked).max(axis=-1) / np.maximum(np.abs(asked).max(axis=-1), 1.0)
        # Next to the border a hair of J moves XYZ by whites. By ZCAM a C of 100 is nearly grey in
        # the dark: XYZ carry few digits of it.
        usual = 1e-6 if name == "ZCAM" and conditions.L_A == 0.0 else 1e-9
        assert off.max() <= 1e-6 and np.quantile(off, 0.95) <= usual


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_inverse_is_the_continued_one_where_forward_is_defined(name):
    conditions, model = CONDITIONS["room under A"], APPEARANCE_MODELS[name]
    XYZ = everything(conditions)
    seen = model.forward(XYZ, conditions)
    back, on = (f(seen.J, seen.C, seen.h, conditions) for f in (model.inverse, model.invert_beyond))
    np.testing.assert_array_equal(back[seen.defined], on[seen.defined])
    beyond = ~seen.defined & (apart(on, XYZ) < 1e-9)
    assert np.isnan(back[beyond]).all()
