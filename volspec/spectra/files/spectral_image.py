"""Images with a spectrum in every pixel, and their OpenEXR layout.

    grid, spectrum, envi -> [spectral_image] -> files

An emissive channel is named ``S0.550,000000nm``, a reflective one ``T.550,000000nm``, with a
decimal comma because a point separates layers. The unit is m or Hz with an SI prefix.

References
----------
[1] Fichet, Pacanowski & Wilkie (2021), "An OpenEXR Layout for Spectral Images", Journal of
    Computer Graphics Techniques 10(3), 1-18. http://jcgt.org/published/0010/03/01/
"""

from __future__ import annotations

import json
import operator
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._exr import read_exr, write_exr
from volspec._files import require_suffix
from volspec._parse import parse_json
from volspec.errors import SpectrumError, VolspecWarning
from volspec.spectra.files import envi
from volspec.spectra.files.tables import path_text, require_nanometres
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.spectrum import Kind, Spectrum, extended_band_means, read_only_notes

_LAYER = {"emissive": "S0", "reflective": "T"}
_QUANTITY = {"emissive": "radiance", "reflective": "reflectance"}
_WAVE = r"(\d+(?:,\d*)?|,\d+)((?:[eE][+-]?\d+)?)(da|[YZEPTGMkhdcmunp])?(m|Hz)"
_CHANNEL = re.compile(rf"(S[0-3]|T)\.{_WAVE}")
_RERADIATION = re.compile(rf"T\.{_WAVE}\.{_WAVE}")
_EXPONENTS = (24, 21, 18, 15, 12, 9, 6, 3, 2, -1, -2, -3, -6, -9, -12)
_PREFIX = dict(zip("YZEPTGMkhdcmunp", _EXPONENTS, strict=True)) | {"da": 1, "": 0}
_SPEED_OF_LIGHT = 299_792_458.0
# The layout's unit for radiance; values are nevertheless densities per nm.
_DEFAULT_UNITS = "W.m^-2.sr^-1"
# Header texts longer than this are tables (the spectrum of an illuminant), not notes.
_MAX_NOTE = 200


@dataclass(frozen=True, slots=True, eq=False)
class SpectralImage:
    """Image with a spectrum in every pixel; the arrays are read-only.

    Parameters
    ----------
    values : (H, W, N) float32
        Finite; row 0 is the top. Radiance (emissive) or reflectance (reflective).
    wavelengths_nm : (N,) array
        Strictly increasing, nm, N >= 2.
    kind : "reflective" or "emissive"
    notes : {str: str}
        Metadata from the file's header; keys as in `Spectrum`.

    Raises
    ------
    SpectrumError
        If the arrays do not fit together or have values other than finite numbers, or the kind is
        unknown.
    """

    values: NDArray[np.float32]
    wavelengths_nm: NDArray[np.float64]
    kind: Kind
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_kind(self.kind, "spectral image")
        values = np.ascontiguousarray(self.values, dtype=np.float32).view()
        w = np.array(self.wavelengths_nm, dtype=np.float64)
        if w.size == 1:
            raise SpectrumError(
                "spectral image: one wavelength; at least 2 are needed", code="shape"
            )
        if values.ndim != 3 or 0 in values.shape or w.shape != values.shape[2:] or w.size < 2:
            raise SpectrumError(
                f"spectral image: values have shape {values.shape}, wavelengths {w.shape}; "
                "expected (H, W, N) and (N,) with N of at least 2",
                code="shape",
            )
        if not (np.isfinite(w).all() and np.all(np.diff(w) > 0) and w[0] > 0):
            raise SpectrumError(
                f"spectral image: wavelengths {w[:4]} … nm must be positive and increase "
                "strictly; sort them and remove duplicates"
            )
        if not np.isfinite(values).all():
            y, x, k = np.unravel_index(int(np.argmin(np.isfinite(values))), values.shape)
            raise SpectrumError(
                f"spectral image: pixel ({x}, {y}) is {values[y, x, k]} at {w[k]:g} nm, not "
                "finite; give a finite number"
            )
        for array in (values, w):
            array.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "wavelengths_nm", w)
        object.__setattr__(self, "notes", read_only_notes(self.notes, "spectral image"))

    def __reduce__(self) -> tuple[Any, ...]:
        # A pickled array can be written to.
        return SpectralImage, (self.values, self.wavelengths_nm, self.kind, self.notes)

    def __repr__(self) -> str:
        (width, height), w = self.size, self.wavelengths_nm
        return (
            f"SpectralImage({width}x{height}, {w.size} wavelengths {w[0]:g}-{w[-1]:g} nm, "
            f"{self.kind})"
        )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.values.shape[:2]
        return width, height

    def on(self, grid: SpectralGrid) -> SpectralImage:
        """Return every pixel's band means on a grid; see `Spectrum.on`.

        SpectrumError if the wavelengths do not cover the visible part of the grid.
        """
        # Band means are linear in the samples: those of unit samples are the (N, L) matrix.
        samples = np.eye(self.wavelengths_nm.size)
        means = extended_band_means(self.wavelengths_nm, samples, grid)
        values = self.values @ means.T.astype(np.float32)
        return SpectralImage(values, grid.wavelengths_nm, self.kind, self.notes)

    def mean(self, box: Sequence[int] | None = None) -> Spectrum:
        """Return the mean spectrum of the image or of a box of pixels, with the image's notes.

        Parameters
        ----------
        box : (x0, y0, x1, y1), optional
            Pixels counted from the upper left of the image; x1 and y1 are excluded.

        Raises
        ------
        SpectrumError
            If the box is not four whole numbers, is empty or exceeds the image.
        """
        image = self if box is None else self.part(box)
        mean = image.values.mean(axis=(0, 1), dtype=np.float64)
        notes = {"spectral quantity": _QUANTITY[self.kind]} | dict(self.notes)
        return Spectrum(self.wavelengths_nm, mean, notes=notes)

    def part(self, box: Sequence[int]) -> SpectralImage:
        """Return the pixels of a box (x0, y0, x1, y1); raises as `mean`."""
        width, height = self.size
        x0, y0, x1, y1 = _corners(box)
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise SpectrumError(
                f"box ({x0}, {y0}, {x1}, {y1}) is not inside the image of {width} x {height} "
                "pixels; give x0 < x1 and y0 < y1 from 0, excluding x1 and y1"
            )
        return replace(self, values=self.values[y0:y1, x0:x1])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an OpenEXR file (``.exr``) of float channels [1], atomically."""
        name = path_text(path)
        require_suffix(name, "spectral images", ".exr", error=SpectrumError)
        units = self.notes.get("emissive units", _DEFAULT_UNITS)
        header = spectral_header(self.kind, units) | {"volspec:notes": json.dumps(dict(self.notes))}
        names = spectral_channels(self.kind, self.wavelengths_nm)
        channels = {channel: self.values[..., k] for k, channel in enumerate(names)}
        write_exr(name, header, channels, SpectrumError)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        kind: Kind | None = None,
        *,
        box: Sequence[int] | None = None,
    ) -> SpectralImage:
        """Read an OpenEXR file in the spectral layout [1], or an ENVI picture by its ``.hdr``.

        Parameters
        ----------
        path : path
            Half or float channels. R, G, B, A and others are ignored; so are polarisation (S1…S3)
            and re-radiation (fluorescence), with a `VolspecWarning`.
        kind : "reflective" or "emissive", optional
            Kind to read; by default reflective if a file has both, in which case the note
            ``also holds`` names the other. ENVI's data units decide, or are taken as asked.
        box : (x0, y0, x1, y1), optional
            Part to read; x1 and y1 are excluded. Of an ENVI picture, no other pixel is read.

        Raises
        ------
        SpectrumError
            If the file cannot be read, or has no spectral channels (of that kind).
        """
        name = path_text(path)
        if kind is not None:
            require_kind(kind, name)
        if Path(name).suffix.lower() == envi.SUFFIX:
            return cls._from_envi(name, kind, box)
        header, pixels, ignored = _read(name)
        kinds: list[Kind] = [k for k in get_args(Kind) if pixels[_LAYER[k]]]
        kind = kind or next(iter(kinds), None)
        if kind is None or kind not in kinds:
            sought, example = ("", "S0 or T") if kind is None else (f"{kind} ", _LAYER[kind])
            raise SpectrumError(
                f"{name}: has no {sought}spectral channels ({example}.550,000000nm and so on; "
                f"Fichet et al. 2021){_only(kinds)}",
                code="missing",
            )
        if kind == "reflective" and "reradiation" in ignored:
            _warn(f"{name}: its fluorescence (T.in.out channels) is ignored")
        if kind == "emissive" and "polarisation" in ignored:
            _warn(f"{name}: its polarisation (channels S1, S2, S3) is ignored")
        notes = _notes(name, header)
        if len(kinds) == 2:
            notes["also holds"] = next(k for k in kinds if k != kind)
        samples = sorted(pixels[_LAYER[kind]], key=lambda sample: sample[0])
        try:
            values = np.stack([image for _, image in samples], axis=-1)
            image = cls(values, np.array([w for w, _ in samples]), kind, notes)
            return image if box is None else image.part(box)
        except SpectrumError as error:
            raise error.within(name) from None
        except ValueError as error:
            raise SpectrumError(f"{name}: {error}", code="damaged") from None

    @classmethod
    def _from_envi(cls, name: str, kind: Kind | None, box: Sequence[int] | None) -> SpectralImage:
        file = envi.EnviFile.open(name)
        values, wavelengths = file.pixels(None if box is None else _corners(box))
        require_nanometres(wavelengths, name)
        try:
            return cls(values, wavelengths, kind or file.kind, file.notes)
        except SpectrumError as error:
            raise error.within(name) from None


def _corners(box: Sequence[int]) -> tuple[int, int, int, int]:
    try:
        x0, y0, x1, y1 = map(operator.index, box)
    except (TypeError, ValueError):
        raise SpectrumError(
            f"box {box!r} is not four whole numbers; give (x0, y0, x1, y1)", code="type"
        ) from None
    return x0, y0, x1, y1


def spectral_channels(kind: Kind, wavelengths_nm: ArrayLike) -> list[str]:
    """Return the layout's channel names.

    >>> spectral_channels("emissive", [400, 547.5])
    ['S0.400,000000nm', 'S0.547,500000nm']
    """
    samples = np.atleast_1d(wavelengths_nm)
    return [f"{_LAYER[kind]}." + f"{w:.6f}nm".replace(".", ",") for w in samples]


def spectral_header(kind: Kind, units: str = _DEFAULT_UNITS) -> dict[str, str]:
    """Return the layout's header attributes; ``units`` is the unit of radiance."""
    header = {"spectralLayoutVersion": "1.0"}
    return header | {"emissiveUnits": units} if kind == "emissive" else header


def require_kind(kind: object, label: str) -> None:
    """Raise SpectrumError unless ``kind`` is a `Kind`."""
    if kind not in get_args(Kind):
        raise SpectrumError(
            f"{label}: kind {kind!r} is unknown; choose reflective or emissive", code="unknown"
        )


def _only(kinds: list[Kind]) -> str:
    use = {"reflective": "a reflectance", "emissive": "a light"}
    return f", only {kinds[0]} ones; use it as {use[kinds[0]]}" if kinds else ""


def _warn(message: str) -> None:
    warnings.warn(message, VolspecWarning, stacklevel=3)


_Samples = dict[str, list[tuple[float, NDArray[np.float32]]]]


def _read(name: str) -> tuple[dict[str, Any], _Samples, set[str]]:
    """Return the header, (nm, pixels) of every channel by layer, and the ignored kinds."""
    header, channels = read_exr(name, SpectrumError)
    pixels: _Samples = {layer: [] for layer in _LAYER.values()}
    ignored: set[str] = set()
    for key, channel in channels.items():
        match = _CHANNEL.fullmatch(key)
        if match and match[1] in pixels:
            wavelength = _nanometres(*match.groups("")[1:])
            pixels[match[1]].append((wavelength, channel.astype(np.float32, copy=False)))
        elif match:
            ignored.add("polarisation")
        elif _RERADIATION.fullmatch(key):
            ignored.add("reradiation")
    return header, pixels, ignored


def _nanometres(number: str, exponent: str, prefix: str, unit: str) -> float:
    value = float(number.replace(",", ".") + exponent) * 10.0 ** _PREFIX[prefix]
    if unit == "Hz":
        value = _SPEED_OF_LIGHT / value if value else np.inf
    # 5,5E-7m is 550 nm: rounding, far below any table's precision, keeps samples on a grid.
    return round(value * 1e9, 6)


def _notes(name: str, header: dict[str, Any]) -> dict[str, str]:
    skip = ("name", "type", "view", "spectralLayoutVersion", "emissiveUnits", "volspec:notes")
    notes = {
        key.lower(): value
        for key, value in header.items()
        if isinstance(value, str) and key not in skip and len(value) <= _MAX_NOTE
    }
    if "emissiveUnits" in header:
        notes["emissive units"] = str(header["emissiveUnits"])
    try:
        extra = parse_json(header.get("volspec:notes", "{}"))
        return notes | {str(key): str(value) for key, value in extra.items()}
    except (ValueError, AttributeError) as error:
        raise SpectrumError(
            f"{name}: volspec:notes cannot be read ({error})", code="damaged"
        ) from None
