"""Settings and arguments of appearance that cannot be: an error names each."""

import numpy as np
import pytest

from tests.appearance._models import D65, A
from tests.support.errors import raises, refuses
from volspec.appearance import Display, Viewing, ViewingConditions
from volspec.appearance.comparison.difference import distance, uniform
from volspec.appearance.display.hdr import Hdr
from volspec.appearance.display.monitors import colour_space, preset
from volspec.appearance.display.spaces import SPACES, ColourSpace, Transfer
from volspec.appearance.gamut_mapping import DisplayGamut
from volspec.appearance.measured import measured_conditions
from volspec.appearance.models import APPEARANCE_MODELS, hunt, model, nayatani95
from volspec.appearance.models.cam import CamConditions
from volspec.errors import InputError, SceneError
from volspec.settings import read_table

DAYLIGHT = ViewingConditions(D65)
NO_GREY = CamConditions.of((250.0, 100.0, 1.0), 4.0, 20.0, D=1.0)
P3 = ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06))
WHITE_XY = (0.3127, 0.329)
# The error's field, and a call with the argument.
CALLS = {
    "ViewingConditions.white_XYZ": ViewingConditions,
    "ColourSpace.primaries_xy": lambda x: ColourSpace("mine", x, WHITE_XY, Transfer.gamma(2)),
    "ColourSpace.transfer": lambda x: ColourSpace("mine", P3, WHITE_XY, x),
    "colour space": colour_space,
    "HuntSettings.proximal_XYZ": lambda x: hunt.HuntSettings(proximal_XYZ=x),
    "HuntSettings.helson_judd": lambda x: hunt.HuntSettings(helson_judd=x),
}


@pytest.mark.parametrize("field", CALLS)
def test_an_argument_that_is_no_number_is_named(field):
    for bad in ("abc", ("a", "b", "c"), {}, object(), [[1], [2, 3]]):
        with raises(InputError) as caught:
            CALLS[field](bad)
        assert caught.value.field.split("[")[0] == field
        assert caught.value.remedy and len(str(caught.value)) < 260


WHITES = (D65, list(D65), np.array(D65), np.float32([95, 100, 108]))


@pytest.mark.parametrize("white", WHITES, ids=range(4))
def test_a_white_of_any_kind_of_numbers_is_taken(white):
    taken = ViewingConditions(white).white_XYZ
    assert all(type(value) is float for value in taken)
    np.testing.assert_allclose(taken, white)


def measure(**change):
    given = {"Y": np.ones((4, 4)), "white_XYZ": D65, "fov_deg": 30.0, "luminance_of_white": 100.0}
    return measured_conditions(**(given | change))


def display(**space):
    """Read a measured display from a scene's table."""
    table = {"primaries_xy": P3, "white_xy": WHITE_XY, **space}
    return read_table(Display, {"space": table}, SceneError)


def space(primaries, white=WHITE_XY):
    return ColourSpace("mine", primaries, white, Transfer.gamma(2.4))


TRIANGLE = ((0.6, 0.3), (0.3, 0.6), (0.15, 0.06))
REFUSED = [
    ("unknown Viewing.model", lambda: Viewing(model="ciecam")),
    ("unknown Viewing.surround", lambda: Viewing(surround="dimm")),
    ("range Viewing.Y_b", lambda: Viewing(Y_b=-1.0)),
    ("range Viewing.L_A", lambda: Viewing(L_A=float("nan"))),
    ("range Viewing.fov_deg", lambda: Viewing(fov_deg=179.0)),
    ("conflict Viewing.D", lambda: Viewing(D=0.5, discount=True)),
    ("unknown Viewing.deficiency", lambda: Viewing(deficiency="green")),
    ("range Display.L_A", lambda: Display(L_A=-4.0)),
    ("unknown Display.space", lambda: Display(space="Display P4")),
    ("not-found Display.space", lambda: Display(space="missing.icc")),
    ("unknown preset", lambda: read_table(Display, {"preset": "cinma"}, SceneError)),
    ("unknown", lambda: preset("cinma")),
    ("range space.transfer", lambda: display(transfer=0.0)),
    ("conflict space.transfer", lambda: display(transfer={"power": 0.4, "toe": 0.5})),
    ("missing space.transfer", lambda: display()),
    ("unknown space.transfr", lambda: display(transfr=2.2)),
    ("type space.transfer", lambda: display(transfer="2.2")),
    ("range space.white_xy", lambda: display(white_xy=(0.3127, 3.0), transfer=2.2)),
    ("type space", lambda: read_table(Display, {"space": 5}, SceneError)),
    ("unknown Hdr.transfer", lambda: Hdr(transfer="gamma")),
    ("range Hdr.peak_cd_m2", lambda: Hdr(peak_cd_m2=100.0)),
    ("range Hdr.peak_cd_m2", lambda: Hdr("HLG", peak_cd_m2=4000.0)),
    ("shape ViewingConditions.white_XYZ", lambda: ViewingConditions((95, 100))),
    ("range ViewingConditions.white_XYZ", lambda: ViewingConditions((1.0985, 1, 0.3558))),
    ("range ViewingConditions.white_XYZ", lambda: ViewingConditions((1e-300,) * 3)),
    ("range ViewingConditions.white_XYZ", lambda: ViewingConditions((1e300,) * 3)),
    ("range ViewingConditions.white_XYZ", lambda: ViewingConditions((95, 100, 1e-300))),
    ("range ViewingConditions.Y_b", lambda: ViewingConditions(A, Y_b=1e4)),
    ("conflict ViewingConditions.D", lambda: ViewingConditions(A, D=1.0, discount=True)),
    ("range illuminance_lux", lambda: ViewingConditions.of_lux(A, 0.0)),
    ("range viewing conditions.white_XYZ", lambda: CamConditions.of((0.0, 0.0, 0.0), 60.0, 20.0)),
    ("impossible viewing conditions", lambda: CamConditions.of((10, 1, 90), 60, 20, D=0.0)),
    ("impossible gamut", lambda: DisplayGamut.of(NO_GREY, SPACES["sRGB"])),
    ("unknown difference", lambda: uniform("CIE76", D65, D65)),
    ("unknown difference", lambda: distance(None, D65, D65)),
    ("shape measured.Y", lambda: measure(Y=np.ones((4, 4, 3)))),
    ("shape measured.Y", lambda: measure(Y=np.ones((0, 4)))),
    ("range measured.Y", lambda: measure(Y=np.full((4, 4), np.nan))),
    ("range measured.fov_deg", lambda: measure(fov_deg=180.0)),
    ("range measured.luminance_of_white", lambda: measure(luminance_of_white=0.0)),
    ("range measured.at", lambda: measure(at=(4.0, 0.0))),
    ("range measured.at", lambda: measure(at=(np.nan, 1.0))),
    ("range measured.outside", lambda: measure(outside=-1.0)),
    ("range measured.white_XYZ[1]", lambda: measure(white_XYZ=(1.0, 0.0, 1.0))),
    ("shape measured.white_XYZ", lambda: measure(white_XYZ=(1.0, 1.0))),
    ("range Transfer.gamma", lambda: Transfer.gamma(0.0)),
    ("range Transfer.gamma", lambda: Transfer.gamma(float("nan"))),
    ("range Transfer.icc.g", lambda: Transfer.icc(0.0)),
    ("range Transfer.icc", lambda: Transfer.icc(2.4, 0.9, 0.0)),
    ("unsupported Transfer.icc", lambda: Transfer.icc(2.4, 1.0, 0.0, 1.0, 0.0, 0.01)),
    ("conflict Transfer", lambda: Transfer.icc(2.4, 0.9, 0.1)),
    ("range Transfer.icc.c", lambda: Transfer.icc(2.4, 1 / 1.055, 0.055 / 1.055, 0.0, 0.04)),
    ("conflict Transfer", lambda: Transfer(1 / 2.4, 1.055, 12.0, 0.0031308)),
    ("range Transfer.toe", lambda: Transfer(1 / 2.4, 1.0, 1.0, 1.0)),
    ("unknown colour space", lambda: colour_space("srbg")),
    ("range ColourSpace.primaries_xy", lambda: space(((0.1, 0.1), (0.2, 0.2), (0.3, 0.3)))),
    ("range ColourSpace.primaries_xy[2]", lambda: space((*TRIANGLE[:2], (0.15, 0.0)))),
    ("range ColourSpace.white_xy", lambda: space(TRIANGLE, (0.6, 0.6))),
    ("shape ColourSpace.primaries_xy", lambda: space(TRIANGLE[:2])),
    ("range HuntSettings.N_b", lambda: hunt.HuntSettings(N_b=0.0)),
    ("range HuntSettings.p", lambda: hunt.HuntSettings(p=2.0)),
    ("range HuntSettings.proximal_XYZ", lambda: hunt.HuntSettings(proximal_XYZ=(0, 0, 0))),
    ("range NayataniSettings.n", lambda: nayatani95.NayataniSettings(n=0.0)),
    ("range Hunt", lambda: hunt.forward(D65, DAYLIGHT, hunt.HuntSettings(N_b=1e6))),
    ("shape Hunt.S", lambda: hunt.forward(np.zeros((3, 3)), DAYLIGHT, S="bright")),
    ("shape Hunt.S", lambda: hunt.forward(np.zeros((3, 3)), DAYLIGHT, S=[0.1, 0.2])),
    ("shape Hunt.S", lambda: hunt.inverse(np.zeros(3), 0.0, 0.0, DAYLIGHT, S=[0.1, 0.2])),
]
BLUELESS = ViewingConditions((900.0, 100.0, 1.0))
for _name, _model in APPEARANCE_MODELS.items():
    REFUSED += [
        (f"shape {_name}.XYZ", lambda each=_model: each.forward(np.zeros((4, 2)), DAYLIGHT)),
        (f"shape {_name}", lambda each=_model: each.inverse(np.zeros(3), np.zeros(2), 0, DAYLIGHT)),
    ]
    if _name in ("RLAB", "Hunt", "Nayatani95"):
        REFUSED.append((f"range {_name}.white_XYZ", lambda m=_model: m.forward(D65, BLUELESS)))


@pytest.mark.parametrize(("fault", "make"), REFUSED)
def test_what_cannot_be_is_refused_with_its_code_and_field(fault, make):
    refuses(make, fault, InputError)


def test_an_unknown_model_is_refused_with_a_guess():
    with raises(InputError, "unknown", "appearance model") as caught:
        model("nayatani")
    assert "'Nayatani95'" in caught.value.remedy
