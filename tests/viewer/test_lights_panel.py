"""The lights panel without a window: library, plots of spectra, the dial and its names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.patience import wait_until
from volspec.appearance.rendition import light_figures
from volspec.relight import LightRig
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, light, reflectance
from volspec.spectra.library import library_names
from volspec.viewer.model import light_parts, lights
from volspec.viewer.model.rendition import chosen_lights, measure
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import lights_dial
from volspec.viewer.ui.light_look import column_heights, raw_colour
from volspec.viewer.ui.lights_dial import Ring
from volspec.viewer.ui.lights_library import verdict
from volspec.viewer.ui.lights_rendition import metamer_lines, number_lines
from volspec.viewer.ui.lights_spectrum import pen_place, wavelength_share
from volspec.viewer.ui.overlays import label_boxes
from volspec.viewer.work.rendition import RenditionService

AREA = (0, 20, 900, 600)


@given(at=st.floats(0, 900), left=st.floats(20, 400), right=st.floats(20, 400))
def test_names_of_both_sides_stay_inside_and_apart(at: float, left: float, right: float) -> None:
    a, b = label_boxes(AREA, at, (left, right), 20.0, 16.0, 12.0)
    for x, y, width, height in (a, b):
        assert x >= 12 and x + width <= 888 and y >= 20 and height == 20
    side_by_side = a[0] + a[2] <= b[0] or b[0] + b[2] <= a[0]
    assert side_by_side or abs(a[1] - b[1]) >= 20
    # In the upper line they are on their own sides.
    assert a[1] > 36 or a[0] + a[2] <= at
    assert b[1] > 36 or b[0] >= at


def test_the_library_says_what_a_notation_is_or_what_is_wrong_with_it() -> None:
    for text in ("D65*0.7+planck:2700*0.3", *library_names()):
        rig, wrong = verdict(text, DEFAULT_GRID, ".")
        assert rig is not None and wrong == "", text
    for text, named in (("D65*0.7+Q*0.3", "'Q'"), ("daylight:62", "62"), ("lamp.csv", "file")):
        rig, wrong = verdict(text, DEFAULT_GRID, ".")
        assert rig is None and named in wrong


def test_a_light_without_its_colour_to_the_display_has_one_all_the_same() -> None:
    """Sodium lies outside of sRGB; a swatch is within it, its strongest channel at 1."""
    for name in ("HP1", "LPS", "D65", "LED-B1"):
        colour = raw_colour(LightRig((light(name),)))
        assert min(colour) >= 0.0 and max(colour) == pytest.approx(1.0)


def test_columns_of_a_plot_lie_on_the_bands() -> None:
    values = np.arange(31.0)
    np.testing.assert_allclose(column_heights(values, 31), values)
    # 15 columns a band: the middle one is the band's.
    np.testing.assert_allclose(column_heights(values, 31 * 15)[7::15], values)
    # The pen on a wavelength's tick is on its band: 550 nm is the 16th of 31.
    share = wavelength_share(550.0, PAPERS_GRID)
    place = pen_place((share * 310.0, 0.0), (0.0, 0.0, 310.0, 50.0), 31, 2.0)
    assert place == pytest.approx((15 / 30, 2.0))


LONG = (
    *("Macbeth daylight", "Tungsten halogen", "HP1 high-pressure sodium"),
    *("FL2", "Candle flame, 1900 K", "D65"),
)


def wide(text: str) -> float:
    """Mean width of the panel's letters."""
    return 6.2 * len(text) + 4


def ring_in(width: float, height: float, most: float, names: Sequence[str] = LONG) -> Ring:
    """Return the dial with names in a panel's area, of radius ``most`` at the most."""
    return lights_dial.ring_for(names, (0.0, 0.0, width, height), (24.0, most), 10.0, 15.0, wide)


@given(
    boxes=st.lists(
        st.tuples(st.floats(-20, 120), st.floats(-20, 120), st.floats(1, 60), st.floats(1, 20)),
        max_size=40,
    )
)
def test_names_at_the_dial_never_overlap(boxes: list[tuple[float, float, float, float]]) -> None:
    labels = [lights_dial.Label(i, box, float(i)) for i, box in enumerate(boxes)]
    kept = lights_dial.non_overlapping(labels, (0.0, 0.0, 100.0, 100.0))
    for i, one in enumerate(kept):
        x, y, width, height = one.box
        assert x >= 0 and y >= 0 and x + width <= 100 and y + height <= 100
        for other in kept[i + 1 :]:
            left, top, wide, tall = other.box
            assert x + width <= left or left + wide <= x or y + height <= top or top + tall <= y
    inside = [e for e in labels if lights_dial.non_overlapping([e], (0.0, 0.0, 100.0, 100.0))]
    assert not inside or kept[0] == inside[0]


def test_long_names_are_whole_around_a_dial_as_small_as_it_gets() -> None:
    """Size that the panel gives it in a window of 900 by 600 pixels."""
    ring = ring_in(250.0, 103.0, 24.5)
    labels = lights_dial.place_labels(LONG, range(6), ring)
    written = {label.index: " ".join(label.lines).replace("- ", "-") for label in labels}
    assert written == dict(enumerate(LONG))
    # The sodium lamp, at the right, has moved the dial to the left.
    assert ring.middle[0] < 125.0 and ring.middle[1] == 51.5


def test_names_at_the_left_end_at_the_dial_and_those_at_the_right_begin_there() -> None:
    ring = ring_in(320.0, 200.0, 60.0)
    for label in lights_dial.place_labels(LONG, range(6), ring):
        across = lights.rim_places(6)[label.index][0]
        at = pytest.approx(ring.middle[0] + across * ring.reach)
        starts = lights_dial.line_starts(label, across, wide)
        for start, text in zip(starts, label.lines, strict=True):
            assert across <= 0.5 or start == at
            assert across >= -0.5 or start + wide(text) == at


def test_a_name_that_has_no_room_ends_in_an_ellipsis_and_takes_no_other_s_place() -> None:
    crowded = ("D65", "Osram Dulux, warm white", "x" * 40, *LONG)
    ring = ring_in(180.0, 103.0, 24.5, crowded)
    labels = lights_dial.place_labels(crowded, range(9), ring)
    plain = lights_dial.non_overlapping(labels, ring.within)
    assert len(plain) == len(labels) and any(label.lines[0].endswith("…") for label in labels)
    assert labels[0].lines == ("D65",)


def test_the_dial_is_smaller_for_long_names_and_stays_where_they_are_short() -> None:
    short, long = (ring_in(330.0, 300.0, 105.0, names) for names in (("D65", "A", "FL2"), LONG))
    assert short.radius == 105.0 and short.middle == (165.0, 150.0)
    assert 63.0 <= long.radius < 105.0
    assert sum(lights_dial.extents(LONG, long.radius + 10.0, wide)) <= 330.0


def test_a_light_is_found_at_the_rim_and_by_its_name() -> None:
    ring = ring_in(330.0, 300.0, 105.0)
    labels = lights_dial.place_labels(LONG, range(6), ring)
    x, y, width, height = next(label for label in labels if label.index == 2).box
    assert lights_dial.label_at(labels, x + width / 2, y + height / 2) == 2
    assert lights_dial.label_at(labels, *ring.middle) == -1
    for x, y, found in ((0.05, -1.0, 0), (1.0, 0.02, 1), (0.0, 0.0, -1)):
        assert lights_dial.light_at(4, x, y, 0.1) == found


def test_rendition_is_that_of_the_light_s_notation_over_the_whole_visible(state: ViewState) -> None:
    """The figures of a light by its name do not depend on the document's bands."""
    state = lights.add(state, text="FL2").state
    at = len(state.lights) - 1
    found = measure(chosen_lights(lights.choose(state, at), False))
    assert number_lines(found) == [
        *("R_f 70   R_g 86", "R_a 64   R_9 -84", "SSI 62, daylight:4225"),
        *("4225 K, Duv +0.0019", "337 lm/W"),
    ]
    # Once drawn, it has the document's bands only, and lines of their width.
    drawn = light_parts.draw(lights.choose(state, at), at, 0, (0.1, 0.5), (0.1, 0.5))
    other = measure(chosen_lights(drawn, False))
    assert 0.05 < abs(other.light.rendition.R_f - found.light.rendition.R_f) < 20


def test_rendition_of_the_mix_counts_what_shines(state: ViewState) -> None:
    for text in ("FL2", "FL12"):
        state = lights.add(state, text=text).state
    last = len(state.lights) - 1
    alone = lights.only(state, last)
    whole, single = (measure(chosen_lights(alone, whole)) for whole in (True, False))
    assert whole.light.lm_per_W == pytest.approx(single.light.lm_per_W)
    mix = lights.set_weight(lights.set_weight(alone, last, 0.5), last - 1, 0.5)
    mixed = light_figures(lambda grid: light("FL2*0.5+FL12*0.5", grid))
    found = measure(chosen_lights(mix, True)).light.rendition
    assert found.R_f == pytest.approx(mixed.rendition.R_f)
    assert chosen_lights(lights.set_weight(alone, last, 0.0), True) is None


def test_materials_alike_in_daylight_are_named_with_what_parts_them(state: ViewState) -> None:
    """The engine's block and inserts are a metameric pair, designed on the document's bands."""
    data = Path(__file__).resolve().parents[2] / "data" / "spectra"
    files = {name: str(data / f"engine-{name}.csv") for name in ("block", "inserts")}
    engine = tuple((n, reflectance(file)) for n, file in ({"copper": "copper"} | files).items())
    state = lights.add(state, text="A").state
    tungsten = chosen_lights(lights.choose(state, len(state.lights) - 1), False)
    found = measure(tungsten._replace(materials=engine))
    assert found.pair == ("block", "inserts") and found.metamerism.delta_E < 1
    assert found.metamerism.illuminant > 15
    first, second, third = metamer_lines(found)
    assert first.startswith("block and inserts: ΔE 0.") and second.startswith("ΔE 2")
    assert third.count("CIE 2015") == 2
    plain = measure(tungsten._replace(materials=engine[:2]))
    assert plain.pair is None and metamer_lines(plain) == []


def test_lights_are_measured_in_the_background_once_for_each_change(state: ViewState) -> None:
    service = RenditionService(lambda: None)
    first = chosen_lights(state, False)
    for _ in range(3):
        service.follow(first)
    wait_until(lambda: service.take() and not service.busy)
    assert service.shown[0] == first and not service.take()
    service.follow(chosen_lights(state, False))
    assert not service.busy, "the same lights again"
    service.follow(chosen_lights(lights.choose(state, 1), False))
    assert service.busy
    service.close()
