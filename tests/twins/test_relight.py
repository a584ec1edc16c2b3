"""The shader, its NumPy twin and the colour-science reference make the same picture."""

from functools import cache

import numpy as np
import pytest

from tests.support.relight_reference import encoded_frame
from volspec._gpu.opengl import compile_program, describe, headless_context
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import Source, assemble
from volspec.appearance import Display, Viewing
from volspec.appearance.constants import shader_constants
from volspec.appearance.models.cielab import cielab
from volspec.appearance.spaces import XYZ_FROM_sRGB, decode_sRGB, sRGB_WHITE_XYZ, to_uint8
from volspec.errors import OpenGLError
from volspec.relight import Illumination
from volspec.relight import programs as programs_module
from volspec.relight.cpu import CpuEngine
from volspec.relight.gpu import GLEngine
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


@cache
def missing_gl() -> str:
    try:
        headless_context().release()
    except OpenGLError as error:
        return str(error)
    return ""


@pytest.fixture(autouse=True)
def needs_gl() -> None:
    if missing_gl():
        pytest.skip(missing_gl())


def surfaces(white: np.ndarray) -> np.ndarray:
    """(100, 100, 3) XYZ: the sRGB gamut evenly in code values, moved to a light's white."""
    codes = np.random.default_rng(11).random((100, 100, 3))
    codes[0, :8] = np.indices((2, 2, 2)).reshape(3, -1).T
    codes[0, 8:40] = np.linspace(0.0, 0.1, 32)[:, None]
    return decode_sRGB(codes) @ XYZ_FROM_sRGB.T * (white / sRGB_WHITE_XYZ)


def opaque(XYZ: np.ndarray, white: np.ndarray) -> tuple[np.ndarray, np.ndarray, Illumination]:
    """Coefficients that are the XYZ themselves (a basis of three channels, D = identity)."""
    coefficients = XYZ.astype(np.float32)
    alpha = np.ones(XYZ.shape[:2], np.float32)
    return coefficients, alpha, Illumination(np.eye(3), white, 0.2 * white)


def assert_close(ours: np.ndarray, truth: np.ndarray, limit: float, what: str) -> None:
    error = np.abs(ours.astype(np.float64) - truth)
    worst = np.unravel_index(int(np.argmax(error)), error.shape)
    line = f"{what}: worst pixel {worst[:2]}: {ours[worst[:2]]} against {truth[worst[:2]]}"
    print(line)
    assert error[worst] <= limit, line


def ciede2000(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    import colour

    def lab(codes: np.ndarray) -> np.ndarray:
        return cielab(decode_sRGB(codes) @ XYZ_FROM_sRGB.T, sRGB_WHITE_XYZ)

    return np.asarray(colour.delta_E(lab(one), lab(other), method="CIE 2000"))


@pytest.mark.parametrize("name", LIGHTS)
def test_shader_agrees_with_colour_science_over_the_srgb_gamut(name):
    white = white_XYZ(light(name))
    coefficients, alpha, lit = opaque(surfaces(white), white)
    gl = GLEngine(coefficients, alpha)
    viewing = Viewing()
    truth = encoded_frame(coefficients, alpha, lit, viewing)
    shown = gl.render(lit, viewing, np.float32)
    codes = gl.render(lit, viewing, np.uint8)
    gl.close()
    difference = ciede2000(shown.astype(np.float64), truth)
    print(f"{name}: CIEDE2000 mean {difference.mean():.5f}, max {difference.max():.5f}")
    # The goal is 0.05 and 0.3; llvmpipe's polynomial pow leaves 5e-5 and 5e-4. A hundredfold
    # leaves room for drivers whose pow is coarser.
    assert difference.mean() <= 0.005
    assert difference.max() <= 0.05
    # Half a code of rounding can fall either way.
    assert_close(codes, to_uint8(truth), 1, f"{name}, 8 bit")


@pytest.mark.parametrize("name", VIEWINGS)
def test_shader_and_host_agree_with_the_reference_in_every_viewing(name):
    viewing = VIEWINGS[name]
    rng = np.random.default_rng(5)
    white = white_XYZ(light("D50"))
    XYZ = surfaces(white)
    alpha = rng.random(XYZ.shape[:2]).astype(np.float32)
    coefficients = (XYZ * alpha[..., None]).astype(np.float32)
    gain = viewing.exposure
    lit = Illumination(gain * np.eye(3), white, gain * 0.2 * white)
    truth = encoded_frame(coefficients, alpha, lit, viewing)
    host = CpuEngine(coefficients, alpha).render(lit, viewing, np.float32)
    # float32 storage, and the two branches of sRGB that miss each other by 3e-8.
    assert_close(host, truth, 2e-7, f"host, {name}")
    gl = GLEngine(coefficients, alpha)
    shown = gl.render(lit, viewing, np.float32)
    gl.close()
    # A twentieth of an 8-bit step; measured 5e-5.
    assert_close(shown, truth, 2e-4, f"GL, {name}")


@pytest.mark.parametrize("channels", range(1, 17))
def test_any_number_of_channels_gives_the_host_s_picture(channels):
    rng = np.random.default_rng(channels)
    alpha = rng.random((5, 9)).astype(np.float32)
    coefficients = (rng.random((5, 9, channels)) * alpha[..., None]).astype(np.float32)
    matrix = rng.random((3, channels))
    matrix *= white_XYZ(light("A"))[:, None] / matrix.sum(axis=1, keepdims=True)
    lit = Illumination(matrix, matrix.sum(axis=1), 0.2 * matrix.sum(axis=1))
    gl = GLEngine(coefficients, alpha)
    shown = gl.render(lit, Viewing(), np.float32)
    gl.close()
    twin = CpuEngine(coefficients, alpha).render(lit, Viewing(), np.float32)
    assert_close(shown, twin, 2e-4, f"{channels} channels")


@pytest.mark.parametrize("name", VIEWINGS)
@pytest.mark.parametrize("size", [3e38, 1e6, 100.0, 1.0, 1e-6, 1e-30])
def test_no_finite_coefficient_gives_nan(name, size):
    rng = np.random.default_rng(2)
    coefficients = rng.uniform(-size, size, (64, 64, 7)).astype(np.float32)
    coefficients[0] = 0.0
    coefficients[1] = -np.abs(coefficients[1])
    alpha = rng.uniform(-1.0, 2.0, (64, 64)).astype(np.float32)
    matrix = rng.uniform(-20.0, 100.0, (3, 7))
    lit = Illumination(matrix, white_XYZ(light("A")), white_XYZ(light("A")))
    gl = GLEngine(coefficients, alpha)
    shown = gl.render(lit, VIEWINGS[name], np.float32)
    gl.close()
    host = CpuEngine(coefficients, alpha).render(lit, VIEWINGS[name], np.float32)
    for frame in (shown, host):
        assert np.isfinite(frame).all()
        assert frame.min() >= 0.0 and frame.max() <= 1.0


@pytest.mark.parametrize("model", ["CIECAM02", "none"])
def test_same_source_draws_the_same_picture_as_webgl_2(model, monkeypatch):
    white = white_XYZ(light("A"))
    coefficients, alpha, lit = opaque(surfaces(white), white)
    frames = []
    for version in ("330 core", "300 es"):
        monkeypatch.setattr(programs_module, "_GLSL", version)
        gl = GLEngine(coefficients, alpha)
        frames.append(gl.render(lit, Viewing(model=model), np.uint8))
        gl.close()
    assert np.array_equal(*frames)


def test_a_canvas_shows_row_0_at_the_top(monkeypatch):
    white = white_XYZ(light("A"))
    coefficients, alpha, lit = opaque(surfaces(white), white)
    gl = GLEngine(coefficients, alpha)
    read_back = gl.render(lit, Viewing(), np.uint8)
    gl.close()
    canvas_constants = {"FIRST_ROW_AT_BOTTOM": 0, "IMAGE_HEIGHT": len(read_back)}
    monkeypatch.setattr(
        programs_module,
        "prelude",
        lambda constants, language: prelude({**constants, **canvas_constants}, language),
    )
    gl = GLEngine(coefficients, alpha)
    canvas = gl.render(lit, Viewing(), np.uint8)
    gl.close()
    # Read back from the bottom up, a picture drawn for a canvas comes out upside down.
    assert np.array_equal(canvas[::-1], read_back)


def test_compiler_errors_name_the_file_and_line():
    context = headless_context()
    vertex = assemble("shaders/fullscreen.vert", "", glsl_version="330 core")
    form = {"FORM": 2, "LINEAR": 0, "CURVE": 1, "CAM": 2, "TABLE": 3, "SAME_SURROUND": 0}
    form |= {"FIELD": 0, "REDUCE": 0, "MARK": 0}
    constants = {"LAYERS": 2, "FIRST_ROW_AT_BOTTOM": 1, "IMAGE_HEIGHT": 4, **form}
    lines = prelude({**constants, **shader_constants()}, "glsl")
    fragment = assemble("shaders/relight.frag", lines, glsl_version="330 core")
    broken = Source(fragment.text.replace("vec2 ab =", "vec9 ab ="), fragment.files)
    with pytest.raises(OpenGLError, match=r"shaders/include/cam\.glsl:\d+"):
        compile_program(context, vertex, broken)
    assert describe(context)["device"]
    context.release()
