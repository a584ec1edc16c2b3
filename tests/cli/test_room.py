"""``volspec room --paint-set``: figures of the ranking, and the picture of the best paint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from tests.support.commands import figures, write_files
from tests.support.fixtures import Capture, Patch


def test_a_ranking_prints_figures_and_paints_the_picture(
    tmp_path: Path, monkeypatch: Patch, capsys: Capture
) -> None:
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    paints = ["--paint-set", "sRGB/blue*0.9", "--paint-set", "grey:0.6", "--mix", "0.5"]
    coarse = ["--patches", "12", "--top", "2", "--size", "16x12"]
    wanted = {"blue.png": "blue", "grey.png": "grey:0.6"}
    found = {}
    for name, colour in wanted.items():
        words = ("room.toml", *paints, *coarse, "--wanted", colour, "--picture", name)
        found[name] = figures(capsys, "room", *words)
    assert found["blue.png"]["candidates"] == 3 and found["blue.png"]["solved"] in (2, 3)
    assert found["blue.png"]["surfaces"] == ["left", "right", "front", "back"]
    best = found["blue.png"]["paints"]
    assert {row["paint"] for row in best} == {
        "sRGB/blue*0.9",
        "50 % sRGB/blue*0.9 + 50 % grey:0.6",
    }
    assert best[0]["distance"] < best[1]["distance"]
    assert found["grey.png"]["paints"][0]["paint"] == "grey:0.6"
    blue, grey = (np.asarray(Image.open(name).convert("RGB"), np.float64) for name in wanted)
    assert (blue[..., 2] - blue[..., 0]).mean() > (grey[..., 2] - grey[..., 0]).mean() + 20
