"""Every example runs, and the README's, and writes the pictures that it says you should see."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from tests.support.fixtures import Patch

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: Patch) -> Path:
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(number: int) -> None:
    runpy.run_path(str(EXAMPLES[number]))


def mean_colour(path: Path) -> np.ndarray:
    """Return the mean of the middle of a picture."""
    frame = iio.imread(path)[..., :3].astype(float)
    high, wide = (size // 3 for size in frame.shape[:2])
    return np.asarray(frame[high : 2 * high, wide : 2 * wide].mean(axis=(0, 1)))


def test_examples_are_numbered_in_reading_order_and_short():
    assert [path.name[:2] for path in EXAMPLES] == [f"{n:02}" for n in range(10)]
    assert max(len(path.read_text(encoding="utf-8").splitlines()) for path in EXAMPLES) <= 40


@pytest.mark.parametrize("number", [0, 9])
def test_one_picture(number, folder):
    run(number)
    (picture,) = folder.glob("*.png")
    assert iio.imread(picture).std() > 20


def test_another_light_and_other_viewings_change_the_colour(folder):
    run(1)
    assert len(list(folder.glob("01-*.png"))) == 5
    run(5)
    warmth = {}
    for name in ("none", "CAT02", "CIECAM02", "dim"):
        red, _, blue = mean_colour(folder / f"05-{name}.png")
        warmth[name] = red - blue
    assert warmth["none"] > 100 > 30 > warmth["dim"] > warmth["CAT02"]


def test_materials_and_light_groups(folder):
    run(2)
    gold, jade = (mean_colour(folder / f"02-{name}.png") for name in ("gold", "jade"))
    assert gold[0] > jade[0] + 10
    run(3)
    assert mean_colour(folder / "03-sky.png").sum() > mean_colour(folder / "03-key.png").sum()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:HP1. componentwise colours are off by")  # with 3 channels
def test_more_channels_come_nearer_to_the_exact_picture(folder, capsys):
    run(4)
    printed = capsys.readouterr().out
    means = [float(number) for number in re.findall(r"mean ΔE ([\d.]+)", printed)]
    assert means[0] > 1 > means[1] > means[2] < 0.1
    # Fitted to the lamp, two materials need no more than three channels.
    assert len(means) == 6 and max(means[3:]) < 0.1


def test_reflectances_and_palettes(folder, capsys):
    run(6)
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert all(colour == daylight != sodium for colour, daylight, *_, sodium in words)
    run(7)
    assert "alike under D65: left and right, ΔE 0.0" in capsys.readouterr().out
    assert {path.name for path in folder.glob("*.png")} == {"06-swatches.png", "07-palette.png"}


def test_an_export_is_complete_and_is_not_made_twice(folder, capsys):
    run(8)
    assert len(list((folder / "08-frames").rglob("0*.png"))) == 20
    assert "made=0" in capsys.readouterr().out.splitlines()[-1]


def test_readme_example_runs_and_shows_what_the_text_says(tmp_path):
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


def test_readme_links_to_files_that_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / target).exists(), target
