"""Time the cost of safety: reading volumes in a child process, and testing devices.

``python -m benchmarks.reading``. Each run of "first" is a new program, like a command; "next" are
later reads in the same program, as in the viewer.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.measure import Figure, in_turn, report
from volspec._gpu import device_list as devices
from volspec.volume import Volume, load_volume

ENGINE = Path(__file__).resolve().parents[1] / "data/engine.nrrd"
_FIRST = """
import sys, time
import numpy
from benchmarks.reading import here
from volspec.volume import load_volume
started = time.perf_counter()
{read}(sys.argv[1])
print(1e3 * (time.perf_counter() - started))
"""
_SIDE = 512


def here(path: str) -> Volume:
    """Read a volume with a library in this process, like a script that uses nibabel or ITK."""
    if ".nii" in path:
        import nibabel

        image: Any = nibabel.load(path)
        values = np.array(image.dataobj).T  # not mapped, but in memory
        return Volume(values, spacing_mm=image.header.get_zooms()[:3], name=path)
    import SimpleITK as sitk

    image = sitk.ReadImage(path)
    return Volume(sitk.GetArrayFromImage(image), spacing_mm=image.GetSpacing(), name=path)


def _first_ms(path: Path, read: str) -> float:
    command = [sys.executable, "-c", _FIRST.format(read=read), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout)


def figures() -> Iterator[Figure]:
    """Time reads here and in a child, alternately, and the test of the device in use."""
    pairs = np.array(
        [(_first_ms(ENGINE, "load_volume"), _first_ms(ENGINE, "here")) for _ in range(7)]
    )
    ours, peer = np.median(pairs, axis=0)
    note = f"{ours:.0f} ms in a child, {peer:.0f} here"
    extra = median(pairs[:, 0] - pairs[:, 1])
    yield Figure("read/engine, a program's first", extra, 150.0, True, "ms more", note=note)
    pairs = in_turn(lambda: load_volume(ENGINE), lambda: here(str(ENGINE))).wall
    extra = median(pairs[:, 0] - pairs[:, 1])
    yield Figure("read/engine, the next", extra, 150.0, True, "ms more")
    with tempfile.TemporaryDirectory() as folder:
        for suffix, packed in ((".nrrd", False), (".nii", False), (".nii.gz", True)):
            path = Path(folder, f"v{suffix}")
            _write(path, packed)
            pairs = in_turn(partial(load_volume, path), partial(here, str(path)), runs=5).wall
            ratio = median(pairs[:, 0] / pairs[:, 1])
            ours, peer = np.median(pairs, axis=0)
            note = f"{ours:.0f} ms in a child, {peer:.0f} here"
            yield Figure(
                f"read/{512 if not packed else 128}³ float32 {suffix}",
                ratio,
                1.15,
                True,
                "x",
                note=note,
            )
            path.unlink()
    found = devices.devices()
    index = devices.choose_device()
    times = {}
    for again in (True, False):
        started = perf_counter()
        devices.fault(index, found, again=again)
        times[again] = perf_counter() - started
    yield Figure("device/trial, once", times[True], 2.0, True, "s", note=found[index].name)
    yield Figure("device/trial, later starts", 1e3 * times[False], 10.0, True, "ms")


def _write(path: Path, packed: bool) -> None:
    """Write a smooth field with noise in its last bits, like measured data."""
    import SimpleITK as sitk

    side = 128 if packed else _SIDE  # ITK takes a minute to compress 512³
    axis = np.linspace(-1, 1, side, dtype=np.float32)
    values = np.hypot(np.hypot(axis[:, None, None], axis[:, None]), axis)
    sitk.WriteImage(sitk.GetImageFromArray(values), str(path), packed)


if __name__ == "__main__":
    print(report(list(figures())))
