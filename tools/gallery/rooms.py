"""Make docs/images/room.jpg and rooms.jpg: ``python -m tools.gallery.rooms``.

data/rooms -> [rooms] -> the room as a camera for daylight takes it, and as an adapted eye sees it
data/scenes/engine-room.toml -> [rooms] -> the engine in three rooms, under two lamps
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image

from tools.gallery.studio import ROOT
from volspec.appearance import Viewing
from volspec.export.contact_sheet import SheetTile, comparison_sheet
from volspec.relight import Relighter
from volspec.room import default_eye, load_room, look, room_picture, solve_room
from volspec.scene import Scene

SIZE, TILE = (720, 540), (800, 640)
IMAGES = ROOT / "docs" / "images"
PAINTS = {"beige": "#f0d9b5", "salmon": "#f4b8a0", "yellowish green": "#dfe3a8"}
LAMPS = {"D65": "daylight", "planck:2850": "tungsten"}


def main() -> None:
    """Write the pair and the sheet."""
    save(np.concatenate(before_and_after(), axis=1), "room.jpg")
    save(three_rooms(), "rooms.jpg")


def save(codes: np.ndarray, name: str) -> None:
    """Write a picture, and say so."""
    Image.fromarray(codes).save(IMAGES / name, quality=90)
    print(IMAGES / name)


def before_and_after() -> list[np.ndarray]:
    """Return the beige room without and with an adapted eye."""
    solved = solve_room(load_room(ROOT / "data" / "rooms" / "beige-tungsten.toml"), 8000)
    eye = default_eye(solved.room)
    adapted = look(solved, eye)
    camera = replace(adapted, viewing=Viewing(model="none"))
    pair = [room_picture(solved, eye, each, SIZE) for each in (camera, adapted)]
    return [np.rint(255.0 * each).astype(np.uint8) for each in pair]


def three_rooms() -> np.ndarray:
    """Return the sheet: a column for each paint, a row for each lamp."""
    file = Scene.load(ROOT / "data" / "scenes" / "engine-room.toml").file
    assert file.room is not None
    lights = tuple(
        replace(file.light[0], name=label, label=None, spectrum=lamp)
        for lamp, label in LAMPS.items()
    )
    camera = replace(file.camera, zoom=0.95)
    frames: dict[tuple[str, str], np.ndarray] = {}
    for paint, colour in PAINTS.items():
        room = replace(file.room, paint={"walls": colour}, patches=4000)
        scene = Scene(
            replace(file, room=room, light=lights, camera=camera),
            ROOT / "data" / "scenes" / "engine-room.toml",
        )
        with Relighter(scene.render(size=(2 * TILE[0], 2 * TILE[1]))) as relighter:
            for light in scene.lights:
                frames[light.name, paint] = relighter.frame(light.rig, scene.relight)
    tiles = [
        SheetTile(f"{paint} walls", f"{label} lamp", frames[label, paint])
        for label in LAMPS.values()
        for paint in PAINTS
    ]
    return comparison_sheet("One engine, one cast per room, two lamps", tiles, columns=3, tile=420)


if __name__ == "__main__":
    main()
