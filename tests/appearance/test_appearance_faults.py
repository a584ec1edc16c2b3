"""Text, tuples and other objects instead of numbers or conditions: an error names the argument."""

import numpy as np
import pytest

from tests.appearance._models import D65
from tests.support.errors import raises
from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import ADAPTATIONS, adapt, adaptation, outside
from volspec.appearance.display import colour_space
from volspec.appearance.models import APPEARANCE_MODELS, hunt, model, nayatani95
from volspec.appearance.models.cam import CamConditions
from volspec.appearance.models.cielab import XYZ_from_cielab, cielab
from volspec.appearance.spaces import ColourSpace, Transfer
from volspec.errors import InputError

DAYLIGHT = ViewingConditions(D65)
P3 = ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06))
WHITE_XY = (0.3127, 0.329)
# The error's field, and a call with the argument.
CALLS = {
    "ViewingConditions.white_XYZ": ViewingConditions,
    "ViewingConditions.L_A": lambda x: ViewingConditions(D65, L_A=x),
    "ViewingConditions.Y_b": lambda x: ViewingConditions(D65, Y_b=x),
    "illuminance_lux": lambda x: ViewingConditions.of_lux(D65, x),
    "Transfer.gamma": Transfer.gamma,
    "Transfer.power": Transfer,
    "Transfer.toe": lambda x: Transfer(0.5, toe=x),
    "Transfer.icc.g": Transfer.icc,
    "Transfer.icc.e": lambda x: Transfer.icc(2.2, e=x),
    "Transfer.linear": Transfer.gamma(2.2).encode,
    "Transfer.encoded": Transfer.gamma(2.2).decode,
    "ColourSpace.primaries_xy": lambda x: ColourSpace("mine", x, WHITE_XY, Transfer.gamma(2)),
    "ColourSpace.transfer": lambda x: ColourSpace("mine", P3, WHITE_XY, x),
    "colour space": colour_space,
    "adaptation.XYZ": lambda x: adapt(x, DAYLIGHT, DAYLIGHT),
    "CAT02.source": lambda x: adapt(D65, x, DAYLIGHT),
    "CAT02.target": lambda x: adapt(D65, DAYLIGHT, x),
    "Guth.target": lambda x: ADAPTATIONS["Guth"](DAYLIGHT, x),
    "adaptation": adaptation,
    "adaptation.transform": lambda x: outside(D65, x),
    "appearance model": model,
    "CIELAB.white_XYZ": lambda x: cielab(D65, x),
    "CIELAB.Lab": lambda x: XYZ_from_cielab(x, D65),
    "viewing conditions.white_XYZ": lambda x: CamConditions.of(x, 10.0, 20.0),
    "HuntSettings.N_b": lambda x: hunt.HuntSettings(N_b=x),
    "HuntSettings.p": lambda x: hunt.HuntSettings(p=x),
    "HuntSettings.proximal_XYZ": lambda x: hunt.HuntSettings(proximal_XYZ=x),
    "HuntSettings.helson_judd": lambda x: hunt.HuntSettings(helson_judd=x),
    "Hunt.settings": lambda x: hunt.forward(D65, DAYLIGHT, x),
    "NayataniSettings.E_or": lambda x: nayatani95.NayataniSettings(E_or=x),
    "Nayatani95.settings": lambda x: nayatani95.forward(D65, DAYLIGHT, x),
}
for _name, _model in APPEARANCE_MODELS.items():
    CALLS |= {
        f"{_name}.XYZ": lambda x, model=_model: model.forward(x, DAYLIGHT),
        f"{_name}.conditions": lambda x, model=_model: model.forward(D65, x),
        _name: lambda x, model=_model: model.inverse(50, x, 0, DAYLIGHT),
    }


@pytest.mark.parametrize("bad", ["abc", ("a", "b", "c"), {}, object(), [[1], [2, 3]]], ids=range(5))
@pytest.mark.parametrize("field", CALLS)
def test_an_argument_that_is_no_number_is_named(field, bad):
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


@pytest.mark.parametrize("white", [(1, 2), (1, 2, 3, 4), 5.0, None, (1, 2, None), (1, 2, True)])
def test_a_white_of_another_shape_is_refused(white):
    with raises(InputError) as caught:
        ViewingConditions(white)
    assert caught.value.code in ("type", "shape")
    assert caught.value.field.startswith("ViewingConditions.white_XYZ")
