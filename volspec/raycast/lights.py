"""Light sources without a spectrum, in groups that are controlled separately.

    [light groups] -> raycast -> one layer of channels per group -> relight

A cast uses directions, never spectra: each group fills its own layer of channels, and gets its
spectrum and weight when the picture is relit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from volspec._checks import Direction, Weight
from volspec.camera import Camera
from volspec.errors import InputError, RaycastError
from volspec.settings import Hint, Positive, Unit, Vector, kind_of, settings

Frame = Literal["world", "camera"]
# Within this fraction of its falloff distance, a lamp gets no brighter.
NEAR_LAMP = 0.1
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
# Part of a cone's difference of cosines over which the sharpest one ends.
_SHARPEST = 1e-3
MAX_GROUPS = 8
MAX_SOURCES = 16
MAX_NAME = 64


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class Ambient:
    """Light from all directions, weighted by `RaycastSpec.ambient`."""

    kind: ClassVar = "ambient"
    intensity: Weight = 1.0
    """Factor of its light."""
    occlusion: bool = False
    """Ambient occlusion: nearby matter blocks light."""
    radius_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance up to which matter occludes; a tenth of the volume's diagonal if left out."""


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class Headlight:
    """A light at the camera, along every ray; it casts no shadow that the camera could see."""

    kind: ClassVar = "headlight"
    intensity: Weight = 1.0
    """Factor of its light."""


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class Directional:
    """A distant light with parallel rays."""

    kind: ClassVar = "directional"
    towards: Annotated[Direction, Field(examples=[[1, 0.75, 0.6]])]
    """Direction from the volume to the light; of any length but 0, stored as a unit vector."""
    frame: Frame = "world"
    """Axes of ``towards``: the world's, or the camera's (right, up, back), for a light that moves
    with the camera."""
    intensity: Weight = 1.0
    """Factor of its light."""
    shadows: bool = False
    """The volume casts shadows into itself."""


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class Point:
    """A nearby light that shines equally in all directions."""

    kind: ClassVar = "point"
    position_mm: Annotated[Vector, Field(examples=[[0, 0, -500]]), Unit("mm")]
    """Position of the light; relative to the camera if frame is camera."""
    frame: Frame = "world"
    """The world's axes, or (right, up, back) from the camera's position."""
    intensity: Weight = 1.0
    """Factor of its light."""
    shadows: bool = False
    """The volume casts shadows into itself."""
    falloff_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance at which the light has its intensity, which falls with the square of the distance;
    constant if left out. Within a tenth of this distance the light gets no brighter."""
    radius_mm: Annotated[Positive, Unit("mm")] | None = None
    """Radius of the lamp, a disc that faces what it lights: its shadows are soft."""


@settings(RaycastError)
@dataclass(frozen=True, slots=True, kw_only=True)
class Spot(Point):
    """A nearby light that shines a cone, such as a flashlight."""

    kind: ClassVar = "spot"
    target_mm: Annotated[Vector, Field(examples=[[0, 0, 0]]), Unit("mm")]
    """Point that it is aimed at, in the axes of its position."""
    cone_deg: Annotated[float, Field(ge=0.5, lt=90.0), Unit("degrees")] = 20.0
    """Angle between the axis and the rim of the cone, beyond which it is dark."""
    edge_deg: Annotated[float, Field(ge=0.0, lt=90.0), Unit("degrees")] = 4.0
    """Width of the rim over which its light falls off, inside the cone, at most all of it."""

    def __post_init__(self) -> None:
        if self.target_mm == self.position_mm:
            remedy = "aim at another point than its position_mm"
            raise RaycastError.refused("target_mm", self.target_mm, remedy, "range")

    def beam(self, camera: Camera) -> tuple[float, float, float, float]:
        """Return the plane whose height over unit vectors to the light rises from the cone's rim.

        It is 0 at the rim and 1 where the light is whole, in the world's axes; the light follows
        it as a smoothstep.
        """
        aim = np.subtract(self.target_mm, self.position_mm)
        aim = aim / np.abs(aim).max()  # lengths of any unit
        x, y, z = (aim / np.linalg.norm(aim)).tolist()
        axis = camera.to_world((x, y, z), self.frame)
        inner_deg = max(self.cone_deg - self.edge_deg, 0.0)
        rim, full = np.cos(np.radians([self.cone_deg, inner_deg]))
        slope = 1.0 / max(full - rim, _SHARPEST * (1.0 - rim))
        x, y, z = (-slope * axis).tolist()
        return x, y, z, float(-slope * rim)


Source = Annotated[
    Annotated[Ambient, Tag("<ambient>")]
    | Annotated[Headlight, Tag("<headlight>")]
    | Annotated[Directional, Tag("<directional>")]
    | Annotated[Point, Tag("<point>")]
    | Annotated[Spot, Tag("<spot>")],
    Discriminator(kind_of),
    Hint("Ambient, Headlight, Directional, Point or Spot", whole=True),
]


def lamp_points(
    place_mm: ArrayLike, radius_mm: float, towards_mm: ArrayLike, count: int, rim: int = 0
) -> Iterator[NDArray[np.float64]]:
    """Yield places (K, 3) on discs about a place, in a spiral of the golden angle; first the rim's.

    Each disc faces one of the points (K, 3), of which there may be one.
    """
    place, points = np.asarray(place_mm, float), np.atleast_2d(np.asarray(towards_mm, float))
    axis = points - place
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = axis / np.where(length > 0.0, length, 1.0)
    # The world's axis that is most across.
    helper = np.eye(3)[np.abs(axis).argmin(axis=1)]
    right = np.cross(axis, helper)
    right = right / np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-30)
    up = np.cross(axis, right)
    spots = [(1.0, 2.0 * math.pi * n / rim) for n in range(rim)]
    spots += [(math.sqrt((n + 0.5) / count), n * _GOLDEN_ANGLE) for n in range(count)]
    for reach, angle in spots:
        yield place + radius_mm * reach * (math.cos(angle) * right + math.sin(angle) * up)


def as_tuple(value: object) -> object:
    """Return a single value as a tuple of one."""
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _group_name(name: str) -> str:
    if not name.strip():
        raise InputError("", "give a name", code="missing", given=name)
    if not name.isprintable() or {"=", ";"} & {*name} or name != name.strip():
        raise InputError(
            "",
            "leave out =, ;, control characters, direction marks and surrounding blanks",
            code="syntax",
            given=name,
        )
    return name


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class LightGroup:
    """Sources that share a spectrum and a weight: one layer of channels.

    Raises
    ------
    RaycastError
        If the name is missing or too long, there is no source, or one is of another type.

    Examples
    --------
    >>> LightGroup("key", (Directional((1, -2, 1), frame="camera", shadows=True),)).name
    'key'
    """

    row_keys: ClassVar = ("name",)
    name: Annotated[
        str,
        Field(max_length=MAX_NAME, examples=["lamp"]),
        AfterValidator(_group_name),
        Hint(f"up to {MAX_NAME} characters"),
    ]
    """Name to which a spectrum is assigned; any characters but = and ;, up to 64."""
    sources: Annotated[
        tuple[Source, ...],
        BeforeValidator(as_tuple),
        Field(strict=False, min_length=1, examples=[[{"kind": "headlight"}]]),
    ]
    """Light sources: ambient, headlight, directional, point or spot."""

    def without_shadows(self) -> LightGroup:
        """Return the group without shadows and occlusion."""
        return replace(self, sources=tuple(_without_shadow(source) for source in self.sources))


def _without_shadow(source: Source) -> Source:
    if isinstance(source, Ambient):
        return replace(source, occlusion=False)
    return source if isinstance(source, Headlight) else replace(source, shadows=False)


# One layer, as in a viewer without lights of its own.
HEADLIT = (LightGroup("light", (Ambient(), Headlight())),)
