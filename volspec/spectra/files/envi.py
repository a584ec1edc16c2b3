"""ENVI hyperspectral pictures and spectral libraries: a text header, and a file of plain numbers.

    samples, tables -> [envi] -> spectral_image, files

References
----------
[1] NV5 Geospatial, "ENVI Header Files" and "ENVI Spectral Library Files".
    https://www.nv5geospatialsoftware.com/docs/enviheaderfiles.html
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec.errors import Code, SpectrumError, quote
from volspec.spectra.files.samples import QUANTITY, Sample, SampleSet
from volspec.spectra.files.tables import decoded_text, path_text, read_number
from volspec.spectra.spectrum import Kind

SUFFIX = ".hdr"
LIBRARY = "envi spectral library"
# Sides are (lines, samples, bands); each interleave stores them in another order.
_ORDERS = {"bsq": (2, 0, 1), "bil": (0, 2, 1), "bip": (0, 1, 2)}
_CODES = (1, 2, 3, 4, 5, 12, 13, 14, 15)  # the others are complex
_TYPES = dict(zip(_CODES, ["u1", "i2", "i4", "f4", "f8", "u2", "u4", "i8", "u8"], strict=True))
_BYTE_ORDERS = {0: "<", 1: ">"}
_UNITS = {
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), 1.0),
    **dict.fromkeys(("um", "µm", "micron", "microns"), 1e3),
    **dict.fromkeys(("micrometer", "micrometers", "micrometre", "micrometres"), 1e3),
}
"""Length of a unit of wavelength, nm."""
# In the visible, larger numbers are nm and smaller ones µm, where a header does not say.
_MAX_MICROMETRES = 20.0
# Names of the file of numbers: the header's without .hdr, with one of these.
_DATA = ("", ".img", ".dat", ".raw", ".bin", ".bsq", ".bil", ".bip", ".sli", ".hyspex")
_MAX_BYTES = 1 << 32
"""Largest picture in memory, as float32."""
_NOTES = ("description", "sensor type", "acquisition time", "data units", "interleave")
_MAX_NOTE = 200
_ENTRY = re.compile(r"^[ \t]*([^=;\n{}]+?)[ \t]*=[ \t]*(\{[^}]*\}|[^\n{]*)", re.MULTILINE)

Box = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class EnviFile:
    """A header, and where its numbers are.

    Attributes
    ----------
    path : str
        The header's file.
    fields : dict of str to str
        Values by key in lower case; lists without their braces.
    """

    path: str
    fields: dict[str, str]

    @classmethod
    def open(cls, path: str) -> EnviFile:
        """Read a header; raise SpectrumError if it is not ENVI's."""
        name = path_text(path)
        text = decoded_text(name).lstrip()
        if text[:4].upper() != "ENVI":
            is_picture = text.startswith(("#?RADIANCE", "#?RGBE"))
            raise SpectrumError(
                f"{name}: "
                + ("is a Radiance picture of colours" if is_picture else "does not begin with ENVI")
                + "; give the header of a hyperspectral picture",
                code="unsupported",
            )
        fields = {
            " ".join(key.lower().split()): value.strip().strip("{}").strip()
            for key, value in _ENTRY.findall(text.replace("\r\n", "\n"))
        }
        return cls(name, fields)

    @property
    def is_library(self) -> bool:
        """True for a spectral library, False for a picture."""
        return " ".join(self.fields.get("file type", "").lower().split()) == LIBRARY

    @property
    def kind(self) -> Kind:
        """Use that the header suggests: radiance is emissive, all else reflective."""
        return (
            "emissive" if "radiance" in self.fields.get("data units", "").lower() else "reflective"
        )

    @property
    def notes(self) -> dict[str, str]:
        """Descriptions in the header."""
        entries = ((key, " ".join(self.fields.get(key, "").split())) for key in _NOTES)
        return {key: text for key, text in entries if 0 < len(text) <= _MAX_NOTE}

    def pixels(self, box: Box | None = None) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return the values (H, W, N) of a box (x0, y0, x1, y1), or of all, and wavelengths in nm.

        Bad bands (``bbl``) are left out, and values divided by ``reflectance scale factor``.
        Raises SpectrumError if the header contradicts itself or its data, or a pixel has no data.
        """
        if self.is_library:
            raise SpectrumError(
                f"{self.path}: is a spectral library, not a picture; choose a spectrum of it: "
                f"{Path(self.path).name}#name",
                code="type",
            )
        lines, samples, bands = (self._integer(key, 1) for key in ("lines", "samples", "bands"))
        wavelengths, order = self._wavelengths(bands)
        x0, y0, x1, y1 = box or (0, 0, samples, lines)
        if not (0 <= x0 < x1 <= samples and 0 <= y0 < y1 <= lines):
            raise SpectrumError(
                f"{self.path}: box ({x0}, {y0}, {x1}, {y1}) is not inside the image of {samples} x "
                f"{lines} pixels; give x0 < x1 and y0 < y1 from 0, excluding x1 and y1"
            )
        needed = 4 * (x1 - x0) * (y1 - y0) * len(order)
        if needed > _MAX_BYTES:
            raise SpectrumError(
                f"{self.path}: {x1 - x0} x {y1 - y0} pixels of {len(order)} bands need "
                f"{needed / 2**30:.1f} GiB; give a part, {Path(self.path).name}#X0,Y0,X1,Y1",
                code="size",
                given=needed,
            )
        stored = self._numbers((lines, samples, bands))
        part = stored[y0:y1, x0:x1]
        values = np.empty((*part.shape[:2], len(order)), np.float32)
        ignored = self._number("data ignore value")
        scale = self._number("reflectance scale factor") or 1.0
        with np.errstate(over="ignore", invalid="ignore"):
            for index, band in enumerate(order):
                one = part[..., band]
                if ignored is not None and (empty := one == ignored).any():
                    y, x = np.argwhere(empty)[0]
                    raise SpectrumError(
                        f"{self.path}: pixel ({x0 + x}, {y0 + y}) has no data ({ignored:g}) at "
                        f"{wavelengths[index]:g} nm; give a part without such pixels, "
                        f"{Path(self.path).name}#X0,Y0,X1,Y1",
                        code="missing",
                    )
                values[..., index] = one / scale
        return values, wavelengths

    def library(self) -> SampleSet:
        """Return the spectra of a library: one in each line, as many samples as wavelengths.

        Raises SpectrumError as `pixels`.
        """
        count, size = self._integer("lines", 1), self._integer("samples", 1)
        wavelengths, order = self._wavelengths(size)
        names = self._list("spectra names") or [str(k + 1) for k in range(count)]
        if len(names) != count:
            raise SpectrumError(
                f"{self.path}: {len(names)} spectra names, but {count} lines; correct one of them",
                code="shape",
                field="spectra names",
            )
        stored = self._numbers((count, size, 1))[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):
            scale = self._number("reflectance scale factor")
            values = stored[:, order].astype(np.float64) / (scale or 1.0)
        notes = self.notes
        if scale is not None:
            notes[QUANTITY] = "reflectance"
        return SampleSet(
            self.path,
            "spectrum",
            tuple(
                Sample(name, wavelengths, row, notes=notes)
                for name, row in zip(names, values, strict=True)
            ),
        )

    def _numbers(self, sides: Sequence[int]) -> NDArray[Any]:
        """Return the file's numbers as (lines, samples, bands), mapped and not read."""
        dtype, order = self._dtype(), _ORDERS[self._interleave()]
        offset = self._integer("header offset", 0, 0)
        if self._integer("file compression", 0, 0):
            raise SpectrumError(
                f"{self.path}: its data are compressed; export it without compression",
                code="unsupported",
            )
        data, needed = self._data(), offset + math.prod(sides) * dtype.itemsize
        size = data.stat().st_size
        if size < needed:
            raise SpectrumError(
                f"{data}: has {size} bytes, but {' x '.join(map(str, sides))} (lines, samples, "
                f"bands) of {dtype.itemsize} bytes need {needed}; correct {Path(self.path).name}, "
                "or copy the data again",
                code="damaged",
                given=size,
            )
        shape = tuple(sides[axis] for axis in order)
        try:
            mapped = np.memmap(data, dtype, "r", offset, shape)
        except OSError as error:
            raise SpectrumError(
                f"{data}: cannot be read: {error.strerror or error}; check its permissions",
                code="damaged",
            ) from None
        return np.asarray(mapped).transpose(np.argsort(order))

    def _data(self) -> Path:
        """Return the file with the numbers."""
        base = Path(self.path).with_suffix("")
        tried = [base.with_name(base.name + suffix) for suffix in _DATA]
        tried += [base.with_name(base.name + suffix.upper()) for suffix in _DATA[1:]]
        if file := next((path for path in tried if path.is_file()), None):
            require_inside(file, SpectrumError)
            return file
        raise SpectrumError(
            f"{self.path}: there is no file {base.name}, {base.name}.img, .dat, .raw, .bin, .bsq, "
            ".bil, .bip or .sli with its data; put it next to the header",
            code="not-found",
        )

    def _dtype(self) -> np.dtype[np.generic]:
        code = self._integer("data type", 0)
        if code not in _TYPES:
            listed = ", ".join(f"{key} ({np.dtype(kind)})" for key, kind in _TYPES.items())
            raise self._refused("data type", f"convert it to one of {listed}", "unsupported")
        order = self._integer("byte order", 0, 0)
        if order not in _BYTE_ORDERS:
            raise self._refused("byte order", "give 0 (least byte first) or 1", "unknown")
        return np.dtype(_BYTE_ORDERS[order] + _TYPES[code])

    def _interleave(self) -> str:
        interleave = self.fields.get("interleave", "bsq").lower()
        if interleave not in _ORDERS:
            raise self._refused("interleave", f"give {', '.join(_ORDERS)}", "unknown")
        return interleave

    def _wavelengths(self, bands: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return the sorted wavelengths of good bands, nm, and their indices."""
        texts = self._list("wavelength")
        if not texts:
            raise SpectrumError(
                f"{self.path}: has no wavelength list; give wavelength = {{ … }} in nm, one of "
                "each band",
                code="missing",
                field="wavelength",
            )
        good = self._list("bbl") or ["1"] * bands
        for key, listed in (("wavelength", texts), ("bbl", good)):
            if len(listed) != bands:
                raise SpectrumError(
                    f"{self.path}: {key} has {len(listed)} values, but there are {bands} bands; "
                    "correct one of them",
                    code="shape",
                    field=key,
                )
        wavelengths = np.array([self._parsed("wavelength", text) for text in texts])
        keep = np.array([self._parsed("bbl", text) > 0 for text in good])
        unit = self.fields.get("wavelength units", "unknown").lower()
        if unit in ("", "unknown"):
            scale = 1e3 if wavelengths.max() < _MAX_MICROMETRES else 1.0
        elif unit in _UNITS:
            scale = _UNITS[unit]
        else:
            raise self._refused("wavelength units", "give nanometers or micrometers", "unsupported")
        order = np.argsort(wavelengths, kind="stable")
        order = order[keep[order]]
        # 0.55 µm is 550 nm: rounding, far below any instrument's precision.
        with np.errstate(over="ignore"):
            return np.round(wavelengths[order] * scale, 6), order

    def _list(self, key: str) -> list[str]:
        text = self.fields.get(key, "")
        return [" ".join(entry.split()) for entry in text.split(",")] if text else []

    def _integer(self, key: str, minimum: int, default: int | None = None) -> int:
        text = self.fields.get(key)
        if text is None and default is not None:
            return default
        if text is None:
            raise SpectrumError(
                f"{self.path}: has no {key!r}; export the header again", code="missing", field=key
            )
        if not re.fullmatch(r"\d{1,15}", text) or int(text) < minimum:
            raise self._refused(key, f"give a whole number from {minimum}", "syntax")
        return int(text)

    def _number(self, key: str) -> float | None:
        if not (text := self.fields.get(key)):
            return None
        value = self._parsed(key, text)
        if key == "reflectance scale factor" and not 0 < value < np.inf:
            raise self._refused(key, "give a number above 0", "range")
        return value

    def _parsed(self, key: str, text: str) -> float:
        try:
            return read_number(text)
        except ValueError:
            raise SpectrumError(
                f"{self.path}: {key} has {quote(text)}, expected a number; correct it",
                code="syntax",
                field=key,
                given=text,
            ) from None

    def _refused(self, key: str, remedy: str, code: Code) -> SpectrumError:
        text = self.fields[key]
        return SpectrumError(
            f"{self.path}: {key} is {quote(text)}; {remedy}", code=code, field=key, given=text
        )
