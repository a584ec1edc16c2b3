"""Readers under hostile input: what fuzzing has found is refused in one line, and stays so."""

from __future__ import annotations

import math
import random
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from benchmarks import fuzz, fuzz_child
from benchmarks.fuzz import CORPUS, Run
from benchmarks.fuzz_child import STATE, Session, kept_inputs, mutated, place_of
from benchmarks.fuzz_targets import TARGETS, Target
from volspec.errors import InputError

SEEDS = (b"1,2,3\n4,5,6\n", b"seven")


@pytest.mark.parametrize("name", TARGETS)
def test_kept_inputs_are_read_or_refused(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    target.lay_out(tmp_path)
    inputs = [(path.name, path.read_bytes()) for path in kept_inputs(name)]
    assert inputs, f"tests/fuzz/corpus/{name} is empty; run python -m benchmarks.fuzz {name} --keep"
    for which, data in inputs:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            error = target.run(tmp_path, data)
        assert not target.is_finding(error), f"{CORPUS.name}/{name}/{which}: {error!r}"


def test_the_corpus_is_small() -> None:
    assert sum(path.stat().st_size for path in CORPUS.rglob("*") if path.is_file()) < 2**20


def test_every_seed_is_read(tmp_path: Path) -> None:
    names = "csv", "triples", "icc", "basis", "tm27", "cgats", "cxf", "envi", "spectral-exr"
    for name in (*names, "ies", "ldt", "image-exr", "cache"):
        target = TARGETS[name]
        target.lay_out(tmp_path)
        for data in target.seeds():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                assert target.run(tmp_path, data) is None, name


def reads_digits(path: Path) -> None:
    """A reader with one fault, and one that takes memory."""
    data = path.read_bytes()
    if data.startswith(b"9"):
        bytearray(260 << 20)
    if not data.isdigit():
        raise InputError("no digits; give some")
    if len(data) > 3:
        raise KeyError(len(data))


DIGITS = Target(reads_digits, lambda: (b"12",))


def session(folder: Path, target: Target = DIGITS) -> Session:
    (folder / "state").write_bytes(bytes(STATE.size + fuzz_child.MOST_BYTES))
    return Session(target, folder)


def test_plain_mutations_find_a_fault_and_shorten_it(tmp_path: Path) -> None:
    made = session(tmp_path)
    # As long as it takes on a busy machine: inputs are counted, not seconds.
    fuzz_child.plain(made, [b"12"], 1000, math.inf, seed=1)
    [found] = [path for path in made.findings.glob("crash-*") if not path.suffix]
    assert "KeyError" in found.with_name(f"{found.name}.txt").read_text()
    short = fuzz_child.shortened(DIGITS, found.read_bytes() + b"0" * 50, made.inside)
    assert short.isdigit() and len(short) == 4
    assert made.inputs == 1000 and STATE.unpack_from(made.state)[0] == 1000


def test_memory_beyond_what_a_file_declares_is_a_finding(tmp_path: Path) -> None:
    made = session(tmp_path)
    for data in (b"12", b"9"):
        made.run(data)
    [found] = [path for path in made.findings.iterdir() if not path.suffix]
    assert found.name.startswith("memory-") and found.read_bytes() == b"9"
    assert made.largest > 250 << 20


@pytest.mark.parametrize(
    ("code", "kind"), [("import time; time.sleep(60)", "hang"), ("import os; os.abort()", "death")]
)
def test_a_process_that_hangs_or_dies_leaves_its_input(
    code: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run("csv", tmp_path / "csv", "plain")
    state, ready, head = run.folder / "state", run.folder / "ready", STATE.pack(7, 0, 0, 3)

    def child(*words: str) -> subprocess.Popen[bytes]:
        if words[0] == "shorten":
            return subprocess.Popen([sys.executable, "-c", ""])
        begun = f"f = open({str(state)!r}, 'r+b'); f.write({head + b'abc'!r}); f.close()"
        (run.folder / "log").touch()
        script = f"{begun}; open({str(ready)!r}, 'w').close(); {code}"
        return subprocess.Popen([sys.executable, "-c", script])

    monkeypatch.setattr(run, "_child", child)
    monkeypatch.setattr(fuzz, "LIMIT_S", 0.5)
    monkeypatch.setattr(fuzz, "_MOST_RESTARTS", 1)
    row = run.fuzz(100, 60.0, 0)
    assert [path.name.split("-")[0] for path in row.findings] == [kind]
    assert row.findings[0].read_bytes() == b"abc" and row.inputs == 7


def test_mutations_are_the_same_for_one_seed_and_differ_from_their_source() -> None:
    made = [
        [mutated(SEEDS[0], SEEDS, (b"token",), rng) for _ in range(200)]
        for rng in (random.Random(3), random.Random(3), random.Random(4))
    ]
    assert made[0] == made[1] != made[2]
    assert len(set(made[0])) > 150


def test_a_place_is_where_an_error_came_from() -> None:
    def raised(data: bytes) -> object:
        try:
            reads_digits_of(data)
        except InputError as error:
            return place_of(error)
        return None

    def reads_digits_of(data: bytes) -> None:
        try:
            int(data)
        except ValueError:
            raise InputError("no number") from None
        raise InputError("too many")

    assert raised(b"x") == raised(b"y") != raised(b"1")
