"""Films from finished frames: MP4, WebM or GIF, their colours told, whole or not at all.

    frames on disk -> [film]

Players guess what a film's numbers mean unless it says so: matrix, range, primaries and curve are
converted to and tagged as what they are.

References
----------
[1] Recommendation ITU-T H.273: code points of primaries, transfer functions and matrices.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from volspec._files import write_whole
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.errors import DeviceError, InputError, VolspecWarning, quoted
from volspec.export.frames import read_frame
from volspec.scene.export import ExportTable

SUFFIXES = (".mp4", ".webm", ".gif")
# ffmpeg's names of a space's primaries and curve; others cannot be told to a player.
_TAGS = {
    "sRGB": ("bt709", "iec61966-2-1"),
    "Display P3": ("smpte432", "iec61966-2-1"),
    "Rec. 709": ("bt709", "bt709"),
}
# Bytes must not follow from the machine's cores, nor from its clock.
_THREADS = "4"
_BITEXACT = ("-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact")
_CODECS = {
    ".mp4": (
        *("-c:v", "libx264", "-preset", "medium", "-crf", "16", "-pix_fmt", "yuv420p"),
        *("-movflags", "+faststart"),
    ),
    ".webm": ("-c:v", "libvpx-vp9", "-crf", "22", "-b:v", "0", "-pix_fmt", "yuv420p"),
    ".gif": ("-loop", "0"),
}
# GIF counts hundredths of a second, and players slow down what is shorter than two.
_GIF_TICKS, _LEAST_TICKS = 100, 2
# What names another ffmpeg than imageio-ffmpeg's, and how long it may take to say its version.
_VARIABLE, _PATIENCE_S = "IMAGEIO_FFMPEG_EXE", 20.0
Progress = Callable[[float], object]


def check_film(path: Path, table: ExportTable, space: ColourSpace) -> None:
    """Refuse a film that cannot be made, before its frames are.

    Raises
    ------
    InputError
        If the frames are of no film.
    DeviceError
        If there is no ffmpeg.
    """
    if table.format != "png" or table.transparent or table.bits != 8:
        file = f"{table.bits}-bit PNG" if table.format == "png" else f'format = "{table.format}"'
        what = "transparent ones" if table.transparent else file
        raise InputError(
            f"{path}: films have opaque 8-bit frames, [export] asks for {what}; name a folder to "
            "have those"
        )
    if path.suffix.lower() != ".gif" and not _is_tagged(space):
        raise InputError(
            f"{path}: display space {space.name!r} cannot be told to a player; take "
            f"{', '.join(_TAGS)}, or name a folder"
        )
    if path.suffix.lower() == ".gif" and space != SPACES["sRGB"]:
        raise InputError(f"{path}: GIF is sRGB, the display is {space.name!r}; take .mp4")
    ffmpeg()


def _is_tagged(space: ColourSpace) -> bool:
    return space.name in _TAGS and SPACES[space.name] == space


def ffmpeg() -> str:
    """The program that encodes films.

    Raises
    ------
    DeviceError
        If there is none, or what ``IMAGEIO_FFMPEG_EXE`` names is none.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        found = str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise DeviceError(
            "export: films need ffmpeg, which is not here; pip install 'volspec[video]'",
            code="unsupported",
        ) from error
    if os.environ.get(_VARIABLE) and not _is_ffmpeg(found):
        raise DeviceError(
            f"export: films need ffmpeg, and {_VARIABLE} is {quoted(found)}, which is none that "
            "runs; mend or unset the variable"
        )
    return found


def _is_ffmpeg(program: str) -> bool:
    """Whether a program says so; what a variable names, imageio-ffmpeg takes unseen."""
    command = [program, "-version"]
    try:
        said = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PATIENCE_S, check=True
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return False
    return said.stdout.startswith(b"ffmpeg")


def write_film(
    path: Path, frames: Sequence[Path], fps: float, space: ColourSpace, progress: Progress
) -> None:
    """Encode frames at a constant rate; the film appears when it is done.

    Sides that are odd get one row or column more, as MP4 and WebM keep colours for pairs.

    Parameters
    ----------
    path : Path
        ``.mp4``, ``.webm`` or ``.gif``.
    frames : sequence of Path
        PNG files of one size, in order.
    fps : float
        Frames a second.
    space : ColourSpace
        What their codes are of.
    progress : callable
        Called with the finished share, 0…1.

    Raises
    ------
    InputError
        If the film cannot be written.
    DeviceError
        If there is no ffmpeg.
    """
    suffix = path.suffix.lower()
    first = _pixels(frames[0])
    height, width = first.shape[:2]
    padded = (width, height) if suffix == ".gif" else (width + width % 2, height + height % 2)
    if padded != (width, height):
        warnings.warn(
            f"{path}: {width}x{height} has odd sides, which {suffix[1:]} cannot have; its edge is "
            f"repeated once, {padded[0]}x{padded[1]}",
            VolspecWarning,
            stacklevel=3,
        )
    with write_whole(path) as temporary, tempfile.TemporaryFile() as said:
        command = [
            *(ffmpeg(), "-y", "-nostdin", "-loglevel", "error", "-threads", _THREADS),
            *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{padded[0]}x{padded[1]}"),
            *("-framerate", f"{_rate(path, suffix, fps):.6f}", "-i", "-", "-an"),
            *_filters(suffix, space),
            *_CODECS[suffix],
            *("-threads", _THREADS, *_BITEXACT, str(temporary)),
        ]
        coder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said)
        assert coder.stdin is not None
        try:
            _feed(coder.stdin, frames, padded, progress)
        except BaseException:
            coder.kill()
            raise
        finally:
            with suppress(BrokenPipeError):
                coder.stdin.close()
            coder.wait()
        if coder.returncode != 0:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise InputError(
                f"{path}: ffmpeg could not write it: {lines[-1]}; the frames stay, repeat the "
                "command"
            )


def _feed(
    pipe: IO[bytes], frames: Sequence[Path], size: tuple[int, int], progress: Progress
) -> None:
    """Frames to ffmpeg; where it has ended early, its exit code tells."""
    with suppress(BrokenPipeError):
        for i, frame in enumerate(frames, start=1):
            pixels = _pixels(frame)
            height, width = pixels.shape[:2]
            edges = ((0, size[1] - height), (0, size[0] - width), (0, 0))
            pipe.write(np.pad(pixels, edges, mode="edge").tobytes())
            progress(i / len(frames))


def _pixels(path: Path) -> NDArray[np.uint8]:
    return np.asarray(read_frame(path).convert("RGB"))


def _rate(path: Path, suffix: str, fps: float) -> float:
    """What the format can keep."""
    if suffix != ".gif":
        return fps
    ticks = max(_LEAST_TICKS, round(_GIF_TICKS / fps))
    kept = _GIF_TICKS / ticks
    if abs(kept - fps) > 1e-6 * fps:
        warnings.warn(
            f"{path}: GIF counts hundredths of a second; {fps:g} frames a second become {kept:.4g}",
            VolspecWarning,
            stacklevel=4,
        )
    return kept


def _filters(suffix: str, space: ColourSpace) -> list[str]:
    if suffix == ".gif":
        palette = "split[a][b];[a]palettegen=stats_mode=full[p];[b][p]paletteuse=dither=sierra2_4a"
        return ["-filter_complex", palette]
    primaries, curve = _TAGS[space.name]
    convert = (
        "scale=in_range=pc:out_range=tv:out_color_matrix=bt709:flags=accurate_rnd+full_chroma_int"
    )
    tags = f"setparams=range=tv:colorspace=bt709:color_primaries={primaries}:color_trc={curve}"
    named = ("-colorspace", "bt709", "-color_primaries", primaries, "-color_trc", curve)
    return ["-vf", f"{convert},{tags}", *named, "-color_range", "tv"]
