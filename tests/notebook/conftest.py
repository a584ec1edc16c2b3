"""A small picture of many colours."""

import numpy as np
import pytest

from tests.support.images import image
from volspec.basis import SpectralBasis
from volspec.image import CoefficientImage
from volspec.spectra import reflectance

# A side, in colours and in pixels.
COUNT, SIZE = 8, 64


@pytest.fixture(scope="session")
def colours() -> CoefficientImage:
    """64 natural colours, half transparent on the left."""
    basis = SpectralBasis.load("general-7")
    names = [f"CES/{number}" for number in range(1, COUNT * COUNT + 1)]
    samples = basis.analyse([reflectance(name) for name in names]).reshape(COUNT, COUNT, -1)
    alpha = np.ones((SIZE, SIZE), np.float32)
    alpha[:, : SIZE // 2] = 0.5
    pixels = samples.repeat(SIZE // COUNT, axis=0).repeat(SIZE // COUNT, axis=1)
    return image(pixels * alpha[..., None], basis, alpha)
