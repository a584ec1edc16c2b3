"""Pictures for a file: cast in the background at any size, relit as the window shows them.

state, Shot -> [screenshot] -> PNG
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec import __version__
from volspec.errors import CastCancelled, DeviceError, InputError, OpenCLError, ViewingError
from volspec.export import write_frame
from volspec.export.frames import file_stem
from volspec.pipeline import Relighter, raycast
from volspec.raycast import CoefficientImage
from volspec.raycast.checks import MAX_SIDE
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.probe import Reading

SHOWN, TWICE, UHD, CUSTOM = "As shown", "Twice as shown", "4K, 3840 × 2160", "Custom"
PRESETS = (SHOWN, TWICE, UHD, CUSTOM)
_UHD = (3840, 2160)
# Bytes of a pixel without its channels: alpha, two depths, the codes.
_OTHER_BYTES = 16


@dataclass(frozen=True, slots=True)
class Shot:
    """Settings for saved pictures."""

    preset: str = SHOWN
    custom: tuple[int, int] = _UHD  # width and height in pixels, for the last of `PRESETS`
    folder: str = ""  # empty for the current one
    name: str = ""  # without ".png"; empty for the scene's title

    def size(self, shown: tuple[int, int]) -> tuple[int, int]:
        """Return width and height in pixels; ``shown`` is the size in the window."""
        twice = 2 * shown[0], 2 * shown[1]
        sizes = {SHOWN: shown, TWICE: twice, UHD: _UHD, CUSTOM: self.custom}
        width, height = (min(max(side, 1), MAX_SIDE) for side in sizes[self.preset])
        return width, height

    def path(self, title: str) -> Path:
        """Return the first free path; names made from titles always have a number."""
        named = bool(self.name.strip())
        stem = file_stem(self.name.removesuffix(".png")) if named else ""
        stem = stem or f"volspec-{file_stem(title)}"
        names = chain([stem] * named, (f"{stem}-{number}" for number in count(1)))
        folder = Path(os.path.expanduser(self.folder))
        return next(path for name in names if not (path := folder / f"{name}.png").exists())


def megabytes(size: tuple[int, int], channels: int) -> float:
    """Estimate the memory that a picture takes while it is cast and relit, in MB."""
    width, height = size
    # Once each on the device, on the host, and packed for GL.
    return 3 * width * height * (4 * channels + _OTHER_BYTES) / 1e6


@dataclass(slots=True)
class Progress:
    """Progress of a cast for a file; the window shows it, and cancels the cast with ``ended``."""

    what: str
    share: float = 0.0  # 0 to 1
    ended: bool = False

    def report(self, share: float) -> None:
        """Set the share; called by the cast."""
        self.share = share


def save_picture(state: ViewState, shot: Shot, progress: Progress) -> Path:
    """Cast, relight and write a picture, off the window's thread; return its path."""
    path = shot.path(state.document.title)
    if not path.parent.is_dir():
        raise InputError(f"{path.parent}: no such folder; choose another", code="not-found")
    frame = render_frame(state, shot.size(state.size), progress)
    notes = {"scene": state.document.title, "Software": f"volspec {__version__}"}
    write_frame(path, frame, notes, state.relight.viewing.display.space)
    return path


def render_frame(state: ViewState, size: tuple[int, int], progress: Progress) -> NDArray[np.uint8]:
    """Render a state at a size, (H, W, 3), with both sides of the divide."""
    rig = light_rig(state.lights)
    if rig is None:
        raise ViewingError("No light is on, so there is no picture to save", code="missing")
    cancelled = CastCancelled("the picture was cancelled")
    try:
        image = _cast(state, size, progress)
    except CastCancelled:
        raise cancelled from None
    if progress.ended:
        raise cancelled
    other = light_rig(state.other) if state.other else None
    # In a context of this thread's own: many pixels take longer than the window may wait.
    with Relighter(image) as relighter:
        frame: NDArray[np.uint8] = relighter.frame(rig, state.relight)
        if other is not None:
            left = round(state.divide * frame.shape[1])
            frame = frame.copy()
            frame[:, left:] = relighter.frame(other, state.relight)[:, left:]
    return frame


def _cast(state: ViewState, size: tuple[int, int], progress: Progress) -> CoefficientImage:
    """Cast with a Raycaster of its own: the window's casts would wait for the document's."""
    document = state.document
    volume, shared = document.volume, document.caster
    camera = state.view.camera(volume)
    what = volume, state.transfer, camera, size, state.shading
    cast = partial(raycast, *what, progress=progress.report, cancel=lambda: progress.ended)
    try:
        return cast(device=shared.device if shared else None)
    except OpenCLError:
        if shared is None:
            raise
        # The device has no room for the volume twice.
        return cast(caster=shared)


class ClipboardError(DeviceError):
    """There is no clipboard, it refuses the data, or there is nothing to copy."""


def copy_shown(pictures: Pictures) -> str:
    """Copy the picture that is shown, for as long as the program runs; return a message."""
    if not pictures.framebuffer:
        raise ClipboardError("There is no picture to copy yet", code="missing")
    frame = pictures.pixels()
    height, width, _ = frame.shape
    data = np.dstack([frame, np.full((height, width), 255, np.uint8)]).tobytes()
    _copy("picture", lambda clipboard: clipboard.copy_image(data, width, height))
    return "The picture was copied"


def copy_values(reading: Reading | None) -> str:
    """Copy the values under the mouse, a name and a value per line; return a message."""
    if reading is None:
        raise ClipboardError("Point at something in the picture first", code="missing")
    _copy("text", lambda clipboard: clipboard.copy(str(reading)))
    return "The values were copied"


def _copy(what: str, copy: Callable[[Any], object]) -> None:
    import copykitten

    try:
        copy(copykitten)
    except copykitten.CopykittenError as error:
        raise ClipboardError(f"The {what} cannot be copied: {error}", code="unsupported") from error
