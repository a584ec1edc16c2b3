"""Measured reflectances that come with the package or with colour-science, by name and by set.

    tables, datasets -> [samples] -> reflectances

Two sets were never looked at while bases were made: ``natural`` and ``patches``.
"""

from __future__ import annotations

from functools import cache

from volspec._gpu.sources import asset
from volspec.errors import SpectrumError, nearest
from volspec.spectra.datasets import Table, reflectances
from volspec.spectra.tables import read_table

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
            f"reflectance set {name!r} is unknown; {nearest(name, _SETS)}choose {', '.join(_SETS)}",
            code="unknown",
        )
    return tuple(n for start in _SETS[name] for n in sample_tables() if n.startswith(start))


@cache
def sample_tables() -> dict[str, Table]:
    """Every named measured reflectance."""
    tables = dict(reflectances())
    for number in _ACES_DROPPED:
        del tables[f"ACES/{number}"]
    for name, (nm, values) in tables.items():
        if name.startswith("ACES/"):
            # Some are 0 below 400 nm, where nothing was measured.
            seen = (nm >= 400) & (nm <= 700)
            tables[name] = (nm[seen], values[seen])
    for prefix, file in (("", "metals"), ("Vrhel/", "vrhel")):
        table = read_table(asset(f"data/spectra/{file}.csv"))
        for name, column in zip(table.names, table.columns.T, strict=True):
            tables[prefix + name] = (table.wavelengths_nm, column)
    return tables
