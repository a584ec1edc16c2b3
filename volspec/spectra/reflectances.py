"""Named reflectances: colour charts, colour-rendering samples, metals, greys, files.

grid, spectrum -> [reflectances] -> library
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.sources import asset
from volspec.errors import SpectrumError, nearest
from volspec.spectra._colour import colour_science
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.photometry import extended_band_means
from volspec.spectra.spectrum import Spectrum, read_table

_Table = tuple[NDArray[np.float64], NDArray[np.float64]]
_METALS_FILE = "data/spectra/metals.csv"
_SETS = {
    "training": ("CES/", "TCS/", "TCS 1995/"),
    "test": ("ColorChecker/", "PMC/", "VS/", "VS 7.4/"),
}


def reflectance(
    text: str, grid: SpectralGrid = DEFAULT_GRID, *, folder: str | os.PathLike[str] = "."
) -> Spectrum:
    """A reflectance by name, as scene files write it.

    Parameters
    ----------
    text : str
        A name of `reflectance_names` (any case): ``ColorChecker/dark skin``, ``PMC/Banana``,
        ``CES/1``-``CES/99`` (CIE 224:2017), ``TCS/1``-``TCS/15`` (CIE colour rendering,
        2024 data; ``TCS 1995/…`` the older), ``VS/1``-``VS/15`` (NIST CQS 9.0; ``VS 7.4/…``),
        a metal such as ``aluminium``; ``white``, ``black``, ``grey:0.18``; or ``FILE.csv``
        (nm, value in 0..1).
    grid : SpectralGrid
    folder : path
        What a file's relative name starts from.

    Returns
    -------
    Spectrum
        On the grid, values in 0..1. Tables that end inside the grid are continued by their
        last value where the eye hardly sees.

    Raises
    ------
    SpectrumError
        If the name is unknown (the nearest ones are given), a value lies outside 0..1, or
        the table does not cover the grid.

    Examples
    --------
    >>> float(reflectance("grey:0.18").values.mean().round(6))
    0.18
    """
    name = " ".join(str(text).split())
    folded = name.casefold()
    prefix, _, number = folded.partition(":")
    if folded in ("white", "black") or prefix in ("grey", "gray"):
        return _flat(name, {"white": "1", "black": "0"}.get(folded, number), grid)
    if folded.endswith(".csv"):
        return _from_file(os.fspath(Path(folder, name)), grid)
    known = {n.casefold(): n for n in _tables()}
    if folded not in known:
        raise SpectrumError(
            f"reflectance {name!r} is unknown; {nearest(name, reflectance_names())}"
            "other forms: grey:0.18, white, black, FILE.csv"
        )
    w, v = _tables()[known[folded]]
    try:
        values = extended_band_means(w, v, grid)
    except SpectrumError as error:
        raise SpectrumError(f"reflectance {known[folded]!r}: {error}") from None
    return Spectrum(grid.wavelengths_nm, values, known[folded])


def reflectance_names() -> tuple[str, ...]:
    """Every name `reflectance` knows, apart from files and ``grey:…``."""
    return ("white", "black", *_tables())


def reflectance_set(name: str, grid: SpectralGrid = DEFAULT_GRID) -> NDArray[np.float64]:
    """Reflectances to fit and to test bases with (METHOD section 2).

    ``training``: 99 colour evaluation samples of CIE 224:2017 and the 15 + 14 test colours of
    the CIE colour rendering index. ``test``: 24 ColorChecker patches (BabelColor average),
    30 preferred memory colours, 15 + 15 samples of CQS 9.0 and 7.4.

    Returns
    -------
    (K, N) float64

    Raises
    ------
    SpectrumError
        If the set is unknown.
    """
    return np.array([reflectance(n, grid).values for n in reflectance_set_names(name)])


def reflectance_set_names(name: str) -> tuple[str, ...]:
    """The names behind the rows of `reflectance_set`."""
    if name not in _SETS:
        raise SpectrumError(
            f"reflectance set {name!r} is unknown; {nearest(name, _SETS)}choose training or test"
        )
    return tuple(n for start in _SETS[name] for n in _tables() if n.startswith(start))


def _flat(name: str, level: str, grid: SpectralGrid) -> Spectrum:
    try:
        value = float(level)
    except ValueError:
        value = np.nan
    if not 0 <= value <= 1:
        raise SpectrumError(f"reflectance {name!r}: {level!r} is not in 0..1; write grey:0.18")
    return Spectrum(grid.wavelengths_nm, np.full(grid.size, value), name)


def _from_file(path: str, grid: SpectralGrid) -> Spectrum:
    measured = Spectrum.from_csv(path)
    low, high = measured.values.min(), measured.values.max()
    if low < 0 or high > 1:
        hint = "are they per cent? divide by 100" if low >= 0 and high > 2 else "clip them"
        raise SpectrumError(f"{path}: reflectances span {low:g} to {high:g}, expected 0..1; {hint}")
    try:
        values = extended_band_means(measured.wavelengths_nm, measured.values, grid)
    except SpectrumError as error:
        raise SpectrumError(f"{path}: {error}") from None
    return Spectrum(grid.wavelengths_nm, values, measured.name)


@cache
def _tables() -> dict[str, _Table]:
    colour = colour_science()
    samples = colour.quality.datasets
    tables: dict[str, _Table] = {}
    for space, group in (
        ("ColorChecker", colour.SDS_COLOURCHECKERS["BabelColor Average"]),
        ("ColorChecker Ohta", colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]),
        ("ISO 17321-1", colour.SDS_COLOURCHECKERS["ISO 17321-1"]),
        ("PMC", colour.SDS_COLOURCHECKERS["PMC"]),
        ("TCS", samples.SDS_TCS["CIE 2024"]),
        ("TCS 1995", samples.SDS_TCS["CIE 1995"]),
        ("VS", samples.SDS_VS["NIST CQS 9.0"]),
        ("VS 7.4", samples.SDS_VS["NIST CQS 7.4"]),
    ):
        for key in group:
            # TCS01 and VS1 become TCS/1 and VS/1; charts keep their patches' names.
            short = key.removeprefix(space.split()[0]).lstrip("0") or key
            tables[f"{space}/{short}"] = (group[key].wavelengths, group[key].values)
    for number, values in enumerate(_colour_evaluation_samples(), start=1):
        tables[f"CES/{number}"] = values
    rows = [row for _, row in read_table(asset(_METALS_FILE))]
    table = np.array(rows)
    for column, metal in enumerate(_metal_names(), start=1):
        tables[metal] = (table[:, 0], table[:, column])
    return tables


def _colour_evaluation_samples() -> list[_Table]:
    colour = colour_science()
    samples = colour.quality.cfi2017.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    return [(samples.wavelengths, column) for column in samples.values.T]


def _metal_names() -> list[str]:
    lines = asset(_METALS_FILE).read_text(encoding="utf-8").splitlines()
    header = next(line for line in lines if not line.startswith("#"))
    return header.split(",")[1:]
