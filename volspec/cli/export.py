"""``volspec export``: re-lit frames of a scene, lights × cameras, as files or as a film."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from volspec.cli.kinds import require_scene
from volspec.cli.shell import Device, Json, app, as_written, bar, counted, print_json, say
from volspec.cli.size import Size, sides
from volspec.errors import InputError, SceneError

_Strict = Parameter(converter=as_written)
_Whole = Annotated[int | None, _Strict]
_Number = Annotated[float | None, _Strict]


@app.command
def export(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    light: Annotated[list[str] | None, Parameter(negative="")] = None,
    turntable: _Whole = None,
    sweep: _Whole = None,
    size: Size = None,
    samples: _Whole = None,
    bits: _Whole = None,
    format: Annotated[Literal["png", "exr", "coefficients"] | None, _Strict] = None,
    spectral: Annotated[bool, Parameter(negative="")] = False,
    transparent: Annotated[bool, Parameter(negative="")] = False,
    fps: _Number = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    device: Device = None,
    json: Json = False,
) -> None:
    """Export re-lit frames: each light of a scene, from one camera, a turntable or keyframes.

    A camera is cast once, however many lights there are. What the options leave out is the
    scene's `[export]`. An export that was interrupted goes on when the command is repeated.

    Example: `volspec export engine.toml -o frames`

    Example: `volspec export engine.toml -o engine.mp4 --turntable 120 --light D65 --light A`

    Example: `volspec export engine.toml -o shot --format coefficients --turntable 72`

    Example: `volspec export engine.toml -o poster --size 12000x9000 --samples 2 --bits 16`

    Parameters
    ----------
    scene
        A scene file.
    output
        A folder; or a film, `.mp4`, `.webm` or `.gif` (needs `volspec[video]`).
    light
        A light of the scene by name, in place of all; repeatable.
    turntable
        Frames of a whole turn of the camera.
    sweep
        Frames in which one light fades into the next.
    size
        WIDTHxHEIGHT in pixels, in place of the scene's; cast in parts where it is large.
    samples
        n: n × n rays a pixel, 1 to 8.
    bits
        Of PNG codes, 8 or 16.
    format
        Of frames: png, or exr with linear light; or coefficients, one image a camera as
        `volspec render` writes it, to be relit in a compositor.
    spectral
        Of exr: a spectrum in every pixel.
    transparent
        No backdrop; opacity is kept in the files.
    fps
        Frames a second.
    overwrite
        Replace what an export of another scene has left in the folder.
    """
    from volspec.scene import Scene
    from volspec.settings import plain

    require_scene(scene)
    changes: dict[str, Any] = {
        "lights": light,
        "samples": samples,
        "bits": bits,
        "format": format,
        "spectral": spectral or None,
        "transparent": transparent or None,
        "fps": fps,
    }
    with bar(quiet=json, left=True) as tell:
        tell("load the scene", 0)
        loaded = Scene.load(scene)
        own = loaded.file.export
        for key, frames, table in (
            ("turntable", turntable, own.turntable),
            ("sweep", sweep, own.sweep),
        ):
            if frames is not None:
                kept = {} if table is None else plain(table)
                changes[key] = kept | {"frames": frames}
        given = {key: value for key, value in changes.items() if value is not None}
        with _by_option(given):
            loaded = loaded.exporting(**given)
        tell("load the scene", 1)
        made = loaded.export(
            output,
            size=sides(size) if size else None,
            overwrite=overwrite,
            device=device,
            progress=tell,
        )
    if json:
        print_json(
            {
                "output": str(made.output),
                "files": list(made.files),
                "frames": made.frames,
                "made": made.made,
                "casts": made.casts,
            }
        )
        return
    there = made.frames - made.made
    rest = f"; {there} were there" if there else ""
    said = (
        f"{made.output}: {counted(made.frames, 'frame')}, {made.made} made from "
        f"{counted(made.casts, 'cast')}{rest}"
    )
    say(said)


@contextmanager
def _by_option(given: Container[str]) -> Iterator[None]:
    """Name the option instead of the key of ``[export]`` that it has changed."""
    try:
        yield
    except SceneError as error:
        found = re.match(r"export\.(\w+)", error.field)
        if found is None or found[1] not in given:
            raise
        option = f"--{'light' if found[1] == 'lights' else found[1]}"
        plain = InputError(
            error.problem, error.remedy, code=error.code, field=option, given=error.given
        )
        raise plain from error
