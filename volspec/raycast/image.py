"""The coefficient image: what a cast leaves, and its OpenEXR file.

    volume -> transfer -> [raycast] -> relight -> appearance

In the file every channel of the basis is one float channel ``coefficients.00``,
``coefficients.01``, …; ``A`` is the opacity and ``Z`` the depth in millimetres. The header's
``volspec:basis`` holds the whole basis (JSON), so that an image can be relit without the scene
that made it, and one of another basis version is refused.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec._exr import read_exr, write_exr
from volspec.basis import Basis, SpectralBasis, basis_from_dict
from volspec.errors import BasisError, ImageError, ShapeError
from volspec.spectra import SpectralGrid, SpectralImage, Spectrum
from volspec.spectra.values import light_power

FORMAT = 1
# What a camera's noise may bring below 0, and highlights above 1, in a spectral picture.
_NOISE, _LARGEST_REFLECTANCE = 0.1, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class CoefficientImage:
    """Reflection under flat white light, channel by channel.

    Parameters
    ----------
    coefficients : (H, W, M) float32
        Premultiplied by opacity; unitless.
    alpha : (H, W) float32
        Opacity, 0…1.
    depth_mm : (H, W) float32
        Expected distance of what is seen; inf where nothing is.
    basis : SpectralBasis or MaterialBasis
        With M channels.
    notes : {str: str}
        Free text kept in the file's header (scene, camera, software).

    Raises
    ------
    ShapeError
        If the arrays do not belong together.
    """

    coefficients: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    basis: Basis
    notes: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        width, height = self.size
        return f"CoefficientImage({width}x{height}, {self.basis.size} channels)"

    def __post_init__(self) -> None:
        shape = np.shape(self.coefficients)
        if len(shape) != 3 or shape[2] != self.basis.size:
            raise ShapeError(
                f"coefficient image: coefficients have shape {shape}, the basis "
                f"{self.basis.name!r} has {self.basis.size} channels; expected (H, W, M)"
            )
        for name in ("alpha", "depth_mm"):
            if np.shape(getattr(self, name)) != shape[:2]:
                raise ShapeError(
                    f"coefficient image: {name} has shape {np.shape(getattr(self, name))}; "
                    f"expected {shape[:2]}"
                )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.alpha.shape
        return width, height

    @classmethod
    def from_spectral_image(
        cls, image: SpectralImage, basis: SpectralBasis, taken_under: Spectrum | None = None
    ) -> CoefficientImage:
        """A measured or rendered spectral picture, ready for other lights.

        Parameters
        ----------
        image : SpectralImage
            Reflectances; or radiances, which are divided by the light they were taken under.
        basis : SpectralBasis
        taken_under : Spectrum, optional
            The light of radiances. Their scale is unknown, so that the brightest surface, 99.9 %
            of the picture's mean reflectances, is taken for white.

        Raises
        ------
        ImageError
            If radiances come without their light, or reflectances with one; or if the light
            leaves a band dark.
        SpectrumError
            If the picture does not cover the basis' grid.
        """
        if not (isinstance(image, SpectralImage) and isinstance(basis, SpectralBasis)):
            raise ImageError(
                f"from_spectral_image: got {image!r:.40} and {basis!r:.40}; expected a "
                "SpectralImage and a SpectralBasis"
            )
        grid = basis.grid
        spectra = image.on(grid).values.astype(np.float64)
        if (image.kind == "emissive") != (taken_under is not None):
            raise ImageError(
                "the spectral picture holds radiances: say which light it was taken under"
                if taken_under is None
                else "the spectral picture holds reflectances: leave out its light"
            )
        if taken_under is None:
            _check_range(spectra, grid)
        else:
            E = light_power(taken_under, grid)
            if E.min() < 1e-3 * E.max():
                raise ImageError(
                    f"light {taken_under.name!r} has next to nothing at "
                    f"{grid.wavelengths_nm[int(E.argmin())]:g} nm: no reflectance can be told there"
                )
            spectra /= E
            spectra /= max(float(np.percentile(spectra.mean(axis=-1), 99.9)), 1e-12)
        coefficients = basis.analyze(spectra).astype(np.float32)
        alpha = np.ones(coefficients.shape[:2], np.float32)
        return cls(coefficients, alpha, np.full_like(alpha, np.inf), basis, dict(image.notes))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an OpenEXR file, whole or not at all.

        Raises
        ------
        ImageError
            If the name does not end in ``.exr`` or the file cannot be written.
        """
        if Path(path).suffix.lower() != ".exr":
            raise ImageError(f"{os.fspath(path)}: coefficient images are OpenEXR; name it .exr")
        header = {
            "volspec:format": FORMAT,
            "volspec:basis": json.dumps(self.basis.to_dict()),
            "volspec:notes": json.dumps(dict(self.notes)),
        }
        channels = {
            f"coefficients.{k:02d}": self.coefficients[..., k] for k in range(self.basis.size)
        }
        write_exr(path, header, channels | {"A": self.alpha, "Z": self.depth_mm}, ImageError)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> CoefficientImage:
        """Read a file that `save` wrote.

        Raises
        ------
        ImageError
            If the file is missing, damaged, no coefficient image, or made with a format or
            basis version this volspec does not know.
        """
        name = os.fspath(path)
        missing = f"no such file; `volspec render SCENE -o {name}` makes one"
        header, pixels = read_exr(path, ImageError, missing=missing, again="render the scene again")
        if "volspec:basis" not in header:
            raise ImageError(
                f"{name}: not a coefficient image; `volspec render` makes them, and a spectral "
                "picture needs --basis"
            )
        if header.get("volspec:format") != FORMAT:
            raise ImageError(
                f"{name}: format {header.get('volspec:format')}, this volspec reads {FORMAT}; "
                "render the scene again"
            )
        try:
            basis = basis_from_dict(json.loads(header["volspec:basis"]))
            notes = dict(json.loads(header.get("volspec:notes", "{}")))
        except (BasisError, ValueError, KeyError, TypeError) as error:
            raise ImageError(f"{name}: its basis is refused ({error}); render again") from error
        wanted = [f"coefficients.{k:02d}" for k in range(basis.size)]
        for key in (*wanted, "A", "Z"):
            if key not in pixels:
                raise ImageError(f"{name}: channel {key!r} is missing; render the scene again")
        coefficients = np.stack([pixels[key] for key in wanted], axis=-1)
        if not (np.isfinite(coefficients).all() and np.isfinite(pixels["A"]).all()):
            raise ImageError(f"{name}: holds NaN or infinite values; render the scene again")
        return cls(coefficients, pixels["A"], pixels["Z"], basis, notes)


def _check_range(spectra: NDArray[np.float64], grid: SpectralGrid) -> None:
    """Refuse what cannot be reflectances: a wrong unit, or another quantity."""
    for at, wrong in (
        (spectra.argmin(), spectra.min() < -_NOISE),
        (spectra.argmax(), spectra.max() > _LARGEST_REFLECTANCE),
    ):
        if wrong:
            y, x, k = np.unravel_index(int(at), spectra.shape)
            raise ImageError(
                f"spectral picture: pixel ({x}, {y}) reflects {spectra[y, x, k]:g} at "
                f"{grid.wavelengths_nm[k]:g} nm, expected 0…1; per cent? divide by 100"
            )
