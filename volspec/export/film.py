"""Encode finished frames as films, opaque or transparent, tagged with their colour space.

    frames on disk -> [film]

Players guess the colours of untagged films, so matrix, range, primaries and curve are converted
explicitly and tagged.

References
----------
[1] Recommendation ITU-T H.273: code points of primaries, transfer functions and matrices.
"""

from __future__ import annotations

import math
import subprocess
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from volspec._files import write_whole
from volspec.appearance.display import SPACES, ColourSpace
from volspec.errors import InputError, VolspecWarning
from volspec.export.ffmpeg import ffmpeg
from volspec.export.frames import read_frame
from volspec.scene.tables import ExportSpec

# ffmpeg's names of a space's primaries and curve; films in other spaces cannot be tagged.
_TAGS = {
    "sRGB": ("bt709", "iec61966-2-1"),
    "Display P3": ("smpte432", "iec61966-2-1"),
    "Rec. 709": ("bt709", "bt709"),
}
# Bytes must not depend on the machine's number of cores or its clock.
_THREADS = "4"
_BITEXACT = "-map_metadata -1 -fflags +bitexact -flags:v +bitexact"
# ffmpeg's words for an opaque film, and for a transparent one if the format can be.
_CODECS: Mapping[str, tuple[str, ...]] = {
    ".mp4": ("-c:v libx264 -preset medium -crf 16 -pix_fmt yuv420p -movflags +faststart",),
    ".webm": (
        "-c:v libvpx-vp9 -crf 22 -b:v 0 -pix_fmt yuv420p",
        "-c:v libvpx-vp9 -crf 22 -b:v 0 -pix_fmt yuva420p -auto-alt-ref 0",
    ),
    ".mov": (
        "-c:v prores_ks -profile:v 4444 -vendor apl0 -pix_fmt yuv444p10le",
        "-c:v prores_ks -profile:v 4444 -vendor apl0 -pix_fmt yuva444p10le",
    ),
    ".webp": (
        "-c:v libwebp_anim -lossless 1 -loop 0 -pix_fmt bgra",
        "-c:v libwebp_anim -lossless 1 -loop 0 -pix_fmt bgra",
    ),
    ".apng": (
        "-c:v apng -pred mixed -plays 0 -pix_fmt rgb24",
        "-c:v apng -pred mixed -plays 0 -pix_fmt rgba",
    ),
}
FILM_SUFFIXES = (*_CODECS, ".gif")
TRANSPARENT = tuple(suffix for suffix, words in _CODECS.items() if len(words) > 1)
_SRGB_ONLY = (".webp", ".apng", ".gif")
# Formats whose chroma is shared by four pixels, so that sides are even.
EVEN = (".mp4", ".webm")
# GIF counts in hundredths of a second, and players slow down frames shorter than two of them.
_GIF_TICKS, _MIN_TICKS, _MAX_TICKS = 100, 2, 2**16 - 1
# Numbers sampled from all frames together for a GIF's palette.
_PALETTE_NUMBERS = 3_000_000
Progress = Callable[[float], object]


def check_film(path: Path, table: ExportSpec, space: ColourSpace) -> None:
    """Refuse a film before its frames are made: unsuitable frames, colour space, or no ffmpeg."""
    if table.hdr is not None:
        raise InputError(
            f"{path}: films end at the display's white, but [export] requests hdr",
            "give a folder, or leave hdr out",
            code="conflict",
        )
    if table.format != "png" or table.bits != 8:
        file = f"{table.bits}-bit PNG" if table.format == "png" else f'format = "{table.format}"'
        raise InputError(
            f"{path}: films have 8-bit frames, but [export] requests {file}",
            "give a folder for these",
            code="conflict",
        )
    suffix = path.suffix.lower()
    if table.transparent and suffix not in TRANSPARENT:
        raise InputError(
            f"{path}: {suffix} has no opacity, but [export] requests transparent frames",
            f"name a film {', '.join(TRANSPARENT[:-1])} or {TRANSPARENT[-1]}, or a folder",
            code="conflict",
        )
    if suffix in _SRGB_ONLY and space != SPACES["sRGB"]:
        problem = f"{path}: {suffix} is sRGB, not {space.name!r}"
        raise InputError(problem, "name a film .mp4, .webm or .mov", code="unsupported")
    if not _is_tagged(space):
        raise InputError(
            f"{path}: films cannot be tagged with the display space {space.name!r}",
            f"use {', '.join(_TAGS)}, or give a folder",
            code="unsupported",
        )
    if suffix in _CODECS:
        ffmpeg()


def _is_tagged(space: ColourSpace) -> bool:
    return space.name in _TAGS and SPACES[space.name] == space


def write_film(
    path: Path, frames: Sequence[Path], fps: float, space: ColourSpace, progress: Progress
) -> None:
    """Encode PNG frames of equal size at a constant rate; the film appears when it is complete.

    It is transparent if they are. Odd sides of MP4 and WebM, which subsample chroma, get one more
    row or column.
    """
    suffix = path.suffix.lower()
    if suffix == ".gif":
        _write_gif(path, frames, fps, progress)
        return
    height, width, channels = _pixels(frames[0]).shape
    even = suffix in EVEN
    padded = width + even * (width % 2), height + even * (height % 2)
    if padded != (width, height):
        warnings.warn(
            f"{path}: {suffix[1:]} cannot have odd sides, {width}x{height}; the edge is repeated "
            f"once, {padded[0]}x{padded[1]}",
            VolspecWarning,
            stacklevel=3,
        )
    with write_whole(path) as temporary, tempfile.TemporaryFile() as log:
        command = [
            ffmpeg(),
            *f"-y -nostdin -loglevel error -threads {_THREADS}".split(),
            *f"-f rawvideo -pix_fmt rgb{'a' if channels == 4 else '24'}".split(),
            *f"-s {padded[0]}x{padded[1]} -framerate {fps:.9g} -i - -an".split(),
            *([] if suffix in _SRGB_ONLY else _filters(space)),
            *f"{_CODECS[suffix][channels == 4]} -threads {_THREADS} {_BITEXACT}".split(),
            *("-f", suffix[1:]),
            str(temporary),
        ]
        coder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log)
        assert coder.stdin is not None
        try:
            _feed(coder.stdin, frames, padded, suffix not in _SRGB_ONLY, progress)
        except BaseException:
            coder.kill()
            raise
        finally:
            with suppress(BrokenPipeError):
                coder.stdin.close()
            coder.wait()
        if coder.returncode != 0:
            log.seek(0)
            lines = log.read().decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise InputError(
                f"{path}: ffmpeg could not write it: {lines[-1]}",
                "the frames are kept, repeat the command",
                code="unwritable",
            )


def _feed(
    pipe: IO[bytes],
    frames: Sequence[Path],
    size: tuple[int, int],
    is_lossy: bool,
    progress: Progress,
) -> None:
    """Write frames to ffmpeg; if it ends early, its exit code shows that."""
    with suppress(BrokenPipeError):
        for i, frame in enumerate(frames, start=1):
            pixels = _fill_transparent(_pixels(frame)) if is_lossy else _pixels(frame)
            height, width = pixels.shape[:2]
            edges = ((0, size[1] - height), (0, size[0] - width), (0, 0))
            pipe.write(np.pad(pixels, edges, mode="edge").tobytes())
            progress(i / len(frames))


def _pixels(path: Path) -> NDArray[np.uint8]:
    picture = read_frame(path)
    return np.asarray(picture if picture.mode == "RGBA" else picture.convert("RGB"))


def _fill_transparent(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give transparent pixels the nearest colour: a codec would mix their black into edges."""
    from scipy.ndimage import distance_transform_edt

    if pixels.shape[2] == 3 or not pixels[..., 3].any():
        return pixels
    clear = pixels[..., 3] == 0
    near = distance_transform_edt(clear, return_distances=False, return_indices=True)
    return np.dstack([pixels[..., :3][tuple(near)], pixels[..., 3]])


def _write_gif(path: Path, frames: Sequence[Path], fps: float, progress: Progress) -> None:
    """Write a GIF with one palette for all frames; Pillow needs no ffmpeg for it."""
    from PIL import Image

    stride = math.ceil(math.sqrt(_pixels(frames[0]).size * len(frames) / _PALETTE_NUMBERS))
    sampled = [_pixels(frame)[::stride, ::stride].reshape(-1, 3) for frame in frames]
    colours = Image.fromarray(np.concatenate(sampled)[None])
    palette = colours.quantize(256, Image.Quantize.MEDIANCUT)

    def indexed() -> Iterator[Image.Image]:
        for i, frame in enumerate(frames, start=1):
            picture = read_frame(frame).convert("RGB")
            yield picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
            progress(i / len(frames))

    pictures, ms = indexed(), 10 * _gif_ticks(path, fps)
    with write_whole(path) as temporary:
        next(pictures).save(
            temporary, "GIF", save_all=True, append_images=pictures, duration=ms, loop=0
        )


def _gif_ticks(path: Path, fps: float) -> int:
    """Return the time of a frame in hundredths of a second, as GIF counts it."""
    ticks = min(max(_MIN_TICKS, round(_GIF_TICKS / fps)), _MAX_TICKS)
    rate = _GIF_TICKS / ticks
    if abs(rate - fps) > 1e-6 * fps:
        warnings.warn(
            f"{path}: plays at {rate:.4g} frames a second instead of {fps:g}, the nearest "
            "that a GIF can have; give .mp4 for others",
            VolspecWarning,
            stacklevel=5,
        )
    return ticks


def _filters(space: ColourSpace) -> list[str]:
    primaries, curve = _TAGS[space.name]
    convert = (
        "scale=in_range=pc:out_range=tv:out_color_matrix=bt709:flags=accurate_rnd+full_chroma_int"
    )
    tags = f"setparams=range=tv:colorspace=bt709:color_primaries={primaries}:color_trc={curve}"
    named = ("-colorspace", "bt709", "-color_primaries", primaries, "-color_trc", curve)
    return ["-vf", f"{convert},{tags}", *named, "-color_range", "tv"]
