"""Make the pictures of docs/large.md: ``python -m tools.gallery.larger [--gib 4]``.

three commands -> memory of each -> docs/images/large-memory.png, large-sponge.jpg
engine: whole, in parts, and with a damaged chunk -> large-parts.jpg
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil
from PIL import Image

from tests.support.pyramids import pyramid_of
from tools.gallery.studio import ROOT
from volspec.camera import Camera
from volspec.large import level_caster as out_of_core
from volspec.large.conversion import convert
from volspec.pipeline import raycast, relight
from volspec.scene import Scene
from volspec.volume import load_volume
from volspec.volume.out_of_memory import level_of

FOLDER = ROOT / "docs" / "images"
_SIDE, _EVERY_S = 2048, 0.05
_SIZE = 360, 360
_VOLSPEC = (sys.executable, "-m", "volspec")


@dataclass(frozen=True)
class Run:
    """A command, and the bytes of memory of its processes over time."""

    name: str
    shown: str
    seconds: list[float]
    used: list[int]


def main() -> None:
    """Make the pictures, and print the commands with their time and memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gib", type=float, default=4.0)
    gib = parser.parse_args().gib
    with tempfile.TemporaryDirectory(dir=ROOT / "build") as folder:
        parts(Path(folder), FOLDER / "large-parts.jpg")
        runs = three_commands(Path(folder), gib)
        save(Image.open(Path(folder) / "big.png"), FOLDER / "large-sponge.jpg")
    plot(runs, FOLDER / "large-memory.png")
    for each in runs:
        peak = max(each.used) / 2**30
        print(f"{each.shown}\n    {each.seconds[-1]:.0f} s, {peak:.2f} GiB")


def three_commands(folder: Path, gib: float) -> list[Run]:
    """Make a sponge, convert it, and render it with 1 GiB of memory for its voxels."""
    depth = round(gib * 2**30 / _SIDE**2)
    address = f"big.raw?shape={_SIDE}x{_SIDE}x{depth}&dtype=uint8"
    size = "900x900"
    commands = [
        (sys.executable, "-m", "benchmarks.large", f"{folder}/big.raw", "--gib", f"{gib:g}"),
        (*_VOLSPEC, "convert", f"{folder}/{address}", "-o", f"{folder}/big.zarr"),
        (
            *(*_VOLSPEC, "render", f"{folder}/big.zarr", "-o", f"{folder}/big.png"),
            *("--size", size, "--memory", "1GiB"),
        ),
    ]
    shown = [
        f"python -m benchmarks.large big.raw --gib {gib:g}",
        f"volspec convert {shlex.quote(address)} -o big.zarr",
        f"volspec render big.zarr -o big.png --size {size} --memory 1GiB",
    ]
    named = zip(("make", "convert", "render"), shown, commands, strict=True)
    return [watched(*each) for each in named]


def watched(name: str, shown: str, command: tuple[str, ...]) -> Run:
    """Run a command and sample the memory of its processes."""
    process = subprocess.Popen(command, cwd=ROOT)
    root, began = psutil.Process(process.pid), time.perf_counter()
    run = Run(name, shown, [], [])
    while process.poll() is None:
        try:
            used = sum(p.memory_info().rss for p in (root, *root.children(recursive=True)))
        except psutil.Error:
            break
        run.seconds.append(time.perf_counter() - began)
        run.used.append(used)
        time.sleep(_EVERY_S)
    if process.wait() != 0:
        raise SystemExit(f"{shown}: exit code {process.returncode}")
    return run


def plot(runs: list[Run], path: Path) -> None:
    """Plot the memory of the commands, one panel each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((9.0, 2.9), layout="constrained")
    top = max(max(each.used) for each in runs) / 2**30 * 1.12
    for axes, each in zip(figure.subplots(1, len(runs), sharey=True), runs, strict=True):
        axes.fill_between(each.seconds, np.array(each.used) / 2**30, lw=0, color="#7fa8d1")
        axes.plot(each.seconds, np.array(each.used) / 2**30, lw=1.2, color="#1f4e79")
        axes.set(xlim=(0, None), ylim=(0, top), xlabel="s")
        axes.set_title(each.name, fontsize=10, loc="left")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("memory in GiB")
    FigureCanvasAgg(figure).print_png(str(path))
    with Image.open(path) as made:
        made.convert("RGB").quantize(64).save(path, optimize=True)


def parts(folder: Path, path: Path) -> None:
    """Show the engine whole, in parts of 32³ cells, ten times their difference, and a gap."""
    scene = Scene.load(ROOT / "data" / "scenes" / "engine.toml")
    volume = load_volume("engine")
    convert(level_of(volume), folder / "engine.zarr")
    (folder / "engine.zarr/0/c/0/1/2").write_bytes(b"damaged")
    damaged = load_volume(f"{folder}/engine.zarr?memory=5MB")
    camera = Camera.orbit(volume, azimuth_deg=35, elevation_deg=25, zoom=1.4)
    spec = replace(scene.raycast, level=0, step_mm=0.5)
    own = out_of_core.sides_for
    out_of_core.sides_for = lambda *given: (32, 32, 32)
    try:
        one, other, incomplete = (
            relight(
                raycast(each, scene.transfer, camera, _SIZE, spec),
                scene.lights[0].rig,
                scene.relight,
                np.float32,
            )
            for each in (volume, pyramid_of(volume), damaged)
        )
    finally:
        out_of_core.sides_for = own
    tenfold = np.clip(10 * np.abs(one - other), 0, 1)
    print(f"in parts: the greatest difference is {np.abs(one - other).max():.1e} of 1")
    strip = np.concatenate([one, other, tenfold, incomplete], axis=1)
    save(Image.fromarray(np.rint(255 * strip).astype(np.uint8)), path)


def save(image: Image.Image, path: Path) -> None:
    """Save a picture as JPEG."""
    image.convert("RGB").save(path, quality=86, optimize=True)


if __name__ == "__main__":
    main()
