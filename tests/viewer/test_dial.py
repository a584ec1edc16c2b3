"""The light dial: which light is under the mouse, and where names stand around it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volspec.viewer.model.light_mixes import rim_places
from volspec.viewer.ui import lights_dial

LONG = (
    *("Macbeth daylight", "Tungsten halogen", "HP1 high-pressure sodium"),
    *("FL2", "Candle flame, 1900 K", "D65"),
)


def wide(text: str) -> float:
    """As the panel's letters are on the average."""
    return 6.2 * len(text) + 4


@given(
    boxes=st.lists(
        st.tuples(st.floats(-20, 120), st.floats(-20, 120), st.floats(1, 60), st.floats(1, 20)),
        max_size=40,
    )
)
def test_names_at_the_dial_never_overlap_and_never_leave_it(
    boxes: list[tuple[float, float, float, float]],
) -> None:
    labels = [lights_dial.Label(i, box, float(i)) for i, box in enumerate(boxes)]
    kept = lights_dial.non_overlapping(labels, (0.0, 0.0, 100.0, 100.0))
    for i, one in enumerate(kept):
        x, y, width, height = one.box
        assert x >= 0 and y >= 0 and x + width <= 100 and y + height <= 100
        for other in kept[i + 1 :]:
            left, top, wide, tall = other.box
            apart = x + width <= left or left + wide <= x or y + height <= top or top + tall <= y
            assert apart
    inside = [e for e in labels if lights_dial.non_overlapping([e], (0.0, 0.0, 100.0, 100.0))]
    assert not inside or kept[0] == inside[0]


def test_the_light_under_the_mouse_is_found_at_the_rim_only() -> None:
    assert (
        lights_dial.light_at(4, 0.05, -1.0, 0.1) == 0
        and lights_dial.light_at(4, 1.0, 0.02, 0.1) == 1
    )
    assert lights_dial.light_at(4, 0.0, 0.0, 0.1) == -1


def test_long_names_are_whole_around_a_dial_as_small_as_it_gets() -> None:
    """As wide and high as the panel has it in a window of 900 by 600 pixels."""
    ring = lights_dial.ring_for(LONG, (0.0, 0.0, 250.0, 103.0), (24.0, 24.5), 10.0, 15.0, wide)
    labels = lights_dial.labels_of(LONG, range(6), ring)
    written = {label.index: " ".join(label.lines).replace("- ", "-") for label in labels}
    assert written == dict(enumerate(LONG))
    # The sodium lamp, at the right, has moved the dial to the left.
    assert ring.middle[0] < 125.0 and ring.middle[1] == 51.5


def test_names_at_the_left_end_at_the_dial_and_those_at_the_right_begin_there() -> None:
    ring = lights_dial.ring_for(LONG, (0.0, 0.0, 320.0, 200.0), (24.0, 60.0), 10.0, 15.0, wide)
    reach = ring.reach
    for label in lights_dial.labels_of(LONG, range(6), ring):
        place = rim_places(6)[label.index]
        at = ring.middle[0] + place[0] * reach
        for start, text in zip(
            lights_dial.line_starts(label, place[0], wide), label.lines, strict=True
        ):
            if place[0] > 0.5:
                assert start == pytest.approx(at)
            elif place[0] < -0.5:
                assert start + wide(text) == pytest.approx(at)


def test_a_name_that_has_no_room_ends_in_an_ellipsis_and_takes_no_other_s_place() -> None:
    crowded = ("D65", "Osram Dulux, warm white", "x" * 40, *LONG)
    ring = lights_dial.ring_for(crowded, (0.0, 0.0, 180.0, 103.0), (24.0, 24.5), 10.0, 15.0, wide)
    labels = lights_dial.labels_of(crowded, range(9), ring)
    plain = lights_dial.non_overlapping(labels, ring.within)
    assert len(plain) == len(labels) and any(label.lines[0].endswith("…") for label in labels)
    assert labels[0].lines == ("D65",)


def test_the_dial_is_smaller_for_long_names_and_stays_where_they_are_short() -> None:
    area = (0.0, 0.0, 330.0, 300.0)
    short = lights_dial.ring_for(("D65", "A", "FL2"), area, (24.0, 105.0), 10.0, 15.0, wide)
    assert short.radius == 105.0 and short.middle == (165.0, 150.0)
    long = lights_dial.ring_for(LONG, area, (24.0, 105.0), 10.0, 15.0, wide)
    assert 63.0 <= long.radius < 105.0
    assert sum(lights_dial.extents(LONG, long.radius + 10.0, wide)) <= 330.0


def test_a_name_under_the_mouse_stands_for_its_light() -> None:
    ring = lights_dial.ring_for(LONG, (0.0, 0.0, 330.0, 300.0), (24.0, 105.0), 10.0, 15.0, wide)
    labels = lights_dial.labels_of(LONG, range(6), ring)
    x, y, width, height = next(label for label in labels if label.index == 2).box
    assert lights_dial.label_at(labels, x + width / 2, y + height / 2) == 2
    assert lights_dial.label_at(labels, *ring.middle) == -1
