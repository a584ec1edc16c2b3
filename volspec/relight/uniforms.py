"""What the shader is told of a light and of the passage to the display: plain arrays by name.

illumination, passage -> [uniforms] -> gpu -> shaders/relight.frag
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.field import PassageField
from volspec.appearance.gamut import SHADER_STEPS
from volspec.appearance.models.conditions import CamPassage
from volspec.appearance.passages import CurvePassage, LinearPassage, Passage
from volspec.appearance.screen import Screen
from volspec.appearance.table import TableSpace
from volspec.relight.illumination import Illumination
from volspec.relight.packed import layer_count

# What a pixel goes through, by the numbers that the shader knows the forms by.
FORM_NUMBERS = {"LINEAR": 0, "CURVE": 1, "CAM": 2, "TABLE": 3}
# Those that the shader can work out colour by colour, and fill a table with.
Closed = CurvePassage | CamPassage
Uniforms = dict[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class Tabled:
    """A passage that is looked up.

    Parameters
    ----------
    space : TableSpace
    behind : CurvePassage or CamPassage, optional
        From adapted linear RGB on, to fill the table with.
    """

    space: TableSpace
    behind: Closed | None

    @classmethod
    def of(cls, passage: Passage, space: TableSpace) -> Tabled:
        """A passage from a scene's XYZ, to be looked up in a space."""
        if not isinstance(passage, Closed):
            return cls(space, None)
        XYZ_from_adapted = np.linalg.inv(space.adapted_from_XYZ)
        first = passage.response_from_XYZ @ XYZ_from_adapted
        return cls(space, replace(passage, response_from_XYZ=first))


Drawn = LinearPassage | Closed | Tabled | PassageField
FORMS: dict[type, int] = dict(
    zip((LinearPassage, CurvePassage, CamPassage, Tabled), FORM_NUMBERS.values(), strict=True)
)
FORMS[PassageField] = FORMS[CamPassage]


def form_of(passage: Drawn) -> dict[str, int]:
    """What ``shaders/relight.frag`` is compiled with to draw a passage."""
    if isinstance(passage, Tabled):
        checked = int(passage.behind is not None)
        return form_of(LinearPassage(np.eye(3))) | {"FORM": FORMS[Tabled], "CHECKED": checked}
    same = isinstance(passage, CamPassage) and all(
        bool(np.all(np.abs(np.asarray(value) - 1.0) < 1e-7))
        for value in (passage.lightness_power, passage.chroma_gain)
    )
    outer = isinstance(passage, CurvePassage) and bool(np.any(passage.outer != 1))
    form = {"FORM": FORMS[type(passage)], "SAME_SURROUND": int(same), "OUTER": int(outer)}
    return form | {"FIELD": int(isinstance(passage, PassageField)), "CHECKED": 0}


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
    elif isinstance(passage, Tabled):
        first = passage.space.adapted_from_XYZ
    return _flat({"XYZ_from_layer": columns @ first.T, "backdrop_XYZ": first @ light.backdrop_XYZ})


def passage_uniforms(passage: Drawn, screen: Screen) -> Uniforms:
    """What a passage sends, by GLSL name: of ``passage.*`` what `form_of` asks for.

    Returns
    -------
    dict
        Flat float32 arrays; matrices column by column.
    """
    if isinstance(passage, LinearPassage | Tabled):
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


def node_uniforms(behind: Closed, offset: float, screen: Screen) -> Uniforms:
    """What ``shaders/nodes.frag`` is sent to work out a table's nodes, or its cells' middles."""
    return passage_uniforms(behind, screen) | _flat({"offset": offset})


def _flat(values: Mapping[str, ArrayLike]) -> Uniforms:
    return {name: np.asarray(v, dtype=np.float32).ravel() for name, v in values.items()}
