"""The offline export: every frame of a scene, cast as rarely as can be, whole or not at all.

Scene -> plan -> maker -> [run] -> a folder of frames, or a film
"""

from __future__ import annotations

import operator
import os
from pathlib import Path

from volspec._files import require_writable, require_writable_folder
from volspec._tables.written import plain
from volspec.errors import InputError, ViewingError
from volspec.export.film import SUFFIXES, check_film, write_film
from volspec.export.framefiles import FrameFiles
from volspec.export.maker import Maker, Tell
from volspec.export.manifest import Folder, alone_in, files_of, fingerprint
from volspec.export.overview import write_overview
from volspec.export.plan import plan_export
from volspec.pipeline import Raycaster
from volspec.scene import Scene
from volspec.scene.export import Exported
from volspec.scene.wording import in_keys
from volspec.volume import Volume

# What nobody calls a folder: other films, and single pictures.
_NOT_FOLDERS = (
    *(".mov", ".avi", ".mkv", ".m4v", ".ogv", ".png", ".apng", ".exr"),
    *(".jpg", ".jpeg", ".webp", ".tif", ".tiff"),
)
# Larger pictures than this are a slip: 64 Ki pixels a side.
MAX_SIDE = 1 << 16


def export_scene(
    scene: Scene,
    output: str | os.PathLike[str],
    *,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
    device: str | None = None,
    tell: Tell | None = None,
    volume: Volume | None = None,
    caster: Raycaster | None = None,
) -> Exported:
    """Export the frames that a scene's ``[export]`` asks for.

    Where the folder holds some of them already, only the others are made: an export that was
    killed goes on where it was, and leaves the same bytes.

    Parameters
    ----------
    scene : Scene
    output : path
        A folder; or a film, ``.mp4``, ``.webm`` or ``.gif``.
    size : (width, height), optional
        In place of the scene's; as large as 65536.
    overwrite : bool
        Replace what an export of another scene has left in the folder.
    device : str, optional
        Part of an OpenCL device's name.
    tell : callable, optional
        Called with a step's name and the finished share of it, 0…1.
    volume : Volume, optional
        The scene's, where it is loaded already.
    caster : Raycaster, optional
        With that volume on a device already; ``device`` is then the caster's.

    Raises
    ------
    InputError
        If the output cannot be written to, or is of another scene; if a number is out of range.
    DeviceError
        If there is no device, or a film is asked for and there is no ffmpeg.
    """
    tell = tell or (lambda step, share: None)
    target, table = Path(output), scene.file.export
    is_film = target.suffix.lower() in SUFFIXES
    if is_film:
        check_film(target, table, scene.relight.viewing.display.colours)
    elif target.is_file() or (target.suffix.lower() in _NOT_FOLDERS and not target.is_dir()):
        what = "is a file" if target.is_file() else "is no name of a folder"
        raise InputError(
            f"{target}: {what}; give a folder, for frames, or a film ({', '.join(SUFFIXES)})"
        )
    (require_writable if is_film else require_writable_folder)(target)
    pixels = _checked_size(size or (scene.file.output.width, scene.file.output.height))
    tell("read the volume", 0.0)
    volume = caster.volume if caster else volume or scene.volume()
    tell("read the volume", 1.0)
    plan = plan_export(scene, volume, table)
    settings = {"size": pixels, "export": plain(table), "film": is_film}
    # Frames of a film stand beside it until it is done.
    path = target.with_name(f"{target.name}.frames") if is_film else target
    has_sheet = table.sheet and not is_film
    files = files_of([shot.stem for shot in plan.shots], table.suffix, has_sheet)
    with alone_in(path):
        folder = Folder(path, fingerprint(scene, volume, settings), files)
        folder.begin(overwrite, own=is_film)
        maker = Maker(FrameFiles(scene, folder, table, pixels))
        try:
            made, casts = maker.make(plan, lambda: caster or Raycaster(volume, device=device), tell)
        except ViewingError as error:
            said = in_keys(str(error).removeprefix("export: "))
            raise ViewingError(f"{scene.path}: [viewing] {said}") from error
        finally:
            folder.keep_sizes()
        frames = [path / name for name in files[: len(plan.shots)]]
        if is_film:
            tell("encode", 0.0)
            colours = scene.relight.viewing.display.colours
            write_film(target, frames, table.fps, colours, lambda share: tell("encode", share))
            folder.remove()
        elif has_sheet and "sheet.png" in folder.missing():
            write_overview(path / "sheet.png", scene, plan, frames, table.primaries)
            folder.keep_sizes()
    done = (target.name,) if is_film else files
    return Exported(target, done, len(frames), made, casts)


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError.refused(
            "export.size", size, "give (width, height) in whole pixels"
        ) from None
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise InputError(f"export: the picture is {width}x{height}; give 1x1 to {MAX_SIDE} a side")
    return width, height
