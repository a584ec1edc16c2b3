"""The window on a machine that cannot cast, and before files that are doubtful."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.robot import Robot
from volspec._gpu.devices import POCL, devices

pytestmark = pytest.mark.usefixtures("screen")


def test_without_a_device_that_works_the_empty_picture_keeps_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not all(device.platform == POCL for device in devices()):
        pytest.skip("a device here is none of PoCL, and would work")
    # PoCL refuses this flag as it refuses a CPU that it does not know: when it builds.
    monkeypatch.setenv("POCL_EXTRA_BUILD_FLAGS", "-no-such-flag")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.delenv("VOLSPEC_DEVICE", raising=False)
    with Robot(tmp_path, [], (900, 600)) as robot:
        robot.wait_for(lambda row: row["event"] == "error" and row.get("stage") == "cast")
        robot.rest()
        x, y, width, height = robot.area("picture")
        robot.grab(tmp_path / "window.png")
        with Image.open(tmp_path / "window.png") as window:
            left = window.crop((x, y, x + 2 * width // 3, y + height))  # of cube and scale
            picture = np.asarray(left.convert("L")) > 90
        above, middle, below = (part.sum() for part in np.array_split(picture, 3))
        assert 300 < middle < 0.1 * picture.size
        assert above == below == 0  # where a notice would say the same
        robot.key("h")  # the window goes on
        robot.rest()
        assert robot.viewer.poll() is None


def test_a_reader_s_doubts_are_told_in_the_window(tmp_path: Path) -> None:
    values = np.linspace(0, 1, 20**3, dtype=np.float32).reshape(20, 20, 20)
    values[3, 4, 5] = np.nan
    np.save(tmp_path / "v.npy", values)
    with Robot(tmp_path, ["v.npy"], (900, 600)) as robot:
        told = robot.wait_for(lambda row: row["event"] == "warning")
        assert "1 of 8000 voxels are NaN or infinite" in told["message"]
        robot.whole()
