"""What every basis does the same way: colours of channels, its report, its file.

    [base] -> SpectralBasis, MaterialBasis

The pipeline asks either kind for no more than this and for `size`, `white`, `channels_of`,
`synthesize` and `fingerprint`.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self, cast

from numpy.typing import ArrayLike, NDArray

from volspec.basis import checks, storage
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.report import BasisReport
    from volspec.basis.stored import Basis


class StoredBasis(ABC):
    """Channels with colours, errors and a JSON file."""

    __slots__ = ()

    name: str

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of channels, m."""

    @abstractmethod
    def color_matrix(self, light: Spectrum, mode: str = "componentwise") -> NDArray[Any]:
        """(3, m) what takes a picture's channels to XYZ under a light, Y = 100 for white."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON types, with a format version; numbers keep every digit."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The inverse of `to_dict`."""

    def xyz(self, coefficients: ArrayLike, light: Spectrum) -> NDArray[Any]:
        """Colour of reflectance coefficients under a light, componentwise.

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
        BasisError
            If the last axis is not m, or holds anything but finite numbers.
        SpectrumError
            If the light cannot be seen by or does not cover the grid.
        """
        return checks.channels(self, coefficients) @ self.color_matrix(light).T

    def report(
        self,
        lights: Sequence[Spectrum] | None = None,
        reflectances: Sequence[Spectrum] | ArrayLike | None = None,
    ) -> BasisReport:
        """CIEDE2000 against full spectra; see `volspec.basis.report.report`.

        By default under the 26 smooth lights, of the 84 held-out samples or, where channels are
        materials, of these.

        Examples
        --------
        >>> from volspec.basis import SpectralBasis
        >>> from volspec.spectra import light, reflectance
        >>> samples = [reflectance("gold"), reflectance("CES/5")]
        >>> table = SpectralBasis.load("general-7").report([light("D65"), light("A")], samples)
        >>> table.componentwise.max < 0.1 < table.rgb_product.max
        True
        """
        from volspec.basis.report import report

        return report(cast("Basis", self), lights, reflectances)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .json file; it appears whole or not at all.

        Raises
        ------
        BasisError
            If it is not named .json.
        InputError
            If it cannot be written there.
        """
        storage.write(path, self.to_dict())

    @classmethod
    def load(cls, name_or_path: str | os.PathLike[str]) -> Self:
        """A shipped basis by name (``"general-7"``), or a file written by `save`.

        Raises
        ------
        BasisError
            Names the file and what is wrong with it; an unknown name lists the shipped ones.

        Examples
        --------
        >>> from volspec.basis import SpectralBasis
        >>> SpectralBasis.load("general-7").size
        7
        """
        return storage.load(name_or_path, cls.from_dict)
