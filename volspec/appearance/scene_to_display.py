"""The view transform from a scene under a light to the display, by any model.

Viewing, white -> [scene_to_display] -> ViewTransform -> cpu | shaders/relight.frag
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

from numpy.typing import ArrayLike

from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import (
    APPEARANCE_MODELS,
    Appearance,
    Model,
    cam16,
    ciecam02,
    hellwig2022,
    hunt,
    lab,
    nayatani95,
    rlab,
)
from volspec.appearance.models.base import Array
from volspec.appearance.models.numeric import nearest_inverse
from volspec.appearance.spec import Viewing, ViewingConditions
from volspec.appearance.transforms import ViewTransform

Forward = Callable[[ArrayLike, ViewingConditions], Appearance]
CLOSED = MappingProxyType(
    {m.NAME: m.view_transform for m in (ciecam02, cam16, lab, rlab, hellwig2022)}
)
"""View transforms in closed form by the model's name: inverse after forward in one step."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelTransform:
    """A model's inverse after its forward, colour by colour; shaders need it as a 3-D LUT."""

    model: Model
    forward: Forward  # of the scene, with its settings
    scene: ViewingConditions
    display: ViewingConditions

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ of equal J, C and h; if there are none, the nearest."""
        look = self.forward(XYZ, self.scene)
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
    model = APPEARANCE_MODELS[viewing.model]
    return ModelTransform(model, forward_for(viewing), scene, display)


def forward_for(viewing: Viewing) -> Forward:
    """Return the forward function of a viewing's model with its settings; CIECAM02's if it adapts.

    An adaptation on its own has no appearance.
    """
    if viewing.model == hunt.NAME:
        return partial(hunt.forward, settings=viewing.hunt)
    if viewing.model == nayatani95.NAME:
        return partial(nayatani95.forward, settings=viewing.nayatani)
    return APPEARANCE_MODELS.get(viewing.model, ciecam02).forward
