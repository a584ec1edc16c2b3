"""Remake docs/images/palette-6, -7, -volume and -vision: ``python -m tools.palette_volumes``.

The scenes data/scenes/figure-6, figure-7, figure-2 and colour-vision, each cast once and relit
under its lights: a contact sheet with the lights' spectra above the frames.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image

import volspec as vs
from benchmarks.scenes import ROOT, stored
from volspec.appearance.display.deficiency import DeficiencyName
from volspec.export import contact_sheet
from volspec.export.contact_sheet import SheetColumn

IMAGES = ROOT / "docs" / "images"
_BYTES, _QUALITY = 200_000, 92


@dataclass(frozen=True, slots=True)
class Sheet:
    """A picture: its scene, its rows, and the width of a frame."""

    scene: str
    file: str
    rows: Mapping[str, DeficiencyName]  # captions, and the deficiency that each simulates
    tile: int = 400


SHEETS = {
    "6": Sheet("figure-6", "palette-6", {"Three lights designed with three materials": "none"}),
    "7": Sheet("figure-7", "palette-7", {"From a light that hides to one that shows": "none"}, 300),
    "volume": Sheet("figure-2", "palette-volume", {"Daylight, and two lights that part": "none"}),
    "vision": Sheet(
        "colour-vision",
        "palette-vision",
        {"Normal vision": "none", "Deuteranope, simulated": "deutan"},
    ),
}


def main() -> None:
    """Make the sheets whose volumes are available."""
    parser = argparse.ArgumentParser(prog="python -m tools.palette_volumes", description=__doc__)
    parser.add_argument("--only", choices=SHEETS, nargs="+", default=list(SHEETS))
    parser.add_argument("--out", type=Path, default=IMAGES, metavar="FOLDER")
    options = parser.parse_args()
    for name in options.only:
        sheet = SHEETS[name]
        scene = vs.Scene.load(ROOT / "data" / "scenes" / f"{sheet.scene}.toml")
        try:
            volume = volume_of(scene)
        except FileNotFoundError as error:
            print(f"{sheet.file}: skipped, the picture stays: {error}", flush=True)
            continue
        path = options.out / f"{sheet.file}.jpg"
        print(f"{path}: {make(scene, volume, sheet, path) / 1000:.0f} kB", flush=True)


def volume_of(scene: vs.Scene) -> vs.Volume:
    """Return the scene's volume, from data/ or the folder of the larger volumes."""
    own = scene.folder / scene.file.volume.file
    return vs.load_volume(own) if own.exists() else stored(own.stem)()


def make(scene: vs.Scene, volume: vs.Volume, sheet: Sheet, path: Path) -> int:
    """Cast once, relight under every light, write a JPEG; return its size in bytes."""
    image = scene.render(volume)
    relit = scene.relight
    columns = []
    with vs.Relighter(image) as relighter:
        for light in scene.lights:
            frames = []
            for deficiency in sheet.rows.values():
                viewing = replace(relit.viewing, deficiency=deficiency)
                frames.append(relighter.frame(light.rig, replace(relit, viewing=viewing)))
            label = light.label if light.label != light.name else ""
            columns.append(SheetColumn(light.name, label, light.spectrum, frames))
    title = f"{scene.file.title} (cast once)"
    picture = Image.fromarray(contact_sheet(title, list(sheet.rows), columns, sheet.tile))
    for quality in range(_QUALITY, 40, -4):
        memory = io.BytesIO()
        picture.save(memory, "JPEG", quality=quality, subsampling=0, optimize=True)
        if memory.tell() <= _BYTES:
            break
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(memory.getvalue())
    return memory.tell()


if __name__ == "__main__":
    main()
