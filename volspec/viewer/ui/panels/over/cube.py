"""The orientation cube in the picture's corner: a click looks at a face, a drag orbits."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view.cube import HALF, face_at, faces, middle
from volspec.viewer.model.view.slices import AXES, PATIENT, is_patient
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import over_picture, packed
from volspec.viewer.ui.window.style import ACCENT

# A face that is seen more askew has no letters.
_ASKEW = 0.3
# What a face is lit with: from everywhere, and by how it faces the eye.
_SHADE = 0.30, 0.34
_EDGE, _LETTER = (0.08, 0.08, 0.08), (0.02, 0.02, 0.02)


def label(face: int, patient: bool) -> str:
    """What is written on a face."""
    return (PATIENT if patient else AXES)[face // 2][face % 2]


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it."""
    if not state.interface.aids.cube:
        return None
    seen = ui.projection(state)
    x, y = middle(seen, ui.scale)
    half = HALF * ui.scale
    mouse = imgui.get_mouse_pos()
    over = None
    if not imgui.get_io().want_capture_mouse:
        over = face_at(seen, (mouse.x, mouse.y), ui.scale)
    patient = is_patient(state.document.volume, state.interface.aids.patient)
    with over_picture(ui) as draw_list:
        for face, corners, towards in faces(seen.camera):
            a, b, c, d = ((x + half * px, y + half * py) for px, py in corners.tolist())
            grey = _SHADE[0] + _SHADE[1] * towards
            lit = ACCENT[True] if face == over else (grey, grey, grey)
            draw_list.add_quad_filled(a, b, c, d, packed(lit, 0.88))
            draw_list.add_quad(a, b, c, d, packed(_EDGE, 0.8), ui.px(1.2))
            if towards < _ASKEW:
                continue
            text = label(face, patient)
            size = imgui.calc_text_size(text)
            at = (a[0] + c[0]) / 2, (a[1] + c[1]) / 2
            ink = min((towards - _ASKEW) / 0.3, 1.0)
            place = at[0] - size.x / 2, at[1] - size.y / 2
            draw_list.add_text(place, packed(_LETTER, ink), text)
            ui.areas[f"cube {face}"] = int(at[0]) - 1, int(at[1]) - 1, 2, 2
    return None
