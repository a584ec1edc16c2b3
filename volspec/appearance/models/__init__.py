"""Appearance models by name: each a module with ``NAME``, ``forward``, ``inverse``, ``continued``.

ViewingConditions, XYZ -> [models] -> Appearance -> [models] -> XYZ
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from volspec.appearance.models import cam16, ciecam02, cielab, hunt, nayatani95, rlab
from volspec.appearance.models.base import Appearance, Model
from volspec.errors import ViewingError, nearest

__all__ = ["MODELS", "Appearance", "Model", "model"]

MODELS: Mapping[str, Model] = MappingProxyType(
    {each.NAME: each for each in (ciecam02, cam16, cielab, rlab, hunt, nayatani95)}
)
"""Every model by its ``NAME``."""


def model(name: str) -> Model:
    """The appearance model of a name.

    Raises
    ------
    ViewingError
        If there is none.

    Examples
    --------
    >>> model("RLAB").NAME
    'RLAB'
    >>> model("hunt")
    Traceback (most recent call last):
    ...
    volspec.errors.ViewingError: appearance model is 'hunt'; did you mean 'Hunt'? known: ...
    """
    if not (isinstance(name, str) and name in MODELS):
        raise ViewingError.refused(
            "appearance model",
            name,
            f"{nearest(str(name), MODELS)}known: {', '.join(MODELS)}",
            "unknown",
        )
    return MODELS[name]
