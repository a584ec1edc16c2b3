"""Breneman's corresponding colours: the means of METHOD, and the table of docs/adaptation.md."""

from pathlib import Path

import numpy as np
import pytest

from tools import breneman
from volspec.appearance.adaptation import ADAPTATIONS, adapt

DOC = Path(__file__).parents[2] / "docs" / "adaptation.md"
# Mean Δu'v' over eight experiments of 12 colours, as computed beforehand from the papers'
# equations; four decimals.
MEANS = {
    "Fairchild 1990": (None, 0.0106),
    "CAT02": (1.0, 0.0158),
    "von Kries": (None, 0.0191),
    "CIE 1994": (None, 0.0257),
}


@pytest.mark.parametrize("method", MEANS)
def test_mean_error_is_the_known_one(method):
    D, mean = MEANS[method]
    assert breneman.errors(method, D).mean() == pytest.approx(mean, abs=1e-4)


def test_mean_of_a_linear_transform_does_not_hang_on_the_luminance_of_its_samples():
    first = breneman.experiments()[0]
    adapted = adapt([first.XYZ, 0.01 * first.XYZ], first.source, first.target, "Fairchild 1990")
    bright, dim = breneman.uv_from_XYZ(adapted)
    np.testing.assert_allclose(bright, dim, rtol=1e-12)


def test_doc_s_table_is_what_the_code_gives():
    table = breneman.table()
    assert table in DOC.read_text(encoding="utf-8"), (
        f"docs/adaptation.md is stale; paste what python -m tools.breneman prints:\n{table}"
    )


def test_every_adaptation_has_its_row():
    assert {method for _, method, _, _ in breneman.ROWS} == set(ADAPTATIONS)
