"""Base class of bases: colours of channels, file; and checks of a basis' data.

    [base] -> report -> SpectralBasis, MaterialBasis

Of either kind, the pipeline uses only this, `white`, `channels_for_materials`, `synthesise` and
`fingerprint`.
"""

from __future__ import annotations

import os
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis import storage
from volspec.basis.display import DEFAULT_MODE
from volspec.errors import BasisError, SpectrumError
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    check_observer,
    real_array,
    reflectance_values,
)


class StoredBasis(ABC):
    """Channels, with their colours and JSON file."""

    __slots__ = ()

    name: str
    method: str
    grid: SpectralGrid
    trained_on: str
    observer_deg: Observer

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of channels, m."""

    @property
    @abstractmethod
    def fingerprint(self) -> str:
        """Short hash of the numbers; unchanged by save and load."""

    @abstractmethod
    def colour_matrix(
        self, light: Spectrum, mode: str = DEFAULT_MODE, seen_through: Spectrum | None = None
    ) -> NDArray[Any]:
        """Return the (3, m) matrix from channels to XYZ under a light, Y = 100 for white.

        ``seen_through`` is a filter in the eye's path; without it the white has Y = 100.
        """

    @abstractmethod
    def synthesise(self, coefficients: ArrayLike) -> NDArray[Any]:
        """Convert (..., m) channels to (..., N) spectra."""

    def leaving(self, coefficients: ArrayLike, power: NDArray[Any]) -> NDArray[Any]:
        """Return the light (..., N) of channels under light of (N,) power, the best estimate."""
        return self.synthesise(coefficients) * power

    @abstractmethod
    def _numbers(self) -> dict[str, Any]:
        """Return the fields of `to_dict` that only this kind of basis has."""

    def to_dict(self) -> dict[str, Any]:
        """Return JSON types with a format version; numbers keep every digit."""
        words = {} if self.method == storage.MATERIALS else {"trained_on": self.trained_on}
        return {
            "format": storage.FORMAT,
            "version": storage.FORMAT_VERSION,
            "name": self.name,
            "method": self.method,
            **words,
            "fingerprint": self.fingerprint,
            "observer_deg": self.observer_deg,
            "grid_nm": [self.grid.start_nm, self.grid.stop_nm, self.grid.step_nm],
            **self._numbers(),
        }

    @classmethod
    @abstractmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Invert `to_dict`."""

    def _require_unedited(self, data: Mapping[str, Any]) -> None:
        """Raise BasisError if the fingerprint does not match; the first files had none."""
        stored = data.get("fingerprint", self.fingerprint)
        if stored != self.fingerprint:
            raise BasisError(
                f"its numbers, grid and observer have the fingerprint {self.fingerprint}, but it "
                f"says {stored!r:.40}: were the numbers edited? Fit it again",
                code="damaged",
            )

    def xyz(self, coefficients: ArrayLike, light: Spectrum) -> NDArray[Any]:
        """Return the colour of reflectance coefficients under a light, in the default mode.

        Parameters
        ----------
        coefficients : (..., m) array
            Reflectances (or a coefficient image's pixels) under flat white.
        light : Spectrum

        Returns
        -------
        (..., 3) float64
            XYZ, Y = 100 for a perfect diffuser.

        Raises
        ------
        BasisError, SpectrumError
            If the last axis is not m finite numbers; if the light is invisible or does not cover
            the grid.
        """
        return require_channels(self, coefficients) @ self.colour_matrix(light).T

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .json file, whole or not at all.

        Raises
        ------
        BasisError, InputError
            If the name does not end in .json, or the file cannot be written.
        """
        storage.write(path, self.to_dict())

    @classmethod
    def load(cls, name_or_path: str | os.PathLike[str]) -> Self:
        """Load a shipped basis by name (``"general-7"``), or a file written by `save`.

        Raises
        ------
        BasisError
            If the name is unknown, or the file is missing or damaged.
        """
        return storage.load(name_or_path, cls.from_dict)


Array = NDArray[np.float64]

ROUND_TRIP_TOLERANCE = 1e-5
"""Largest error of channels after synthesis and analysis: rounding if B is large."""
_WHITE_TOLERANCE = 1e-6
# Control characters, surrogates and line breaks.
_UNPRINTABLE = ("Cc", "Cs", "Zl", "Zp")


@contextmanager
def basis_errors(label: str = "") -> Iterator[None]:
    """Turn a SpectrumError inside into a BasisError."""
    try:
        yield
    except SpectrumError as error:
        raise error.within(label, BasisError) from None


def require_text(value: Any, label: str) -> str:
    """Return a text, or raise BasisError if it is not text or has control characters."""
    if not isinstance(value, str):
        raise BasisError.refused(label, value, "expected text", "type")
    if any(unicodedata.category(character) in _UNPRINTABLE for character in value):
        raise BasisError.refused(label, value, "leave out its control characters", "syntax")
    return value


def require_observer(observer_deg: object, label: str) -> Observer:
    """Return the observer, a number as a plain int; raise BasisError if there is no such one."""
    with basis_errors(label):
        return check_observer(observer_deg)


def require_matrices(
    matrices: Mapping[str, ArrayLike], grid: SpectralGrid, label: str
) -> dict[str, Array]:
    """Return A, B and D by field name: read-only float64 copies that match.

    Raises BasisError if shapes do not match, a value is not finite, flat white changes, or A B is
    not I.
    """
    arrays: dict[str, Array] = {}
    for field, matrix in matrices.items():
        try:
            array = real_array(matrix, field)
        except SpectrumError:
            raise BasisError(f"{label}: {field} is not an array of numbers", code="type") from None
        if array.ndim != 2 or not np.isfinite(array).all():
            raise BasisError(f"{label}: {field} is not a matrix of finite numbers", code="range")
        array.flags.writeable = False
        arrays[field] = array
    m, N = arrays["analysis"].shape[0], grid.size
    for field, expected in zip(arrays, ((m, N), (N, m), (3, m)), strict=True):
        shape = arrays[field].shape
        if shape != expected or m < 1:
            raise BasisError(
                f"{label}: {field} has shape {shape}, expected {expected} on {grid}",
                code="shape",
            )
    off = float(np.abs(arrays["analysis"].sum(1) - 1).max())
    if off > _WHITE_TOLERANCE:
        raise BasisError(
            f"{label}: the channels of flat white are not ones (a row sums to 1 +- {off:.2g}); "
            "scale the channels by A 1",
            code="damaged",
        )
    loss = round_trip_loss(arrays["analysis"], arrays["synthesis"])
    if loss > ROUND_TRIP_TOLERANCE:
        raise BasisError(
            f"{label}: analysis and synthesis do not match (A B differs from the "
            f"identity by {loss:.2g}); were the numbers edited? Fit the basis again",
            code="damaged",
        )
    return arrays


def round_trip_loss(A: Array, B: Array) -> float:
    """Return the largest deviation of A B from the identity."""
    return float(np.abs(A @ B - np.eye(len(A))).max())


def require_samples(values: ArrayLike | None, grid: SpectralGrid, label: str) -> Array | None:
    """Return a read-only copy of a basis' samples, (K, N) reflectances; None without any.

    Raises BasisError if they are something else.
    """
    if values is None:
        return None
    with basis_errors(label):
        samples = real_array(values, label)
        if samples.size == 0:
            samples = np.zeros((0, grid.size))
        if samples.ndim != 2:
            raise BasisError.refused(label, samples.shape, "give (K, N) reflectances", "shape")
        samples = reflectance_values(samples, grid, label)
    samples.flags.writeable = False
    return samples


def require_channels(basis: StoredBasis, coefficients: ArrayLike) -> Array:
    """Return (..., m) float64 coefficients; raise BasisError if not finite or another m."""
    with basis_errors():
        c = real_array(coefficients, "coefficients")
    if c.ndim == 0 or c.shape[-1] != basis.size:
        raise BasisError(
            f"coefficients have shape {c.shape}, basis {basis.name!r} has {basis.size} channels; "
            "were they made with another basis?",
            code="shape",
        )
    if not np.isfinite(c).all():
        raise BasisError(
            "coefficients hold NaN or infinite values; leave those pixels out", code="range"
        )
    return c


def require_reflective(materials: Mapping[str, Spectrum], basis: str) -> None:
    """Raise BasisError if a material is fluorescent: only a `MaterialBasis` holds what it emits."""
    for name, spectrum in materials.items():
        if spectrum.fluorescence:
            raise BasisError(
                f"material {name!r} is fluorescent, and basis {basis!r} holds only reflectances; "
                'use a MaterialBasis, in scenes [basis] method = "materials"',
                code="conflict",
            )


def require_materials(materials: Mapping[str, Spectrum], label: str) -> None:
    """Raise BasisError if there is no material."""
    if not materials:
        raise BasisError(f"{label}: no materials; give {{name: reflectance}}", code="missing")
