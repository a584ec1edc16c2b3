"""The contact sheet of an export: every light, or every so many frames.

frames on disk -> [overview] -> sheet.png
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._exr import read_exr
from volspec.appearance.spaces import SPACES
from volspec.appearance.srgb import decode, encode
from volspec.errors import ImageError
from volspec.export.comparison import Seen, comparison_sheet
from volspec.export.frames import read_frame, write_frame
from volspec.export.plan import Plan
from volspec.export.primaries import PRIMARIES, XYZ_adapted
from volspec.export.sheet import SheetColumn, contact_sheet, fitted
from volspec.scene import NamedLight, Scene

# Of the whole sheet, pixels; and frames that it shows of each light, or of one row after another.
_WIDTH, _TILE = 2600, 400
_ROWS, _FRAMES, _COLUMNS = 4, 24, 6
# Lights whose spectra can still be told apart beside each other.
_SPECTRA = 10
# Chequers behind what is transparent: two greys, and the side of one of them.
_PAPERS, _CHEQUER = (104, 122), 16
# About how wide a letter of titles, names and labels is, pixels.
_TITLE_LETTER, _NAME_LETTER, _LABEL_LETTER = 17, 14, 9
# Letters below which a label says nothing.
_LEAST_LABEL = 4


def write_overview(
    path: Path, scene: Scene, plan: Plan, frames: Sequence[Path], primaries: str = "Rec. 709"
) -> None:
    """Write the sheet of frames that are all there.

    Lights with frames of their own are columns under their spectra; where they are many, or
    every frame has a mix, the frames follow each other in rows.

    Parameters
    ----------
    path : Path
        Of the sheet.
    scene : Scene
    plan : Plan
    frames : sequence of Path
        In the plan's order.
    primaries : str
        Of EXR frames.
    """
    title = printable(scene.file.title or scene.path.stem)
    moments = plan.shots[-1].moment + 1
    many = f"{len(frames)} frame{'s' if len(frames) > 1 else ''}"
    if plan.lights and len(plan.lights) <= _SPECTRA:
        tile = min(_TILE, _WIDTH // len(plan.lights))
        shown = _spread(moments, _ROWS)
        columns = [
            SheetColumn(
                *_captions(light, tile),
                light.spectrum,
                [opened(frames[i * moments + at], tile, primaries) for at in shown],
            )
            for i, light in enumerate(plan.lights)
        ]
        title = printable(title, len(columns) * tile // _TITLE_LETTER)
        rows = [f"frame {at}" if moments > 1 else many for at in shown]
        sheet = contact_sheet(title, rows, columns, tile)
    else:
        tile = (_WIDTH - 100) // _COLUMNS
        at_most = _FRAMES if not plan.lights or moments > 1 else len(frames)
        seen = [
            Seen(
                printable(plan.shots[i].light, 28),
                f"frame {plan.shots[i].moment}" if moments > 1 else "",
                opened(frames[i], tile, primaries),
            )
            for i in _spread(len(frames), at_most)
        ]
        sheet = comparison_sheet(f"{title}: {many}", seen, _COLUMNS, tile)
    write_frame(path, sheet, {"Title": title})


def _captions(light: NamedLight, width: int) -> tuple[str, str]:
    """A light's name and label, as much as there is room for."""
    name = printable(light.name, width // _NAME_LETTER)
    room = (width - len(name) * _NAME_LETTER) // _LABEL_LETTER
    label = light.label if light.label != light.name else ""
    return name, printable(label, room) if room > _LEAST_LABEL else ""


def _spread(count: int, most: int) -> list[int]:
    """Some of many, the first and the last among them."""
    return sorted({round(i) for i in np.linspace(0, count - 1, min(count, most))})


def opened(path: Path, width: int, primaries: str) -> NDArray[np.uint8]:
    """(H, W, 3) a frame's picture, no larger than needed; linear ones as sRGB."""
    from PIL import Image

    if path.suffix == ".exr":
        picture = Image.fromarray(_linear_as_codes(path, 2 * width, primaries))
    else:
        picture = read_frame(path)
    needed = fitted(picture.size, 2 * width)
    if picture.size > needed:
        picture = picture.resize(needed, Image.Resampling.LANCZOS)
    if picture.mode == "RGBA":
        paper = Image.fromarray(_chequers(picture.size)).convert("RGBA")
        picture = Image.alpha_composite(paper, picture)
    return np.asarray(picture.convert("RGB"))


def _chequers(size: tuple[int, int]) -> NDArray[np.uint8]:
    """(H, W) greys."""
    y, x = np.ogrid[: size[1], : size[0]]
    return np.array(_PAPERS, np.uint8)[(x // _CHEQUER + y // _CHEQUER) % 2]


def _linear_as_codes(path: Path, least: int, primaries: str) -> NDArray[np.uint8]:
    """What an EXR frame looks like on an sRGB display; reduced, but wider than so many pixels."""
    _, read = read_exr(path, ImageError)
    height, width = read["R"].shape
    n = max(1, min(width // least, height))
    channels = {name: _reduced(read[name], n) for name in "RGBA" if name in read}
    linear = np.stack([channels[name] for name in "RGB"], axis=-1)
    space, shown = PRIMARIES[primaries], SPACES["sRGB"]
    linear = linear @ (shown.RGB_from_XYZ @ XYZ_adapted(space, shown) @ space.XYZ_from_RGB).T
    if "A" in channels:
        height, width = linear.shape[:2]
        paper = decode(_chequers((width, height)) / 255.0)[..., None]
        linear += (1.0 - channels["A"][..., None]) * paper
    return np.rint(encode(linear) * 255).astype(np.uint8)


def _reduced(pixels: NDArray[Any], n: int) -> NDArray[np.float64]:
    """(H/n, W/n) float64: means of n × n pixels, row by row since the whole may be large."""
    height, width = (side // n for side in pixels.shape)
    rows = np.empty((height, width))
    for y in range(height):
        own = pixels[y * n : (y + 1) * n, : width * n].astype(np.float64)
        rows[y] = own.reshape(n, width, n).mean(axis=(0, 2))
    return rows


def printable(text: str, most: int = 60) -> str:
    """Text for one line of a picture: no marks that turn its direction, no breaks; cut.

    >>> printable("a\\u202eb\\nc"), printable("x" * 9, 4)
    ('ab c', 'xxx…')
    """
    kept = (c for c in " ".join(text.split()) if unicodedata.category(c) not in ("Cf", "Cc", "Cs"))
    line = "".join(kept)
    return line if len(line) <= most else f"{line[: most - 1]}…"
