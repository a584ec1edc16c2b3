"""The offline export: every frame of a scene, cast as rarely as can be, whole or not at all.

Scene -> plan -> tiles -> pixels -> [run] -> a folder of frames, or a film
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from volspec import __version__
from volspec._files import require_writable
from volspec._tables.written import plain
from volspec.appearance.spaces import space_of
from volspec.errors import InputError, quoted
from volspec.export.encoders import Encoders, disk_told
from volspec.export.exr import ExrRows, exr_file
from volspec.export.film import SUFFIXES, check_film, write_film
from volspec.export.frames import png_bytes, png_file
from volspec.export.lamps import Lamps
from volspec.export.manifest import Folder, alone_in, clear_temporaries, files_of, fingerprint
from volspec.export.overview import write_overview
from volspec.export.pixels import PRIMARIES, Array, Pane, check_viewing, measured
from volspec.export.plan import Plan, Shot, plan_export
from volspec.export.png import PngWriter
from volspec.export.tiles import Canvas, Caster
from volspec.pipeline import Raycaster
from volspec.raycast import CoefficientImage
from volspec.scene import Scene
from volspec.scene.export import Exported, ExportTable
from volspec.volume import Volume

Tell = Callable[[str, float], object]
# About how many relit frames a cast takes as long as; for the time left alone.
_FRAMES_A_CAST = 10
# Files that may be open at once, and bytes of rows that EXR keeps until a picture is whole.
_OPEN_FILES, _ROWS_BYTES = 64, 2**31
# Of the picture that an eye's adaptation is measured in where the whole is never in memory.
_MEASURED_SIDE = 512
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
            f"{target}: {what}; give one, for frames, or a film's ({', '.join(SUFFIXES)})"
        )
    require_writable(target if is_film else target / "sheet.png")
    pixels = _checked_size(size or (scene.file.output.width, scene.file.output.height))
    tell("read the volume", 0.0)
    volume = caster.volume if caster else volume or scene.volume()
    tell("read the volume", 1.0)
    plan = plan_export(scene, volume, table)
    settings = {"size": pixels, "export": plain(table), "film": is_film}
    # Frames of a film stand beside it until it is done.
    path = target.with_name(f"{target.name}.frames") if is_film else target
    suffix = f".{table.format}"
    has_sheet = table.sheet and not is_film
    files = files_of([shot.stem for shot in plan.shots], suffix, has_sheet)
    with alone_in(path):
        folder = Folder(path, fingerprint(scene, volume, settings), files)
        folder.begin(overwrite, own=is_film)
        maker = _Maker(scene, folder, table, pixels, suffix)
        made, casts = maker.make(plan, lambda: caster or Raycaster(volume, device=device), tell)
        frames = [path / name for name in files[: len(plan.shots)]]
        if is_film:
            tell("encode", 0.0)
            clear_temporaries(target)
            colours = scene.relight.viewing.display.colours
            write_film(target, frames, table.fps, colours, lambda share: tell("encode", share))
            folder.remove()
        elif has_sheet and "sheet.png" in folder.missing():
            with disk_told(path / "sheet.png"):
                write_overview(path / "sheet.png", scene, plan, frames, table.primaries)
    done = (target.name,) if is_film else files
    return Exported(target, done, len(frames), made, casts)


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(
            f"export: size is {quoted(size)}; give (width, height) in whole pixels"
        ) from None
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise InputError(f"export: the picture is {width}x{height}; give 1x1 to {MAX_SIDE} a side")
    return width, height


@dataclass(frozen=True, slots=True, eq=False)
class _Maker:
    """Makes the frames that a folder lacks."""

    scene: Scene
    folder: Folder
    table: ExportTable
    size: tuple[int, int]
    suffix: str

    def make(self, plan: Plan, caster_of: Callable[[], Raycaster], tell: Tell) -> tuple[int, int]:
        """How many frames were made, from how many casts."""
        missing = self.folder.missing()
        todo = [
            [shot for shot in shots if f"{shot.stem}{self.suffix}" in missing]
            for shots in plan.casts()
        ]
        todo = [shots for shots in todo if shots]
        if not todo:
            return 0, 0
        channels = len(self.scene.raycast.groups) * self.scene.basis.size
        canvas = Canvas(self.size, self.table.samples, channels)
        strips = canvas.strips()
        parts = len(strips) * len(strips[0])
        check_viewing(self.table, self.scene.relight.viewing.adapting, parts)
        notes = {
            "scene": self.scene.file.title,
            "viewing": self.scene.viewing.model_dump_json(),
        }
        tell("export", 0.0)
        caster = Caster(caster_of(), self.scene.raycast, notes)
        batches = [
            shots[i : i + self._batch] for shots in todo for i in range(0, len(shots), self._batch)
        ]
        groups = batches if parts > 1 else todo
        total = sum(len(shots) + _FRAMES_A_CAST for shots in groups)
        done = 0
        encoders = Encoders(8 * self.size[0] * self.size[1])
        with Lamps() as lamps, encoders:
            for group in groups:

                def told(share: float, done: int = done) -> None:
                    tell("export", (done + share * _FRAMES_A_CAST) / total)

                shots = self._measured(group, caster, parts)
                images = caster.strips(shots[0].transfer, shots[0].camera, canvas, told)
                if parts > 1:
                    self._in_strips(images, shots, lamps)
                    done += _FRAMES_A_CAST + len(shots)
                    tell("export", done / total)
                    continue
                panes = self._panes(next(images))
                done += _FRAMES_A_CAST
                for shot in shots:
                    self._write(shot, panes, lamps.row(panes, shot), encoders)
                    done += 1
                    tell("export", done / total)
        return sum(len(shots) for shots in todo), len(groups)

    @property
    def _batch(self) -> int:
        """How many frames may grow at once, strip by strip."""
        if self.table.format == "png":
            return _OPEN_FILES
        return max(1, _ROWS_BYTES // (8 * self.size[0] * self.size[1]))

    def _measured(self, shots: list[Shot], caster: Caster, parts: int) -> list[Shot]:
        """What ``adapting = "picture"`` measures, where frames do not hold what it looks at."""
        given = self.scene.relight.viewing.adapting == "given"
        if given or not (self.table.transparent or parts > 1):
            return shots
        scale = min(1.0, _MEASURED_SIDE / max(self.size))
        width, height = (max(1, round(scale * side)) for side in self.size)
        small = caster.cast(shots[0].transfer, shots[0].camera, (width, height))
        return [measured(shot, small) for shot in shots]

    def _in_strips(
        self, images: Iterator[list[CoefficientImage]], shots: Sequence[Shot], lamps: Lamps
    ) -> None:
        """Every light of a strip before the next is cast: only one is in memory."""
        with ExitStack() as stack:
            files: list[PngWriter | ExrRows] = []
            for strip in images:
                panes = self._panes(strip)
                if not files:
                    notes = panes[0].image.notes
                    files = [
                        stack.enter_context(self._file(shot, self._text(shot, notes)))
                        for shot in shots
                    ]
                for file, shot in zip(files, shots, strict=True):
                    file.rows(lamps.row(panes, shot))

    def _panes(self, images: Sequence[CoefficientImage]) -> list[Pane]:
        return [Pane.of(image, self.table) for image in images]

    def _write(self, shot: Shot, panes: Sequence[Pane], pixels: Array, encoders: Encoders) -> None:
        """A whole frame's file, now or soon."""
        text = self._text(shot, panes[0].image.notes)
        if self.table.format == "exr":
            with self._file(shot, text) as file:
                file.rows(pixels)
            return
        colours = space_of(shot.spec.viewing.display.space)
        encoders.put(self._path(shot), partial(png_bytes, pixels, text, colours))

    def _path(self, shot: Shot) -> Path:
        return self.folder.path / f"{shot.stem}{self.suffix}"

    @contextmanager
    def _file(self, shot: Shot, text: Mapping[str, str]) -> Iterator[PngWriter | ExrRows]:
        """A frame's file that takes rows; whole when the body is done."""
        path, table = self._path(shot), self.table
        with disk_told(path):
            if table.format == "exr":
                with exr_file(path, PRIMARIES[table.primaries], text) as rows:
                    yield rows
                return
            channels = 4 if table.transparent else 3
            colours = space_of(shot.spec.viewing.display.space)
            with png_file(path, self.size, channels, table.bits, text, colours) as file:
                yield file

    def _text(self, shot: Shot, cast: Mapping[str, str]) -> dict[str, str]:
        """What made a frame, to stand in its file."""
        spec, samples = shot.spec, self.table.samples
        text = {
            "Title": self.scene.file.title,
            "light": shot.light,
            "camera": repr(shot.camera),
            "transfer": repr(shot.transfer),
            "viewing": repr(spec.viewing),
            "relight": f"mode {spec.mode}, level {spec.level}, backdrop {spec.backdrop}",
            "samples": f"{samples} x {samples}",
            **{key: cast[key] for key in ("volume", "raycast")},
            "export": self.folder.fingerprint,
            "Software": f"volspec {__version__}",
        }
        return {key: value for key, value in text.items() if value}
