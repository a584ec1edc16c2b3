"""Make docs/images/room.jpg: ``python -m tools.gallery.rooms``.

data/rooms -> [rooms] -> the room as a camera for daylight takes it, and as an adapted eye sees it
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image

from tools.gallery.studio import ROOT
from volspec.appearance import Viewing
from volspec.room import default_eye, load_room, look, room_picture, solve_room

SIZE = 720, 540
PICTURE = ROOT / "docs" / "images" / "room.jpg"


def main() -> None:
    """Write the pair."""
    solved = solve_room(load_room(ROOT / "data" / "rooms" / "beige-tungsten.toml"), 8000)
    eye = default_eye(solved.room)
    adapted = look(solved, eye)
    camera = replace(adapted, viewing=Viewing(model="none"))
    pair = [room_picture(solved, eye, each, SIZE) for each in (camera, adapted)]
    codes = np.rint(255.0 * np.concatenate(pair, axis=1)).astype(np.uint8)
    Image.fromarray(codes).save(PICTURE, quality=90)
    print(PICTURE)


if __name__ == "__main__":
    main()
