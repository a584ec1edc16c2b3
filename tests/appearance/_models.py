"""Colours and conditions that the tests of the appearance models share."""

import numpy as np

from volspec.appearance import ViewingConditions
from volspec.appearance.display.spaces import ColourSpace, Transfer, XYZ_FROM_sRGB, sRGB_WHITE_XYZ

A, D50, D65, PLANCK_7500 = (
    (109.85, 100.0, 35.58),
    (96.42, 100.0, 82.49),
    (95.05, 100.0, 108.88),
    (87.12, 90.0, 112.95),
)
# White, L_A, Y_b, surround, discount: what is usual, and towards every end.
CONDITIONS = {
    "office under D65": ViewingConditions(D65, 318.31, 20.0, "average", discount=True),
    "room under A": ViewingConditions(A, 63.66, 20.0, "average"),
    "prints under D50": ViewingConditions(D50, 100.0, 20.0, "average", discount=True),
    "television": ViewingConditions(D65, 5.0, 8.0, "dim"),
    "cinema": ViewingConditions(PLANCK_7500, 10.0, 1.0, "dark"),
    "dusk, half dim": ViewingConditions(A, 1.0, 20.0, 0.05),
    "sun, bright background": ViewingConditions(PLANCK_7500, 5000.0, 60.0, 0.15),
    "light box, white around": ViewingConditions(D50, 954.93, 100.0, "average", D=0.4),
}


ACES = ColourSpace(
    "ACES2065-1",
    ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077)),
    (0.32168, 0.33767),
    Transfer.gamma(1.0),
)


def cube(steps: int = 17) -> np.ndarray:
    """(steps³, 3) linear RGB."""
    return np.indices((steps,) * 3).reshape(3, -1).T / (steps - 1.0)


def colours(white: tuple[float, float, float], count: int = 10_000) -> np.ndarray:
    """(N, 3) XYZ over the sRGB gamut, moved to a white; the gamut's corners first, black last."""
    rng = np.random.default_rng(11)
    linear = np.concatenate([cube(2)[1:], rng.random((count, 3)) ** 2.2, np.zeros((1, 3))])
    return linear @ XYZ_FROM_sRGB.T * (np.asarray(white) / sRGB_WHITE_XYZ)


def spectral_mixtures(count: int = 5000) -> np.ndarray:
    """(N, 3) XYZ of mixtures of three wavelengths, Y up to 100: every chromaticity there is."""
    from colour import MSDS_CMFS

    observer = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].values
    locus = observer[observer.sum(axis=-1) > 0.01]
    rng = np.random.default_rng(4)
    shares = rng.dirichlet(np.full(3, 0.3), count)
    XYZ = np.einsum("nk,nki->ni", shares, locus[rng.integers(0, len(locus), (count, 3))])
    XYZ *= (100.0 * rng.random(count) / np.maximum(XYZ[:, 1], 0.01))[:, None]
    return XYZ[XYZ.max(axis=-1) < 300.0]


def apart(back: np.ndarray, XYZ: np.ndarray) -> np.ndarray:
    """Greatest difference of each colour, relative to its greatest channel (or 1e-5 of white)."""
    return np.abs(back - XYZ).max(axis=-1) / np.maximum(np.abs(XYZ).max(axis=-1), 1e-3)


def worst(ours: np.ndarray, theirs: np.ndarray, XYZ: np.ndarray, limit: float, what: str) -> None:
    """Assert |ours - theirs| <= limit max(1, |theirs|); the message names the worst colour."""
    error = np.abs(ours - theirs) / np.maximum(1.0, np.abs(theirs))
    i = int(np.argmax(error))
    assert error[i] <= limit, (what, XYZ[i], ours[i], theirs[i], error[i])


def worst_hue(ours, theirs, XYZ: np.ndarray, limit: float) -> None:
    """Same as `worst`, in degrees times chroma: a neutral has any hue."""
    turn = np.abs((ours.h - theirs.h + 180.0) % 360.0 - 180.0) * np.minimum(ours.C, 1.0)
    worst(turn, np.zeros_like(turn), XYZ, limit, "h")
