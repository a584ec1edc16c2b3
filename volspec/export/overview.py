"""Contact sheet of an export: one column per light, or a sample of the frames.

frames on disk -> [overview] -> sheet.png
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._exr import read_exr
from volspec.appearance.display import SPACES, Hdr, decode_sRGB, encode_sRGB
from volspec.errors import ImageError
from volspec.export.contact_sheet import (
    SheetColumn,
    SheetTile,
    comparison_sheet,
    contact_sheet,
    fitted_size,
)
from volspec.export.exr import PRIMARIES, white_adaptation
from volspec.export.frames import read_frame, write_frame
from volspec.export.plan import Plan
from volspec.scene import Scene
from volspec.scene.tables import ExportSpec

if TYPE_CHECKING:
    from PIL import Image

# Widths of the sheet and a tile in pixels; numbers of frames per light, in all, and per row.
_WIDTH, _TILE = 2600, 400
_ROWS, _FRAMES, _COLUMNS = 4, 24, 6
# Most lights whose spectra are legible in one row.
_SPECTRA = 10
# Chequers behind transparent frames: two greys, and the side of a square.
_CHEQUERS, _CHEQUER_SIDE = (104, 122), 16


def write_overview(
    path: Path, scene: Scene, plan: Plan, frames: Sequence[Path], table: ExportSpec
) -> None:
    """Write the sheet of a complete export, with frames in the plan's order.

    Up to ten lights with frames of their own become columns under their spectra; otherwise frames
    follow each other in rows.
    """
    title = scene.file.title or scene.path.stem
    times = plan.shots[-1].time_index + 1
    many = f"{len(frames)} frame{'s' if len(frames) > 1 else ''}"
    if plan.lights and len(plan.lights) <= _SPECTRA:
        tile = min(_TILE, _WIDTH // len(plan.lights))
        indices = _sample_indices(times, _ROWS)
        columns = [
            SheetColumn(
                light.name,
                light.label if light.label != light.name else "",
                light.spectrum,
                [read_picture(frames[i * times + index], tile, table) for index in indices],
            )
            for i, light in enumerate(plan.lights)
        ]
        rows = [f"frame {index}" if times > 1 else many for index in indices]
        sheet = contact_sheet(title, rows, columns, tile)
    else:
        tile = (_WIDTH - 100) // _COLUMNS
        at_most = _FRAMES if not plan.lights or times > 1 else len(frames)
        tiles = [
            SheetTile(
                plan.shots[i].light,
                f"frame {plan.shots[i].time_index}" if times > 1 else "",
                read_picture(frames[i], tile, table),
            )
            for i in _sample_indices(len(frames), at_most)
        ]
        sheet = comparison_sheet(f"{title}: {many}", tiles, _COLUMNS, tile)
    write_frame(path, sheet, {"Title": title})


def _sample_indices(count: int, maximum: int) -> list[int]:
    """Return evenly spaced indices, including the first and the last."""
    return sorted({round(i) for i in np.linspace(0, count - 1, min(count, maximum))})


def read_picture(path: Path, width: int, table: ExportSpec) -> NDArray[np.uint8]:
    """Read a frame as (H, W, 3) sRGB codes, no larger than a tile needs."""
    from PIL import Image

    if path.suffix == ".exr":
        picture = Image.fromarray(_linear_as_codes(path, 2 * width, table.primaries))
    else:
        picture = read_frame(path)
    needed = fitted_size(picture.size, 2 * width)
    if picture.size > needed:
        picture = picture.resize(needed, Image.Resampling.LANCZOS)
    if table.hdr is not None:
        picture = _hdr_as_codes(picture, table.hdr)
    if picture.mode == "RGBA":
        paper = Image.fromarray(_chequers(picture.size)).convert("RGBA")
        picture = Image.alpha_composite(paper, picture)
    return np.asarray(picture.convert("RGB"))


def _chequers(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the (H, W) greys of a chequerboard."""
    y, x = np.ogrid[: size[1], : size[0]]
    return np.array(_CHEQUERS, np.uint8)[(x // _CHEQUER_SIDE + y // _CHEQUER_SIDE) % 2]


def _hdr_as_codes(picture: Image.Image, hdr: Hdr) -> Image.Image:
    """Convert 8 bits of PQ or HLG to sRGB codes, in which white is the end."""
    from PIL import Image

    codes = np.asarray(picture)
    linear = hdr.luminances(codes[..., :3] / 255.0) / hdr.white_cd_m2
    matrix = SPACES["sRGB"].RGB_from_XYZ @ SPACES["Rec. 2020"].XYZ_from_RGB
    RGB = np.rint(encode_sRGB(linear @ matrix.T) * 255.0).astype(np.uint8)
    return Image.fromarray(np.dstack([RGB, codes[..., 3:]]))


def _linear_as_codes(path: Path, min_width: int, primaries: str) -> NDArray[np.uint8]:
    """Convert an EXR frame to sRGB codes, reduced to no less than a given width."""
    _, read = read_exr(path, ImageError)
    height, width = read["R"].shape
    n = max(1, min(width // min_width, height))
    channels = {name: _average_blocks(read[name], n) for name in "RGBA" if name in read}
    linear = np.stack([channels[name] for name in "RGB"], axis=-1)
    space, sRGB = PRIMARIES[primaries], SPACES["sRGB"]
    linear = linear @ (sRGB.RGB_from_XYZ @ white_adaptation(space, sRGB) @ space.XYZ_from_RGB).T
    if "A" in channels:
        height, width = linear.shape[:2]
        paper = decode_sRGB(_chequers((width, height)) / 255.0)[..., None]
        linear += (1.0 - channels["A"][..., None]) * paper
    return np.rint(encode_sRGB(linear) * 255).astype(np.uint8)


def _average_blocks(pixels: NDArray[Any], n: int) -> NDArray[np.float64]:
    """Return (H/n, W/n) float64 means of n × n pixels, row by row as the picture may be large."""
    height, width = (side // n for side in pixels.shape)
    rows = np.empty((height, width))
    for y in range(height):
        strip = pixels[y * n : (y + 1) * n, : width * n].astype(np.float64)
        rows[y] = strip.reshape(n, width, n).mean(axis=(0, 2))
    return rows
