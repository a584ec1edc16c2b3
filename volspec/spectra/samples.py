"""Measured reflectances that come with the package or with colour-science, by name and by set.

    tables, colour-science -> [samples] -> reflectances

Two sets were never looked at while bases were made: ``natural`` and ``patches``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.sources import asset
from volspec.errors import SpectrumError, nearest
from volspec.spectra._colour import colour_science
from volspec.spectra.tables import read_table

Table = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Wavelengths (nm) and values."""
_SETS = {
    "training": ("CES/", "TCS/", "TCS 1995/"),
    "test": ("ColorChecker/", "PMC/", "VS/", "VS 7.4/"),
    "natural": ("Vrhel/",),
    "patches": ("ACES/",),
}
# Of the 190 patches those that are scaled copies of TCS samples (spectral angle below 1 degree),
# within 0.005 RMS of a sample of the other sets, or above 1.
_ACES_DROPPED = {66, 104, 106, 129, 142, 145, 175, 177, 2, 3, 11, 131, 114, 125, 128}


def reflectance_set_names(name: str) -> tuple[str, ...]:
    """The names of a set of reflectances.

    Parameters
    ----------
    name : str
        ``training``: 99 colour evaluation samples of CIE 224:2017 and the 15 + 14 test colours
        of the CIE colour rendering index (METHOD section 2). ``test``: 24 ColorChecker patches
        (BabelColor average), 30 preferred memory colours, 15 + 15 samples of CQS 9.0 and 7.4.
        ``natural``: the 170 objects of Vrhel, Gershon & Iwan (1994): skin, leaves, rocks, wood,
        cloth. ``patches``: 175 of the Academy's 190 camera training patches.

    Raises
    ------
    SpectrumError
        If the set is unknown.
    """
    if name not in _SETS:
        raise SpectrumError(
            f"reflectance set {name!r} is unknown; {nearest(name, _SETS)}choose {', '.join(_SETS)}"
        )
    return tuple(n for start in _SETS[name] for n in sample_tables() if n.startswith(start))


@cache
def sample_tables() -> dict[str, Table]:
    """Every named measured reflectance."""
    colour = colour_science()
    samples = colour.quality.datasets
    tables: dict[str, Table] = {}
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
    for number, values in enumerate(_camera_training_patches(), start=1):
        if number not in _ACES_DROPPED:
            tables[f"ACES/{number}"] = values
    for prefix, file in (("", "metals"), ("Vrhel/", "vrhel")):
        table = read_table(asset(f"data/spectra/{file}.csv"))
        for name, column in zip(table.names, table.columns.T, strict=True):
            tables[prefix + name] = (table.wavelengths_nm, column)
    return tables


def _colour_evaluation_samples() -> list[Table]:
    colour = colour_science()
    samples = colour.quality.cfi2017.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    return [(samples.wavelengths, column) for column in samples.values.T]


def _camera_training_patches() -> list[Table]:
    patches = colour_science().characterisation.read_training_data_rawtoaces_v1()
    # Some are 0 below 400 nm, where nothing was measured.
    seen = (patches.wavelengths >= 400) & (patches.wavelengths <= 700)
    return [(patches.wavelengths[seen], column) for column in patches.values[seen].T]
