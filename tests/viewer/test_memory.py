"""What a picture took is the system's again, whatever was allocated after it."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# The first block, freed, would teach glibc to keep blocks of this size in its heap.
_PICTURES = """
import re
from pathlib import Path

def taken():
    (kilobytes,) = re.findall(r"RssAnon:\\s*(\\d+)", Path("/proc/self/status").read_text())
    return int(kilobytes) / 1024

from volspec.viewer.work.pictures import give_back_large
if {given}:
    give_back_large()
import numpy as np
before, small = taken(), []
for _ in range(4):
    picture = np.ones(16 * 2**20, np.uint8)
    small += [np.ones(100_000, np.uint8) for _ in range(3)]
    del picture
print(taken() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_a_picture_s_memory_is_given_back() -> None:
    kept, back = (
        float(
            subprocess.run(
                [sys.executable, "-c", _PICTURES.format(given=given)],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        for given in (False, True)
    )
    # MiB, of which the small ones take 1.1.
    assert back < 3
    assert kept > back + 8
