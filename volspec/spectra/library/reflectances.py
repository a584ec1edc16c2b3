"""Named reflectances: colour charts, colour-rendering samples, metals, greys, files.

    files, tables, datasets -> [reflectances] -> construct, scene, basis, command line

No basis is fitted to the sets ``natural`` and ``patches``.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import asset
from volspec.errors import SpectrumError, VolspecWarning, nearest
from volspec.spectra.datasets import Table, reflectances
from volspec.spectra.files.reading import (
    FILE_FORMS,
    named_in_palette,
    read_spectrum,
    resample,
    split_address,
)
from volspec.spectra.files.tables import fold_name, path_text, read_number, read_table
from volspec.spectra.fluorescence import Fluorescence
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.library.fluorophores import (
    FLUOROPHORE,
    FLUOROPHORES,
    fluorescence_in_file,
    named_fluorescence,
)
from volspec.spectra.spectrum import Spectrum, extended_band_means


def reflectance(
    text: str, grid: SpectralGrid = DEFAULT_GRID, *, folder: str | os.PathLike[str] = "."
) -> Spectrum:
    """Return a reflectance by name, as scene files write it.

    Parameters
    ----------
    text : str
        A name in `reflectance_names` (any case): ``ColorChecker/dark skin``, ``PMC/Banana``,
        ``CES/1``-``CES/99`` (CIE 224:2017), ``TCS/1``-``TCS/15`` (CIE colour rendering,
        2024 data; ``TCS 1995/…``: older), ``VS/1``-``VS/15`` (NIST CQS 9.0; ``VS 7.4/…``),
        ``Vrhel/118 wood pine`` (170 natural and man-made objects), ``ACES/1`` (175 patches),
        a metal such as ``aluminium``; ``sRGB/red`` … ``sRGB/yellow`` (the colours of display
        codes 0 and 1 under D65); ``white``, ``black``, ``grey:0.18``; a filter,
        ``longpass:500``, ``shortpass:500`` or ``bandpass:525/50`` (middle/width, nm);
        ``fluorophore:EGFP`` (see `FLUOROPHORES`), which absorbs and emits, and reflects nothing; a
        mix of these, ``white*0.25+sRGB/red*0.5``, whose weights sum to at most 1; FPbase's
        ``FILE.csv#EGFP`` with columns ``EGFP ex`` and ``EGFP em``; or a file with
        values in 0..1 (``FILE.csv``, ``FILE.csv#column``, ``FILE.ti3#sample``, ``FILE.cxf#object``,
        ``PALETTE.toml#name``, …; see `read_spectrum`).
    grid : SpectralGrid
    folder : path
        Base of a file's relative name.

    Returns
    -------
    Spectrum
        Values in 0..1 on the grid, with a file's notes. Tables that end inside of the grid are
        extrapolated by their last value at the ends of the visible; for a file, with a
        `VolspecWarning`. A file's values of 1..2 (fluorescent paper) are accepted with a warning.

    Raises
    ------
    SpectrumError
        If the name is unknown (the nearest are listed), a value is negative or above 2, the
        table does not cover the grid, or a file cannot be read or contains a light.

    Examples
    --------
    >>> float(reflectance("grey:0.18").values.mean().round(6))
    0.18
    """
    folder = path_text(folder, "folder")
    name = str(text).strip()
    folded = fold_name(name)
    prefix, _, number = folded.partition(":")
    single = not set("+*") & set(number)
    if folded in ("white", "black") or (single and prefix in ("grey", "gray")):
        return _flat(name, {"white": "1", "black": "0"}.get(folded, number), grid)
    if single and prefix == FLUOROPHORE:
        return _fluorescent(*named_fluorescence(number), grid)
    if single and prefix in _FILTERS:
        return _filter(name, prefix, number, grid)
    if address := split_address(name):
        if fluorophore := fluorescence_in_file(Path(folder, address[0]), address[1]):
            return _fluorescent(*fluorophore, grid)
        if target := named_in_palette(address, "reflectance", folder):
            text, its_folder = target
            return reflectance(text, grid, folder=its_folder)
        return _from_file(os.fspath(Path(folder, name)), grid)
    names = {n.casefold(): n for n in sample_tables()}
    if folded not in names and ("*" in name or "+" in name):
        return _mix_spectra(name, grid)
    if folded not in names:
        raise SpectrumError(
            f"reflectance {name!r} is unknown; {nearest(name, reflectance_names())}"
            f"other forms: grey:0.18, white, black, {FLUOROPHORE}:EGFP, longpass:500, {FILE_FORMS}",
            code="unknown",
        )
    w, v = sample_tables()[names[folded]]
    try:
        values = extended_band_means(w, v, grid)
    except SpectrumError as error:
        raise error.within(f"reflectance {names[folded]!r}") from None
    return Spectrum(grid.wavelengths_nm, values, names[folded])


def reflectance_names() -> tuple[str, ...]:
    """Return every name that `reflectance` accepts, except files, filters and ``grey:…``."""
    dyes = (f"{FLUOROPHORE}:{name}" for name in FLUOROPHORES)
    return ("white", "black", *sample_tables(), *dyes)


def reflectance_set(name: str, grid: SpectralGrid = DEFAULT_GRID) -> NDArray[np.float64]:
    """Return the (K, N) reflectances of a set in `reflectance_set_names`."""
    return np.array([reflectance(n, grid).values for n in reflectance_set_names(name)])


def _mix_spectra(text: str, grid: SpectralGrid) -> Spectrum:
    """Return the weighted sum of named reflectances; a weight left out is 1."""
    total, mixed = 0.0, _flat("black", "0", grid)
    for part in text.split("+"):
        name, star, digits = part.rpartition("*")
        try:
            weight = read_number(digits) if star else 1.0
        except ValueError:
            weight = np.nan
        if not 0 <= weight <= 1:
            raise SpectrumError(
                f"reflectance {text!r}: weight {digits!r} is not in 0..1; write NAME*0.5+NAME*0.5",
                code="range",
            )
        total += weight
        mixed += weight * reflectance(name if star else part, grid)
    if total > 1 + 1e-6:
        raise SpectrumError(
            f"reflectance {text!r}: its weights sum to {total:g}; give at most 1", code="range"
        )
    return replace(mixed, name=text)


def _fluorescent(name: str, fluorescence: Fluorescence, grid: SpectralGrid) -> Spectrum:
    black = np.zeros(grid.size)
    return Spectrum(grid.wavelengths_nm, black, name, fluorescence=fluorescence)


# Wavelengths, nm, between which a filter passes light, from its numbers.
_FILTERS: Mapping[str, Callable[..., tuple[float, float]]] = {
    "longpass": lambda start: (start, np.inf),
    "shortpass": lambda end: (-np.inf, end),
    "bandpass": lambda middle, width: (middle - width / 2, middle + width / 2),
}


def _filter(name: str, kind: str, numbers: str, grid: SpectralGrid) -> Spectrum:
    """Return an ideal filter: 1 where it passes light, 0 elsewhere, in parts of bands."""
    try:
        nm = [read_number(number) for number in numbers.split("/")]
        low, high = _FILTERS[kind](*nm)
        if not all(0 < number < np.inf for number in nm):
            raise ValueError
    except (TypeError, ValueError):
        raise SpectrumError(
            f"filter {name!r}: give nm above 0, as in longpass:500, shortpass:500 or "
            "bandpass:525/50 (middle/width)",
            code="syntax",
        ) from None
    starts = grid.wavelengths_nm - grid.step_nm / 2
    passed = np.minimum(starts + grid.step_nm, high) - np.maximum(starts, low)
    return Spectrum(grid.wavelengths_nm, np.clip(passed / grid.step_nm, 0.0, 1.0), name)


def _flat(name: str, level: str, grid: SpectralGrid) -> Spectrum:
    try:
        value = read_number(level)
    except ValueError:
        value = np.nan
    if not 0 <= value <= 1:
        raise SpectrumError(f"reflectance {name!r}: {level!r} is not in 0..1; write as grey:0.18")
    return Spectrum(grid.wavelengths_nm, np.full(grid.size, value), name)


def as_reflectance(
    measured: Spectrum, grid: SpectralGrid, label: str = "", *, stacklevel: int = 2
) -> Spectrum:
    """Convert a measured spectrum to a reflectance on the grid: checked, with its notes.

    ``label`` names it in messages; ``stacklevel`` is for warnings, counted from here. Values are 0
    to 1, or up to 2 with a warning; others, or an uncovered grid, raise SpectrumError.
    """
    label = label or f"reflectance {measured.name!r}"
    w, v = measured.wavelengths_nm, measured.values
    low, high = int(v.argmin()), int(v.argmax())
    if v[low] < 0:
        raise SpectrumError(
            f"{label}: reflectance {v[low]:g} at {w[low]:g} nm is negative; if it is the "
            "instrument's noise, write 0"
        )
    if v[high] > 2:
        raise SpectrumError(
            f"{label}: reflectance {v[high]:g} at {w[high]:g} nm, expected 0..1; are the values "
            "percentages? divide by 100"
        )
    if v[high] > 1:
        warnings.warn(
            f"{label}: reflectance {v[high]:g} at {w[high]:g} nm is above 1, left unchanged; "
            "only fluorescence causes that",
            VolspecWarning,
            stacklevel=stacklevel,
        )
    values = resample(measured, grid, label, stacklevel=stacklevel)
    return Spectrum(grid.wavelengths_nm, values, measured.name, measured.notes)


def _from_file(path: str, grid: SpectralGrid) -> Spectrum:
    # stacklevel: the caller of `reflectance` is three calls up from `as_reflectance`.
    return as_reflectance(read_spectrum(path, kind="reflective"), grid, path, stacklevel=4)


_SETS = {
    "training": ("CES/", "TCS/", "TCS 1995/"),
    "test": ("ColorChecker/", "PMC/", "VS/", "VS 7.4/"),
    "natural": ("Vrhel/",),
    "patches": ("ACES/",),
}
# Those of the 190 patches that are scaled copies of TCS samples (spectral angle below 1 degree),
# within 0.005 RMS of a sample of another set, or above 1.
_ACES_DROPPED = {66, 104, 106, 129, 142, 145, 175, 177, 2, 3, 11, 131, 114, 125, 128}


def reflectance_sets() -> tuple[str, ...]:
    """Return the names of the sets that `reflectance_set_names` lists."""
    return tuple(_SETS)


def reflectance_set_names(name: str) -> tuple[str, ...]:
    """Return the names of a set of reflectances.

    Parameters
    ----------
    name : str
        ``training``: 99 colour evaluation samples of CIE 224:2017 and the 15 + 14 test colours
        of the CIE colour rendering index (docs/method.md, section 2). ``test``: 24 ColorChecker
        patches (BabelColor average), 30 preferred memory colours, 15 + 15 samples of CQS 9.0
        and 7.4.
        ``natural``: the 170 objects of Vrhel, Gershon & Iwan (1994): skin, leaves, rocks, wood,
        cloth. ``patches``: 175 of the Academy's 190 camera training patches.

    Raises
    ------
    SpectrumError
        If the set is unknown.
    """
    if name not in _SETS:
        raise SpectrumError(
            f"reflectance set {name!r} is unknown; {nearest(name, _SETS)}choose {', '.join(_SETS)}",
            code="unknown",
        )
    return tuple(n for start in _SETS[name] for n in sample_tables() if n.startswith(start))


@cache
def sample_tables() -> dict[str, Table]:
    """Return the tables of all measured reflectances by name."""
    tables = dict(reflectances())
    for number in _ACES_DROPPED:
        del tables[f"ACES/{number}"]
    for name, (nm, values) in tables.items():
        if name.startswith("ACES/"):
            # Some are 0 below 400 nm, where they were not measured.
            measured = (nm >= 400) & (nm <= 700)
            tables[name] = (nm[measured], values[measured])
    for prefix, file in (("", "metals"), ("Vrhel/", "vrhel"), ("sRGB/", "srgb")):
        table = read_table(asset(f"data/spectra/{file}.csv"))
        for name, column in zip(table.names, table.columns.T, strict=True):
            tables[prefix + name] = (table.wavelengths_nm, column)
    return tables
