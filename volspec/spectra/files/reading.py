"""Measured spectra from files: text tables, CGATS, CxF, IES TM-27, spectral images, palettes.

    tables, cgats, cxf, spectral_image, palettes, photometry -> [files] -> lights, reflectances

References
----------
[1] Illuminating Engineering Society (2014), "IES Standard Format for the Electronic Transfer
    of Spectral Data", TM-27-14.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError, VolspecWarning, one_line
from volspec.spectra.datasets import colour_science
from volspec.spectra.files.cgats import is_cgats, read_cgats
from volspec.spectra.files.cxf import read_cxf
from volspec.spectra.files.envi import EnviFile
from volspec.spectra.files.palettes import SUFFIX as PALETTE
from volspec.spectra.files.palettes import named_spectrum, palette_spectrum
from volspec.spectra.files.samples import QUANTITY, SampleSet, fits
from volspec.spectra.files.spectral_image import SpectralImage, require_kind
from volspec.spectra.files.tables import (
    TextTable,
    decoded_text,
    path_text,
    read_number,
    read_table,
    require_nanometres,
    xml_root,
)
from volspec.spectra.grid import DEFAULT_GRID, PAPERS_GRID, SpectralGrid
from volspec.spectra.spectrum import Kind, Spectrum, extended_band_means

Address = str | os.PathLike[str]
FILE_FORMS = (
    "FILE.csv, FILE.csv#column, FILE.spd, FILE.spdx, FILE.ti3#sample, FILE.cxf#object, FILE.exr, "
    "FILE.hdr#X,Y, PALETTE.toml#name"
)
"""Address forms of `read_spectrum`, for messages."""

# A gap at the end of a table that needs no warning: rounding of frequencies.
_NOTHING_NM = 1e-3
_CGATS = (".cgats", ".cie", ".ti3", ".sp")
_ROLE = {"emissive": "light", "reflective": "reflectance"}


def read_spectrum(path: Address, *, kind: Kind | None = None) -> Spectrum:
    """Read one measured spectrum; the file's metadata become the spectrum's notes.

    Parameters
    ----------
    path : path
        The suffix determines the format:

        - ``.csv``, ``.txt``, ``.tsv``, ``.spd``, ``.ssp`` (PBRT, Mitsuba): rows of nm and values,
          separated by commas, semicolons, tabs or blanks, after at most one header line.
          ``# key: value`` lines are notes, other lines with ``#`` comments. With several columns
          of values, ``FILE.csv#column`` selects one by its name in the header, or by number: 1 is
          the first after the wavelengths.
        - ``.cgats``, ``.cie``, ``.ti3``, ``.sp`` (Argyll), or a ``.txt`` of this syntax: CGATS.17.
          ``FILE.ti3#sample`` selects by SAMPLE_NAME, SAMPLE_ID or number. Values are divided by
          SPECTRAL_NORM, and percentages of reflectance by 100.
        - ``.cxf``: CxF3 (ISO 17972-1); ``FILE.cxf#object`` selects by name, Id or number; of an
          object with several spectra, ``FILE.cxf#object/specification``.
        - ``.spdx``, ``.xml``: IES TM-27-14 [1]; its fields become notes, such as
          ``manufacturer``, ``measurement equipment`` and ``bandwidth fwhm`` (nm).
        - ``.exr``: a `SpectralImage`; ``FILE.exr`` is its mean, ``FILE.exr#X,Y`` one pixel,
          ``FILE.exr#X0,Y0,X1,Y1`` the mean of a box, excluding X1 and Y1.
        - ``.hdr``: an ENVI picture, with the same parts, or an ENVI spectral library, of which
          ``FILE.hdr#name`` selects one.
        - ``.toml``: a palette that ``volspec design`` wrote; ``PALETTE.toml#name`` selects the
          values of a light or reflectance by name, or by number from 1.
    kind : "emissive" or "reflective", optional
        The use of the spectrum, as a light or a reflectance. A file that declares the other kind,
        in TM-27's SpectralQuantity or the note ``spectral quantity``, is refused; from an image
        with both kinds, this one is read.

    Returns
    -------
    Spectrum
        Stored values: nm and the file's own units.

    Raises
    ------
    SpectrumError
        If the file cannot be used; names the file, the faulty line, field or channel, and a remedy.
    """
    if kind is not None:
        require_kind(kind, path_text(path))
    address = split_address(path)
    if address is None and Path(os.fspath(path)).suffix.lower() in (".ies", ".ldt"):
        raise SpectrumError(
            f"{os.fspath(path)}: holds where a luminaire sends its light, but no spectrum; give it "
            "as the beam of a room's lamp, next to a spectrum such as LED-B3",
            code="unsupported",
        )
    if address is None:
        raise SpectrumError(
            f"{os.fspath(path)}: the suffix is not a known format; use .csv, .txt, .tsv, .spd "
            "(text), .ti3, .cgats, .cie, .sp (CGATS), .cxf (CxF3), .spdx, .xml (IES TM-27), .exr, "
            ".hdr (spectral images) or .toml (palette)",
            code="unsupported",
        )
    file, selector = address
    spectrum = _READERS[Path(file).suffix.lower()](file, selector, kind)
    quantity = spectrum.notes.get(QUANTITY, "")
    if kind and not fits(quantity, kind):
        raise SpectrumError(
            f"{os.fspath(path)}: its spectral quantity is {quantity!r}, which is not a "
            f"{_ROLE[kind]}; give another file, or correct that field if it is wrong",
            code="type",
        )
    return spectrum


def read_columns(path: Address, *, kind: Kind | None = None) -> TextTable | SampleSet:
    """Read all spectra of a file that holds many: a text table, CGATS or CxF.

    Raises SpectrumError as `read_spectrum`.
    """
    name = path_text(path)
    suffix = Path(name).suffix.lower()
    if suffix == ".cxf":
        return read_cxf(name).for_kind(kind)
    if suffix in _CGATS or (suffix == ".txt" and is_cgats(decoded_text(name))):
        return read_cgats(name).for_kind(kind)
    return read_table(name)


def split_address(text: Address) -> tuple[str, str] | None:
    """Split ``FILE#selector`` into (FILE, selector or ""); None if no file is named."""
    match = _ADDRESS.fullmatch(path_text(text))
    return (match[1], (match[2] or "").strip()) if match else None


def named_in_palette(
    address: tuple[str, str], role: str, folder: Address
) -> tuple[str, str] | None:
    """Return the name to which a palette's address refers, such as ``D65``, and its base folder.

    ``folder`` is the base of a relative address. None if the palette has the values itself, or the
    file is not a palette.
    """
    path = Path(path_text(folder), address[0])
    if path.suffix.lower() != PALETTE:
        return None
    target = named_spectrum(os.fspath(path), address[1], role)
    return None if target is None else (target, os.fspath(path.parent))


def palette_grid(address: str, role: str, folder: Address) -> SpectralGrid | None:
    """Return the grid of a palette's values, such as designed ones.

    ``folder`` is the base of a relative address. None if the address is not a palette's, or if the
    palette gives the spectrum by its name. Raises SpectrumError as `read_spectrum` does.
    """
    parts = split_address(address)
    if parts is None or Path(parts[0]).suffix.lower() != PALETTE:
        return None
    if named_in_palette(parts, role, folder):
        return None
    path = os.fspath(Path(path_text(folder), parts[0]))
    return palette_spectrum(path, parts[1], role).grid


def rebase_address(text: str, folder: Path, to: Path | None) -> str:
    """Rewrite ``FILE#selector`` relative to another folder, absolute if that is None.

    Other names do not change.
    """
    if (address := split_address(text)) is None:
        return text
    return rebase_path(address[0], folder, to) + text[len(address[0]) :]


def rebase_path(file: str, folder: Path, to: Path | None) -> str:
    """Rewrite a file's name as `rebase_address`; absolute names do not change."""
    if os.path.isabs(file):
        return file
    if to is None:
        return (folder.resolve() / file).as_posix()
    # `..` of a folder behind a symbolic link is the folder's parent, not the link's.
    return Path(os.path.relpath(folder.resolve() / file, to.resolve())).as_posix()


def resample(
    measured: Spectrum, grid: SpectralGrid, label: str, *, unit: float = 1.0, stacklevel: int
) -> NDArray[np.float64]:
    """Return (N,) band means of a file's spectrum divided by ``unit``.

    Warns of extrapolated ends, ``stacklevel`` counted from here, but not of the default grid's
    below 400 and above 700 nm. Raises SpectrumError if the visible part of the grid is not covered;
    ``label`` names the file.
    """
    w, v = measured.wavelengths_nm, measured.values
    try:
        means = extended_band_means(w, v / unit, grid)
    except SpectrumError as error:
        raise error.within(label) from None
    # Nobody asked for the default grid's ends, and common instruments do not measure them.
    needed = PAPERS_GRID if grid == DEFAULT_GRID else grid
    filled = []
    if w[0] > needed.start_nm + _NOTHING_NM:
        filled.append(f"{grid.start_nm:g}-{w[0]:g} nm with its first value, {v[0]:g}")
    if w[-1] < needed.stop_nm - _NOTHING_NM:
        filled.append(f"{w[-1]:g}-{grid.stop_nm:g} nm with its last value, {v[-1]:g}")
    if filled:
        warnings.warn(
            f"{label}: covers {w[0]:g}-{w[-1]:g} nm; filled {' and '.join(filled)} "
            "(CIE 167:2005; the eye hardly sees there)",
            VolspecWarning,
            stacklevel=stacklevel + 1,
        )
    return means


def _column(path: str, selector: str, kind: Kind | None) -> Spectrum:
    return read_columns(path, kind=kind).spectrum(selector)


def _palette(path: str, selector: str, kind: Kind | None) -> Spectrum:
    return palette_spectrum(path, selector, _ROLE[kind] if kind else None)


def _tm27(path: str, selector: str, kind: Kind | None) -> Spectrum:
    if selector:
        raise SpectrumError(f"{path}: has one spectrum; leave out '#{selector}'", code="unknown")
    _check_tm27(path)
    colour = colour_science()
    try:
        # colour-science only warns of values that are not finite; Spectrum refuses them.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            document = colour.SpectralDistribution_IESTM2714(path)
    except Exception as error:  # of any class: colour-science validates nothing
        raise SpectrumError(
            f"{path}: cannot be read as IES TM-27 ({one_line(error)}); correct or re-export it",
            code="damaged",
        ) from None
    notes = {}
    for part in (document.header, document):
        for item in part.mapping.elements:
            value = getattr(part, item.attribute)
            if isinstance(value, bool):
                value = "yes" if value else "no"
            text = str(value).strip()
            # The reader returns None, "None" or NaN for missing fields; instruments write N/A.
            if text.lower() not in ("", "none", "nan", "n/a"):
                notes[item.attribute.replace("_", " ")] = text
    name = notes.get("description") or Path(path).stem
    require_nanometres(document.wavelengths, path)
    try:
        return Spectrum(document.wavelengths, document.values, name, notes)
    except SpectrumError as error:
        raise error.within(path) from None


def _check_tm27(path: str) -> None:
    """Refuse XML that colour-science would misread: it accepts any and joins distributions."""
    root = xml_root(path)
    tag = root.tag.rpartition("}")[2]
    if tag != "IESTM2714" or "}" not in root.tag:
        raise SpectrumError(
            f"{path}: its root is <{tag}>, expected <IESTM2714 xmlns=…> (IES TM-27-14); "
            "export it in that format, or as CSV",
            code="unsupported",
        )
    spectra = root.findall("{*}SpectralDistribution")
    if not spectra:
        raise SpectrumError(
            f"{path}: has no <SpectralDistribution> with the values; export the file again",
            code="damaged",
        )
    if len(spectra) > 1:
        raise SpectrumError(
            f"{path}: has {len(spectra)} spectral distributions, expected one; split the file",
            code="unsupported",
        )
    last = -np.inf
    number = 0
    # At any depth, as colour-science finds them.
    for number, sample in enumerate(root.iterfind(".//{*}SpectralData"), start=1):
        pair = sample.get("wavelength"), sample.text
        try:
            wavelength, value = (read_number(text or "") for text in pair)
        except ValueError:
            raise SpectrumError(
                f"{path}: SpectralData number {number}: wavelength {pair[0]!r}, value "
                f"{pair[1]!r}; expected two numbers",
                code="syntax",
            ) from None
        if not np.isfinite((wavelength, value)).all():
            raise SpectrumError(
                f"{path}: SpectralData number {number}: the value at {wavelength:g} nm is "
                f"{value:g}, not finite; leave that value out"
            )
        if not wavelength > last:
            raise SpectrumError(
                f"{path}: SpectralData number {number}: {wavelength:g} nm after {last:g} nm; "
                "wavelengths must increase strictly, sort them"
            )
        last = wavelength
    if number < 2:
        raise SpectrumError(
            f"{path}: has {number} <SpectralData>, expected at least 2; export the file again",
            code="damaged",
        )


def _pixels(path: str, selector: str, kind: Kind | None) -> Spectrum:
    box = None
    if selector:
        try:
            # Python's int() accepts 4_00.
            box = tuple(int(number) for number in selector.replace("_", "?").split(","))
        except ValueError:
            box = ()
        if len(box) == 2:
            box = (*box, box[0] + 1, box[1] + 1)
        if len(box) != 4:
            raise SpectrumError(
                f"{path}: {selector!r} is not a part of an image; write "
                f"{Path(path).name}#X,Y or {Path(path).name}#X0,Y0,X1,Y1",
                code="syntax",
            )
    spectrum = SpectralImage.load(path, kind, box=box).mean()
    return replace(spectrum, name=Path(path).stem + (f"#{selector}" if selector else ""))


def _envi(path: str, selector: str, kind: Kind | None) -> Spectrum:
    file = EnviFile.open(path)
    if file.is_library:
        return file.library().for_kind(kind).spectrum(selector)
    return _pixels(path, selector, kind)


COLUMNS = (".csv", ".txt", ".tsv", ".spd", ".ssp", *_CGATS, ".cxf")
"""Suffixes of files that may have many spectra, as `read_columns` takes them."""
_READERS: dict[str, Callable[[str, str, Kind | None], Spectrum]] = {
    **dict.fromkeys(COLUMNS, _column),
    **dict.fromkeys((".spdx", ".xml"), _tm27),
    ".exr": _pixels,
    ".hdr": _envi,
    PALETTE: _palette,
}
_ADDRESS = re.compile(rf"(.*?(?:{'|'.join(map(re.escape, _READERS))}))(?:#(.*))?", re.IGNORECASE)
