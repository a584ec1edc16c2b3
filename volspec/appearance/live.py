"""From a scene under a light to the display: the passage that a viewing asks for.

Viewing, white -> [live] -> Passage -> host | shaders/relight.frag
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

from numpy.typing import ArrayLike

from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import MODELS, Model, cam16, ciecam02, cielab, rlab
from volspec.appearance.models.base import Array
from volspec.appearance.models.numeric import nearest_inverse
from volspec.appearance.passages import Passage
from volspec.appearance.spec import Viewing, ViewingConditions

# Models of which inverse after forward is a passage in closed form.
CLOSED = MappingProxyType({each.NAME: each.passage for each in (ciecam02, cam16, cielab, rlab)})


@dataclass(frozen=True, slots=True, eq=False)
class ModelPassage:
    """A model's inverse after its forward, colour by colour: no form that the shader draws.

    Parameters
    ----------
    model : Model
    scene, display : ViewingConditions
    """

    model: Model
    scene: ViewingConditions
    display: ViewingConditions

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) to those of equal J, C and h; where there are none, to the nearest."""
        seen = self.model.forward(XYZ, self.scene)
        return nearest_inverse(self.model, seen.J, seen.C, seen.h, self.display)


def passage_of(viewing: Viewing, white_XYZ: ArrayLike) -> Passage:
    """What takes the scene's XYZ to the display's.

    Parameters
    ----------
    viewing : Viewing
        Model, scene and display conditions.
    white_XYZ : (3,) array_like
        The scene's adopted white.

    Returns
    -------
    Passage

    Raises
    ------
    ViewingError
        If the white is none, or has no lightness in the model.
    """
    scene, display = viewing.conditions(white_XYZ), viewing.display.conditions
    if viewing.model in ADAPTATIONS:
        # The white moves, tones stay: the models that carry level are given one for both.
        level = {name: getattr(scene, name) for name in ("L_A", "Y_b", "surround")}
        return ADAPTATIONS[viewing.model](scene, replace(display, **level))
    if closed := CLOSED.get(viewing.model):
        return closed(scene, display)
    return ModelPassage(MODELS[viewing.model], scene, display)
