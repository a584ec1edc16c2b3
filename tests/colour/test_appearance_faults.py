"""Text, tuples and nothing where numbers or conditions belong: one line that says which."""

import numpy as np
import pytest

from tests.colour._models import D65
from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import ADAPTATIONS, adapt, adaptation, outside
from volspec.appearance.curves import Transfer
from volspec.appearance.models import MODELS, hunt, model, nayatani95
from volspec.appearance.models.cielab import XYZ_from_cielab, cielab
from volspec.appearance.models.conditions import Conditions
from volspec.appearance.spaces import ColourSpace, space_of
from volspec.errors import ShapeError, ViewingError

SEEN = ViewingConditions(D65)
P3 = ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06))
WHITE_XY = (0.3127, 0.329)
# What the argument is called in the message, and a call with it.
CALLS = {
    "ViewingConditions.white_XYZ": ViewingConditions,
    "ViewingConditions.L_A is": lambda x: ViewingConditions(D65, L_A=x),
    "ViewingConditions.Y_b is": lambda x: ViewingConditions(D65, Y_b=x),
    "illuminance_lux is": lambda x: ViewingConditions.of_lux(D65, x),
    "Transfer: gamma is": Transfer.gamma,
    "Transfer.power is": Transfer,
    "Transfer.toe is": lambda x: Transfer(0.5, toe=x),
    "the ICC curve's g is": Transfer.icc,
    "the ICC curve's e is": lambda x: Transfer.icc(2.2, e=x),
    "Transfer: linear light are": Transfer.gamma(2.2).encode,
    "Transfer: code values are": Transfer.gamma(2.2).decode,
    "ColourSpace.primaries_xy": lambda x: ColourSpace("mine", x, WHITE_XY, Transfer.gamma(2)),
    "ColourSpace.transfer is": lambda x: ColourSpace("mine", P3, WHITE_XY, x),
    "colour space ": space_of,
    "adaptation: XYZ is": lambda x: adapt(x, SEEN, SEEN),
    "CAT02: source is": lambda x: adapt(D65, x, SEEN),
    "CAT02: target is": lambda x: adapt(D65, SEEN, x),
    "Guth: target is": lambda x: ADAPTATIONS["Guth"](SEEN, x),
    "adaptation is": adaptation,
    "adaptation.passage is": lambda x: outside(D65, x),
    "appearance model is": model,
    "CIELAB: XYZ is": lambda x: cielab(x, D65),
    "CIELAB: the white is": lambda x: cielab(D65, x),
    r"CIELAB: L\*, a\*, b\* is": lambda x: XYZ_from_cielab(x, D65),
    "viewing conditions: the white is": lambda x: Conditions.of(x, 10.0, 20.0),
    "HuntSettings.N_b is": lambda x: hunt.HuntSettings(N_b=x),
    "HuntSettings.p is": lambda x: hunt.HuntSettings(p=x),
    "HuntSettings.proximal_XYZ is": lambda x: hunt.HuntSettings(proximal_XYZ=x),
    "HuntSettings.helson_judd is": lambda x: hunt.HuntSettings(helson_judd=x),
    "Hunt: settings are": lambda x: hunt.forward(D65, SEEN, x),
    "NayataniSettings.E_or is": lambda x: nayatani95.NayataniSettings(E_or=x),
    "Nayatani95: settings are": lambda x: nayatani95.forward(D65, SEEN, x),
    **{f"{n}: XYZ is": lambda x, n=n: MODELS[n].forward(x, SEEN) for n in MODELS},
    **{f"{n}: conditions is": lambda x, n=n: MODELS[n].forward(D65, x) for n in MODELS},
    **{f"{n}: J, C, h are": lambda x, n=n: MODELS[n].inverse(50, x, 0, SEEN) for n in MODELS},
}


@pytest.mark.parametrize("bad", ["abc", ("a", "b", "c"), {}, object(), [[1], [2, 3]]], ids=range(5))
@pytest.mark.parametrize("what", CALLS)
def test_what_is_no_number_is_named_in_one_line(what, bad):
    with pytest.raises((ViewingError, ShapeError), match=what) as caught:
        CALLS[what](bad)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 260
    assert any(words in message for words in ("expected", "known:", "; give "))


WHITES = (D65, list(D65), np.array(D65), np.float32([95, 100, 108]))


@pytest.mark.parametrize("white", WHITES, ids=range(4))
def test_a_white_of_any_kind_of_numbers_is_taken(white):
    taken = ViewingConditions(white).white_XYZ
    assert all(type(value) is float for value in taken)
    np.testing.assert_allclose(taken, white)


@pytest.mark.parametrize("white", [(1, 2), (1, 2, 3, 4), 5.0, None, (1, 2, None), (1, 2, True)])
def test_a_white_of_another_shape_is_refused(white):
    with pytest.raises(ViewingError, match=r"white_XYZ.* is .*; give (three|a) number"):
        ViewingConditions(white)
