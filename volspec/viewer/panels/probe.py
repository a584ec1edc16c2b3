"""What is drawn under the mouse: code, XYZ, lightness, chroma and hue, and where it lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from volspec.appearance.models import MODELS
from volspec.errors import VolspecError
from volspec.raycast import Camera, CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_inputs
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
)


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it over the picture's lower left corner."""
    if not desk.under_mouse:
        return None
    x, y, _, height = desk.areas["picture"]
    corner = x + desk.px(12), y + height - desk.px(12)
    imgui.set_next_window_pos(corner, imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_bg_alpha(0.78)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, desk.px(5))
    if imgui.begin("##probe", None, _FLAGS)[0]:
        widest = max(imgui.calc_text_size(name).x for name in desk.under_mouse)
        label = widest + desk.px(14) + imgui.get_style().window_padding.x
        for name, value in desk.under_mouse.items():
            imgui.text_disabled(name)
            imgui.same_line(label)
            imgui.text(value)
    imgui.end()
    imgui.pop_style_var()
    return None


def probed(
    image: CoefficientImage,
    camera: Camera,
    rig: LightRig,
    seen: RelightSpec,
    pixel: tuple[int, int],
) -> Mapping[str, str]:
    """What a pixel of a picture is, in words.

    Parameters
    ----------
    image, camera : CoefficientImage, Camera
        The picture and where it was taken from.
    rig, seen : LightRig, RelightSpec
        How it is lit and looked at.
    pixel : (x, y)
        Row 0 is the top.
    """
    x, y = pixel
    said = {}
    try:
        lit = Illumination.of(image.basis, rig, seen, image.groups)
        XYZ = lit.scene_XYZ(image.coefficients[y, x], image.alpha[y, x])
        said["XYZ"] = "  ".join(f"{value:.1f}" for value in XYZ)
        given = replace(lit.viewed(seen.viewing), adapting="given")
        name = given.model if given.model in MODELS else "CIECAM02"
        look = MODELS[name].forward(XYZ, given.conditions(lit.white_XYZ))
        numbers = (float(look.J), float(look.C), float(look.h))
        if np.isfinite(numbers).all():
            said["J C h"] = f"{numbers[0]:.1f}  {numbers[1]:.1f}  {numbers[2]:.0f}°"
    except VolspecError as error:
        said["colour"] = str(error)
    if (place := place_mm(image, camera, pixel)) is not None:
        said["mm"] = "  ".join(f"{value:.1f}" for value in place)
    return said


def place_mm(
    image: CoefficientImage, camera: Camera, pixel: tuple[int, int]
) -> tuple[float, float, float] | None:
    """Where in the world a pixel is first hit; None where nothing is."""
    x, y = pixel
    depths = image.depth_mm if image.first_mm is None else image.first_mm
    depth = float(depths[y, x])
    if not np.isfinite(depth):
        return None
    rays = camera.ray_field(*image.size)
    offset = (x - rays.middle[0]) * rays.across + (y - rays.middle[1]) * rays.down
    if rays.perspective:
        start, direction = np.asarray(camera.position_mm), rays.forward * rays.distance + offset
        direction = direction / np.linalg.norm(direction)
    else:
        start, direction = np.asarray(camera.position_mm) + offset, rays.forward
    px, py, pz = (float(value) for value in start + depth * direction)
    return px, py, pz
