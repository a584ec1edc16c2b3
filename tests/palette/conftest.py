"""Designs of shipped palettes, which several files report and draw."""

from pathlib import Path

import pytest

from volspec.palette import Design, Palette, design, load_palette

PALETTES = Path(__file__).resolve().parents[2] / "data" / "palettes"


@pytest.fixture(scope="session")
def figure_1() -> Palette:
    """A flame and a paint by day and under sodium."""
    return load_palette(PALETTES / "figure-1.toml")


@pytest.fixture(scope="session")
def sodium(figure_1: Palette) -> Design:
    """The design of figure 1."""
    return design(figure_1)


@pytest.fixture(scope="session")
def figure_2() -> Design:
    """The design of figure 2."""
    return design(load_palette(PALETTES / "figure-2.toml"))
