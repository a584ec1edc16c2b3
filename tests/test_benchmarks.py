"""Foundations of the benchmarks: scenes, arithmetic, page; nothing is timed."""

import doctest
import json
import math
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kills, layers, measure, picture
from benchmarks.gpu import Record, recorded
from benchmarks.measure import PAGE, Comparison, Figure, between, in_turn, replaced, report, save
from benchmarks.picture import psnr
from benchmarks.scenes import NAMES, RECIPES, bench_scene, stored
from volspec._files import write_whole
from volspec.basis import MaterialBasis
from volspec.spectra import reflectance_names

RECORD = Record("A GPU", "1.0", "2030-01-02", "abc1234", ("1 ms", "2 ms", "3 ms", "4 ms"))


@pytest.mark.parametrize("name", RECIPES)
def test_every_scene_rises_from_clear_and_names_materials_of_the_library(name):
    recipe = RECIPES[name]
    values = [value for value, _, _ in recipe.points]
    assert all(a < b for a, b in pairwise(values))
    assert recipe.points[0][1] == 0, "what lies below the first point is air"
    assert all(0 <= opacity < 1 for _, opacity, _ in recipe.points)
    assert {material for _, _, material in recipe.points} == set(recipe.materials)
    assert set(recipe.materials.values()) <= set(reflectance_names())


def test_the_engine_is_the_demo_in_seven_channels():
    assert len(NAMES) == 5
    assert bench_scene("engine").transfer.basis.size == 7


@pytest.mark.parametrize("module", [measure, picture], ids=lambda m: m.__name__)
def test_examples_say_what_they_give(module):
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize(
    ("make", "kind", "named"),
    [
        (stored("no such volume"), FileNotFoundError, "VOLSPEC_DATA"),
        (lambda: replaced("text", "t", ""), ValueError, "<!-- t -->"),
    ],
)
def test_volumes_and_markers_that_are_missing_are_named(make, kind, named):
    with pytest.raises(kind, match=named):
        make()


def test_white_is_white_where_layers_are_compared():
    basis = layers.transfer_of(layers.CASES["engine"][1]).basis
    assert isinstance(basis, MaterialBasis)
    white = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.5]])
    codes = layers.display(basis)(white, np.zeros(2))
    assert np.allclose(codes[0], 1, atol=2e-3) and np.allclose(codes[1], 0.735, atol=2e-3)
    # L* of white and of half of it: 100 and 76.
    assert layers.Errors.of(codes[None, :1], codes[None, 1:]).mean == pytest.approx(16, abs=2)


def test_psnr_is_that_of_the_root_mean_square():
    picture = np.linspace(0, 1, 100).reshape(10, 10)
    assert psnr(picture, picture + 0.01) == pytest.approx(40)
    assert psnr(picture, picture) == math.inf


def test_both_sides_are_timed_alternately_after_a_call_of_their_own():
    calls: list[str] = []
    times = in_turn(lambda: calls.append("a"), lambda: calls.append("b"), our_calls=2, runs=2)
    assert "".join(calls) == "aaabb" * 2
    assert times.wall.shape == times.cpu.shape == (2, 2)


def test_a_figure_is_met_on_its_own_side():
    assert Figure("faster", 3.0, asked=3).met
    assert not Figure("faster", 2.9, asked=3).met
    assert Figure("smaller", 1.1, asked=1.15, at_most=True).met
    assert Figure("unasked", 1.0).met is Figure("skipped", None, asked=3).met is None


def test_the_report_tells_misses_and_reasons():
    text = report([Figure("a", 1.0, asked=3), Figure("b", None, asked=3, note="no file")])
    assert "MISSED" in text.splitlines()[1]
    assert text.splitlines()[2].endswith("skipped: no file")


def test_rows_are_saved_in_their_documented_form(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    row = Comparison("cast/engine/flat", "vtk-fixed-point", 1.0, 3.0, 3.0, "CPU", "abc")
    save([Figure("a", 3.0, row=row), Figure("memory", 1.0)])
    assert json.loads(Path("build/bench.json").read_text()) == [asdict(row)]


def test_a_device_and_commit_keep_one_row():
    empty = "before <!-- devices -->\n<!-- /devices --> after"
    once = recorded(empty, RECORD)
    assert recorded(once, RECORD) == once
    again = recorded(once, replace(RECORD, date="2030-02-03", cells=("9 ms",) * 4))
    assert again.count("A GPU") == 1 and "9 ms" in again and "1 ms" not in again
    other = recorded(once, replace(RECORD, commit="def5678"))
    assert other.count("A GPU") == 2
    assert other.startswith("before") and other.endswith("after")


@pytest.mark.parametrize("name", ["devices", "convergence", "equal error", "figures"])
def test_the_page_has_room_for_what_scripts_write(name):
    assert between(PAGE.read_text(encoding="utf-8"), name).startswith("\n")


class Killed(BaseException):
    """A kill amid a write."""


@pytest.mark.parametrize("name", ["well", "torn", "left"])
def test_kills_find_what_is_torn_and_what_is_left(name, tmp_path, monkeypatch):
    """No process dies here: what is killed ends with half of a file."""
    amid = False

    def run(folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        if name == "left":
            (folder / ".volspec-of-nobody.part").touch()
        with write_whole(folder / "a.bin") as temporary:
            temporary.touch()
            path = folder / "b.bin" if name == "torn" else temporary
            path.write_bytes(b"half")
            if amid:
                raise Killed
            path.write_bytes(b"whole")

    def kill(job: kills.Job, folder: Path, *_: object) -> bool:
        nonlocal amid
        amid = True
        with suppress(Killed):
            job.run(folder)
        amid = False
        return True

    monkeypatch.setattr(kills, "run_to_end", lambda job, folder: job.run(folder))
    monkeypatch.setattr(kills, "measure", lambda job, folder: (job.run(folder), [1.0]))
    monkeypatch.setattr(kills, "kill", kill)
    count = kills.count_damage(kills.Job(name, run), 4, tmp_path)
    found = {"torn": count.torn > 0, "left": count.left > 0}
    assert count.kills == 4 and count.other == 0
    assert found == {each: each == name for each in ("torn", "left")}
