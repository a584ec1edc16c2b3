"""The view transform from a scene under a light to the display, by any model.

Viewing, white -> [scene_to_display] -> ViewTransform -> cpu | shaders/relight.frag
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

from numpy.typing import ArrayLike

from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import APPEARANCE_MODELS, Model, cam16, ciecam02, cielab, rlab
from volspec.appearance.models.base import Array
from volspec.appearance.models.numeric import nearest_inverse
from volspec.appearance.spec import Viewing, ViewingConditions
from volspec.appearance.transforms import ViewTransform

CLOSED = MappingProxyType({m.NAME: m.view_transform for m in (ciecam02, cam16, cielab, rlab)})
"""View transforms in closed form by the model's name: inverse after forward in one step."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelTransform:
    """A model's inverse after its forward, colour by colour; shaders need it as a 3-D LUT."""

    model: Model
    scene: ViewingConditions
    display: ViewingConditions

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ of equal J, C and h; if there are none, the nearest."""
        look = self.model.forward(XYZ, self.scene)
        return nearest_inverse(self.model, look.J, look.C, look.h, self.display)


def view_transform(viewing: Viewing, white_XYZ: ArrayLike) -> ViewTransform:
    """Make the transform from the scene's XYZ to the display's.

    Parameters
    ----------
    viewing : Viewing
        Model, scene and display conditions.
    white_XYZ : (3,) array_like
        The scene's adopted white.

    Raises
    ------
    ViewingError
        If the white is not a colour, or has no lightness in the model.
    """
    scene, display = viewing.conditions(white_XYZ), viewing.display.conditions
    if viewing.model in ADAPTATIONS:
        # The white moves, tones stay: adaptations get the same light level on both sides.
        level = {name: getattr(scene, name) for name in ("L_A", "Y_b", "surround")}
        return ADAPTATIONS[viewing.model](scene, replace(display, **level))
    if closed := CLOSED.get(viewing.model):
        return closed(scene, display)
    return ModelTransform(APPEARANCE_MODELS[viewing.model], scene, display)
