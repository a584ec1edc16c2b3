"""What the shader is told of a light and of the passage to the display: plain arrays by name.

illumination, passage -> [uniforms] -> gpu -> shaders/relight.frag
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.field import PassageField
from volspec.appearance.gamut import SHADER_STEPS
from volspec.appearance.models.conditions import CamPassage
from volspec.appearance.passages import CurvePassage, LinearPassage
from volspec.appearance.screen import Screen
from volspec.appearance.table import TableSpace
from volspec.relight.illumination import Illumination
from volspec.relight.packed import layer_count

# What a pixel goes through, by the numbers that the shader knows the forms by.
FORM_NUMBERS = {"LINEAR": 0, "CURVE": 1, "CAM": 2, "TABLE": 3}
FORMS: dict[type, int] = dict(
    zip((LinearPassage, CurvePassage, CamPassage, TableSpace), FORM_NUMBERS.values(), strict=True)
)
FORMS[PassageField] = FORMS[CamPassage]
# Those that the shader can work out colour by colour, and fill a table with.
CLOSED_FORMS = (CurvePassage, CamPassage)
Drawn = LinearPassage | CurvePassage | CamPassage | TableSpace | PassageField
Uniforms = dict[str, NDArray[np.float32]]


def form_of(passage: Drawn) -> dict[str, int]:
    """What ``shaders/relight.frag`` is compiled with to draw a passage."""
    same = isinstance(passage, CamPassage) and all(
        bool(np.all(np.abs(np.asarray(value) - 1.0) < 1e-7))
        for value in (passage.lightness_power, passage.chroma_gain)
    )
    outer = isinstance(passage, CurvePassage) and bool(np.any(passage.outer != 1))
    form = {"FORM": FORMS[type(passage)], "SAME_SURROUND": int(same), "OUTER": int(outer)}
    return form | {"FIELD": int(isinstance(passage, PassageField))}


def light_uniforms(light: Illumination, passage: Drawn) -> Uniforms:
    """What a light sends, by GLSL name.

    Parameters
    ----------
    light : Illumination
        The light, for L·M channels.
    passage : Drawn
        From the scene to the display. What of it is a matrix that comes first costs a pixel
        nothing: it is multiplied in here.

    Returns
    -------
    dict
        Flat float32 arrays; matrices column by column.
    """
    channels = light.XYZ_from_channels.shape[1]
    columns = np.zeros((layer_count(channels) * 4, 3))
    columns[:channels] = light.XYZ_from_channels.T
    # Opacity takes away what the backdrop gives: (1 - alpha) XYZ_backdrop without a branch.
    columns[channels] = -light.backdrop_XYZ
    first = np.eye(3)
    if isinstance(passage, LinearPassage):
        first = passage.matrix
    elif isinstance(passage, TableSpace):
        first = passage.adapted_from_XYZ
    return _flat({"XYZ_from_layer": columns @ first.T, "backdrop_XYZ": first @ light.backdrop_XYZ})


def passage_uniforms(passage: Drawn, screen: Screen) -> Uniforms:
    """What a passage sends, by GLSL name: of ``passage.*`` what `form_of` asks for.

    Returns
    -------
    dict
        Flat float32 arrays; matrices column by column.
    """
    if isinstance(passage, LinearPassage | TableSpace):
        return {}
    form = form_of(passage)
    if isinstance(passage, PassageField):  # whose scenes are in its texture
        passage = passage.passage
    values: dict[str, ArrayLike] = {
        "linear_from_response": (screen.RGB_from_XYZ @ passage.XYZ_from_response).T
    }
    if not form["FIELD"]:
        values["response_from_XYZ"] = passage.response_from_XYZ.T
    if isinstance(passage, CurvePassage):
        names = ["gain", "power", "shift", "offset", *(["outer"] if form["OUTER"] else [])]
    else:
        names = ["display_achromatic"]
        if not form["FIELD"]:
            names += ["scene_achromatic"]
            names += [] if form["SAME_SURROUND"] else ["lightness_power", "chroma_gain"]
    values |= {name: getattr(passage, name) for name in names}
    return _flat({f"passage.{name}": value for name, value in values.items()})


def screen_form(screen: Screen) -> dict[str, int]:
    """What ``shaders/include/gamut.glsl`` is compiled with."""
    return {"REDUCE": int(screen.gamut is not None), "MARK": int(screen.mark)}


def screen_uniforms(screen: Screen) -> Uniforms:
    """What a display sends, by GLSL name: of ``gamut.*`` what `screen_form` asks for."""
    gamut = screen.gamut
    if gamut is None:
        return {}
    # XYZ cancel: what the shader has is the display's linear RGB.
    response_from_linear = gamut.conditions.response_from_XYZ() @ np.linalg.inv(gamut.RGB_from_XYZ)
    return _flat(
        {
            "gamut.response_from_linear": response_from_linear.T,
            "gamut.linear_from_response": gamut.linear_from_response.T,
            "gamut.top": gamut.top,
            "gamut.knee": gamut.knee,
            "gamut.knee_slope": gamut.knee_slope,
            "gamut.last_step": 0.5**SHADER_STEPS,
        }
    )


def node_uniforms(passage: Drawn, space: TableSpace, screen: Screen) -> Uniforms:
    """What ``shaders/nodes.frag`` is sent to fill a table with a passage."""
    XYZ_from_adapted = np.linalg.inv(space.adapted_from_XYZ)
    return passage_uniforms(passage, screen) | _flat({"XYZ_from_adapted": XYZ_from_adapted.T})


def _flat(values: Mapping[str, ArrayLike]) -> Uniforms:
    return {name: np.asarray(v, dtype=np.float32).ravel() for name, v in values.items()}
