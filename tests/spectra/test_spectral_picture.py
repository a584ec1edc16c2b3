"""A measured spectral picture as a coefficient image: relit like a cast."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.basis import SpectralBasis
from volspec.errors import ImageError, SpectrumError
from volspec.raycast import CoefficientImage
from volspec.relight import relight
from volspec.spectra import SpectralImage, light, reflectance_set

BASIS = SpectralBasis.load("general-7")
CHART = reflectance_set("test").reshape(7, 12, -1)
NM = BASIS.grid.wavelengths_nm


def test_a_chart_of_reflectances_is_analysed_pixel_by_pixel() -> None:
    image = CoefficientImage.from_spectral_image(SpectralImage(CHART, NM, "reflective"), BASIS)
    assert np.allclose(image.coefficients, BASIS.analyse(CHART), atol=1e-6)
    assert image.alpha.min() == 1
    assert relight(image, light("A"), backend="numpy").std() > 30


def test_radiances_are_divided_by_the_light_they_were_taken_under() -> None:
    """The scale of radiances is free: the chart comes back up to one factor."""
    lamp = light("A")
    radiance = SpectralImage(3.7 * CHART * lamp.values, NM, "emissive")
    image = CoefficientImage.from_spectral_image(radiance, BASIS, taken_under=lamp)
    wanted = BASIS.analyse(CHART)
    factor = image.coefficients.mean() / wanted.mean()
    assert np.allclose(image.coefficients, factor * wanted, atol=1e-5)
    assert 1 <= factor < 1.3, "the brightest patch, which reflects 0.9, counts as white"


def test_a_hot_pixel_does_not_become_the_white() -> None:
    """The brightest of a thousand is taken; here every patch covers 20 of 1680 pixels."""
    lamp = light("A")
    large = np.tile(CHART, (4, 5, 1)) * lamp.values

    def taken(radiances: np.ndarray) -> np.ndarray:
        picture = SpectralImage(radiances, NM, "emissive")
        return CoefficientImage.from_spectral_image(picture, BASIS, lamp).coefficients

    plain, hot = taken(large), large.copy()
    y, x = np.unravel_index(large.sum(axis=-1).argmax(), large.shape[:2])
    hot[y, x] *= 5
    found = taken(hot)
    assert np.allclose(found[y, x], 5 * plain[y, x], rtol=1e-5)
    found[y, x] = plain[y, x]
    assert np.array_equal(found, plain)
    wanted = BASIS.analyse(np.tile(CHART, (4, 5, 1))) / CHART.mean(axis=-1).max()
    assert np.allclose(plain, wanted, atol=1e-5), "the brightest patch is the white"


def test_pictures_without_their_light_or_grid_are_refused() -> None:
    radiance = SpectralImage(CHART, NM, "emissive")
    with raises(ImageError, "conflict"):
        CoefficientImage.from_spectral_image(radiance, BASIS)
    with raises(ImageError, "conflict"):
        CoefficientImage.from_spectral_image(
            SpectralImage(CHART, NM, "reflective"), BASIS, taken_under=light("A")
        )
    with raises(ImageError):
        CoefficientImage.from_spectral_image(radiance, BASIS, taken_under=light("LPS"))
    narrow = SpectralImage(CHART[..., :20], NM[:20], "reflective")
    with raises(SpectrumError, "range"):
        CoefficientImage.from_spectral_image(narrow, BASIS)


@pytest.mark.parametrize("factor", [100, -1])
def test_what_is_no_reflectance_is_refused(factor: float) -> None:
    picture = SpectralImage(factor * CHART, NM, "reflective")
    with raises(ImageError, "range"):
        CoefficientImage.from_spectral_image(picture, BASIS)
