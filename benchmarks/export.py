"""Gain of an export from casting once, and its state after being killed.

One export of many lights × one camera, against a cast per light; neither encodes files. An export
killed at random times and repeated until done must leave the same bytes as an undisturbed one.

``python -m benchmarks.export`` alone: 20 kills; ``figures()`` uses three.
"""

from __future__ import annotations

import hashlib
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from PIL import Image

from benchmarks.measure import Comparison, Figure, commit
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import asset
from volspec.export import export as export_scene
from volspec.export import frame_files
from volspec.pipeline import Raycaster, Relighter
from volspec.scene import Scene
from volspec.scene.file import scene_file
from volspec.settings import plain
from volspec.spectra import light_set

ASKED = 8.0
SIZE, LIGHTS, KILLS = (1024, 1024), 24, 3
# Kills in the full test of survival; takes minutes.
ALL_KILLS = 20
_SEED, _RUNS = 7, 3


def scene_of(lights: int) -> Scene:
    """Return the demo under many lights of the library."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    rows = [
        {"name": f"{i:02d} {spectrum.name}", "spectrum": spectrum.name}
        for i, spectrum in enumerate(light_set("spiky")[:lights])
    ]
    return Scene(scene_file({**plain(scene.file), "light": rows}, scene.path), scene.path)


def digests(folder: Path) -> dict[str, str]:
    """Return a digest of every file."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def once(scene: Scene, size: tuple[int, int]) -> tuple[np.ndarray, float, bool]:
    """Return ms of one cast and of a cast per light, (runs, 2); ms with files; True if equal."""
    volume = scene.volume()
    caster = Raycaster(volume)
    seen = scene.relight
    frames: dict[str, np.ndarray] = {}

    def cast_each() -> None:
        for light in scene.lights:
            image = scene.render(volume, caster=caster, size=size)
            with Relighter(image, lut3d=False) as relighter:
                frames[light.name] = relighter.frame(light.rig, seen)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings: dict[str, Any] = {"size": size, "caster": caster, "sheet": False}

        def export(number: int) -> None:
            with mock.patch.object(frame_files, "encode", lambda *_: b""):
                export_scene(scene, folder / str(number), **settings)

        export(-1)
        scene.render(volume, caster=caster, size=size)
        times = np.array([[taken(partial(export, run)), taken(cast_each)] for run in range(_RUNS)])
        encoded = taken(lambda: export_scene(scene, folder / "frames", **settings))
        there = sorted((folder / "frames").glob("*.png"))
        pictures = [np.asarray(Image.open(path)) for path in there]
        same = all(map(np.array_equal, pictures, (frames[name] for name in sorted(frames))))
    return times, encoded, same


def taken(call: Callable[[], object]) -> float:
    """Milliseconds."""
    started = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - started)


def survived(kills: int, size: tuple[int, int], frames: int = 24) -> int:
    """Count the exports killed at a random time whose final files equal an undisturbed export's."""
    chance, equal = random.Random(_SEED), 0
    with tempfile.TemporaryDirectory() as root:

        def command(name: str) -> list[str]:
            return [
                *(sys.executable, "-m", "volspec", "export", str(asset("data/scenes/engine.toml"))),
                *("-o", f"{root}/{name}", "--size", f"{size[0]}x{size[1]}", "--json"),
                *("--turntable", str(frames), "--light", "D65", "--light", "A"),
            ]

        def run(name: str) -> None:
            subprocess.run(command(name), check=True, capture_output=True)

        def begun(name: str) -> subprocess.Popen[bytes]:
            """Return an export that has written its manifest: casts and frames follow."""
            export = subprocess.Popen(command(name), stdout=subprocess.DEVNULL)
            while export.poll() is None and not Path(root, name, "export.json").exists():
                time.sleep(0.01)
            return export

        run("warm")
        # By a clock: the manifest is written again at the end, so its date says nothing.
        whole, started = begun("whole"), time.perf_counter()
        if whole.wait():
            raise subprocess.CalledProcessError(whole.returncode, whole.args)
        took = time.perf_counter() - started
        expected = digests(Path(root, "whole"))
        for number in range(kills):
            name = f"killed-{number}"
            export = begun(name)
            time.sleep(took * chance.uniform(0.0, 0.9))
            export.send_signal(signal.SIGKILL)
            export.wait()
            there = len(list(Path(root, name).rglob("*.png")))
            run(name)
            same = digests(Path(root, name)) == expected
            equal += same
            print(f"killed with {there} frames there: {'equal' if same else 'DIFFERENT'}")
    return equal


def figures(
    size: tuple[int, int] = SIZE, lights: int = LIGHTS, kills: int = KILLS
) -> Iterator[Figure]:
    """Yield the two figures."""
    times, encoded, same = once(scene_of(lights), size)
    ours, peer = (float(ms) for ms in np.median(times, axis=0))
    ratio, device = float(np.median(times[:, 1] / times[:, 0])), Compute.open().info.name
    name = f"export/{lights} lights"
    print(
        f"{name} {size[0]}x{size[1]}: one cast {ours:.0f} ms, a cast each {peer:.0f} ms, ratio "
        f"{ratio:.2f}; with PNG files {encoded:.0f} ms; pictures {'equal' if same else 'DIFFERENT'}"
    )
    row = Comparison(name, "a cast a light", ours, peer, ratio, device, commit())
    yield Figure(name, ratio if same else 0.0, ASKED, row=row)
    yield Figure("export: killed, then equal", survived(kills, (128, 128)) / kills, 1.0)


if __name__ == "__main__":
    for figure in figures(kills=ALL_KILLS):
        print(figure)
