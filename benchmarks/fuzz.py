"""Fuzz the readers: ``python -m benchmarks.fuzz [TARGET...] [--inputs N] [--seconds S]``.

    fuzz_targets -> [fuzz] -> fuzz_child, one process a reader -> a table, findings, fuzz_corpus

A finding is an exception that the reader may not raise, more than 10 s, memory beyond twice what
the input declares and 200 MB, or a process that ended. Findings are shortened and written to
``build/fuzz/TARGET/findings``; with ``--keep`` they are added to the corpus that ``make test``
replays (`fuzz_corpus`), with inputs that are refused at new places. The exit code is the number
of readers with findings.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import mmap
import os
import re
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.fuzz_child import MAX_BYTES, STATE, place_of
from benchmarks.fuzz_corpus import CORPUS, add_inputs, kept_inputs
from benchmarks.fuzz_targets import ROOT, TARGETS

LIMIT_S = 10.0
"""An input that takes longer is a finding."""
_START_S = 300.0  # imports, instrumented
_MAX_RESTARTS = 20
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
_MAX_KEPT = 20_000  # bytes of a reader's corpus


@dataclass(slots=True)
class Row:
    """Outcome of one reader."""

    name: str
    inputs: int = 0
    seconds: float = 0.0
    largest: int = 0
    places: int = 0
    edges: int | None = None
    findings: list[Path] = field(default_factory=list)
    said: str = ""

    def line(self) -> str:
        """Return the table's line."""
        count = {kind: sum(path.name.startswith(kind) for path in self.findings) for kind in KINDS}
        rate = self.inputs / self.seconds if self.seconds else 0.0
        edges = "" if self.edges is None else str(self.edges)
        cells = (
            f"{self.inputs:>9}",
            f"{rate:>8.0f}",
            *(f"{n:>7}" for n in count.values()),
            f"{self.largest / 2**20:>9.0f} MB",
            f"{edges:>7}",
            f"{self.places:>7}",
        )
        return f"{self.name:<14}" + "".join(cells) + (f"  {self.said}" if self.said else "")


KINDS = ("crash", "hang", "memory", "death")
HEAD = (
    f"{'reader':<14}{'inputs':>9}{'1/s':>8}"
    + "".join(f"{kind:>7}" for kind in KINDS)
    + f"{'largest':>12}{'edges':>7}{'places':>7}"
)


class Run:
    """Processes of one reader; a process that dies is restarted.

    Parameters
    ----------
    name : str
    folder : Path
        Emptied at first.
    engine : "atheris" or "plain"
    """

    def __init__(self, name: str, folder: Path, engine: str) -> None:
        self.row, self.folder, self.engine = Row(name), folder, engine
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "findings").mkdir(parents=True)
        (folder / "state").write_bytes(bytes(STATE.size + MAX_BYTES))

    def fuzz(self, inputs: int, seconds: float, seed: int) -> Row:
        """Fuzz for a number of inputs or seconds, whichever ends first."""
        row, restarts = self.row, 0
        with (self.folder / "state").open("r+b") as file:
            state = mmap.mmap(file.fileno(), 0)
        while row.inputs < inputs and row.seconds < seconds and restarts < _MAX_RESTARTS:
            before = row.inputs
            said = self._process(state, inputs, seconds - row.seconds, seed + restarts)
            if said == "":
                break
            if said == "start":
                row.said = f"did not start; see {self.folder / 'log'}"
                break
            self._death(said, state)
            restarts += 1 if row.inputs > before else _MAX_RESTARTS // 4
        if restarts >= _MAX_RESTARTS:
            row.said = f"given up after {restarts} dead processes"
        for path in sorted((self.folder / "findings").iterdir()):
            if path.suffix != ".txt":
                self._child("shorten", str(path)).wait()
                row.findings.append(path)
        log = (self.folder / "log").read_text(errors="replace")
        covered = [int(number) for number in re.findall(r"\bcov: (\d+)", log)]
        row.edges = covered[-1] - covered[0] if covered else None
        return row

    def _child(self, *words: str) -> subprocess.Popen[bytes]:
        command = (sys.executable, "-m", "benchmarks.fuzz_child", self.row.name, str(self.folder))
        with (self.folder / "log").open("ab") as log:
            return subprocess.Popen(
                (*command, *words),
                cwd=ROOT,
                env={**os.environ, **_ONE_THREAD, "XDG_CACHE_HOME": str(self.folder / "cache")},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def _process(self, state: mmap.mmap, inputs: int, seconds: float, seed: int) -> str:
        """Run one process; return the cause of its death, or ``""`` if it finished."""
        ready = self.folder / "ready"
        ready.unlink(missing_ok=True)
        child = self._child(self.engine, str(inputs), str(seconds), str(seed))
        started = since = time.monotonic()
        seen, spent = -1, self.row.seconds
        is_ready = False
        while child.poll() is None:
            time.sleep(0.1)
            now = time.monotonic()
            if not is_ready:
                is_ready = ready.exists()
                started = since = now if is_ready else started
                if now - started > _START_S:
                    return self._ended(child, "start")
                continue
            self._read(state)
            self.row.seconds = spent + now - started
            if self.row.inputs != seen:
                seen, since = self.row.inputs, now
            elif now - since > LIMIT_S and self.row.seconds < seconds + spent + LIMIT_S:
                return self._ended(child, "hang")
            elif now - since > 6 * LIMIT_S:  # its shutdown hangs
                return self._ended(child, "")
        self._read(state)
        if not is_ready:
            return "start"
        return "" if child.returncode == 0 else f"death: exit code {child.returncode}"

    def _read(self, state: mmap.mmap) -> None:
        self.row.inputs, self.row.largest, self.row.places, _ = STATE.unpack_from(state)

    def _ended(self, child: subprocess.Popen[bytes], said: str) -> str:
        child.kill()
        child.wait()
        return said

    def _death(self, said: str, state: mmap.mmap) -> None:
        length = STATE.unpack_from(state)[3]
        data = bytes(state[STATE.size : STATE.size + length])
        name = f"{said.partition(':')[0]}-{hashlib.sha1(data).hexdigest()[:10]}"
        (self.folder / "findings" / name).write_bytes(data)
        log = (self.folder / "log").read_bytes()[-3000:].decode(errors="replace")
        (self.folder / "findings" / f"{name}.txt").write_text(f"{said}\n{log}")


def keep(run: Run) -> None:
    """Add findings to the corpus, and the shortest input for every new place."""
    name = run.row.name
    target, folder, kept = TARGETS[name], run.folder / "in", kept_inputs(name).values()
    target.lay_out(folder)

    def place(data: bytes) -> object:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return place_of(target.run(folder, data))

    known = {place(data) for data in kept}
    room = _MAX_KEPT - sum(map(len, kept))
    found, new = [path.read_bytes() for path in run.row.findings], []
    corpus = sorted((path.read_bytes() for path in (run.folder / "corpus").glob("*")), key=len)
    for data in [*found, *corpus]:
        if data not in found:
            if len(data) > room or (at := place(data)) in known:
                continue
            known.add(at)
        room -= len(data)
        new.append(data)
    add_inputs(name, new)


def main(words: Sequence[str] | None = None) -> int:
    """Fuzz the named readers, or all; print a line for each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("target", nargs="*", help=f"of {', '.join(TARGETS)}; all by default")
    parser.add_argument("--inputs", type=int, default=200_000, help="for each; 200,000 by default")
    parser.add_argument("--seconds", type=float, default=1200, help="for each; 1200 by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plain", action="store_true", help="without atheris")
    parser.add_argument("--keep", action="store_true", help=f"add to {CORPUS.relative_to(ROOT)}")
    parser.add_argument("--folder", type=Path, default=ROOT / "build/fuzz")
    given = parser.parse_args(words)
    if unknown := [name for name in given.target if name not in TARGETS]:
        parser.error(f"no reader {unknown[0]!r}; known: {', '.join(TARGETS)}")
    found_atheris = importlib.util.find_spec("atheris") is not None
    engine = "atheris" if found_atheris and not given.plain else "plain"
    os.nice(max(0, 10 - os.nice(0)))
    print(f"engine: {engine}{'' if found_atheris else ' (pip install atheris: by coverage)'}")
    print(HEAD, flush=True)
    bad = 0
    for name in given.target or TARGETS:
        run = Run(name, (given.folder / name).absolute(), engine)
        row = run.fuzz(given.inputs, given.seconds, given.seed)
        print(row.line(), flush=True)
        for path in row.findings:
            said = path.with_name(f"{path.name}.txt").read_text().strip().splitlines()
            print(f"    {path}: {said[-1][:160] if said else ''}", flush=True)
        if given.keep:
            keep(run)
        bad += bool(row.findings or row.said)
    return bad


if __name__ == "__main__":
    sys.exit(main())
