"""Colour: errors of the general bases, frames against colour-science, time of a light's matrix.

    python -m benchmarks.colour

CIEDE2000, each light as white. Sets are those of METHOD: the 84 held-out reflectances under the 26
smooth and 89 spiky lights. "1 nm" compares with sums over 380 to 780 nm every 1 nm.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Figure, in_turn, report
from volspec.appearance.display.spaces import decode_sRGB
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.appearance.spec import Viewing
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.report import basis_report
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    light,
    light_set,
    reflectance,
    reflectance_set,
)
from volspec.spectra.datasets import colour_science
from volspec.spectra.library.reflectances import reflectance_set_names

Array = NDArray[np.float64]

FINE = SpectralGrid(380, 780, 1)
# Basis: smooth mean, spiky mean, on the 31 bands of METHOD.
ASKED = {"general-5": (0.07, 0.65), "general-7": (0.018, 0.225), "general-9": (0.006, 0.11)}
LAMPS = (
    *("A", "D50", "D65", "FL2", "FL4", "FL7", "FL11", "FL12", "HP1", "HP3", "HP5"),
    *("LED-B1", "LED-B3", "LED-B5", "LED-BH1", "LED-RGB1", "LED-V1"),
    *("planck:2200", "daylight:12000", "lamp:halogen-3000"),
)


def held_out(grid: SpectralGrid) -> list[Spectrum]:
    """Return the 84 reflectances on a grid."""
    return [reflectance(name, grid) for name in reflectance_set_names("test")]


def narrow_leds(grid: SpectralGrid) -> list[Spectrum]:
    """Return Gaussians of 420 to 660 nm, 10 to 25 nm wide at half height."""
    nm = np.arange(300.0, 831.0)
    return [
        Spectrum(nm, np.exp(-4 * np.log(2) * ((nm - peak) / width) ** 2), f"{peak}/{width} nm").on(
            grid
        )
        for peak in range(420, 661, 10)
        for width in (10, 15, 20, 25)
    ]


def basis_errors() -> Iterator[Figure]:
    """Yield errors of the general bases in the default mode."""
    for name, asked in ASKED.items():
        basis = SpectralBasis.load(f"{name}-10nm")
        for kind, most in zip(("smooth", "spiky"), asked, strict=True):
            found = basis.report(light_set(kind, basis.grid)).fitted
            yield Figure(f"colour/{name}, 31 bands, {kind}, mean", found.mean, most, True, "ΔE00")
            if (name, kind) == ("general-7", "spiky"):
                yield Figure(f"colour/{name}, 31 bands, spiky, max", found.max, 3, True, "ΔE00")
    basis = SpectralBasis.load("general-7")
    for kind, most in (("smooth", 0.03), ("spiky", 0.25)):
        found = basis_report(basis, light_set(kind, FINE), held_out(FINE), grid=FINE).fitted
        yield Figure(f"colour/general-7 against 1 nm, {kind}, mean", found.mean, most, True, "ΔE00")
    for kind, most in (("smooth", 0.093), ("spiky", 0.419)):
        found = basis.report(light_set(kind, basis.grid)).products[2].fitted
        yield Figure(f"colour/general-7, two surfaces, {kind}", found.mean, most, True, "ΔE00")
    found = basis_report(basis, narrow_leds(FINE), held_out(FINE), grid=FINE).fitted
    yield Figure("colour/general-7 against 1 nm, single LEDs", found.mean, 1, True, "ΔE00")


def times() -> Iterator[Figure]:
    """Yield the time of a light's effect with a cached fit, and of a first fit."""
    basis, lamps = SpectralBasis.load("general-7"), light_set("spiky")
    specs = {mode: RelightSpec(mode=mode) for mode in ("fitted", "componentwise")}
    ours, peer = (
        lambda spec=spec: [Illumination.of(basis, lamp, spec) for lamp in lamps[:20]]
        for spec in specs.values()
    )
    ratio = in_turn(ours, peer).wall
    yield Figure(
        "colour/relight, cached fit / componentwise",
        float(np.median(ratio[:, 0] / ratio[:, 1])),
        *(1, True),
    )
    first = []
    for lamp in lamps[20:]:
        started = time.perf_counter()
        basis.fitted_matrix(lamp)
        first.append(1e3 * (time.perf_counter() - started))
    yield Figure("colour/first fit of a light", median(first), 2, True, "ms")


def oracle(lamp: str, surfaces: list[Spectrum]) -> Array:
    """Return colour-science's linear sRGB (K, 3): 1 nm, CIECAM02 there and back."""
    colour, viewing = colour_science(), Viewing()
    E, Q = light(lamp, FINE).values, colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    weights = Q.copy().align(colour.SpectralShape(380, 780, 1)).values * E[:, None]
    XYZ = 100 * np.array([each.values for each in surfaces]) @ weights / weights[:, 1].sum()
    white = 100 * weights.sum(0) / weights[:, 1].sum()
    surround = colour.VIEWING_CONDITIONS_CIECAM02["Average"]
    L_A = viewing.illuminance_lux / np.pi * viewing.Y_b / 100
    seen = colour.XYZ_to_CIECAM02(XYZ, white, L_A, viewing.Y_b, surround)
    display = viewing.display.conditions
    shown = colour.CIECAM02_to_XYZ(
        colour.CAM_Specification_CIECAM02(J=seen.J, C=seen.C, h=seen.h),
        np.array(display.white_XYZ),
        display.L_A,
        display.Y_b,
        surround,
    )
    return np.asarray(shown @ np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ).T)


def frames() -> Iterator[Figure]:
    """Yield the mean error of frames of 24 materials under 20 lights; displayable colours count."""
    names = [name for name in reflectance_set_names("test") if name.startswith("ColorChecker/")]
    materials = {name: reflectance(name, DEFAULT_GRID) for name in names}
    basis = MaterialBasis(materials)
    pixels = basis.channels_for_materials(materials).astype(np.float32)[None]
    opaque = np.ones(pixels.shape[:2], np.float32)
    errors = []
    to_XYZ = 100 * colour_science().RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    white = to_XYZ.sum(1)
    with Relighter(CoefficientImage(pixels, opaque, opaque, basis), "numpy") as relighter:
        for lamp in LAMPS:
            wanted = oracle(lamp, [reflectance(name, FINE) for name in names]) / 100
            lit = LightRig((light(lamp),))
            got = decode_sRGB(np.float64(relighter.frame(lit, dtype=np.float32)[0]))
            shown = ((wanted > 0) & (wanted < 1)).all(1)
            Lab = (cielab(RGB[shown] @ to_XYZ.T, white) for RGB in (wanted, got))
            errors.append(delta_E_2000(*Lab))
    found = float(np.concatenate(errors).mean())
    yield Figure("colour/frames against colour-science at 1 nm", found, 0.03, True, "ΔE00")


def figures() -> Iterator[Figure]:
    """Yield all figures."""
    reflectance_set("training")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield from basis_errors()
        yield from frames()
        yield from times()


if __name__ == "__main__":
    print(report(list(figures())))
