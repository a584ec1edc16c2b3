"""Named spectra of one file: samples of a chart, objects of an exchange file, a library's entries.

spectrum, tables -> [samples] -> cgats, cxf, envi -> files
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra.files.tables import choose_name, require_nanometres
from volspec.spectra.spectrum import Kind, Spectrum

QUANTITY = "spectral quantity"
"""Note that declares what a file's values are."""
# Quantities that a kind cannot have; `relative` and `other` fit both kinds.
_REFUSED = {
    "emissive": ("reflectance", "transmittance", "absorptance", "r-factor", "t-factor"),
    "reflective": ("flux", "intensity", "irradiance", "radiance", "exitance", "absorptance"),
}
_FRACTIONS = ("reflectance", "transmittance")
# Reflectances above are percentages: fluorescent paper reflects up to twice the light.
_MAX_FRACTION = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One spectrum of a file, in its own units."""

    name: str
    wavelengths_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    id: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def quantity(self) -> str:
        """The declared spectral quantity; "" if the file has none."""
        return self.notes.get(QUANTITY, "")


@dataclass(frozen=True, slots=True, eq=False)
class SampleSet:
    """Samples of one file, chosen by name, by id or by number from 1."""

    path: str
    noun: str
    """One of them in messages: "sample", "object"."""
    samples: tuple[Sample, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each sample."""
        return tuple(sample.name for sample in self.samples)

    def for_kind(self, kind: Kind | None) -> SampleSet:
        """Return the samples that fit a kind, all if none does; reflectances are made fractions.

        A file states either fractions or percentages: one value above 2 divides all by 100. Values
        of an undeclared quantity are left unchanged, unless the kind is reflective.
        """
        kept = [s for s in self.samples if kind is None or fits(s.quantity, kind)]
        kept = kept or list(self.samples)
        reflective = [
            s.quantity in _FRACTIONS or (kind == "reflective" and not s.quantity) for s in kept
        ]
        maximum = max(
            (s.values.max() for s, is_one in zip(kept, reflective, strict=True) if is_one),
            default=0.0,
        )
        if _MAX_FRACTION < maximum < np.inf:
            kept = [
                replace(s, values=s.values / 100.0) if is_one else s
                for s, is_one in zip(kept, reflective, strict=True)
            ]
        return replace(self, samples=tuple(kept))

    def spectrum(self, selector: str = "") -> Spectrum:
        """Return one sample by name (any case), id or number from 1; "" if there is only one."""
        ids = [sample.id for sample in self.samples]
        sample = self.samples[choose_name(self.path, selector, self.names, ids, noun=self.noun)]
        if not np.isfinite(sample.values).all():
            k = int(np.argmin(np.isfinite(sample.values)))
            raise SpectrumError(
                f"{self.path}: {self.noun} {sample.name!r}: the value at "
                f"{sample.wavelengths_nm[k]:g} nm is {sample.values[k]:g}, not finite; measure "
                "it again or choose another"
            )
        require_nanometres(sample.wavelengths_nm, self.path)
        name = Path(self.path).stem + (f"#{sample.name}" if selector else "")
        try:
            return Spectrum(sample.wavelengths_nm, sample.values, name, sample.notes)
        except SpectrumError as error:
            raise error.within(self.path) from None


def fits(quantity: str, kind: Kind) -> bool:
    """Return True if a declared quantity can be that of a kind.

    >>> fits("radiance", "emissive"), fits("radiance", "reflective"), fits("", "reflective")
    (True, False, True)
    """
    return quantity.lower().removeprefix("spectral ") not in _REFUSED[kind]
