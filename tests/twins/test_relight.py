"""The shader, its NumPy twin and the colour-science reference make the same picture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.support.fixtures import slow_each
from tests.support.relight_reference import encoded_frame
from tests.support.relighting import (
    assert_close,
    assert_drawn_alike_by_webgl_2,
    assert_in_range,
    ciede2000,
    cpu_frame,
    gl_frame,
    opaque,
    surfaces,
)
from volspec._gpu.opengl import compile_program, describe
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import Source, assemble
from volspec.appearance import Display, Viewing
from volspec.appearance.display.constants import shader_constants
from volspec.appearance.display.spaces import to_uint8
from volspec.errors import OpenGLError
from volspec.relight import Illumination
from volspec.relight import programs as programs_module
from volspec.spectra import light
from volspec.spectra.photometry import white_XYZ

LIGHTS = ("A", "D50", "D65", "FL2")
VIEWINGS = {
    "default": Viewing(),
    "dim scene, dark room": Viewing(
        illuminance_lux=20.0, Y_b=40.0, surround="dim", display=Display(Y_b=8.0, surround="dark")
    ),
    "half adapted": Viewing(D=0.5, exposure=1.5),
    "none": Viewing(model="none"),
}
pytestmark = pytest.mark.usefixtures("needs_gl")


def gamut(name: str) -> tuple[np.ndarray, np.ndarray, Illumination]:
    """The sRGB gamut in a light: coefficients, alpha and the light."""
    white = white_XYZ(light(name))
    return opaque(surfaces(white), white)


@pytest.mark.parametrize("name", LIGHTS)
def test_shader_agrees_with_colour_science_over_the_srgb_gamut(name):
    given = *gamut(name), Viewing()
    truth = encoded_frame(*given)
    difference = ciede2000(gl_frame(*given), truth, what=name)
    # The goal is 0.05 and 0.3; llvmpipe's polynomial pow leaves 5e-5 and 5e-4. A hundredfold
    # leaves room for drivers whose pow is coarser.
    assert difference.mean() <= 0.005
    assert difference.max() <= 0.05
    # Half a code of rounding can fall either way.
    assert_close(gl_frame(*given, np.uint8), to_uint8(truth), 1, f"{name}, 8 bit")


@pytest.mark.parametrize("name", VIEWINGS)
def test_shader_and_host_agree_with_the_reference_in_every_viewing(name):
    viewing = VIEWINGS[name]
    white = white_XYZ(light("D50"))
    XYZ = surfaces(white)
    alpha = np.random.default_rng(5).random(XYZ.shape[:2]).astype(np.float32)
    coefficients = (XYZ * alpha[..., None]).astype(np.float32)
    gain = viewing.exposure
    lit = Illumination(gain * np.eye(3), white, gain * 0.2 * white)
    given = coefficients, alpha, lit, viewing
    truth = encoded_frame(*given)
    # float32 storage, and the two branches of sRGB that miss each other by 3e-8.
    assert_close(cpu_frame(*given), truth, 2e-7, f"host, {name}")
    # A twentieth of an 8-bit step; measured 5e-5.
    assert_close(gl_frame(*given), truth, 2e-4, f"GL, {name}")


@pytest.mark.parametrize("channels", range(1, 17))
def test_any_number_of_channels_gives_the_host_s_picture(channels):
    rng = np.random.default_rng(channels)
    alpha = rng.random((5, 9)).astype(np.float32)
    coefficients = (rng.random((5, 9, channels)) * alpha[..., None]).astype(np.float32)
    matrix = rng.random((3, channels))
    matrix *= white_XYZ(light("A"))[:, None] / matrix.sum(axis=1, keepdims=True)
    lit = Illumination(matrix, matrix.sum(axis=1), 0.2 * matrix.sum(axis=1))
    given = coefficients, alpha, lit, Viewing()
    assert_close(gl_frame(*given), cpu_frame(*given), 2e-4, f"{channels} channels")


P3 = Display(space="Display P3", gamut="reduce")
MORE = {
    f"{model}, reduced{', marked' if mark else ''}": Viewing(
        model=model, display=replace(P3, mark=mark)
    )
    for model in ("CIECAM02", "none", "Guth")
    for mark in (False, True)
}


@pytest.mark.parametrize("viewing", [*VIEWINGS.values(), *MORE.values()], ids=[*VIEWINGS, *MORE])
@pytest.mark.parametrize("size", [3e38, 1.0, *slow_each(1e6, 100, 1e-6, 1e-30)])
def test_no_finite_coefficient_gives_nan(viewing, size):
    rng = np.random.default_rng(2)
    coefficients = rng.uniform(-size, size, (64, 64, 7)).astype(np.float32)
    coefficients[0] = 0.0
    coefficients[1] = -np.abs(coefficients[1])
    alpha = rng.uniform(-1.0, 2.0, (64, 64)).astype(np.float32)
    matrix = rng.uniform(-20.0, 100.0, (3, 7))
    lit = Illumination(matrix, white_XYZ(light("A")), white_XYZ(light("A")))
    for draw in (gl_frame, cpu_frame):
        assert_in_range(draw(coefficients, alpha, lit, viewing))


@pytest.mark.parametrize("model", ["CIECAM02", "none"])
def test_same_source_draws_the_same_picture_as_webgl_2(model, monkeypatch):
    given = *gamut("A"), Viewing(model=model), np.uint8
    assert_drawn_alike_by_webgl_2(lambda: gl_frame(*given), monkeypatch)


def test_a_canvas_shows_row_0_at_the_top(monkeypatch):
    given = *gamut("A"), Viewing(), np.uint8
    read_back = gl_frame(*given)
    canvas_constants = {"FIRST_ROW_AT_BOTTOM": 0, "IMAGE_HEIGHT": len(read_back)}
    monkeypatch.setattr(
        programs_module,
        "prelude",
        lambda constants, language: prelude({**constants, **canvas_constants}, language),
    )
    # Read back from the bottom up, a picture drawn for a canvas comes out upside down.
    assert np.array_equal(gl_frame(*given)[::-1], read_back)


def test_compiler_errors_name_the_file_and_line(context):
    vertex = assemble("shaders/fullscreen.vert", "", glsl_version="330 core")
    form = {"FORM": 2, "LINEAR": 0, "CURVE": 1, "CAM": 2, "TABLE": 3, "SAME_SURROUND": 0}
    form |= {"PROPORTIONAL": 0, "FIELD": 0, "REDUCE": 0, "MARK": 0, "SIMULATE": 0}
    constants = {"LAYERS": 2, "FIRST_ROW_AT_BOTTOM": 1, "IMAGE_HEIGHT": 4, **form}
    lines = prelude({**constants, **shader_constants()}, "glsl")
    fragment = assemble("shaders/relight.frag", lines, glsl_version="330 core")
    broken = Source(fragment.text.replace("vec2 ab =", "vec9 ab ="), fragment.files)
    with pytest.raises(OpenGLError) as caught:
        compile_program(context, vertex, broken)
    assert re.search(r"shaders/include/cam\.glsl:\d+", str(caught.value))
    assert describe(context)["device"]
