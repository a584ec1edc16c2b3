"""Readers under hostile input: what fuzzing has found is refused in one line, and stays so."""

import math
import random
import subprocess
import sys
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest

from benchmarks import fuzz, fuzz_child
from benchmarks.fuzz import Run
from benchmarks.fuzz_child import STATE, Session, mutated, place_of
from benchmarks.fuzz_corpus import CORPUS, add_inputs, read_corpus
from benchmarks.fuzz_targets import TARGETS, Target
from volspec.errors import InputError
from volspec.volume import reader_process

SEEDS = (b"1,2,3\n4,5,6\n", b"seven")


@pytest.fixture(scope="module")
def corpus() -> dict[str, dict[str, bytes]]:
    return read_corpus()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TARGETS)
def test_kept_inputs_end_without_a_finding(name, corpus, tmp_path, monkeypatch):
    """One that is never read to its end is given up sooner here."""
    monkeypatch.setattr(reader_process, "_TIMEOUT_S", 1.0)
    target = TARGETS[name]
    target.lay_out(tmp_path)
    assert corpus[name], f"none of {name}; run python -m benchmarks.fuzz {name} --keep"
    for which, data in corpus[name].items():
        error = target.run(tmp_path, data)
        assert not target.is_finding(error), f"{CORPUS.name}: {name}/{which}: {error!r}"


def test_the_corpus_is_small_and_the_same_file_in_any_order(tmp_path):
    assert CORPUS.stat().st_size < 2**17
    one, other = tmp_path / "one.tar.xz", tmp_path / "other.tar.xz"
    add_inputs("ies", [b"a", b"b"], one)
    add_inputs("csv", [b"c"], one)
    for target, data in (("csv", b"c"), ("ies", b"b"), ("ies", b"a"), ("ies", b"b")):
        add_inputs(target, [data], other)
    assert one.read_bytes() == other.read_bytes()
    assert [*read_corpus(one)] == ["csv", "ies"]
    assert sorted(read_corpus(one)["ies"].values()) == [b"a", b"b"]


@pytest.mark.filterwarnings("ignore")
def test_every_seed_is_read(tmp_path):
    names = "csv", "triples", "icc", "basis", "tm27", "cgats", "cxf", "envi", "spectral-exr"
    for name in (*names, "ies", "ldt", "image-exr", "cache"):
        TARGETS[name].lay_out(tmp_path)
        for data in TARGETS[name].seeds():
            assert TARGETS[name].run(tmp_path, data) is None, name


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


def session(folder: Path) -> Session:
    (folder / "state").write_bytes(bytes(STATE.size + fuzz_child.MAX_BYTES))
    return Session(DIGITS, folder)


@pytest.mark.slow
def test_plain_mutations_find_a_fault_and_shorten_it(tmp_path):
    made = session(tmp_path)
    # As long as it takes on a busy machine: inputs are counted, not seconds.
    fuzz_child.plain(made, [b"12"], 1000, math.inf, seed=1)
    [found] = [path for path in made.findings.glob("crash-*") if not path.suffix]
    assert "KeyError" in found.with_name(f"{found.name}.txt").read_text()
    short = fuzz_child.shortened(DIGITS, found.read_bytes() + b"0" * 50, made.inside)
    assert short.isdigit() and len(short) == 4
    assert made.inputs == 1000 and STATE.unpack_from(made.state)[0] == 1000


def test_memory_beyond_what_a_file_declares_is_a_finding(tmp_path):
    made = session(tmp_path)
    for data in (b"12", b"9"):
        made.run(data)
    [found] = [path for path in made.findings.iterdir() if not path.suffix]
    assert found.name.startswith("memory-") and found.read_bytes() == b"9"
    assert made.largest > 250 << 20


@pytest.mark.parametrize(
    ("code", "kind"),
    [("import threading; threading.Event().wait()", "hang"), ("import os; os.abort()", "death")],
)
def test_a_process_that_hangs_or_dies_leaves_its_input(code, kind, tmp_path, monkeypatch):
    """The clock does not go on while a process starts, and where it is to end by itself."""
    run = Run("csv", tmp_path / "csv", "plain")
    state, ready, head = run.folder / "state", run.folder / "ready", STATE.pack(7, 0, 0, 3)
    clock_s = [0.0]

    def child(*words: str) -> subprocess.Popen[bytes]:
        if words[0] == "shorten":
            return subprocess.Popen([sys.executable, "-c", ""])
        begun = f"f = open({str(state)!r}, 'r+b'); f.write({head + b'abc'!r}); f.close()"
        (run.folder / "log").touch()
        script = f"{begun}; open({str(ready)!r}, 'w').close(); {code}"
        return subprocess.Popen([sys.executable, "-c", script])

    def sleep(seconds: float) -> None:
        Event().wait(seconds / 10)
        if kind == "hang" and ready.exists():
            clock_s[0] += fuzz.LIMIT_S

    monkeypatch.setattr(run, "_child", child)
    monkeypatch.setattr(fuzz, "time", SimpleNamespace(monotonic=lambda: clock_s[0], sleep=sleep))
    monkeypatch.setattr(fuzz, "_MAX_RESTARTS", 1)
    row = run.fuzz(100, 1e6, 0)
    assert [path.name.split("-")[0] for path in row.findings] == [kind]
    assert row.findings[0].read_bytes() == b"abc" and row.inputs == 7


def test_mutations_are_the_same_for_one_seed_and_differ_from_their_source():
    made = [
        [mutated(SEEDS[0], SEEDS, (b"token",), rng) for _ in range(200)]
        for rng in map(random.Random, (3, 3, 4))
    ]
    assert made[0] == made[1] != made[2]
    assert len(set(made[0])) > 150


def test_a_place_is_where_an_error_came_from():
    def reads_digits_of(data: bytes) -> None:
        try:
            int(data)
        except ValueError:
            raise InputError("no number") from None
        raise InputError("too many")

    places = []
    for data in (b"x", b"y", b"1"):
        with pytest.raises(InputError) as caught:
            reads_digits_of(data)
        places.append(place_of(caught.value))
    assert places[0] == places[1] != places[2]
