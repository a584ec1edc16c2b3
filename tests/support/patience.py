"""Wait for a condition; the limit only ends a hang."""

import time
from collections.abc import Callable
from typing import Any

# No machine, however busy, needs so long.
PATIENCE_S = 300.0


def wait_until(
    holds: Callable[[], object], what: object = "", pause: Callable[[], object] | None = None
) -> Any:
    """Wait for a condition, assert and return it; ``pause`` comes between two looks."""
    end = time.monotonic() + PATIENCE_S
    while not (done := holds()) and time.monotonic() < end:
        time.sleep(0.002) if pause is None else pause()
    assert done, what
    return done
