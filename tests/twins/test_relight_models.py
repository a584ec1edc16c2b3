"""Every model in the shader: closed forms, tables, and no NaN anywhere."""

from __future__ import annotations

import numpy as np
import pytest

from tests.twins.test_relight import ciede2000, needs_gl, opaque, surfaces  # noqa: F401
from volspec.appearance import Viewing, view_transform
from volspec.appearance.display import colour_space
from volspec.appearance.lut3d import Lut3D, LutSpace
from volspec.appearance.presets import preset
from volspec.appearance.spec import MODELS
from volspec.relight.cpu import CpuEngine
from volspec.relight.gpu import GLEngine
from volspec.spectra import light
from volspec.spectra.photometry import XYZ_from_spectra, white_XYZ

LIGHTS = ("A", "FL2")
# Known colour by colour only: always looked up.
TABLED = ("Hunt", "Nayatani95")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", LIGHTS)
def test_the_shader_draws_a_model_as_numpy_does(model: str, name: str) -> None:
    white = white_XYZ(light(name))
    coefficients, alpha, lit = opaque(surfaces(white), white)
    viewing = Viewing(model=model, surround=0.12)
    gl = GLEngine(coefficients, alpha, lut3d=False)
    frame = gl.render(lit, viewing, np.float32)
    gl.close()
    truth = CpuEngine(coefficients, alpha).render(lit, viewing, np.float32)
    error = ciede2000(frame, truth)
    print(f"{model} under {name}: CIEDE2000 mean {error.mean():.5f}, max {error.max():.5f}")
    if model in TABLED:
        # Nayatani's turns sharply next to black: the worst is a purple of Y = 2.3.
        assert error.mean() <= 0.10 and np.percentile(error, 99) <= 0.8 and error.max() <= 2.5
    else:  # off by float32 alone
        assert error.mean() <= 0.001 and error.max() <= 0.02


@pytest.mark.parametrize("model", ["CIECAM02", "CAM16", "Nayatani", "Guth"])
@pytest.mark.parametrize("name", [*LIGHTS, "HP1"])
def test_a_table_is_near_the_closed_form(model: str, name: str) -> None:
    white = white_XYZ(light(name))
    space, transform = colour_space("sRGB"), view_transform(Viewing(model=model), white)
    table = Lut3D.of(transform, LutSpace.between(white, space))
    looked_up, exact = (each.apply(surfaces(white)) for each in (table, transform))
    # The others are drawn by the closed form itself.
    held = np.any(looked_up != exact, axis=-1)
    error = ciede2000(
        *(space.encode(np.clip(XYZ @ space.RGB_from_XYZ.T, 0, 1)) for XYZ in (looked_up, exact))
    )[held]
    print(f"{model} under {name}: {held.mean():.2f}, {error.mean():.4f}, max {error.max():.4f}")
    assert held.mean() > 0.6
    assert error.mean() <= 0.10 and error.max() <= 0.8


@pytest.mark.parametrize("model", ["CIECAM02", "Guth"])
def test_a_table_filled_on_the_device_is_numpys(model: str) -> None:
    white = white_XYZ(light("A"))
    viewing = Viewing(model=model)
    space = LutSpace.between(white, colour_space("sRGB"))
    transform = view_transform(viewing, white)
    table = Lut3D.of(transform, space)
    XYZ = surfaces(white)
    # Where the closed form stands in, the two are the same: leave such colours out.
    held = np.any(table.apply(XYZ) != transform.apply(XYZ), axis=-1)
    XYZ[~held] = XYZ[held][0]
    coefficients, alpha, lit = opaque(XYZ, white)
    gl = GLEngine(coefficients, alpha, lut3d=True)
    frame = gl.render(lit, viewing, np.float32)
    gl.close()
    assert held.mean() > 0.5
    from volspec.appearance.spaces import encode_sRGB, linear_sRGB_from_XYZ

    assert ciede2000(frame, encode_sRGB(linear_sRGB_from_XYZ(table.apply(XYZ)))).max() < 0.05


def boxes() -> np.ndarray:
    """Reflectances of one in a band and nothing beside, or the reverse: the most saturated."""
    edges = [(a, b) for a in range(31) for b in range(a + 1, 32)]
    own = np.array([[a <= k < b for k in range(31)] for a, b in edges], dtype=float)
    return np.concatenate([own, 0.05 * own, 1.0 - own, 3.0 * own])


@pytest.mark.parametrize(
    ("name", "viewing"),
    [
        ("D65", Viewing()),
        ("HP1", Viewing(model="CAM16")),
        ("A", Viewing(model="Guth", exposure=3.0)),
        ("A", Viewing(display=preset("cinema").display(space="DCI-P3"))),
        ("D65", Viewing(Y_b=1.0)),
    ],
)
def test_a_table_holds_where_the_model_has_cliffs_and_beyond_white(
    name: str, viewing: Viewing
) -> None:
    lamp = light(name)
    XYZ = XYZ_from_spectra(lamp, boxes())
    transform = view_transform(viewing, white_XYZ(lamp))
    colours = viewing.display.colours
    table = Lut3D.of(transform, LutSpace.between(white_XYZ(lamp), colours))
    frames = [
        colours.encode(np.clip(each.apply(viewing.exposure * XYZ) @ colours.RGB_from_XYZ.T, 0, 1))
        for each in (table, transform)
    ]
    error = ciede2000(*(frame[None] for frame in frames))
    print(f"{viewing.model} under {name}: CIEDE2000 mean {error.mean():.4f}, max {error.max():.3f}")
    assert error.mean() <= 0.10 and error.max() <= 2.0


def test_a_picture_with_colours_that_no_table_holds_is_drawn_by_the_closed_form() -> None:
    lamp = light("D65")
    coefficients, alpha, lit = opaque(XYZ_from_spectra(lamp, boxes())[:, None], white_XYZ(lamp))
    frames = []
    for table in (False, True):
        gl = GLEngine(coefficients, alpha, lut3d=table)
        frames.append(gl.render(lit, Viewing(), np.float32))
        gl.close()
    assert np.array_equal(*frames)


@pytest.mark.parametrize("model", TABLED)
def test_what_is_brighter_than_white_is_white(model: str) -> None:
    white = white_XYZ(light("A"))
    coefficients, alpha, lit = opaque(3.0 * white[None, None], white)
    gl = GLEngine(coefficients, alpha)
    frame = gl.render(lit, Viewing(model=model, D=1.0), np.uint8)
    gl.close()
    assert frame.min() >= 250


def cube(XYZ_from_RGB: np.ndarray) -> np.ndarray:
    steps = np.linspace(0.0, 1.0, 17)
    return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(17, -1, 3) @ XYZ_from_RGB.T


# Columns are the primaries, Y = 100 for white: Rec. 2020, and ACES AP0 with its imaginary blue.
REC_2020 = 100 * np.array(
    [[0.636958, 0.144617, 0.168881], [0.2627, 0.677998, 0.059302], [0.0, 0.028073, 1.060985]]
)
ACES_AP0 = 100 * np.array(
    [[0.9525524, 0.0, 0.0000937], [0.3439664, 0.7281661, -0.0721325], [0.0, 0.0, 1.0088252]]
)


@pytest.mark.parametrize("model", MODELS)
def test_no_colour_gives_nan(model: str) -> None:
    cubes = [cube(REC_2020), cube(ACES_AP0), np.zeros((17, 1, 3)), np.full((17, 1, 3), -5.0)]
    XYZ = np.concatenate(cubes, axis=1)
    coefficients, alpha, _ = opaque(XYZ, np.ones(3))
    # Two models have no closed form: they are looked up either way.
    kinds = (True,) if model in TABLED else (False, True)
    engines = [GLEngine(coefficients, alpha, lut3d=table) for table in kinds]
    engines.append(CpuEngine(coefficients, alpha))
    for name in ("A", "HP1", "planck:1000"):
        lit = opaque(XYZ, white_XYZ(light(name)))[2]
        for limits in ({}, {"L_A": 0.0}, {"Y_b": 0.0}, {"L_A": 0.0, "Y_b": 0.0}):
            for engine in engines:
                frame = engine.render(lit, Viewing(model=model, **limits), np.float32)
                assert np.isfinite(frame).all(), (model, name, limits, engine.name)
                assert frame.min() >= 0.0 and frame.max() <= 1.0
    for engine in engines:
        engine.close()
