"""Weights by use: spectra of larger weight have smaller errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from volspec.basis import SpectralBasis
from volspec.spectra import XYZ_from_spectra, light, light_set, reflectance_set

LIGHTS = [light(n) for n in ("D65", "A", "planck:3000", "FL2", "HP1", "FL11")]
SAMPLES = reflectance_set("training")[::10]
METHODS = ("virtual-sensors", "pca-sharpened", "pca", "reduced-rank")


def fit(method: str, **weights: Any) -> SpectralBasis:
    return SpectralBasis.fit(LIGHTS, SAMPLES, size=5, method=method, **weights)


def errors(basis: SpectralBasis) -> np.ndarray:
    """(J, K) root mean square error of XYZ by the exact matrix, which every method has."""
    c = basis.analyse(SAMPLES)
    off = [c @ basis.light_matrix(e).T - XYZ_from_spectra(e, SAMPLES) for e in LIGHTS]
    return np.sqrt((np.array(off) ** 2).mean(-1))


@pytest.mark.parametrize("method", METHODS)
def test_equal_weights_are_none(method: str) -> None:
    plain = fit(method)
    weighed = fit(method, light_weights=[7] * 6, reflectance_weights=np.full(len(SAMPLES), 0.2))
    # Weights of equal size and any scale divide out to rounding; a descent follows rounding
    # until its steps are small, to 1e-5 of the cost.
    assert errors(weighed) == pytest.approx(errors(plain), abs=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_a_material_used_more_is_held_better(method: str) -> None:
    weights = np.ones(len(SAMPLES))
    worst = int(errors(fit(method)).mean(0).argmax())
    weights[worst] = 1000.0
    before, after = errors(fit(method)), errors(fit(method, reflectance_weights=weights))
    # Measured .58 for the components, which fit colour only indirectly; else below .3.
    assert after[:, worst].mean() < 0.7 * before[:, worst].mean()


@pytest.mark.parametrize("method", ["virtual-sensors", "reduced-rank"])
def test_a_light_used_more_is_held_better(method: str) -> None:
    # Not the pca methods: they hold signals, and their colour follows only in the main.
    weights = np.ones(len(LIGHTS))
    weights[4] = 1000.0

    def componentwise(basis: SpectralBasis) -> float:
        if method == "reduced-rank":
            return float(errors(basis)[4].mean())
        return basis.report([LIGHTS[4]], SAMPLES).componentwise.mean

    before, after = componentwise(fit(method)), componentwise(fit(method, light_weights=weights))
    assert after < 0.7 * before


def test_a_light_used_more_bends_the_components_towards_its_signals() -> None:
    signals = LIGHTS[4].values * SAMPLES
    plain, weighed = fit("pca"), fit("pca", light_weights=[1, 1, 1, 1, 1e4, 1])
    lost = [
        np.linalg.norm(signals - basis.synthesise(basis.analyse(signals)))
        for basis in (plain, weighed)
    ]
    assert lost[1] < 0.5 * lost[0]


def test_all_lights_of_the_library_may_weigh_little() -> None:
    # As scenes are trained: their own lights at ten times the weight of the library's together.
    library = light_set("spiky")
    weights = np.repeat([1 / 6, 0.1 / len(library)], [6, len(library)])
    basis = SpectralBasis.fit([*LIGHTS, *library], SAMPLES[:5], light_weights=weights)
    # Measured .02 and .1.
    assert basis.report(LIGHTS, SAMPLES[:5]).componentwise.mean <= 0.05
    assert basis.report(library, SAMPLES[:5]).componentwise.mean <= 0.3
