"""Relight pictures to spectra: the light of each pixel, band by band.

    coefficient image, light -> [spectral] -> exr

    S = Σ_g W_g C_g + (1 - A) S_backdrop             W_g = κ diag(E_g) B         exact, fitted
                                                     W_g = κ B diag(A E_g)       componentwise
                                                     W_g = κ B R(A E_g)          linear-model

κ scales so that a perfect diffuser under equal-energy light of the same luminance is 1 in every
band: Y = Σ S V / Σ V is 1 for white, as in an EXR frame. The exact product preserves spikes of the
light; the others are as smooth as the basis. An exact spectrum has the colours of the exact light
matrix if the basis spans flat white (B 1 = 1).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._exr import to_half
from volspec._files import require_suffix
from volspec.basis import Basis, SpectralBasis
from volspec.export.exr import PRIMARIES, ExrBands, ExrHeader, ExrWriter, encoding_threads
from volspec.export.frames import row_file
from volspec.export.tiles import row_strips
from volspec.image import ONE_GROUP, CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    illuminance_lux,
    stack,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SpectralIllumination:
    """Relighting by one light in N bands: the spectral counterpart of `Illumination`.

    >>> from volspec.basis import SpectralBasis
    >>> from volspec.spectra import light
    >>> lit = SpectralIllumination.of(SpectralBasis.load("general-7"), light("E"), RelightSpec())
    >>> lit.pixels(np.full((1, 7), 0.5), np.ones(1))[0, 3:].round(6).tolist() == [0.5] * 81
    True
    """

    bands_from_channels: Array  # (N, L·M)
    backdrop: Array  # (N,)
    grid: SpectralGrid
    observer_deg: Observer  # standard observer of the colours
    # W / (m² sr nm) of 1 in a band: white has the lights' lux, or if they have none the viewing's.
    radiance_of_one: float

    @classmethod
    def of(
        cls,
        basis: Basis,
        light: Spectrum | LightRig,
        spec: RelightSpec,
        groups: Mapping[str, float] = ONE_GROUP,
    ) -> Self:
        """Return a light's matrices for coefficients in a basis; see `Illumination.of`."""
        illumination = Illumination.of(basis, light, spec, groups)
        rig = LightRig.of(light)
        mixed = rig.facing(groups).mixed(basis.grid)
        kappa = flat_white_scale(basis, mixed, illumination.gain)
        parts = []
        for group in groups:
            lamps = rig.shining_from(group)
            product = None if lamps is None else _product(basis, lamps.mixed(basis.grid), spec.mode)
            parts.append(np.zeros((basis.grid.size, basis.size)) if product is None else product)
        reflected = (
            stack(spec.backdrop, basis.grid)
            if isinstance(spec.backdrop, Spectrum)
            else spec.backdrop
        )
        lux = illumination.viewing.illuminance_lux
        seen_through = spec.seen_through(basis.grid)
        scale = kappa * (np.ones(basis.grid.size) if seen_through is None else seen_through.values)
        return cls(
            scale[:, None] * np.hstack(parts),
            scale * mixed.values * reflected,
            basis.grid,
            basis.observer_deg,
            lux / np.pi / (kappa * illuminance_lux(mixed)),
        )

    def pixels(self, coefficients: ArrayLike, alpha: ArrayLike) -> Array:
        """Return (..., 3 + N): linear Rec. 709, white 1, without adaptation, and the spectra."""
        bare = 1.0 - np.asarray(alpha, np.float64)
        C = np.asarray(coefficients, np.float64)
        spectra = C @ self.bands_from_channels.T + bare[..., None] * self.backdrop
        Q = colour_matching_functions(self.grid, self.observer_deg)
        to_RGB = PRIMARIES["Rec. 709"].RGB_from_XYZ @ (100.0 * Q / Q[1].sum())
        return np.concatenate([spectra @ to_RGB.T, spectra], axis=-1)

    def strips(self, image: CoefficientImage) -> Iterator[NDArray[np.float16]]:
        """Yield the `pixels` of an image as half floats, in strips of rows to save memory."""
        for rows in row_strips(image.size, 3 + self.grid.size):
            yield to_half(self.pixels(image.coefficients[rows], image.alpha[rows]))

    @property
    def bands(self) -> ExrBands:
        """Wavelengths and unit of the bands in a file."""
        units = f"{self.radiance_of_one:.7g} W.m^-2.sr^-1.nm^-1"
        return ExrBands(self.grid.wavelengths_nm, units)


def flat_white_scale(basis: Basis, light: Spectrum, gain: float) -> float:
    """Return gain times κ, which scales flat white of the light's luminance to 1 in every band."""
    V = colour_matching_functions(basis.grid, basis.observer_deg)[1]
    return float(gain * V.sum() / (V @ light.values))


def _product(basis: Basis, light: Spectrum, mode: str) -> Array:
    """Return the (N, M) matrix from channels to bands of the colour signal."""
    if not isinstance(basis, SpectralBasis) or mode in ("exact", "fitted"):
        return np.asarray(basis.leaving(np.eye(basis.size), light.values).T)
    B = basis.synthesise(np.eye(basis.size)).T
    if mode == "componentwise":
        return B * basis.analyse(light)
    return B @ basis.illumination_matrix(light)


def write_spectral_frame(
    path: str | os.PathLike[str],
    image: CoefficientImage,
    light: Spectrum | LightRig,
    spec: RelightSpec,
    text: Mapping[str, str],
) -> None:
    """Write a relit picture with a spectrum in every pixel; errors as in `Illumination.of`.

    Bands are half floats ``S0.400,000000nm``, … in the layout of Fichet et al. (2021), with the
    unit in ``emissiveUnits``; R, G and B are for picture viewers. Mode, backdrop, level and
    exposure of ``spec`` apply, adaptation does not.
    """
    require_suffix(path, "spectral frames", ".exr")
    illumination = SpectralIllumination.of(image.basis, light, spec, image.groups)
    header = ExrHeader(image.size, PRIMARIES["Rec. 709"], text, bands=illumination.bands)
    with row_file(path, lambda file: ExrWriter(file, header, encoding_threads())) as rows:
        for strip in illumination.strips(image):
            rows.rows(strip)
