"""``[export]`` and ``[[keyframe]]``: which re-lit frames a scene is exported as.

    tables -> [export] -> volspec.export.plan

docs/export.md explains them to users.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from volspec.errors import SceneError, nearest
from volspec.scene.specs import CameraSpec, fault
from volspec.scene.transfer import PointSpec
from volspec.settings import (
    Finite,
    Fraction,
    Name,
    NotNegative,
    Positive,
    Unit,
    Vector,
    settings,
)


def _direction(axis: Vector) -> Vector:
    if not any(axis):
        raise SceneError("", "give a direction, which has a length", code="range", given=axis)
    return axis


Direction = Annotated[Vector, AfterValidator(_direction)]
# A film of an hour and more; beyond it a number is a slip.
MAX_FRAMES = 100_000
Frames = Annotated[int, Field(ge=1, le=MAX_FRAMES)]


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Turntable:
    """``turntable`` of [export]: the camera goes around what it looks at."""

    frames: Annotated[Frames, Field(examples=[72])]
    """How many; a whole turn ends one before the first, so that it can be repeated."""
    degrees: Finite = 360.0
    """How far; negative turns the other way."""
    axis: Direction | None = None
    """Axis of the turn; left out, the camera's up."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Sweep:
    """``sweep`` of [export]: one light fades into the next."""

    frames: Frames | None = None
    """How many; left out, as many as the camera has, 24 a fade if it does not move."""
    closed: bool = False
    """From the last light back to the first, so that it can be repeated."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class ExportSpec:
    """``[export]``: which frames are made, and as what files."""

    lights: Annotated[tuple[Name, ...], Field(strict=False)] | None = None
    """By name, in this order; left out, all of the scene."""
    turntable: Turntable | None = None
    """The camera goes around."""
    sweep: Sweep | None = None
    """One light fades into the next; left out, every light has its own frames."""
    fps: Annotated[float, Field(gt=0, le=240, allow_inf_nan=False)] = 25.0
    """Frames a second, of films and keyframes."""
    format: Literal["png", "exr", "coefficients"] = "png"
    """Format of frames in a folder; coefficients: an image a camera, for compositors to relight."""
    bits: Literal[8, 16] = 8
    """Bits of a PNG's codes."""
    samples: Annotated[int, Field(ge=1, le=8)] = 1
    """n × n rays a pixel: smooth edges."""
    transparent: bool = False
    """No backdrop: opacity is stored in the file."""
    shows: Literal["display", "scene"] = "display"
    """In EXR: linear light of the display, with the appearance model applied; or of the scene."""
    spectral: bool = False
    """In EXR: a spectrum in every pixel; docs/compositing.md."""
    primaries: Literal["Rec. 709", "ACES AP0", "ACES AP1"] = "Rec. 709"
    """Primaries of EXR."""
    sheet: bool = True
    """A contact sheet next to the frames."""

    def __post_init__(self) -> None:
        if self.lights == ():
            raise fault("lights", "empty", "name one, or leave it out for all", "missing")
        form, spectra = self.format, "spectra" if self.spectral else "coefficients"
        sweep, turntable = self.sweep, self.turntable
        apart = self.spectral or form == "coefficients"  # files that compositors take apart
        frames = None if sweep is None or turntable is None else sweep.frames
        for field, refused, problem in (
            ("shows", form != "exr" and self.shows == "scene", '"scene" is for format = "exr"'),
            ("bits", form != "png" and self.bits != 8, f'{self.bits} is for format = "png"'),
            (
                "primaries",
                form == "png" and self.primaries != "Rec. 709",
                'are for format = "exr"; PNG has the display\'s',
            ),
            (
                "transparent",
                form == "coefficients" and self.transparent,
                'format = "coefficients" holds no backdrop',
            ),
            ("spectral", self.spectral and form != "exr", f'is for format = "exr", not "{form}"'),
            (
                "spectral",
                self.spectral and self.transparent,
                "holds the light of the backdrop, too, transparent has none",
            ),
            (
                "primaries",
                apart and self.primaries != "Rec. 709",
                f'R, G and B with {spectra} are Rec. 709, not "{self.primaries}"',
            ),
            (
                "sweep",
                form == "coefficients" and sweep is not None,
                'fades the light, which format = "coefficients" leaves to the compositor',
            ),
            (
                "sweep.frames",
                turntable is not None and frames not in (None, turntable.frames),
                f"{frames}, the turntable has {turntable and turntable.frames}",
            ),
        ):
            if refused:
                raise fault(field, problem, "leave out one of them")

    @property
    def suffix(self) -> str:
        """Ending of the files' names."""
        return ".png" if self.format == "png" else ".exr"

    @property
    def has_eye(self) -> bool:
        """True if the files hold what an eye sees, and not the light that reaches it."""
        return self.format == "png" or (
            self.format == "exr" and self.shows == "display" and not self.spectral
        )


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyCamera:
    """``camera`` of a keyframe: differences from [camera], of an orbit or a position."""

    azimuth_deg: Finite | None = None
    """The short way from the key before."""
    elevation_deg: Finite | None = None
    """Towards up."""
    zoom: Positive | None = None
    """As [camera]."""
    fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    """As [camera]."""
    target_mm: Vector | None = None
    """Point that it looks at."""
    position_mm: Vector | None = None
    """Its position, instead of the orbit; goes around the target."""
    up: Direction | None = None
    """With position_mm: direction that is above in the picture."""

    @property
    def given(self) -> set[str]:
        """Names of the fields that it gives."""
        names = (field.name for field in fields(self))
        return {name for name in names if getattr(self, name) is not None}


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyTransfer:
    """``transfer`` of a keyframe: each costs casts of its own."""

    shift: Finite | None = None
    """Added to the values of points, regions or surfaces."""
    points: Annotated[tuple[PointSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Instead of [transfer] points; as many in every keyframe, and there."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyViewing:
    """``viewing`` of a keyframe: differences from [viewing]."""

    exposure: Positive | None = None
    """Factor of all light."""
    L_A: Annotated[Positive, Unit("cd/m²")] | None = None
    """Adapting luminance."""
    Y_b: Positive | None = None
    """The background's luminance, white 100."""
    D: Fraction | None = None
    """Degree of adaptation."""


# Kind of a keyframe's camera: with a position, or without.
_KINDS = {True: "a position", False: "an orbit"}


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Keyframe:
    """``[[keyframe]]``: settings at a time; between two all moves smoothly.

    A value that some keyframes give moves between those; one that none gives is the scene's.
    """

    row_keys: ClassVar = ("time_s",)
    time_s: Annotated[NotNegative, Field(examples=[0])]
    """Rising."""
    camera: KeyCamera | None = None
    """The camera."""
    transfer: KeyTransfer | None = None
    """The transfer function."""
    lights: dict[Name, NotNegative] | None = None
    """Weights by light; lights left out are dark."""
    viewing: KeyViewing | None = None
    """The viewing conditions."""

    def __post_init__(self) -> None:
        if self.lights is not None and not any(self.lights.values()):
            raise fault(
                "lights", "no weight is above 0, so there is no light", "raise one", "range"
            )


def check_export(
    table: ExportSpec,
    keys: Sequence[Keyframe],
    lights: Sequence[str],
    camera: CameraSpec,
) -> None:
    """Refuse frames that cannot be of one scene; SceneError with the field."""
    names = table.lights or ()
    for i, name in enumerate(names):
        _check_light(f"export.lights[{i}]", name, lights)
        if name in names[:i]:
            raise fault(
                f"export.lights[{i}]", f"{name!r} is given twice", "leave out one", "duplicate"
            )
    for i, key in enumerate(keys):
        for name in key.lights or ():
            _check_light(f"keyframe[{i}].lights", name, lights)
    for i, (before, after) in enumerate(pairwise(keys), start=1):
        if not after.time_s > before.time_s:
            problem = f"{after.time_s:g} after {before.time_s:g}"
            raise fault(f"keyframe[{i}].time_s", problem, "give times that rise", "range")
    seconds = keys[-1].time_s - keys[0].time_s if keys else 0.0
    if seconds * table.fps >= MAX_FRAMES:
        raise fault(
            "keyframe",
            f"{seconds:g} s at {table.fps:g} frames a second are more than {MAX_FRAMES} frames",
            "give less",
            "size",
        )
    if keys:
        _check_ways(table, keys)
        _check_cameras(keys, camera)
    if table.sweep is not None and len(table.lights or lights) < 2:
        raise fault("export.sweep", "there is one light", "a sweep needs two", "missing")


def _check_cameras(keys: Sequence[Keyframe], camera: CameraSpec) -> None:
    """All of an orbit or all of positions: the way from one to the other would be a guess."""
    orbit = camera.position_mm is None
    first: dict[bool, str] = {} if orbit else {True: "[camera]'s position_mm"}
    for i, key in enumerate(keys):
        for name in sorted(key.camera.given) if key.camera is not None else ():
            if name in ("target_mm", "fov_deg"):
                continue
            where = f"keyframe[{i}].camera.{name}"
            if name == "position_mm" and camera.orthographic:
                # Its rays are parallel: the orbit's height would stay, wherever the camera is.
                raise fault(
                    where, "[camera] is orthographic", "give position_mm or orthographic, not both"
                )
            placed = name in ("position_mm", "up")
            first.setdefault(placed, f"[[keyframe]] {i + 1}'s {name}")
            if (not placed) in first:
                raise fault(
                    where,
                    f"of {_KINDS[placed]}, {first[not placed]} of {_KINDS[not placed]}",
                    "give one kind",
                )


def _check_light(where: str, name: str, lights: Sequence[str]) -> None:
    if name not in lights:
        remedy = f"{nearest(name, lights)}there is {', '.join(lights)}"
        raise fault(where, f"no [[light]] is named {name!r}", remedy, "unknown", name)


def _check_ways(table: ExportSpec, keys: Sequence[Keyframe]) -> None:
    """Keyframes with a turntable or a sweep: each thing is moved by one of them."""
    if table.turntable is not None:
        raise fault("export.turntable", "there are [[keyframe]]s, too", "leave out one of them")
    if table.sweep is not None and table.sweep.frames is not None:
        raise fault("export.sweep.frames", "the [[keyframe]]s give the number", "leave it out")
    weighted: Mapping[bool, int] = {key.lights is not None: i for i, key in enumerate(keys)}
    for name in ("sweep", "lights"):
        if True in weighted and getattr(table, name) is not None:
            problem = f"[[keyframe]] {weighted[True] + 1} has lights, too"
            raise fault(f"export.{name}", problem, "leave out one of them")
    if len(weighted) == 2:
        raise fault(
            f"keyframe[{weighted[False]}].lights",
            f"missing, [[keyframe]] {weighted[True] + 1} has some",
            "give them in all or in none",
            "missing",
        )
