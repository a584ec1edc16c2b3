"""Pictures of the viewer's window: ``python -m tools.gallery.viewer``; needs Xvfb and xdotool.

Foot and head do not ship: without them (in ``$VOLSPEC_DATA`` or ``../shared/data``) their pictures
stay as they are.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from tests.support.window import Place, Robot

ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "docs" / "gallery"
VOLUMES = Path(os.environ.get("VOLSPEC_DATA", ROOT.parent / "shared" / "data"))
SIZE = (1280, 760)
# Position in the tabs at the lower right, next to the first row of the front tab.
TRANSFER, PALETTE, LIGHTING = (1054.0, 395.0), (1140.0, 395.0), (1205.0, 395.0)


def click(robot: Robot, where: str | Place) -> None:
    """Click, and wait for the result."""
    robot.click(where)
    robot.rest()


def keys(robot: Robot, *names: str) -> None:
    """Press keys, each after the response to the previous one."""
    for name in names:
        robot.key(name)
        robot.rest()


def command(robot: Robot, words: str) -> None:
    """Find a command in the command palette, and run it."""
    keys(robot, "ctrl+p")
    robot.rest()  # the field has the focus some frames later
    robot.type(words)
    keys(robot, "Return")


def blended(robot: Robot) -> None:
    """Lights mixed on the dial, the mouse over the picture."""
    x, y = robot.middle("dial")
    robot.drag([(x, y), (x + 6, y - 4), (x + 10, y - 6), (x + 14, y - 7)])
    robot.do("mousemove", 410.0, 240.0)


def compared(robot: Robot) -> None:
    """Daylight right of the divide, a sodium lamp left of it; the transfer function."""
    robot.do("mousemove", 410.0, 350.0)
    keys(robot, "b", "space", "space", "space")
    click(robot, TRANSFER)


def drawn(robot: Robot) -> None:
    """A light drawn with the mouse."""
    click(robot, "tab Spectrum")
    x, y, width, height = robot.area("spectrum")
    robot.drag([(x + s * width, y + height * (0.9 - 0.75 * abs(2 * s - 1) ** 2)) for s in SHARES])
    robot.do("mousemove", 480.0, 250.0)


SHARES = [i / 40 for i in range(1, 40)]


def grouped(robot: Robot) -> None:
    """A lamp and a blue sky, part by part, in the light theme."""
    keys(robot, "t")
    click(robot, "tab Light")
    robot.do("mousemove", 420.0, 240.0)


def wished(robot: Robot) -> None:
    """A target colour for one material under one light."""
    click(robot, PALETTE)
    click(robot, "cell 6")  # the inserts under the tungsten lamp
    x, y, width, height = robot.area("picker")
    robot.drag([(x + s * 0.7 * width, y + (0.6 - 0.4 * s) * height) for s in SHARES])


def regions(robot: Robot) -> None:
    """The foot, its boundaries separated by value and gradient."""
    click(robot, TRANSFER)
    command(robot, "muscle bone")
    keys(robot, "3", "4")
    command(robot, "regions")


def cropped(robot: Robot) -> None:
    """A head from the side, cut by a plane, with its slices."""
    keys(robot, "7", "4", "4", "p", "o")
    x, y = robot.middle("picture")
    robot.drag([(x, y), (x + 20, y - 10), (x + 40, y - 20), (x + 55, y - 30)])


def lit(robot: Robot) -> None:
    """A head under a tungsten lamp and a blue sky, both added with the mouse."""
    command(robot, "mr head")
    command(robot, "directional")
    command(robot, "add a sky")
    click(robot, LIGHTING)
    for index in (1, 0):  # the headlight and its ambient light
        click(robot, f"remove source {index}")
    for group, name in enumerate(("tungsten", "blue sky")):
        click(robot, f"group spectrum {group}")
        robot.type(name)
        keys(robot, "Return")
    x, y = robot.middle("light 0")
    robot.drag([(x + s * 150, y - s * 20) for s in SHARES])
    robot.do("mousemove", 1100.0, 760.0)


def erred(robot: Robot) -> None:
    """The error map of the channels."""
    keys(robot, "space", "space", "space", "e")


def commanded(robot: Robot) -> None:
    """The command palette."""
    keys(robot, "ctrl+p")
    robot.type("light")


def keyed(robot: Robot) -> None:
    """The list of keys."""
    keys(robot, "h")


PICTURES: dict[str, tuple[Path, Callable[[Robot], None]]] = {
    "viewer-1": (ROOT / "data/scenes/engine.toml", blended),
    "viewer-2": (ROOT / "data/scenes/engine.toml", compared),
    "viewer-3": (ROOT / "data/scenes/engine.toml", drawn),
    "viewer-4": (ROOT / "data/scenes/engine-groups.toml", grouped),
    "viewer-5": (ROOT / "data/scenes/engine.toml", wished),
    "viewer-6": (VOLUMES / "foot.nrrd", regions),
    "viewer-7": (VOLUMES / "mrbrain.nrrd", cropped),
    "viewer-8": (ROOT / "data/scenes/engine.toml", erred),
    "viewer-9": (ROOT / "data/scenes/engine-surfaces.toml", commanded),
    "viewer-10": (ROOT / "data/scenes/engine-cut.toml", keyed),
    "viewer-11": (VOLUMES / "mrbrain.nrrd", lit),
}


def main() -> None:
    """Write all pictures."""
    for name, (file, use) in PICTURES.items():
        if not file.exists():
            print(f"{name}: {file.name} is not here, left as it is")
            continue
        with tempfile.TemporaryDirectory() as folder:
            shot = Path(folder) / "screen.png"
            with Robot(Path(folder), [str(file)], SIZE) as robot:
                robot.whole()
                robot.rest()
                use(robot)
                robot.rest()
                # Wait until messages disappear, and the tooltip below the mouse appears.
                time.sleep(2.0)
                robot.rest()
                robot.grab(shot)
            # In full colour, as 256 palette entries would leave none for the swatches.
            Image.open(shot).convert("RGB").save(GALLERY / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
