"""Messages of ITK."""

from __future__ import annotations

import re

_SENDER = re.compile(r"(?:ITK )?ERROR: \w+\(0x[0-9a-f]+\): ")


def itk_message(error: RuntimeError, output: list[str]) -> str:
    """Return ITK's innermost message, the last one, such as "expected 7208960 bytes but …"."""
    lines = [line.strip() for line in [*str(error).splitlines(), *output] if line.strip()]
    return _SENDER.sub("", lines[-1])
