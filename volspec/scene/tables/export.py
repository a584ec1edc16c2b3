"""``[export]`` and ``[[keyframe]]``: the re-lit frames to export from a scene.

    tables -> [export] -> volspec.export.plan

User guide: docs/export.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import AfterValidator, Field

from volspec.appearance.display import Hdr
from volspec.errors import SceneError, nearest
from volspec.relight import Stereo
from volspec.scene.tables.specs import CameraSpec, fault
from volspec.scene.tables.transfer import PointSpec
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
        raise SceneError("", "give a direction of non-zero length", code="range", given=axis)
    return axis


Direction = Annotated[Vector, AfterValidator(_direction)]
# More than an hour of film; a larger number is a slip.
MAX_FRAMES = 100_000
Frames = Annotated[int, Field(ge=1, le=MAX_FRAMES)]


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Turntable:
    """``turntable`` of [export]: the camera orbits its target."""

    frames: Annotated[Frames, Field(examples=[72])]
    """Number of frames; a full turn ends one step before its start, so that it can loop."""
    degrees: Finite = 360.0
    """Angle of the turn; negative turns the other way."""
    axis: Direction | None = None
    """Axis of the turn; default: the camera's up."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Sweep:
    """``sweep`` of [export]: one light fades into the next."""

    frames: Frames | None = None
    """Number of frames; default: as many as the camera has, or 24 per fade if it does not move."""
    closed: bool = False
    """Fade from the last light back to the first, so that it can loop."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Play:
    """``play`` of [export]: the time steps of a series follow each other."""

    frames: Frames | None = None
    """Number of frames; default: as many as the camera or the lights have, or else one per step."""
    loops: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of times that the series is played."""


Mark = Literal["scale", "orientation", "title", "light", "materials", "values"]
MARKS: tuple[Mark, ...] = get_args(Mark)


# Bits per channel of pictures for displays.
_BITS: Mapping[str, tuple[int, ...]] = {"png": (8, 16), "avif": (8, 10, 12)}


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class ExportSpec:
    """``[export]``: the frames to make, and their file formats."""

    lights: Annotated[tuple[Name, ...], Field(strict=False)] | None = None
    """Names of lights, in this order; default: all lights of the scene."""
    turntable: Turntable | None = None
    """The camera orbits its target."""
    sweep: Sweep | None = None
    """One light fades into the next; default: each light has its own frames."""
    play: Play | None = None
    """The time steps of a series follow each other; default: that of [volume] step."""
    fps: Annotated[float, Field(gt=0, le=240, allow_inf_nan=False)] = 25.0
    """Frames per second, of films and keyframes."""
    format: Literal["png", "avif", "exr", "coefficients"] = "png"
    """Frame format in a folder; avif is for hdr; coefficients: one image per camera, for
    compositors to relight."""
    bits: Literal[8, 10, 12, 16] = 8
    """Bits per channel: 8 or 16 of PNG, 10 or 12 of AVIF. With hdr, PNG has 16 and AVIF at least
    10."""
    hdr: Hdr | None = None
    """PNG and AVIF for displays of high dynamic range: highlights are brighter than white. The
    lights must have illuminance_lux."""
    samples: Annotated[int, Field(ge=1, le=8)] = 1
    """n for n × n rays per pixel: smooth edges."""
    transparent: bool = False
    """Omit the backdrop and store opacity in the file."""
    shows: Literal["display", "scene"] = "display"
    """EXR: linear light of the display, with the appearance model applied; or of the scene."""
    spectral: bool = False
    """EXR: a spectrum in every pixel; docs/compositing.md."""
    primaries: Literal["Rec. 709", "ACES AP0", "ACES AP1"] = "Rec. 709"
    """Primaries of EXR."""
    sheet: bool = True
    """Write a contact sheet next to the frames."""
    annotate: Annotated[tuple[Mark, ...], Field(strict=False)] = ()
    """PNG and films: marks in the picture: scale, orientation, title, light, materials, and values,
    a bar of their colours, with numbers and their unit, also in pages."""
    stereo: Stereo | None = None
    """PNG and films: both eyes' pictures in one, of one cast with [raycast] layers, otherwise of
    two casts."""

    def __post_init__(self) -> None:
        if self.lights == ():
            raise fault("lights", "empty", "name a light, or leave it out for all", "missing")
        form, spectra = self.format, "spectra" if self.spectral else "coefficients"
        sweep, turntable = self.sweep, self.turntable
        composited = self.spectral or form == "coefficients"  # files that compositors take apart
        frames = None if sweep is None or turntable is None else sweep.frames
        played = None if self.play is None else self.play.frames
        lengths = [motion.frames for motion in (turntable, sweep) if motion and motion.frames]
        for field, refused, problem in (
            (
                "shows",
                form != "exr" and self.shows == "scene",
                f'"scene" is for format = "exr", not "{form}"',
            ),
            (
                "bits",
                self.bits not in _BITS.get(form, (8,)),
                f'{self.bits} is for format = "{"png" if self.bits == 16 else "avif"}", '
                f'not "{form}"',
            ),
            (
                "hdr",
                form not in _BITS and self.hdr is not None,
                f'is for format = "png" or "avif", not "{form}"',
            ),
            (
                "hdr",
                self.hdr is not None and bool(self.annotate),
                "annotate marks pictures whose white is their end",
            ),
            ("transparent", form == "avif" and self.transparent, 'format = "avif" has no opacity'),
            (
                "primaries",
                form in _BITS and self.primaries != "Rec. 709",
                f'are for format = "exr"; {form.upper()} uses the display\'s',
            ),
            (
                "transparent",
                form == "coefficients" and self.transparent,
                'format = "coefficients" holds no backdrop',
            ),
            (
                "annotate",
                form != "png" and bool(self.annotate),
                f'is for format = "png", not "{form}"',
            ),
            (
                "stereo",
                form != "png" and self.stereo is not None,
                f'is for format = "png", not "{form}"',
            ),
            (
                "stereo",
                self.stereo is not None and (self.transparent or self.hdr is not None),
                f"does not work with {'transparent' if self.transparent else 'hdr'}",
            ),
            ("spectral", self.spectral and form != "exr", f'is for format = "exr", not "{form}"'),
            (
                "spectral",
                self.spectral and self.transparent,
                "includes the light of the backdrop, but transparent has none",
            ),
            (
                "primaries",
                composited and self.primaries != "Rec. 709",
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
                f"{frames}, but the turntable has {turntable and turntable.frames}",
            ),
            (
                "play.frames",
                played is not None and lengths != [played] * len(lengths),
                f"{played}, but the turntable or the sweep has {', '.join(map(str, lengths))}",
            ),
        ):
            if refused:
                raise fault(field, problem, "leave out one of them")
        if form == "avif" and self.hdr is None:
            raise fault("hdr", 'missing, but format = "avif" is for it', "give hdr", "missing")

    @property
    def suffix(self) -> str:
        """File name suffix."""
        return f".{self.format}" if self.format in _BITS else ".exr"

    @property
    def depth(self) -> int:
        """Bits per channel of PNG and AVIF."""
        if self.hdr is None:
            return self.bits
        return 16 if self.format == "png" else max(self.bits, 10)

    def frame_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return width and height of the files, of pictures of a size."""
        return size if self.stereo is None else self.stereo.frame_size(size)

    @property
    def has_eye(self) -> bool:
        """True if the appearance model is applied, False for the light that reaches the eye."""
        return self.format in _BITS or (
            self.format == "exr" and self.shows == "display" and not self.spectral
        )


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyCamera:
    """``camera`` of a keyframe: changes to [camera], of an orbit or a position."""

    azimuth_deg: Finite | None = None
    """Angle around up; goes the short way from the previous keyframe."""
    elevation_deg: Finite | None = None
    """Angle towards up."""
    zoom: Positive | None = None
    """As [camera]."""
    fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    """As [camera]."""
    target_mm: Vector | None = None
    """Point that the camera looks at."""
    position_mm: Vector | None = None
    """The camera's position, instead of an orbit; moves around the target."""
    up: Direction | None = None
    """With position_mm: direction that points up in the picture."""

    @property
    def set_keys(self) -> set[str]:
        """Names of the fields that are set."""
        names = (field.name for field in fields(self))
        return {name for name in names if getattr(self, name) is not None}


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyTransfer:
    """``transfer`` of a keyframe: each change needs a new cast."""

    shift: Finite | None = None
    """Added to the values of points, regions or surfaces."""
    points: Annotated[tuple[PointSpec, ...], Field(strict=False, min_length=1)] | None = None
    """Replaces [transfer] points; their number must be the same there and in every keyframe."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyViewing:
    """``viewing`` of a keyframe: changes to [viewing]."""

    exposure: Positive | None = None
    """Factor of all light."""
    L_A: Annotated[Positive, Unit("cd/m²")] | None = None
    """Adapting luminance."""
    Y_b: Positive | None = None
    """Background luminance, white 100."""
    D: Fraction | None = None
    """Degree of adaptation."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class KeyDepth:
    """``depth`` of a keyframe: changes to [depth], as a focus pull; no cast."""

    focus_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance in focus."""
    aperture_mm: Annotated[Positive, Unit("mm")] | None = None
    """Diameter of the lens's opening."""
    fog_mm: Annotated[Positive, Unit("mm")] | None = None
    """Visibility."""
    near_mm: Annotated[NotNegative, Unit("mm")] | None = None
    """Near cut: nothing nearer is shown."""
    far_mm: Annotated[Positive, Unit("mm")] | None = None
    """Far cut: nothing farther is shown."""


# Kind of a keyframe's camera: with a position, or without.
_KINDS = {True: "a position", False: "an orbit"}


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class Keyframe:
    """``[[keyframe]]``: settings at a time, smoothly interpolated in between.

    A value is interpolated between the keyframes that give it; otherwise it is the scene's.
    """

    row_keys: ClassVar = ("time_s",)
    time_s: Annotated[NotNegative, Field(examples=[0])]
    """Rising."""
    camera: KeyCamera | None = None
    """The camera."""
    transfer: KeyTransfer | None = None
    """The transfer function."""
    lights: dict[Name, NotNegative] | None = None
    """Weights by light name; lights left out are dark."""
    viewing: KeyViewing | None = None
    """The viewing conditions."""
    depth: KeyDepth | None = None
    """Focus, fog and cuts."""
    opacities: dict[Name, NotNegative] | None = None
    """Scales of materials' optical depths, as [raycast] opacities; with [raycast] layers they need
    no new cast."""

    def __post_init__(self) -> None:
        if self.lights is not None and not any(self.lights.values()):
            raise fault(
                "lights", "no weight is above 0, so there is no light", "raise a weight", "range"
            )


def check_export(
    table: ExportSpec,
    keys: Sequence[Keyframe],
    lights: Sequence[str],
    camera: CameraSpec,
) -> None:
    """Raise a SceneError with the field if the frames do not fit the scene."""
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
            problem = f"{after.time_s:g} follows {before.time_s:g}"
            raise fault(f"keyframe[{i}].time_s", problem, "give increasing times", "range")
    seconds = keys[-1].time_s - keys[0].time_s if keys else 0.0
    if seconds * table.fps >= MAX_FRAMES:
        raise fault(
            "keyframe",
            f"{seconds:g} s at {table.fps:g} frames per second are more than {MAX_FRAMES} frames",
            "give fewer",
            "size",
        )
    if keys:
        _check_ways(table, keys)
        _check_cameras(keys, camera)
    if table.sweep is not None and len(table.lights or lights) < 2:
        raise fault("export.sweep", "there is one light", "a sweep needs two", "missing")


def _check_cameras(keys: Sequence[Keyframe], camera: CameraSpec) -> None:
    """Require only orbits or only positions: a path between the two would be a guess."""
    orbit = camera.position_mm is None
    first: dict[bool, str] = {} if orbit else {True: "[camera]'s position_mm"}
    for i, key in enumerate(keys):
        for name in sorted(key.camera.set_keys) if key.camera is not None else ():
            if name in ("target_mm", "fov_deg"):
                continue
            where = f"keyframe[{i}].camera.{name}"
            if name == "position_mm" and camera.orthographic:
                # The rays are parallel: the picture's height would stay the orbit's.
                raise fault(
                    where, "[camera] is orthographic", "give position_mm or orthographic, not both"
                )
            placed = name in ("position_mm", "up")
            first.setdefault(placed, f"[[keyframe]] {i + 1}'s {name}")
            if (not placed) in first:
                raise fault(
                    where,
                    f"belongs to {_KINDS[placed]}, but {first[not placed]} to {_KINDS[not placed]}",
                    "give one kind",
                )


def _check_light(where: str, name: str, lights: Sequence[str]) -> None:
    if name not in lights:
        remedy = f"{nearest(name, lights)}known: {', '.join(lights)}; add it as a [[light]]"
        raise fault(where, f"no [[light]] is named {name!r}", remedy, "unknown", name)


def _check_ways(table: ExportSpec, keys: Sequence[Keyframe]) -> None:
    """Refuse keyframes and a turntable, sweep or lights that set the same thing."""
    if table.turntable is not None:
        raise fault("export.turntable", "given with [[keyframe]]", "leave out one of them")
    if table.sweep is not None and table.sweep.frames is not None:
        raise fault("export.sweep.frames", "set by the [[keyframe]]s", "leave it out")
    if table.play is not None and table.play.frames is not None:
        raise fault("export.play.frames", "set by the [[keyframe]]s", "leave it out")
    weighted: Mapping[bool, int] = {key.lights is not None: i for i, key in enumerate(keys)}
    for name in ("sweep", "lights"):
        if True in weighted and getattr(table, name) is not None:
            problem = f"[[keyframe]] {weighted[True] + 1} also has lights"
            raise fault(f"export.{name}", problem, "leave out one of them")
    if len(weighted) == 2:
        raise fault(
            f"keyframe[{weighted[False]}].lights",
            f"missing, but [[keyframe]] {weighted[True] + 1} has lights",
            "give them in all or in none",
            "missing",
        )
