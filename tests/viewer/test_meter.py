"""What is measured of relights, and in how many frames the next one is made."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest

from volspec.viewer.work.meter import SLOW_MS, Meter
from volspec.viewer.work.notify import Trace
from volspec.viewer.work.pictures import Relit


@dataclass
class Query:
    """A GPU's time for a band."""

    elapsed: float


def relit(ms: float) -> Relit:
    return Relit(cast(Any, Query(1e6 * ms)), 0.0)


def test_a_picture_relit_in_bands_is_one_relight_of_all_their_time(tmp_path: Path) -> None:
    file = tmp_path / "trace.jsonl"
    with Trace(file) as trace:
        meter = Meter(trace)
        assert meter.bands == 1
        meter.relights(relit(2.5 * SLOW_MS), first=True, ends=True, whole=True)
        meter.frame(0.0, {})
        # Each of three bands takes less than what is slow.
        assert meter.bands == 3
        for i in range(3):
            meter.relights(relit(5.0), first=i == 0, ends=i == 2, whole=True)
            meter.frame(0.0, {})
        assert meter.bands == 1
        # Fewer pixels teach nothing of the whole; no light is nothing.
        meter.relights(relit(9 * SLOW_MS), first=True, ends=True, whole=False)
        meter.frame(0.0, {})
        meter.relights(None, first=True, ends=True, whole=True)
        meter.frame(0.0, {})
        assert meter.bands == 1
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    said = [(row["ms"], row["whole"]) for row in rows if row["event"] == "relight"]
    assert said == [(pytest.approx(45.0), True), (pytest.approx(15.0), True), (162.0, False)]
