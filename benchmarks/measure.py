"""Time two callables alternately, compare their ratio with a target, write it to the docs page."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

RESULTS = Path("build/bench.json")
PAGE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks.md"


@dataclass(frozen=True, slots=True)
class Comparison:
    """One row of ``build/bench.json``; ratio = peer / ours, above 1 is ahead.

    Times are on the wall; ``cpu_ratio`` is that of the time of all cores.
    """

    name: str
    peer: str
    ours_ms: float
    peer_ms: float
    ratio: float
    device: str
    commit: str
    cpu_ratio: float | None = None


class Times(NamedTuple):
    """Milliseconds of two sides, run alternately.

    Attributes
    ----------
    wall, cpu : (runs, 2)
        On the clock, and of all cores.
    """

    wall: NDArray[np.float64]
    cpu: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Figure:
    """The result of a benchmark: value, target, and the times behind the value.

    Parameters
    ----------
    name : str
    reached : float, optional
        Value; None if it could not be measured, with the reason in ``note``.
    asked : float, optional
        Target; None without one.
    at_most : bool
        True if less is better.
    unit : str
    row : Comparison, optional
    note : str
    """

    name: str
    reached: float | None
    asked: float | None = None
    at_most: bool = False
    unit: str = "x"
    row: Comparison | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """True if the target is met; None if there is no target or no measurement."""
        if self.reached is None or self.asked is None:
            return None
        return self.reached <= self.asked if self.at_most else self.reached >= self.asked


def in_turn(
    ours: Callable[[], object], peer: Callable[[], object], our_calls: int = 1, runs: int = 7
) -> Times:
    """Time both callables alternately.

    Each side is timed right after an untimed call of its own, so that neither pays for caches that
    the other has filled, as when a user drags a slider. Compute statistics pair by pair, so that
    drifts of the machine's speed cancel.
    """
    times = np.array([(_warm_ms(ours, our_calls), _warm_ms(peer)) for _ in range(runs)])
    return Times(times[..., 0], times[..., 1])


def _warm_ms(call: Callable[[], object], calls: int = 1) -> NDArray[np.float64]:
    call()
    started = _clocks()
    for _ in range(calls):
        call()
    return 1e3 * (_clocks() - started) / calls


def _clocks() -> NDArray[np.float64]:
    return np.array([time.perf_counter(), time.process_time()])


def commit() -> str:
    """Return the checkout's revision, with ``+`` if there are changes."""
    try:
        return subprocess.run(
            ["git", "describe", "--always", "--dirty=+"], capture_output=True, text=True, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def compare(
    name: str,
    peer_name: str,
    device: str,
    ours: Callable[[], object],
    peer: Callable[[], object],
    our_calls: int = 1,
    runs: int = 7,
) -> Comparison:
    """Measure and print one row: medians, and the median ratio.

    ``our_calls`` calls of ours are timed together; the result is per call.
    """
    times = in_turn(ours, peer, our_calls, runs)
    ours_ms, peer_ms = (float(n) for n in np.median(times.wall, axis=0))
    ratio, cpu_ratio = (float(np.median(each[:, 1] / each[:, 0])) for each in times)
    print(
        f"{name:28s} ours {ours_ms:8.1f} ms   {peer_name} {peer_ms:8.1f} ms   ratio {ratio:6.2f}"
        f"   of all cores' time {cpu_ratio:6.2f}",
        flush=True,
    )
    return Comparison(name, peer_name, ours_ms, peer_ms, ratio, device, commit(), cpu_ratio)


def save(figures: Iterable[Figure]) -> None:
    """Write the rows as JSON."""
    rows = [asdict(figure.row) for figure in figures if figure.row]
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps(rows, indent=2) + "\n")
    print(f"written to {RESULTS}")


def report(figures: Iterable[Figure]) -> str:
    """Return a table with a line for each figure: name, target, value and verdict.

    >>> print(report([Figure("cast", 4.12, asked=3), Figure("scan", None, 3, note="no file")]))
    figure                                   asked        reached
    cast                                     ≥ 3 x         4.12 x  met
    scan                                     ≥ 3 x                 skipped: no file
    """
    lines = [f"{'figure':32s}{'asked':>14s}{'reached':>15s}"]
    for figure in figures:
        sign = "≤" if figure.at_most else "≥"
        asked = "" if figure.asked is None else f"{sign} {figure.asked:g} {figure.unit}"
        reached = "" if figure.reached is None else f"{figure.reached:.3g} {figure.unit}"
        verdict = {True: "met", False: "MISSED", None: ""}[figure.met]
        if figure.reached is None:
            verdict = f"skipped: {figure.note}"
        lines.append(f"{figure.name:32s}{asked:>14s}{reached:>15s}  {verdict}".rstrip())
    return "\n".join(lines)


def between(text: str, name: str) -> str:
    """Return the text between the markers of a name.

    >>> between("a <!-- t -->b<!-- /t --> c", "t")
    'b'
    """
    start, end = _markers(name)
    if text.count(start) != 1 or text.count(end) != 1:
        raise ValueError(f"the page needs one {start} and one {end}")
    return text.split(start)[1].split(end)[0]


def replaced(text: str, name: str, content: str) -> str:
    """Return the text with other content between the markers."""
    start, end = _markers(name)
    return text.replace(start + between(text, name) + end, start + content + end)


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->", f"<!-- /{name} -->"
