"""What a ``[[keyframe]]`` may say of camera, transfer function and eye.

tables -> [keyparts] -> export
"""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from volspec._tables import Table
from volspec.scene.transfer import PointTable


def _direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(axis):
        raise ValueError("has no length; give a direction")
    return axis


Finite = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Place = Annotated[tuple[Finite, Finite, Finite], Field(strict=False)]
Direction = Annotated[Place, AfterValidator(_direction)]


class KeyCameraTable(Table):
    """``camera`` of a keyframe: what differs from [camera], an orbit's or a place's."""

    azimuth_deg: Finite | None = None
    """The short way from the key before."""
    elevation_deg: Finite | None = None
    """Towards up."""
    zoom: Positive | None = None
    """As [camera]."""
    fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    """As [camera]."""
    target_mm: Place | None = None
    """What it looks at."""
    position_mm: Place | None = None
    """Where it stands, in place of the orbit; goes around the target."""
    up: Direction | None = None
    """Beside position_mm: what is above in the picture."""

    @property
    def given(self) -> set[str]:
        """Names of what it says."""
        return {name for name in type(self).model_fields if getattr(self, name) is not None}


class KeyTransferTable(Table):
    """``transfer`` of a keyframe: each costs casts of its own."""

    shift: Finite | None = None
    """Added to the values of points, regions or surfaces."""
    points: Annotated[list[PointTable], Field(min_length=1)] | None = None
    """In place of [transfer] points; as many in every keyframe, and there."""


class KeyViewingTable(Table):
    """``viewing`` of a keyframe: what differs from [viewing]."""

    exposure: Positive | None = None
    """Factor of all light."""
    L_A: Positive | None = None
    """Adapting luminance, cd/m²."""
    Y_b: Positive | None = None
    """The background's luminance, white 100."""
    D: Share | None = None
    """Degree of adaptation."""
