"""Named lights, Planck radiators, daylights, files, and mixes of them.

    grid, spectrum, photometry, library, files, lamps -> [lights] -> scene, basis, command line

Every light is scaled to the luminous energy of a flat light of ones (the V-weighted mean of its
values is 1), so a weight in a mix is the component's share of the illuminance; a nearly invisible
one, such as an ultraviolet lamp, to the power of such a light.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from operator import add
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError, nearest
from volspec.spectra.datasets import (
    colour_matching_functions,
    daylight_components,
    illuminants,
)
from volspec.spectra.files.palettes import palette_holds
from volspec.spectra.files.reading import (
    FILE_FORMS,
    named_in_palette,
    read_spectrum,
    rebase_address,
    resample,
    split_address,
)
from volspec.spectra.files.tables import fold_name, path_text, read_number
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.library.catalogue import (
    canonical_light,
    light_names,
    light_tables,
    nearest_light,
)
from volspec.spectra.library.lamps import LAMP, LAMPS
from volspec.spectra.photometry import C2_NM_K, light_level
from volspec.spectra.spectrum import Spectrum, extended_band_means, light_power

# Thermal and xenon lamps are smooth; without them and the two "Natural" tubes, 89 lights remain
# (docs/method.md, section 2).
_NOT_SPIKY = {
    "SA",
    "SC",
    "Incandescent",
    "Neodimium Incandescent",
    "60 A/W (Soft White)",
    "Kinoton 75P",
    "Natural",
    "F40/N (Natural FL)",
}
Folder = str | os.PathLike[str]
# Peaks of coloured LEDs and lasers, and the full width at half maximum of the former.
_PEAKED = ("led", "laser")
_PEAKS_NM, _LED_WIDTH_NM = (350.0, 750.0), 20.0
_SMOOTH = ("A", "B", "C", "D50", "D55", "D60", "D65", "D75", "E")


def light(text: str, grid: SpectralGrid = DEFAULT_GRID, *, folder: Folder = ".") -> Spectrum:
    """Return a light by name, as the command line writes it.

    Parameters
    ----------
    text : str
        A name in `light_names` (any case), an everyday name (``tungsten``, ``sodium``,
        ``candle``, …; see `EVERYDAY`), ``planck:KELVIN`` (500-100000),
        ``daylight:KELVIN`` (4000-25000), ``lamp:NAME`` (see `LAMPS`), ``led:NM`` (a coloured LED,
        20 nm wide, with its peak at 350-750 nm), ``laser:NM`` (a line, shared by the
        two bands around it), a file (``FILE.csv``, ``FILE.csv#column``, ``FILE.spd``,
        ``FILE.spdx``, ``FILE.exr#X,Y``, ``PALETTE.toml#name``, …; see `read_spectrum`), or a mix
        ``NAME*WEIGHT+NAME*WEIGHT`` with shares of illuminance as weights (default 1). Known names
        with ``+`` or ``/`` are matched whole; in a mix, give a column with ``+`` or ``*`` in its
        name by number.
    grid : SpectralGrid
    folder : path
        Base of a file's relative name.

    Returns
    -------
    Spectrum
        Relative power on the grid; the V-weighted mean is 1 for a single light, the sum of the
        weights for a mix. Tables that end inside of the grid are extrapolated by their last value
        (CIE 167:2005) at the ends of the visible; for a file, with a `VolspecWarning`. A file's
        notes are kept; a mix has the notes common to its parts (`Spectrum`).

    Raises
    ------
    SpectrumError
        If the name is unknown (the nearest are listed), a weight is negative, a temperature is
        out of range, a light has no energy or does not cover the grid, or a file cannot be read
        or contains a reflectance.

    Examples
    --------
    >>> light("D65*0.7 + planck:2856*0.3").name
    'D65*0.7+planck:2856*0.3'
    """
    name = str(text).strip()
    if not name:
        raise SpectrumError(
            "light: empty name; give a name such as D65, planck:3200 or FILE.csv", code="missing"
        )
    # Refuse a grid beyond the visible before any warning.
    colour_matching_functions(grid)
    folder = path_text(folder, "folder")
    terms = None if _is_known(name, folder) else _parse_mix(name, folder)
    if terms is None:
        return _component(name, grid, folder)
    for term in terms:
        if not (np.isfinite(term.weight) and term.weight >= 0):
            raise SpectrumError(
                f"light {name!r}: the weight of {term.name} is {term.weight:g}; "
                "a light cannot be subtracted, use a weight of 0 or more"
            )
    if not any(term.weight > 0 for term in terms):
        raise SpectrumError(f"light {name!r}: every weight is 0; give one a positive weight")
    parts = []
    for term in terms:
        if term.weight > 0:
            parts.append(term.weight * _component(term.name, grid, folder))
    return replace(reduce(add, parts), name="+".join(str(term) for term in terms))


@dataclass(frozen=True)
class _Term:
    name: str
    weight: float

    def __str__(self) -> str:
        return self.name if self.weight == 1 else f"{self.name}*{self.weight:g}"


def light_terms(text: str, folder: Folder = ".") -> list[tuple[str, float]]:
    """Return (name, weight) of every light in a mix, or of a single light.

    Raises SpectrumError if a part of a mix is unknown.
    """
    terms = None if _is_known(text, folder) else _parse_mix(text, folder)
    return [(term.name, term.weight) for term in terms or [_Term(text, 1.0)]]


def rebase_light(text: str, folder: Path, to: Path) -> str:
    """Rewrite file names in a light's name or mix relative to another folder.

    Names are relative to ``folder`` before, and to ``to`` afterwards. Raises SpectrumError if a
    part of a mix is unknown.
    """
    terms = light_terms(text, folder)
    names = [rebase_address(name, folder, to) for name, _ in terms]
    if names == [name for name, _ in terms]:
        return text
    return "+".join(
        name if weight == 1.0 else f"{name}*{weight!r}"
        for name, (_, weight) in zip(names, terms, strict=True)
    )


def sent_name(text: str) -> str:
    """Return a light's name for what is meant to be sent: without the folders of its files.

    >>> sent_name("key=/home/me/lamp.csv#2; fill=my lamps/a.spd*0.5+D65")
    'key=lamp.csv#2; fill=a.spd*0.5+D65'
    """
    return re.sub(r"(^|[=;+])[^=;+]*[/\\](?=[^=;+/\\]*\.\w)", r"\1", text)


def sent_names(texts: Sequence[str]) -> list[str]:
    """Return names as `sent_name`, but where two would be the same as they are."""
    short = [sent_name(text) for text in texts]
    return [
        name if short.count(name) == 1 else text for name, text in zip(short, texts, strict=True)
    ]


def light_set(name: str, grid: SpectralGrid = DEFAULT_GRID) -> list[Spectrum]:
    """Return a set of lights for fitting and testing bases (docs/method.md, section 2).

    ``smooth``: A, B, C, D50, D55, D60, D65, D75, E and Planck 2000-10000 K every 500 K (26).
    ``spiky``: FL, HP and LED illuminants and measured discharge, fluorescent and LED lamps (89).

    Raises
    ------
    SpectrumError
        If the set is unknown.
    """
    if name == "smooth":
        names = [*_SMOOTH, *(f"planck:{kelvin}" for kelvin in range(2000, 10001, 500))]
    elif name == "spiky":
        names = [
            n
            for n in light_names()
            if n.startswith(("FL", "HP", "LED")) or (n not in illuminants() and n not in _NOT_SPIKY)
        ]
    else:
        raise SpectrumError(
            f"light set {name!r} is unknown; {nearest(name, ('smooth', 'spiky'))}"
            "choose smooth or spiky",
            code="unknown",
        )
    return [light(n, grid) for n in names]


def _is_known(name: str, folder: Folder) -> bool:
    """Return True if the text is a single light, which need not be valid, and not a mix."""
    low = fold_name(name)
    if canonical_light(name):
        return True
    if address := split_address(name):
        file, selector = address
        if not set("+*") & set(name):
            return True
        # "A+lamp.csv" is a mix unless a file, "p.toml#x+A" unless a light in it, has that name.
        path = Path(folder, file)
        if set("+*") & set(selector):
            return palette_holds(os.fspath(path), selector, "light")
        return path.is_file()
    prefix, _, number = low.partition(":")
    if prefix == LAMP:
        return number.strip() in LAMPS
    return prefix in ("planck", "daylight", *_PEAKED) and _number(number) is not None


def _parse_mix(text: str, folder: Folder) -> list[_Term] | None:
    """Parse the terms of a mix; names may contain ``+``, so the longest term is tried first."""

    def read(parts: list[str]) -> Iterator[list[_Term]]:
        if not parts:
            yield []
        for count in range(len(parts), 0, -1):
            term = _read_term("+".join(parts[:count]).strip(), folder)
            if term is not None:
                for tail in read(parts[count:]):
                    yield [term, *tail]

    terms = next(read(text.split("+")), None)
    if terms is not None or not ("+" in text or "*" in text):
        return terms
    for part in text.split("+"):
        if not part.strip("* "):
            raise SpectrumError(
                f"light {text!r}: a name is missing; write NAME*WEIGHT+NAME*WEIGHT", code="syntax"
            )
        if part.rstrip().endswith("*"):
            raise SpectrumError(
                f"light {text!r}: a weight is missing after {part.strip()!r}", code="syntax"
            )
        name, _, weight = part.strip().rpartition("*")
        bare = name.strip() if name and _number(weight) is not None else part.strip()
        if not _is_known(bare, folder):
            raise _unknown(bare, f" in the mix {text!r}")
    raise SpectrumError(
        f"light {text!r}: cannot be read as a mix NAME*WEIGHT+NAME*WEIGHT", code="syntax"
    )


def _read_term(text: str, folder: Folder) -> _Term | None:
    if _is_known(text, folder):
        return _Term(canonical_light(text) or text, 1.0)
    for name, weight in (text.rpartition("*")[::2], text.partition("*")[::-2]):
        number = _number(weight)
        if number is not None and _is_known(name.strip(), folder):
            return _Term(canonical_light(name) or name.strip(), number)
    return None


def _number(text: str) -> float | None:
    try:
        return read_number(text)
    except ValueError:
        return None


@lru_cache(maxsize=1024)
def _named_light(name: str, grid: SpectralGrid) -> Spectrum:
    w, v = light_tables()[name]
    try:
        return _normalise(extended_band_means(w, v, grid), grid, name)
    except SpectrumError as error:
        raise error.within(f"light {name!r}") from None


def _component(name: str, grid: SpectralGrid, folder: Folder) -> Spectrum:
    name = canonical_light(name) or name
    if name in light_tables():
        return _named_light(name, grid)
    prefix, _, number = fold_name(name).partition(":")
    kelvin = peak_nm = _number(number)
    if prefix in ("planck", "daylight"):
        if kelvin is None:
            digits = re.match(r"\d{3,5}(?=\s*k)", number)
            example = f"{prefix}:{digits[0] if digits else 5000}"
            raise SpectrumError(
                f"light {name!r}: {number!r} is not a temperature in kelvin; write {example}",
                code="syntax",
            )
        low, high = (500, 100_000) if prefix == "planck" else (4000, 25_000)
        if not low <= kelvin <= high:
            raise SpectrumError(
                f"light {name!r}: {kelvin:g} K is outside of {low}-{high} K; stay within that range"
            )
        values = _planck(kelvin, grid) if prefix == "planck" else _daylight(kelvin, grid)
        return _normalise(values, grid, f"{prefix}:{kelvin:g}")
    if prefix in _PEAKED:
        low_nm, high_nm = _PEAKS_NM
        if peak_nm is None or not low_nm <= peak_nm <= high_nm:
            raise SpectrumError(
                f"light {name!r}: {number!r} is no peak of an LED or laser; give {low_nm:g} to "
                f"{high_nm:g} nm, as in {prefix}:450",
                code="range",
            )
        if abs(peak_nm - (grid.start_nm + grid.stop_nm) / 2) > (grid.stop_nm - grid.start_nm) / 2:
            raise SpectrumError(
                f"light {name!r}: its peak is beyond the grid, {grid.start_nm:g} to "
                f"{grid.stop_nm:g} nm; give a peak within it, or a wider grid, as in scenes "
                "[basis] grid_nm = [360, 750, 10]",
                code="range",
            )
        values = _led(peak_nm, grid) if prefix == "led" else _laser(peak_nm, grid)
        return _normalise(values, grid, f"{prefix}:{peak_nm:g}")
    if prefix == LAMP and number.strip() in LAMPS:
        source = LAMPS[number.strip()]
        return _normalise(_planck(source.kelvin, grid), grid, f"{LAMP}:{source.name}")
    if address := split_address(name):
        if target := named_in_palette(address, "light", folder):
            text, its_folder = target
            return _normalise(light(text, grid, folder=its_folder).values, grid, text)
        return _from_file(os.fspath(Path(folder, name)), grid)
    raise _unknown(name)


def as_light(
    measured: Spectrum, grid: SpectralGrid, label: str = "", *, stacklevel: int = 2
) -> Spectrum:
    """Convert a measured spectrum to a light on the grid: V-weighted mean 1, with its notes.

    ``label`` names it in messages; ``stacklevel`` is for warnings, counted from here. Raises
    SpectrumError if the power is negative or not visible, or the grid is not covered.
    """
    label = label or f"light {measured.name!r}"
    # A spectrometer's dark noise is slightly negative; a wrong column may be far below 0.
    peak = float(np.abs(measured.values).max())
    if measured.values.min() < -0.01 * peak:
        worst = int(measured.values.argmin())
        raise SpectrumError(
            f"{label}: power {measured.values[worst]:g} at {measured.wavelengths_nm[worst]:g} nm "
            "is negative; a light's values are 0 or more"
        )
    # Sums of values near the limits of float64 would overflow or vanish unless the peak is 1.
    values = resample(measured, grid, label, unit=peak or 1.0, stacklevel=stacklevel)
    values /= np.abs(values).max() or 1.0
    return replace(_normalise(values, grid, measured.name, label), notes=measured.notes)


def _from_file(path: str, grid: SpectralGrid) -> Spectrum:
    # stacklevel: the caller of `light` is four calls up from `as_light`.
    return as_light(read_spectrum(path, kind="emissive"), grid, path, stacklevel=5)


def _unknown(name: str, context: str = "") -> SpectrumError:
    lamps = [f"{LAMP}:{key}" for key in LAMPS]
    if fold_name(name).startswith(f"{LAMP}:"):
        return SpectrumError(
            f"light {name!r}{context} is unknown; {nearest(name, lamps)}known: {', '.join(lamps)}",
            code="unknown",
        )
    kelvin = re.fullmatch(r"(\d{3,5}) ?[kK]", name.strip())
    meant = f"did you mean 'daylight:{kelvin[1]}' or 'planck:{kelvin[1]}'? " if kelvin else ""
    if peak := re.fullmatch(r"([4-6]\d\d|700) ?nm", name.strip()):
        meant = f"did you mean 'led:{peak[1]}'? "
    return SpectrumError(
        f"light {name!r}{context} is unknown; {meant or nearest_light(name)}"
        "other forms: planck:3200, daylight:6500, lamp:candle-1900, led:450, laser:488, "
        f"{FILE_FORMS}",
        code="unknown",
    )


def _normalise(
    values: NDArray[np.float64], grid: SpectralGrid, name: str, label: str = ""
) -> Spectrum:
    power = light_power(values, grid, label or f"light {name!r}")
    return Spectrum(grid.wavelengths_nm, power / light_level(power, grid), name)


def _planck(kelvin: float, grid: SpectralGrid) -> NDArray[np.float64]:
    w = np.arange(grid.start_nm - grid.step_nm, grid.stop_nm + grid.step_nm + 0.5, 0.5)
    # Relative to 560 nm, because at 500 K the plain formula underflows in the blue.
    exponent = C2_NM_K / (kelvin * w) - C2_NM_K / (kelvin * 560.0)
    floor = np.exp(-C2_NM_K / (kelvin * 560.0))
    return grid.band_means(w, (560.0 / w) ** 5 / (np.exp(np.minimum(exponent, 600.0)) - floor))


def _laser(nm: float, grid: SpectralGrid) -> NDArray[np.float64]:
    """Return a line, shared by the two bands around it so that its mean wavelength is kept."""
    return np.maximum(0.0, 1.0 - np.abs(grid.wavelengths_nm - nm) / grid.step_nm)


def _led(peak_nm: float, grid: SpectralGrid) -> NDArray[np.float64]:
    """Return the band means of a Gaussian of an LED's width."""
    wavelengths = np.arange(300.0, 831.0)
    values = np.exp(-4.0 * np.log(2.0) * ((wavelengths - peak_nm) / _LED_WIDTH_NM) ** 2)
    return extended_band_means(wavelengths, values, grid)


def _daylight(kelvin: float, grid: SpectralGrid) -> NDArray[np.float64]:
    x, y = _daylight_locus(kelvin)
    M = 0.0241 + 0.2562 * x - 0.7341 * y
    M1 = round((-1.3515 - 1.7703 * x + 5.9114 * y) / M, 3)
    M2 = round((0.0300 - 31.4424 * x + 30.0717 * y) / M, 3)
    (nm, S0), (_, S1), (_, S2) = (daylight_components()[name] for name in ("S0", "S1", "S2"))
    return extended_band_means(nm, S0 + M1 * S1 + M2 * S2, grid)


def _daylight_locus(kelvin: float) -> tuple[float, float]:
    """Return x, y of a phase of daylight (CIE 15:2018, eq. 4.9-4.11)."""
    if kelvin <= 7000:
        x = -4.607e9 / kelvin**3 + 2.9678e6 / kelvin**2 + 0.09911e3 / kelvin + 0.244063
    else:
        x = -2.0064e9 / kelvin**3 + 1.9018e6 / kelvin**2 + 0.24748e3 / kelvin + 0.23704
    return x, -3.000 * x * x + 2.870 * x - 0.275
