"""Fluorescent materials: fluorophores by name, and those of FPbase's files.

    published numbers, FILE.csv -> [fluorophores] -> reflectances

References
----------
[1] Siano & Metzler (1969), "Band Shapes of the Electronic Spectra of Complex Molecules with
    Log-Normal Curves", Journal of Chemical Physics 51, 1856-1861.
[2] Lambert (2019), "FPbase: a community-editable fluorescent protein database", Nature Methods 16.
"""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError, VolspecWarning, nearest
from volspec.spectra.files.tables import file_content, fold_name, keep_note, read_number
from volspec.spectra.fluorescence import Fluorescence
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.spectrum import Spectrum

Array = NDArray[np.float64]
FLUOROPHORE = "fluorophore"
# Bands of fluorophores: near ultraviolet to the end of the visible.
_FINE = SpectralGrid(300.0, 830.0, 2.0)


@dataclass(frozen=True, slots=True)
class Fluorophore:
    """Numbers of a fluorophore: peaks and full widths at half maximum, nm, and quantum yield.

    Peaks and yield are as commonly tabulated; the source is the yield's. Widths are those of
    FPbase's measured spectra [2], but rough for quinine, rhodamine 6G and mTagBFP2. The bands are
    log-normal [1], with the longer tail of the excitation towards the blue and of the emission
    towards the red.
    """

    excitation_nm: float
    emission_nm: float
    widths_nm: tuple[float, float]
    quantum_yield: float
    source: str

    def fluorescence(self) -> Fluorescence:
        """Return the fluorescence where all light at the peak of the excitation is absorbed."""
        w = _FINE.wavelengths_nm
        excitation = _log_normal(w, self.excitation_nm, self.widths_nm[0], 1 / _SKEW)
        emission = _log_normal(w, self.emission_nm, self.widths_nm[1], _SKEW)
        return Fluorescence.of(Spectrum(w, excitation), Spectrum(w, emission), self.quantum_yield)


# Half-width on the side of a band's longer tail by that on the other.
_SKEW = 1.6
_HANDBOOK = "Molecular Probes Handbook, 11th ed. (2010)"
FLUOROPHORES: Mapping[str, Fluorophore] = MappingProxyType(
    {
        "quinine sulfate": Fluorophore(
            348, 451, (55, 90), 0.546, "Melhuish (1961), in 0.5 M H2SO4"
        ),
        "mTagBFP2": Fluorophore(399, 454, (60, 60), 0.64, "Subach et al. (2011), PLoS ONE 6"),
        "mTurquoise2": Fluorophore(
            434, 474, (65, 64), 0.93, "Goedhart et al. (2012), Nat. Commun."
        ),
        "EGFP": Fluorophore(488, 507, (54, 32), 0.60, "Patterson et al. (1997), Biophys. J. 73"),
        "fluorescein": Fluorophore(
            490, 514, (36, 41), 0.93, "Sjöback et al. (1995), Spectrochim. A 51"
        ),
        "Alexa Fluor 488": Fluorophore(495, 519, (36, 41), 0.92, _HANDBOOK),
        "rhodamine 6G": Fluorophore(530, 555, (42, 38), 0.95, "Kubin & Fletcher (1982), J. Lumin."),
        "tdTomato": Fluorophore(554, 581, (62, 66), 0.69, "Shaner et al. (2004), Nat. Biotech. 22"),
        "Alexa Fluor 546": Fluorophore(556, 573, (30, 34), 0.79, _HANDBOOK),
        "Alexa Fluor 568": Fluorophore(578, 603, (58, 45), 0.69, _HANDBOOK),
        "mCherry": Fluorophore(587, 610, (65, 57), 0.22, "Shaner et al. (2004), Nat. Biotech. 22"),
        "Alexa Fluor 594": Fluorophore(590, 617, (44, 49), 0.66, _HANDBOOK),
        "Alexa Fluor 647": Fluorophore(650, 668, (37, 36), 0.33, _HANDBOOK),
    }
)


@lru_cache(maxsize=64)
def named_fluorescence(name: str) -> tuple[str, Fluorescence]:
    """Return a shipped fluorophore's full name and fluorescence; any case.

    Raises SpectrumError if there is none of the name.
    """
    names = {fold_name(fluor): fluor for fluor in FLUOROPHORES}
    if fold_name(name) not in names:
        raise SpectrumError(
            f"fluorophore {name!r} is unknown; {nearest(name, FLUOROPHORES)}"
            f"known: {', '.join(FLUOROPHORES)}; others from FPbase's FILE.csv#name",
            code="unknown",
        )
    full_name = names[fold_name(name)]
    return full_name, FLUOROPHORES[full_name].fluorescence()


def _log_normal(w: Array, peak: float, width: float, skew: float) -> Array:
    """Return a band of height 1 with its full width at half maximum; ``skew`` is right by left."""
    # Wavelength from the peak, in widths, as in [1]; 0 beyond the shorter tail's end.
    x = (w - peak) / width * (skew**2 - 1) / skew + 1
    inside = x > 0
    values = np.zeros_like(w)
    values[inside] = np.exp(-math.log(2) * (np.log(x[inside]) / math.log(skew)) ** 2)
    return values


# Ends of FPbase's column names: "EGFP ex", "EGFP em".
_ENDS = re.compile(r"(.*?)[ _-]*\b(ex|abs|em|excitation|absorption|emission)\.?", re.IGNORECASE)


def fluorescence_in_file(path: Path, name: str) -> tuple[str, Fluorescence] | None:
    """Return a fluorophore of FPbase's CSV [2], whose columns are ``NAME ex`` and ``NAME em``.

    ``name`` may be empty if the file has one. The yield is that of a comment, ``# NAME quantum
    yield: 0.6`` or ``# quantum yield: 0.6``; else 1, with a VolspecWarning. None if the file has no
    such columns, or a column of just this name. Raises SpectrumError if a fluorophore is damaged.
    """
    if path.suffix.lower() != ".csv" or not path.is_file():
        return None
    lines = file_content(str(path)).decode("utf-8-sig", "replace").splitlines()
    data = [line for line in lines if line.strip() and not line.startswith("#")]
    separator = max(",;\t", key=(data[0] if data else "").count)
    rows = list(csv.reader(data, delimiter=separator))
    columns = _columns(rows[0] if rows else [], path)
    if name:
        fluor = next((column for column in columns if fold_name(column) == fold_name(name)), None)
    else:  # of other files, a column may end in "em" by chance
        pairs = [column for column, kinds in columns.items() if len(kinds) == 2]
        fluor = pairs[0] if len(pairs) == 1 else None
    if fluor is None:
        return None
    if missing := {"excitation", "emission"} - columns[fluor].keys():
        raise SpectrumError(
            f"{path}: {fluor!r} has no {missing.pop()}; a fluorophore needs two columns, "
            f"'{fluor} ex' and '{fluor} em'",
            code="missing",
        )
    notes: dict[str, str] = {}
    for line in lines:
        keep_note(line, notes)
    try:
        excitation, emission = (
            _band(rows, columns[fluor][kind], f"{fluor} {kind}")
            for kind in ("excitation", "emission")
        )
        quantum_yield = _quantum_yield(notes, fluor, path)
        return fluor, Fluorescence.of(excitation, emission, quantum_yield)
    except SpectrumError as error:
        raise error.within(f"{path}: {fluor}") from None


def _columns(header: list[str], path: Path) -> dict[str, dict[str, int]]:
    """Return the columns of excitation and emission by the fluorophores' names."""
    columns: dict[str, dict[str, int]] = {}
    for column, cell in enumerate(header):
        if column and (match := _ENDS.fullmatch(cell.strip())):
            kind = "emission" if match[2].lower().startswith("em") else "excitation"
            kinds = columns.setdefault(match[1].strip(), {})
            if kind in kinds:
                raise SpectrumError(
                    f"{path}: two columns are the {kind} of {match[1]!r}; leave one",
                    code="duplicate",
                )
            kinds[kind] = column
    return columns


def _band(rows: list[list[str]], column: int, name: str) -> Spectrum:
    """Return a column on the bands of fluorophores, 0 where its cells are empty or end."""
    w: list[float] = []
    values: list[float] = []
    for number, row in enumerate(rows[1:], start=2):
        if cell := row[column].strip() if len(row) > column else "":
            try:
                w.append(read_number(row[0]))
                values.append(read_number(cell))
            except ValueError:
                raise SpectrumError(
                    f"row {number} of {name}: {cell!r} at {row[0]!r} is no number; write one or "
                    "leave the cell empty",
                    code="damaged",
                ) from None
    spectrum = Spectrum(np.array(w), np.maximum(values, 0.0), name)
    nm = _FINE.wavelengths_nm
    fine = np.interp(nm, spectrum.wavelengths_nm, spectrum.values, left=0.0, right=0.0)
    return Spectrum(nm, fine, name)


def _quantum_yield(notes: Mapping[str, str], name: str, path: Path) -> float:
    for key in (f"{name} quantum yield".lower(), "quantum yield"):
        if key in notes:
            try:
                return read_number(notes[key])
            except ValueError:
                raise SpectrumError(
                    f"{key} {notes[key]!r} is no number; give 0 to 1, as 0.6"
                ) from None
    warnings.warn(
        f"{path}: no quantum yield of {name}, taken as 1; write # {name} quantum yield: 0.6",
        VolspecWarning,
        stacklevel=4,
    )
    return 1.0
