"""Breneman's corresponding colours: the means of METHOD, and the table of docs/adaptation.md."""

from pathlib import Path

import numpy as np
import pytest

from tools import breneman
from volspec.appearance.adaptation import ADAPTATIONS, adapt
from volspec.spectra.datasets import colour_science

DOC = Path(__file__).parents[2] / "docs" / "adaptation.md"
# Mean Δu'v' over eight experiments of 12 colours, as computed beforehand from the papers'
# equations; four decimals.
MEANS = {"Fairchild 1990": (None, 0.0106), "CAT02": (1.0, 0.0158), "von Kries": (None, 0.0191)}


@pytest.mark.parametrize("method", MEANS)
def test_mean_error_is_the_known_one(method):
    D, mean = MEANS[method]
    assert breneman.errors(method, D).mean() == pytest.approx(mean, abs=1e-4)


def foretold_by_colour_science(model: str) -> float:
    """Mean Δu'v' of its own predictions."""
    foretell = colour_science().corresponding_chromaticities_prediction
    seen = [each for number in breneman.EXPERIMENTS for each in foretell(number, model=model)]
    return float(np.mean([np.linalg.norm(each.uv_p - each.uv_m) for each in seen]))


def test_whites_are_the_lights_named():
    for each in breneman.experiments():
        uv = breneman.uv_from_XYZ([each.source.white_XYZ, each.target.white_XYZ])
        lights = each.lights.split(" to ")
        # CIE 15: u'v' of A, D55 and D65; observers' whites lie within 0.007.
        named = {"A": (0.256, 0.524), "D55": (0.2044, 0.4807), "D65": (0.1978, 0.4683)}
        for seen, light in zip(uv, lights, strict=True):
            if light in named:
                np.testing.assert_allclose(seen, named[light], atol=0.007)


def test_mean_of_a_linear_transform_does_not_hang_on_the_luminance_of_its_samples():
    first = breneman.experiments()[0]
    bright, dim = (
        breneman.uv_from_XYZ(adapt(f * first.XYZ, first.source, first.target, "Fairchild 1990"))
        for f in (1.0, 0.01)
    )
    np.testing.assert_allclose(bright, dim, rtol=1e-12)


def test_colour_science_misses_with_CIE_1994_where_the_paper_does_not():
    """Its prediction gives absolute XYZ where percent are due, and cd/m² for lux."""
    assert breneman.errors("CIE 1994").mean() == pytest.approx(0.0257, abs=1e-4)
    assert foretold_by_colour_science("CIE 1994") == pytest.approx(0.0517, abs=1e-4)


def test_colour_science_s_fairchild_1990_misses_as_von_kries():
    von_kries = breneman.errors("von Kries").mean()
    assert foretold_by_colour_science("Fairchild 1990") == pytest.approx(von_kries, rel=1e-9)


def test_doc_s_table_is_what_the_code_gives():
    table = breneman.table()
    assert table in DOC.read_text(encoding="utf-8"), (
        f"docs/adaptation.md is stale; paste what python -m tools.breneman prints:\n{table}"
    )


def test_every_adaptation_has_its_row():
    assert {method for _, method, _, _ in breneman.ROWS} == set(ADAPTATIONS)
