"""Process in which one reader is fuzzed, and which may die.

    fuzz -> [fuzz_child] -> state file, findings

Each input is in a shared page before it is read, so that `fuzz` can find the input that hung or
killed this process. With atheris (``pip install atheris``), inputs are chosen by coverage, else by
the place of refusal: an input that is refused at a new place is mutated further.
"""

from __future__ import annotations

import hashlib
import mmap
import os
import random
import re
import resource
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from benchmarks.fuzz_corpus import kept_inputs

MAX_BYTES = 1 << 16
"""Largest input of any target; the shared page has room for it."""
SPARE_BYTES = 200 << 20
_SLACK_BYTES = 1 << 20
STATE = struct.Struct("<QQQQ")  # inputs, largest allocation, places, length of the input
_ADDRESS_SPACE = 3 << 30  # beyond the initial use: larger allocations fail harmlessly
_PAGE = os.sysconf("SC_PAGE_SIZE")
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = (b"0", b"-1", b"1e308", b"1e999", b"nan", b"-inf", b"4294967296", b"0.5", b"9" * 400)
_INTEGERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_BRACKETS = (b"[", b"{", b"(", b'{"a":', b"[[", b"<a>", b"-", b"'", b"a.")

Key = tuple[Any, ...]


def mutated(
    data: bytes, pool: Sequence[bytes], tokens: Sequence[bytes], rng: random.Random
) -> bytes:
    """Return an input that differs from another in one to eight places, of any length."""
    for _ in range(1 << rng.randrange(4)):
        at = rng.randrange(len(data) + 1)
        end = min(len(data), at + (1 << rng.randrange(1 + max(1, len(data)).bit_length())))
        kind = rng.randrange(10)
        if kind == 0 and data:
            at = min(at, len(data) - 1)
            data = data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + rng.randbytes(rng.randrange(1, 9)) + data[at:]
        elif kind == 2:
            data = data[:at] + data[end:]
        elif kind == 3:
            data = data[:at] + data[at:end] * rng.choice((2, 3, 40)) + data[end:]
        elif kind == 4:
            size = rng.choice((1, 2, 4, 8))
            number = rng.choice(_INTEGERS) & ((1 << 8 * size) - 1)
            order: Any = rng.choice(("little", "big"))
            data = data[:at] + number.to_bytes(size, order) + data[at + size :]
        elif kind == 5 and tokens:
            data = data[:at] + rng.choice(tokens) + data[end if rng.randrange(2) else at :]
        elif kind == 6 and (found := list(_NUMBER.finditer(data[at : at + 4096]))):
            match = rng.choice(found)
            data = data[: at + match.start()] + rng.choice(_NUMBERS) + data[at + match.end() :]
        elif kind == 7:
            other = rng.choice(pool)
            start = rng.randrange(len(other) + 1)
            data = data[:at] + other[start : start + rng.randrange(1, 400)] + data[end:]
        elif kind == 8 and not rng.randrange(8):
            deep = rng.choice((10, 200, 3000))
            data = data[:at] + rng.choice(_BRACKETS) * deep + data[at:]
        elif kind == 9 and data:
            other = rng.choice(pool)
            cut = rng.randrange(len(other) + 1)
            data = data[:at] + other[cut:] if rng.randrange(2) else data[:at]
    return data


def place_of(error: BaseException | None) -> Key:
    """Return an error's class and its last lines of code, and its cause's.

    An error of another process has its own ``place``.
    """
    if error is None:
        return ("read",)
    lines: list[object] = [type(error).__name__, *getattr(error, "place", ())]
    cause: BaseException | None = error
    while cause is not None and len(lines) < 30:
        frames = traceback.extract_tb(cause.__traceback__)[-12:]
        own = [frame for frame in frames if "volspec" in frame.filename]
        # The depth of a deep recursion is meaningless.
        frames = own[-2:] if isinstance(cause, RecursionError) else frames
        lines += [(Path(frame.filename).name, frame.lineno) for frame in frames]
        cause = cause.__cause__ or cause.__context__
    return tuple(lines)


class Session:
    """One target in this process: runs inputs, measures them, keeps findings.

    Parameters
    ----------
    target : Target
    folder : Path
        Folder of this run: ``in/`` for the reader, ``findings/``, ``state``.
    """

    def __init__(self, target: Any, folder: Path) -> None:
        self.target, self.inside, self.findings = target, folder / "in", folder / "findings"
        for each in (self.inside, self.findings):
            each.mkdir(parents=True, exist_ok=True)
        target.lay_out(self.inside)
        with (folder / "state").open("r+b") as file:
            self.state = mmap.mmap(file.fileno(), 0)
        self.inputs, self.largest, _, _ = STATE.unpack_from(self.state)
        self.places: set[Key] = set()
        self.known = {path.stem for path in self.findings.iterdir()}

    def run(self, data: bytes) -> Key | None:
        """Read an input; return its place if that is new."""
        self.inputs += 1
        self.state[STATE.size : STATE.size + len(data)] = data
        self._tell(len(data))
        before = _resident()
        if _peak() - before > _SLACK_BYTES:  # peak of an earlier input, or of libFuzzer
            _forget_peak()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            error = self.target.run(self.inside, data)
        peak = max(_peak() - before, self.target.peak())
        self.largest = max(self.largest, peak)
        place = place_of(error)
        if self.target.is_finding(error):
            self._keep("crash", place, data, traceback.format_exception(error)[-12:])
        if peak > 2 * self.target.declared(data) + SPARE_BYTES:
            said = [f"{peak >> 20} MB for {len(data)} bytes\n"]
            self._keep("memory", ("memory", *place), data, said)
        if place in self.places:
            return None
        self.places.add(place)
        return place

    def _tell(self, length: int) -> None:
        STATE.pack_into(self.state, 0, self.inputs, self.largest, len(self.places), length)

    def _keep(self, kind: str, place: Key, data: bytes, said: list[str]) -> None:
        name = f"{kind}-{hashlib.sha1(repr(place).encode()).hexdigest()[:10]}"
        if name not in self.known:
            self.known.add(name)
            (self.findings / f"{name}.txt").write_text("".join(said), errors="replace")
            (self.findings / name).write_bytes(data)


def _peak() -> int:
    """Return the peak resident size, bytes; getrusage's value would start at the parent's."""
    with open("/proc/self/status", "rb") as file:
        return int(file.read().partition(b"VmHWM:")[2].split(maxsplit=1)[0]) * 1024


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _resident() -> int:
    with open("/proc/self/statm", "rb") as file:
        return int(file.read().split()[1]) * _PAGE


def plain(session: Session, seeds: Sequence[bytes], runs: int, seconds: float, seed: int) -> None:
    """Fuzz by mutation alone."""
    rng, pool = random.Random(seed), list(seeds)
    corpus = session.findings.with_name("corpus")
    corpus.mkdir(exist_ok=True)
    ends = time.monotonic() + seconds
    for data in pool:
        session.run(data)
    while session.inputs < runs and time.monotonic() < ends:
        data = mutated(
            rng.choice(pool[-40:] if rng.randrange(2) else pool), pool, session.target.tokens, rng
        )[: session.target.most]
        if session.run(data) is not None:
            pool.append(data)
            (corpus / hashlib.sha1(data).hexdigest()).write_bytes(data)


def guided(
    session: Session, seeds: Sequence[bytes], runs: int, seconds: float, seed: int, folder: Path
) -> None:
    """Fuzz by coverage; ends the process."""
    import atheris

    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    for data in seeds:
        (corpus / hashlib.sha1(data).hexdigest()).write_bytes(data)
    rng, tokens = random.Random(seed), session.target.tokens

    def own(data: bytes, most: int, number: int) -> bytes:
        if rng.randrange(2):
            return atheris.Mutate(data, most)
        return mutated(data, seeds, tokens, rng)[:most]

    def one(data: bytes) -> None:
        session.run(data)

    left = max(1, runs - session.inputs)
    options = (
        f"-runs={left}",
        f"-max_total_time={max(1, int(seconds))}",
        f"-max_len={session.target.most}",
        f"-seed={seed + 1}",
        "-timeout=3600",
        "-rss_limit_mb=0",
        f"-artifact_prefix={folder}/",
        "-malloc_limit_mb=0",
        "-handle_abrt=0",
        "-handle_segv=0",
        "-print_final_stats=1",
    )
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=own)
    atheris.Fuzz()


def shortened(target: Any, data: bytes, folder: Path, seconds: float = 20.0) -> bytes:
    """Return a shorter input with the same outcome; every trial runs in a fork."""
    ends = time.monotonic() + seconds
    wanted = _outcome(target, data, folder)
    size = max(1, len(data) // 2)
    while size and wanted is not None and time.monotonic() < ends:
        at, shorter = 0, False
        while at < len(data) and time.monotonic() < ends:
            trial = data[:at] + data[at + size :]
            if _outcome(target, trial, folder) == wanted:
                data, shorter = trial, True
            else:
                at += size
        size = size if shorter and size > 1 else size // 2
    return data


def _outcome(target: Any, data: bytes, folder: Path, limit_s: int = 11) -> str | None:
    """Return the fault of an input, read in a fork; None if it has none."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(limit_s)  # its default ends the process
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            error = target.run(folder, data)
        if target.is_finding(error):
            os.write(writer, repr(place_of(error)).encode()[:4000])
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read().decode()
    status = os.waitpid(child, 0)[1]
    return f"ended by {status}" if status else said or None


def main(words: Sequence[str]) -> None:
    """``TARGET FOLDER ENGINE RUNS SECONDS SEED``, or ``TARGET FOLDER shorten FILE``."""
    name, folder, engine = words[0], Path(words[1]), words[2]
    with _instrumented(engine):  # includes modules that readers import on their first call
        from benchmarks.fuzz_targets import TARGETS

        target = TARGETS[name]
        if engine == "shorten":
            inside, file = folder / "in", Path(words[3])
            target.lay_out(inside)
            file.write_bytes(shortened(target, file.read_bytes(), inside))
            return
        session = Session(target, folder)
        own = list(target.seeds())
        # Larger ones, which tests replay, have no room in the shared page.
        kept = (data for data in kept_inputs(name).values() if len(data) <= MAX_BYTES)
        seeds = [*own, *kept]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for number, data in enumerate(seeds):
                error = target.run(session.inside, data)
                if error and number < len(own):
                    print(f"{name}: seed {number} is refused: {error}", file=sys.stderr)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * _PAGE
    resource.setrlimit(resource.RLIMIT_AS, (used + _ADDRESS_SPACE,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    (folder / "ready").touch()
    runs, seconds, seed = int(words[3]), float(words[4]), int(words[5])
    if engine == "plain":
        plain(session, seeds, runs, seconds, seed)
    else:
        guided(session, seeds, runs, seconds, seed, folder)


def _instrumented(engine: str) -> AbstractContextManager[Any]:
    """Instrument the project and its parsers for coverage, under atheris."""
    if engine != "atheris":
        return nullcontext()
    import atheris

    # Without tomlkit, whose parser takes minutes to instrument.
    names = ["volspec", "tomllib", "csv", "xml", "zipfile"]
    return atheris.instrument_imports(include=names)


if __name__ == "__main__":
    main(sys.argv[1:])
