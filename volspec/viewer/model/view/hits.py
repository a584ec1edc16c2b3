"""The handles that a state has in the picture, and the one that a press takes hold of.

state, Projection -> [hits] -> mouse, panels
"""

from __future__ import annotations

import math

from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view.handles import Handle, handles
from volspec.viewer.model.view.projection import Place, Projection

# So near the mouse takes hold of a handle; pixels at 96 dpi.
_GRIP = 11.0


def handles_of(state: ViewState, seen: Projection, scale: float) -> tuple[Handle, ...]:
    """Those in the picture; ``scale`` as `volspec.viewer.model.view.handles.handles`."""
    aids, shading = state.interface.aids, state.shading
    if not (aids.crop or (aids.planes and shading.clip_planes)):
        return ()
    return handles(shading, state.document.volume, seen, aids, scale)


def nearest(found: tuple[Handle, ...], place: Place, scale: float) -> Handle | None:
    """The handle that a press at a place of the window takes hold of."""
    handle = min(found, key=lambda each: math.dist(each.place, place), default=None)
    if handle is None or math.dist(handle.place, place) > _GRIP * scale:
        return None
    return handle
