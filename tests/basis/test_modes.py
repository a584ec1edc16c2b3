"""Three ways from channels to XYZ, and the algebra they share."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.errors import raises
from volspec.basis import SpectralBasis
from volspec.basis.display import MODES
from volspec.errors import BasisError
from volspec.spectra import (
    DEFAULT_GRID,
    PAPERS_GRID,
    Spectrum,
    XYZ_from_spectra,
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
def test_white_is_exact_in_every_mode(basis: SpectralBasis, lamp: Spectrum, mode: str) -> None:
    # Rounding of a sum that cancels: pca's channels reach 1e4 times the result.
    shown = basis.colour_matrix(lamp, mode) @ basis.white
    assert shown == pytest.approx(white_XYZ(lamp), abs=1e-6)


@given(any_basis, any_light, any_light)
def test_analysis_and_illumination_are_linear_in_the_light(
    basis: SpectralBasis, one: Spectrum, other: Spectrum
) -> None:
    both = Spectrum(DEFAULT_GRID.wavelengths_nm, one.values + other.values, "both")
    for of in (basis.analyse, basis.illumination_matrix):
        total = of(one) + of(other)
        assert of(both) == pytest.approx(total, abs=1e-9 * np.abs(total).max())


@given(st.sampled_from(["virtual-sensors", "positive", "reduced-rank"]), any_light, any_light)
def test_light_matrices_add_up_by_the_lights_luminances(
    method: str, one: Spectrum, other: Spectrum
) -> None:
    # Not the pca methods: their rows are stretched to each light's white.
    basis = BASES[method]
    both = Spectrum(DEFAULT_GRID.wavelengths_nm, one.values + other.values, "both")
    Y = [float(XYZ_from_spectra(light("E"), lamp.values)[1]) for lamp in (one, other)]
    summed = (basis.light_matrix(one) * Y[0] + basis.light_matrix(other) * Y[1]) / sum(Y)
    assert basis.light_matrix(both) == pytest.approx(summed, abs=1e-7)


@given(any_basis, any_light, channels())
def test_componentwise_is_the_display_matrix_on_the_product(
    basis: SpectralBasis, lamp: Spectrum, c: np.ndarray
) -> None:
    product = basis.display_matrix(lamp) @ (basis.analyse(lamp) * c)
    shown = basis.colour_matrix(lamp, "componentwise") @ c
    assert shown == pytest.approx(product, rel=1e-9, abs=1e-6)


@given(any_basis, any_lamp, channels())
def test_illumination_matrix_is_the_product_inside_the_subspace(
    basis: SpectralBasis, lamp: Spectrum, s: np.ndarray
) -> None:
    # Bergner, Drew and Moeller (2009), eq. 5-6: multiply the synthesised spectra, analyse again.
    e = basis.analyse(lamp)
    product = basis.analyse(basis.synthesise(e) * basis.synthesise(s))
    found = basis.illumination_matrix(lamp) @ s
    assert found == pytest.approx(product, abs=1e-9 * np.abs(basis.synthesis).max() ** 2)


@given(any_basis, any_lamp, channels())
def test_colours_are_those_of_the_default_mode(
    basis: SpectralBasis, lamp: Spectrum, c: np.ndarray
) -> None:
    shown = basis.colour_matrix(lamp, "fitted") @ c
    assert basis.xyz(c, lamp) == pytest.approx(shown, rel=1e-9, abs=1e-6)


def test_illumination_matrix_is_equation_7() -> None:
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


def test_linear_model_does_not_depend_on_which_vectors_span_the_subspace() -> None:
    for name in LAMPS:
        plain, sharp = (
            BASES[m].analyse(_TRAINING) @ BASES[m].colour_matrix(light(name), "linear-model").T
            for m in METHODS_OF_PCA
        )
        assert plain == pytest.approx(sharp, abs=1e-6)


def test_modes_are_ever_closer_to_the_full_spectra() -> None:
    # Mean difference of XYZ, in per cent of white: plain components do not multiply by
    # themselves; sharpened, they nearly do what the whole product does.
    lamp = light("planck:3000")
    plain, sharp = (
        [
            np.abs(
                BASES[method].analyse(_TRAINING) @ BASES[method].colour_matrix(lamp, mode).T
                - XYZ_from_spectra(lamp, _TRAINING)
            ).mean()
            for mode in ("componentwise", "linear-model", "exact")
        ]
        for method in METHODS_OF_PCA
    )
    assert plain[0] > 5 and sharp[0] < 0.2
    assert plain[2] < plain[1] < 0.2


def test_materials_channels_come_in_their_order() -> None:
    basis = BASES["virtual-sensors"]
    paints = {n: reflectance(n) for n in ("gold", "CES/5")}
    assert basis.channels_for_materials(paints)[1] == pytest.approx(basis.analyse(paints["CES/5"]))
    assert basis.channels_for_materials(paints).shape == (2, 7)


def test_unknown_modes_are_refused() -> None:
    with raises(BasisError, "unknown"):
        BASES["pca"].colour_matrix(light("A"), "exakt")
