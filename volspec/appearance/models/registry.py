"""Appearance models by name; each has ``NAME``, ``forward``, ``inverse`` and ``invert_beyond``.

ViewingConditions, XYZ -> [models] -> Appearance -> [models] -> XYZ
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from volspec.appearance.models import hellwig2022, hunt, lab, nayatani95, rlab, zcam
from volspec.appearance.models.base import Model
from volspec.appearance.models.cam import cam16, ciecam02
from volspec.errors import ViewingError, nearest

APPEARANCE_MODELS: Mapping[str, Model] = MappingProxyType(
    {m.NAME: m for m in (ciecam02, cam16, lab, rlab, hunt, nayatani95, hellwig2022, zcam)}
)
"""Every model by its ``NAME``."""


def model(name: str) -> Model:
    """Return the appearance model of a name; raise ViewingError if there is none."""
    if name not in APPEARANCE_MODELS:
        raise ViewingError.refused(
            "appearance model",
            name,
            f"{nearest(name, APPEARANCE_MODELS)}known: {', '.join(APPEARANCE_MODELS)}",
            "unknown",
        )
    return APPEARANCE_MODELS[name]
