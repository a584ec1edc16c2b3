"""Spectra of a palette: given ones, and design variables with bounds and an initial value.

spectra -> [variables] -> model
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.errors import Code, PaletteError, SpectrumError
from volspec.spectra import (
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light_power,
    reflectance_values,
    require_no_emission,
    stack,
)

Array = NDArray[np.float64]
Find = Callable[[str, SpectralGrid], Spectrum]
"""`volspec.light` or `volspec.reflectance`."""

# Periods of the waves that free lights start from, nm (Bergner et al., section 4.1: 60 and 85).
_WAVES_NM = (60.0, 85.0, 110.0, 140.0, 45.0)
SHARE_DECIMALS = 4
"""Decimals of a lamp's share of the illuminance in files and reports."""
# Relative difference up to which two spectra are the same one.
_SAME_SHAPE = 1e-3
# Values in files have six decimals.
_ROUNDING = 1e-5
# A light with less luminance than this fraction of equal energy is too dark to show a colour.
_MIN_Y = 1e-9


def fault(field: str, message: str, code: Code = "conflict", given: object = None) -> PaletteError:
    """Return an error about a field; the message is "problem; remedy"."""
    return PaletteError(message, code=code, field=field, given=given)


@dataclass(frozen=True, slots=True, eq=False)
class PaletteSpectrum:
    """A light or a reflectance of a palette.

    Parameters
    ----------
    name : str
    spectrum : Spectrum, optional
        Values; if it is free, the initial ones (by default one half for a reflectance, and for
        each light a wave of a different period).
    free : bool
        True if it is a variable of the design.
    lower, upper : float, optional
        Bounds of a free spectrum in every band; None: unbounded. For a light, in units of the
        equal-energy light.
    band_nm : (shortest, longest), optional
        A free spectrum is zero outside.
    mixture : tuple of Spectrum
        Lamps; a free light is a sum of these with weights of at least 0, so that it can be built.
    constant : bool
        True for a reflectance with the same colour under every light: objective colour constancy.

    Raises
    ------
    PaletteError
        If a given spectrum has no values, its bounds contradict each other, or it is a mixture,
        as only free lights may be.
    """

    name: str
    spectrum: Spectrum | None = None
    free: bool = False
    lower: float | None = 0.0
    upper: float | None = None
    band_nm: tuple[float, float] | None = None
    mixture: tuple[Spectrum, ...] = ()
    constant: bool = False

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.strip()):
            raise PaletteError.refused("PaletteSpectrum.name", self.name, "give it a name")
        if self.spectrum is None and not self.free:
            problem = f"{self.name!r} has no spectrum; give one, or make it free for design"
            raise fault("PaletteSpectrum.spectrum", problem, "missing")
        for name in ("lower", "upper"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                field = f"PaletteSpectrum.{name}"
                raise PaletteError.refused(field, value, "give a number, or none", "range")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            remedy = "give different bounds" if self.lower == self.upper else "swap them"
            problem = f"{self.lower:g} is not below upper {self.upper:g}; {remedy}"
            raise fault("PaletteSpectrum.lower", problem, given=self.lower)
        if self.band_nm is not None and not self.band_nm[0] < self.band_nm[1]:
            remedy = "the band is empty, give the shortest wavelength first"
            raise PaletteError.refused("PaletteSpectrum.band_nm", self.band_nm, remedy, "range")
        if self.mixture and not self.free:
            problem = f"{self.name!r} is a given spectrum, not a sum of lamps"
            raise fault("PaletteSpectrum.mixture", f"{problem}; make it free for design")

    def synthesis(self, grid: SpectralGrid) -> Array:
        """Return the (N, n) matrix from variables to bands: the identity, part of it, or lamps."""
        inside = np.ones(grid.size, dtype=bool)
        if self.band_nm is not None:
            wavelengths = grid.wavelengths_nm
            inside = (wavelengths >= self.band_nm[0]) & (wavelengths <= self.band_nm[1])
            if not inside.any():
                problem = f"{self.name!r}: no band of {grid} lies within {self.band_nm} nm"
                field = "PaletteSpectrum.band_nm"
                raise fault(field, f"{problem}; widen it", "range", self.band_nm)
        if self.mixture:
            lamps = np.stack([light_power(lamp, grid) for lamp in self.mixture], axis=-1)
            return (lamps / lamps.mean(axis=0)) * inside[:, None]
        return np.eye(grid.size)[:, inside]

    def allows(self, values: Array, grid: SpectralGrid) -> bool:
        """Return True if (N,) values are within the bounds and the band, to rounding."""
        lower = -math.inf if self.lower is None else self.lower
        upper = math.inf if self.upper is None else self.upper
        if self.mixture:
            return bool((values >= -_ROUNDING).all())
        inside = self.synthesis(grid).any(axis=1)
        bounded = (values >= lower - _ROUNDING) & (values <= upper + _ROUNDING)
        return bool(np.where(inside, bounded, np.abs(values) <= _ROUNDING).all())

    def lamp_shares(self, grid: SpectralGrid) -> tuple[float, ...]:
        """Return each lamp's share of a designed mixture's illuminance; empty if there is none."""
        if not self.mixture or self.spectrum is None:
            return ()
        from scipy.optimize import nnls

        lamps = self.synthesis(grid)
        weights, _ = nnls(lamps, self.spectrum.on(grid).values)
        lux = weights * (colour_matching_functions(grid)[1] @ lamps)
        return tuple((lux / lux.sum()).tolist())


# The keyword `open` is accepted for one version;
# a generated constructor has no place for a decorator.


def mixture_text(fractions: Mapping[str, float]) -> str:
    """Return shares of illuminance as `volspec.light` takes them, without lamps of no share.

    >>> mixture_text({"D65": 0.25, "FL2": 1e-9, "A": 0.75})
    'D65*0.25+A*0.75'
    """
    rounded = {name: round(fraction, SHARE_DECIMALS) for name, fraction in fractions.items()}
    return "+".join(f"{name}*{fraction:g}" for name, fraction in rounded.items() if fraction)


def is_named(spectrum: Spectrum, find: Find, grid: SpectralGrid) -> bool:
    """Return True if `volspec.light` or `volspec.reflectance` finds the spectrum by its name."""
    try:
        named, shape = find(spectrum.name, grid).values, stack(spectrum, grid)
    except SpectrumError:
        return False
    level = named.mean(), shape.mean()
    return min(level) > 0.0 and np.allclose(
        named / level[0], shape / level[1], rtol=_SAME_SHAPE, atol=_SAME_SHAPE
    )


def values_on(
    member: PaletteSpectrum, values: Array, find: Find, grids: tuple[SpectralGrid, SpectralGrid]
) -> Array:
    """Return a spectrum's (N,) values on other bands, for a light in any unit.

    A given spectrum and the lamps of a mixture are looked up by their names; what has none, as a
    designed spectrum, is interpolated. ``values`` are on the first of the grids.
    """
    source, target = grids
    nm = source.wavelengths_nm
    if member.mixture:
        weights = replace(member, spectrum=Spectrum(nm, values)).lamp_shares(source)
        lamps = [
            light_power((find(lamp.name, target) if is_named(lamp, find, source) else lamp), target)
            for lamp in member.mixture
        ]
        V = colour_matching_functions(target)[1]
        inside = member.synthesis(target).any(axis=1)
        mixed = sum(weight / (V @ lamp) * lamp for weight, lamp in zip(weights, lamps, strict=True))
        return np.asarray(mixed * inside)
    spectrum = member.spectrum
    if spectrum is not None and not member.free and is_named(spectrum, find, source):
        named = find(spectrum.name, target).values
        return np.asarray(named * (values.mean() / find(spectrum.name, source).values.mean()))
    return Spectrum(nm, values).on(target).values


def initial_reflectance(row: PaletteSpectrum, grid: SpectralGrid) -> Array:
    """Return the (N,) values of a given reflectance, or the initial values of a free one."""
    if row.spectrum is None:
        return np.full(grid.size, 0.5)
    require_no_emission(row.spectrum, label := f"palette: reflectance {row.name!r}")
    if row.free:
        return row.spectrum.on(grid).values
    return reflectance_values(row.spectrum, grid, label)


def initial_light(column: PaletteSpectrum, grid: SpectralGrid, number: int) -> Array:
    """Return the (N,) power, at Y = 100, of a given light, or the initial power of a free one.

    Free lights in columns of different ``number`` start from waves of different periods.
    """
    if column.spectrum is not None:
        power = light_power(column.spectrum, grid, f"palette: light {column.name!r}")
    elif column.mixture:
        power = column.synthesis(grid).sum(axis=1)
    else:
        period = _WAVES_NM[number % len(_WAVES_NM)]
        wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * (grid.wavelengths_nm - grid.start_nm) / period)
        synthesis = column.synthesis(grid)
        power = synthesis @ (synthesis.T @ wave)
    V = colour_matching_functions(grid)[1]
    if not V @ power > _MIN_Y * V.sum():
        raise PaletteError(
            f"light {column.name!r} has no luminance to show colours with; widen its band, or "
            "start from another spectrum",
            code="impossible",
        )
    return 100.0 * power / (V @ power)
