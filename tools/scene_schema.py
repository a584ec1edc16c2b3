"""Write data/scenes/scene.schema.json anew: python -m tools.scene_schema."""

from __future__ import annotations

from volspec._files import write_whole
from volspec._gpu.sources import asset
from volspec.scene.schema import scene_schema_text

FILE = "data/scenes/scene.schema.json"


def main() -> None:
    with write_whole(asset(FILE)) as temporary:
        temporary.write_text(scene_schema_text(), encoding="utf-8")
    print(FILE)


if __name__ == "__main__":
    main()
