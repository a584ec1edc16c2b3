"""Fits of bases: the cache, weights by use, any grid, and residuals by finite differences."""

from functools import cache
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.fixtures import slow, slow_each
from volspec import _cache
from volspec.appearance.models.lab import cielab
from volspec.basis import SpectralBasis, fit_cache
from volspec.basis import report as pairs
from volspec.basis.fit import residuals as fitted
from volspec.basis.fit.residuals import (
    CIE94_metric,
    FitState,
    Problem,
    evaluate,
    normal_equations,
    pose_problem,
)
from volspec.basis.fit.training import Training, training_set
from volspec.errors import BasisError
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    light,
    light_set,
    reflectance,
    reflectance_set,
)

LIGHTS = [light("D65"), light("A"), light("FL2")]
PAINTS = [reflectance("ColorChecker/orange"), reflectance("copper"), reflectance("CES/4")]
OPTIONS: dict[str, Any] = {
    "size": 5,
    "method": "virtual-sensors",
    "positive": False,
    "grid": DEFAULT_GRID,
    "observer_deg": 2,
    "light_weights": [1.0, 0.5, 0.25],
    "reflectance_weights": [1.0, 1.0, 0.5],
    "name": "paints",
    "trained_on": "three paints",
}


@pytest.fixture
def fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One entry a fit; in an empty cache folder."""
    done: list[int] = []
    fit = SpectralBasis.fit

    def counted(*given: Any, **named: Any) -> SpectralBasis:
        done.append(1)
        return fit(*given, **named)

    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(SpectralBasis, "fit", counted)
    return done


@pytest.fixture
def quick(fits: list[int], monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Same as `fits`, with a fit that takes no time."""

    def fit(*given: Any, grid: SpectralGrid, **named: Any) -> SpectralBasis:
        fits.append(1)
        return SpectralBasis.bands(grid)

    monkeypatch.setattr(SpectralBasis, "fit", fit)
    return fits


@pytest.mark.not_quick
def test_a_basis_read_is_the_basis_fitted_to_the_last_bit(fits):
    plain = SpectralBasis.fit(LIGHTS, PAINTS, **OPTIONS)
    first, second = (fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS) for _ in range(2))
    assert len(fits) == 2, "the plain one, and the first"
    for basis in (first, second):
        for matrix in ("analysis", "synthesis", "XYZ_from_channels"):
            assert np.array_equal(getattr(basis, matrix), getattr(plain, matrix))
        for name in ("name", "method", "trained_on", "grid", "observer_deg"):
            assert getattr(basis, name) == OPTIONS[name]


def test_a_name_is_no_reason_to_fit_again(quick):
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    assert fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | {"name": "other"}).name == "other"
    assert len(quick) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"size": 4},
        {"method": "pca"},
        {"positive": True},
        {"observer_deg": 10},
        {"light_weights": [1.0, 0.5, 0.2500001]},
        {"reflectance_weights": [1.0, 0.5, 1.0]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_another_option_is_fitted_again(change, quick):
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | change)
    assert len(quick) == 2


def test_other_spectra_are_fitted_again(quick):
    values = PAINTS[0].values.copy()
    values[7] = np.nextafter(values[7], 1.0)
    near = Spectrum(PAINTS[0].wavelengths_nm, values)
    wide = SpectralGrid(380, 780, 10)
    on_wide = [[each.on(wide) for each in spectra] for spectra in (LIGHTS, PAINTS)]
    for lights, paints, options in (
        (LIGHTS, PAINTS, {}),
        (LIGHTS, [near, *PAINTS[1:]], {}),
        (LIGHTS[::-1], PAINTS, {}),
        (*on_wide, {"grid": wide}),
    ):
        fit_cache.fit_cached(lights, paints, **OPTIONS | options)
    assert len(quick) == 4


def test_other_code_fits_anew(quick, monkeypatch):
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    monkeypatch.setattr(fit_cache, "_code", lambda: "edited")
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    assert len(quick) == 2


def test_a_fit_that_fails_fails_each_time(fits):
    for _ in range(2):
        with raises(BasisError, "impossible"):
            fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | {"method": "pca", "size": 31})
    assert len(fits) == 2


SIX_LIGHTS = [light(n) for n in ("D65", "A", "planck:3000", "FL2", "HP1", "FL11")]
SAMPLES = reflectance_set("training")[::10]
METHODS = ("virtual-sensors", "pca-sharpened", "pca", "reduced-rank")


def fit(method: str, **weights: Any) -> SpectralBasis:
    options = {"restarts": 0} if method == "virtual-sensors" else {}
    return SpectralBasis.fit(SIX_LIGHTS, SAMPLES, size=5, method=method, **options, **weights)


@cache
def plain(method: str) -> SpectralBasis:
    """Return the basis fitted without weights."""
    return fit(method)


def errors(basis: SpectralBasis) -> np.ndarray:
    """(J, K) root mean square error of XYZ by the exact matrix, which every method has."""
    c = basis.analyse(SAMPLES)
    off = [c @ basis.light_matrix(e).T - XYZ_from_spectra(e, SAMPLES) for e in SIX_LIGHTS]
    return np.sqrt((np.array(off) ** 2).mean(-1))


@pytest.mark.parametrize("method", METHODS)
def test_equal_weights_are_none(method):
    weighed = fit(method, light_weights=[7] * 6, reflectance_weights=np.full(len(SAMPLES), 0.2))
    # Weights of equal size and any scale divide out to rounding; a descent follows rounding
    # until its steps are small, to 1e-5 of the cost.
    assert errors(weighed) == pytest.approx(errors(plain(method)), abs=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_a_material_used_more_is_held_better(method):
    weights = np.ones(len(SAMPLES))
    before = errors(plain(method))
    worst = int(before.mean(0).argmax())
    weights[worst] = 1000.0
    after = errors(fit(method, reflectance_weights=weights))
    # Measured .58 for the components, which fit colour only indirectly; else below .3.
    assert after[:, worst].mean() < 0.7 * before[:, worst].mean()


@pytest.mark.parametrize("method", ["virtual-sensors", "reduced-rank"])
def test_a_light_used_more_is_held_better(method):
    # Not the pca methods: they hold signals, and their colour follows only in the main.
    weights = np.ones(len(SIX_LIGHTS))
    weights[4] = 1000.0

    def componentwise(basis: SpectralBasis) -> float:
        if method == "reduced-rank":
            return float(errors(basis)[4].mean())
        return basis.report([SIX_LIGHTS[4]], SAMPLES).componentwise.mean

    before, after = componentwise(plain(method)), componentwise(fit(method, light_weights=weights))
    assert after < 0.7 * before


def test_a_light_used_more_bends_the_components_towards_its_signals():
    signals = SIX_LIGHTS[4].values * SAMPLES
    weighed = fit("pca", light_weights=[1, 1, 1, 1, 1e4, 1])
    before, after = (
        np.linalg.norm(signals - basis.synthesise(basis.analyse(signals)))
        for basis in (plain("pca"), weighed)
    )
    assert after < 0.5 * before


@pytest.mark.not_quick
def test_all_lights_of_the_library_may_weigh_little():
    # As scenes are trained: their own lights at ten times the weight of the library's together.
    library = light_set("spiky")[::4]
    weights = np.repeat([1 / 6, 0.1 / len(library)], [6, len(library)])
    lights = [*SIX_LIGHTS, *library]
    basis = SpectralBasis.fit(lights, SAMPLES[:5], light_weights=weights, restarts=0)
    # Measured .02 and .1.
    assert basis.report(SIX_LIGHTS, SAMPLES[:5]).componentwise.mean <= 0.05
    assert basis.report(library, SAMPLES[:5]).componentwise.mean <= 0.3


# Products of surfaces have errors of their own, which take most of a report on a fine grid.
GRIDS = [
    SpectralGrid(400, 700, 10),
    *slow_each(SpectralGrid(360, 830, 5), SpectralGrid(360, 830, 1)),
]


@pytest.fixture
def few_products(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairs, "_MAX_PRODUCTS", 10)


@pytest.mark.not_quick
@pytest.mark.usefixtures("few_products")
@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize(
    ("options", "way", "mean", "maximum"),
    [
        # On the three grids: .009 .010 .010 (max .08); .13 .14 .14 (1.4); .25 to .29 (4.4).
        ({}, "componentwise", 0.012, 0.11),
        ({"positive": True}, "componentwise", 0.16, 1.6),
        ({"method": "pca-sharpened"}, "componentwise", 0.32, 5.0),
        # .10 .11 .11; .19 .22 .22.
        ({"method": "reduced-rank"}, "exact", 0.13, np.inf),
        ({"method": "pca"}, "exact", 0.25, np.inf),
    ],
    ids=["virtual-sensors", "positive", "pca-sharpened", "reduced-rank", "pca"],
)
def test_errors_are_alike_on_every_grid(grid, options, way, mean, maximum):
    smooth = light_set("smooth", grid)
    lights = smooth + light_set("spiky", grid) if "reduced-rank" in options.values() else smooth
    samples = reflectance_set("training", grid)
    basis = SpectralBasis.fit(lights, samples, size=7, grid=grid, **options)
    found = getattr(basis.report(smooth), way)
    print(found)
    assert found.mean <= mean and found.max <= maximum


@pytest.mark.not_quick
@pytest.mark.usefixtures("few_products")
@pytest.mark.parametrize("step", [5, slow(1)])
def test_a_scene_may_bring_a_fine_grid(step):
    grid = SpectralGrid(360, 830, step)
    lights = [light(n, grid) for n in ("D65", "A", "planck:4000")]
    samples = [reflectance(f"CES/{k}", grid) for k in (5, 25, 45, 65, 85)]
    basis = SpectralBasis.fit(lights, samples, size=6, grid=grid, restarts=0)
    assert basis.analysis.shape == (6, grid.size)
    assert basis.report(lights, samples).componentwise.max <= 0.2


GRID = SpectralGrid(400, 700, 30)
TRAINING_LIGHTS = ("D65", "A", "FL2")
SURFACES = ("red", "blue", "yellow", "cyan")
LIGHT_WEIGHTS, SURFACE_WEIGHTS = (1.0, 3.0, 0.2), (1.0, 0.1, 5.0, 2.0)


@pytest.fixture(scope="module")
def training() -> Training:
    return training_set(
        [light(name, GRID) for name in TRAINING_LIGHTS],
        [reflectance(f"ColorChecker/{name}", GRID) for name in SURFACES],
        GRID,
        observer_deg=2,
        light_weights=LIGHT_WEIGHTS,
        reflectance_weights=SURFACE_WEIGHTS,
    )


def posed(training: Training, kind: str) -> Problem:
    """On the bands themselves, or on six hat functions of them; with roughness to pay."""
    w = GRID.wavelengths_nm
    at = w if kind == "bands" else np.linspace(w[0], w[-1], 6)
    knots = np.array([np.interp(w, at, row) for row in np.eye(at.size)])
    return pose_problem(training, knots, 0.3 * np.diff(np.eye(at.size), 2, axis=0))


def started(problem: Problem, m: int = 3) -> FitState:
    """Lobes with some noise; D such that whites are about right, far from their floor."""
    at, rng = np.linspace(0, 1, len(problem.area)), np.random.default_rng(5)
    heights = np.exp(-(((at - np.linspace(0.2, 0.8, m)[:, None]) / 0.3) ** 2))
    heights += 0.1 * rng.standard_normal(heights.shape)
    heights /= (heights @ problem.area)[:, None]
    D = np.linalg.lstsq(problem.E @ heights.T, problem.white, rcond=None)[0].T
    return FitState(heights, D + 0.2 * rng.standard_normal(D.shape), positive=False)


def residuals(problem: Problem, x: np.ndarray, like: FitState) -> np.ndarray:
    """Everything that is squared and summed, of unknowns as a fit steps in them."""
    cut = like.heights.size
    heights = x[:cut].reshape(like.heights.shape)
    heights = heights / (heights @ problem.area)[:, None]
    D = x[cut:].reshape(like.D.shape)
    value = evaluate(problem, FitState(heights, D, like.positive))
    large = D * (fitted._DISPLAY_WEIGHT / 100)
    parts = (value.residual, value.rough, value.white_off, large)
    return np.concatenate([part.ravel() for part in parts])


@pytest.mark.parametrize("kind", ["bands", "hats"])
def test_normal_equations(training, kind, monkeypatch):
    # Large entries of D cost as much as colours here; in fits too little to show.
    monkeypatch.setattr(fitted, "_DISPLAY_WEIGHT", 20.0)
    problem = posed(training, kind)
    state = started(problem)
    x = np.concatenate([state.heights.ravel(), state.D.ravel()])
    value = evaluate(problem, state)
    r = residuals(problem, x, state)
    assert r @ r == pytest.approx(value.cost)
    # Away from the floor of whites: the fit leaves out its slope.
    assert ((value.e @ state.D.T) / problem.white).min() > 0.5
    columns = []
    for step in np.diag(1e-5 * np.maximum(np.abs(x), 0.01)):
        more, less = residuals(problem, x + step, state), residuals(problem, x - step, state)
        columns.append((more - less) / (2 * step.max()))
    J = np.transpose(columns)
    H, gradient = normal_equations(problem, state, value)
    # Unknowns differ in scale by thousands: each is measured by its own size in J. Central
    # differences of 1e-5 are off by 1e-10 in truncation and 1e-11 / 1e-5 in rounding.
    size = np.sqrt((J**2).sum(0))
    worst = np.abs((H - J.T @ J) / np.outer(size, size)).max()
    off = np.abs((gradient - J.T @ r) / size).max() / np.sqrt(r @ r)
    print(f"{kind}: J^T J off by {worst:.1e}, J^T r by {off:.1e}")
    assert worst < 1e-6 and off < 1e-6


def test_pairs_cost_by_their_weights(training):
    """The mean over pairs of w_j w_k |G d|^2, weights of mean 1."""
    problem = posed(training, "bands")
    value = evaluate(problem, started(problem))
    d = value.ratio - problem.target
    squares = (np.einsum("jkrc,jkc->jkr", CIE94_metric(problem.target), d) ** 2).sum(-1)
    w, v = (np.array(x) / np.mean(x) for x in (LIGHT_WEIGHTS, SURFACE_WEIGHTS))
    assert value.colour_error == pytest.approx((w[:, None] * v * squares).mean())


def test_the_metric_is_cie94_of_small_steps():
    rng = np.random.default_rng(7)
    greys = np.array([[0.9, 0.9, 0.9], [0.18, 0.18, 0.18], [0.004, 0.004, 0.004]])
    dark = rng.uniform(0.02, 0.9, (30, 3)), rng.uniform(0, 0.008, (6, 3))
    colours = np.concatenate([greys, *dark])
    steps = rng.standard_normal((8, 1, 3)) * colours.mean(axis=-1, keepdims=True) * 1e-5
    found = np.linalg.norm(np.einsum("krc,skc->skr", CIE94_metric(colours), steps), axis=-1)
    white = np.ones(3)
    # The textile constants are 2, .048 and .014; the graphic arts' 1, .045 and .015.
    true = colour.delta_E(
        np.broadcast_to(cielab(colours, white), steps.shape),
        cielab(colours + steps, white),
        method="CIE 1994",
        textiles=False,
    )
    # A step of 1e-5 bends the curves by as much, a few times where X, Y and Z differ widely.
    assert found == pytest.approx(true, rel=1e-3)
    assert found.min() > 0
