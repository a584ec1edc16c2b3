"""Reflectances to be distinguished with and without a colour-vision deficiency."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.fixtures import slow_each
from tests.support.palettes import free_light, given, lamp, shown_codes, surface
from volspec.appearance import Viewing
from volspec.appearance.display.deficiency import DEFICIENCIES, simulation
from volspec.appearance.models.lab import delta_E_2000
from volspec.palette import (
    Apart,
    Cell,
    Criteria,
    DesignReport,
    Palette,
    design,
    load_palette,
    save_palette,
)
from volspec.palette.optimisation import Phase, apart_cost, true_cost
from volspec.palette.state import DesignState

EXAMPLE = Path(__file__).resolve().parents[2] / "data" / "palettes" / "colour-vision.toml"
# A red, and the green that a deuteranope takes for it.
RED, GREEN = (0.784, 0.333, 0.239), (0.439, 0.553, 0.204)


def palette(*apart: Apart, light: str = "L", **more: object) -> Palette:
    """Red and green by day; under a free light the red stays."""
    cells = {
        ("a", "D65"): Cell(colour=RED, weight=4.0),
        ("b", "D65"): Cell(colour=GREEN, weight=4.0),
        ("a", light): Cell(colour=RED),
    }
    viewing = Viewing("CAT02", exposure=3.0)
    lights = lamp("D65"), free_light(light, band_nm=(420, 680))
    rows = surface("a"), surface("b")
    criteria = Criteria(smoothness=3e-3, rounds=6)
    return Palette(rows, lights, cells, viewing, criteria=criteria, apart=apart, **more)


def simulated(made: DesignState, deficiency: str, column: int) -> np.ndarray:
    """CIELAB of both rows as the picture would show them."""
    model = made.colour_models()[column]
    linear = np.clip(made.RGB()[:, column], 0.0, 1.0)
    if (simulates := simulation(deficiency, 1.0, model.space)) is not None:
        linear = np.clip(simulates.apply(linear), 0.0, 1.0)
    return model.Lab_from_RGB(linear)


OTHERS = [each for each in DEFICIENCIES if each != "deutan"]
EVERY = pytest.mark.parametrize("deficiency", ["deutan", *slow_each(*OTHERS)])


@EVERY
def test_a_row_parts_what_a_viewer_sees(deficiency):
    made = design(palette(Apart(light="L", deficiency=deficiency, distance=30.0)))
    assert np.linalg.norm(np.subtract(*simulated(made.state, deficiency, 1))) >= 29.5
    by_day = np.abs(shown_codes(made)[:, 0] - [RED, GREEN]).max()
    assert by_day < 0.01


def test_a_deuteranope_sees_one_colour_by_day_and_two_under_the_example_s_light():
    made = design(load_palette(EXAMPLE))
    assert made.kept
    (pair,) = DesignReport.of(made).apart
    assert pair.lights == ("for all",) and pair.deficiencies == ("none", "protan", "deutan")
    assert pair.delta_E["daylight"]["deutan"] < 0.5 < 40.0 < pair.delta_E["daylight"]["none"]
    assert min(pair.smallest.values()) > 30.0


def test_without_lightness_only_hue_and_chroma_count():
    row = Apart(light="L", deficiency=("none", "deutan"), distance=35.0, lightness=False)
    made = design(palette(row))
    for deficiency in row.deficiencies:
        one, other = simulated(made.state, deficiency, 1)
        assert np.linalg.norm((one - other)[1:]) >= 34.0


@pytest.mark.not_quick
def test_what_is_apart_already_costs_nothing():
    """Rows are one-sided: they never pull colours together."""
    free = design(palette(Apart(light="L", deficiency="tritan", distance=5.0)))
    (pair,) = DesignReport.of(free).apart
    assert pair.smallest["tritan"] > 5.0
    state = replace(free.state, palette=replace(free.state.palette, apart=()))
    assert true_cost(free.state) == pytest.approx(true_cost(state), abs=1e-12)
    assert apart_cost(free.state, free.state.RGB()) == 0.0


def test_the_cost_is_the_shortfall():
    rows = given("a", 0.30), given("b", 0.34)
    apart = Apart(deficiency=("none", "protan"), distance=40.0, weight=2.0)
    cells = {("a", "L"): Cell("free", group="any")}
    state = DesignState.start(Palette(rows, (free_light(),), cells, apart=(apart,)))
    short = [
        40.0 - np.linalg.norm(np.subtract(*simulated(state, name, 0)))
        for name in ("none", "protan")
    ]
    expected = sum((2.0 * 0.01 * each) ** 2 / 3.0 for each in short)
    assert min(short) > 0.0
    assert apart_cost(state, state.RGB()) == pytest.approx(expected)
    assert DesignReport.of(design(state.palette)).cost["apart"] > 0.0


@EVERY
def test_equations_are_the_tangent_of_what_is_seen(deficiency):
    """A small step of the light's spectrum changes the distance as the row says."""
    state = design(palette(Apart(light="L", deficiency=deficiency, distance=30.0))).state
    blocks, terms = Phase(state, lights=True, first=False).problem()
    row = next(term for term in terms if "excess" in term.label)
    model = state.colour_models()[1]
    E = state.E[1] * (1.0 + 1e-4 * np.random.default_rng(1).standard_normal(state.E[1].shape))
    # Adaptation changes with the light, but not within a phase.
    XYZ = [state.Q @ (spectrum * state.S.T[:, i]) for i in (0, 1) for spectrum in (state.E[1], E)]
    RGB = model.RGB_from_XYZ(np.stack(XYZ)).reshape(2, 2, 3)
    Lab = model.simulated_Lab(RGB, deficiency)
    distance = np.linalg.norm(Lab[0] - Lab[1], axis=-1)
    names = [name for name in row.parts if "shown" in name]
    assert all(blocks[name].size == 3 for name in names) and len(names) == 2
    ends = dict(zip(names, (RGB[0], RGB[1]), strict=True))
    made = [sum(row.parts[n] @ ends[n][k] for n in names)[0] - row.target[0] for k in (0, 1)]
    unit = 0.01 / np.sqrt(3.0)
    assert made[0] / unit + 30.0 == pytest.approx(distance[0], abs=1e-6)
    change = distance[1] - distance[0]
    assert (made[1] - made[0]) / unit == pytest.approx(change, abs=0.02 * abs(change) + 1e-5)


def test_pairs_are_of_every_reflectance_and_light_named():
    rows = tuple(surface(name) for name in "abc")
    cells = {("a", "D65"): Cell(colour=RED)}
    lights = lamp("D65"), lamp("A")
    asked = Palette(rows, lights, cells, apart=(Apart(), Apart(reflectance=("c", "a"), light="A")))
    pairs = [(pair.one, pair.other) for pair in asked.apart_pairs()]
    assert len(pairs) == 6 + 1 and pairs[-1] == ((2, 1), (0, 1))
    moved = Apart().renamed({"a": "x", "c": "z"}, {"A": "lamp"})
    assert moved == Apart(reflectance=("x", "z"), light=("lamp",))
    assert Apart(reflectance=("a", "b")).renamed({"a": "x"}, {"A": "A"}) is None


@pytest.mark.not_quick
def test_figures_are_of_the_picture_s_colours():
    made = design(palette(Apart(light="L", deficiency="deutan")))
    (pair,) = DesignReport.of(made).apart
    for name in DEFICIENCIES:
        for column, light in enumerate(("D65", "L")):
            expected = delta_E_2000(*simulated(made.state, name, column))
            assert pair.delta_E[light][name] == pytest.approx(float(expected), abs=1e-9)
    assert pair.smallest == pair.delta_E["L"]


def test_distinct_cells_are_reported_as_well():
    cells = {("a", "D65"): Cell("distinct", other=("b", "D65"), distance=20.0)}
    made = design(Palette((surface("a"), surface("b")), (lamp("D65"),), cells, Viewing("CAT02")))
    (pair,) = DesignReport.of(made).apart
    assert pair.reflectances == ("a", "b") and pair.deficiencies == ("none",)
    own = DesignReport.of(made).cell(("a", "D65")).delta_E_2000
    assert pair.smallest["none"] == pytest.approx(own)


def test_files_hold_rows_and_load_them_again(tmp_path):
    asked = palette(
        Apart(reflectance=("a", "b"), light="L", deficiency=("none", "deutan"), severity=0.6),
        Apart(lightness=False, distance=12.0, weight=3.0),
    )
    save_palette(asked, tmp_path / "new.toml")
    loaded = load_palette(tmp_path / "new.toml")
    assert loaded.apart == asked.apart
    other = replace(loaded, apart=loaded.apart[:1])
    save_palette(other, tmp_path / "kept.toml", source=tmp_path / "new.toml")
    assert load_palette(tmp_path / "kept.toml").apart == other.apart


def test_a_viewing_s_simulation_is_not_written(tmp_path):
    simulating = replace(palette(), viewing=Viewing("CAT02", deficiency="protan"))
    save_palette(simulating, tmp_path / "palette.toml")
    assert load_palette(tmp_path / "palette.toml").viewing == Viewing("CAT02")
