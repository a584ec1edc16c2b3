"""Frames that show nothing: reported once, and only those."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.export.conftest import Make
from tests.support.fixtures import Patch, slow
from volspec.errors import VolspecWarning
from volspec.export import tiles
from volspec.export.frames import BlankFrames

LUX = """
[viewing]
level = "absolute"
[[light]]
name = "lit"
spectrum = "E"
illuminance_lux = {}
"""


@pytest.mark.parametrize(
    "settings", [{}, slow({"bits": 16}), slow({"transparent": True}), {"format": "exr"}]
)
def test_absurd_lux_are_told_whatever_the_file(
    settings: dict[str, Any], scene: Make, tmp_path: Path
) -> None:
    for lux, problem in ((1e-9, "black"), (1e12, "clipped")):
        with pytest.warns(VolspecWarning) as caught:
            scene(LUX.format(lux)).export(
                tmp_path / problem, lights=["lit"], sheet=False, size=(8, 6), **settings
            )
        assert problem in str(caught[0].message)


def test_a_bright_picture_is_not_told(scene: Make, tmp_path: Path) -> None:
    """Warnings are errors here; at 3000 lx, three times the viewing's, highlights are clipped."""
    scene(LUX.format(3000)).export(tmp_path, lights=["lit"], sheet=False)


def test_many_frames_and_their_strips_are_one_warning(
    scene: Make, tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(tiles, "STRIP_SIDE", 64)
    made = scene(LUX.format(1e-9))
    with pytest.warns(VolspecWarning) as caught:
        made.export(tmp_path, lights=["lit"], turntable={"frames": 3}, size=(90, 80), sheet=False)
    (only,) = caught
    assert {"lit/0000.png", "black", "2"} <= set(str(only.message).split())


def messages(pixels: np.ndarray, alpha: np.ndarray) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        blanks = BlankFrames("exposure")
        blanks.add("f", "A", pixels, alpha.astype(np.float32))
        blanks.warn()
    return [str(each.message) for each in caught]


def test_of_what_is_covered_all_but_a_thousandth_must_be_blank() -> None:
    frame, opaque = np.zeros((100, 100, 3), np.uint8), np.ones((100, 100))
    frame.reshape(-1, 3)[:10] = 9
    assert ["black" in message for message in messages(frame, opaque)] == [True]
    frame.reshape(-1, 3)[10] = 9
    assert messages(frame, opaque) == []
    frame[:50] = 77
    assert len(messages(frame, opaque * (np.arange(100) >= 50)[:, None])) == 1, (
        "backdrop counts not"
    )
    assert messages(frame, 0 * opaque) == [], "an empty picture is reported by its cast"


def test_a_saturated_colour_is_clipped_where_no_channel_has_a_shade_left() -> None:
    opaque = np.ones((4, 4))
    assert "clipped" in messages(np.full((4, 4, 3), (255, 255, 0), np.uint8), opaque)[0]
    assert messages(np.full((4, 4, 3), (255, 200, 0), np.uint8), opaque) == []
    half = np.full((4, 4, 4), 0.5, np.float32)
    assert "clipped" in messages(half, opaque / 2)[0], "white times its opacity"
    assert messages(half, opaque) == []
