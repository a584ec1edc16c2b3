"""Pictures for a file: cast at any size, relit as the window shows them.

state -> [screenshot] -> PNG
"""

from __future__ import annotations

from pathlib import Path

from volspec import __version__
from volspec.errors import ViewingError
from volspec.export import write_frame
from volspec.export.frames import file_stem
from volspec.pipeline import raycast
from volspec.raycast import CoefficientImage
from volspec.viewer.lighting import rig_of
from volspec.viewer.pictures import Pictures
from volspec.viewer.state import ViewState


def cast_for_file(state: ViewState, size: tuple[int, int]) -> CoefficientImage:
    """The picture of a state; on any thread.

    Raises
    ------
    VolspecError
        As `volspec.raycast`.
    """
    document = state.document
    return raycast(
        *(document.volume, state.transfer, state.view.camera(document.volume), size),
        state.shading,
        caster=document.caster,
    )


def save(pictures: Pictures, image: CoefficientImage, state: ViewState) -> Path:
    """Relight a picture and write it under a name that is free; where it is.

    Raises
    ------
    VolspecError, OSError
        If no light is on, it cannot be relit or not be written.
    """
    rig = rig_of(state.lights)
    if rig is None:
        raise ViewingError("No light is on, so there is no picture to save")
    path = _unused(f"volspec-{file_stem(state.document.title)}")
    frame = pictures.frame_of(image, rig, state.seen)
    notes = {"scene": state.document.title, "Software": f"volspec {__version__}"}
    write_frame(path, frame, notes, state.seen.viewing.display.space)
    return path


def _unused(stem: str) -> Path:
    """The first name of a row that is no file yet."""
    number = 1
    while (path := Path(f"{stem}-{number}.png")).exists():
        number += 1
    return path
