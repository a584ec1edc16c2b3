"""Memory of pictures that are given up goes back to the system.

    view -> [memory] -> malloc

glibc keeps what large blocks took, once it has seen them freed, and so holds up to twice the
memory in use after some minutes of casts in ever other sizes.
"""

from __future__ import annotations

import ctypes
import sys

# mallopt(3): blocks from this size on are the system's own, whatever has been freed.
_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1_000_000


def give_back_large() -> None:
    """Have large blocks given back as soon as they are freed, for the rest of the process.

    Nothing changes where the C library is another than glibc.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
