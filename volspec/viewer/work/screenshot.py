"""Pictures for a file: cast in the background at any size, relit as the window shows them.

state, Shot -> [screenshot] -> PNG
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec import __version__
from volspec.errors import CastCancelled, DeviceError, ViewingError
from volspec.export import (
    MarkedPicture,
    Patch,
    material_colours,
    paint,
    picture_marks,
    value_bars,
    write_frame,
)
from volspec.image import CoefficientImage
from volspec.pipeline import Raycaster, Relighter, raycast
from volspec.raycast import WHOLE
from volspec.scene.tables import Mark
from volspec.viewer.model.depth import needs_layers, picture_look, picture_spec, shown_stereo
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.light_rows import light_rig, lit_names
from volspec.viewer.model.room import has_walls, shown_spec, solve_radiosity
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.outputs import (
    Destination,
    PictureSize,
    Progress,
    short_title,
    with_own_caster,
)
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.probe import PixelProbe

# Bytes of a pixel without its channels: alpha, two depths, the codes.
_OTHER_BYTES = 16


@dataclass(frozen=True, slots=True)
class Still:
    """Settings for saved pictures."""

    size: PictureSize = field(default_factory=PictureSize)
    to: Destination = field(default_factory=Destination)
    marks: tuple[Mark, ...] | None = None  # None: the scale bar, if it is on the screen
    title: str = ""  # in the picture; empty for the document's

    def marks_for(self, state: ViewState) -> tuple[Mark, ...]:
        """Return the marks of a state's picture."""
        if self.marks is not None:
            return self.marks
        has_scale = state.interface.overlays.scale and shown_stereo(state) != "side-by-side"
        return ("scale",) if has_scale else ()


def megabytes(size: tuple[int, int], channels: int) -> float:
    """Estimate the memory that a picture takes while it is cast and relit, in MB."""
    width, height = size
    # Once each on the device, on the host, and packed for GL.
    return 3 * width * height * (4 * channels + _OTHER_BYTES) / 1e6


def save_picture(state: ViewState, shot: Still, progress: Progress) -> Path:
    """Cast, relight and write a picture, off the window's thread; return its path."""
    path, state = shot.to.new_path(state.document, ".png"), solve_radiosity(state)
    size = shot.size.pixels(state.size)
    frame = render_frame(state, size, progress, partial(_marks, state, shot))
    notes = {"scene": state.document.title, "Software": f"volspec {__version__}"}
    write_frame(path, frame, notes, state.relight.viewing.display.space)
    return path


def _marks(state: ViewState, shot: Still, cast: CoefficientImage) -> list[Patch]:
    """Return the marks of a picture; their colours are those on the left of a divide."""
    rig, spec = light_rig(state.lights, state.room), shown_spec(state)
    volume, image = state.document.volume, state.document.image
    # The rest would be that of a volume and a view, which a cast image does not have.
    names = shot.marks_for(state)
    marks = [mark for mark in names if image is None or mark in ("title", "light")]
    annotations = state.annotations if image is None else ()
    if rig is None or not (marks or annotations):
        return []
    transfer, group_shares = state.transfer, state.shading.shares()
    materials = transfer.materials if "materials" in marks else {}
    picture = MarkedPicture(
        cast.size,
        cast.camera or state.view.camera(volume),
        volume,
        shot.title.strip() or short_title(state.document),
        " | ".join(map(lit_names, filter(None, (state.lights, state.other)))),
        material_colours(materials, transfer.basis, rig, spec, group_shares),
        state.interface.overlays.patient,
        annotations,
        value_bars(state.transfer, volume, transfer.basis, rig, spec, group_shares)
        if "values" in marks
        else (),
    )
    return picture_marks(marks, picture)


def render_frame(
    state: ViewState,
    size: tuple[int, int],
    progress: Progress,
    marks: Callable[[CoefficientImage], list[Patch]] = lambda _: [],
) -> NDArray[np.uint8]:
    """Render a state at a size, (H, W, 3), as it is shown: both sides of the divide, both eyes.

    A cast image has a size of its own. Each eye's picture has its ``marks``.
    """
    rig = light_rig(state.lights, state.room)
    if rig is None:
        raise ViewingError("No light is on, so there is no picture to save", code="missing")
    image, look = state.document.image, picture_look(state)
    stereo = look.stereo
    # An anaglyph's marks are drawn once, as in the window, not with each eye's parallax.
    overlaid = stereo is not None and stereo.eye_size(size) == size
    if image is None:
        size = stereo.eye_size(size) if stereo else size
        image = with_own_caster(state.document, partial(_cast, state, size, progress))
        look = replace(look, opacities={})
    progress.check()
    other = light_rig(state.other, state.room) if state.other else None
    frames = []
    for view in look.views(image):
        # In a context of this thread's own: many pixels take longer than the window may wait.
        with Relighter(view) as relighter:
            frame: NDArray[np.uint8] = relighter.frame(rig, look.of_view)
            if other is not None:
                left = round(state.divide * frame.shape[1])
                frame = frame.copy()
                frame[:, left:] = relighter.frame(other, look.of_view)[:, left:]
        frames.append(paint(frame, [] if overlaid else marks(view)))
        progress.check()
    frame = look.combine(frames)
    return paint(frame, marks(image)) if overlaid else frame


def _cast(
    state: ViewState, size: tuple[int, int], progress: Progress, caster: Raycaster
) -> CoefficientImage:
    volume = state.document.volume
    camera = state.view.camera(volume)
    spec = picture_spec(state)
    if not needs_layers(state):
        spec = WHOLE.spec(spec, volume)
    cast_args = volume, shown_transfer(state), camera, size, spec
    room = state.room
    walls_visible = room is not None and has_walls(state)
    backdrop = room.behind(volume, state.transfer.basis) if room and walls_visible else None
    surfaces = state.document.surfaces(state.meshes, state.transfer)
    try:
        return raycast(
            *cast_args,
            progress=progress.report,
            cancel=lambda: progress.ended,
            caster=caster,
            behind=surfaces if backdrop is None else (*surfaces, backdrop),
        )
    except CastCancelled:
        progress.check()
        raise


class ClipboardError(DeviceError):
    """There is no clipboard, it refuses the data, or there is nothing to copy."""


def copy_shown(pictures: Pictures, state: ViewState) -> str:
    """Copy the picture that is shown, for as long as the program runs; return a message.

    It has the window's marks, which pictures next to each other and coarse ones do without.
    """
    image = pictures.image
    if image is None or not pictures.framebuffer:
        raise ClipboardError("There is no picture to copy yet", code="missing")
    frame = pictures.pixels()
    if pictures.size == image.size:
        frame = paint(frame, _marks(state, Still(), image))
    height, width, _ = frame.shape
    data = np.dstack([frame, np.full((height, width), 255, np.uint8)]).tobytes()
    _copy("picture", lambda clipboard: clipboard.copy_image(data, width, height))
    return "The picture was copied"


def copy_values(reading: PixelProbe | None) -> str:
    """Copy the values under the mouse, a name and a value per line; return a message."""
    if reading is None:
        raise ClipboardError("Point at something in the picture first", code="missing")
    _copy("text", lambda clipboard: clipboard.copy(str(reading)))
    return "The values were copied"


def _copy(kind: str, copy: Callable[[Any], object]) -> None:
    import copykitten

    try:
        copy(copykitten)
    except copykitten.CopykittenError as error:
        raise ClipboardError(f"The {kind} cannot be copied: {error}", code="unsupported") from error
