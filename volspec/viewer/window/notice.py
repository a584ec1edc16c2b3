"""One line told to the user, for a while."""

from __future__ import annotations

import time
from dataclasses import dataclass

from volspec.errors import one_line

SECONDS = 8.0
# Of what has been seen happen.
SHORT_SECONDS = 2.0


@dataclass(slots=True)
class Notice:
    """The line, and until when it stands."""

    text: str = ""
    until: float = 0.0

    def say(self, text: str, seconds: float = SECONDS) -> None:
        """Another line in place of the present one."""
        self.text, self.until = one_line(text), time.perf_counter() + seconds

    def ended(self, now: float) -> bool:
        """Whether its time was over, and it is gone now."""
        if not self.text or now <= self.until:
            return False
        self.text = ""
        return True
