"""The README's example is pasted into Python as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_readme_example_runs_and_shows_four_different_lights(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert len([line for line in code[1].splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    exec(compile(code[1], "README.md", "exec"), names)
    frames = names["frames"]
    assert isinstance(frames, list) and len(frames) == 4
    for frame in frames:
        assert frame.shape == (512, 512, 3) and frame.dtype == np.uint8
        assert frame.std() > 10, "an empty picture"
    assert np.abs(frames[0].astype(int) - frames[2]).max() > 10


def test_readme_links_to_files_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / target).exists(), target
