"""CGATS.17 text: measured charts and lamps, with a spectrum in each row of a table [1].

    samples -> [cgats] -> files

Argyll's ``.ti3`` and ``.sp`` are tables of the same syntax; their fields ``SPEC_400`` round the
wavelengths, which SPECTRAL_START_NM, SPECTRAL_END_NM and SPECTRAL_BANDS give exactly [2].

References
----------
[1] ANSI CGATS.17 (2009), "Exchange format for colour and process control data using XML or ASCII
    text"; the same keywords are in ISO 28178.
[2] Gill, "Argyll CMS documentation: File formats". https://argyllcms.com/doc/File_Formats.html
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError, quote
from volspec.spectra.files.samples import QUANTITY, Sample, SampleSet, fits
from volspec.spectra.files.tables import decoded_text, positive_number, read_number

# Names of fields with a wavelength, of which programs write many.
_BAND = re.compile(
    r"(?:SPECTRAL|SPECT|SPEC|NM|PCT|DEC|R|REFL)(?:_?(?:NM|PCT|DEC))?_?(\d{3,4}(?:\.\d+)?)(?:_?NM)?"
    r"|(\d{3,4}(?:\.\d+)?)_?NM",
    re.IGNORECASE,
)
_CGATS = re.compile(r"\A\s*CGATS\b|^\s*BEGIN_DATA(_FORMAT)?\s*$", re.IGNORECASE | re.MULTILINE)
# Keywords that describe the table, not what was measured.
_STRUCTURE = re.compile(r"KEYWORD|NUMBER_OF_\w+|LGOROWLENGTH|SPECTRAL_\w+|(BEGIN|END)_DATA\w*")
_TOKEN = re.compile(r'"([^"]*)"|([^\s"]+)')
_FIELD = re.compile(r"[^\s,;\"]+")
_MAX_NOTE = 200
# Argyll rounds the wavelengths in names of fields to whole nm.
_ROUNDING_NM = 1.0
_QUANTITIES = {
    "REFLECTIVE": "reflectance",
    "TRANSMISSIVE": "transmittance",
    "EMISSION": "radiance",
    "EMISSION_FLASH": "radiance",
    "AMBIENT": "irradiance",
    "AMBIENT_FLASH": "irradiance",
    "DISPLAY": "radiance",
    "EMISINPUT": "radiance",
}
"""Spectral quantity by Argyll's MEAS_TYPE and DEVICE_CLASS."""


@dataclass
class _Table:
    """One table of a file: keywords, names of fields, and lines of data."""

    start: str
    keywords: dict[str, str] = field(default_factory=dict)
    fields: list[str] = field(default_factory=list)
    lines: list[tuple[int, str]] = field(default_factory=list)
    """END_DATA was found."""


def is_cgats(text: str) -> bool:
    """Return True if a text begins with CGATS, or has one of the format's tables.

    >>> is_cgats("CGATS.17"), is_cgats("nm,value")
    (True, False)
    """
    return _CGATS.search(text) is not None


def read_cgats(path: str) -> SampleSet:
    """Read the spectra of the first table that has any.

    Values are divided by SPECTRAL_NORM, the value of 100 %, or by that of the fields' names.
    Raises SpectrumError if the file cannot be read, has no spectra or is cut off.
    """
    tables = list(_tables(path, decoded_text(path)))
    spectral = [(table, bands) for table in tables if (bands := _bands(path, table))]
    if not spectral:
        fields = next((table.fields for table in tables if table.fields), [])
        raise SpectrumError(
            f"{path}: has no spectra, expected fields such as SPECTRAL_NM400 or SPEC_400"
            + (f", got {quote(', '.join(fields[:12]), 120)}" if fields else "")
            + "; export it with spectral values",
            code="missing",
        )
    table, bands = spectral[0]
    return SampleSet(path, "sample", tuple(_samples(path, table, bands)))


def _tables(path: str, text: str) -> Iterator[_Table]:
    table, part = _Table(""), ""
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip(" \f")
        tokens = _tokens(line)
        word = tokens[0].upper() if tokens else ""
        if not word or line.startswith("#"):
            continue
        if word == "END_DATA":
            yield table
            table, part = _Table(""), ""
        elif word in ("BEGIN_DATA", "BEGIN_DATA_FORMAT"):
            part = word
        elif word == "END_DATA_FORMAT":
            part = ""
        elif part == "BEGIN_DATA_FORMAT":
            table.fields += _FIELD.findall(line)
        elif part == "BEGIN_DATA":
            table.lines.append((number, line))
        elif not (table.start or table.keywords):
            table.start = word
        elif len(tokens) > 1 and (word != "KEYWORD"):
            table.keywords.setdefault(word, " ".join(tokens[1:]))
    if table.fields or table.lines:
        yield table


def _tokens(line: str) -> list[str]:
    return [quote or bare for quote, bare in _TOKEN.findall(line)]


_Bands = list[tuple[int, float, float]]
"""(column of the value, nm, value of 100 % or 0 if unknown) of each band; nm is NaN if the column
before has it."""


def _bands(path: str, table: _Table) -> _Bands:
    """Return the columns with spectral values; none if the table has no spectra."""
    names = [name.upper() for name in table.fields]
    if "SPECTRAL_NM" in names:
        pairs = zip(range(1, len(names)), names, names[1:], strict=False)
        return [(k, np.nan, _full(value)) for k, nm, value in pairs if nm == "SPECTRAL_NM"]
    matches = [(k, match) for k, name in enumerate(names) if (match := _BAND.fullmatch(name))]
    bands = [(k, float(match[1] or match[2]), _full(names[k])) for k, match in matches]
    count, low, high = (
        _keyword_number(path, table, f"SPECTRAL_{key}") for key in ("BANDS", "START_NM", "END_NM")
    )
    if count != len(bands) or low is None or high is None:
        return bands
    exact = np.linspace(low, high, len(bands)).tolist()
    off = [abs(nm - expected) for (_, nm, _), expected in zip(bands, exact, strict=True)]
    if off and max(off) > _ROUNDING_NM:
        k = off.index(max(off))
        raise SpectrumError(
            f"{path}: field {table.fields[bands[k][0]]} is at {exact[k]:g} nm by SPECTRAL_START_NM "
            f"{low:g} and SPECTRAL_END_NM {high:g}; correct one of them",
            code="conflict",
        )
    return [(k, nm, full) for (k, _, full), nm in zip(bands, exact, strict=True)]


def _full(name: str) -> float:
    """Return the value of 100 % by a field's name; 0 if it does not say."""
    return 100.0 if "PCT" in name else 1.0 if "DEC" in name else 0.0


def _keyword_number(path: str, table: _Table, keyword: str) -> float | None:
    if keyword not in table.keywords:
        return None
    return positive_number(path, keyword, table.keywords[keyword])


def _samples(path: str, table: _Table, bands: _Bands) -> Iterator[Sample]:
    rows = _rows(path, table)
    notes = _notes(table)
    norm = _keyword_number(path, table, "SPECTRAL_NORM")
    if norm is None and table.start == "CTI3" and fits(notes.get(QUANTITY, ""), "reflective"):
        norm = 100.0  # Argyll's, in files that do not state it
    titles = [name.upper().replace("_", "") for name in table.fields]
    columns = [k for k, _, _ in bands]
    wavelengths = np.array([nm for _, nm, _ in bands])
    full = np.array([norm or scale or 1.0 for _, _, scale in bands])
    for index, (number, row) in enumerate(rows, start=1):
        if np.isnan(wavelengths[0]):
            row_nm = _numbers(path, number, row, table.fields, [k - 1 for k in columns])
        else:
            row_nm = wavelengths
        values = _numbers(path, number, row, table.fields, columns) / full
        order = np.argsort(row_nm, kind="stable")
        label, name = (
            row[titles.index(key)] if key in titles else "" for key in ("SAMPLEID", "SAMPLENAME")
        )
        yield Sample(name or label or str(index), row_nm[order], values[order], label, notes)


def _rows(path: str, table: _Table) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of every set; a set may also fill several lines."""
    n = len(table.fields)
    rows = [(number, _cells(line, n)) for number, line in table.lines]
    odd = next((row for row in rows if len(row[1]) != n), None)
    if odd is not None:
        stream = [(number, token) for number, line in table.lines for token in _tokens(line)]
        # Where a row is whole, one that differs would shift all that follow.
        if len(stream) % n or any(len(cells) >= n for _, cells in rows):
            raise SpectrumError(
                f"{path}, line {odd[0]}: {len(odd[1])} cells, but {n} fields; complete the line, "
                "put names with blanks in quotes, and write decimal points, not commas",
                code="shape",
            )
        rows = [
            (stream[k][0], [token for _, token in stream[k : k + n]])
            for k in range(0, len(stream), n)
        ]
    expected = _keyword_number(path, table, "NUMBER_OF_SETS")
    if not rows or (expected is not None and len(rows) < expected):
        raise SpectrumError(
            f"{path}: has {len(rows)} sets of data"
            + (f", but NUMBER_OF_SETS is {expected:g}" if expected is not None else "")
            + "; it is cut off, export it again",
            code="damaged",
        )
    return rows


def _cells(line: str, count: int) -> list[str]:
    """Split a line at tabs, blanks or commas, whichever gives as many cells as fields."""
    split = [_tokens(line)]
    for separator in ("\t", ",", ";"):
        if separator in line:
            with suppress(csv.Error):
                cells = next(csv.reader([line], delimiter=separator))
                while len(cells) > count and not cells[-1].strip():
                    cells.pop()
                split.append([cell.strip() for cell in cells])
    return next((cells for cells in split if len(cells) == count), split[0])


def _numbers(
    path: str, number: int, row: list[str], fields: list[str], columns: list[int]
) -> NDArray[np.float64]:
    values = np.empty(len(columns))
    for index, k in enumerate(columns):
        try:
            values[index] = read_number(row[k])
        except ValueError:
            remedy = "write decimal points" if "," in row[k] else "measure it again"
            raise SpectrumError(
                f"{path}, line {number}: {fields[k]} is {quote(row[k])}, expected a number; "
                f"{remedy}",
                code="syntax",
                field=fields[k],
                given=row[k],
            ) from None
    return values


def _notes(table: _Table) -> dict[str, str]:
    notes = {
        key.replace("_", " ").lower(): value
        for key, value in table.keywords.items()
        if not _STRUCTURE.fullmatch(key) and 0 < len(value) <= _MAX_NOTE
    }
    kinds = (table.keywords.get(key, "").upper() for key in ("MEAS_TYPE", "DEVICE_CLASS"))
    if quantity := next((_QUANTITIES[kind] for kind in kinds if kind in _QUANTITIES), ""):
        notes[QUANTITY] = quantity
    elif any("PCT" in name.upper() for name in table.fields):
        notes[QUANTITY] = "reflectance"
    return notes
