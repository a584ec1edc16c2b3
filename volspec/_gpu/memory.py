"""Free memory of the host."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from pathlib import Path


def host_free_bytes(root: Path = Path("/")) -> int:
    """Return the memory this process can still allocate, on the machine or in its container.

    Without limit where the system does not say: only Linux does.
    """
    free = sys.maxsize
    with suppress(OSError):  # another system, or a hidden /proc
        match = re.search(r"^MemAvailable: +(\d+) kB", (root / "proc/meminfo").read_text(), re.M)
        free = 1024 * int(match[1]) if match else free
    group = root / "sys/fs/cgroup"
    try:
        limit = int((group / "memory.max").read_text())  # ValueError if it is "max"
        used = int((group / "memory.current").read_text())
        stat = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):
        return free
    # Cached files count as used, but are dropped when memory runs short.
    return min(free, max(limit - used + int(stat.get("inactive_file", 0)), 0))
