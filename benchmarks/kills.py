"""Does killing a program leave torn or stray files? ``python -m benchmarks.kills``.

Every command that writes files is killed repeatedly, mostly during writes, and then run to its
end. A file with its final name must be whole at any moment; after the second run, no leftovers of
the first may remain, and the bytes must equal those of an undisturbed run.

``--kills N`` per command, ``--only TEXT…`` for commands whose names contain one of the texts. Needs
a system that forks: a command starts from a process that has imported everything.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
from PIL import Image

from volspec import _cache, cli
from volspec.export.demo import run_demo
from volspec.scene import Scene
from volspec.viewer.model import camera, scene_file
from volspec.viewer.model.document import Document
from volspec.viewer.model.scene_file import export_python
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.session import read_session
from volspec.viewer.work.session_store import SessionStore
from volspec.volume import phantom

KILLS, _SEED = 3, 11
# Fraction of kills at any moment of the run; the others hit a write.
_ANYWHERE = 0.2
# Runs that end before they are killed are repeated, up to this often per kill.
_MAX_RUNS = 5
_PREFIX = ".volspec-"
# Seconds between two looks at a folder, to leave the cores to the job.
_LOOK_S = 1e-4
_IMPORTS = (
    *("OpenEXR", "clarabel", "colour", "imageio_ffmpeg", "matplotlib.figure", "moderngl"),
    *("pyopencl", "rich.table", "scipy.optimize", "tomlkit"),
)
_FORK = multiprocessing.get_context("fork")

_SCENE = """
title = "Ball"
[volume]
file = "ball.npy"
[[material]]
name = "shell"
reflectance = "ColorChecker/blue sky"
[[material]]
name = "core"
reflectance = "ColorChecker/orange"
[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "shell" },
    { value = 0.4, opacity = 0.2, material = "shell" },
    { value = 0.8, opacity = 0.9, material = "core" },
]
[basis]
method = "materials"
[[light]]
name = "day"
spectrum = "D65"
[[light]]
name = "lamp"
spectrum = "A"
[output]
width = 32
height = 32
"""
_PALETTE = """
[[light]]
name = "day"
spectrum = "D65"
[[reflectance]]
name = "a"
[[cell]]
reflectance = "a"
light = "day"
colour = "steelblue"
"""


@dataclass(frozen=True, slots=True)
class Job:
    """Something that writes files.

    Parameters
    ----------
    name : str
    run : callable
        Function of the folder to write to.
    replaces : bool
        Overwrites its earlier files; every other kill starts with such files.
    varies : tuple of str
        Patterns of files that differ between runs.
    """

    name: str
    run: Callable[[Path], object]
    replaces: bool = True
    varies: tuple[str, ...] = ()


@dataclass(slots=True)
class Count:
    """Outcome of the kills of one job."""

    kills: int = 0
    amid: int = 0
    torn: int = 0
    left: int = 0
    other: int = 0


def command(name: str, *words: str | Path, **settings: bool) -> Job:
    """Return a command as typed, with ``OUT`` for the folder to write to."""

    def run(folder: Path) -> None:
        cli.main([str(word).replace("OUT", str(folder)) for word in words])

    return Job(name, run, **settings)


def jobs(inputs: Path) -> Iterator[Job]:
    """Yield everything that writes files, on a volume of 12³ voxels and pictures of 32 x 32."""
    scene, palette, image, photo = (
        inputs / name for name in ("ball.toml", "palette.toml", "ball.exr", "photo.png")
    )
    np.save(inputs / "ball.npy", phantom.ball(12).values)
    scene.write_text(_SCENE, encoding="utf-8")
    palette.write_text(_PALETTE, encoding="utf-8")
    codes = np.random.default_rng(_SEED).integers(0, 256, (32, 32, 3), np.uint8)
    Image.fromarray(codes).save(photo)
    run_to_end(command("image", "render", scene, "-o", image), inputs)

    yield command("render", "render", scene, "-o", "OUT/a.exr")
    lights = ("--light", "D65", "--light", "A")
    yield command("relight", "relight", image, *lights, "--errors", "-o", "OUT/a.png")
    yield command(
        "relight --spectral", "relight", image, *lights[:2], "--spectral", "-o", "OUT/a.exr"
    )
    turn = ("--turntable", "3")
    yield command("export frames", "export", scene, *turn, "-o", "OUT/frames", replaces=False)
    yield command(
        "export EXR", "export", scene, "--format", "exr", "-o", "OUT/frames", replaces=False
    )
    yield command("export film", "export", scene, *turn, "-o", "OUT/film.mp4")
    yield command("page", "page", scene, "-o", "OUT/page.html")
    design = ("-o", "OUT/new.toml", "--figure", "OUT/new.png")
    yield command("design", "design", palette, *design)
    yield command("wizard", "wizard", "keep", scene, "core", "-o", "OUT/new.toml")
    paint = ("-o", "OUT/paint.csv", "--figure", "OUT/paint.png")
    yield command("reflectance", "reflectance", "#c08040", *paint)
    yield command("reflectance --image", "reflectance", "--image", photo, "-o", "OUT/photo.exr")
    for suffix in ("py", "nk", "exr"):
        light = lights[:2] if suffix == "exr" else ()
        yield command(
            f"compositing .{suffix}", "compositing", image, *light, "-o", f"OUT/a.{suffix}"
        )
    opened = Scene.load(scene)
    # The page and the sheet show the time taken.
    varying = ("report.json", "sheet.png")
    yield Job("demo", lambda out: run_demo(opened, out, lambda *_: None), varies=varying)
    yield command("appearance", "appearance", "--image", image, "-o", "OUT/models.png")
    basis = ("-o", "OUT/basis.json", "--figure", "OUT/basis.png")
    yield command("basis", "basis", "general-5", "--reflectances", "patches", *basis)
    state = ViewState.first(Document.of(opened, opened.volume(), None), (32, 32))
    moved = camera.orbit(state, 0.2, 0.1)
    yield Job("viewer: scene", lambda out: scene_file.export_scene(moved, out / "saved.toml"))
    yield Job("viewer: Python", lambda out: export_python(moved, out / "saved.py"))
    yield Job("viewer: session", lambda out: sessions(out, state), varies=("*.volspec.json",))
    arrays = {"values": np.random.default_rng(_SEED).standard_normal((512, 512))}
    yield Job("cache", lambda out: cache(out, arrays), replaces=False)


def sessions(folder: Path, state: ViewState) -> None:
    """Save as the viewer does during work: the same file twice, then another document."""
    store = SessionStore(folder)
    store.ended_early()
    for title in ("one", "two"):
        state = replace(state, document=replace(state.document, title=title))
        store.begin(state)
        for _ in range(2):
            state = camera.orbit(state, 0.1, 0.0)
            store.save(state)
    store.end()


def cache(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Make arrays in a cache of their own."""
    os.environ["XDG_CACHE_HOME"] = str(folder)
    _cache.cached_arrays("kills/arrays", "maker", lambda: arrays)


def start(job: Job, folder: Path) -> BaseProcess:
    """Run a job in its own process, with its output in a file."""

    def quiet() -> None:
        log = os.open(f"{folder}.log", os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        try:
            job.run(folder)
        except Exception:
            traceback.print_exc()
            sys.exit(1)

    folder.mkdir(exist_ok=True)
    process = _FORK.Process(target=quiet)
    process.start()
    return process


def run_to_end(job: Job, folder: Path) -> None:
    """Run a job to its end."""
    process = start(job, folder)
    process.join()
    if process.exitcode:
        raise SystemExit(f"{job.name}: failed; {Path(f'{folder}.log').read_text()}")


def unfinished_files(folder: Path) -> set[str]:
    """Return the files that are being written, or whose writer died."""
    return {
        name.split(".")[1]
        for _, _, names in os.walk(folder)
        for name in names
        if name.startswith(_PREFIX)
    }


def measure(job: Job, folder: Path) -> tuple[float, list[float]]:
    """Run a job to its end; return the time of the run and of each write, in seconds."""
    began, writes = time.perf_counter(), dict[str, tuple[float, float]]()
    process = start(job, folder)
    while process.exitcode is None:
        now = time.perf_counter()
        for name in unfinished_files(folder):
            writes[name] = (writes.get(name, (now,))[0], now)
        time.sleep(_LOOK_S)
    if process.exitcode:
        raise SystemExit(f"{job.name}: failed; {Path(f'{folder}.log').read_text()}")
    return time.perf_counter() - began, [last - first for first, last in writes.values()]


def kill(job: Job, folder: Path, whole_s: float, writes: list[float], dice: random.Random) -> bool:
    """Kill a job during a write, or anywhere; return False if it ended before."""
    if writes and dice.random() >= _ANYWHERE:
        nth = dice.randrange(len(writes))
        after_s = dice.uniform(0.0, 1.2 * writes[nth])
    else:
        nth, after_s = -1, dice.uniform(0.0, whole_s)
    process, seen, due = start(job, folder), set[str](), float("inf")
    while process.exitcode is None:
        if due == float("inf"):
            seen |= unfinished_files(folder)
            if len(seen) > nth:
                due = time.perf_counter() + after_s
        elif time.perf_counter() >= due:
            process.kill()
            process.join()
        time.sleep(_LOOK_S)
    return process.exitcode < 0


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files that have their final names."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(_PREFIX)
    }


def is_whole(path: Path) -> bool:
    """Return True if a file without known contents can be read to its end."""
    try:
        if path.name.endswith(".volspec.json"):
            read_session(path)
        elif path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix == ".png":
            Image.open(path).load()
        else:
            return False
    except Exception:
        return False
    return True


def count_damage(job: Job, kills: int, root: Path) -> Count:
    """Kill a job repeatedly, each time in a new folder, and check its files."""
    dice, count = random.Random(f"{_SEED} {job.name}"), Count()
    run_to_end(job, root / "warm")  # kernels and caches
    for _ in range(_MAX_RUNS):
        shutil.rmtree(root / "whole", ignore_errors=True)
        whole_s, writes = measure(job, root / "whole")
        if writes:  # else they were too quick to observe
            break
    expected = contents(root / "whole")

    def varies(name: str) -> bool:
        return any(fnmatch.fnmatch(name, pattern) for pattern in job.varies)

    for number in range(_MAX_RUNS * kills):
        folder = root / "killed"
        has_old = job.replaces and number % 2 == 1
        if has_old:
            shutil.copytree(root / "whole", folder)
        if kill(job, folder, whole_s, writes, dice):
            count.kills += 1
            count.amid += bool(unfinished_files(folder))
            there = contents(folder)
            count.torn += (has_old and not expected.keys() <= there.keys()) or not all(
                data == expected.get(name) or is_whole(folder / name)
                for name, data in there.items()
                if not name.startswith("running/")
            )
            run_to_end(job, folder)
            there = contents(folder)
            extra = [name for name in there.keys() - expected.keys() if not varies(name)]
            count.left += bool(unfinished_files(folder) or extra)
            count.other += any(
                there.get(name) != data for name, data in expected.items() if not varies(name)
            )
        shutil.rmtree(folder)
        if count.kills == kills:
            break
    return count


def main() -> None:
    """Print a row for each command; exit with 1 if a file is torn, left over or different."""
    parser = argparse.ArgumentParser(description="Kill commands that write, and check files.")
    parser.add_argument("--kills", type=int, default=KILLS, help="kills per command")
    parser.add_argument("--only", nargs="+", default=[""], help="parts of the commands' names")
    asked = parser.parse_args()
    for name in _IMPORTS:
        import_module(name)
    print(f"{'command':22}{'kills':>7}{'amid a write':>14}{'torn':>6}{'left over':>11}{'other':>7}")
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        inputs = Path(name, "inputs")
        inputs.mkdir()
        for number, job in enumerate(jobs(inputs)):
            if not any(text in job.name for text in asked.only):
                continue
            root = Path(name, str(number))
            root.mkdir()
            c = count_damage(job, asked.kills, root)
            row = f"{job.name:22}{c.kills:7}{c.amid:14}{c.torn:6}{c.left:11}{c.other:7}"
            print(row, flush=True)
            bad += c.torn + c.left + c.other + (c.kills < asked.kills)
            shutil.rmtree(root)
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
