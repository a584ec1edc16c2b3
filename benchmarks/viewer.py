"""Is the viewer quick enough for interaction? ``python -m benchmarks.viewer [WIDTH HEIGHT]``.

Figures come from the viewer's trace while a robot drags a light's slider and the picture.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import volspec as vs
from benchmarks.measure import Figure, report
from tests.support.window import ENGINE, Robot, along, missing

# Seconds of each drag.
DRAG_S = 5.0
# And between turns.
PAUSES_S = 2.5, 0.3, 0.8, 1.5
# After which programs are built ahead: up to seven, of up to four seconds each.
AHEAD_S = 40.0


def figures(size: tuple[int, int] = (1280, 720)) -> Iterator[Figure]:
    """Time the start, drags of a light, of the view, a paint and an opacity; the bundled engine."""
    if why := missing():
        yield Figure("viewer", None, note=why)
        return
    with tempfile.TemporaryDirectory() as folder, Robot(Path(folder), size=size) as robot:
        yield _start(robot)
        time.sleep(1.0)
        yield from _light(robot)
        time.sleep(1.0)
        yield from _orbit(robot)
    with (
        cold_caches(),
        tempfile.TemporaryDirectory() as folder,
        Robot(Path(folder), size=size) as robot,
    ):
        yield from _lamps(robot)
    scene = str(Path(ENGINE).with_name("engine-room.toml"))
    with tempfile.TemporaryDirectory() as folder, Robot(Path(folder), [scene], size) as robot:
        robot.whole()
        robot.rest()
        yield from _paint(robot)
    with tempfile.TemporaryDirectory() as folder, Robot(Path(folder), size=size) as robot:
        robot.whole()
        yield from _faded(robot)
    with tempfile.TemporaryDirectory() as folder:
        series = _series(Path(folder))
        with Robot(Path(folder), [str(series)], size) as robot:
            robot.whole()
            robot.rest()
            yield from _played(robot)


def _series(folder: Path) -> Path:
    """Write 20 steps of 128³ voxels, the engine that moves through itself; return their file."""
    import SimpleITK

    engine = vs.load_volume("engine").values[::2, ::2, ::2]
    still = np.zeros((128, 128, 128), np.uint8)
    still[: engine.shape[0], : engine.shape[1], : engine.shape[2]] = engine[:128, :128, :128]
    steps = [np.roll(still, 3 * k, axis=0) for k in range(20)]
    image = SimpleITK.JoinSeries([SimpleITK.GetImageFromArray(step) for step in steps])
    SimpleITK.WriteImage(image, folder / "moving.nrrd")
    return folder / "moving.nrrd"


def _played(robot: Robot) -> Iterator[Figure]:
    """Drag a light while 20 time steps play."""
    time.sleep(AHEAD_S / 2)  # few programs
    robot.key("j")
    time.sleep(3.0)  # every step has been shown, and the casts have found their size
    x, y, width, height = robot.area("weight 1")
    start, end = (x + 4, y + height / 2), (x + width - 4, y + height / 2)
    pressed, released = _drag(robot, along(start, end, DRAG_S))
    rows = [row for row in robot.since(pressed) if row["t"] <= released]
    frames = sum(row["stage"] == "frame" for row in rows) / (released - pressed)
    yield Figure("viewer/light dragged while steps play, frames a second", frames, 15.0, unit="/s")
    casts = [row for row in rows if row["event"] == "cast"]
    coarse = max(row["divisor"] for row in casts)
    name = f"viewer/time steps of 128³ a second, at 1/{coarse} of the sides"
    yield Figure(name, len(casts) / (released - pressed), 5.0, unit="/s")


def _start(robot: Robot) -> Figure:
    whole = robot.whole()
    seconds = robot.rows()[0]["perf_counter"] + whole["t"] - robot.started
    return Figure("viewer/start to first whole picture", seconds, 4.0, at_most=True, unit="s")


def _light(robot: Robot) -> Iterator[Figure]:
    x, y, width, height = robot.area("weight 1")
    start, end = (x + 4, y + height / 2), (x + width - 4, y + height / 2)
    yield from _relit(robot, "light", along(start, end, DRAG_S))


@contextmanager
def cold_caches() -> Iterator[None]:
    """Set empty caches of compiled programs, PoCL's and pyopencl's, for programs started within."""
    names = "POCL_CACHE_DIR", "XDG_CACHE_HOME"
    kept = {name: os.environ.get(name) for name in names}
    # A child that still builds may write to them.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.environ |= {name: str(Path(folder, name)) for name in names}
        try:
            yield
        finally:
            for name, value in kept.items():
                del os.environ[name]
                if value is not None:
                    os.environ[name] = value


def _lamps(robot: Robot) -> Iterator[Figure]:
    """Add a lamp and switch its shadows, the first time on this machine, programs built ahead."""
    robot.whole()
    time.sleep(AHEAD_S)
    longest = 0.0
    remove = "remove the chosen light source"
    for words in ("add a directional light", "shadows", "shadows", remove):
        robot.key("ctrl+p")
        robot.rest()
        robot.type(words)
        robot.rest()
        before = robot.now()
        robot.key("Return")
        asked = robot.wait_for(lambda row: row.get("key") == "enter", before)["t"]
        seen = robot.wait_for(lambda row: row["event"] == "relight", asked)["t"]
        longest = max(longest, seen - asked)
        robot.rest()
    name = "viewer/lamp added or switched, longest wait"
    yield Figure(name, 1e3 * longest, 250.0, at_most=True, unit="ms")


def _paint(robot: Robot) -> Iterator[Figure]:
    robot.click("paint walls")
    robot.rest()
    x, y, width, height = robot.area("paint picker")
    start, end = (x + 10, y + 20), (x + 0.7 * width, y + 0.3 * height)
    yield from _relit(robot, "wall paint", along(start, end, DRAG_S))


def _faded(robot: Robot) -> Iterator[Figure]:
    for _ in range(2):  # closed and opened, the panel comes to the front
        for name in ("menu Window", "action panel-opacity"):
            robot.click(name)
            robot.rest()
    robot.click("opacity eye inserts")  # the first change makes the materials channels
    robot.rest()
    x, y, width, height = robot.area("opacity block")
    start, end = (x + 0.9 * width, y + height / 2), (x + 0.1 * width, y + height / 2)
    yield from _relit(robot, "opacity", along(start, end, DRAG_S))
    yield from _turned(robot)


def _turned(robot: Robot) -> Iterator[Figure]:
    """Turn by a few degrees after pauses in which layers are cast, packed, and ready."""
    x, y = robot.middle("picture")
    firsts, others = [], []
    for pause in (*PAUSES_S, *PAUSES_S):
        time.sleep(pause)
        pressed, released = _drag(robot, along((x, y), (x + 12, y), 0.4))
        rows = [row for row in robot.since(pressed) if row["t"] <= released + 0.1]
        times = [row["ms"] for row in rows if row["event"] == "reproject"]
        firsts += times[:1]
        others += times[1:]
    for name, times in (("first picture of a turn", firsts), ("next ones", others)):
        title = f"viewer/{name} by layers"
        yield Figure(f"{title}, median", float(np.median(times)), 30.0, at_most=True, unit="ms")
        yield Figure(f"{title}, longest", max(times), unit="ms")


def _relit(robot: Robot, what: str, places: list[tuple[float, float]]) -> Iterator[Figure]:
    """Drag what needs no cast."""
    pressed, released = _drag(robot, places)
    rows = [row for row in robot.since(pressed) if row["t"] <= released]
    frames = sum(row["stage"] == "frame" for row in rows)
    casts = sum(row["stage"] == "cast" for row in rows)
    rate = frames / (released - pressed)
    yield Figure(f"viewer/{what} dragged, frames a second", rate, 30.0, unit="/s")
    yield Figure(f"viewer/{what} dragged, casts", float(casts), 0.0, at_most=True, unit="")


def _orbit(robot: Robot) -> Iterator[Figure]:
    x, y = robot.middle("picture")
    pressed, released = _drag(robot, along((x - 150, y - 60), (x + 150, y + 60), DRAG_S))
    whole = robot.whole(released)
    rows = [row for row in robot.since(pressed) if row["t"] <= released]
    rate = sum(row["event"] == "relight" for row in rows) / (released - pressed)
    yield Figure("viewer/view dragged, new pictures a second", rate, 12.0, unit="/s")
    refined = whole["t"] - released
    yield Figure("viewer/whole after release", refined, 0.6, at_most=True, unit="s")


def _drag(robot: Robot, places: list[tuple[float, float]]) -> tuple[float, float]:
    """Drag; return the times of press and release."""
    before = robot.now()
    robot.drag(places)
    pressed = robot.wait_for(lambda row: row["event"] == "press", before)["t"]
    return pressed, robot.wait_for(lambda row: row["event"] == "release", pressed)["t"]


if __name__ == "__main__":
    sides = [int(argument) for argument in sys.argv[1:3]] or (1280, 720)
    print(report(list(figures((sides[0], sides[1])))))
