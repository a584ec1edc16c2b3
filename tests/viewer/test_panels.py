"""What panels say, without a window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from volspec.pipeline import raycast
from volspec.relight import RelightSpec
from volspec.viewer.document import Document
from volspec.viewer.lighting import rig_of
from volspec.viewer.state import ViewState

desk = pytest.importorskip("volspec.viewer.panels.desk")


def test_a_search_finds_every_word_and_what_starts_with_it_first() -> None:
    from volspec.viewer.panels.lights import matching

    assert matching("d65")[0] == "D65"
    found = matching("fl")
    assert found[0].startswith("FL") and all("fl" in name.casefold() for name in found)
    assert matching("no such light") == []


def test_swatches_show_tungsten_orange_and_what_adapts_to_it_nearly_white(
    state: ViewState,
) -> None:
    raw, adapted = desk.swatch_colours(state.lights[1].rig, state.seen)
    assert raw[0] == pytest.approx(1.0) and raw[2] < 0.5
    assert min(adapted) > 0.85


def test_swatches_are_kept(state: ViewState) -> None:
    kept = desk.Desk()
    first = kept.swatch(state.lights[0].rig, state.seen)
    assert kept.swatch(state.lights[0].rig, state.seen) is first


def test_settings_that_do_not_go_together_are_left_as_they_are() -> None:
    from volspec.viewer.panels.viewing import changed, with_model

    seen = changed(RelightSpec(), adapting="pixel")
    assert with_model(seen, "Hunt").viewing.adapting == "picture"
    assert changed(seen, model="Hunt") is seen
    assert changed(seen, discount=True).viewing.discount


@pytest.mark.parametrize("logarithmic", [False, True])
def test_histogram_bars_stay_within_the_plot(logarithmic: bool) -> None:
    from volspec.viewer.panels.transfer import bars

    for counts in (np.zeros(256), np.r_[1e9, np.ones(255)]):
        heights = bars(counts, logarithmic)
        assert np.isfinite(heights).all() and heights.min() >= 0 and heights.max() <= 1


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_probe_says_where_a_ball_is_hit(
    state: ViewState, document: Document, orthographic: bool
) -> None:
    """The middle of the picture is hit on the near side, on the camera's axis."""
    from volspec.viewer.panels.probe import place_mm, probed

    view = replace(state.view, orthographic=orthographic)
    camera = view.camera(document.volume)
    image = raycast(document.volume, document.transfer, camera, (33, 33))
    rig = rig_of(state.lights)
    assert rig is not None
    said = probed(image, camera, rig, state.seen, (16, 16))
    assert list(said) == ["XYZ", "J C h", "mm"]
    place = place_mm(image, camera, (16, 16))
    assert place is not None
    centre = document.volume.corners_mm.mean(axis=0)
    away = np.subtract(camera.position_mm, centre)
    nearer = np.subtract(place, centre)
    assert 0 < nearer @ away / np.linalg.norm(away) < 4.0
    # 8-voxel ball: within a tenth of a voxel of the axis.
    off = nearer - (nearer @ away) / (away @ away) * away
    assert np.linalg.norm(off) < 0.1
    assert place_mm(image, camera, (0, 0)) is None


def test_the_status_line_tells_coarse_from_whole(state: ViewState, document: Document) -> None:
    from volspec.viewer.panels.status import sizes, timings

    here = desk.Desk()
    assert sizes(state, here) == "casting …"
    here.image = raycast(
        document.volume, document.transfer, state.view.camera(document.volume), (40, 30)
    )
    assert sizes(state, here) == "160 × 120, refining (1/4)"
    here.whole, here.fps, here.ms = True, 59.9, {"cast": 12.3}
    assert sizes(state, here) == "160 × 120" and timings(here) == "60 fps   cast 12 ms"
