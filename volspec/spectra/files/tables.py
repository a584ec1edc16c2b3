"""Read and write text tables of spectra: wavelengths, columns of values, notes in comments.

spectrum -> [tables] -> files, lights, reflectances
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec._files import require_suffix, write_whole
from volspec._parse import parse_xml
from volspec.errors import SpectrumError, nearest, quote
from volspec.spectra.spectrum import Spectrum

# "# Key: value"; sentences and web addresses in comments do not count as notes.
_NOTE = re.compile(r"#+\s*([A-Za-z][\w ()/%-]{0,39}?)\s*[:=]\s*(?!//)(\S.*)")
# A chart of ten thousand samples of 400 bands has 30 MiB.
_MAX_BYTES = 1 << 26
_SEPARATORS = (",", ";", "\t", None)


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """Contents of a text table: wavelengths, K columns of values, notes."""

    path: str
    wavelengths_nm: NDArray[np.float64]
    columns: NDArray[np.float64]  # (L, K)
    names: tuple[str, ...]  # from the header; "1", "2", … if there is none
    lines: tuple[int, ...]  # line of each row in the file, from 1
    notes: dict[str, str] = field(default_factory=dict)
    decimal_commas: bool = False  # commas between columns may be decimal marks

    def spectrum(self, column: str = "") -> Spectrum:
        """Return one column by name (any case) or number from 1; "" if there is only one."""
        k = choose_name(self.path, column, self.names, commas=self.decimal_commas)
        values = self.columns[:, k]
        for array, name in ((self.wavelengths_nm, "wavelength"), (values, "value")):
            if not np.isfinite(array).all():
                row = int(np.argmin(np.isfinite(array)))
                raise SpectrumError(
                    f"{self.path}, line {self.lines[row]}: {name} {array[row]} is not finite; "
                    "leave that line out"
                )
        require_nanometres(self.wavelengths_nm, self.path)
        name = Path(self.path).stem + (f"#{self.names[k]}" if column else "")
        try:
            return Spectrum(self.wavelengths_nm, values, name, self.notes)
        except SpectrumError as error:
            raise error.within(self.path) from None


def read_table(path: str | os.PathLike[str]) -> TextTable:
    """Read a text table (see `read_spectrum`); a SpectrumError names the file and the line."""
    name = path_text(path)
    try:
        text = file_content(name).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SpectrumError(
            f"{name}: cannot be read as text ({error.reason} at byte {error.start}); "
            "save it as UTF-8",
            code="damaged",
        ) from None
    rows: list[list[float]] = []
    lines: list[int] = []
    notes: dict[str, str] = {}
    header = ""
    separator: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("#"):
            keep_note(line, notes)
            continue
        # The first row of numbers determines the separator: headers may contain any.
        candidates = (separator,) if rows else _SEPARATORS
        read = ((_numbers(line, candidate), candidate) for candidate in candidates)
        row, separator = next((pair for pair in read if pair[0]), (None, separator))
        if row is None:
            if header or rows or line[0].isdigit():
                raise _not_numbers(name, number, line)
            header = line
            continue
        if rows and len(row) != len(rows[0]):
            raise SpectrumError(
                f"{name}, line {number}: {len(row)} cells, but {len(rows[0])} in line "
                f"{lines[0]}; use the same number in every row"
                + (separator == ",")
                * ", and write decimal points, not commas",
                code="shape",
            )
        rows.append(row)
        lines.append(number)
    if len(rows) < 2:
        raise SpectrumError(
            f"{name}: {len(rows)} rows of numbers, expected at least 2 (nm,value)", code="missing"
        )
    if len(rows[0]) < 2:
        raise SpectrumError(
            f"{name}, line {lines[0]}: one column, expected nm,value", code="missing"
        )
    titles = _cells(header, separator)[1:]
    unnamed = len(titles) != len(rows[0]) - 1
    if unnamed:
        titles = [str(k) for k in range(1, len(rows[0]))]
    table = np.array(rows)
    w, columns = table[:, 0], table[:, 1:]
    suspect = unnamed and separator == "," and bool((columns == np.floor(columns)).all())
    return TextTable(name, w, columns, tuple(titles), tuple(lines), notes, suspect)


def choose_name(
    path: str,
    selector: str,
    names: Sequence[str],
    ids: Sequence[str] = (),
    *,
    noun: str = "column",
    commas: bool = False,
) -> int:
    """Return the index of a file's column or sample by name (any case), id or number from 1.

    ``selector`` may be empty if there is only one. ``commas`` hints at decimal commas, which make
    columns of values.
    """
    if not selector and len(names) == 1:
        return 0
    listed = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    if not selector:
        raise SpectrumError(
            f"{path}: {len(names)} {noun}s{' of values' * (noun == 'column')} ({listed}); "
            f"choose one: {Path(path).name}#{names[0]}"
            + commas
            * "; or are the commas decimal marks? write points",
            code="missing",
        )
    folded = fold_name(selector)
    for labels in (names, ids):
        matches = [k for k, name in enumerate(labels) if fold_name(name) == folded]
        if len(matches) > 1:
            raise SpectrumError(
                f"{path}: {len(matches)} {noun}s are named {selector!r}; choose one by number: "
                f"{' or '.join(f'#{k + 1}' for k in matches[:4])}",
                code="duplicate",
            )
        if matches:
            return matches[0]
    if selector.isdecimal() and 1 <= int(selector) <= len(names):
        return int(selector) - 1
    raise SpectrumError(
        f"{path}: no {noun} {selector!r}; {nearest(selector, names)}"
        f"choose from {listed}, or a number from 1 to {len(names)}",
        code="unknown",
    )


def file_content(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a file; raise SpectrumError if it cannot be read or is too large."""
    require_inside(path_text(path), SpectrumError)
    try:
        size = Path(path_text(path)).stat().st_size
        if size > _MAX_BYTES:
            raise SpectrumError(
                f"{path}: has {size / 2**20:.0f} MiB, more than any measured spectra; give a file "
                f"of up to {_MAX_BYTES >> 20} MiB",
                code="size",
                given=size,
            )
        return Path(path_text(path)).read_bytes()
    except FileNotFoundError:
        raise SpectrumError(f"{path}: no such file; check the path", code="not-found") from None
    except OSError as error:
        raise SpectrumError(
            f"{path}: cannot be read: {error.strerror}; check the path and its permissions",
            code="damaged",
        ) from None


def positive_number(where: str, label: str, text: str) -> float:
    """Parse a number above 0; raise SpectrumError, which says where and what it is."""
    try:
        value = read_number(text)
    except ValueError:
        value = np.nan
    if not 0 < value < np.inf:
        raise SpectrumError(
            f"{where}: {label} is {quote(text)}, expected a number above 0; correct it",
            code="syntax",
            field=label,
            given=text,
        )
    return value


def xml_root(path: str) -> Element:
    """Return the root of an XML file; raise SpectrumError if it cannot be read or is damaged."""
    try:
        return parse_xml(file_content(path))
    except ValueError as error:
        if isinstance(error, SpectrumError):
            raise
        raise SpectrumError(
            f"{path}: damaged XML ({error}); export the file again", code="damaged"
        ) from None


def decoded_text(path: str) -> str:
    """Return a file's text: UTF-8, or else Latin-1, as older instruments write it."""
    content = file_content(path)
    if content[:2] in (b"\xff\xfe", b"\xfe\xff") or 0 in content:
        raise SpectrumError(
            f"{path}: is not UTF-8 or Latin-1 text; export it again as text", code="damaged"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def read_number(text: str) -> float:
    """Parse a number; raise ValueError if it is not one, or has Python's underscores."""
    if "_" in text:
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def require_nanometres(wavelengths: NDArray[np.float64], label: str) -> None:
    """Raise SpectrumError for wavelengths far from the visible in nm, guessing their unit."""
    low, high = float(wavelengths.min()), float(wavelengths.max())
    if 0 < high < 1e-4:
        guess = "are they metres? multiply by 1e9"
    elif 1.2 < low < high < 7:
        guess = "are they electronvolts? nm = 1239.84 / eV, then sort"
    elif 0 < high < 20:
        guess = "are they micrometres? multiply by 1000"
    elif low > 2000 and high <= 12_000:
        guess = "are they Ångström? divide by 10"
    elif low > 2000:
        guess = "are they wavenumbers in 1/cm? nm = 1e7 / wavenumber, then sort"
    else:
        return
    raise SpectrumError(f"{label}: wavelengths of {low:g}-{high:g} nm are not visible; {guess}")


def keep_note(line: str, notes: dict[str, str]) -> None:
    """Add a comment's note, ``# name: text``, to those of a file; names in lower case."""
    # Spreadsheets pad comments with separators, too.
    if note := _NOTE.match(line.rstrip(",;\t ")):
        key = " ".join(note[1].replace("_", " ").split()).lower()
        notes[key] = f"{notes[key]}; {note[2]}" if key in notes else note[2]


def _cells(line: str, separator: str | None) -> list[str]:
    cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
    cells = [cell.strip() for cell in cells]
    # Spreadsheets end every row of a narrow table in separators.
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _numbers(line: str, separator: str | None) -> list[float] | None:
    if separator and separator not in line:
        return None
    try:
        return [read_number(cell) for cell in _cells(line, separator)] or None
    except (ValueError, csv.Error):
        return None


def _not_numbers(path: str, number: int, line: str) -> SpectrumError:
    if re.search(r"\d,\d", line) and re.search(r"[;\t ]", line):
        remedy = "write decimal points, not commas"
    else:
        remedy = "put # before lines that are not data"
    return SpectrumError(
        f"{path}, line {number}: {line[:40]!r} is not a row of numbers (nm,value); {remedy}",
        code="syntax",
    )


TABLE_SUFFIXES = (".csv", ".spd")
"""Formats of `write_spectrum`."""
# Names of notes that the reader accepts.
_KEY = re.compile(r"[a-z][\w ()/%-]{0,39}")


def write_spectrum(spectrum: Spectrum, path: str | os.PathLike[str]) -> None:
    """Write one spectrum as rows of nm and values, atomically.

    Parameters
    ----------
    spectrum : Spectrum
        Its notes become ``# key: value`` lines, which `read_spectrum` restores.
    path : path
        File name that ends in ``.csv``, or in ``.spd`` for renderers such as PBRT and Mitsuba.

    Raises
    ------
    SpectrumError, InputError
        If the name has another suffix, or the folder is not writable.
    """
    name = path_text(path)
    target = require_suffix(name, "spectra", *TABLE_SUFFIXES, error=SpectrumError)
    with write_whole(name) as temporary:
        temporary.write_text(spectrum_text(spectrum, target.suffix.lower()), encoding="utf-8")


def spectrum_text(spectrum: Spectrum, suffix: str) -> str:
    """Return the content of a file of one of `TABLE_SUFFIXES`."""
    # Renderers read blanks between the numbers, and no line with titles.
    title, separator = ("", " ") if suffix == ".spd" else ("nm,value", ",")
    lines = [
        f"# {key}: {' '.join(value.split())}"
        for key, value in spectrum.notes.items()
        if _KEY.fullmatch(key) and value.strip()
    ]
    lines += [title] * bool(title)
    lines += [
        f"{w:.10g}{separator}{v:.10g}"
        for w, v in zip(spectrum.wavelengths_nm.tolist(), spectrum.values.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def path_text(path: str | os.PathLike[str], label: str = "path") -> str:
    """Return a path as text; raise SpectrumError if it contains a NUL."""
    text = os.fspath(path)
    if "\0" in text:
        raise SpectrumError(f"{label} {text!r} contains a NUL character; remove it", code="syntax")
    return text


def fold_name(name: str) -> str:
    """Return a name for comparison: single blanks, no case."""
    return " ".join(name.split()).casefold()
