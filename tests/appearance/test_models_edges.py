"""Appearance models at their ends, and the correlates that few of them have."""

from pathlib import Path

import numpy as np
import pytest
from colour.appearance import hunt as colour_hunt

from tests.appearance._models import CONDITIONS, D65, A, apart, colours
from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import APPEARANCE_MODELS, hunt, nayatani95, rlab
from volspec.appearance.models.hunt import HuntConditions
from volspec.appearance.spec import MODELS as VIEWED
from volspec.cli.appearance import NOTES

ENDS = {
    **CONDITIONS,
    "no light": ViewingConditions(D65, 0.0, 20.0),
    "black background": ViewingConditions(D65, 63.66, 0.0),
    "neither": ViewingConditions(A, 0.0, 0.0, "dark"),
    "glare": ViewingConditions(A, 1e8, 1000.0),
    "monochromatic": ViewingConditions((150.0, 100.0, 1e-4), 50.0, 20.0),
}


def correlates(seen):
    return [value for name in "JChHQMs" if (value := getattr(seen, name)) is not None]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_forward_gives_numbers_for_every_finite_colour(name):
    for where, conditions in ENDS.items():
        rng = np.random.default_rng(5)
        for size in (1e5, 1.0, 1e-9, 0.0):
            XYZ = rng.uniform(-size, size, (500, 3))
            for value in correlates(APPEARANCE_MODELS[name].forward(XYZ, conditions)):
                assert np.isfinite(value).all(), (name, where, size)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_inverse_gives_numbers_or_nan_and_no_warning(name):
    for conditions in ENDS.values():
        lightness = [-5.0, 0.0, 1e-9, 30.0, 100.0, 250.0]
        J, C, h = np.meshgrid(lightness, [0.0, 1.0, 300.0], [0.0, 200.0])
        for backwards in (APPEARANCE_MODELS[name].inverse, APPEARANCE_MODELS[name].invert_beyond):
            back = backwards(J, C, h, conditions)
            assert not np.isinf(back).any()
            assert (np.isnan(back).all(axis=-1) == np.isnan(back).any(axis=-1)).all()
        if name in ("CIELAB", "RLAB"):
            assert np.isfinite(back).all()


def test_surround_moves_rlab_and_hunt_smoothly_between_the_named_ones():
    assert rlab.exponent(0.0) == pytest.approx(1 / 3.5)
    assert rlab.exponent("dim") == rlab.exponent(0.1) == pytest.approx(1 / 2.9)
    assert rlab.exponent(0.15) == pytest.approx((1 / 2.9 + 1 / 2.3) / 2)
    assert rlab.exponent(1.0) == rlab.exponent("average") == pytest.approx(1 / 2.3)
    expected = {0.0: (0.7, 10.0), 0.1: (1.0, 25.0), 0.2: (1.0, 75.0), 0.05: (0.85, 17.5)}
    for surround, factors in expected.items():
        eye = HuntConditions.of(ViewingConditions(D65, surround=surround), hunt.NORMAL)
        assert (eye.N_c, eye.N_b) == pytest.approx(factors)


def test_darker_surrounds_lower_contrast_and_light_raises_colourfulness():
    """Bartleson-Breneman in RLAB and Hunt; the Hunt effect in Hunt and Nayatani."""
    greys = np.array(D65) * np.array([[0.1], [0.5]])
    rooms = [ViewingConditions(D65, surround=name) for name in ("dark", "dim", "average")]
    for each in (rlab, hunt):
        ratio = [np.divide(*each.forward(greys, room).J) for room in rooms]
        assert ratio[0] > ratio[1] > ratio[2]
    levels = [ViewingConditions(D65, L_A) for L_A in (1.0, 30.0, 1000.0)]
    for each in (hunt, nayatani95):
        M = [each.forward([57.06, 43.06, 31.96], level).M for level in levels]
        assert M[0] < M[1] < M[2]


def test_every_model_has_its_name_and_its_notes():
    assert {each.NAME for each in APPEARANCE_MODELS.values()} == set(APPEARANCE_MODELS)
    # Every setting of a viewing is reported, and noted in the comparison picture.
    assert sorted(VIEWED) == sorted([*APPEARANCE_MODELS, *ADAPTATIONS]) == sorted(NOTES)


@pytest.mark.parametrize("each", [rlab, hunt])
def test_degree_of_adaptation_runs_from_none_discounted_to_all(each):
    XYZ = colours(A)[7:50]

    def seen(**others):
        return each.forward(XYZ, ViewingConditions(A, 63.66, **others))

    for one, other in ((seen(D=0.0), seen()), (seen(D=1.0), seen(discount=True))):
        for name in "JCh":
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    white = [each.forward(A, ViewingConditions(A, 63.66, D=D)).C for D in (0.0, 0.5, 1.0)]
    # What is not discounted stays yellow.
    assert white[0] > white[1] > white[2] and white[2] < 0.2


def test_example_of_the_docs_runs_as_written():
    page = (Path(__file__).parents[2] / "docs" / "models.md").read_text(encoding="utf-8")
    code, *_ = page.split("```python\n")[1].split("```")
    space: dict = {}
    exec(code, space)
    assert f'# "{space["composition"](space["look"].H)}"' in code
    np.testing.assert_allclose(space["XYZ"], [57.06, 43.06, 31.96], rtol=1e-12)


@pytest.mark.parametrize("where", CONDITIONS)
def test_hunts_whiteness_blackness_is_0_on_the_background_and_rises_with_brightness(where):
    conditions = CONDITIONS[where]
    eye = HuntConditions.of(conditions, hunt.NORMAL)
    greys = np.asarray(conditions.white_XYZ) * np.array([[0.0], [eye.n], [0.7], [1.0]])
    seen = hunt.forward(greys, conditions)
    assert float(seen.Q_WB[1]) == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(seen.Q_WB[np.argsort(seen.Q)]) >= 0.0)
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


@pytest.mark.parametrize("where", CONDITIONS)
def test_hunt_with_scotopic_data_goes_both_ways(where):
    conditions = CONDITIONS[where]
    XYZ = colours(conditions.white_XYZ, 2000)
    S = 1.5 * np.random.default_rng(3).random(len(XYZ))
    seen = hunt.forward(XYZ, conditions, S=S)
    back = hunt.inverse(seen.J, seen.C, seen.h, conditions, S=S)
    assert apart(back, XYZ)[seen.defined].max() <= 1e-9


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
