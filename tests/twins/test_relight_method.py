"""METHOD sections 4 and 5 written out once more in plain NumPy, and every backend against it."""

import math

import numpy as np
import pytest

from tests.support.relight_reference import relight_reference
from tests.support.relighting import GRID, RAW, assert_in_range
from volspec.appearance import Viewing
from volspec.appearance.display.spaces import (
    XYZ_FROM_sRGB,
    decode_sRGB,
    encode_sRGB,
    linear_sRGB_from_XYZ,
    sRGB_WHITE_XYZ,
)
from volspec.appearance.models.lab import cielab
from volspec.basis import SpectralBasis
from volspec.image.model import CoefficientImage
from volspec.relight import LightRig, Relighter, RelightSpec, relight
from volspec.spectra import Spectrum, colour_matching_functions, light, reflectance


@pytest.fixture(scope="module")
def general() -> SpectralBasis:
    return SpectralBasis.load("general-7")


def two_materials(basis: SpectralBasis) -> tuple[CoefficientImage, np.ndarray, np.ndarray]:
    """An image, the (H, W, N) spectra of its mixed surfaces, and their opacity.

    Both materials lie in the basis' span, so that all bands and the light matrix must agree.
    """
    names = ("ColorChecker/orange", "ColorChecker/blue sky")
    spans = basis.synthesise(basis.analyse([reflectance(name) for name in names]))
    rng = np.random.default_rng(8)
    share = rng.random((6, 5, 1))
    alpha = rng.random((6, 5)).astype(np.float32)
    alpha[0], alpha[-1] = 1.0, 0.0
    spectra = share * spans[0] + (1.0 - share) * spans[1]
    coefficients = (basis.analyse(spectra) * alpha[..., None]).astype(np.float32)
    return CoefficientImage(coefficients, alpha, np.ones_like(alpha), basis), spectra, alpha


@pytest.mark.parametrize("name", ["D65", "A", "FL2", "LPS"])
def test_relight_is_method_4_in_81_bands(backend, general, name):
    image, S, alpha = two_materials(general)
    behind = reflectance("ColorChecker/red")
    E, Q = light(name).values, colour_matching_functions(GRID)
    kappa, opacity = 100.0 / (Q[1] @ E), alpha[..., None].astype(float)
    surface, backdrop = (kappa * (E * each) @ Q.T for each in (S, behind.values))
    XYZ = opacity * surface + (1.0 - opacity) * backdrop
    truth = encode_sRGB(linear_sRGB_from_XYZ(0.5 * XYZ))
    spec = RelightSpec(Viewing(model="none", exposure=0.5), "exact", behind)
    np.testing.assert_allclose(relight_reference(image, light(name), spec), truth, atol=1e-5)
    frame = relight(image, light(name), spec, dtype=np.float32, backend=backend)
    # llvmpipe's pow, measured 5e-5.
    np.testing.assert_allclose(frame, truth, atol=2e-4)


def lab(frame: np.ndarray) -> np.ndarray:
    return cielab(decode_sRGB(frame) @ XYZ_FROM_sRGB.T, sRGB_WHITE_XYZ)


def test_brighter_light_looks_more_colourful_at_equal_level(backend, general):
    """Hunt's effect: 50 000 lx against 5 lx, both shown with their white at Y = 100."""
    image, _, alpha = two_materials(general)
    how, chroma = {"dtype": np.float32, "backend": backend}, []
    for lux in (5.0, 50_000.0):
        frame = relight(image, LightRig((light("D65"),), illuminance_lux=(lux,)), **how)
        seen = lab(frame)[alpha == 1.0]
        chroma.append(np.hypot(seen[:, 1], seen[:, 2]).mean())
        same = relight(image, light("D65"), Viewing(illuminance_lux=lux), **how)
        np.testing.assert_array_equal(frame, same)
    # Measured 35.9 and 37.3.
    assert chroma[1] > chroma[0] + 1.0


def test_the_rig_s_lux_gives_L_A_unless_the_viewing_does(general):
    image, A = two_materials(general)[0], light("A")
    rig = LightRig((A, A), weights=(0.5, 0.25), illuminance_lux=(40.0, 80.0))
    L_A = 40.0 / math.pi * 30.0 / 100.0

    def frame(what: Spectrum | LightRig, **viewing: float) -> np.ndarray:
        return relight(image, what, Viewing(Y_b=30.0, **viewing), dtype=np.float32, backend="numpy")

    np.testing.assert_allclose(frame(rig), frame(A, L_A=L_A), atol=1e-6)
    np.testing.assert_allclose(frame(rig, L_A=300.0), frame(A, L_A=300.0), atol=1e-6)
    assert not np.allclose(frame(rig), frame(A), atol=1e-3)
    reference = relight_reference(image, rig, RelightSpec(Viewing(Y_b=30.0)))
    np.testing.assert_allclose(reference, frame(rig), atol=1e-6)


def test_exposure_multiplies_light(backend, general):
    image, *_ = two_materials(general)
    views = (Viewing(model="none", exposure=factor) for factor in (1.0, 0.5))
    with Relighter(image, backend) as relighter:
        once, half = (decode_sRGB(relighter.frame(light("D65"), v, dtype="f4")) for v in views)
    # llvmpipe's pow, and codes are steep near black.
    np.testing.assert_allclose(half, once / 2.0, atol=2e-4)


def test_dark_surround_lowers_contrast_on_an_average_display(backend, general):
    """A scene seen in the dark looks flat (Bartleson-Breneman); the frame must show it flat."""
    image, *_ = two_materials(general)
    with Relighter(image, backend) as relighter:
        average, dim, dark = (
            lab(relighter.frame(light("D65"), Viewing(surround=name), dtype=np.float32))
            for name in ("average", "dim", "dark")
        )
    inside = (average[..., 0] > 5.0) & (average[..., 0] < 95.0)
    assert (dim[..., 0] > average[..., 0])[inside].all()
    assert (dark[..., 0] > dim[..., 0])[inside].all()


@pytest.mark.parametrize("viewing", [Viewing(), RAW], ids=["CIECAM02", "none"])
def test_broken_coefficients_give_the_same_finite_frame_everywhere(needs_gl, general, viewing):
    image, *_ = two_materials(general)
    for row, value in enumerate((np.nan, np.inf, -np.inf, 3e38, -3e38)):
        image.coefficients[row, 0, 2] = value
        image.alpha[row, 1] = value
    frames = [
        relight(image, light("A"), viewing, dtype=np.float32, backend=backend)
        for backend in ("gl", "numpy")
    ]
    for frame in frames:
        assert_in_range(frame)
    # llvmpipe's pow, measured 5e-5.
    np.testing.assert_allclose(*frames, atol=2e-4)
    whole, *_ = two_materials(general)
    whole.coefficients[0, 0, 2] = whole.alpha[0, 1] = 0.0
    zeroed = relight(whole, light("A"), viewing, dtype=np.float32, backend="numpy")
    np.testing.assert_array_equal(frames[1][0], zeroed[0], "NaN counts as 0")
