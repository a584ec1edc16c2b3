"""Pictures and text for other programs: the system's clipboard.

frame, values -> [clipboard] -> X11, Wayland, macOS, Windows
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.errors import DeviceError
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.probe import Reading


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
