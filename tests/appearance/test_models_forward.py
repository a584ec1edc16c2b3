"""Every appearance model forward, against colour-science 0.4.7 where that is right."""

import warnings
from dataclasses import replace

import colour
import numpy as np
import pytest
from colour.appearance import InductionFactors_Hellwig2022, InductionFactors_ZCAM
from colour.appearance import hunt as colour_hunt

from tests.appearance._models import CONDITIONS, D65, A, apart, colours, worst, worst_hue
from volspec.appearance import ViewingConditions
from volspec.appearance.models import (
    APPEARANCE_MODELS,
    Appearance,
    hellwig2022,
    hunt,
    lab,
    nayatani95,
    rlab,
    zcam,
)
from volspec.appearance.models.base import degree_of_discounting
from volspec.appearance.models.hunt import HuntConditions, cct_mccamy

# Two float64 evaluations of one formula, relative to 1 or the value.
LIMIT = 1e-9


@pytest.fixture(params=CONDITIONS)
def seen(request):
    conditions = CONDITIONS[request.param]
    return conditions, np.asarray(conditions.white_XYZ), colours(conditions.white_XYZ)


def worst_correlates(names, ours, theirs, XYZ):
    for name in names:
        worst(getattr(ours, name), getattr(theirs, name), XYZ, LIMIT, name)


def degree_as_F(conditions: ViewingConditions) -> float:
    """Return F such that its multiple is D: colour-science takes no D but through F."""
    if conditions.D is None:
        return conditions.factors.F
    return conditions.D / (1.0 - np.exp(-(conditions.L_A + 42.0) / 92.0) / 3.6)


@pytest.mark.parametrize("name", ["CIECAM02", "CAM16"])
def test_ciecam02_and_cam16_agree_with_colour_science(seen, name):
    conditions, white, XYZ = seen
    _, c, N_c = conditions.factors
    known = replace(conditions, D=1.0, discount=False) if conditions.discount else conditions
    factors = getattr(colour.appearance, f"InductionFactors_{name}")(degree_as_F(known), c, N_c)
    theirs = getattr(colour, f"XYZ_to_{name}")(
        XYZ[:-1], white, conditions.L_A, conditions.Y_b, factors
    )
    ours = APPEARANCE_MODELS[name].forward(XYZ[:-1], conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    coloured = theirs.C > 1e-6
    # s of a neutral is the square root of rounding, and its hue is rounding alone.
    worst(ours.s[coloured], theirs.s[coloured], XYZ[:-1][coloured], LIMIT, "s")
    worst_correlates("JCQM", ours, theirs, XYZ)
    # Between red and 0 degrees colour-science has another hue quadrature (see the faults).
    bluer = coloured & (ours.h > 21.0) & (ours.h < 237.0)
    worst(ours.H[bluer], theirs.H[bluer], XYZ[:-1][bluer], 1e-6, "H")


def test_cielab_agrees_with_colour_science(seen):
    conditions, white, XYZ = seen
    ours = lab.forward(XYZ[:-1] * (100.0 / white[1]), scaled(conditions))
    white_100 = np.asarray(scaled(conditions).white_XYZ)
    theirs = colour.XYZ_to_Lab(XYZ[:-1] / white[1], colour.XYZ_to_xy(white_100))
    J, C, h = np.moveaxis(colour.models.Lab_to_LCHab(theirs), -1, 0)
    worst(ours.J, J, XYZ, LIMIT, "J")
    worst(ours.C, C, XYZ, LIMIT, "C")
    worst_hue(ours, Appearance(J=J, C=C, h=h, defined=np.isfinite(J)), XYZ, LIMIT)


def scaled(conditions: ViewingConditions) -> ViewingConditions:
    X, Y, Z = conditions.white_XYZ
    return ViewingConditions((100 * X / Y, 100.0, 100 * Z / Y))


def test_rlab_agrees_with_colour_science(seen):
    conditions, white, XYZ = seen
    exponent, D = rlab.exponent(conditions.surround), degree_of_discounting(conditions)
    theirs = colour.XYZ_to_RLAB(XYZ[:-1], white, conditions.L_A, exponent, D)
    ours = rlab.forward(XYZ[:-1], conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    worst_correlates("JCs", ours, theirs, XYZ)
    assert ours.defined.all()


def test_nayatani_agrees_with_colour_science(seen):
    conditions, white, XYZ = seen
    E_o = 100.0 * np.pi * conditions.L_A / conditions.Y_b
    theirs = colour.XYZ_to_Nayatani95(XYZ, white, conditions.Y_b, E_o, 1000.0)
    ours = nayatani95.forward(XYZ, conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    worst(ours.J, theirs.L_star_P, XYZ, LIMIT, "J")
    # colour-science lets chroma turn negative with lightness.
    worst(ours.C, np.abs(theirs.C), XYZ, LIMIT, "C")
    worst(ours.M, np.abs(theirs.M), XYZ, LIMIT, "M")
    worst_correlates("Qs", ours, theirs, XYZ)
    worst(ours.L_N, theirs.L_star_N, XYZ, LIMIT, "L_N")
    components = ours.M * np.cos(np.radians(ours.h)), ours.M * np.sin(np.radians(ours.h))
    np.testing.assert_allclose([ours.M_RG, ours.M_YB], components, rtol=1e-12, atol=1e-12)
    # Q of eq. 104 is what L*_P has over 50.
    worst(ours.Q_WB, theirs.L_star_P - 50.0, XYZ, LIMIT, "Q_WB")
    np.testing.assert_array_equal(ours.defined, ours.J >= 0.0)


def test_hellwig_agrees_with_colour_science(seen):
    conditions, white, XYZ = seen
    _, c, N_c = conditions.factors
    factors = InductionFactors_Hellwig2022(degree_as_F(conditions), c, N_c)
    given = white, conditions.L_A, conditions.Y_b, factors, conditions.discount
    theirs = colour.XYZ_to_Hellwig2022(XYZ[:-1], *given)
    ours = hellwig2022.forward(XYZ[:-1], conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    worst_correlates("JCQMs", ours, theirs, XYZ)
    # Of chroma that is rounding alone, this is its 0.587th power.
    coloured = theirs.C > 1e-6
    worst(ours.J_HK[coloured], theirs.J_HK[coloured], XYZ[:-1][coloured], LIMIT, "J_HK")
    back = colour.Hellwig2022_to_XYZ(theirs, *given)
    own = hellwig2022.inverse(ours.J, ours.C, ours.h, conditions)
    assert apart(own, back).max() <= LIMIT and ours.defined.all()


def test_zcam_agrees_with_colour_science(seen):
    # In cd/m², with the luminance of the background for Y_b.
    conditions, white, XYZ = seen
    scale = conditions.white_luminance / white[1]
    _, c, N_c = conditions.factors
    factors = InductionFactors_ZCAM(c, degree_as_F(conditions), c, N_c)
    own = scale * white, conditions.L_A, scale * conditions.Y_b, factors, conditions.discount
    theirs = colour.XYZ_to_ZCAM(scale * XYZ[:-1], *own)
    ours = zcam.forward(XYZ[:-1], conditions)
    # Their white D65 is rounded elsewhere: 1e-9 of neutrals' chroma, where it has no slope.
    coloured = theirs.C > 1e-2
    worst_hue(ours, theirs, XYZ, 1e-7)
    worst_correlates("JQ", ours, theirs, XYZ)
    for correlate in "CMsH":
        one, other = (getattr(each, correlate)[coloured] for each in (ours, theirs))
        worst(one, other, XYZ[:-1][coloured], 1e-8, correlate)
    back = colour.ZCAM_to_XYZ(theirs, *own) / scale
    assert apart(zcam.inverse(ours.J, ours.C, ours.h, conditions), back).max() <= 1e-8
    assert ours.defined.all()


def colour_science_hunt(XYZ, conditions, **others):
    """XYZ_to_Hunt without its warnings on what it assumes."""
    eye = HuntConditions.of(conditions, hunt.NORMAL)
    white = np.asarray(conditions.white_XYZ)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return colour.XYZ_to_Hunt(
            XYZ,
            white,
            white * (conditions.Y_b / white[1]),
            conditions.L_A,
            colour_hunt.InductionFactors_Hunt(eye.N_c, eye.N_b),
            CCT_w=cct_mccamy(conditions.white_XYZ),
            discount_illuminant=conditions.discount,
            **others,
        )


def hunt_white_brightness(conditions, own_hue):
    """Q_w from colour-science's parts, with e_s at the white's own hue (eq. 40-54)."""
    eye = HuntConditions.of(conditions, hunt.NORMAL)
    white = np.asarray(conditions.white_XYZ)
    light = np.asarray(conditions.L_A), np.asarray(eye.F_L)
    rgb = colour_hunt.chromatic_adaptation(
        white, white, white * eye.n, *light, discount_illuminant=conditions.discount
    )
    differences = colour_hunt.colour_difference_signals(rgb)
    e_s = colour_hunt.eccentricity_factor(colour_hunt.hue_angle(differences) + own_hue)
    M_yb = colour_hunt.yellowness_blueness_response(differences, e_s, eye.N_c, eye.N_bb, eye.F_t)
    M_rg = colour_hunt.redness_greenness_response(differences, e_s, eye.N_c, eye.N_bb)
    A_a = colour_hunt.achromatic_post_adaptation_signal(rgb)
    L_AS = 2.26 * eye.scotopic / 5.0
    A_w = colour_hunt.achromatic_signal(L_AS, eye.Y_w, eye.Y_w, eye.N_bb, A_a)
    return colour_hunt.brightness_correlate(A_w, A_w, np.hypot(M_yb, M_rg), eye.N_b)


# colour-science has no partial degree_of_discounting: D = 0.4 stays out.
HUNT = [name for name in CONDITIONS if CONDITIONS[name].D is None]


@pytest.mark.parametrize("name", HUNT)
def test_hunt_agrees_with_colour_science(name):
    conditions = CONDITIONS[name]
    XYZ, eye = colours(conditions.white_XYZ)[:-1], HuntConditions.of(CONDITIONS[name], hunt.NORMAL)
    theirs, ours = colour_science_hunt(XYZ, conditions), hunt.forward(XYZ, conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    worst_correlates("Qs", ours, theirs, XYZ)
    # J, C and M need Q_w, which colour-science takes with the sample's e_s (see the faults).
    Q_w = hunt_white_brightness(conditions, own_hue=0.0)
    J = colour_hunt.lightness_correlate(eye.n, 1.0, theirs.Q, Q_w)
    C = colour_hunt.chroma_correlate(theirs.s, eye.n, 1.0, theirs.Q, Q_w)
    worst(ours.J, J, XYZ, LIMIT, "J")
    worst(ours.C, np.abs(C), XYZ, LIMIT, "C")
    worst(ours.M, colour_hunt.colourfulness_correlate(eye.F_L, np.abs(C)), XYZ, LIMIT, "M")
    cones = hunt._signals(XYZ, XYZ[:, 1] / eye.Y_w, eye)[0]
    C_123, e_s = (
        colour_hunt.colour_difference_signals(cones),
        colour_hunt.eccentricity_factor(ours.h),
    )
    induced = e_s, eye.N_c, eye.N_bb
    worst(ours.M_RG, colour_hunt.redness_greenness_response(C_123, *induced), XYZ, LIMIT, "M_RG")
    M_YB = colour_hunt.yellowness_blueness_response(C_123, *induced, eye.F_t)
    worst(ours.M_YB, M_YB, XYZ, LIMIT, "M_YB")


def test_hunt_with_helson_judd_agrees_with_colour_science():
    conditions = CONDITIONS["room under A"]
    XYZ = colours(A)[:-1]
    ours = hunt.forward(XYZ, conditions, hunt.HuntSettings(helson_judd=True))
    theirs = colour_science_hunt(XYZ, conditions, helson_judd_effect=True)
    plain = hunt.forward(XYZ, conditions)
    worst_hue(ours, theirs, XYZ, LIMIT)
    worst_correlates("Qs", ours, theirs, XYZ)
    for correlate in "Qs":
        assert np.abs(getattr(ours, correlate) - getattr(plain, correlate)).max() > 0.1


def test_hunt_settings_reach_the_model():
    conditions = CONDITIONS["office under D65"]
    XYZ = colours(D65)[7:50]
    plain = hunt.forward(XYZ, conditions)
    for settings in (
        hunt.HuntSettings(N_b=300.0),
        hunt.HuntSettings(N_c=0.7),
        hunt.HuntSettings(L_AS=1.0),
        hunt.HuntSettings(CCT_kelvin=2856.0),
        hunt.HuntSettings(p=-0.5, proximal_XYZ=(30.0, 20.0, 10.0)),
    ):
        moved = hunt.forward(XYZ, conditions, settings)
        assert np.abs(moved.J - plain.J).max() + np.abs(moved.C - plain.C).max() > 0.1
