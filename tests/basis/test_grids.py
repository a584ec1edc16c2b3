"""One method on any grid: the same colours, whatever the sampling."""

from __future__ import annotations

from typing import Any

import pytest

from volspec.basis import SpectralBasis
from volspec.basis import report as pairs
from volspec.spectra import SpectralGrid, light, light_set, reflectance, reflectance_set

# Products of surfaces have errors of their own, which take most of a report on a fine grid.
pytestmark = pytest.mark.usefixtures("few_products")
GRIDS = [
    SpectralGrid(400, 700, 10),
    SpectralGrid(360, 830, 5),
    pytest.param(SpectralGrid(360, 830, 1), marks=pytest.mark.slow),
]


@pytest.fixture
def few_products(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairs, "_MOST_PRODUCTS", 10)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize(
    ("options", "mean", "maximum"),
    # Measured on the three grids: .009 .010 .010 (max .08); .13 .14 .14 (1.4); .25 to .29 (4.4).
    [({}, 0.012, 0.11), ({"positive": True}, 0.16, 1.6), ({"method": "pca-sharpened"}, 0.32, 5.0)],
    ids=["virtual-sensors", "positive", "pca-sharpened"],
)
def test_componentwise_errors_are_alike_on_every_grid(
    grid: SpectralGrid, options: dict[str, Any], mean: float, maximum: float
) -> None:
    lights = light_set("smooth", grid)
    basis = SpectralBasis.fit(
        lights, reflectance_set("training", grid), size=7, grid=grid, **options
    )
    found = basis.report(lights).componentwise
    print(found)
    assert found.mean <= mean
    assert found.max <= maximum


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize(
    ("method", "mean"),
    # Measured: reduced-rank .10 .11 .11; pca .19 .22 .22.
    [("reduced-rank", 0.13), ("pca", 0.25)],
)
def test_exact_errors_are_alike_on_every_grid(grid: SpectralGrid, method: str, mean: float) -> None:
    smooth = light_set("smooth", grid)
    lights = smooth + light_set("spiky", grid) if method == "reduced-rank" else smooth
    basis = SpectralBasis.fit(
        lights, reflectance_set("training", grid), size=7, grid=grid, method=method
    )
    found = basis.report(smooth).exact
    print(found)
    assert found.mean <= mean


@pytest.mark.parametrize("step", [5, 1])
def test_a_scene_may_bring_a_fine_grid(step: int) -> None:
    grid = SpectralGrid(360, 830, step)
    lights = [light(n, grid) for n in ("D65", "A", "planck:4000")]
    samples = [reflectance(f"CES/{k}", grid) for k in (5, 25, 45, 65, 85)]
    basis = SpectralBasis.fit(lights, samples, size=6, grid=grid, restarts=0)
    assert basis.analysis.shape == (6, grid.size)
    assert basis.report(lights, samples).componentwise.max <= 0.2
