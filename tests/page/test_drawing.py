"""Times and sizes of a page's drawing: coarse only while a slow browser's light moves."""

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.fixtures import slow
from volspec.export.page import PageView, write_page
from volspec.image import CoefficientImage
from volspec.scene import Scene

# By the page's clock whole pictures take so many milliseconds, and all else no time. The last
# coarse one is kept, and how often was drawn.
SLOW = """
let clock = 0;
performance.now = () => clock;
const draw = WebGL2RenderingContext.prototype.drawArrays;
window.draws = 0;
WebGL2RenderingContext.prototype.drawArrays = function (...what) {
  draw.apply(this, what);
  window.draws += 1;
  if (this.canvas.width < parseInt(this.canvas.style.width)) {
    window.coarse = this.canvas.toDataURL();
    return;
  }
  clock += MS;
};"""
DRAG = """async () => {
  const slider = document.querySelector('#light-list input'), widths = [];
  for (const value of [0.9, 0.8, 0.7, 0.6, 0.5]) {
    slider.value = value;
    slider.dispatchEvent(new Event('input'));
    await new Promise(requestAnimationFrame);
    await new Promise(requestAnimationFrame);
    widths.push(document.getElementById('picture').width);
  }
  return widths;
}"""


@pytest.fixture(scope="module")
def file(
    tmp_path_factory: pytest.TempPathFactory, engine_scene: Scene, engine_image: CoefficientImage
) -> Path:
    path = tmp_path_factory.mktemp("drawing") / "page.html"
    write_page(path, [PageView(engine_image)], engine_scene.lights, engine_scene.relight)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("milliseconds", [60, slow(400)])
def test_a_slow_browser_draws_coarsely_while_the_light_moves_and_nothing_under_the_mouse(
    opened, file, milliseconds
):
    page = opened(file, before=SLOW.replace("MS", str(milliseconds)))
    draws, box = page.page.evaluate("window.draws"), page.page.locator("#picture").bounding_box()
    for step in range(5):
        page.page.mouse.move(box["x"] + 60 + 20 * step, box["y"] + 90)
        page.settle()
    assert page.page.query_selector("#probe-rows dd") is not None
    assert page.page.evaluate("window.draws") == draws
    # Half of rows and columns are drawn until the light rests.
    widths = page.page.evaluate(DRAG)
    whole = page.page.evaluate("parseInt(document.getElementById('picture').style.width)")
    assert widths[-1] == -(-whole // 2)
    drawn = page.page.evaluate("window.coarse").partition(",")[2]
    coarse = np.asarray(Image.open(io.BytesIO(base64.b64decode(drawn))).convert("RGB"), float)
    page.until(f"document.getElementById('picture').width === {whole}")
    # The same numbers through the same arithmetic: one code at most.
    assert np.abs(coarse - page.picture()[::2, ::2]).max() <= 1
    assert page.complaints == []
