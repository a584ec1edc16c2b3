"""Where light comes from: sources without a spectrum, in groups that are steered apart.

    [light groups] -> raycast -> one layer of channels a group -> relight

A cast knows directions, never spectra: each group leaves its own layer of channels, and gets
its spectrum and weight when the picture is relit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from volspec.errors import RaycastError, quoted
from volspec.raycast.checks import Vector, positive, unit_vector, vector, weight

Frame = Literal["world", "camera"]
# Nearer than this share of its falloff a lamp shines no brighter.
NEAR_LAMP = 0.1
MAX_GROUPS = 8
MAX_SOURCES = 16
MAX_NAME = 64


@dataclass(frozen=True, slots=True)
class Ambient:
    """Light from everywhere, which `RaycastSpec.ambient` reflects.

    Parameters
    ----------
    intensity : float
        Of 0 or more.
    occlusion : bool
        Whether what is near takes light away (ambient occlusion).
    radius_mm : float, optional
        How far occluders reach; a tenth of the volume's diagonal when left out.
    """

    intensity: float = 1.0
    occlusion: bool = False
    radius_mm: float | None = None

    def __post_init__(self) -> None:
        _check_intensity(self)
        _check_flag(self, "occlusion")
        if self.radius_mm is not None:
            positive("ambient light: radius_mm", self.radius_mm)


@dataclass(frozen=True, slots=True)
class Headlight:
    """A light at the camera, along every ray; it casts no shadow that the camera could see."""

    intensity: float = 1.0

    def __post_init__(self) -> None:
        _check_intensity(self)


@dataclass(frozen=True, slots=True)
class Directional:
    """A light far away.

    Parameters
    ----------
    towards : (x, y, z)
        From the volume to the light; of any length but 0, kept as a unit vector.
    frame : {"world", "camera"}
        Axes of ``towards``: the world's, or (right, up, back) of the camera, for a light that
        moves with it.
    intensity : float
    shadows : bool
        Whether the volume casts shadows into itself.
    """

    towards: Vector
    frame: Frame = "world"
    intensity: float = 1.0
    shadows: bool = False

    def __post_init__(self) -> None:
        _check_intensity(self)
        _check_flag(self, "shadows")
        _check_frame(self)
        towards = unit_vector("directional light: towards", self.towards)
        object.__setattr__(self, "towards", towards)


@dataclass(frozen=True, slots=True)
class Point:
    """A light near by, which shines alike in all directions.

    Parameters
    ----------
    position_mm : (x, y, z)
    frame : {"world", "camera"}
        The world, or (right, up, back) from the camera's position.
    intensity : float
    shadows : bool
    falloff_mm : float, optional
        Distance at which the light has its intensity, which falls with the distance squared;
        when left out it does not fall. Nearer than a tenth of it the light stays as it is.
    """

    position_mm: Vector
    frame: Frame = "world"
    intensity: float = 1.0
    shadows: bool = False
    falloff_mm: float | None = None

    def __post_init__(self) -> None:
        _check_intensity(self)
        _check_flag(self, "shadows")
        _check_frame(self)
        position = vector("point light: position_mm", self.position_mm)
        object.__setattr__(self, "position_mm", position)
        if self.falloff_mm is not None:
            positive("point light: falloff_mm", self.falloff_mm)


Source = Ambient | Headlight | Directional | Point


@dataclass(frozen=True, slots=True)
class LightGroup:
    """Sources that share a spectrum and a weight: one layer of channels.

    Parameters
    ----------
    name : str
        What a light of the rig is given to; up to 64 characters.
    sources : tuple of Ambient, Headlight, Directional, Point
        At least one.

    Raises
    ------
    RaycastError
        If there is no name or too long a one, no source or something else among them.

    Examples
    --------
    >>> LightGroup("key", (Directional((1, -2, 1), frame="camera", shadows=True),)).name
    'key'
    """

    name: str
    sources: tuple[Source, ...]

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.strip()):
            raise RaycastError(f"light group: name is {self.name!r}; give a word")
        plain = self.name.isprintable() and not {"=", ";"} & {*self.name}
        if not plain or self.name != self.name.strip():
            raise RaycastError(
                f"light group: name is {quoted(self.name)}; leave out =, ;, "
                "control characters, marks of direction and blanks around it"
            )
        if len(self.name) > MAX_NAME:
            raise RaycastError(
                f"light group {self.name!r:.20}…: the name has {len(self.name)} characters; give "
                f"{MAX_NAME} at most"
            )
        given = self.sources
        sources = tuple(given) if isinstance(given, list | tuple) else (given,)
        if not sources:
            raise RaycastError(f"light group {self.name!r}: no source; give at least one")
        for source in sources:
            if not isinstance(source, Source):
                raise RaycastError(
                    f"light group {self.name!r}: {quoted(source, 60)} is no source; give Ambient, "
                    "Headlight, Directional or Point"
                )
        object.__setattr__(self, "sources", sources)


def _check_intensity(source: Source) -> None:
    weight(f"{_who(source)}: intensity", source.intensity)


def _check_flag(source: Source, name: str) -> None:
    if not isinstance(getattr(source, name), bool):
        raise RaycastError(
            f"{_who(source)}: {name} is {quoted(getattr(source, name))}; give a bool"
        )


def _check_frame(source: Directional | Point) -> None:
    if source.frame not in ("world", "camera"):
        raise RaycastError(
            f"{_who(source)}: frame is {quoted(source.frame)}; give 'world' or 'camera'"
        )


def _who(source: Source) -> str:
    return (
        "headlight" if isinstance(source, Headlight) else f"{type(source).__name__.lower()} light"
    )


# One layer, as a viewer without lights of its own has it.
HEADLIT = (LightGroup("light", (Ambient(), Headlight())),)
