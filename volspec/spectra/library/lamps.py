"""Lamps and sky light by name: temperature, lumens per watt, lux at a distance.

    photometry -> [lamps] -> lights (``lamp:halogen-3300``), scene

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 3, eq. 2-4, table 4 (temperatures and efficacies).
[2] BIPM, SI brochure, 9th edition: 683 lm/W at 540 THz.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from volspec.errors import SpectrumError, nearest
from volspec.spectra.datasets import colour_matching_functions, observers
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import LUMINOUS_EFFICACY, illuminance_lux
from volspec.spectra.spectrum import Spectrum, light_power

LAMP = "lamp"


@dataclass(frozen=True, slots=True)
class Lamp:
    """Row of table 4 [1]: a source and the nearest Planck radiator."""

    name: str
    what: str
    kelvin: float
    efficacy_lm_per_W: float | None = None
    """Lumens per watt of electrical power; None if not in the table."""


_TABLE = (
    Lamp("north-sky-7500", "north-sky light", 7500.0),
    Lamp("daylight-6500", "average daylight", 6500.0),
    Lamp("xenon-6500", "xenon flash", 6500.0),
    Lamp("sun-and-sky-5500", "sunlight and skylight", 5500.0),
    Lamp("sun-4700", "sunlight, sun 20° high", 4700.0),
    Lamp("sun-4000", "sunlight, sun 10° high", 4000.0),
    Lamp("fluorescent-3500", "fluorescent lamps, white or natural", 3500.0),
    Lamp("halogen-3300", "tungsten halogen lamps of short life", 3300.0),
    Lamp("studio-3200", "studio tungsten lamps", 3200.0, 25.0),
    Lamp("fluorescent-3000", "fluorescent lamps, warm white", 3000.0, 83.0),
    Lamp("halogen-3000", "tungsten halogen lamps of long life", 3000.0, 21.0),
    Lamp("tungsten-2850", "tungsten, 100 W at 110 V", 2850.0, 15.0),
    Lamp("tungsten-2750", "tungsten, 100 W at 240 V", 2750.0, 13.0),
    Lamp("tungsten-2700", "tungsten, 40 W at 110 V", 2700.0, 12.0),
    Lamp("tungsten-2650", "tungsten, 40 W at 240 V", 2650.0, 10.0),
    Lamp("sunset-2000", "sunlight at sunset", 2000.0),
    Lamp("candle-1900", "candle flame", 1900.0),
)
LAMPS: Mapping[str, Lamp] = MappingProxyType({row.name: row for row in _TABLE})


def lamp(name: str) -> Lamp:
    """Return a lamp by name, with or without ``lamp:``, in any case."""
    bare = str(name).strip().casefold().removeprefix(f"{LAMP}:").strip()
    if bare in LAMPS:
        return LAMPS[bare]
    raise SpectrumError(
        f"lamp {name!r} is unknown; {nearest(bare, LAMPS)}known: {', '.join(LAMPS)}", code="unknown"
    )


def lamp_for_light(light: str) -> Lamp:
    """Return the lamp that a light's text names, so that its illuminance follows from its watts.

    Raises SpectrumError if the light is a mix, or not a lamp.
    """
    prefix, _, name = str(light).strip().casefold().partition(":")
    if prefix == LAMP and name.strip() in LAMPS:
        return LAMPS[name.strip()]
    raise SpectrumError(
        f"light {light!r}: only a lamp's illuminance follows from its watts; use a lamp, such as "
        "lamp:tungsten-2850, or give lux",
        code="unsupported",
    )


def flux_lm(of: str | Lamp, power_W: float) -> float:
    """Return the luminous flux of a lamp, lm: electrical power times efficacy.

    Raises SpectrumError if the lamp is unknown or table 4 has no efficacy for it.
    """
    source = of if isinstance(of, Lamp) else lamp(of)
    _require_above_0("power_W", power_W)
    if source.efficacy_lm_per_W is None:
        names = (row.name for row in _TABLE if row.efficacy_lm_per_W is not None)
        raise SpectrumError(
            f"lamp {source.name!r}: the table has no lumens per watt for {source.what}; give lux, "
            f"or use one of {', '.join(names)}",
            code="missing",
        )
    return power_W * source.efficacy_lm_per_W


def lamp_illuminance_lux(
    of: str | Lamp, power_W: float, distance_m: float, beam_deg: float | None = None
) -> float:
    """Return the illuminance at normal incidence from a point-like lamp, lux.

        E = Φ / (Ω d²),  Ω = 4π, or 2π (1 - cos(beam / 2)) for a spotlight

    Raises SpectrumError as `flux_lm` does, or if the distance is not above 0 or the angle not
    within 0…360.

    Parameters
    ----------
    of : str or Lamp
    power_W : float
        Electrical power.
    distance_m : float
    beam_deg : float, optional
        Full angle of the cone that receives all flux evenly; None means all directions.

    Examples
    --------
    >>> round(lamp_illuminance_lux("tungsten-2850", 100, 1.0), 1)
    119.4
    """
    _require_above_0("distance_m", distance_m)
    beam = 360.0 if beam_deg is None else beam_deg
    if not 0.0 < beam <= 360.0:
        raise SpectrumError.refused("lamp.beam_deg", beam_deg, "expected above 0, at most 360")
    solid_angle = 4.0 * math.pi * math.sin(math.radians(beam) / 4.0) ** 2
    lit_m2 = solid_angle * distance_m * distance_m
    lux = flux_lm(of, power_W) / lit_m2 if lit_m2 > 0.0 else math.inf
    if not math.isfinite(lux):
        raise SpectrumError(
            f"lamp: {power_W:g} W within {beam:g}° at {distance_m:g} m has no finite illuminance; "
            "give less power, a wider beam or more distance"
        )
    return lux


def lumens_per_watt(radiation: Spectrum) -> float:
    """Return the luminous efficacy of radiation, lm/W: 683 ∑ E V / ∑ E over the spectrum's range.

    A lamp's efficacy is lower, because it includes power outside of that range and losses.
    """
    grid = radiation.grid
    power = light_power(radiation, grid)
    return float(LUMINOUS_EFFICACY * (colour_matching_functions(grid)[1] @ power) / power.sum())


def monochromatic_lm(power_W: float, wavelength_nm: float) -> float:
    """Return the lumens of light of one wavelength, 360-830 nm: 683 V(λ) P [1, eq. 2]."""
    if not 360.0 <= wavelength_nm <= 830.0:
        raise SpectrumError.refused("wavelength_nm", wavelength_nm, "expected within 360-830 nm")
    return LUMINOUS_EFFICACY * luminosity(wavelength_nm) * power_W


def luminosity(wavelength_nm: float) -> float:
    """Interpolate V(λ) of CIE 1931 linearly between whole nanometres; 0 beyond 360-830 nm."""
    nm, xyz = observers()["CIE 1931 2 Degree Standard Observer"]
    return float(np.interp(wavelength_nm, nm, xyz[:, 1], left=0, right=0))


def irradiance(light: Spectrum, illuminance: float, grid: SpectralGrid | None = None) -> Spectrum:
    """Scale a light to the spectral irradiance, W / (m² nm), of an illuminance, lux.

    The result is on ``grid``, by default the light's own. Raises SpectrumError if the light has no
    luminous energy or the illuminance is not above 0.
    """
    _require_above_0("illuminance", illuminance)
    shape = light if grid is None else light.on(grid)
    power = light_power(shape, shape.grid)
    relative = Spectrum(shape.wavelengths_nm, power, shape.name)
    return Spectrum(
        shape.wavelengths_nm, power * (illuminance / illuminance_lux(relative)), shape.name
    )


def _require_above_0(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise SpectrumError.refused(f"lamp: {name}", value, "expected a finite number above 0")
