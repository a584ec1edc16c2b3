"""Coefficient images of small hand-made bases, and their frames by every backend."""

from typing import Any

import numpy as np
import pytest

from volspec.appearance import Viewing
from volspec.appearance.display.spaces import (
    SPACES,
    ColourSpace,
    XYZ_FROM_sRGB,
    decode_sRGB,
    sRGB_WHITE_XYZ,
)
from volspec.appearance.models.lab import cielab
from volspec.basis import Basis, SpectralBasis
from volspec.errors import OpenGLError
from volspec.image.model import CoefficientImage
from volspec.relight import Illumination, Relighter, programs
from volspec.relight.gpu import GLEngine
from volspec.relight.reference import CpuEngine
from volspec.spectra import SpectralGrid
from volspec.spectra.datasets import colour_matching_functions

GRID = SpectralGrid()
RAW = Viewing(model="none")
# Reflectances are beyond the channels of `box_basis`, which frames warn of.
COARSE = pytest.mark.filterwarnings("ignore:.* colours are off by ")


def box_basis(size: int = 5, grid: SpectralGrid = GRID) -> SpectralBasis:
    """Channels that are means over groups of neighbouring bands."""
    B = np.zeros((grid.size, size))
    B[np.arange(grid.size), np.arange(grid.size) * size // grid.size] = 1.0
    Q = colour_matching_functions(grid)
    D = 100.0 * Q @ B / Q[1].sum()
    return SpectralBasis("boxes", "boxes", grid, (B / B.sum(0)).T, B, D)


def cast(height: int = 6, width: int = 5, seed: int = 0, size: int = 5) -> CoefficientImage:
    """Random surfaces behind random opacity; the last row is empty, the first opaque white."""
    rng = np.random.default_rng(seed)
    alpha = rng.random((height, width)).astype(np.float32)
    alpha[0], alpha[-1] = 1.0, 0.0
    surfaces = rng.random((height, width, size)).astype(np.float32)
    surfaces[0] = 1.0
    depth = np.full((height, width), np.inf, np.float32)
    return CoefficientImage(surfaces * alpha[..., None], alpha, depth, box_basis(size))


def grouped_cast(
    shares: dict[str, float], basis: Basis, seed: int = 3, half: bool = False
) -> CoefficientImage:
    """Random surfaces under random light of each group; the first pixel is white, facing all."""
    rng = np.random.default_rng(seed)
    alpha = rng.random((6, 5)).astype(np.float32)
    alpha[0, 0] = 1.0
    layers = []
    for share in shares.values():
        layer = rng.random((6, 5, basis.size)) * alpha[..., None] * share
        layer[0, 0] = share * basis.white
        layers.append(layer)
    kind = np.float16 if half else np.float32
    coefficients = np.concatenate(layers, axis=-1).astype(kind)
    return CoefficientImage(coefficients, alpha, np.ones_like(alpha), basis, groups=shares)


def gl_or_skip(image: CoefficientImage, **options: object) -> Relighter:
    try:
        return Relighter(image, backend="gl", **options)
    except OpenGLError as error:
        pytest.skip(str(error))


def surfaces(white: np.ndarray) -> np.ndarray:
    """(100, 100, 3) XYZ: the sRGB gamut evenly in code values, moved to a light's white."""
    codes = np.random.default_rng(11).random((100, 100, 3))
    codes[0, :8] = np.indices((2, 2, 2)).reshape(3, -1).T
    codes[0, 8:40] = np.linspace(0.0, 0.1, 32)[:, None]
    return decode_sRGB(codes) @ XYZ_FROM_sRGB.T * (white / sRGB_WHITE_XYZ)


def opaque(XYZ: np.ndarray, white: np.ndarray) -> tuple[np.ndarray, np.ndarray, Illumination]:
    """Return an image whose coefficients are XYZ (a basis of three channels, D = identity)."""
    coefficients = XYZ.astype(np.float32)
    alpha = np.ones(XYZ.shape[:2], np.float32)
    return coefficients, alpha, Illumination(np.eye(3), white, 0.2 * white)


def gl_frame(
    coefficients: np.ndarray,
    alpha: np.ndarray,
    lit: Illumination,
    viewing: Viewing,
    dtype: Any = np.float32,
    **options: Any,
) -> np.ndarray:
    """Return the shader's frame."""
    gl = GLEngine(coefficients, alpha, **options)
    try:
        return gl.render(lit, viewing, dtype)
    finally:
        gl.close()


def cpu_frame(
    coefficients: np.ndarray, alpha: np.ndarray, lit: Illumination, viewing: Viewing
) -> np.ndarray:
    """Return the NumPy twin's frame."""
    return CpuEngine(coefficients, alpha).render(lit, viewing, np.float32)


def assert_drawn_alike_by_webgl_2(draw: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw with the same source in both versions of GLSL, and compare."""
    frames = []
    for version in ("330 core", "300 es"):
        monkeypatch.setattr(programs, "_GLSL", version)
        frames.append(draw())
    assert np.array_equal(*frames)


def assert_close(ours: np.ndarray, truth: np.ndarray, limit: float, what: str) -> None:
    """Compare every pixel; the message has the worst with both values."""
    error = np.abs(ours.astype(np.float64) - truth)
    worst = np.unravel_index(int(np.argmax(error)), error.shape)
    line = f"{what}: worst pixel {worst[:2]}: {ours[worst[:2]]} against {truth[worst[:2]]}"
    print(line)
    assert error[worst] <= limit, line


def assert_in_range(frame: np.ndarray, what: object = "") -> None:
    """Assert that a frame has no NaN and no value outside the display's codes."""
    assert np.isfinite(frame).all(), what
    assert frame.min() >= 0.0 and frame.max() <= 1.0, what


def ciede2000(
    one: np.ndarray, other: np.ndarray, space: ColourSpace = SPACES["sRGB"], what: str = ""
) -> np.ndarray:
    """Print and return the differences of two frames."""
    import colour

    def lab(codes: np.ndarray) -> np.ndarray:
        XYZ = space.decode(codes.astype(np.float64)) @ space.XYZ_from_RGB.T
        return cielab(XYZ, space.white_XYZ)

    error = np.asarray(colour.delta_E(lab(one), lab(other), method="CIE 2000"))
    print(f"{what}: CIEDE2000 mean {error.mean():.5f}, max {error.max():.5f}")
    return error
