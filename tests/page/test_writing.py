"""Content of a page and its refusals, without a browser."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import call, refusal
from tests.support.errors import refuses, warns
from tests.support.images import some_rows
from volspec.appearance import Viewing
from volspec.errors import ImageError, ShapeError, ViewingError
from volspec.export.page import PageSpec, PageView, page_html, write_page
from volspec.export.page.packing import median_prediction, residual_bytes
from volspec.export.page.payload import look_numbers, models
from volspec.relight import RelightSpec
from volspec.spectra import reflectance


def test_edges_predict_from_the_neighbours_that_there_are():
    plane = np.array([[5, 7, 9], [6, 1, 4]])
    # West along the first row, north down the first column; else the median of three.
    assert median_prediction(plane).tolist() == [[0, 5, 7], [5, 7, 3]]


def test_a_plane_like_the_one_before_costs_nothing():
    plane = np.arange(12).reshape(3, 4)
    data = residual_bytes(np.stack([plane, plane + 3], axis=-1), 8)
    assert len(data) == 24 and data[12] == 3 and not any(data[13:])


def test_twelve_bits_are_written_high_bytes_first():
    codes = np.full((1, 2, 1), 0x3A5)
    assert residual_bytes(codes, 12) == bytes([0x03, 0x00, 0xA5, 0x00])


def test_a_page_is_one_file_of_the_size_asked_for(tmp_path, capsys):
    scene = Path(__file__).resolve().parents[2] / "data" / "scenes" / "engine.toml"
    out = tmp_path / "engine.html"
    words = ("page", scene, "-o", out, "--views", "3", "--size", "48x32")
    assert call(*words, "--light", "planck:2000", "--title", "Around") == 0
    assert "3 views" in capsys.readouterr().out
    text = out.read_text(encoding="utf-8")
    assert text.count('type="text/plain" id="view-') == 3
    assert "<title>Around</title>" in text and '"width":48,"height":32' in text
    assert "planck:2000" in text and "http://" not in text.replace("http://www.w3.org/", "")
    assert list(tmp_path.iterdir()) == [out]
    assert refusal(*words, "--play").code == "conflict"


@pytest.mark.parametrize("model", ["Hunt", "Nayatani95", "ZCAM"])
def test_a_model_without_closed_form_is_replaced_with_a_warning(model, engine_scene):
    with warns(model, "CIECAM02"):
        look = look_numbers(RelightSpec(Viewing(model=model)), engine_scene.lights)
    assert look["model"] == "CIECAM02" and model not in models()["appearance"]
    kept = look_numbers(RelightSpec(Viewing(model="Hellwig2022")), engine_scene.lights)
    assert kept["model"] == "Hellwig2022"


def test_pages_need_a_view_a_light_and_views_alike(engine_scene, engine_image):
    view, lights = PageView(engine_image), engine_scene.lights
    cut, copper = some_rows(engine_image, slice(40)), RelightSpec(backdrop=reflectance("copper"))
    refuses(lambda: page_html([view], []), "missing page.lights", ImageError)
    refuses(lambda: page_html([], lights), "missing page.views", ImageError)
    refuses(lambda: page_html([view, PageView(cut)], lights), "shape page.views", ShapeError)
    refuses(lambda: page_html([view], lights, copper), "unsupported page.backdrop", ViewingError)
    refuses(lambda: PageSpec(bits=16), "range PageSpec.bits", ImageError)
    refuses(lambda: write_page("page.exr", [view], lights), "unsupported", ImageError)
