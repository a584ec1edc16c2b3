"""The README's example is pasted into Python unchanged."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np

ROOT = Path(__file__).resolve().parent.parent


def test_readme_example_runs_and_shows_what_the_text_says(tmp_path: Path) -> None:
    """You should see grey inserts under D65, pink under A, violet under HP1."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert len([line for line in code[1].splitlines() if line.strip()]) <= 10
    (tmp_path / "data").symlink_to(ROOT / "data")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code[1]], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    frames = {p.stem: iio.imread(p).astype(int) for p in tmp_path.glob("*.png")}
    assert set(frames) == {"engine-D65", "engine-A", "engine-HP1"}
    reddest = {name: np.percentile(f[..., 0] - f[..., 1], 99) for name, f in frames.items()}
    assert reddest["engine-D65"] < 10 < 30 < reddest["engine-A"]
    assert all(frame.shape == (512, 512, 3) for frame in frames.values())


def test_readme_links_to_files_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / target).exists(), target
