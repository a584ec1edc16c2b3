"""Find and assemble the kernels, shaders and data that ship with the Python code.

In a checkout they are in ``kernels/``, ``shaders/`` and ``data/`` at the root; in a wheel the same
folders are in ``volspec/_assets/``. Paths are relative to that root or folder.

``#include "file"`` lines are expanded here for both languages, so that OpenCL C and GLSL
share one mechanism and compiler messages name the real file and line: OpenCL C by its
standard ``#line N "file"``, GLSL by ``#line N k`` where k is a file number (`Source.files`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from volspec.errors import VolspecError, one_line

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')


@cache
def asset_root() -> Path:
    """Return the folder of ``kernels``, ``shaders`` and ``data``."""
    package = Path(__file__).resolve().parent.parent
    for root in (package / "_assets", package.parent):
        if (root / "kernels").is_dir() and (root / "shaders").is_dir():
            return root
    raise VolspecError(
        f"volspec: kernels/ and shaders/ not found next to {package}; "
        "the installation is incomplete, reinstall the package",
        code="damaged",
    )


def asset(relative: str) -> Path:
    """Return the path of a shipped file, such as ``data/engine.nrrd`` or ``kernels/raycast.cl``."""
    return asset_root() / relative


@cache
def _lines(file: Path) -> list[str]:
    """Return a source's lines; cached, since every cast assembles its kernel to look it up."""
    return file.read_text(encoding="utf-8").splitlines()


@dataclass(frozen=True, slots=True)
class Source:
    """Program text ready for a compiler, and the files its line marks refer to."""

    text: str
    files: tuple[str, ...]

    def name_files(self, log: str) -> str:
        """Replace GLSL's file numbers in a compiler log (``2:14`` or ``2(14)``) by names."""

        def named(match: re.Match[str]) -> str:
            index = int(match[1])
            name = self.files[index] if index < len(self.files) else match[1]
            return f"{name}:{match[2]}"

        return re.sub(r"\b(\d+)[:(](\d+)\)?", named, log)


@lru_cache(maxsize=64)
def assemble(relative: str, prelude: str, *, glsl_version: str = "") -> Source:
    """Read a kernel or shader, prepend the prelude and expand its includes.

    Includes are looked up in the ``include`` folder next to the file, each at most once. The GLSL
    version is ``"330 core"`` or ``"300 es"``; an empty string for OpenCL C.
    """
    path = asset(relative)
    files: list[str] = ["<prelude>"]
    included: set[str] = set()
    out: list[str] = [f"#version {glsl_version}"] if glsl_version else []
    out.append(prelude.rstrip("\n"))

    def mark(line: int, name: str) -> str:
        return f"#line {line} {files.index(name)}" if glsl_version else f'#line {line} "{name}"'

    def append(file: Path) -> None:
        name = file.relative_to(asset_root()).as_posix()
        if name in included:
            return
        included.add(name)
        files.append(name)
        try:
            lines = _lines(file)
        except OSError as error:
            raise VolspecError(
                f"{relative}: cannot read {name}: {error.strerror}", code="not-found"
            ) from error
        out.append(mark(1, name))
        for number, line in enumerate(lines, start=1):
            if match := _INCLUDE.match(line):
                append(path.parent / "include" / match[1])
                out.append(mark(number + 1, name))
            else:
                out.append(line)

    append(path)
    return Source("\n".join(out) + "\n", tuple(files))


# "FILE:12:5: error: …" is clang's form, "error: FILE:12:5: …" PoCL's.
_ERROR = re.compile(
    r"^(?:(?:fatal )?error: )?([^:\n]+):(\d+):(\d+): (?:(?:fatal )?error: )?(.*)$", re.MULTILINE
)
_NVIDIA = "<kernel>"  # its name of every file
_MARK = re.compile(r'#line (\d+) "([^"]+)"')


def first_error(log: str, source: Source) -> str:
    """Return the OpenCL compiler's first error in one line, with the source line's text."""
    match = next((m for m in _ERROR.finditer(log) if "error: " in m[0]), None)
    if match is None:
        return one_line(log)
    # The compiler uses its own file name for the lines before the first mark; NVIDIA's names no
    # file and counts the lines of the whole text.
    file = match[1] if match[1] in source.files else source.files[0]
    name, number = source.files[0], 0
    for place, line in enumerate(source.text.splitlines(), start=1):
        if mark := _MARK.match(line):
            number, name = int(mark[1]) - 1, mark[2]
            continue
        number += 1
        if (match[1], match[2]) == (_NVIDIA, str(place)) or (
            match[1] != _NVIDIA and (name, number) == (file, int(match[2]))
        ):
            return f'{name}:{number}:{match[3]}: error: {match[4]}: "{line.strip()}"'
    return one_line(match[0])
