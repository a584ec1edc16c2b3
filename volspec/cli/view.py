"""``volspec view``: the interactive viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from volspec._files import require_writable
from volspec.cli.kinds import RELIGHT, require_scene
from volspec.cli.shell import Device, app
from volspec.cli.size import Size, Sized, sides
from volspec.errors import InputError


@app.command
def view(
    file: str | None = None,
    /,
    *,
    size: Annotated[str, Sized] = "1280x720",
    screenshot: Size = None,
    restore: bool = False,
    trace: Path | None = None,
    device: Device = None,
) -> None:
    """Look at a scene or a volume, and swap its lights; H shows the keys.

    Example: `volspec view`

    Example: `volspec view engine.toml --screenshot 3840x2160`

    Example: `volspec view --restore`

    Parameters
    ----------
    file
        A scene file, a volume (file or folder) or a session; the bundled engine when left out.
    size
        WIDTHxHEIGHT of the window.
    screenshot
        WIDTHxHEIGHT of the pictures that S saves; as shown when left out.
    restore
        Go on from the last session; without one FILE is opened, or the file that was open last.
    trace
        Write what happens to a file of JSON lines: `t`, `event`, `stage`, `ms`.
    """
    if trace is not None:
        require_writable(trace)
    # Before a window opens for nothing.
    if file is not None and not Path(file.partition("?")[0]).exists():
        raise InputError(
            f"{file.partition('?')[0]}: no such file; check the path", code="not-found"
        )
    if file is not None:
        require_scene(
            Path(file), "the viewer casts its scene itself: volspec view SCENE.toml; or " + RELIGHT
        )
    from volspec.viewer.app import Options
    from volspec.viewer.app import view as open_window

    wanted = _sides("--screenshot", screenshot) if screenshot else None
    open_window(Options(file, trace, _sides("--size", size), wanted, device, restore))


def _sides(option: str, given: str) -> tuple[int, int]:
    """Width and height, as far as there are pictures."""
    from volspec.raycast.checks import MAX_SIDE

    both = sides(given)
    if max(both) > MAX_SIDE:
        raise InputError(f"{option} {given}: a side is too long; give at most {MAX_SIDE}")
    return both
