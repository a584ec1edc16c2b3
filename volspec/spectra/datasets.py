"""Tables from colour-science: observers, illuminants, lamps, measured reflectances.

    colour-science, grid -> [datasets] -> spectrum, photometry, lights, reflectances

colour-science takes more than a second to import; its tables are cached in the user's cache folder
(`volspec._cache`) and read from there in milliseconds.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from volspec._cache import cached_arrays
from volspec.errors import SpectrumError
from volspec.spectra.grid import SpectralGrid

Table = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Wavelengths (L,), nm, and values (L,) or (L, K); read-only."""

Observer = Literal[2, 10, "CIE 2015 2", "CIE 2015 10"]
"""Standard observers by their field in degrees: CIE 1931 and CIE 1964, and those of CIE 2015."""


@cache
def observers() -> Mapping[str, Table]:
    """Colour-matching functions x, y, z by colour-science's name: values are (L, 3)."""
    names = _OBSERVERS.values()
    return _cache_tables("observers", lambda: _tables(colour_science().MSDS_CMFS, names))


@cache
def illuminants() -> Mapping[str, Table]:
    """CIE and ISO illuminants."""
    return _cache_tables("illuminants", lambda: _tables(colour_science().SDS_ILLUMINANTS))


@cache
def light_sources() -> Mapping[str, Table]:
    """Measured lamps."""
    return _cache_tables("light-sources", lambda: _tables(colour_science().SDS_LIGHT_SOURCES))


@cache
def daylight_components() -> Mapping[str, Table]:
    """S0, S1 and S2, which sum to daylight of any temperature (CIE 15:2018, table T.2)."""
    return _cache_tables(
        "daylight",
        lambda: _tables(colour_science().colorimetry.SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES),
    )


@cache
def reflectances() -> Mapping[str, Table]:
    """Charts and test samples as ``SET/name``; numbers in a set begin at 1."""
    return _cache_tables("reflectances", _reflectances)


def _reflectances() -> dict[str, Table]:
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
        for name, table in _tables(group).items():
            # TCS01 and VS1 become TCS/1 and VS/1; patches of charts keep their names.
            short = name.removeprefix(space.split()[0]).lstrip("0") or name
            tables[f"{space}/{short}"] = table
    sets = {
        "CES": colour.quality.cfi2017.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5)),
        "ACES": colour.characterisation.read_training_data_rawtoaces_v1(),
    }
    for space, spectra in sets.items():
        for number, column in enumerate(spectra.values.T, start=1):
            tables[f"{space}/{number}"] = (spectra.wavelengths, column)
    return tables


def _tables(group: Mapping[str, Any], names: Iterable[str] | None = None) -> dict[str, Table]:
    """Convert colour-science's distributions to tables."""
    return {name: (group[name].wavelengths, group[name].values) for name in names or group}


def _cache_tables(group: str, read: Callable[[], Mapping[str, Table]]) -> dict[str, Table]:
    """Return tables from the cache, or read them from colour-science."""
    reader = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    maker = f"colour-science {version('colour-science')}, reader {reader}"
    return _unpack(cached_arrays(f"spectra/{group}", maker, lambda: _pack(read())))


def _pack(tables: Mapping[str, Table]) -> dict[str, NDArray[Any]]:
    """Concatenate tables into a few arrays: an archive of hundreds is slow to read."""
    return {
        "names": np.array(list(tables)),
        "ends": np.cumsum([len(nm) for nm, _ in tables.values()]),
        "nm": np.concatenate([nm for nm, _ in tables.values()], dtype=np.float64),
        "values": np.concatenate([values for _, values in tables.values()], dtype=np.float64),
    }


def _unpack(packed: Mapping[str, NDArray[Any]]) -> dict[str, Table]:
    nm, values = (np.split(packed[key], packed["ends"][:-1]) for key in ("nm", "values"))
    return dict(zip(packed["names"].tolist(), zip(nm, values, strict=True), strict=True))


@cache
def colour_science() -> ModuleType:
    """Import ``colour`` late and without its side effects.

    The import warns of missing optional packages and switches NumPy's printing to a legacy style.
    """
    with warnings.catch_warnings(), np.printoptions():
        warnings.simplefilter("ignore")
        import colour
    return colour


_OBSERVERS: Mapping[Observer, str] = {
    2: "CIE 1931 2 Degree Standard Observer",
    10: "CIE 1964 10 Degree Standard Observer",
    "CIE 2015 2": "CIE 2015 2 Degree Standard Observer",
    "CIE 2015 10": "CIE 2015 10 Degree Standard Observer",
}
# The range of the first two. CIE 170-2's tables begin at 390 nm: nothing is seen below.
_FIRST_NM = 360.0


# Most programs use one grid; measured or experimental spectra bring their own.
@lru_cache(maxsize=64)
def colour_matching_functions(
    grid: SpectralGrid, observer_deg: Observer = 2
) -> NDArray[np.float64]:
    """Return a standard observer's colour-matching functions x, y, z: (3, N) band means.

    Parameters
    ----------
    grid : SpectralGrid
        Within 360-830 nm.
    observer_deg : {2, 10, "CIE 2015 2", "CIE 2015 10"}
        CIE 1931 2 degrees, CIE 1964 10 degrees, or the observers of CIE 170-2:2015, which are
        linear transforms of cone fundamentals; these are 0 below 390 nm.

    Raises
    ------
    SpectrumError
        If the grid exceeds 360-830 nm or the observer is not one of these.
    """
    nm, xyz = observers()[_OBSERVERS[check_observer(observer_deg)]]
    if nm[0] > _FIRST_NM:
        unseen = np.arange(_FIRST_NM, nm[0])
        nm, xyz = np.append(unseen, nm), np.vstack([np.zeros((unseen.size, 3)), xyz])
    try:
        Q = grid.band_means(nm, xyz).T
    except SpectrumError:
        raise SpectrumError(
            f"grid {grid}: the colour-matching functions span 360-830 nm; stay within that range"
        ) from None
    Q = np.ascontiguousarray(Q)
    Q.flags.writeable = False
    return Q


def check_observer(observer_deg: object) -> Observer:
    """Return a standard observer, numbers as plain ints; raise SpectrumError if it is none."""
    is_integer = isinstance(observer_deg, int | np.integer) and not isinstance(observer_deg, bool)
    if not (is_integer or isinstance(observer_deg, str)) or observer_deg not in get_args(Observer):
        raise SpectrumError.refused(
            "observer_deg",
            observer_deg,
            'use 2 (CIE 1931), 10 (CIE 1964), "CIE 2015 2" or "CIE 2015 10"',
            "unknown",
        )
    return cast(Observer, int(cast(int, observer_deg)) if is_integer else observer_deg)
