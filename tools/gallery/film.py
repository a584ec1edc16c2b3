"""Make the films of docs/export.md: ``python -m tools.gallery.film``.

engine.toml -> export -> [film] -> docs/images/engine.mp4, engine-sweep.webp

Three seconds around the engine while one light fades into the next.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

from tools.gallery.studio import ROOT, engine_scene
from volspec.export.exporter import export

FOLDER = ROOT / "docs" / "images"
LIGHTS = ["D65", "A", "FL2", "HP1"]
FRAMES = 75
_SMALL, _BYTES = (480, 374), 900_000


def main() -> None:
    """Make the film, and a smaller animated picture that loops without a jump."""
    scene = engine_scene()
    turn = {"frames": FRAMES}
    film = FOLDER / "engine.mp4"
    export(
        scene,
        film,
        size=(720, 560),
        turntable=turn,
        sweep=turn,
        lights=LIGHTS,
        samples=2,
        overwrite=True,
    )
    print(f"{film.name}: {film.stat().st_size / 1000:.0f} kB")
    with tempfile.TemporaryDirectory() as folder:
        made = export(
            scene,
            *(Path(folder) / "frames",),
            size=_SMALL,
            turntable={"frames": FRAMES // 2},
            sweep={"closed": True},
            lights=LIGHTS,
            samples=2,
            sheet=False,
        )
        frames = [Image.open(made.output / name).convert("RGB") for name in made.files]
    save_loop(frames, FOLDER / "engine-sweep.webp", 80, _BYTES)


def save_loop(frames: list[Image.Image], path: Path, frame_ms: int, most_bytes: int) -> None:
    """Save frames as an animated WebP that loops, as good as its size permits."""
    for quality in range(90, 40, -5):
        frames[0].save(
            path,
            save_all=True,
            append_images=frames[1:],
            duration=frame_ms,
            loop=0,
            quality=quality,
            method=6,
        )
        if path.stat().st_size <= most_bytes:
            break
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
