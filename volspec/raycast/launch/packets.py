"""Packets of rays: how many a work-item of a CPU marches together, and how it loads their voxels.

    device -> [packets] -> Packet -> Raycaster

The fastest that works is found by a trial in a child process, which a driver's compiler may end,
and cached by device and driver. Pictures are the same.
"""

from __future__ import annotations

import json
import subprocess
from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np

from volspec import __version__, _cache
from volspec._child import child_command
from volspec._gpu import DeviceInfo, device_key, devices

# Shapes by lanes, (width, height) in pixels; lanes.clh numbers the lanes row by row.
TILES = {1: (1, 1), 4: (2, 2), 8: (4, 2), 16: (4, 4)}
_FILE, _TIMEOUT_S = "packets.json", 120.0
# A later candidate has to take this much less time.
_GAIN = 0.97
_TRIAL = """
import sys
from volspec.raycast.packet_trial import measure
for name, ms in measure(*sys.argv[2:]):
    print(name, ms, flush=True)
"""


@dataclass(frozen=True, slots=True)
class Packet:
    """Rays that a work-item marches together.

    ``single_loads`` keeps compilers from making gather instructions of their loads.
    """

    lanes: int
    single_loads: bool = False

    def __str__(self) -> str:
        rays = "single rays" if self.lanes == 1 else f"packets of {self.lanes} rays"
        return f"{rays}, single loads" if self.single_loads else rays


SAFE = Packet(8)
"""Packet that every CPU's driver compiles."""


def candidates(info: DeviceInfo) -> list[Packet]:
    """Return the packets to try, the safest first."""
    if not info.is_cpu:
        return [Packet(1)]
    wide_packets = [Packet(16), Packet(16, single_loads=True)] if info.vector_width >= 16 else []
    return [SAFE, *wide_packets] if wide_packets else [SAFE, Packet(8, single_loads=True)]


def choose_packet(index: int) -> Packet:
    """Return the packet for a device of `volspec._gpu.devices`, tried once per driver."""
    available = devices()
    packets = candidates(available[index])
    if len(packets) == 1:
        return packets[0]
    # Another version has other kernels.
    key = f"{__version__} | {device_key(index, available)}"
    with suppress(KeyError, TypeError):  # never tried, or damaged
        return Packet(**_cache.cached_rows(_FILE)[key])
    times = _try(index, packets)
    best = SAFE
    for packet in packets:
        if times.get(packet, np.inf) < _GAIN * times.get(best, np.inf):
            best = packet
    _cache.cache_rows(_FILE, {key: asdict(best)})
    return best


def _try(index: int, packets: list[Packet]) -> dict[Packet, float]:
    """Return the CPU time of each packet that the device carries, ms."""
    names = [json.dumps(asdict(packet)) for packet in packets]
    command = [*child_command(_TRIAL), str(index), *names]
    try:
        done = subprocess.run(
            command, capture_output=True, check=False, timeout=_TIMEOUT_S, text=True
        )
        output = done.stdout
    except subprocess.TimeoutExpired as error:
        output = (error.stdout or b"").decode(errors="replace")
    except (OSError, TypeError):  # the latter if the interpreter's path is unknown
        return {}
    rows = [line.rpartition(" ") for line in output.splitlines() if line.startswith("{")]
    return {Packet(**json.loads(name)): float(ms) for name, _, ms in rows}
