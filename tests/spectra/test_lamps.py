"""Photometry and the lamps of Neumann et al., section 3."""

import math

import numpy as np
import pytest
from colour import MSDS_CMFS
from colour.temperature import CCT_to_uv_Ohno2013

import volspec as vs
from volspec.spectra import DEFAULT_GRID, SpectralGrid, light, light_names
from volspec.spectra.library.lamps import (
    LAMPS,
    flux_lm,
    irradiance,
    lamp_illuminance_lux,
    lumens_per_watt,
    luminosity,
    monochromatic_lm,
)
from volspec.spectra.photometry import C2_NM_K, correlated_temperature, illuminance_lux, luminance


def test_V_is_a_tenth_at_472_and_651_nm():
    """The paper's 429 nm is a misprint (errata); its 651 nm holds."""
    assert luminosity(472.0) == pytest.approx(0.1, abs=1e-3)
    assert luminosity(651.0) == pytest.approx(0.1, abs=2e-3)
    assert luminosity(429.0) == pytest.approx(0.0107, abs=5e-5)
    assert luminosity(555.0) == 1.0
    assert monochromatic_lm(2.0, 555.0) == pytest.approx(1366.0)
    # Section 3.2: the ends of 400-700 nm.
    assert (luminosity(400.0), luminosity(700.0)) == pytest.approx((0.000396, 0.004102))
    assert luminosity(300.0) == luminosity(900.0) == 0.0


def test_table_4_has_17_sources_7_of_them_with_lumens_per_watt():
    assert len(LAMPS) == 17 and not any(name.startswith("lamp:") for name in light_names())
    lumens = [row.efficacy_lm_per_W for row in LAMPS.values() if row.efficacy_lm_per_W]
    assert lumens == [25, 83, 21, 15, 13, 12, 10]
    for name, row in LAMPS.items():
        assert name.endswith(f"-{row.kelvin:.0f}")


def test_a_lamp_is_the_planck_radiator_of_its_temperature():
    for name, row in LAMPS.items():
        shown = vs.light(f"lamp:{name}")
        assert np.array_equal(shown.values, light(f"planck:{row.kelvin}").values)
        assert shown.name == f"lamp:{name}"


def test_lamps_mix_as_other_lights_do():
    mix = light("lamp:halogen-3300*0.3 + D65*0.7")
    expected = 0.3 * light("planck:3300").values + 0.7 * light("D65").values
    np.testing.assert_allclose(mix.values, expected, rtol=1e-12)
    assert mix.name.startswith("lamp:halogen-3300*0.3+")
    for text in (" Lamp:Candle-1900 ", "lamp: candle-1900"):
        assert light(text).name == "lamp:candle-1900"


def test_a_100_W_bulb_gives_119_lux_at_a_metre():
    # 100 W · 15 lm/W / 4π.
    assert flux_lm("tungsten-2850", 100.0) == 1500.0
    assert lamp_illuminance_lux("tungsten-2850", 100.0, 1.0) == pytest.approx(1500 / 4 / math.pi)
    near, far = (lamp_illuminance_lux("lamp:studio-3200", 500.0, d) for d in (2.0, 4.0))
    assert near == pytest.approx(4.0 * far)


def test_a_beam_gathers_the_flux():
    all_around = lamp_illuminance_lux("studio-3200", 500.0, 2.0)
    assert lamp_illuminance_lux("studio-3200", 500.0, 2.0, 360.0) == pytest.approx(all_around)
    assert lamp_illuminance_lux("studio-3200", 500.0, 2.0, 180.0) == pytest.approx(2 * all_around)
    # 2π (1 - cos 10°) of 4π.
    narrow = lamp_illuminance_lux("studio-3200", 500.0, 2.0, 20.0)
    assert narrow == pytest.approx(all_around * 2.0 / (1.0 - math.cos(math.radians(10.0))))


def test_lux_to_watts_and_back():
    bulb = irradiance(light("lamp:tungsten-2850"), 200.0)
    assert illuminance_lux(bulb) == pytest.approx(200.0, rel=1e-12)
    assert luminance(bulb) == pytest.approx(200.0 / math.pi)
    watts = float(bulb.values.sum() * DEFAULT_GRID.step_nm)
    assert lumens_per_watt(bulb) == pytest.approx(200.0 / watts)
    other = irradiance(light("lamp:tungsten-2850"), 200.0, SpectralGrid(420, 680, 20))
    assert illuminance_lux(other) == pytest.approx(200.0, rel=1e-12)


def test_lumens_per_watt_of_radiation():
    green = vs.Spectrum(np.arange(550.0, 561.0), np.ones(11), "green")
    assert lumens_per_watt(green) == pytest.approx(683.0, rel=2e-3)
    # Equal energy over 360-830 nm: 683 · 106.857 / 470, the integral of V being 106.857 nm.
    flat = vs.Spectrum(np.arange(360.0, 831.0), np.ones(471), "flat")
    assert lumens_per_watt(flat) == pytest.approx(683.0 * 106.857 / 471, rel=1e-4)


OBSERVER = "CIE 1931 2 Degree Standard Observer"
# colour-science's second radiation constant is that of ITS-90.
_KELVIN_OF_THEIRS = C2_NM_K / 1.4388e7


def white(kelvin: float, Duv: float) -> list[float]:
    # Given by itself the observer is not cut at 780 nm, which moves 1000 K by 0.2 K.
    u, v = CCT_to_uv_Ohno2013(np.array([kelvin, Duv]), MSDS_CMFS[OBSERVER])
    return [1.5 * u / v, 1.0, (4.0 - u - 10.0 * v) / (2.0 * v)]


@pytest.mark.parametrize("Duv", [-0.045, -0.003, -1e-5, 0.001, 0.02, 0.045])
def test_what_lies_beside_a_temperature_has_it(Duv):
    for kelvin in np.geomspace(1010, 99_000, 25):
        found = correlated_temperature(white(kelvin, Duv))
        assert found is not None
        # A parabola through rows 0.2 % apart; measured 2e-5 and 5e-8.
        assert found.kelvin == pytest.approx(kelvin * _KELVIN_OF_THEIRS, rel=5e-5)
        assert found.Duv == pytest.approx(Duv, abs=1e-6)


def test_there_is_none_beyond_the_table_or_far_from_the_locus():
    for kelvin, Duv in ((990, 0), (102_000, 0), (5000, 0.051), (5000, -0.051), (600, 0.01)):
        assert correlated_temperature(white(kelvin, Duv)) is None, (kelvin, Duv)
