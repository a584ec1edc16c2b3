"""Frames as OpenEXR: linear light, half floats, the primaries told, spectra where asked for.

    pixels -> [exr]

Opacity is multiplied into the colours, as compositors expect of this format.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._exr import chromaticities, halves, write_exr
from volspec.appearance.spaces import ColourSpace
from volspec.errors import ImageError
from volspec.spectra.spectral_image import spectral_channels, spectral_header


class ExrRows:
    """Rows of one picture, kept until all are there."""

    def __init__(self) -> None:
        self.parts: list[NDArray[np.float16]] = []

    def rows(self, pixels: NDArray[Any]) -> None:
        """Add rows; (R, W, C) linear."""
        self.parts.append(halves(pixels))


@contextmanager
def exr_file(
    path: str | os.PathLike[str],
    space: ColourSpace,
    text: Mapping[str, str],
    wavelengths_nm: ArrayLike | None = None,
    units: str = "",
) -> Iterator[ExrRows]:
    """An OpenEXR picture that takes its rows; it appears when all are there.

    Parameters
    ----------
    path : path
    space : ColourSpace
        Its primaries and white go into the header's ``chromaticities``.
    text : {name: text}
        Goes into the header, as ``volspec:name``.
    wavelengths_nm : (N,) array, optional
        Behind red, green and blue (and opacity) the rows hold a spectrum: radiances in the
        spectral layout (`volspec.spectra.spectral_image`).
    units : str
        Of the radiances.

    Raises
    ------
    ImageError
        If the file cannot be written.
    """
    writer = ExrRows()
    yield writer
    header: dict[str, Any] = {
        "chromaticities": chromaticities(space.primaries_xy, space.white_xy),
        **{f"volspec:{name}": value for name, value in text.items()},
    }
    bands = []
    if wavelengths_nm is not None:
        header |= spectral_header("emissive", units)
        bands = spectral_channels("emissive", wavelengths_nm)
    colours = "RGBA"[: writer.parts[0].shape[2] - len(bands)]
    channels = {
        name: np.concatenate([part[..., i] for part in writer.parts])
        for i, name in enumerate((*colours, *bands))
    }
    write_exr(path, header, channels, ImageError)
