"""Coefficient images and lights that nobody cast."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis import Basis
from volspec.export.frames import read_frame
from volspec.image import CoefficientImage
from volspec.relight import LightRig
from volspec.scene.tables.lights import NamedLight
from volspec.spectra import light


def image(coefficients: ArrayLike, basis: Basis, alpha: Any = None, **more: Any) -> Any:
    """Return an image of (H, W, M) premultiplied coefficients; opaque without an opacity."""
    coefficients = np.asarray(coefficients, np.float32)
    alpha = np.ones(coefficients.shape[:2]) if alpha is None else alpha
    alpha = np.asarray(alpha, np.float32)
    return CoefficientImage(coefficients, alpha, alpha, basis, **more)


def read_codes(path: Path) -> NDArray[Any]:
    """Return a picture's codes."""
    return np.asarray(read_frame(path).convert("RGB"))


def some_rows(whole: CoefficientImage, rows: slice) -> CoefficientImage:
    """Return an image of some of another's rows."""
    first = None if whole.first_mm is None else whole.first_mm[rows]
    parts = {name: getattr(whole, name)[rows] for name in ("coefficients", "alpha", "depth_mm")}
    return replace(whole, **parts, first_mm=first)


def named_lights(names: Sequence[str], spectrum: str = "") -> list[NamedLight]:
    """Return lights of the library, or one of its spectra by several names."""
    spectra = [light(spectrum or name) for name in names]
    return [NamedLight(n, n, s, LightRig((s,))) for n, s in zip(names, spectra, strict=True)]
