"""Colour rendition of lights: R_a, R_f, R_g, colour vector graphic, SSI; metamerism of pairs.

    spectra, CIECAM02 -> [rendition] -> figure, command line, viewer

CIE and IES tabulate lights every 5 nm, and so does this: a light is to be looked up on
`RENDITION_GRID`, as band means of wider or narrower steps would widen the lines of a lamp.

References
----------
[1] CIE 13.3-1995, "Method of measuring and specifying colour rendering properties of light
    sources": R_1 to R_14 and R_a.
[2] CIE 224:2017, "CIE 2017 colour fidelity index for accurate scientific use": R_f.
[3] ANSI/IES TM-30-18, "IES method for evaluating light source color rendition": the same R_f, R_g,
    hue bins and the colour vector graphic.
[4] Academy of Motion Picture Arts and Sciences S-2018-001, SMPTE ST 2122:2020: SSI, the spectral
    similarity index.
[5] CIE 15:2018, section 9: special metamerism indices, change in illuminant and in observer.
[6] Nimeroff & Yurow (1965), "Degree of metamerism", JOSA 55(2), 185-190.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display.spaces import encode_sRGB, linear_sRGB_from_XYZ
from volspec.appearance.models.cam import CamConditions, forward, inverse
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.errors import SpectrumError
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    Temperature,
    XYZ_from_spectra,
    colour_matching_functions,
    correlated_temperature,
    light,
    light_leaving,
    light_power,
    reflectances,
    white_XYZ,
)
from volspec.spectra.library import lumens_per_watt

Array = NDArray[np.float64]

COLOUR_GRID = SpectralGrid(360, 830, 1)
"""Bands of colour and temperature: the whole range of the CIE 1931 observer, without which a
radiator of 7500 K comes out at 7497 K."""
RADIATED_GRID = SpectralGrid(380.5, 779.5, 1)
"""Bands whose power counts as radiated: 380 to 780 nm exactly."""
RENDITION_GRID = SpectralGrid(380, 780, 5)
"""Bands of R_a, R_f, R_g and metamerism."""
SIMILARITY_GRID = SpectralGrid(377.5, 672.5, 5)
"""Bands of the spectral similarity index: 375 to 675 nm, halves of its intervals."""
HUE_BINS = 16
FARTHEST = 0.0054
"""Duv beyond CIE 13.3's tolerance: R_a is less accurate for a light so far from white."""

# CIE 13.3: a daylight is the reference from here on; CIE 224 mixes both kinds from 4000 K on.
_DAYLIGHT_K, _MIXED_K = 5000.0, 4000.0
_WARMEST_DAYLIGHT_K, _COOLEST_DAYLIGHT_K = 4000.0, 25_000.0
# Scale of R_f: 100 less 6.73 times the mean difference, bent at 0.
_FIDELITY = 6.73


@dataclass(frozen=True, slots=True, eq=False)
class Rendition:
    """Colours of samples under a light, compared with a reference of the same temperature.

    Parameters
    ----------
    temperature : Temperature
    R : (14,) array
        Special colour rendering indices R_1 to R_14 [1].
    R_f, R_g : float
        Fidelity and gamut index [2, 3].
    fidelity : (99,) array
        R_f of every sample.
    test, reference : (16, 2) arrays
        Mean a', b' of CAM02-UCS in every hue bin.
    hue_fidelity, chroma_shift, hue_shift : (16,) arrays
        R_f,h; R_cs,h as a fraction; R_hs,h in radians.
    """

    temperature: Temperature
    R: Array
    R_f: float
    R_g: float
    fidelity: Array
    test: Array
    reference: Array
    hue_fidelity: Array
    chroma_shift: Array
    hue_shift: Array

    @property
    def R_a(self) -> float:
        """General colour rendering index: the mean of R_1 to R_8."""
        return float(self.R[:8].mean())

    @property
    def is_white(self) -> bool:
        """True if the light is within CIE 13.3's tolerance of Planck's locus."""
        return abs(self.temperature.Duv) <= FARTHEST

    def vectors(self) -> tuple[Array, Array]:
        """Return starts and ends (16, 2) of the colour vector graphic's arrows.

        They start on the unit circle, at the reference's mean hue of every bin.
        """
        chroma = np.linalg.norm(self.reference, axis=1, keepdims=True)
        return self.reference / chroma, self.test / chroma


def colour_rendition(spectrum: Spectrum) -> Rendition | None:
    """Return how a light on `RENDITION_GRID` renders colours.

    None if it has no correlated temperature up to 25 000 K, and so no reference.

    Examples
    --------
    >>> found = colour_rendition(light("FL2", RENDITION_GRID))
    >>> round(found.R_a), round(found.R_f), round(found.R_g)
    (64, 70, 86)
    """
    spectrum = spectrum.on(RENDITION_GRID)
    near = correlated_temperature(white_XYZ(spectrum))
    if near is None or near.kelvin > _COOLEST_DAYLIGHT_K:
        return None
    name = "planck" if near.kelvin < _DAYLIGHT_K else "daylight"
    R = _rendering_indices(spectrum, light(f"{name}:{near.kelvin!r}", RENDITION_GRID))
    Jab, reference = (
        _uniform_colours(source) for source in (spectrum, rendition_reference(near.kelvin))
    )
    differences = np.linalg.norm(Jab - reference, axis=1)
    hues = np.arctan2(reference[:, 2], reference[:, 1]) % (2.0 * np.pi)
    bins = (hues / (2.0 * np.pi) * HUE_BINS).astype(int)
    members = [bins == number for number in range(HUE_BINS)]
    test, centres = (np.array([X[m, 1:].mean(0) for m in members]) for X in (Jab, reference))
    middle = (np.arange(HUE_BINS) + 0.5) * (2.0 * np.pi / HUE_BINS)
    radial, tangential = (
        np.stack([np.cos(middle), np.sin(middle)], axis=1),
        np.stack([-np.sin(middle), np.cos(middle)], axis=1),
    )
    shift = (test - centres) / np.linalg.norm(centres, axis=1, keepdims=True)
    return Rendition(
        near,
        R,
        float(_fidelity(differences.mean())),
        100.0 * _area(test) / _area(centres),
        _fidelity(differences),
        test,
        centres,
        _fidelity(np.array([differences[m].mean() for m in members])),
        (shift * radial).sum(1),
        (shift * tangential).sum(1),
    )


def rendition_reference(kelvin: float) -> Spectrum:
    """Return the reference of R_f, R_g: Planck to 4000 K, daylight from 5000 K, mixed between."""
    fraction = min(max((kelvin - _MIXED_K) / (_DAYLIGHT_K - _MIXED_K), 0.0), 1.0)
    parts = {"planck": 1.0 - fraction, "daylight": fraction}
    # Both have a V-weighted mean of 1, so shares are of the luminance.
    spectra = [light(f"{n}:{kelvin!r}", RENDITION_GRID) * part for n, part in parts.items() if part]
    name = "+".join(f"{n}:{kelvin:.0f}*{part:.2f}" for n, part in parts.items() if part)
    return replace(reduce(add, spectra), name=name.removesuffix("*1.00"))


@cache
def _samples(space: str) -> Array:
    """Return the reflectances (N, 81) of a set of test samples, in the order of their numbers."""
    tables = [table for name, table in reflectances().items() if name.startswith(f"{space}/")]
    return np.array([RENDITION_GRID.band_means(*table) for table in tables])


def _uniform_colours(spectrum: Spectrum) -> Array:
    """Return J', a', b' (99, 3) of CAM02-UCS under a light, for the 10 degree observer [2]."""
    conditions = CamConditions.of(white_XYZ(spectrum, 10), L_A=100.0, Y_b=20.0, D=1.0)
    appearance = forward(XYZ_from_spectra(spectrum, _samples("CES"), 10), conditions)
    assert appearance.M is not None
    M = np.log1p(0.0228 * appearance.M) / 0.0228
    J, h = 1.7 * appearance.J / (1.0 + 0.007 * appearance.J), np.radians(appearance.h)
    return np.stack([J, M * np.cos(h), M * np.sin(h)], axis=1)


def _fidelity(difference: Array | float) -> Array:
    return np.asarray(10.0 * np.log1p(np.exp((100.0 - _FIDELITY * np.asarray(difference)) / 10.0)))


def _area(polygon: Array) -> float:
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2.0)


def _rendering_indices(test: Spectrum, reference: Spectrum) -> Array:
    """Return R_1 to R_14 [1]: CIE 1964 U*V*W*, and von Kries' adaptation in CIE 1960 u, v."""
    (u_k, v_k), (u_r, v_r) = (_uv(white_XYZ(source)) for source in (test, reference))
    XYZ = XYZ_from_spectra(test, _samples("TCS 1995"))
    u, v = np.moveaxis(_uv(XYZ), -1, 0)
    c = _c(u, v) * _c(u_r, v_r) / _c(u_k, v_k)
    d = _d(u, v) * _d(u_r, v_r) / _d(u_k, v_k)
    below = 16.518 + 1.481 * c - d
    adapted = np.stack([(10.872 + 0.404 * c - 4.0 * d) / below, 5.520 / below], axis=-1)
    target = XYZ_from_spectra(reference, _samples("TCS 1995"))
    colours = [
        _UVW(uv, Y, (u_r, v_r)) for uv, Y in ((adapted, XYZ[:, 1]), (_uv(target), target[:, 1]))
    ]
    return np.asarray(100.0 - 4.6 * np.linalg.norm(colours[0] - colours[1], axis=1))


def _uv(XYZ: Array) -> Array:
    X, Y, Z = np.moveaxis(XYZ, -1, 0)
    return np.stack([4.0 * X, 6.0 * Y], axis=-1) / (X + 15.0 * Y + 3.0 * Z)[..., None]


def _c(u: Array, v: Array) -> Array:
    return (4.0 - u - 10.0 * v) / v


def _d(u: Array, v: Array) -> Array:
    return (1.708 * v + 0.404 - 1.481 * u) / v


def _UVW(uv: Array, Y: Array, white_uv: tuple[float, float]) -> Array:
    W = 25.0 * np.cbrt(Y) - 17.0
    return np.stack([*(13.0 * W * (uv - white_uv).T), W], axis=-1)


def similarity_reference(kelvin: float) -> str | None:
    """Return the light that SSI compares with [4]: Planck below 4000 K, from there on daylight.

    Temperatures are rounded to whole kelvin; None above 25 000 K.

    >>> similarity_reference(3200.4), similarity_reference(5600)
    ('planck:3200', 'daylight:5600')
    """
    rounded = round(kelvin)
    if rounded > _COOLEST_DAYLIGHT_K:
        return None
    return f"{'planck' if rounded < _WARMEST_DAYLIGHT_K else 'daylight'}:{rounded}"


def spectral_similarity(test: Spectrum, reference: Spectrum) -> float:
    """Return the spectral similarity index of two lights on `SIMILARITY_GRID`, not rounded [4].

    >>> round(spectral_similarity(*(light(n, SIMILARITY_GRID) for n in ("C", "D65"))))
    94
    """
    bands = []
    for spectrum in (test, reference):
        ten = spectrum.on(SIMILARITY_GRID).values.reshape(-1, 2).sum(1)
        bands.append(ten / ten.sum())
    one, other = bands
    relative = _SIMILARITY_WEIGHTS * (one - other) / (other + 1.0 / one.size)
    return float(100.0 - 32.0 * np.linalg.norm(np.convolve(relative, (0.22, 0.56, 0.22), "same")))


# Less weight at the ends of the spectrum, where cameras and eyes are less sensitive.
_SIMILARITY_WEIGHTS = np.concatenate(
    [np.array([12, 22, 32, 40, 44]) / 45, np.ones(23), np.array([11, 3]) / 15]
)


@dataclass(frozen=True, slots=True, eq=False)
class LightFigures:
    """Figures of a light that do not depend on its brightness.

    Parameters
    ----------
    white_XYZ : (3,) array
        Y = 100.
    temperature : Temperature, optional
        None far from Planck's locus; then there is no rendition either.
    lm_per_W : float
        Luminous efficacy of the radiation from 380 to 780 nm.
    rendition : Rendition, optional
    similarity : float, optional
        SSI, not rounded; None without a reference or without power from 375 to 675 nm.
    reference : str
        The light that SSI compares with; empty for none.
    """

    white_XYZ: Array
    temperature: Temperature | None
    lm_per_W: float
    rendition: Rendition | None
    similarity: float | None
    reference: str


def light_figures(
    on: Callable[[SpectralGrid], Spectrum], reference: str | None = None
) -> LightFigures:
    """Measure a light, given by a function that returns it on a grid.

    ``reference`` is the light for SSI, by default `similarity_reference`. Raises SpectrumError if
    the light does not cover the visible, or the reference is unknown.
    """
    white = white_XYZ(on(COLOUR_GRID))
    near = correlated_temperature(white)
    rendition = colour_rendition(on(RENDITION_GRID))
    if rendition is not None and near is not None:
        rendition = replace(rendition, temperature=near)  # of finer bands
    text = reference or (near and similarity_reference(near.kelvin)) or ""
    similarity = None
    if text:
        compared = light(text, SIMILARITY_GRID)
        with suppress(SpectrumError):  # no power there
            similarity = spectral_similarity(on(SIMILARITY_GRID), compared)
    return LightFigures(
        white, near, lumens_per_watt(on(RADIATED_GRID)), rendition, similarity, text
    )


@dataclass(frozen=True, slots=True)
class Metamerism:
    """Figures of two reflectances that are alike under a reference light.

    Parameters
    ----------
    delta_E : float
        CIEDE2000 under the reference light for the 2 degree observer.
    general : float
        Root mean square of the difference between the reflectances, weighted by x² + y² + z² of
        the colour-matching functions, after Nimeroff & Yurow [6]; 0 to 1.
    illuminant : float
        Special index, change in illuminant: CIEDE2000 under the test light [5].
    observers : {observer: float}
        Special index, change in observer: CIEDE2000 for other observers under the reference.
    """

    delta_E: float
    general: float
    illuminant: float
    observers: dict[Observer, float]


def metamerism(one: Spectrum, other: Spectrum, reference: Spectrum, test: Spectrum) -> Metamerism:
    """Compare two reflectances on `RENDITION_GRID` under two lights, and for other observers.

    What fluorescent ones emit counts; of those, the general index compares radiance factors under
    the reference light.
    What they differ by under the reference light is taken from the special indices, by scaling XYZ
    of the second one as CIE 15 does.
    """
    pair = [one.on(RENDITION_GRID), other.on(RENDITION_GRID)]
    power = light_power(reference, RENDITION_GRID)
    factors = light_leaving(pair, power, RENDITION_GRID) / np.where(power > 0, power, np.inf)
    before = XYZ_from_spectra(reference, pair)
    scale = before[0] / np.maximum(before[1], 1e-9)

    def difference(lamp: Spectrum, observer: Observer) -> float:
        XYZ = XYZ_from_spectra(lamp, pair, observer)
        XYZ[1] *= scale
        return _delta_E(XYZ, white_XYZ(lamp, observer))

    weights = (colour_matching_functions(RENDITION_GRID) ** 2).sum(0)
    observers: tuple[Observer, ...] = (10, "CIE 2015 2", "CIE 2015 10")
    return Metamerism(
        _delta_E(before, white_XYZ(reference)),
        float(np.sqrt(weights @ (factors[0] - factors[1]) ** 2 / weights.sum())),
        difference(test, 2),
        {observer: difference(reference, observer) for observer in observers},
    )


def _delta_E(XYZ: Array, white: Array) -> float:
    return float(delta_E_2000(*cielab(XYZ, np.maximum(white, 1e-3 * white[1]))))


def hue_colours(hues: Array, chroma: float = 40.0, lightness: float = 65.0) -> Array:
    """Return sRGB codes (..., 3) of hues in radians, of even lightness and chroma in CIECAM02."""
    conditions = CamConditions.of(white_XYZ(light("D65")), L_A=64.0 / np.pi * 0.2, Y_b=20.0)
    XYZ = inverse(lightness, chroma, np.degrees(hues) % 360.0, conditions)
    return encode_sRGB(np.clip(linear_sRGB_from_XYZ(XYZ), 0.0, 1.0))
