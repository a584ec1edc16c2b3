"""The orientation cube in the picture's corner: a click looks at a face, a drag orbits."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.raycast import Camera
from volspec.viewer.panels.desk import Desk, packed
from volspec.viewer.projection import Place, Projection
from volspec.viewer.slices import AXES, PATIENT, is_patient
from volspec.viewer.state import ViewState
from volspec.viewer.style import ACCENT

# Half an edge, and the middle's distance from the picture's corner; pixels at 96 dpi.
HALF, CORNER = 21.0, 48.0
# A face that is seen more askew has no letters.
_ASKEW = 0.3
# What a face is lit with: from everywhere, and by how it faces the eye.
_SHADE = 0.30, 0.34


def faces(camera: Camera) -> list[tuple[int, NDArray[np.float64], float]]:
    """Those seen of a cube with edges of 2: number, (4, 2) corners right and down, how they face.

    Face 2 · axis looks against an axis of the world, the next one along it.
    """
    right, up, forward = camera.frame()
    seen = []
    for face in range(6):
        axis, far = divmod(face, 2)
        normal = np.zeros(3)
        normal[axis] = 1.0 if far else -1.0
        towards = float(-normal @ forward)
        if towards < 1e-3:
            continue
        first, second = (np.eye(3)[other] for other in range(3) if other != axis)
        ring = [normal + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = np.array(ring)
        seen.append((face, np.stack([corners @ right, -(corners @ up)], axis=1), towards))
    return seen


def label(face: int, patient: bool) -> str:
    """What is written on a face."""
    return (PATIENT if patient else AXES)[face // 2][face % 2]


def middle(seen: Projection, scale: float) -> Place:
    """Of the cube in the window."""
    x, y, width, _ = seen.area
    return x + width - CORNER * scale, y + CORNER * scale


def face_at(seen: Projection, place: Place, scale: float) -> int | None:
    """The face at a place of the window; None where there is none."""
    centre = middle(seen, scale)
    at = np.subtract(place, centre) / (HALF * scale)
    if np.abs(at).max() > 2:
        return None
    for face, corners, _ in faces(seen.camera):
        edges = np.roll(corners, -1, axis=0) - corners
        to = at - corners
        side = edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0]
        if (side >= 0).all() or (side <= 0).all():
            return face
    return None


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it."""
    if not state.interface.aids.cube:
        return None
    seen = desk.projection(state)
    area = seen.area
    x, y = middle(seen, desk.scale)
    half = HALF * desk.scale
    mouse = imgui.get_mouse_pos()
    over = None
    if not imgui.get_io().want_capture_mouse:
        over = face_at(seen, (mouse.x, mouse.y), desk.scale)
    patient = is_patient(state.document.volume, state.interface.aids.patient)
    draw_list = imgui.get_background_draw_list()
    draw_list.push_clip_rect((area[0], area[1]), (area[0] + area[2], area[1] + area[3]))
    for face, corners, towards in faces(seen.camera):
        a, b, c, d = ((x + half * px, y + half * py) for px, py in corners.tolist())
        grey = _SHADE[0] + _SHADE[1] * towards
        lit = ACCENT[True][:3] if face == over else (grey, grey, grey)
        draw_list.add_quad_filled(a, b, c, d, packed((*lit, 0.88)))
        draw_list.add_quad(a, b, c, d, packed((0.08, 0.08, 0.08, 0.8)), desk.px(1.2))
        if towards < _ASKEW:
            continue
        text = label(face, patient)
        size = imgui.calc_text_size(text)
        at = (a[0] + c[0]) / 2, (a[1] + c[1]) / 2
        ink = min((towards - _ASKEW) / 0.3, 1.0)
        place = at[0] - size.x / 2, at[1] - size.y / 2
        draw_list.add_text(place, packed((0.02, 0.02, 0.02, ink)), text)
        desk.areas[f"cube {face}"] = int(at[0]) - 1, int(at[1]) - 1, 2, 2
    draw_list.pop_clip_rect()
    return None
