"""Figures are drawn as their pictures; `python -m tests.basis.test_figures` writes them again."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib import __version__
from PIL import Image

from tests.support.fixtures import slow_each
from volspec.appearance.comparison.rendition import RENDITION_GRID, colour_rendition
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.figure import basis_figure
from volspec.basis.light_figure import light_figure
from volspec.basis.reflectance_figure import reflectance_figure
from volspec.basis.report_table import error_table
from volspec.spectra import light, reflectance

FOLDER = Path(__file__).with_name("figures")
LAMPS = {"smooth": [light("D65"), light("A")], "spiky": [light("FL2"), light("HP1")]}
CHECKER = "red", "green", "blue", "yellow", "cyan", "orange", "purple", "foliage"
NAMES = ["copper", "iron", "gold", "silver", *(f"ColorChecker/{name}" for name in CHECKER)]
PAINTS = {name: reflectance(name) for name in NAMES}
FIGURES = "materials", *slow_each("many", "general", "light", "reflectance")


def drawn(name: str) -> Image.Image:
    lamp, other = (light(each, RENDITION_GRID) for each in ("FL4", "A"))
    match name:
        case "light":
            figure = light_figure(lamp, other, colour_rendition(lamp), "SSI 32")
        case "reflectance":
            parts = {key: (0.5, each.values) for key, each in list(PAINTS.items())[:2]}
            figure = reflectance_figure(PAINTS["gold"], parts, LAMPS["smooth"])
        case "general":
            table = error_table(SpectralBasis.load("general-7"), LAMPS, list(PAINTS.values()))
            figure = basis_figure(table)
        case _:
            few = list(PAINTS.items())[: 2 if name == "materials" else None]
            figure = basis_figure(error_table(MaterialBasis(dict(few)), LAMPS))
    figure.canvas.draw()
    return Image.fromarray(np.array(figure.canvas.buffer_rgba())[..., :3]).reduce(2)


@pytest.mark.skipif(not __version__.startswith("3.11."), reason="pip install matplotlib==3.11.*")
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_drawn_as_its_picture(name):
    with Image.open(FOLDER / f"{name}.png") as picture:
        one, other = (np.asarray(each.convert("RGB"), int) for each in (picture, drawn(name)))
    assert (np.abs(one - other).max(axis=-1) > 32).sum() <= 4


if __name__ == "__main__":
    for path in FOLDER.glob("*.png"):
        drawn(path.stem).save(path, optimize=True)
