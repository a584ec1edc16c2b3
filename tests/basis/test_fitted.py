"""The matrix fitted to each light: an independent least squares, limits, and its accuracy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.support.errors import raises
from volspec.appearance.models.cielab import CIE94_metric, cielab, delta_E_2000
from volspec.basis import SpectralBasis
from volspec.basis.display import fitted_matrix
from volspec.basis.samples import through_samples
from volspec.errors import BasisError
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.spectra import (
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

GENERAL = SpectralBasis.load("general-7")
PAPERS = SpectralBasis.load("general-7-10nm")
KINDS = ("smooth", "spiky")
PAINTS = np.array([reflectance(name).values for name in ("gold", "copper", "CES/5")])


def test_the_matrix_is_the_constrained_least_squares() -> None:
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
        far = M - prior / white[:, None]
        return float(weights @ (off**2).sum(1) + 1e-5 * (far**2).sum())

    ours = found / white[:, None]
    assert ours.sum(1) == pytest.approx(np.ones(3), abs=1e-9)
    best = minimize(cost, ours[:, :6].ravel() * 1.01, method="BFGS", options={"gtol": 1e-10})
    assert cost(ours[:, :6].ravel()) <= best.fun * (1 + 1e-9)
    assert matrix(best.x) == pytest.approx(ours, abs=2e-3)


@pytest.mark.parametrize("lamp", ["D65", "FL4", "LPS", "led:470", "laser:532"])
def test_fewer_samples_than_channels_and_their_mixtures_are_exact(lamp: str) -> None:
    basis, lit = replace(GENERAL, samples=PAINTS), light(lamp)
    mixtures = np.array([[1, 0, 0], [0.2, 0.3, 0.5], [0, 0.4, 0.1]]) @ PAINTS
    white = white_XYZ(lit)
    shown = basis.xyz(basis.analyse(mixtures), lit)
    Lab = (cielab(XYZ, np.maximum(white, 0.1)) for XYZ in (shown, XYZ_from_spectra(lit, mixtures)))
    assert delta_E_2000(*Lab).max() < 0.02
    without = GENERAL.xyz(GENERAL.analyse(mixtures), lit)
    assert np.abs(shown - without).max() > 1e-3


def test_a_file_of_the_first_version_is_componentwise() -> None:
    old = replace(GENERAL, samples=None)
    assert "samples" not in old.to_dict()
    again = SpectralBasis.from_dict(old.to_dict())
    for name in ("D65", "FL4"):
        lamp = light(name)
        wanted = GENERAL.colour_matrix(lamp, "componentwise")
        assert (again.colour_matrix(lamp) == wanted).all()
    with raises(BasisError, "missing"):
        old.fitted_matrix(light("D65"))


def test_samples_are_kept_by_files_and_refused_if_they_do_not_fit() -> None:
    basis = replace(GENERAL, samples=PAINTS)
    again = SpectralBasis.from_dict(basis.to_dict())
    assert again.samples is not None
    assert (again.samples == PAINTS).all()
    assert again.fingerprint == GENERAL.fingerprint
    with raises(BasisError, "shape"):
        replace(GENERAL, samples=PAINTS[0])
    with raises(BasisError, "shape"):
        replace(GENERAL, samples=PAINTS[:, :5])
    with raises(BasisError):
        replace(GENERAL, samples=-PAINTS)


def test_matrices_of_lights_add_up() -> None:
    lamps = light("D65"), light("led:470")
    rig = LightRig(lamps, (0.7, 0.2))
    found = Illumination.of(GENERAL, rig, RelightSpec())
    Y = [0.7 * white_Y(lamps[0]), 0.2 * white_Y(lamps[1])]
    parts = [y * GENERAL.fitted_matrix(each) for y, each in zip(Y, lamps, strict=True)]
    assert found.XYZ_from_channels == pytest.approx(sum(parts) / sum(Y), rel=1e-9)
    assert found.XYZ_from_channels @ np.ones(7) == pytest.approx(found.white_XYZ, rel=1e-9)


def white_Y(lamp: Spectrum) -> float:
    """Luminous power of a light."""
    return float(colour_matching_functions(lamp.grid)[1] @ lamp.values)


def test_the_fit_is_better_than_other_modes_in_every_class() -> None:
    for basis in (GENERAL, PAPERS):
        for kind in ("smooth", "spiky"):
            report = basis.report(light_set(kind, basis.grid)[::3])
            for other in (report.componentwise, report.exact):
                assert report.fitted.mean < other.mean
                assert report.fitted.p95 < other.p95


def test_figures_of_the_papers_bands() -> None:
    # `python -m benchmarks.colour` prints all of them, also against 1 nm.
    smooth, spiky = (PAPERS.report(light_set(kind, PAPERS_GRID)).fitted for kind in KINDS)
    assert smooth.mean < 0.018 and spiky.mean < 0.225 and spiky.max < 3


def test_through_samples_is_exact_for_them() -> None:
    full = through_samples(replace(GENERAL, samples=PAINTS))
    assert full is not None
    assert full.synthesise(GENERAL.analyse(PAINTS)) == pytest.approx(PAINTS, abs=1e-9)
    assert full.synthesise(np.ones(7)) == pytest.approx(np.ones(81))
    assert through_samples(GENERAL) is None  # no samples
    many = reflectance_set("training")[:9]
    assert through_samples(replace(GENERAL, samples=many)) is None
    # Grey is a mixture of white and black; a metamer of gold in these channels is none.
    grey = np.vstack([PAINTS, np.full(81, 0.4)])
    assert through_samples(replace(GENERAL, samples=grey)) is not None
    black = np.eye(81)[40] - GENERAL.synthesis @ GENERAL.analyse(np.eye(81)[40])
    paint = np.linspace(0.3, 0.6, 81)
    metamer = paint + 0.2 * black / np.abs(black).max()
    assert through_samples(replace(GENERAL, samples=np.array([paint, metamer]))) is None
