"""Drive the viewer in a display of its own with mouse and keys; its trace records the events.

Needs Xvfb, xdotool and xprop; to drop files python-xlib.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageGrab

from tests.support.patience import PATIENCE_S, wait_until

Row = dict[str, Any]
Place = tuple[float, float]
# Interval of the mouse's position reports.
MOUSE_S = 1 / 60
# The bundled scene, by its path: without one, the start screen would be over it.
ENGINE = str(Path(__file__).resolve().parents[2] / "data" / "scenes" / "engine.toml")
# A key that does nothing.
_MARK = "F12"
_TWICE = ("click", "--repeat", "2", "--delay", "60", "1")
_VIEW = "from volspec.cli import main; main()"
# Each document would start a process that compiles programs for some seconds.
_NOTHING_AHEAD = (
    "from volspec.viewer.work.precompile import ProgramBuilder; "
    "ProgramBuilder.request = lambda *_: None; "
)


def missing() -> str:
    """Return the programs that the machine lacks to run this; empty if none."""
    lacking = [name for name in ("Xvfb", "xdotool", "xprop") if shutil.which(name) is None]
    if not lacking:
        return ""
    return (
        f"{' and '.join(lacking)} missing; "
        "on Debian or Ubuntu: apt-get install xvfb xdotool x11-utils"
    )


def small_engine(folder: Path) -> Path:
    """Write the bundled scene downsampled by 2, for quicker casts; return its path."""
    data = Path(__file__).resolve().parents[2] / "data"
    text = (data / "scenes" / "engine.toml").read_text(encoding="utf-8")
    text = text.replace('"../', f'"{data}/').replace('.nrrd"', '.nrrd"\ndownsample = 2')
    (folder / "engine.toml").write_text(text, encoding="utf-8")
    return folder / "engine.toml"


class Robot:
    """The viewer under Xvfb, running in a folder that gets its trace; a context manager.

    Programs with its ``environment`` see the same screen. Without ``ahead``, it compiles no
    programs before they are needed.
    """

    def __init__(
        self,
        folder: Path,
        arguments: Sequence[str] = (ENGINE,),
        size: tuple[int, int] = (1280, 720),
        dpi: int = 96,
        ahead: bool = True,
    ) -> None:
        self.trace = folder / "trace.jsonl"
        self.trace.unlink(missing_ok=True)
        self.size = size
        self._rows: list[Row] = []
        self._read = self._first = 0
        width, height = size
        screen = f"{max(width, 1000)}x{max(height, 800)}x24"
        window = f"{width * 96 // dpi}x{height * 96 // dpi}"
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", screen, "-nolisten", "tcp", "-noreset"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self._server.stdout is not None
        self.environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("WAYLAND_DISPLAY", "XDG_SESSION_TYPE")
        }
        # Use its own settings, not the user's.
        self.environment.setdefault("VOLSPEC_STATE", str(folder / "state"))
        self.environment["XDG_PICTURES_DIR"] = str(folder)
        self.environment["DISPLAY"] = f":{self._server.stdout.readline().strip()}"
        if dpi != 96:
            given = ("-f", "RESOURCE_MANAGER", "8s", "-set", "RESOURCE_MANAGER", f"Xft.dpi: {dpi}")
            subprocess.run(["xprop", "-root", *given], env=self.environment, check=True)
        self.started = time.perf_counter()
        self.viewer = subprocess.Popen(
            [
                *(sys.executable, "-c", _VIEW if ahead else _NOTHING_AHEAD + _VIEW, "view"),
                *("--trace", str(self.trace), "--size", window, *arguments),
            ],
            env=self.environment | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])},
            cwd=folder,
            stderr=subprocess.PIPE,
            text=True,
        )

    def rows(self) -> list[Row]:
        """The trace so far, or since the last `begin`."""
        return self._all()[self._first :]

    def _all(self) -> list[Row]:
        if self.trace.exists():
            with self.trace.open("rb") as file:
                file.seek(self._read)
                new, line_end, _ = file.read().rpartition(b"\n")
            self._read += len(new) + len(line_end)
            self._rows += [json.loads(line) for line in new.splitlines()]
        return self._rows

    def begin(self) -> None:
        """Forget the trace so far."""
        self._first = len(self._all())

    def since(self, t: float, *events: str) -> list[Row]:
        """Return the rows after a time of the trace, of all events or of some."""
        rows = (row for row in self.rows() if row["t"] > t)
        return [row for row in rows if not events or row["event"] in events]

    def now(self) -> float:
        """The present as a time of the trace."""
        return time.perf_counter() - float(self._all()[0]["perf_counter"])

    def wait_for(self, wanted: Callable[[Row], bool], after: float = -1.0) -> Row:
        """Return the first wanted row after a time; TimeoutError, with the last rows, if none."""
        found: list[Row] = []

        def came() -> bool:
            found.extend(row for row in self.rows() if row["t"] > after and wanted(row))
            return bool(found)

        self.until(came)
        return found[0]

    def event(self, name: str, after: float = -1.0) -> Row:
        """Wait for the first event of a name after a time."""
        return self.wait_for(lambda row: row["event"] == name, after)

    def until(self, holds: Callable[[], object]) -> None:
        """Wait for a condition; TimeoutError, with the last rows, if the viewer ends before."""

        def done() -> bool:
            ended = self.viewer.poll() is not None
            if not (held := holds()) and ended:
                tail = [row for row in self.rows() if row["event"] not in ("frame", "layout")][-8:]
                said = self.viewer.stderr.read() if self.viewer.stderr else ""
                raise TimeoutError(f"the viewer did not; last: {tail}; {said}")
            return bool(held)

        wait_until(done, "the viewer did not")

    def ends(self) -> int:
        """Wait until the viewer has ended; return its exit code."""
        return self.viewer.wait(PATIENCE_S)

    def whole(self, after: float = -1.0) -> Row:
        """The first whole picture relit after a time."""
        return self.wait_for(lambda row: row["event"] == "relight" and row["whole"], after)

    def rest(self) -> float:
        """Wait until the viewer has answered all input and is idle; return the time."""
        after = self._all()[-1]["t"]
        self.key(_MARK)  # goes last through the window's queue
        marked = self.wait_for(lambda row: row.get("key") == _MARK.lower(), after)
        return float(self.event("rest", marked["t"])["t"])

    def areas(self) -> dict[str, tuple[int, int, int, int]]:
        """Return the last rectangles of all items: x, y, width, height."""
        found = next(row for row in reversed(self._all()) if row["event"] == "layout")
        return {name: tuple(area) for name, area in found["areas"].items()}

    def area(self, name: str) -> tuple[int, int, int, int]:
        """Return the last rectangle of an item."""
        return self.areas()[name]

    def at(self, name: str, across: float = 0.5, down: float = 0.5) -> Place:
        """Return a place in an item, in fractions of its sides."""
        x, y, width, height = self.area(name)
        return x + across * width, y + down * height

    def middle(self, name: str) -> Place:
        """Return the centre of an item."""
        return self.at(name)

    def do(self, *words: str | float) -> None:
        """Run xdotool with arguments."""
        whole = [str(round(word)) if isinstance(word, float) else str(word) for word in words]
        subprocess.run(["xdotool", *whole], env=self.environment, check=True)

    def find(self) -> str:
        """xdotool's number of the window."""
        command = ["xdotool", "search", "--pid", str(self.viewer.pid)]
        found = subprocess.run(
            command, env=self.environment, check=True, capture_output=True, text=True
        )
        return found.stdout.split()[-1]

    def resize(self, size: tuple[int, int]) -> None:
        """Resize the window, if it has another size."""
        if size != self.size:
            self.do("windowsize", "--sync", self.find(), *size)
            self.size = size

    def key(self, name: str) -> None:
        """Press a key."""
        self.do("key", name)

    def type(self, text: str) -> None:
        """Press the keys of a text, one after the other."""
        self.do("type", "--delay", "20", text)

    def click(self, *names: str | Place) -> None:
        """Go to places, or the middles of items, and press the left button at each."""
        for number, where in enumerate(names):
            if number:
                self.rest()
            x, y = self.middle(where) if isinstance(where, str) else where
            self.do("mousemove", x, y, "sleep", "0.1", "click", "1")

    def double_click(self, where: str | Place, done: Callable[[], object]) -> None:
        """Double-click an item, again where a frame in between took too long for one."""
        x, y = self.middle(where) if isinstance(where, str) else where

        def clicked() -> object:
            # Clicks within 0.3 s of those before would be the third and fourth of a series.
            self.do("mousemove", x, y, "sleep", "0.4", *_TWICE)
            self.rest()
            return done()

        self.until(clicked)

    def keys(self, *names: str) -> float:
        """Press keys, each when the viewer is idle; return when it is idle again."""
        for name in names:
            self.rest()
            self.key(name)
        return self.rest()

    def enter(self, text: str, *keys: str) -> float:
        """Type a text into what is open and press keys, by default Enter; return the time."""
        self.rest()
        self.type(text)
        return self.keys(*(keys or ("Return",)))

    def command(self, words: str) -> float:
        """Run a command from the list; return when the viewer is idle again."""
        self.keys("ctrl+p")
        return self.enter(words)

    def front(self, panel: str) -> None:
        """Close and open a panel, which brings it to the front."""
        for _ in range(2):
            self.click("menu Window", f"action panel-{panel}")
            self.rest()

    def open(self, path: Path) -> float:
        """Drop a file and wait until it is shown; return the time."""
        before = self.now()
        self.drop(path.as_uri())
        self.whole(self.event("open", before)["t"])
        return self.rest()

    def memory(self) -> int:
        """Return the bytes of RAM that the viewer uses.

        Read from a kernel counter, as adding up pages, like ``smaps``, would stall the viewer.
        """
        status = Path(f"/proc/{self.viewer.pid}/status").read_text(encoding="utf-8")
        (kilobytes,) = re.findall(r"^RssAnon:\s*(\d+) kB$", status, re.MULTILINE)
        return 1024 * int(kilobytes)

    def drag(self, places: Sequence[Place], button: int = 1) -> None:
        """Press at the first place, go along the others as a mouse does, release at the last."""
        words: list[str | float] = ["mousemove", float(places[0][0]), float(places[0][1])]
        words += ["sleep", "0.1", "mousedown", str(button)]
        for x, y in places[1:]:
            words += ["sleep", f"{MOUSE_S:.4f}", "mousemove", float(x), float(y)]
        self.do(*words, "mouseup", str(button))

    def steps(self, places: Sequence[Place], event: str) -> float:
        """Drag as `drag` does, but wait for an event after each move; return when it is idle."""
        self.do("mousemove", *map(float, places[0]), "sleep", "0.1", "mousedown", "1")
        for place in places[1:]:
            before = self.now()
            self.do("mousemove", *map(float, place))
            self.event(event, before)
        self.do("mouseup", "1")
        return self.rest()

    def drop(self, *uris: str, key: str = "") -> None:
        """Drag files, as ``file:///a/b%20c.npy``, from another program onto the picture.

        A key is pressed as they arrive.
        """
        from tests.support.drag_and_drop import drop

        x, y = self.middle("picture")
        drop(self.environment["DISPLAY"], int(self.find()), uris, (round(x), round(y)), key)

    def grab(self, path: Path) -> None:
        """Save a picture of the whole screen."""
        ImageGrab.grab(xdisplay=self.environment["DISPLAY"]).save(path)

    def pixels(self, area: str = "picture") -> NDArray[np.int16]:
        """Return the RGB of an item once the viewer is idle."""
        self.rest()
        return self.look(area)

    def look(self, area: str = "picture") -> NDArray[np.int16]:
        """Return the RGB of an item now."""
        x, y, width, height = self.area(area)
        box = x, y, x + width, y + height
        screen = ImageGrab.grab(box, xdisplay=self.environment["DISPLAY"])
        return np.asarray(screen.convert("RGB"), np.int16)

    def picture(self) -> NDArray[np.int16]:
        """Return the part of the picture below a message and above the values under the mouse."""
        whole = self.pixels()
        high = len(whole)
        return whole[high // 4 : high // 2, :-8]

    def saved(self, event: str, after: float) -> NDArray[np.int16]:
        """Wait for a picture's file; return its RGB."""
        with Image.open(self.event(event, after)["path"]) as image:
            return np.asarray(image.convert("RGB"), np.int16)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in (self.viewer, self._server):
            process.terminate()
            process.wait(PATIENCE_S)
            for stream in (process.stdout, process.stderr):
                if stream is not None:
                    stream.close()


def along(start: Place, end: Place, seconds: float) -> list[Place]:
    """Return a path to and fro between two places, once in two seconds."""
    count = max(2, round(seconds / MOUSE_S))
    shares = [0.5 - 0.5 * math.cos(math.pi * i * MOUSE_S) for i in range(count)]
    (x0, y0), (x1, y1) = start, end
    return [(x0 + s * (x1 - x0), y0 + s * (y1 - y0)) for s in shares]
