"""Ways from channels to XYZ, the matrix fitted to each light, and the algebra they share."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from volspec.appearance.models.lab import CIE94_metric, cielab, delta_E_2000
from volspec.basis import SpectralBasis
from volspec.basis.display import MODES, fitted_matrix
from volspec.basis.samples import through_samples
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.spectra import (
    DEFAULT_GRID,
    PAPERS_GRID,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
    light_set,
    reflectance,
    reflectance_set,
    white_XYZ,
)

_TRAINING = reflectance_set("training")[::4]
BASES = {
    "virtual-sensors": SpectralBasis.load("general-7"),
    "positive": SpectralBasis.load("general-7-positive"),
    "reduced-rank": SpectralBasis.load("exact-7"),
    "pca": SpectralBasis.fit(light_set("smooth"), _TRAINING, method="pca"),
    "pca-sharpened": SpectralBasis.fit(light_set("smooth"), _TRAINING, method="pca-sharpened"),
}
WAYS = ("componentwise", "linear-model", "exact")
METHODS_OF_PCA = ("pca", "pca-sharpened")
LAMPS = ("D65", "A", "planck:2000", "FL2", "HP1", "LED-RGB1", "LPS")

any_basis = st.sampled_from(list(BASES.values()))
any_lamp = st.sampled_from(LAMPS).map(light)
# Mixtures of lamps and a flat light: any level, never dark.
any_light = st.tuples(any_lamp, st.floats(0.01, 100), st.floats(0, 1)).map(
    lambda t: Spectrum(DEFAULT_GRID.wavelengths_nm, t[1] * (t[0].values + t[2]), "mixed")
)


def channels(size: int = 7) -> st.SearchStrategy[np.ndarray]:
    return st.lists(st.floats(0, 1), min_size=size, max_size=size).map(np.array)


@given(any_basis, any_light, st.sampled_from(MODES))
def test_white_is_exact_in_every_mode(basis, lamp, mode):
    # Rounding of a sum that cancels: pca's channels reach 1e4 times the result.
    shown = basis.colour_matrix(lamp, mode) @ basis.white
    assert shown == pytest.approx(white_XYZ(lamp), abs=1e-6)


@given(any_basis, any_light, any_light)
def test_light_is_analysed_linearly(basis, one, other):
    both = Spectrum(DEFAULT_GRID.wavelengths_nm, one.values + other.values, "both")
    for of in (basis.analyse, basis.illumination_matrix):
        total = of(one) + of(other)
        assert of(both) == pytest.approx(total, abs=1e-9 * np.abs(total).max())


@given(st.sampled_from(["virtual-sensors", "positive", "reduced-rank"]), any_light, any_light)
def test_light_matrices_add_up_by_luminance(method, one, other):
    # Not the pca methods: their rows are stretched to each light's white.
    basis = BASES[method]
    both = Spectrum(DEFAULT_GRID.wavelengths_nm, one.values + other.values, "both")
    Y = [float(XYZ_from_spectra(light("E"), lamp.values)[1]) for lamp in (one, other)]
    summed = (basis.light_matrix(one) * Y[0] + basis.light_matrix(other) * Y[1]) / sum(Y)
    assert basis.light_matrix(both) == pytest.approx(summed, abs=1e-7)


@given(any_basis, any_light, channels())
def test_componentwise_is_the_product(basis, lamp, c):
    product = basis.display_matrix(lamp) @ (basis.analyse(lamp) * c)
    shown = basis.colour_matrix(lamp, "componentwise") @ c
    assert shown == pytest.approx(product, rel=1e-9, abs=1e-6)


@given(any_basis, any_lamp, channels())
def test_illumination_is_a_product_inside(basis, lamp, s):
    # Bergner, Drew and Moeller (2009), eq. 5-6: multiply the synthesised spectra, analyse again.
    product = basis.analyse(basis.synthesise(basis.analyse(lamp)) * basis.synthesise(s))
    found = basis.illumination_matrix(lamp) @ s
    assert found == pytest.approx(product, abs=1e-9 * np.abs(basis.synthesis).max() ** 2)


@given(any_basis, any_lamp, channels())
def test_colours_have_the_default_mode(basis, lamp, c):
    shown = basis.colour_matrix(lamp, "fitted") @ c
    assert basis.xyz(c, lamp) == pytest.approx(shown, rel=1e-9, abs=1e-6)


def test_illumination_matrix_is_equation_7():
    lamp, samples = light("A", PAPERS_GRID), reflectance_set("training", PAPERS_GRID)[::4]
    smooth = light_set("smooth", PAPERS_GRID)
    basis = SpectralBasis.fit(smooth, samples, method="pca", grid=PAPERS_GRID)
    B, e = basis.synthesis, basis.analyse(lamp)
    # With equal band weights, as in the papers, A is the pseudoinverse.
    assert basis.analysis == pytest.approx(np.linalg.pinv(B), abs=1e-9)
    R = [
        [sum(basis.analysis[i] @ (B[:, j] * B[:, k]) * e[k] for k in range(7)) for j in range(7)]
        for i in range(7)
    ]
    assert basis.illumination_matrix(lamp) == pytest.approx(np.array(R))


def shown(method: str, lamp: Spectrum, mode: str) -> np.ndarray:
    """Return the XYZ of the training reflectances."""
    return BASES[method].analyse(_TRAINING) @ BASES[method].colour_matrix(lamp, mode).T


def test_linear_model_does_not_depend_on_which_vectors_span_the_subspace():
    for lamp in map(light, LAMPS):
        plain, sharp = (shown(method, lamp, "linear-model") for method in METHODS_OF_PCA)
        assert plain == pytest.approx(sharp, abs=1e-6)


def test_modes_are_ever_closer_to_the_full_spectra():
    # Mean difference of XYZ, in per cent of white: plain components do not multiply by
    # themselves; sharpened, they nearly do what the whole product does.
    lamp = light("planck:3000")
    true = XYZ_from_spectra(lamp, _TRAINING)
    plain, sharp = (
        [np.abs(shown(method, lamp, mode) - true).mean() for mode in WAYS]
        for method in METHODS_OF_PCA
    )
    assert plain[0] > 5 and sharp[0] < 0.2
    assert plain[2] < plain[1] < 0.2


def test_materials_channels_come_in_their_order():
    basis = BASES["virtual-sensors"]
    paints = {n: reflectance(n) for n in ("gold", "CES/5")}
    assert basis.channels_for_materials(paints)[1] == pytest.approx(basis.analyse(paints["CES/5"]))
    assert basis.channels_for_materials(paints).shape == (2, 7)


GENERAL = SpectralBasis.load("general-7")
PAPERS = SpectralBasis.load("general-7-10nm")
KINDS = ("smooth", "spiky")
PAINTS = np.array([reflectance(name).values for name in ("gold", "copper", "CES/5")])


def test_the_matrix_is_the_constrained_least_squares():
    lamp = light("FL4")
    S = reflectance_set("training")[:20]
    c, XYZ, white = GENERAL.analyse(S), XYZ_from_spectra(lamp, S), white_XYZ(lamp)
    weights, prior = np.linspace(0.5, 2.0, len(S)) / len(S), GENERAL.light_matrix(lamp)
    found = fitted_matrix(c, XYZ, weights, white, prior)
    G = CIE94_metric(XYZ / white)

    # Free: 3 x 6 entries; the last column makes white exact.
    def matrix(x: np.ndarray) -> np.ndarray:
        free = x.reshape(3, 6)
        return np.hstack([free, (1.0 - free.sum(1))[:, None]])

    def cost(x: np.ndarray) -> float:
        M = matrix(x)
        off = np.einsum("kij,kj->ki", G, c @ M.T - XYZ / white)
        return float(weights @ (off**2).sum(1) + 1e-5 * ((M - prior / white[:, None]) ** 2).sum())

    ours = found / white[:, None]
    assert ours.sum(1) == pytest.approx(np.ones(3), abs=1e-9)
    best = minimize(cost, ours[:, :6].ravel() * 1.01, method="BFGS", options={"gtol": 1e-10})
    assert cost(ours[:, :6].ravel()) <= best.fun * (1 + 1e-9)
    assert matrix(best.x) == pytest.approx(ours, abs=2e-3)


@pytest.mark.parametrize("lamp", ["D65", "FL4", "LPS", "led:470", "laser:532"])
def test_fewer_samples_than_channels_and_their_mixtures_are_exact(lamp):
    basis, lit = replace(GENERAL, samples=PAINTS), light(lamp)
    mixtures = np.array([[1, 0, 0], [0.2, 0.3, 0.5], [0, 0.4, 0.1]]) @ PAINTS
    white = white_XYZ(lit)
    shown = basis.xyz(basis.analyse(mixtures), lit)
    Lab = (cielab(XYZ, np.maximum(white, 0.1)) for XYZ in (shown, XYZ_from_spectra(lit, mixtures)))
    assert delta_E_2000(*Lab).max() < 0.02
    assert np.abs(shown - GENERAL.xyz(GENERAL.analyse(mixtures), lit)).max() > 1e-3


def test_a_file_of_the_first_version_is_componentwise():
    old = replace(GENERAL, samples=None)
    assert "samples" not in old.to_dict()
    again = SpectralBasis.from_dict(old.to_dict())
    for name in ("D65", "FL4"):
        lamp = light(name)
        assert (again.colour_matrix(lamp) == GENERAL.colour_matrix(lamp, "componentwise")).all()


def test_samples_are_kept_by_files():
    again = SpectralBasis.from_dict(replace(GENERAL, samples=PAINTS).to_dict())
    assert np.array_equal(again.samples, PAINTS)
    assert again.fingerprint == GENERAL.fingerprint


def test_matrices_of_lights_add_up():
    lamps = light("D65"), light("led:470")
    found = Illumination.of(GENERAL, LightRig(lamps, (0.7, 0.2)), RelightSpec())
    Y = [0.7 * white_Y(lamps[0]), 0.2 * white_Y(lamps[1])]
    parts = [y * GENERAL.fitted_matrix(each) for y, each in zip(Y, lamps, strict=True)]
    assert found.XYZ_from_channels == pytest.approx(sum(parts) / sum(Y), rel=1e-9)
    assert found.XYZ_from_channels @ np.ones(7) == pytest.approx(found.white_XYZ, rel=1e-9)


def white_Y(lamp: Spectrum) -> float:
    """Luminous power of a light."""
    return float(colour_matching_functions(lamp.grid)[1] @ lamp.values)


@pytest.mark.not_quick
def test_the_fit_is_better_than_other_modes_in_every_class():
    for basis in (GENERAL, PAPERS):
        for kind in KINDS:
            report = basis.report(light_set(kind, basis.grid)[::3])
            for other in (report.componentwise, report.exact):
                assert report.fitted.mean < other.mean
                assert report.fitted.p95 < other.p95


def test_figures_of_the_papers_bands():
    # `python -m benchmarks.colour` prints all of them, also against 1 nm.
    smooth, spiky = (PAPERS.report(light_set(kind, PAPERS_GRID)).fitted for kind in KINDS)
    assert smooth.mean < 0.018 and spiky.mean < 0.225 and spiky.max < 3


def test_through_samples_is_exact_for_them():
    full = through_samples(replace(GENERAL, samples=PAINTS))
    assert full is not None
    assert full.synthesise(GENERAL.analyse(PAINTS)) == pytest.approx(PAINTS, abs=1e-9)
    assert full.synthesise(np.ones(7)) == pytest.approx(np.ones(81))
    assert through_samples(GENERAL) is None  # no samples
    assert through_samples(replace(GENERAL, samples=reflectance_set("training")[:9])) is None
    # Grey is a mixture of white and black; a metamer of gold in these channels is none.
    grey = np.vstack([PAINTS, np.full(81, 0.4)])
    assert through_samples(replace(GENERAL, samples=grey)) is not None
    black = np.eye(81)[40] - GENERAL.synthesis @ GENERAL.analyse(np.eye(81)[40])
    paint = np.linspace(0.3, 0.6, 81)
    metamer = paint + 0.2 * black / np.abs(black).max()
    assert through_samples(replace(GENERAL, samples=np.array([paint, metamer]))) is None
