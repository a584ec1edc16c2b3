"""Threads that give way to the window's, where both want the same cores.

document, session -> [priority] -> OpenCL device -> casts
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")

# Of 19: a cast gets a tenth of a core that the window wants, too.
_NICE = 10


def yielding(make: Callable[[], T]) -> T:
    """What a function makes, whose own threads, which outlive it, give way.

    Linux gives a thread the priority of the one that starts it; elsewhere nothing changes.

    >>> yielding(lambda: 6 * 7)
    42
    """
    with ThreadPoolExecutor(1, "volspec-yielding", initializer=_give_way) as pool:
        return pool.submit(make).result()


def _give_way() -> None:
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
