"""Displays in the live path: spaces, reduced chroma and marks, in the shader and in NumPy."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.fixtures import slow, slow_each
from tests.support.relight_reference import encoded_frame
from tests.support.relighting import (
    assert_close,
    assert_drawn_alike_by_webgl_2,
    ciede2000,
    cpu_frame,
    gl_frame,
    opaque,
)
from volspec.appearance import Display, Viewing, view_transform
from volspec.appearance.display.deficiency import DEFICIENCIES
from volspec.appearance.display.spaces import SPACES, Transfer
from volspec.appearance.gamut_mapping import (
    GAMUT_SLACK,
    HATCH_CODE,
    HATCH_PERIOD,
    HATCH_WIDTH,
    DisplayOutput,
    reduce_chroma,
    screen_for_viewing,
)
from volspec.appearance.lut3d import Lut3D, LutSpace
from volspec.appearance.models import cam
from volspec.appearance.models.cam import CamConditions
from volspec.appearance.spec import MODELS
from volspec.appearance.transforms import ViewTransform
from volspec.relight import Illumination
from volspec.relight.gpu import GLEngine
from volspec.relight.reference import CpuEngine
from volspec.spectra import light
from volspec.spectra.photometry import white_XYZ

pytestmark = pytest.mark.usefixtures("needs_gl")
DISPLAYS = {
    "sRGB clip": Display(),
    "sRGB reduce": Display(gamut="reduce"),
    "Display P3 reduce": Display(space="Display P3", gamut="reduce"),
    "Rec. 2020 clip": Display(space="Rec. 2020"),
}
TABLES = ("Hunt", "Nayatani95", "ZCAM")


def bright_cube(name: str) -> tuple[np.ndarray, np.ndarray, Illumination]:
    """The cube of Rec. 2020 × 1.2, moved to a light's white: half and more cannot be shown."""
    space, white = SPACES["Rec. 2020"], white_XYZ(light(name))
    RGB = np.stack(np.meshgrid(*[np.linspace(0.0, 1.2, 17)] * 3), axis=-1).reshape(17, -1, 3)
    return opaque(RGB @ space.XYZ_from_RGB.T / space.white_XYZ * white, white)


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[Lut3D]:
    """LUTs that are made, in order; each takes the host up to a second."""
    made: list[Lut3D] = []
    make = Lut3D.of

    def noted(transform: ViewTransform, space: LutSpace, cancel: None = None) -> Lut3D:
        made.append(make(transform, space, cancel))
        return made[-1]

    monkeypatch.setattr(Lut3D, "of", noted)
    return made


@pytest.mark.parametrize(
    "name", [*("sRGB clip", "Display P3 reduce"), *slow_each("sRGB reduce", "Rec. 2020 clip")]
)
@pytest.mark.parametrize(
    "model", [pytest.param(m, marks=[pytest.mark.slow] if m == "Hunt" else []) for m in MODELS]
)
def test_the_shader_shows_a_model_on_every_display_as_numpy_does(model, name, tables):
    coefficients, alpha, lit = bright_cube("A")
    viewing = Viewing(model=model, display=DISPLAYS[name])
    given = coefficients, alpha, lit, viewing
    frame = gl_frame(*given, lut3d=model in TABLES)
    if model in TABLES:
        # The table's own error is not the display's (test_a_table_is_near_the_closed_form).
        (table,) = tables
        space = LutSpace.between(lit.white_XYZ, viewing.display.colours)
        assert np.array_equal(table.space.adapted_from_XYZ, space.adapted_from_XYZ)
        assert table.space.space == space.space
        truth = screen_for_viewing(viewing).codes(table.apply(coefficients.astype(np.float64)))
    else:
        truth = cpu_frame(*given)
    assert np.isfinite(frame).all() and np.isfinite(truth).all()
    error = ciede2000(frame, truth, viewing.display.colours, f"{model}, {name}")
    worst = np.unravel_index(error.argmax(), error.shape)
    line = f"{worst}: {frame[worst]} against {truth[worst]}"
    # Clipped frames are as near as on sRGB (5e-4). Where float32 falls on the other side of the
    # cube's face in one of the last halvings, a colour is some 1/4096 of its chroma off: 0.053.
    # (Of a table's values roots are interpolated in GL's way, 0.05 elsewhere.)
    reduced = DISPLAYS[name].gamut == "reduce" or model in TABLES
    assert error.mean() <= 0.005 and error.max() <= (0.1 if reduced else 0.01), line


@pytest.mark.parametrize("space", SPACES)
def test_every_space_is_the_reference_s(space):
    given = *bright_cube("D50"), Viewing(display=Display(space=space))
    # A primary's residue of 1e-12 where the truth is 0 is 1e-5 by a power of 1/2.4.
    assert_close(cpu_frame(*given), encoded_frame(*given), 5e-5, f"host, {space}")


@pytest.mark.parametrize("display", DISPLAYS.values(), ids=DISPLAYS)
@pytest.mark.parametrize("backend", ["gl", "numpy"])
def test_the_mark_is_on_mapped_pixels_and_on_no_others(backend, display):
    coefficients, alpha, lit = bright_cube("A")
    engine = (GLEngine if backend == "gl" else CpuEngine)(coefficients, alpha)
    viewing = Viewing(model="CAT02", display=display)
    marked = replace(viewing, display=replace(display, mark=True))
    plain, hatched = (
        engine.render(lit, each, np.float32).astype(np.float64) for each in (viewing, marked)
    )
    engine.close()
    shown = view_transform(viewing, lit.white_XYZ).apply(coefficients.astype(np.float64))
    linear = shown @ display.colours.RGB_from_XYZ.T
    excess = np.maximum(linear - 1.0, -linear).max(axis=-1)
    outside = excess > GAMUT_SLACK
    y, x = np.indices(outside.shape)
    band = (x + y) % HATCH_PERIOD < HATCH_WIDTH
    grey = np.repeat(plain.mean(axis=-1, keepdims=True), 3, axis=-1)
    expected = np.where(band[..., None], HATCH_CODE, grey)
    expected = np.where(outside[..., None], expected, plain)
    sure = np.abs(excess - GAMUT_SLACK) > 1e-5  # float32 may fall on either side
    assert 0.3 < outside.mean() < 0.9 and sure.mean() > 0.99
    np.testing.assert_allclose(hatched[sure], expected[sure], atol=1e-6)


def test_white_and_greys_of_a_picture_are_not_marked():
    """Every adaptation that ends at the display's white, in every space with it."""
    white = white_XYZ(light("A"))
    grey = np.linspace(0.0, 1.0, 64)[:, None, None] * np.ones((1, 16, 1)) * white
    coefficients, alpha, lit = opaque(grey, white)
    gl = GLEngine(coefficients, alpha)
    for model in ("CIELAB", "von Kries", "Bradford", "Sharp"):
        for space in SPACES:
            viewing = Viewing(model=model, D=1.0, display=Display(space=space, mark=True))
            plain = replace(viewing, display=Display(space=space))
            frames = [gl.render(lit, each, np.float32) for each in (viewing, plain)]
            assert np.array_equal(*frames), (model, space)
    gl.close()


@pytest.mark.parametrize("model", ["CIECAM02", "CAM16"])
def test_reduced_frames_keep_lightness_and_hue_where_clipped_ones_do_not(model):
    display = Display(gamut="reduce")
    space, off = display.colours, {}
    conditions = CamConditions.of_viewing(display.conditions, model)
    coefficients, alpha, lit = bright_cube("D65")
    gl = GLEngine(coefficients, alpha)
    viewing = Viewing(model=model, display=display)
    transform = view_transform(viewing, lit.white_XYZ)
    asked = cam.forward(transform.apply(coefficients.astype(float)), conditions)
    for gamut in ("reduce", "clip"):
        frame = gl.render(lit, replace(viewing, display=Display(gamut=gamut)), np.float32)
        shown = cam.forward(space.decode(frame) @ space.XYZ_from_RGB.T, conditions)
        inside = (asked.J > 5.0) & (asked.J < 96.0)
        off[gamut] = np.abs(shown.J - asked.J)[inside].max()
    gl.close()
    # The slack and llvmpipe's pow; clipping moves J by 13.
    assert off["reduce"] < 0.1 < 5.0 < off["clip"]


@pytest.mark.parametrize("gamut", ["clip", "reduce"])
def test_the_screen_is_gamut_s_mapping_but_for_the_shader_s_steps(gamut):
    display = Display(space="Display P3", gamut=gamut)
    XYZ = bright_cube("D65")[0].astype(np.float64)
    linear, outside = DisplayOutput.of(display).linear(XYZ)
    conditions, space = CamConditions.of_viewing(display.conditions), display.colours
    truth, mapped = reduce_chroma(XYZ, conditions, space)
    assert np.mean(outside != mapped) < 0.01
    expected = (XYZ if gamut == "clip" else truth) @ space.RGB_from_XYZ.T
    # Along the cube's faces the slack reaches further than across: measured 4.6e-3.
    np.testing.assert_allclose(np.clip(linear, 0, 1), np.clip(expected, 0, 1), atol=6e-3)


@pytest.mark.parametrize("model", ["CIECAM02", "CIELAB", "none"])
@pytest.mark.parametrize("deficiency", [d if d == "protan" else slow(d) for d in DEFICIENCIES[1:]])
def test_the_shader_simulates_a_deficiency_as_numpy_does(model, deficiency):
    """All forms of view transforms, clipped and with reduced chroma."""
    coefficients, alpha, lit = bright_cube("A")
    gl = GLEngine(coefficients, alpha)
    for display in (Display(), Display(space="Display P3", gamut="reduce")):
        viewing = Viewing(model=model, display=display)
        plain = gl.render(lit, viewing, np.float32)
        for severity in (0.35, 1.0):
            simulated = replace(viewing, deficiency=deficiency, severity=severity)
            frame = gl.render(lit, simulated, np.float32)
            truth = cpu_frame(coefficients, alpha, lit, simulated)
            error = ciede2000(frame, truth, display.colours, f"{deficiency} {severity}, {model}")
            # As without a simulation: see above.
            assert error.mean() <= 0.005
            assert error.max() <= (0.1 if display.gamut == "reduce" else 0.01)
            assert np.abs(frame - plain).max() > 0.05
        none = replace(viewing, deficiency=deficiency, severity=0.0)
        assert np.array_equal(gl.render(lit, none, np.float32), plain)
    gl.close()


def test_a_lut_is_looked_up_and_then_simulated():
    viewing = Viewing(model="CIECAM02", deficiency="deutan", display=Display(mark=True))
    by_lut, closed = (gl_frame(*bright_cube("D65"), viewing, lut3d=lut) for lut in (True, False))
    # The closed form is drawn if a colour is outside of the LUT, else CIEDE2000 0.03 from it.
    assert ciede2000(by_lut, closed).mean() < 0.1


def test_another_deficiency_or_severity_costs_uniforms_alone():
    coefficients, alpha, lit = bright_cube("A")
    gl = GLEngine(coefficients, alpha)
    gl.render(lit, Viewing(deficiency="protan"), np.uint8)
    programs = len(gl._programs._compiled)
    for deficiency in DEFICIENCIES[1:]:
        for severity in (0.2, 0.9):
            gl.render(lit, Viewing(deficiency=deficiency, severity=severity), np.uint8)
    assert len(gl._programs._compiled) == programs
    gl.close()


def test_displays_draw_the_same_picture_as_webgl_2(monkeypatch):
    display = Display(space="Rec. 2020", gamut="reduce", mark=True)
    viewing = Viewing(display=display, deficiency="tritan", severity=0.8)
    given = *bright_cube("A"), viewing, np.uint8
    assert_drawn_alike_by_webgl_2(lambda: gl_frame(*given), monkeypatch)


def test_one_engine_changes_displays_between_frames():
    """Programs are cached by what is compiled into them, a space of any name included."""
    coefficients, alpha, lit = bright_cube("D65")
    own = replace(SPACES["sRGB"], transfer=Transfer.gamma(2.2))
    displays = [*DISPLAYS.values(), Display(space=own), Display(mark=True)]
    gl = GLEngine(coefficients, alpha)
    frames = [gl.render(lit, Viewing(display=d), np.uint8) for d in displays * 2]
    gl.close()
    first, second = frames[: len(displays)], frames[len(displays) :]
    assert all(map(np.array_equal, first, second))
    assert not any(np.array_equal(*pair) for pair in itertools.combinations(first, 2))
