"""Pictures for a file: cast in the background at any size, relit as the window shows them.

state, Shot -> [screenshot] -> PNG
"""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec import __version__
from volspec.errors import CastCancelled, DeviceError, InputError, OpenCLError, ViewingError
from volspec.export import write_frame
from volspec.export.frames import file_stem
from volspec.pipeline import Relighter, raycast
from volspec.raycast import CoefficientImage
from volspec.raycast.checks import MAX_SIDE
from volspec.relight import LightRig
from volspec.viewer.model.light_rows import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.probe import Reading

SHOWN, TWICE, UHD, CUSTOM = "As shown", "Twice as shown", "4K, 3840 × 2160", "Custom"
PRESETS = (SHOWN, TWICE, UHD, CUSTOM)
_UHD = (3840, 2160)
# Bytes of a pixel beside its channels: alpha, two depths, the codes.
_BESIDE = 16


@dataclass(frozen=True, slots=True)
class Shot:
    """How pictures are saved.

    Parameters
    ----------
    preset : str
        One of `PRESETS`.
    custom : (width, height)
        Pixels, for the last of them.
    folder : str
        Empty is where the program runs.
    name : str
        Without ``.png``; empty is made of the scene's title. A number is added where there is
        such a file.
    """

    preset: str = SHOWN
    custom: tuple[int, int] = _UHD
    folder: str = ""
    name: str = ""

    def size(self, shown: tuple[int, int]) -> tuple[int, int]:
        """Width and height in pixels, where the window shows a picture of this size."""
        if self.preset == SHOWN:
            return shown
        wanted = {TWICE: (2 * shown[0], 2 * shown[1]), UHD: _UHD}.get(self.preset, self.custom)
        width, height = (min(max(int(side), 1), MAX_SIDE) for side in wanted)
        return width, height

    def path(self, title: str) -> Path:
        """The first name that is no file yet."""
        stem = file_stem(self.name.removesuffix(".png")) if self.name.strip() else ""
        stem = stem or f"volspec-{file_stem(title)}"
        numbered = (f"{stem}-{number}" for number in count(1))
        names = chain([stem], numbered) if self.name.strip() else numbered
        folder = Path(os.path.expanduser(self.folder))
        return next(path for name in names if not (path := folder / f"{name}.png").exists())


def megabytes(size: tuple[int, int], channels: int) -> float:
    """About what a picture takes while it is cast and relit."""
    width, height = size
    # On the device, on the host, and packed for GL.
    return 3 * width * height * (4 * channels + _BESIDE) / 1e6


@dataclass(slots=True)
class Progress:
    """How far a cast for a file is; the window reads it, and may end it.

    Parameters
    ----------
    what : str
        What is said of it.
    share : float
        0 to 1.
    """

    what: str
    share: float = 0.0
    _ended: threading.Event = field(default_factory=threading.Event)

    def end(self) -> None:
        """Give it up."""
        self._ended.set()

    @property
    def ended(self) -> bool:
        """Whether it shall be given up."""
        return self._ended.is_set()

    def report(self, share: float) -> None:
        """What casts call."""
        self.share = share


def save_picture(state: ViewState, shot: Shot, progress: Progress) -> Path:
    """Cast, relight and write a picture; on any thread but the window's. Where it is.

    Raises
    ------
    CastCancelled
        If it was given up.
    VolspecError, OSError
        If no light is on, it cannot be cast or relit, or not be written.
    """
    path = shot.path(state.document.title)
    if not path.parent.is_dir():
        raise InputError(f"{path.parent}: no such folder; choose another")
    frame = frame_of(state, shot.size(state.size), progress)
    notes = {"scene": state.document.title, "Software": f"volspec {__version__}"}
    write_frame(path, frame, notes, state.relight.viewing.display.space)
    return path


def frame_of(state: ViewState, size: tuple[int, int], progress: Progress) -> NDArray[np.uint8]:
    """(H, W, 3) the picture of a state at a size, with what is kept beside it.

    Raises
    ------
    CastCancelled, VolspecError
        As `save_picture`.
    """
    rig = rig_of(state.lights)
    if rig is None:
        raise ViewingError("No light is on, so there is no picture to save")
    image = _cast(state, size, progress)
    if progress.ended:
        raise CastCancelled("the picture was given up")
    other = rig_of(state.other) if state.other else None
    return _relit(image, state, rig, other)


def _cast(state: ViewState, size: tuple[int, int], progress: Progress) -> CoefficientImage:
    """With a Raycaster of its own, as the window's casts would wait for that of the document."""
    document = state.document
    volume, shared = document.volume, document.caster
    what = volume, state.transfer, state.view.camera(volume), size, state.shading

    def cancel() -> bool:
        return progress.ended

    try:
        device = shared.device if shared else None
        return raycast(*what, device=device, progress=progress.report, cancel=cancel)
    except OpenCLError:
        if shared is None:
            raise
        # The device has no room for the volume twice.
        return raycast(*what, caster=shared, progress=progress.report, cancel=cancel)


def _relit(
    image: CoefficientImage, state: ViewState, rig: LightRig, other: LightRig | None
) -> NDArray[np.uint8]:
    # A context of this thread's own: many pixels take longer than the window may wait.
    with Relighter(image) as relighter:
        frame: NDArray[np.uint8] = relighter.frame(rig, state.relight)
        if other is not None:
            left = round(state.divide * frame.shape[1])
            frame = frame.copy()
            frame[:, left:] = relighter.frame(other, state.relight)[:, left:]
    return frame


class ClipboardError(DeviceError):
    """There is no clipboard, it does not take what it is given, or there is nothing to give."""


def copy_shown(pictures: Pictures) -> str:
    """Copy the picture that is shown; what to say of it.

    Raises
    ------
    ClipboardError
        If there is none, or as `copy_picture`.
    """
    if not pictures.framebuffer:
        raise ClipboardError("There is no picture to copy yet")
    copy_picture(pictures.pixels())
    return "The picture is copied"


def copy_values(reading: Reading | None) -> str:
    """Copy what is under the mouse, a name and a value to the line; what to say of it.

    Raises
    ------
    ClipboardError
        If nothing is there, or as `copy_text`.
    """
    if reading is None:
        raise ClipboardError("Point at something in the picture first")
    copy_text(str(reading))
    return "The values are copied"


def copy_picture(frame: NDArray[np.uint8]) -> None:
    """Put a picture on the clipboard; it stays there while the program runs.

    Parameters
    ----------
    frame : (H, W, 3) uint8

    Raises
    ------
    ClipboardError
    """
    import copykitten

    height, width, _ = frame.shape
    opaque = np.full((height, width, 1), 255, np.uint8)
    data = np.concatenate([frame, opaque], axis=2).tobytes()
    try:
        copykitten.copy_image(data, width, height)
    except copykitten.CopykittenError as error:
        raise ClipboardError(f"The picture cannot be copied: {error}") from error


def copy_text(text: str) -> None:
    """Put text on the clipboard.

    Raises
    ------
    ClipboardError
    """
    import copykitten

    try:
        copykitten.copy(text)
    except copykitten.CopykittenError as error:
        raise ClipboardError(f"The text cannot be copied: {error}") from error
