"""Drive the viewer in a display of its own with mouse and keys; its trace records the events.

Needs Xvfb, xdotool and xprop; to drop files python-xlib.
"""

from __future__ import annotations

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
from types import TracebackType
from typing import Any, Self

Row = dict[str, Any]
Place = tuple[float, float]
# Interval of the mouse's position reports.
MOUSE_S = 1 / 60
# The bundled scene, by its path: without one, the start screen would be over it.
ENGINE = str(Path(__file__).resolve().parents[2] / "data" / "scenes" / "engine.toml")
# A key that does nothing.
_MARK = "F12"


def missing() -> str:
    """Return the programs that the machine lacks to run this; empty if none."""
    lacking = [name for name in ("Xvfb", "xdotool", "xprop") if shutil.which(name) is None]
    if not lacking:
        return ""
    return (
        f"{' and '.join(lacking)} missing; "
        "on Debian or Ubuntu: apt-get install xvfb xdotool x11-utils"
    )


def small_engine(folder: Path) -> list[str]:
    """Write the bundled scene downsampled by 2, for quicker casts; return its name."""
    data = Path(__file__).resolve().parents[2] / "data"
    text = (data / "scenes" / "engine.toml").read_text(encoding="utf-8")
    text = text.replace('"../', f'"{data}/').replace('.nrrd"', '.nrrd"\ndownsample = 2')
    (folder / "engine.toml").write_text(text, encoding="utf-8")
    return ["engine.toml"]


class Robot:
    """The viewer under Xvfb, running in a folder that gets its trace; a context manager.

    Programs with its ``environment`` see the same screen.
    """

    def __init__(
        self,
        folder: Path,
        arguments: Sequence[str] = (ENGINE,),
        size: tuple[int, int] = (1280, 720),
        dpi: int = 96,
    ) -> None:
        self.folder, self.trace = folder, folder / "trace.jsonl"
        self._rows: list[Row] = []
        self._read = 0
        width, height = size
        screen = f"{width}x{height}x24"
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
        self.started = time.time()
        self.viewer = subprocess.Popen(
            [
                *(sys.executable, "-c", "from volspec.cli import main; main()", "view"),
                *("--trace", str(self.trace), "--size", window, *arguments),
            ],
            env=self.environment | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])},
            cwd=folder,
            stderr=subprocess.PIPE,
            text=True,
        )

    def rows(self) -> list[Row]:
        """The trace so far."""
        if self.trace.exists():
            with self.trace.open("rb") as file:
                file.seek(self._read)
                new, line_end, _ = file.read().rpartition(b"\n")
            self._read += len(new) + len(line_end)
            self._rows += [json.loads(line) for line in new.splitlines()]
        return self._rows

    def since(self, t: float) -> list[Row]:
        """Return the rows after a time of the trace."""
        return [row for row in self.rows() if row["t"] > t]

    def now(self) -> float:
        """The present as a time of the trace."""
        return time.time() - float(self.rows()[0]["unix"])

    def wait_for(
        self, wanted: Callable[[Row], bool], after: float = -1.0, seconds: float = 120
    ) -> Row:
        """Return the first wanted row after a time; TimeoutError, with the last rows, if none.

        A runtime that has no kernel in its cache compiles half a minute on a busy machine.
        """
        end = time.time() + seconds
        while time.time() < end:
            for row in self.rows():
                if row["t"] > after and wanted(row):
                    return row
            if self.viewer.poll() is not None:
                break
            time.sleep(0.02)
        tail = [row for row in self.rows() if row["event"] not in ("frame", "layout")][-8:]
        said = ""
        if self.viewer.poll() is not None and self.viewer.stderr is not None:
            said = self.viewer.stderr.read()
        raise TimeoutError(f"the viewer did not; last: {tail}; {said}")

    def until(self, holds: Callable[[], bool], seconds: float = 10) -> bool:
        """Return True as soon as a condition holds, False after so many seconds."""
        end = time.time() + seconds
        while not (held := holds()) and time.time() < end:
            time.sleep(0.05)
        return held

    def whole(self, after: float = -1.0) -> Row:
        """The first whole picture relit after a time."""
        return self.wait_for(lambda row: row["event"] == "relight" and row["whole"], after)

    def rest(self, seconds: float = 120) -> float:
        """Wait until the viewer has answered all input and is idle; return the time."""
        after = self.rows()[-1]["t"]
        self.key(_MARK)  # goes last through the window's queue
        marked = self.wait_for(lambda row: row.get("key") == _MARK.lower(), after, seconds)
        rested = self.wait_for(lambda row: row["event"] == "rest", marked["t"], seconds)
        return float(rested["t"])

    def area(self, name: str) -> tuple[int, int, int, int]:
        """Return the last rectangle of an item: x, y, width, height."""
        found = [row["areas"] for row in self.rows() if row["event"] == "layout"]
        x, y, width, height = found[-1][name]
        return x, y, width, height

    def middle(self, name: str) -> Place:
        """Return the centre of an item."""
        x, y, width, height = self.area(name)
        return x + width / 2, y + height / 2

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

    def key(self, name: str) -> None:
        """Press a key."""
        self.do("key", name)

    def type(self, text: str) -> None:
        """Press the keys of a text, one after the other."""
        self.do("type", "--delay", "20", text)

    def click(self, where: str | Place) -> None:
        """Go to a place, or the middle of an area, and press the left button."""
        x, y = self.middle(where) if isinstance(where, str) else where
        self.do("mousemove", x, y, "sleep", "0.1", "click", "1")

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

    def drop(self, *uris: str, key: str = "") -> None:
        """Drag files, as ``file:///a/b%20c.npy``, from another program onto the picture.

        A key is pressed as they arrive.
        """
        from tests.support.drag_and_drop import drop

        x, y = self.middle("picture")
        drop(self.environment["DISPLAY"], int(self.find()), uris, (round(x), round(y)), key)

    def grab(self, path: Path) -> None:
        """Save a picture of the whole screen."""
        from PIL import ImageGrab

        ImageGrab.grab(xdisplay=self.environment["DISPLAY"]).save(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in (self.viewer, self._server):
            process.terminate()
            process.wait(20)
            for stream in (process.stdout, process.stderr):
                if stream is not None:
                    stream.close()


def along(start: Place, end: Place, seconds: float) -> list[Place]:
    """Return a path to and fro between two places, once in two seconds."""
    count = max(2, round(seconds / MOUSE_S))
    shares = [0.5 - 0.5 * math.cos(math.pi * i * MOUSE_S) for i in range(count)]
    (x0, y0), (x1, y1) = start, end
    return [(x0 + s * (x1 - x0), y0 + s * (y1 - y0)) for s in shares]
