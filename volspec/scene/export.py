"""``[export]`` and ``[[keyframe]]``: which re-lit frames a scene is exported as.

    tables -> [export] -> volspec.export.plan

What they mean is told to users in docs/export.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from volspec._tables import Name, Table
from volspec.errors import nearest
from volspec.scene.keyparts import (
    Direction,
    Finite,
    KeyCameraTable,
    KeyTransferTable,
    KeyViewingTable,
    NotNegative,
)
from volspec.scene.tables import CameraTable

# A film of an hour and more; beyond it a number is a slip.
MAX_FRAMES = 100_000
Frames = Annotated[int, Field(ge=1, le=MAX_FRAMES)]


class TurntableTable(Table):
    """``turntable`` of [export]: the camera goes around what it looks at."""

    frames: Annotated[Frames, Field(examples=[72])]
    """How many; a whole turn ends one before the first, so that it can be repeated."""
    degrees: Finite = 360.0
    """How far; negative turns the other way."""
    axis: Direction | None = None
    """What it turns about; left out, the camera's up."""


class SweepTable(Table):
    """``sweep`` of [export]: one light fades into the next."""

    frames: Frames | None = None
    """How many; left out, as many as the camera has, 24 a fade where it stands still."""
    closed: bool = False
    """From the last light back to the first, so that it can be repeated."""


class ExportTable(Table):
    """``[export]``: which frames are made, and as what files."""

    lights: list[Name] | None = None
    """By name, in this order; left out, all of the scene."""
    turntable: TurntableTable | None = None
    """The camera goes around."""
    sweep: SweepTable | None = None
    """One light fades into the next; left out, every light has its own frames."""
    fps: Annotated[float, Field(gt=0, le=240, allow_inf_nan=False)] = 25.0
    """Frames a second, of films and keyframes."""
    format: Literal["png", "exr", "coefficients"] = "png"
    """Of frames in a folder; or one coefficient image a camera, to be relit by a compositor."""
    bits: Literal[8, 16] = 8
    """Of a PNG's codes."""
    samples: Annotated[int, Field(ge=1, le=8)] = 1
    """n × n rays a pixel: smooth edges."""
    transparent: bool = False
    """No backdrop: opacity is kept in the file."""
    shows: Literal["display", "scene"] = "display"
    """Of EXR: linear light of the display, what the eye makes of it included; or of the scene."""
    spectral: bool = False
    """Of EXR: a spectrum in every pixel; docs/compositing.md."""
    primaries: Literal["Rec. 709", "ACES AP0", "ACES AP1"] = "Rec. 709"
    """Of EXR."""
    sheet: bool = True
    """A contact sheet beside the frames."""

    @model_validator(mode="after")
    def _fit_together(self) -> ExportTable:
        if self.lights is not None and not self.lights:
            raise ValueError("lights: is empty; name one, or leave it out for all")
        if self.format != "exr" and self.shows == "scene":
            raise ValueError(
                f'shows = "scene" is for format = "exr", not "{self.format}"; leave out one of them'
            )
        if self.format != "png" and self.bits != 8:
            raise ValueError(
                f'bits = {self.bits} is for format = "png", not "{self.format}"; leave it out'
            )
        if self.format == "png" and self.primaries != "Rec. 709":
            raise ValueError(
                f'primaries = "{self.primaries}" is for format = "exr"; PNG has the display\'s, '
                "leave it out"
            )
        if self.format == "coefficients" and self.transparent:
            raise ValueError(
                'transparent: format = "coefficients" holds no backdrop; leave transparent out'
            )
        self._check_spectra()
        if self.sweep is None:
            return self
        if self.turntable is not None and self.sweep.frames not in (None, self.turntable.frames):
            raise ValueError(
                f"turntable has {self.turntable.frames} frames, sweep {self.sweep.frames}; leave "
                "out the sweep's"
            )
        return self

    def _check_spectra(self) -> None:
        """Of what compositors take apart: which settings have no meaning beside it."""
        if self.spectral and self.format != "exr":
            raise ValueError(
                f'spectral: is for format = "exr", not "{self.format}"; leave out one of them'
            )
        if self.spectral and self.transparent:
            raise ValueError(
                "spectral: holds the light of the backdrop, too, transparent has none; leave out "
                "one of them"
            )
        is_taken_apart = self.spectral or self.format == "coefficients"
        if is_taken_apart and self.primaries != "Rec. 709":
            kind = "spectra" if self.spectral else "coefficients"
            raise ValueError(
                f'primaries: R, G and B beside {kind} are Rec. 709, not "{self.primaries}"; leave '
                "it out"
            )
        if self.format == "coefficients" and self.sweep is not None:
            raise ValueError(
                'sweep: fades the light, which format = "coefficients" leaves to the compositor; '
                "leave out one of them"
            )

    @property
    def suffix(self) -> str:
        """Of the files' names."""
        return ".png" if self.format == "png" else ".exr"

    @property
    def has_eye(self) -> bool:
        """Whether the files hold what an eye sees, and not the light that reaches it."""
        return self.format == "png" or (
            self.format == "exr" and self.shows == "display" and not self.spectral
        )


# Of a keyframe's camera, by whether it says where it stands.
_KINDS = {True: "a place", False: "an orbit"}


class KeyframeTable(Table):
    """``[[keyframe]]``: what holds at a time; between two all moves smoothly.

    A value that some keyframes give moves between those; one that none gives is the scene's.
    """

    row_keys = ("time_s",)
    time_s: Annotated[NotNegative, Field(examples=[0])]
    """Rising."""
    camera: KeyCameraTable | None = None
    """Where it is seen from."""
    transfer: KeyTransferTable | None = None
    """What is seen of the volume."""
    lights: dict[Name, NotNegative] | None = None
    """Weights by light; lights left out are dark."""
    viewing: KeyViewingTable | None = None
    """The eye."""

    @model_validator(mode="after")
    def _some_light(self) -> KeyframeTable:
        if self.lights is not None and not any(self.lights.values()):
            raise ValueError("lights: no weight is above 0, so there is no light; raise one")
        return self


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export has made.

    Parameters
    ----------
    output : Path
        The folder, or the film.
    files : tuple of str
        Within the folder; of a film the film alone.
    frames, made : int
        How many there are, and how many of them this call has made.
    casts : int
        That it took.
    """

    output: Path
    files: tuple[str, ...]
    frames: int
    made: int
    casts: int


def check_export(
    table: ExportTable,
    keys: Sequence[KeyframeTable],
    lights: Sequence[str],
    camera: CameraTable,
) -> None:
    """Refuse frames that cannot be of one scene.

    Parameters
    ----------
    table : ExportTable
    keys : sequence of KeyframeTable
    lights : sequence of str
        Names that the scene has.
    camera : CameraTable
        The scene's.

    Raises
    ------
    ValueError
        Names the field.
    """
    for i, name in enumerate(table.lights or (), start=1):
        _check_light(f"export.lights.{i}", name, lights)
    for name in table.lights or ():
        if (table.lights or []).count(name) > 1:
            raise ValueError(f"export.lights: {name!r} is named twice; leave out one")
    for i, key in enumerate(keys, start=1):
        for name in key.lights or ():
            _check_light(f"keyframe.{i}.lights", name, lights)
    for i, (before, after) in enumerate(pairwise(keys), start=2):
        if not after.time_s > before.time_s:
            raise ValueError(
                f"keyframe.{i}.time_s: is {after.time_s:g} after {before.time_s:g}; give times "
                "that rise"
            )
    seconds = keys[-1].time_s - keys[0].time_s if keys else 0.0
    if seconds * table.fps >= MAX_FRAMES:
        raise ValueError(
            f"keyframe: {seconds:g} s at {table.fps:g} frames a second are more than "
            f"{MAX_FRAMES} frames; give less"
        )
    if keys:
        _check_ways(table, keys)
        _check_cameras(keys, camera)
    if table.sweep is not None and len(table.lights or lights) < 2:
        raise ValueError("export.sweep: there is one light; a sweep needs two")


def _check_cameras(keys: Sequence[KeyframeTable], camera: CameraTable) -> None:
    """All of an orbit or all of places: the way from one to the other would be a guess."""
    orbit = camera.position_mm is None
    first: dict[bool, str] = {} if orbit else {True: "[camera]'s position_mm"}
    for i, key in enumerate(keys, start=1):
        for name in sorted(key.camera.given) if key.camera is not None else ():
            if name in ("target_mm", "fov_deg"):
                continue
            if name == "position_mm" and camera.orthographic:
                # Its rays are parallel: the orbit's height would stay, wherever it stands.
                raise ValueError(
                    f"keyframe.{i}.camera.position_mm: [camera] is orthographic; give position_mm "
                    "or orthographic, not both"
                )
            placed = name in ("position_mm", "up")
            first.setdefault(placed, f"keyframe.{i}.camera.{name}")
            if (not placed) in first:
                raise ValueError(
                    f"keyframe.{i}.camera.{name}: is of {_KINDS[placed]}, {first[not placed]} of "
                    f"{_KINDS[not placed]}; give one kind"
                )


def _check_light(where: str, name: str, lights: Sequence[str]) -> None:
    if name not in lights:
        raise ValueError(
            f"{where}: no [[light]] is named {name!r}; {nearest(name, lights)}there is "
            f"{', '.join(lights)}"
        )


def _check_ways(table: ExportTable, keys: Sequence[KeyframeTable]) -> None:
    """Keyframes beside a turntable or a sweep: each thing is moved by one of them."""
    if table.turntable is not None:
        raise ValueError("export.turntable: there are [[keyframe]]s, too; leave out one of them")
    if table.sweep is not None and table.sweep.frames is not None:
        raise ValueError("export.sweep: the [[keyframe]]s say how many frames; leave it out")
    weighted: Mapping[bool, int] = {key.lights is not None: i for i, key in enumerate(keys, 1)}
    if True in weighted and table.sweep is not None:
        raise ValueError(
            f"export.sweep: keyframe.{weighted[True]} has lights, too; leave out one of them"
        )
    if True in weighted and table.lights is not None:
        raise ValueError(
            f"export.lights: keyframe.{weighted[True]} has lights, too; leave out one of them"
        )
    if len(weighted) == 2:
        raise ValueError(
            f"keyframe.{weighted[False]}: has no lights, keyframe.{weighted[True]} has; give them "
            "in all or in none"
        )
