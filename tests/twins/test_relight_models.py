"""Every model in the shader: closed forms, 3-D LUTs, and no NaN in any frame."""

from typing import Any

import numpy as np
import pytest

from tests.support.fixtures import slow
from tests.support.relighting import (
    assert_in_range,
    ciede2000,
    cpu_frame,
    gl_frame,
    opaque,
    surfaces,
)
from tests.twins.test_relight import gamut
from volspec.appearance import Display, Viewing, view_transform
from volspec.appearance.display.monitors import colour_space, preset
from volspec.appearance.display.spaces import ColourSpace, encode_sRGB, linear_sRGB_from_XYZ
from volspec.appearance.lut3d import Lut3D, LutSpace
from volspec.appearance.spec import MODELS
from volspec.basis import SpectralBasis
from volspec.relight import Illumination, LightRig, RelightSpec, gpu
from volspec.relight.gpu import GLEngine
from volspec.relight.reference import CpuEngine
from volspec.spectra import PAPERS_GRID, Spectrum, light
from volspec.spectra.photometry import XYZ_from_spectra, white_XYZ

pytestmark = pytest.mark.usefixtures("needs_gl")
# Known colour by colour only: always looked up.
TABLED = ("Hunt", "Nayatani95", "ZCAM")
# One of each form: a linear one, a curve, an appearance model and one that is looked up.
FEW = [
    pytest.param(m, marks=[] if m in ("CAT02", "CIELAB", "CIECAM02", "ZCAM") else pytest.mark.slow)
    for m in MODELS
]


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ["A", slow("FL2")])
def test_the_shader_draws_a_model_as_numpy_does(model, name):
    given = *gamut(name), Viewing(model=model, surround=0.12)
    error = ciede2000(gl_frame(*given, lut3d=False), cpu_frame(*given), what=f"{model}, {name}")
    if model in TABLED:
        # Nayatani's turns sharply next to black: the worst is a purple of Y = 2.3.
        assert error.mean() <= 0.10 and np.percentile(error, 99) <= 0.8 and error.max() <= 2.5
    else:  # off by float32 alone
        assert error.mean() <= 0.001 and error.max() <= 0.02


def codes(XYZ: np.ndarray, space: ColourSpace) -> np.ndarray:
    return space.encode(np.clip(XYZ @ space.RGB_from_XYZ.T, 0, 1))


@pytest.mark.parametrize("model", ["CIECAM02", "CAM16", "Nayatani", "Guth"])
@pytest.mark.parametrize("name", ["A", "FL2", "HP1"])
def test_a_table_is_near_the_closed_form(model, name):
    white = white_XYZ(light(name))
    space, transform = colour_space("sRGB"), view_transform(Viewing(model=model), white)
    table = Lut3D.of(transform, LutSpace.between(white, space))
    looked_up, exact = (each.apply(surfaces(white)) for each in (table, transform))
    # The others are drawn by the closed form itself.
    held = np.any(looked_up != exact, axis=-1)
    error = ciede2000(*(codes(XYZ, space) for XYZ in (looked_up, exact)))[held]
    assert held.mean() > 0.6
    assert error.mean() <= 0.10 and error.max() <= 0.8


@pytest.mark.parametrize("software", [gpu.SOFTWARE, ()], ids=["sampler", "interpolated"])
@pytest.mark.parametrize("model", ["CIECAM02", "Guth"])
def test_a_table_filled_on_the_device_is_numpys(model, software, monkeypatch):
    """On a GPU the shader interpolates, as a sampler's weights have 8 bits there."""
    monkeypatch.setattr(gpu, "SOFTWARE", software)
    white, viewing = white_XYZ(light("A")), Viewing(model=model)
    transform, XYZ = view_transform(viewing, white), surfaces(white)
    table = Lut3D.of(transform, LutSpace.between(white, colour_space("sRGB")))
    # Colours that the closed form draws are the same in both: leave them out.
    held = np.any(table.apply(XYZ) != transform.apply(XYZ), axis=-1)
    XYZ[~held] = XYZ[held][0]
    frame = gl_frame(*opaque(XYZ, white), viewing, lut3d=True)
    assert held.mean() > 0.5
    assert ciede2000(frame, encode_sRGB(linear_sRGB_from_XYZ(table.apply(XYZ)))).max() < 0.05


def boxes() -> np.ndarray:
    """Reflectances of one in a band and zero elsewhere, or the reverse: the most saturated."""
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
def test_a_table_holds_where_the_model_has_cliffs_and_beyond_white(name, viewing):
    lamp = light(name, PAPERS_GRID)
    XYZ = XYZ_from_spectra(lamp, boxes())
    transform = view_transform(viewing, white_XYZ(lamp))
    colours = viewing.display.colours
    table = Lut3D.of(transform, LutSpace.between(white_XYZ(lamp), colours))
    seen = (each.apply(viewing.exposure * XYZ[None]) for each in (table, transform))
    error = ciede2000(*(codes(each, colours) for each in seen), what=f"{viewing.model}, {name}")
    assert error.mean() <= 0.10 and error.max() <= 2.0


def test_a_picture_with_colours_that_no_table_holds_is_drawn_by_the_closed_form():
    lamp = light("D65", PAPERS_GRID)
    given = *opaque(XYZ_from_spectra(lamp, boxes())[:, None], white_XYZ(lamp)), Viewing()
    assert np.array_equal(*(gl_frame(*given, lut3d=table) for table in (False, True)))


@pytest.mark.parametrize("model", TABLED)
def test_what_is_brighter_than_white_is_white(model):
    white = white_XYZ(light("A"))
    given = *opaque(3.0 * white[None, None], white), Viewing(model=model, D=1.0)
    assert gl_frame(*given, np.uint8).min() >= 250


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


def engines_of(model: str, coefficients: np.ndarray, alpha: np.ndarray) -> list[Any]:
    """Closed form and LUT of the shader, and NumPy; some models have no closed form."""
    kinds = (True,) if model in TABLED else (False, True)
    engines = [GLEngine(coefficients, alpha, lut3d=table) for table in kinds]
    return [*engines, CpuEngine(coefficients, alpha)]


@pytest.mark.parametrize("model", FEW)
def test_no_colour_gives_nan(model):
    cubes = [cube(REC_2020), cube(ACES_AP0), np.zeros((17, 1, 3)), np.full((17, 1, 3), -5.0)]
    XYZ = np.concatenate(cubes, axis=1)
    engines = engines_of(model, *opaque(XYZ, np.ones(3))[:2])
    for name in ("A", "HP1", "planck:1000"):
        lit = opaque(XYZ, white_XYZ(light(name)))[2]
        for limits in ({}, {"L_A": 0.0}, {"Y_b": 0.0}, {"L_A": 0.0, "Y_b": 0.0}):
            # A LUT takes the host a second: of one limit alone NumPy's pictures will do.
            for engine in engines if model not in TABLED or len(limits) != 1 else engines[-1:]:
                frame = engine.render(lit, Viewing(model=model, **limits), np.float32)
                assert_in_range(frame, (model, name, limits, engine.name))
    for engine in engines:
        engine.close()


BASIS = SpectralBasis.load("general-7")
BANDS = BASIS.grid.size


def blocks(count: int, seed: int) -> np.ndarray:
    """(count, BANDS) 0 and 1 in runs of one to eight bands, as a palette designer's optima are."""
    draw, alternate = np.random.default_rng(seed).integers, np.arange(BANDS) % 2
    rows = [np.repeat(alternate, draw(1, 9, BANDS))[:BANDS] ^ draw(0, 2) for _ in range(count)]
    return np.array(rows, dtype=np.float64)


def designed() -> np.ndarray:
    """(N, BANDS) reflectances: blocks, single bands, bands left out, stripes, black and white."""
    stripes = (np.arange(BANDS) // np.arange(1, 9)[:, None]) % 2
    one = np.eye(BANDS)
    rest = [np.zeros((1, BANDS)), np.ones((1, BANDS)), -0.2 * np.ones((1, BANDS))]
    return np.concatenate([blocks(152, 1), one, 1.0 - one, stripes, 1 - stripes, *rest])


def spectrum(values: np.ndarray) -> Spectrum:
    return Spectrum(BASIS.grid.wavelengths_nm, values)


def lights() -> dict[str, Spectrum | LightRig]:
    """Next to no power (none is refused), one band, some, and LEDs with nothing between."""
    nm = BASIS.grid.wavelengths_nm
    leds = {}
    for centres in ((460, 530, 630), (440, 590), (500, 700)):
        away = nm - np.array(centres)[:, None]
        power = np.where(np.abs(away) < 30, np.exp(-((away / 12) ** 2)), 0.0)
        leds[f"LEDs {centres}"] = spectrum(power.sum(axis=0))
    bands = {f"{n:g} nm": spectrum(1.0 * (nm == n)) for n in (nm[0], 450.0, 510.0, 590.0, nm[-1])}
    return {
        "1e-100 of D65": spectrum(1e-100 * light("D65", BASIS.grid).values),
        "1e-30 lux": LightRig((light("A", BASIS.grid),), illuminance_lux=(1e-30,)),
        **bands,
        **leds,
        **{f"blocks {i}": spectrum(values) for i, values in enumerate(blocks(3, 2))},
    }


DESIGNED_LIGHTS = lights()
VIEWINGS = (
    {},
    {"discount": True, "display": Display(L_A=0.05, surround="dark")},
    {"L_A": 0.0, "Y_b": 0.0, "display": Display(L_A=0.0, Y_b=0.0)},
)


@pytest.mark.parametrize("model", FEW)
def test_designed_spectra_under_designed_lights_give_no_nan(model):
    spectra = designed()
    assert len(spectra) % 3 == 0
    coefficients = BASIS.analyse(spectra).reshape(3, -1, BASIS.size).astype(np.float32)
    alpha = np.ones(coefficients.shape[:2], np.float32)
    alpha[0, :4] = 0.0
    tabled, worst = model in TABLED, 0.0  # a LUT takes the host a second
    engines = engines_of(model, coefficients, alpha)
    for turn, (name, lit) in enumerate(DESIGNED_LIGHTS.items()):
        if tabled and turn % 4:  # the next light's table is as hard
            continue
        looks = VIEWINGS[turn // 2 % 3 :][:1] if tabled else VIEWINGS
        level = "absolute" if isinstance(lit, LightRig) else "relative"
        for others in looks:
            viewing = Viewing(model=model, **others)
            seen = Illumination.of(BASIS, lit, RelightSpec(viewing, level=level))
            for engine in engines:
                frame = engine.render(seen, viewing, np.float32)
                assert_in_range(frame, (model, name, others, engine.name))
                worst = max(worst, float(frame.max()))
    # Not by being black all over.
    assert worst > 0.9
    for engine in engines:
        engine.close()
