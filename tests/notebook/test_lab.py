"""The widget in a real JupyterLab: what is seen, what goes to Python and what comes from there."""

import io
import json
from collections.abc import Iterator
from itertools import count
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.notebook.lab import Lab, opened
from tests.support.browser import mean_difference, missing
from tests.support.images import some_rows
from tests.support.patience import wait_until
from volspec.appearance import Viewing
from volspec.image import CoefficientImage
from volspec.pipeline import relight
from volspec.spectra import light

# Eight bits a channel, and the display's rounding: 0.1 to 0.2 on the engine.
NEAR = 0.4
ASKED = "print(json.dumps([dict(w.weights), w.viewing.model, w.probe, w.probed and w.probed.XYZ]))"
CELLS = (
    "import json\n"
    "import volspec as vs\n"
    "w = vs.notebook(vs.CoefficientImage.load('colours.exr'), ['D65', 'A', 'HP1'])\n"
    "w",
    ASKED,
    "w.weights = {'HP1': 1.0}\nw.viewing = vs.Viewing(model='none')\nw.probe = (40, 20)",
    "w.image = vs.CoefficientImage.load('turned.exr')",
    ASKED,
)


@pytest.fixture(scope="module")
def lab(
    tmp_path_factory: pytest.TempPathFactory, colours: CoefficientImage, turned: CoefficientImage
) -> Iterator[Lab]:
    pytest.importorskip("jupyterlab")
    if why := missing():
        pytest.skip(why)
    folder = tmp_path_factory.mktemp("lab")
    colours.save(folder / "colours.exr")
    turned.save(folder / "turned.exr")
    # What the kernel's lights need is kept for it.
    for name in ("D65", "A", "HP1"):
        light(name)
    with opened(folder, CELLS) as made:
        yield made


@pytest.fixture(scope="module")
def turned(colours: CoefficientImage) -> CoefficientImage:
    """Its lower half: another size."""
    return some_rows(colours, slice(colours.size[1] // 2, None))


def seen(lab: Lab, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The picture on the screen, one sample for each of its pixels."""
    shot = Image.open(io.BytesIO(lab.frame.locator("#picture").screenshot())).convert("RGB")
    columns, rows = (
        ((np.arange(count) + 0.5) * whole / count).astype(int)
        for count, whole in zip(size, shot.size, strict=True)
    )
    return np.asarray(shot)[rows[:, None], columns]


def clear(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Crop the picture to what labels, buttons and the probe's card leave visible."""
    height, width = frame.shape[:2]
    return frame[height // 4 : -height // 4, 7 * width // 16 :]


def until_shown(lab: Lab, wanted: NDArray[np.uint8]) -> None:
    """Wait until a picture is visible: a slow browser draws it in parts."""
    size = wanted.shape[1], wanted.shape[0]
    wait_until(
        lambda: mean_difference(clear(seen(lab, size)), clear(wanted)) <= NEAR, "another picture"
    )


@pytest.mark.slow
def test_one_picture_goes_to_and_fro(lab, colours, turned):
    """One story: each step needs the one before, and a second JupyterLab costs too much."""
    assert seen(lab, colours.size).std() > 20, "the picture is empty"
    until_shown(lab, relight(colours, light("D65")))

    # A slider is dragged and a pixel is clicked in the page; the next cell reads them.
    track = lab.frame.locator("#light-list li:nth-child(2) input").bounding_box()
    across, down = track["x"] + track["width"] / 2, track["y"] + track["height"] / 2
    lab.page.mouse.move(track["x"] + 4, down)
    lab.page.mouse.down()
    lab.page.mouse.move(across, down, steps=5)
    lab.page.mouse.up()
    lab.frame.locator("#picture").click(position={"x": 300, "y": 250})
    card = lab.frame.locator("#probe-rows dd")
    place, XYZ = (card.nth(k).text_content() for k in (0, 2))
    # The page reports up to ten times a second: a cell run at once may be before the click.
    answers = (json.loads(lab.run(1)) for _ in count())
    weights, _, probe, probed = next(answer for answer in answers if answer[2])
    assert weights["D65"] == 1.0 and abs(weights["A"] - 0.5) < 0.1 and weights["HP1"] == 0.0
    assert place == ", ".join(map(str, probe))
    # Eight bits of each channel: a step of the root of 255 moves a bright pixel by 0.8 %.
    np.testing.assert_allclose([float(part) for part in XYZ.split()], probed, rtol=0.02, atol=0.1)

    # What a cell sets is drawn, and another image takes its place with the same settings.
    lab.run(2)
    lab.until("#label-a", "HP1")
    bare = Viewing(model="none")
    until_shown(lab, relight(colours, light("HP1"), bare))
    lab.run(3)
    lab.until(f"#picture[height='{turned.size[1]}']", "")
    lab.ready()
    lab.until("#label-a", "HP1")
    wanted = relight(turned, light("HP1"), bare)
    until_shown(lab, wanted)
    with lab.page.expect_download() as download:
        lab.frame.locator("header .download").click()
    saved = np.asarray(Image.open(download.value.path()).convert("RGB"))
    assert mean_difference(saved, wanted) <= NEAR
    assert json.loads(lab.run(4))[1:3] == ["none", [40, 20]]

    # The page is apart from the notebook, and nothing has asked another host for anything.
    element = lab.page.locator(".jp-OutputArea iframe")
    assert set(element.get_attribute("sandbox").split()) == {"allow-scripts", "allow-downloads"}
    hosts = {urlsplit(url).hostname for url in lab.requests if url.startswith(("http", "ws"))}
    assert hosts == {"127.0.0.1"}
