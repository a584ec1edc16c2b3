"""Find ffmpeg, which encodes films and AVIF.

imageio-ffmpeg | variable -> [ffmpeg] -> film, avif
"""

from __future__ import annotations

import os
import subprocess

from volspec._extras import install_command
from volspec.errors import DeviceError, quote

# Variable that overrides imageio-ffmpeg's own ffmpeg; time limit of `ffmpeg -version`.
_VARIABLE, _TIMEOUT_S = "IMAGEIO_FFMPEG_EXE", 20.0


def ffmpeg() -> str:
    """Return the path of ffmpeg; `DeviceError` if there is none."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        path = str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise DeviceError(
            "export: films and .avif need ffmpeg, which is not installed",
            f"{install_command('video')}, or name a .gif or a folder of PNG",
            code="unsupported",
        ) from error
    if os.environ.get(_VARIABLE) and not _is_ffmpeg(path):
        raise DeviceError(
            f"export: ffmpeg is needed, but {_VARIABLE} is {quote(path)}, which is not ffmpeg",
            "correct or unset the variable",
            code="unsupported",
        )
    return path


def _is_ffmpeg(program: str) -> bool:
    """Return True if a program identifies as ffmpeg; imageio-ffmpeg does not check the variable."""
    command = [program, "-version"]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_TIMEOUT_S, check=True
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return False
    return done.stdout.startswith(b"ffmpeg")
