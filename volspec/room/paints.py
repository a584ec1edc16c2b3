"""Candidate paints: sets of the library, atlases in files, and mixtures of paints.

spectra -> [paints] -> paint_ranking

    additive        R = Σ c_i R_i                                       small dots of several paints
    Kubelka-Munk    K/S = Σ c_i (1 - R_i)² / 2R_i,                      one opaque layer of them all
                    R = 1 + K/S - √((K/S)² + 2 K/S)                                     [1], [2]

Shares c sum to 1. All paints scatter alike (the single-constant theory), and the reflection at the
layer's surface is left out.

References
----------
[1] Kubelka & Munk (1931), "Ein Beitrag zur Optik der Farbanstriche", Z. techn. Physik 12, 593-601.
[2] Duncan (1940), "The colour of pigment mixtures", Proc. Physical Society 52, 390-401.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import RoomError, nearest
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    reflectance,
    reflectance_from_colour,
)
from volspec.spectra.files import COLUMNS, fold_name, read_columns, split_address
from volspec.spectra.library import (
    as_reflectance,
    reflectance_names,
    reflectance_set_names,
    reflectance_sets,
)

Array = NDArray[np.float64]
MixingLaw = Literal["km", "additive"]
MIXING_LAWS: tuple[MixingLaw, ...] = ("km", "additive")
# A reflectance of 0 has no K/S.
_DARKEST = 1e-4
# More mixtures take minutes to compare.
_MAX_MIXTURES = 5000
# A step is 1/n if it is so close to it: 0.333 is a third.
_STEP_ROUNDING = 5e-3


def paint_set(
    names: Sequence[str],
    grid: SpectralGrid = DEFAULT_GRID,
    *,
    folder: str | os.PathLike[str] = ".",
) -> tuple[Spectrum, ...]:
    """Return the paints of several names, without repetitions.

    Parameters
    ----------
    names : sequence of str
        Each is a set of `reflectance_set`, such as ``natural``; a part of the library, such as
        ``ColorChecker``; an atlas, ``FILE.csv`` with a paint in each column, or a measured chart
        (``FILE.ti3``, ``FILE.cxf``); or one paint, as `reflectance` takes it, or #rrggbb.
    grid : SpectralGrid
    folder : path
        Base of a file's relative name.

    Raises
    ------
    RoomError
        If a name is unknown, or two paints of an atlas have the same name.
    SpectrumError
        If a file cannot be read, as `reflectance`.
    """
    paints: dict[str, Spectrum] = {}
    for name in names:
        for paint in _find_paints(name.strip(), grid, folder):
            paints.setdefault(paint.name, paint)
    return tuple(paints.values())


def _find_paints(name: str, grid: SpectralGrid, folder: str | os.PathLike[str]) -> list[Spectrum]:
    """Return the paints of one name."""
    if name in reflectance_sets():
        return [reflectance(n, grid) for n in reflectance_set_names(name)]
    if name.startswith("#"):
        return [replace(reflectance_from_colour(name, grid=grid), name=name)]
    address = split_address(name)
    if address and not address[1] and Path(address[0]).suffix.lower() in COLUMNS:
        return _atlas(os.fspath(Path(folder, name)), grid)
    if part := [n for n in reflectance_names() if n.startswith(f"{name}/")]:
        return [reflectance(n, grid) for n in part]
    is_listed = fold_name(name) in map(fold_name, reflectance_names())
    if is_listed or address or any(mark in name for mark in ":*+"):
        return [reflectance(name, grid, folder=folder)]
    parts = dict.fromkeys(n.partition("/")[0] for n in reflectance_names() if "/" in n)
    sets = (*reflectance_sets(), *parts)
    guess = nearest(name, (*sets, *reflectance_names()))
    raise RoomError(
        f"{name!r} is unknown",
        f"{guess}give {', '.join(sets)}, a reflectance or FILE.csv",
        code="unknown",
        field="paint_set",
        given=name,
    )


def _atlas(path: str, grid: SpectralGrid) -> list[Spectrum]:
    """Return the columns of a table, or the samples of a measured chart."""
    table = read_columns(path, kind="reflective")
    if len(set(table.names)) < len(table.names):
        twice = next(name for name in table.names if table.names.count(name) > 1)
        raise RoomError(
            f"{path}: two paints are named {twice!r}", "rename one", code="duplicate", given=twice
        )
    paints: list[Spectrum] = []
    for name in table.names:
        with warnings.catch_warnings():
            if paints:  # all columns have the same wavelengths: one warning is enough
                warnings.simplefilter("ignore")
            paints.append(as_reflectance(table.spectrum(name), grid, f"{path}#{name}"))
    return paints


def mix_paints(
    paints: Sequence[Spectrum],
    step: float,
    law: MixingLaw = "km",
    grid: SpectralGrid = DEFAULT_GRID,
) -> tuple[Spectrum, ...]:
    """Return all mixtures of paints whose shares are multiples of a step, the paints included.

    Parameters
    ----------
    paints : sequence of Spectrum
        Two or more.
    step : float
        1/n of a whole number n of 2 or more: 0.5, 0.25, 0.1, …
    law : "km" or "additive"
        Kubelka-Munk, for paints stirred together; or the mean reflectance by area.
    grid : SpectralGrid

    Raises
    ------
    RoomError
        If there is one paint only, the step is not 1/n, or there are more than 5000 mixtures.

    Examples
    --------
    White and black make a much darker grey than the mean:

    >>> white, black = reflectance("grey:0.9"), reflectance("grey:0.04")
    >>> for law in MIXING_LAWS:
    ...     each = mix_paints([white, black], 0.5, law)[1]
    ...     print(each.name, float(each.values[0].round(3)))
    50 % grey:0.9 + 50 % grey:0.04 0.074
    50 % grey:0.9 + 50 % grey:0.04 0.47
    """
    if law not in MIXING_LAWS:
        raise RoomError.refused("law", law, f"give {' or '.join(MIXING_LAWS)}", "unknown")
    if len(paints) < 2:
        raise RoomError(
            f"{len(paints)} paint", "give two or more to mix", code="missing", field="paints"
        )
    n = round(1.0 / step) if math.isfinite(step) and step > 0.0 else 0
    if n < 2 or abs(n * step - 1.0) > _STEP_ROUNDING:
        remedy = "give a part of 1, such as 0.5, 0.25 or 0.1"
        raise RoomError.refused("step", step, remedy, "range")
    count = math.comb(n + len(paints) - 1, n)
    if count > _MAX_MIXTURES:
        raise RoomError(
            f"{len(paints)} paints in steps of {step:g} make {count} mixtures",
            f"give fewer paints or a larger step: up to {_MAX_MIXTURES}",
            code="size",
            field="step",
            given=step,
        )
    reflectances = np.array([paint.on(grid).values for paint in paints])
    parts = np.array(list(_compositions(n, len(paints))))
    if law == "additive":
        mixed = parts @ reflectances / n
    else:
        mixed = reflectance_from_absorption(parts @ absorption_from_reflectance(reflectances) / n)
    # A pure paint is itself: 0 stays 0, and nothing is rounded.
    pure = parts.max(axis=1) == n
    mixed[pure] = reflectances[parts[pure].argmax(axis=1)]
    return tuple(
        Spectrum(grid.wavelengths_nm, values, _mixture_name(paints, row / n))
        for values, row in zip(mixed, parts, strict=True)
    )


def absorption_from_reflectance(reflectance: ArrayLike) -> Array:
    """Return K/S of an opaque layer; a reflectance below 0.0001 counts as this."""
    R = np.maximum(np.asarray(reflectance, np.float64), _DARKEST)
    return (1.0 - R) ** 2 / (2.0 * R)


def reflectance_from_absorption(absorption: ArrayLike) -> Array:
    """Return the reflectance of an opaque layer of K/S.

    >>> float(reflectance_from_absorption(absorption_from_reflectance(0.3)).round(12))
    0.3
    """
    a = 1.0 + np.asarray(absorption, np.float64)
    # 1 / (a + √(a² - 1)), which is a - √(a² - 1) without its cancellation.
    return np.asarray(1.0 / (a + np.sqrt(a**2 - 1.0)))


def _compositions(total: int, count: int) -> Iterator[tuple[int, ...]]:
    """Yield all rows of ``count`` whole numbers that sum to ``total``."""
    if count == 1:
        yield (total,)
        return
    for first in range(total, -1, -1):
        for tail in _compositions(total - first, count - 1):
            yield first, *tail


def _mixture_name(paints: Sequence[Spectrum], fractions: Array) -> str:
    parts = [(part, paint.name) for part, paint in zip(fractions, paints, strict=True) if part]
    if len(parts) == 1:
        return parts[0][1]
    return " + ".join(f"{100 * part:.3g} % {name}" for part, name in parts)
