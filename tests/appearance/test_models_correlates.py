"""Correlates that few models have: whiteness-blackness, normalised lightness, and Hunt's rods."""

import numpy as np
import pytest
from colour.appearance import hunt as colour_hunt

from tests.appearance._models import CONDITIONS, D65, colours
from volspec.appearance import ViewingConditions
from volspec.appearance.models import APPEARANCE_MODELS, hunt, nayatani95
from volspec.appearance.models.hunt import HuntConditions

OFFICE = CONDITIONS["office under D65"]


@pytest.mark.parametrize("where", CONDITIONS)
def test_hunts_whiteness_blackness_is_0_on_the_background_and_rises_with_brightness(where):
    conditions = CONDITIONS[where]
    eye = HuntConditions.of(conditions, hunt.NORMAL)
    greys = np.asarray(conditions.white_XYZ) * np.array([[0.0], [eye.n], [0.7], [1.0]])
    seen = hunt.forward(greys, conditions)
    assert float(seen.Q_WB[1]) == pytest.approx(0.0, abs=1e-9)
    order = np.argsort(seen.Q)
    assert np.all(np.diff(seen.Q_WB[order]) >= 0.0)
    # Eq. 55 by hand.
    Q, Q_b = float(seen.Q[3]), float(seen.Q[1])
    assert float(seen.Q_WB[3]) == pytest.approx(20.0 * (Q**0.7 - Q_b**0.7))


@pytest.mark.parametrize("each", [hunt, nayatani95])
def test_more_light_makes_white_whiter_and_black_blacker(each):
    """The Stevens effect, which both quantities are there to show."""
    patches = np.asarray(D65) * np.array([[0.03], [0.9]])
    dim, bright = (each.forward(patches, ViewingConditions(D65, L)).Q_WB for L in (5.0, 500.0))
    assert bright[0] < dim[0] < 0.0 < dim[1] < bright[1]


def test_hunts_own_background_counts():
    dark = hunt.HuntSettings(background_XYZ=(4.75, 5.0, 5.44))
    conditions = CONDITIONS["prints under D50"]
    grey = 0.2 * np.asarray(conditions.white_XYZ)
    assert float(hunt.forward(grey, conditions, dark).Q_WB) > 1.0
    assert float(hunt.forward([4.75, 5.0, 5.44], conditions, dark).Q_WB) == pytest.approx(0.0)


def test_other_models_have_neither():
    for name in ("CIECAM02", "CAM16", "CIELAB", "RLAB"):
        seen = APPEARANCE_MODELS[name].forward(D65, OFFICE)
        assert seen.Q_WB is None and seen.L_N is None
    assert hunt.forward(D65, OFFICE).L_N is None


@pytest.mark.parametrize("where", CONDITIONS)
def test_hunt_with_scotopic_data_goes_both_ways(where):
    conditions = CONDITIONS[where]
    XYZ = colours(conditions.white_XYZ, 2000)
    S = 1.5 * np.random.default_rng(3).random(len(XYZ))
    seen = hunt.forward(XYZ, conditions, S=S)
    back = hunt.inverse(seen.J, seen.C, seen.h, conditions, S=S)
    error = np.abs(back - XYZ).max(axis=-1) / np.maximum(XYZ.max(axis=-1), 1e-3)
    assert error[seen.defined].max() <= 1e-9


def test_scotopic_data_enter_as_in_colour_sciences_parts():
    """`XYZ_to_Hunt` itself cannot be given them (see the faults); its eq. 47-51 can."""
    conditions = CONDITIONS["dusk, half dim"]
    eye, XYZ = HuntConditions.of(conditions, hunt.NORMAL), np.array([19.01, 20.0, 21.78])
    seen = [hunt._signals(XYZ, np.asarray(S), eye)[3] for S in (0.1, 0.9)]
    L_AS = 2.26 * eye.scotopic / 5.0
    theirs = [colour_hunt.achromatic_signal(L_AS, S, 1.0, eye.N_bb, 0.0) for S in (0.1, 0.9)]
    assert float(seen[1] - seen[0]) == pytest.approx(float(theirs[1] - theirs[0]), rel=1e-9)
    # Blue is brighter at dusk than its Y: Purkinje.
    plain, rods = (hunt.forward(XYZ, conditions, S=S).Q for S in (None, 0.9))
    assert rods > plain
