"""Materials as channels: exact colour under any light, and reflectances that can be edited.

    materials -> [materials] -> transfer function, raycast, relight

With achromatic opacity a ray accumulates *how much* of each material it met. These weights are
the channels; under a light the display matrix contains the XYZ of every material. Nothing is
projected: the colours are those of the full spectra, and a new reflectance changes the matrix, not
the picture, so that no new cast is needed.

References
----------
[1] Bergner, Drew, Moeller (2009), "A Tool to Create Illuminant and Reflectance Spectra for
    Light-Driven Graphics and Visualization", ACM TOG 28(1), section 2 (post-illumination).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis import display, storage
from volspec.basis.base import (
    basis_errors,
    require_channels,
    require_materials,
    require_observer,
    require_text,
)
from volspec.basis.model import SpectralBasis
from volspec.basis.report import ReportedBasis
from volspec.errors import BasisError, nearest
from volspec.spectra import (
    DEFAULT_GRID,
    Fluorescence,
    Observer,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light_leaving,
    light_power,
    real_array,
    reflectance_values,
)

Array = NDArray[np.float64]
METHOD = storage.MATERIALS


@dataclass(frozen=True, slots=True, eq=False)
class MaterialBasis(ReportedBasis):
    """K materials as channels, and a channel of white for highlights.

    Materials may be fluorescent; no other basis shows what they emit.

    Parameters
    ----------
    materials : {name: Spectrum}
        Reflectances by their names in the transfer function; resampled to the grid.
    name : str
    grid : SpectralGrid
        N bands.
    observer_deg : Observer
        Standard observer.

    Raises
    ------
    BasisError
        If there is no material, a reflectance is impossible (`reflectance_values`) or does not
        cover the grid, the observer is unknown, or a name is not text.

    Examples
    --------
    >>> from volspec.spectra import light, reflectance
    >>> basis = MaterialBasis({"rotor": reflectance("copper"), "case": reflectance("iron")})
    >>> basis.size, basis.white.tolist()
    (3, [0.0, 0.0, 1.0])
    >>> half_copper = basis.xyz([0.5, 0, 0], light("A"))
    >>> gold = basis.with_reflectances({"rotor": reflectance("gold")})
    >>> bool(gold.xyz([0.5, 0, 0], light("A"))[1] > half_copper[1])
    True
    """

    materials: Mapping[str, Spectrum]
    name: str = METHOD
    grid: SpectralGrid = DEFAULT_GRID
    observer_deg: Observer = 2
    method: str = field(default=METHOD, init=False)
    trained_on: str = field(init=False)
    """Names of the materials."""

    multiplies = False

    def __post_init__(self) -> None:
        require_materials(self.materials, "material basis")
        for name, label in [
            (self.name, "name"),
            *((m, "name of a material") for m in self.materials),
        ]:
            if not require_text(name, f"material basis: {label}"):
                raise BasisError(f"material basis: {label} is empty; give one", code="missing")
        observer_deg = require_observer(self.observer_deg, "material basis")
        object.__setattr__(self, "observer_deg", observer_deg)
        rows = {name: self._resample(name, s) for name, s in self.materials.items()}
        object.__setattr__(self, "materials", MappingProxyType(rows))
        object.__setattr__(self, "trained_on", ", ".join(rows))

    def __repr__(self) -> str:
        return f"MaterialBasis({', '.join(self.materials)})"

    @property
    def size(self) -> int:
        """Number of channels: the materials and white."""
        return len(self.materials) + 1

    @property
    def white(self) -> Array:
        """(K + 1,) channels of the perfect diffuser: 0 of every material, 1 of white."""
        return np.eye(self.size)[-1]

    def channels_for_materials(self, materials: Mapping[str, Spectrum]) -> Array:
        """Return (L, K + 1) channels of some of the basis' materials, by name.

        Raises
        ------
        BasisError
            If there are none, a name is unknown, or its reflectance differs from the basis'.
        """
        require_materials(materials, "material basis")
        names = list(self.materials)
        for name, spectrum in materials.items():
            if name not in self.materials:
                raise BasisError(
                    f"material {name!r} is not in the basis; {nearest(name, names)}"
                    f"it holds {', '.join(names)}: make the basis from all materials",
                    code="unknown",
                )
            if not alike(self._resample(name, spectrum), self.materials[name]):
                raise BasisError(
                    f"material {name!r} has another reflectance in the basis; make both the "
                    "same, and change it afterwards with Relighter.set_reflectances",
                    code="conflict",
                )
        return np.eye(self.size)[[names.index(name) for name in materials]]

    def surface_channels(self, surfaces: Sequence[Spectrum]) -> Array:
        """Return (L, K + 1) channels of reflectances that are among the materials.

        Raises BasisError if one is not.
        """
        indices = []
        for surface in surfaces:
            on_grid = surface.on(self.grid)
            match = [k for k, row in enumerate(self.materials.values()) if alike(row, on_grid)]
            if not match:
                raise BasisError(
                    f"report: {surface.name} is not a material of basis {self.name!r}, which holds "
                    f"{', '.join(self.materials)}; it has no channels for others",
                    code="unknown",
                )
            indices.append(match[0])
        return np.eye(self.size)[indices]

    def test_surfaces(self, grid: SpectralGrid) -> tuple[list[Spectrum], list[str]]:
        """Return the materials and their names."""
        return list(self.materials.values()), list(self.materials)

    def synthesise(self, coefficients: ArrayLike) -> Array:
        """Convert (..., K + 1) channels to (..., N) spectra: the mixture itself."""
        return require_channels(self, coefficients) @ self._reflectances()

    def leaving(self, coefficients: ArrayLike, power: Array) -> Array:
        """Return the light (..., N) that channels reflect and emit under light of (N,) power."""
        white = Spectrum(self.grid.wavelengths_nm, np.ones(self.grid.size))
        rows = light_leaving([*self.materials.values(), white], power, self.grid)
        return require_channels(self, coefficients) @ rows

    def colour_matrix(
        self,
        light: Spectrum,
        mode: str = display.DEFAULT_MODE,
        seen_through: Spectrum | None = None,
    ) -> Array:
        """Return (3, K + 1) XYZ of the materials and of white under a light; all modes are exact.

        What fluorescent materials emit is included. ``seen_through`` is a filter between the
        materials and the eye; the white without it has Y = 100.

        Raises
        ------
        BasisError, SpectrumError
            If the mode is unknown; if the light is impossible, see `SpectralBasis.display_matrix`;
            if the filter does not cover the grid.
        """
        display.require_mode(mode)
        E = light_power(light, self.grid)
        Q = colour_matching_functions(self.grid, self.observer_deg)
        filtered = Q if seen_through is None else Q * seen_through.on(self.grid).values
        return np.asarray(filtered @ self.leaving(np.eye(self.size), E).T * (100.0 / (Q[1] @ E)))

    def with_reflectances(self, changes: Mapping[str, Spectrum]) -> MaterialBasis:
        """Replace reflectances of some materials, {name: Spectrum}; the channels stay.

        Raises
        ------
        BasisError
            If a name is unknown, or a reflectance is impossible (`reflectance_values`) or does not
            cover the grid.
        """
        for name in changes:
            if name not in self.materials:
                raise BasisError(
                    f"no material {name!r}; {nearest(name, self.materials)}"
                    f"known: {', '.join(self.materials)}",
                    code="unknown",
                )
        return replace(self, materials={**self.materials, **changes})

    def _numbers(self) -> dict[str, Any]:
        rows = {name: spectrum.values.tolist() for name, spectrum in self.materials.items()}
        numbers: dict[str, Any] = {"materials": rows}
        if emitting := {k: s.fluorescence for k, s in self.materials.items() if s.fluorescence}:
            numbers["fluorescence"] = {k: source.matrix.tolist() for k, source in emitting.items()}
        return numbers

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> MaterialBasis:
        """Invert `to_dict`.

        Raises
        ------
        BasisError
            If the data are not a basis of materials or have another version, a field is missing or
            wrong, or the numbers do not match the fingerprint.
        """
        names = ("name", "materials") if storage.is_material_basis(data) else ("name",)
        head = storage.head_from_dict(data, names)
        if not storage.is_material_basis(data):
            raise BasisError(
                "this is not a basis of materials; use volspec.load_basis or volspec.SpectralBasis",
                code="type",
            )
        if not isinstance(data["materials"], dict):
            raise BasisError(
                "material basis: field 'materials' is not a table of reflectances", code="type"
            )
        matrices = data.get("fluorescence", {})
        if not (isinstance(matrices, dict) and matrices.keys() <= data["materials"].keys()):
            raise BasisError(
                "material basis: field 'fluorescence' is not a table of some of its materials",
                code="type",
            )
        w = head["grid"].wavelengths_nm
        with basis_errors("material basis"):
            emitting = {
                name: Fluorescence(head["grid"], real_array(rows, f"fluorescence of {name!r}"))
                for name, rows in matrices.items()
            }
            rows = {
                name: Spectrum(
                    w,
                    real_array(values, f"values of {name!r}"),
                    name,
                    fluorescence=emitting.get(name),
                )
                for name, values in data["materials"].items()
            }
        basis = cls(rows, data["name"], head["grid"], head["observer_deg"])
        basis._require_unedited(data)
        return basis

    @property
    def fingerprint(self) -> str:
        """Short hash of the grid, the observer, the materials' names and the numbers.

        The basis' own name is left out. Unchanged by save and load.
        """
        digest = hashlib.sha256(f"{self.grid}, {self.observer_deg} degrees".encode())
        for name, spectrum in self.materials.items():
            digest.update(repr(name).encode())
            digest.update(np.ascontiguousarray(spectrum.values, dtype="<f8").tobytes())
            if spectrum.fluorescence:
                digest.update(np.ascontiguousarray(spectrum.fluorescence.matrix, "<f8").tobytes())
        return digest.hexdigest()[:12]

    def _reflectances(self) -> Array:
        """Return the reflectances of the materials and of white, (K + 1, N)."""
        rows = [spectrum.values for spectrum in self.materials.values()]
        return np.array([*rows, np.ones(self.grid.size)])

    def _resample(self, name: str, spectrum: Spectrum) -> Spectrum:
        if not isinstance(spectrum, Spectrum):
            raise BasisError.refused(
                f"material {name!r}",
                spectrum,
                "expected a Spectrum, such as volspec.reflectance('copper')",
                "type",
            )
        with basis_errors():
            values = reflectance_values(spectrum, self.grid, f"material {name!r}")
            fluorescence = spectrum.fluorescence and spectrum.fluorescence.on(self.grid)
        if fluorescence:
            leaving = values + fluorescence.matrix.sum(0)
            if leaving.max() > max(1.0, values.max()) + 1e-6:
                raise BasisError(
                    f"material {name!r} reflects and emits {leaving.max():.3g} of the light at "
                    f"{self.grid.wavelengths_nm[leaving.argmax()]:g} nm; at most 1 can be, lower "
                    "its reflectance or its quantum yield",
                    code="impossible",
                )
        w = self.grid.wavelengths_nm
        return Spectrum(w, values, spectrum.name, spectrum.notes, fluorescence)


def alike(one: Spectrum, other: Spectrum) -> bool:
    """Return True if two materials on one grid reflect and emit alike."""
    if (one.fluorescence is None) != (other.fluorescence is None):
        return False
    pairs = [(one.values, other.values)]
    if one.fluorescence and other.fluorescence:
        pairs.append((one.fluorescence.matrix, other.fluorescence.matrix))
    return all(np.allclose(*pair) for pair in pairs)


Basis = SpectralBasis | MaterialBasis
"""Either kind of basis, as in a coefficient image's header."""


def basis_from_dict(data: Any) -> Basis:
    """Invert either basis' ``to_dict``.

    Raises
    ------
    BasisError
        If the data are not a basis or have another version, or a field is missing or wrong.
    """
    if storage.is_material_basis(data):
        return MaterialBasis.from_dict(data)
    return SpectralBasis.from_dict(data)


def load_basis(name_or_path: str | os.PathLike[str]) -> Basis:
    """Load a shipped basis by name (``"general-7"``), or a file written by ``save``.

    Raises
    ------
    BasisError
        If the name is unknown, or the file is missing or damaged.
    """
    return storage.load(name_or_path, basis_from_dict)
