"""A light or a reflectance: values over wavelength, and checked arrays of them.

grid -> [spectrum] -> photometry, library -> basis
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError, VolspecWarning
from volspec.spectra.datasets import colour_matching_functions, colour_science
from volspec.spectra.fluorescence import Fluorescence
from volspec.spectra.grid import SpectralGrid

Kind = Literal["reflective", "emissive"]
"""Use of a measured spectrum: as a reflectance or transmittance, or as a light."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A sampled function of wavelength; the arrays are read-only copies.

    Parameters
    ----------
    wavelengths_nm : (L,) array
        Strictly increasing, nm, L >= 2.
    values : (L,) array
        Finite. Relative or absolute spectral power for a light, 0..1 for a reflectance.
    name : str
        For messages and legends.
    notes : {str: str}
        Metadata: ``manufacturer``, ``instrument``, ``spectral quantity``, ``designed``, … Keys
        are stored in lower case with single blanks; read-only.
    fluorescence : Fluorescence, optional
        Of a material: light absorbed and emitted at other wavelengths, besides ``values``.

    Raises
    ------
    SpectrumError
        If the arrays do not fit together or have values other than finite numbers, or a note is
        not text with a unique name.

    Notes
    -----
    `on` and multiplication keep notes and fluorescence; a sum has the fluorescence of both sides,
    and only notes equal on both: a lamp's manufacturer did not make the sum. But a sum with a
    designed part is designed.

    Examples
    --------
    >>> s = Spectrum([400, 500, 700], [0.0, 1.0, 1.0], name="step")
    >>> s.on(SpectralGrid(500, 700, 100)).values.tolist()
    [0.875, 1.0, 1.0]
    """

    wavelengths_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    name: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)
    fluorescence: Fluorescence | None = None

    def __post_init__(self) -> None:
        label = f"spectrum {self.name!r}" if self.name else "spectrum"
        for key in ("wavelengths_nm", "values"):
            try:
                array = np.array(getattr(self, key), dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise SpectrumError(
                    f"{label}: {key} are not numbers: {error}", code="type"
                ) from error
            array.flags.writeable = False
            object.__setattr__(self, key, array)
        object.__setattr__(self, "notes", read_only_notes(self.notes, label))
        w, v = self.wavelengths_nm, self.values
        if w.ndim != 1 or w.shape != v.shape or w.size < 2:
            raise SpectrumError(
                f"{label}: wavelengths have shape {w.shape}, values {v.shape}; "
                "expected two equal lengths of at least 2",
                code="shape",
            )
        for key, array in (("wavelength", w), ("value", v)):
            if not np.isfinite(array).all():
                k = int(np.argmin(np.isfinite(array)))
                raise SpectrumError(f"{label}: {key} number {k + 1} is {array[k]}, not finite")
        if not np.all(np.diff(w) > 0):
            k = int(np.argmin(np.diff(w) > 0))
            raise SpectrumError(
                f"{label}: wavelengths must increase strictly, but {w[k]:g} nm is followed by "
                f"{w[k + 1]:g} nm; sort them and remove duplicates"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        # A pickled array can be written to.
        arguments = self.wavelengths_nm, self.values, self.name, self.notes, self.fluorescence
        return Spectrum, arguments

    @property
    def designed(self) -> bool:
        """True if the notes contain ``designed: yes``: computed, not measured."""
        return self.notes.get("designed", "no").casefold() not in ("", "no", "false", "0")

    @property
    def grid(self) -> SpectralGrid:
        """Grid of the samples; raises SpectrumError if they are not equidistant."""
        steps = np.diff(self.wavelengths_nm)
        if np.ptp(steps) > 1e-6:
            raise SpectrumError(
                f"spectrum {self.name!r} is not equidistant (steps {steps.min():g} to "
                f"{steps.max():g} nm); put it on a grid first: spectrum.on(grid)",
                code="conflict",
            )
        start, stop = self.wavelengths_nm[[0, -1]]
        return SpectralGrid(start, stop, (stop - start) / (self.wavelengths_nm.size - 1))

    def on(self, grid: SpectralGrid) -> Spectrum:
        """Return band means on a grid; see `extended_band_means` for the rules and errors."""
        if np.array_equal(self.wavelengths_nm, grid.wavelengths_nm):
            return self
        try:
            values = extended_band_means(self.wavelengths_nm, self.values, grid)
        except SpectrumError as error:
            raise error.within(repr(self.name) if self.name else "") from None
        fluorescence = self.fluorescence and self.fluorescence.on(grid)
        return Spectrum(grid.wavelengths_nm, values, self.name, self.notes, fluorescence)

    def __mul__(self, factor: float) -> Spectrum:
        if not isinstance(factor, int | float | np.integer | np.floating):
            return NotImplemented
        fluorescence = self.fluorescence and self.fluorescence * factor
        return replace(self, values=self.values * factor, fluorescence=fluorescence)

    __rmul__ = __mul__

    def __add__(self, other: Spectrum) -> Spectrum:
        if not isinstance(other, Spectrum):
            return NotImplemented
        if self.wavelengths_nm.shape != other.wavelengths_nm.shape or not np.allclose(
            self.wavelengths_nm, other.wavelengths_nm, rtol=0, atol=1e-6
        ):
            raise SpectrumError(
                f"cannot add {self.name!r} and {other.name!r}: their wavelengths differ; "
                "put both on one grid first: spectrum.on(grid)",
                code="conflict",
            )
        name = "+".join(n for n in (self.name, other.name) if n)
        notes = dict(self.notes.items() & other.notes.items())
        for part in (self, other):
            if part.designed:
                notes["designed"] = part.notes["designed"]
        parts = [part.fluorescence for part in (self, other) if part.fluorescence]
        fluorescence = reduce(add, parts) if parts else None
        return Spectrum(self.wavelengths_nm, self.values + other.values, name, notes, fluorescence)

    @classmethod
    def from_colour(cls, distribution: Any) -> Spectrum:
        """Convert a ``colour.SpectralDistribution``."""
        return cls(distribution.wavelengths, distribution.values, str(distribution.name))

    def to_colour(self) -> Any:
        """Return a ``colour.SpectralDistribution``."""
        data = dict(zip(self.wavelengths_nm.tolist(), self.values.tolist(), strict=True))
        return colour_science().SpectralDistribution(data, name=self.name)


def read_only_notes(notes: Mapping[str, str], label: str) -> Mapping[str, str]:
    """Return a read-only copy of notes, keys in lower case with single blanks.

    Raises SpectrumError if a note is not text, or a key is empty or duplicate.
    """
    checked: dict[str, str] = {}
    for key, value in notes.items():
        if not (isinstance(key, str) and isinstance(value, str)):
            raise SpectrumError(
                f"{label}: note {key!r}: {value!r}; notes are text, use str(…)", code="type"
            )
        short = " ".join(key.split()).lower()
        if not short or short in checked:
            fault = "appears twice" if short else "is empty"
            raise SpectrumError(
                f"{label}: the name of a note, {key!r}, {fault}; choose another", code="duplicate"
            )
        checked[short] = value
    return MappingProxyType(checked)


# Band means of a measured table may fall this far below 0, as a fraction of the peak.
_ROUNDING = 1e-6
# A larger value is not a fluorescent reflectance but a percentage, or a light.
_MAX_REFLECTED = 2.0
# Less light than this cannot be scaled to Y = 100.
_MIN_LIGHT = 1e-300
_FULL_RANGE_NM = (360.0, 830.0)


def extended_band_means(
    wavelengths_nm: NDArray[np.float64], values: NDArray[np.float64], grid: SpectralGrid
) -> NDArray[np.float64]:
    """Return band means of a table, extrapolated by its end values.

    Extrapolates if each colour-matching function has less than 1 % of its area in the missing
    range (400-700 nm data pass, 350-560 nm data do not); otherwise raises the grid's error.
    """
    low, high = wavelengths_nm[0], wavelengths_nm[-1]
    if low <= grid.start_nm and high >= grid.stop_nm:
        return grid.band_means(wavelengths_nm, values)
    full = SpectralGrid(*_FULL_RANGE_NM, 1.0)
    Q = colour_matching_functions(full)
    missing = (full.wavelengths_nm < low) | (full.wavelengths_nm > high)
    if (Q[:, missing].sum(1) < 0.01 * Q.sum(1)).all():
        pad = (int(low > grid.start_nm), int(high < grid.stop_nm))
        wavelengths_nm = np.concatenate(
            [[grid.start_nm] * pad[0], wavelengths_nm, [grid.stop_nm] * pad[1]]
        )
        values = np.pad(values, [pad] + [(0, 0)] * (values.ndim - 1), mode="edge")
    return grid.band_means(wavelengths_nm, values)


def stack(
    spectra: Spectrum | Sequence[Spectrum] | ArrayLike, grid: SpectralGrid
) -> NDArray[np.float64]:
    """Stack spectra into one (..., N) array on a grid; for arrays only the shape is checked."""
    if isinstance(spectra, Spectrum):
        return spectra.on(grid).values
    if isinstance(spectra, list | tuple) and any(isinstance(s, Spectrum) for s in spectra):
        rows = []
        for number, spectrum in enumerate(spectra, start=1):
            try:
                row = stack(spectrum, grid)
            except SpectrumError as error:
                named = isinstance(spectrum, Spectrum) and spectrum.name
                raise error.within("" if named else f"number {number}") from None
            rows.append(row)
            if row.shape != rows[0].shape:
                raise SpectrumError(
                    f"spectrum number {number} is an array of shape {row.shape}; give one "
                    "spectrum at a time",
                    code="shape",
                )
        return np.array(rows)
    array = real_array(spectra, "spectra")
    if array.ndim == 0 or array.shape[-1] != grid.size:
        raise SpectrumError(
            f"spectra have shape {array.shape}; expected (..., {grid.size}) on the grid {grid}. "
            "Were they sampled on another grid?",
            code="shape",
        )
    finite = np.isfinite(array).all(-1)
    if not finite.all():
        which = f"spectrum number {int(finite.argmin()) + 1} has" if finite.ndim else "spectra have"
        raise SpectrumError(f"{which} values that are not finite (NaN or infinity)")
    return array


def light_leaving(
    spectra: Spectrum | Sequence[Spectrum] | ArrayLike,
    power: NDArray[np.float64],
    grid: SpectralGrid,
) -> NDArray[np.float64]:
    """Return the light (..., N) that materials reflect and emit under light of (N,) power."""
    if isinstance(spectra, Spectrum):
        return light_leaving([spectra], power, grid)[0]
    leaving = stack(spectra, grid) * power
    for row, spectrum in enumerate(spectra if isinstance(spectra, list | tuple) else ()):
        if isinstance(spectrum, Spectrum) and spectrum.fluorescence:
            leaving[row] += spectrum.fluorescence.on(grid).emitted(power)
    return leaving


def require_no_emission(spectra: object, label: str) -> None:
    """Raise SpectrumError for a fluorescent spectrum, where only reflected light is computed."""
    for spectrum in spectra if isinstance(spectra, list | tuple) else [spectra]:
        if isinstance(spectrum, Spectrum) and spectrum.fluorescence:
            raise SpectrumError(
                f"{label}: {spectrum.name or 'a spectrum'} emits light, which is not computed here",
                "give one that only reflects",
                code="unsupported",
            )


def real_array(values: Any, label: str) -> NDArray[np.float64]:
    """Convert numbers to float64; text is refused, even if it could be parsed.

    ``label`` names the values in a SpectrumError, in the plural.
    """
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):
        raise SpectrumError(
            f"{label} are not a regular array of numbers: rows differ", code="shape"
        ) from None
    if array.dtype.kind not in "biuf":
        raise SpectrumError(
            f"{label} are not a regular array of numbers: {values!r:.40}; give a list or an array",
            code="type",
        )
    return array.astype(np.float64)


def light_power(
    light: Spectrum | ArrayLike, grid: SpectralGrid, label: str = ""
) -> NDArray[np.float64]:
    """Return the power (N,) of one light on a grid, checked to be visible and not negative.

    Values down to a millionth of the peak below 0 become 0. ``label`` names the light in messages,
    by default with its own name. Raises SpectrumError if ``light`` is more than one light, does not
    cover the grid, has negative power or no luminous energy.
    """
    E = stack(light, grid)
    name = f"light {light.name!r}" if isinstance(light, Spectrum) and light.name else "light"
    label = label or name
    if E.ndim != 1:
        raise SpectrumError(f"{label} has shape {E.shape}; give one light at a time", code="shape")
    lowest = int(E.argmin())
    if E[lowest] < -_ROUNDING * np.abs(E).max():
        raise SpectrumError(
            f"{label} has negative power, {E[lowest]:g} at {grid.wavelengths_nm[lowest]:g} nm; "
            "a light's values are 0 or more"
        )
    E = np.maximum(E, 0.0)
    total = float(colour_matching_functions(grid)[1] @ E)
    if not total > _MIN_LIGHT:
        raise SpectrumError(
            f"{label} has no luminous energy (sum E V = {total:g}); "
            f"give power within {grid.start_nm:g}-{grid.stop_nm:g} nm, or leave it out",
            code="conflict",
        )
    return E


def reflectance_values(
    spectra: Spectrum | Sequence[Spectrum] | ArrayLike, grid: SpectralGrid, label: str
) -> NDArray[np.float64]:
    """Return reflectances (..., N) on a grid, checked to be 0 to 1 (2 with a VolspecWarning).

    Values down to a millionth of the peak below 0 become 0. ``label`` names them in messages.
    Raises SpectrumError if a spectrum does not cover the grid, is negative, or is above 2, which
    means a percentage or a light. Only fluorescence is above 1.
    """
    try:
        S = stack(spectra, grid)
    except SpectrumError as error:
        raise error.within(label) from None
    rows = S.reshape(-1, grid.size)
    names = [getattr(s, "name", "") for s in spectra] if isinstance(spectra, list | tuple) else []

    def text(row: int, band: int) -> str:
        which = f": number {row + 1}" if S.ndim > 1 else ""
        which += f" ({names[row]})" if S.ndim == 2 and names and names[row] else ""
        return f"{label}{which} reflects {rows[row, band]:g} at {grid.wavelengths_nm[band]:g} nm"

    negative = rows < -_ROUNDING * np.abs(rows).max(1, keepdims=True)
    if negative.any():
        row = int(negative.any(1).argmax())
        raise SpectrumError(f"{text(row, int(rows[row].argmin()))}; a reflectance is 0 or more")
    row, band = divmod(int(rows.argmax()), grid.size) if rows.size else (0, 0)
    largest = rows[row, band] if rows.size else 0.0
    if largest > _MAX_REFLECTED:
        raise SpectrumError(
            f"{text(row, band)}; a reflectance is 0 to 1: divide percentages by 100. Is it a light?"
        )
    if largest > 1 + _ROUNDING:
        warnings.warn(
            f"{text(row, band)}, more than falls on it; right only if it is fluorescent",
            VolspecWarning,
            stacklevel=3,
        )
    return np.where(S > 0, S, 0.0)
