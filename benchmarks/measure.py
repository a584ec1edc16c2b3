"""Time two callables in turn and keep the ratio."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

RESULTS = Path("build/bench.json")


@dataclass(frozen=True, slots=True)
class Comparison:
    """One row of ``build/bench.json``; ratio = peer / ours, above 1 is ahead."""

    name: str
    peer: str
    ours_ms: float
    peer_ms: float
    ratio: float
    device: str
    commit: str


def in_turn(
    ours: Callable[[], object], peer: Callable[[], object], our_calls: int = 1, runs: int = 7
) -> tuple[float, float, float]:
    """Median milliseconds of both, run alternately, and the median ratio.

    Each side is timed right after an untimed call of its own: neither pays for the caches the
    other has filled, as neither does when a user drags a slider. The ratio is taken pair by
    pair, so that a machine whose speed drifts does not move it.
    """
    pairs = [(_warm_ms(ours, our_calls), _warm_ms(peer)) for _ in range(runs)]
    return (
        median(a for a, _ in pairs),
        median(b for _, b in pairs),
        median(b / a for a, b in pairs),
    )


def _warm_ms(call: Callable[[], object], calls: int = 1) -> float:
    call()
    started = time.perf_counter()
    for _ in range(calls):
        call()
    return 1e3 * (time.perf_counter() - started) / calls


def commit() -> str:
    """The checkout's revision, with ``+`` where it has changes."""
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
) -> Comparison:
    """Measure and print one row; ``our_calls`` of ours are timed together, per call."""
    ours_ms, peer_ms, ratio = in_turn(ours, peer, our_calls)
    row = Comparison(name, peer_name, ours_ms, peer_ms, ratio, device, commit())
    print(f"{name:32s} ours {ours_ms:8.1f} ms   {peer_name} {peer_ms:8.1f} ms   ratio {ratio:5.2f}")
    return row


def save(rows: list[Comparison]) -> None:
    """Write the rows for machines."""
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")
    print(f"written to {RESULTS}")
