"""Export all frames of a scene: as few casts as possible, complete files only, resumable.

Scene -> plan -> tiles -> frame_files -> [exporter] -> a folder of frames, or a film
"""

from __future__ import annotations

import os
import re
import threading
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from volspec._files import exclusive_folder, require_writable, require_writable_folder
from volspec._gpu import Compute
from volspec.errors import CastCancelled, InputError, ViewingError, VolspecError, VolspecWarning
from volspec.export.annotate import Patch, paint
from volspec.export.film import EVEN, FILM_SUFFIXES, check_film, write_film
from volspec.export.frame_files import (
    Array,
    FrameFiles,
    FrameSource,
    RelighterPool,
    Writer,
    check_adapting,
    measured_shot,
)
from volspec.export.frames import BlankFrames
from volspec.export.manifest import ExportFolder, fingerprint
from volspec.export.overview import write_overview
from volspec.export.plan import Plan, Shot, plan_export
from volspec.export.tiles import Canvas, TileCaster, TileWindow, part_of
from volspec.image import CoefficientImage
from volspec.pipeline import GAPS, Raycaster
from volspec.relight import expected_depth_mm
from volspec.scene import Scene, cast_notes
from volspec.settings import plain
from volspec.volume import Series, Volume

Progress = Callable[[str, float], object]
Fraction = Callable[[float], object]
Made = TypeVar("Made")
CasterOf = Callable[[list[Shot]], TileCaster]

# Suffixes that are not a folder's, nor are names close to them, such as ".mp5".
_OTHER_FILMS = (".avi", ".mkv", ".m4v", ".mpg", ".mpeg", ".wmv", ".flv", ".3gp", ".ogv")
_PICTURES = (".png", ".avif", ".exr", ".jpg", ".jpeg", ".tif", ".tiff")
_CLOSE = 0.75
# Casts that a cluster has begun before the one that is waited for has ended.
_AHEAD = 1
# Larger pictures are taken for a typing error: 64 Ki pixels a side.
MAX_SIDE = 1 << 16
# Number of relit frames that take about as long as a cast; only weights the progress.
_FRAMES_A_CAST = 10
# Files that may be open at once while they grow strip by strip.
_OPEN_FILES = 64
# Settings of a frame's brightness.
_BRIGHTNESS = "the light's illuminance_lux, or exposure in [viewing]"
# Side of the picture in which adaptation is measured if the full one is never in memory.
_MEASURED_SIDE = 512
# Side of the picture whose expected depth is where two cast eyes converge.
_DEPTH_SIDE = 128


@dataclass(frozen=True, slots=True)
class Exported:
    """Result of an export.

    Parameters
    ----------
    output : Path
        Folder or film.
    files : tuple of str
        Names within the folder; for a film, only the film.
    frames, made : int
        Number of frames, and how many of them this call has made.
    casts : int
        Number of casts.
    gaps : str
        Sentence about chunks of the volume that could not be read for the first such frame; empty
        without any. Such frames are made again by the next export.
    """

    output: Path
    files: tuple[str, ...]
    frames: int
    made: int
    casts: int
    gaps: str = ""


def export(
    scene: Scene,
    output: str | os.PathLike[str],
    *,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
    device: str | None = None,
    progress: Progress | None = None,
    volume: Volume | None = None,
    caster: Raycaster | None = None,
    plan: Plan | None = None,
    series: Series | None = None,
    **changes: Any,
) -> Exported:
    """Export the frames of a scene's ``[export]``; see docs/export.md.

    Frames that the folder already has are kept: an export that was killed resumes, and the result
    has the same bytes.

    Parameters
    ----------
    scene : Scene
    output : path
        A folder; or a film, ``.mp4``, ``.webm``, ``.mov``, ``.webp``, ``.apng`` or ``.gif``.
    size : (width, height), optional
        Size instead of the scene's; up to 65536. The scene's own is made even for MP4 and WebM.
    overwrite : bool
        Whether to replace another scene's export in the folder.
    device : str, optional
        Part of an OpenCL device's name.
    progress : callable, optional
        Called with a step's name and its progress, 0…1. If it raises CastCancelled, the frames
        that this export has made are removed.
    volume : Volume, optional
        The scene's volume, if it is already loaded.
    caster : Raycaster, optional
        Caster that already has the volume on a device; ``device`` is then ignored.
    plan : Plan, optional
        Frames instead of those of ``[export]``, in its files' format.
    series : Series, optional
        The scene's time steps, if they are already open.
    **changes
        Keys of ``[export]`` instead of the file's, such as ``turntable={"frames": 36}``.

    Raises
    ------
    InputError
        If a setting is wrong, or the output cannot be written or belongs to another scene.
    DeviceError
        If there is no device, or no ffmpeg for a film.
    """
    progress = progress or (lambda step, fraction: None)
    scene = scene.exporting(**changes) if changes else scene
    target, table = Path(output), scene.file.export
    is_film = target.suffix.lower() in FILM_SUFFIXES
    if is_film:
        check_film(target, table, scene.relight.viewing.display.colours)
    else:
        _require_folder_name(target)
    (require_writable if is_film else require_writable_folder)(target)
    scene_size = scene.file.output.width, scene.file.output.height
    is_even = target.suffix.lower() in EVEN
    pixels = _checked_size(size or (even_size(scene_size) if is_even else scene_size))
    progress("read the volume", 0.0)
    plays = table.play is not None if plan is None else plan.plays
    series = (series or scene.series()) if plays else None
    if series is not None and caster is None:
        volume = series[0]
    volume = caster.volume if caster else volume or scene.volume()
    progress("read the volume", 1.0)
    settings = {"size": pixels, "export": plain(table), "film": is_film}
    if plan is None:
        plan = plan_export(scene, volume, table, series)
    else:
        settings["plan"] = plan.fingerprint()
    # Until a film is done, its frames are in a folder next to it.
    path = target.with_name(f"{target.name}.frames") if is_film else target
    has_sheet = table.sheet and not is_film
    if table.format == "exr" and scene.file.annotation:
        text = f"{scene.path}: annotations are in PNG and films; EXR frames are without them"
        warnings.warn(text, VolspecWarning, stacklevel=3)
    files = tuple(f"{shot.stem}{table.suffix}" for shot in plan.shots)
    files += ("sheet.png",) if has_sheet else ()
    volumes = [volume] if series is None else series
    casters = _Casters(volume, device, caster, series)
    with exclusive_folder(path):
        folder = ExportFolder(path, fingerprint(scene, volumes, settings), files)
        try:
            folder.begin(overwrite, own=is_film)
            maker = FrameMaker(FrameFiles(scene, folder, table, pixels))
            try:
                count, casts = maker.make(plan, casters, progress)
            except ViewingError as error:
                message = re.sub(r"^(?:[A-Z]\w+\.|export: )", "", str(error))
                raise ViewingError(f"{scene.path}: [viewing] {message}", code=error.code) from error
            finally:
                folder.record_sizes()
            frames = [path / name for name in files[: len(plan.shots)]]
            gaps = next(iter(folder.gaps().values()), "")
            if is_film:
                progress("encode", 0.0)
                colours = scene.relight.viewing.display.colours
                write_film(
                    target, frames, table.fps, colours, lambda done: progress("encode", done)
                )
                folder.remove()
            elif has_sheet and "sheet.png" in folder.missing():
                if incomplete := folder.gaps():
                    folder.record_gaps(["sheet.png"], next(iter(incomplete.values())))
                write_overview(path / "sheet.png", scene, plan, frames, table)
                folder.record_sizes()
        except CastCancelled:
            folder.remove()
            raise
        except VolspecError:
            folder.remove_unless_begun()
            raise
    return Exported(target, (target.name,) if is_film else files, len(frames), count, casts, gaps)


def _require_folder_name(target: Path) -> None:
    """Refuse a file, and a name that ends like a file of a kind that is not written."""
    suffix = target.suffix.lower()
    suffixes = FILM_SUFFIXES + _OTHER_FILMS + _PICTURES
    if target.is_dir() or (
        not target.is_file() and not get_close_matches(suffix, suffixes, 1, _CLOSE)
    ):
        return
    problem = "is a file" if target.is_file() else f"frames cannot be written as {suffix}"
    if suffix in (".png", ".avif", ".exr"):
        problem = f"an export's {suffix[1:].upper()} frames are many files"
    folder = f"a folder for the frames, such as {target.with_suffix('')}"
    raise InputError(
        f"{target}: {problem}",
        f"name {folder}, or a film {', '.join(FILM_SUFFIXES[:-1])} or {FILM_SUFFIXES[-1]}",
        code="type",
    )


def even_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return a size with even sides, which most films need; an odd one loses a row or column.

    >>> even_size((929, 673)), even_size((1, 2))
    ((928, 672), (2, 2))
    """
    width, height = (max(side - side % 2, 2) for side in size)
    return width, height


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    width, height = size
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise InputError(
            f"the picture is {width}x{height}",
            f"give 1 to {MAX_SIDE} pixels per side",
            code="range",
            field="size",
            given=size,
        )
    return width, height


@dataclass(slots=True)
class _Casters:
    """Casters of a volume and of its time steps, opened when they are needed."""

    volume: Volume
    device: str | None
    of_volume: Raycaster | None
    series: Series | None
    # The last step, as frames of several lights follow each other.
    _last: tuple[int, Raycaster] | None = None

    def at_step(self, step: int | None) -> Raycaster:
        """Return the caster of a time step, or of the volume."""
        self.of_volume = self.of_volume or Raycaster(self.volume, device=self.device)
        if step is None or self.series is None:
            return self.of_volume
        if self._last is None or self._last[0] != step:
            self._last = step, Raycaster(self.series[step], like=self.of_volume)
        return self._last[1]


class _ProgressMeter:
    """Combined progress of casts and frames."""

    def __init__(self, casts: Sequence[Sequence[Shot]], progress: Progress) -> None:
        self._progress = progress
        self._total = sum(_FRAMES_A_CAST + len(shots) for shots in casts)
        self._done = 0
        self.casting(0.0)

    def casting(self, fraction: float) -> None:
        self._progress("export", (self._done + fraction * _FRAMES_A_CAST) / self._total)

    def add(self, frames: int) -> None:
        """Count work that takes as long as the given number of frames."""
        self._done += frames
        self.casting(0.0)


def _in_order(
    casts: Sequence[list[Shot]],
    caster_of: CasterOf,
    make: Callable[[TileCaster, list[Shot], Fraction], Made],
    meter: _ProgressMeter,
) -> Iterator[tuple[list[Shot], TileCaster, Made]]:
    """Yield the shots of each cast, its caster, and what is made by it.

    A cluster begins the next casts meanwhile, so that no worker waits for the end of one.
    """
    ahead = _AHEAD if casts and caster_of(casts[0]).caster.cluster is not None else 0
    if not ahead:
        for shots in casts:
            caster = caster_of(shots)
            yield shots, caster, make(caster, shots, meter.casting)
        return
    ended = threading.Event()

    def go_on(fraction: float) -> None:
        if ended.is_set():
            raise CastCancelled("raycast: cancelled", code="state")

    coming: deque[tuple[list[Shot], TileCaster, Future[Made]]] = deque()
    with ThreadPoolExecutor(1 + ahead, thread_name_prefix="volspec-cast") as pool:
        try:
            for shots in casts:
                caster = caster_of(shots)
                coming.append((shots, caster, pool.submit(make, caster, shots, go_on)))
                if len(coming) > ahead:
                    shots, caster, future = coming.popleft()
                    yield shots, caster, future.result()
            for shots, caster, future in coming:
                yield shots, caster, future.result()
        finally:
            ended.set()


@dataclass(frozen=True, slots=True, eq=False)
class FrameMaker:
    """Make the frames missing from a folder: one cast for all lights, large frames in strips."""

    files: FrameFiles
    _canvas: Canvas = field(init=False)

    def __post_init__(self) -> None:
        scene = self.files.scene
        channels = len(scene.raycast.groups) * scene.basis.size
        canvas = Canvas(self.files.size, self.files.table.samples, channels)
        object.__setattr__(self, "_canvas", canvas)

    def make(self, plan: Plan, casters: _Casters, progress: Progress) -> tuple[int, int]:
        """Make the missing frames; return the numbers of frames and of casts."""
        casts = self._missing(plan)
        if not casts:
            return 0, 0
        scene, table = self.files.scene, self.files.table
        check_adapting(table, scene.relight.viewing.adapting, self._parts)
        notes = cast_notes(scene.file, scene.relight)
        only_cast = table.format == "coefficients"
        if self._parts > 1 and not only_cast:
            casts = [s[i : i + _OPEN_FILES] for s in casts for i in range(0, len(s), _OPEN_FILES)]
        meter = _ProgressMeter(casts, progress)
        surfaces = scene.behind(casters.volume)
        shared, baked = self._is_layered(plan), dict[str, float]()
        if shared and not _opacities_change(plan):
            # Nearer to a cast than layers that are scaled afterwards.
            baked = dict(plan.shots[0].look.opacities)
            casts = [[_clear_opacities(shot) for shot in shots] for shots in casts]
        has_layers = shared or (only_cast and self._in_one_window)
        layers = scene.raycast.layers if has_layers else 0
        width, height = self.files.size
        for name, is_split in (
            ("[depth]", plan.deep and not self._in_one_window),
            ("[export] stereo", table.stereo is not None and self._parts > 1),
        ):
            if is_split:
                problem = f"{width}x{height} is cast in parts, which {name} cannot join"
                remedy = f"make it smaller, or leave {name} out"
                raise InputError(problem, remedy, code="size")

        def caster_of(shots: list[Shot]) -> TileCaster:
            opacities = baked if shared else dict(shots[0].look.opacities)
            spec = replace(scene.raycast, layers=layers, opacities=opacities)
            return TileCaster(casters.at_step(shots[0].step), spec, notes, surfaces)

        if only_cast:
            self._cast(casts, caster_of, meter, shared)
        else:
            self._relight(casts, caster_of, meter)
        eyes = 2 if table.stereo is not None and not layers else 1
        return sum(len(shots) for shots in casts), eyes * len(casts)

    def _missing(self, plan: Plan) -> list[list[Shot]]:
        """Return the shots to make, grouped by cast."""
        missing = self.files.folder.missing()
        casts = (
            [shot for shot in shots if self.files.name(shot) in missing]
            for shots in plan.casts(self._is_layered(plan))
        )
        return [shots for shots in casts if shots]

    def _is_layered(self, plan: Plan) -> bool:
        """Return True if frames of other opacities, in depth or of two eyes share layered casts.

        Parts of a picture and averages of several rays have no layers.
        """
        if plan.deep:
            return True
        table = self.files.table
        changes = _opacities_change(plan)
        layers = self.files.scene.raycast.layers and table.format != "coefficients"
        return bool((changes or table.stereo) and layers and self._in_one_window)

    @property
    def _in_one_window(self) -> bool:
        windows = self._canvas.windows(TileWindow(0, 0, *self.files.size))
        return len(windows) == 1 and self._canvas.samples == 1

    @property
    def _parts(self) -> int:
        strips = self._canvas.strips()
        return len(strips) * len(strips[0])

    def _cast(
        self,
        casts: list[list[Shot]],
        caster_of: CasterOf,
        meter: _ProgressMeter,
        shared: bool,
    ) -> None:
        def cast_whole(caster: TileCaster, shots: list[Shot], tell: Fraction) -> CoefficientImage:
            return caster.picture(shots[0].transfer, shots[0].camera, self._canvas, tell)

        for shots, _, image in _in_order(casts, caster_of, cast_whole, meter):
            self._record_gaps(shots, [image])
            meter.add(_FRAMES_A_CAST)
            for shot in shots:
                self.files.save(shot, _views(image, shot)[0] if shared else image)
                meter.add(1)

    def _relight(self, casts: list[list[Shot]], caster_of: CasterOf, meter: _ProgressMeter) -> None:
        blanks = BlankFrames(_BRIGHTNESS)

        def strips(
            caster: TileCaster, shots: list[Shot], tell: Fraction
        ) -> tuple[list[Shot], Iterator[list[CoefficientImage]]]:
            measured = self._measured(shots, caster)
            transfer, camera = measured[0].transfer, measured[0].camera
            if self.files.table.stereo is not None and not caster.spec.layers:
                return measured, iter([self._eyes(caster, measured[0], tell)])
            images = caster.strips(transfer, camera, self._canvas, tell)
            # Many strips are cast one after the other, as one alone is in memory.
            return measured, images if self._parts > 1 else iter([*images])

        with closing(RelighterPool()) as pool, self.files.encoders() as encoders:
            for _, caster, (shots, images) in _in_order(casts, caster_of, strips, meter):
                if self._parts > 1:
                    marks = [self.files.marks(shot, caster.caster.volume) for shot in shots]
                    self._relight_strips(images, shots, marks, pool, blanks)
                    meter.add(_FRAMES_A_CAST + len(shots))
                    continue
                images_of_shot = next(images)
                self._record_gaps(shots, images_of_shot)
                layered = images_of_shot[0].opacity_layers is not None
                sources = [] if layered else self._sources(images_of_shot)
                meter.add(_FRAMES_A_CAST)
                current = None
                for shot in shots:
                    if layered and (shot.look.opacities, shot.look.depth) != current:
                        image, compute = images_of_shot[0], caster.caster.compute
                        sources = self._sources(_views(image, shot, compute))
                        current = shot.look.opacities, shot.look.depth
                    notes, parts = sources[0].image.notes, pool.parts(sources, shot)
                    self._check_blank(shot, np.hstack(parts), sources, blanks)
                    pixels = self._marked(caster, shot, sources, parts)
                    self.files.put(shot, pixels, notes, encoders)
                    meter.add(1)
        blanks.warn()

    def _eyes(self, caster: TileCaster, shot: Shot, tell: Fraction) -> list[CoefficientImage]:
        """Cast the pictures of both eyes."""
        stereo = self.files.table.stereo
        assert stereo is not None
        convergence_mm = stereo.convergence_mm
        if convergence_mm is None:
            width, height = self.files.size
            scale = min(1.0, _DEPTH_SIDE / max(width, height))
            size = max(1, round(scale * width)), max(1, round(scale * height))
            small = caster.cast(shot.transfer, shot.camera, size)
            convergence_mm = expected_depth_mm(small)
        return [
            caster.picture(shot.transfer, eye, self._canvas, part_of(tell, n / 2, 1 / 2))
            for n, eye in enumerate(stereo.eyes(shot.camera, convergence_mm))
        ]

    def _marked(
        self, caster: TileCaster, shot: Shot, sources: Sequence[FrameSource], parts: Sequence[Array]
    ) -> Array:
        """Return the pixels of adjacent images, or of both eyes, with the picture's marks."""
        stereo, volume = self.files.table.stereo, caster.caster.volume
        if stereo is None:
            return paint(np.hstack(parts), self.files.marks(shot, volume))
        eyes = [self.files.marks(_by_eye(shot, source), volume) for source in sources]
        return shot.look.combine([*map(paint, parts, eyes)])

    def _measured(self, shots: list[Shot], caster: TileCaster) -> list[Shot]:
        """Measure the viewing in a small cast if no frame is the complete picture."""
        table = self.files.table
        is_given = not self.files.scene.relight.viewing.is_measured
        if is_given or not table.has_eye or not (table.transparent or self._parts > 1):
            return shots
        scale = min(1.0, _MEASURED_SIDE / max(self.files.size))
        width, height = (max(1, round(scale * side)) for side in self.files.size)
        small = caster.cast(shots[0].transfer, shots[0].camera, (width, height))
        return [measured_shot(shot, _views(small, shot)[0]) for shot in shots]

    def _relight_strips(
        self,
        images: Iterator[list[CoefficientImage]],
        shots: Sequence[Shot],
        marks: Sequence[Sequence[Patch]],
        pool: RelighterPool,
        blanks: BlankFrames,
    ) -> None:
        """Write each strip under every light before casting the next, so one is in memory."""
        with ExitStack() as stack:
            files: list[Writer] = []
            top = 0
            for strip in images:
                self._record_gaps(shots, strip)
                sources = self._sources(strip)
                if not files:
                    notes = sources[0].image.notes
                    files = [stack.enter_context(self.files.opened(s, notes)) for s in shots]
                for file, shot, patches in zip(files, shots, marks, strict=True):
                    pixels = pool.row(sources, shot)
                    self._check_blank(shot, pixels, sources, blanks)
                    file.rows(paint(pixels, patches, top))
                top += len(pixels)

    def _record_gaps(self, shots: Sequence[Shot], images: Sequence[CoefficientImage]) -> None:
        """Record frames of images for which parts of the volume could not be read."""
        if gaps := [image.notes[GAPS] for image in images if GAPS in image.notes]:
            self.files.folder.record_gaps(map(self.files.name, shots), gaps[0])

    def _check_blank(
        self, shot: Shot, pixels: Array, sources: Sequence[FrameSource], blanks: BlankFrames
    ) -> None:
        """Check frames for a display only: a compositor can brighten linear light."""
        if self.files.table.has_eye:
            alpha = np.hstack([source.alpha for source in sources])
            side, cut = min(self.files.size), shot.look.depth.cuts
            blanks.add(self.files.name(shot), shot.light, pixels, alpha, side, cut=cut)

    def _sources(self, images: Sequence[CoefficientImage]) -> list[FrameSource]:
        return [FrameSource.of(image, self.files.table) for image in images]


def _by_eye(shot: Shot, source: FrameSource) -> Shot:
    """Return a shot by the camera of an eye's picture."""
    camera = source.image.camera
    assert camera is not None
    return replace(shot, camera=camera)


def _clear_opacities(shot: Shot) -> Shot:
    """Return a shot of layers that were cast with its opacities."""
    return replace(shot, look=replace(shot.look, opacities={}))


def _opacities_change(plan: Plan) -> bool:
    """Return True if the shots of a plan have different opacities."""
    return len({tuple(shot.look.opacities.items()) for shot in plan.shots}) > 1


def _views(
    image: CoefficientImage, shot: Shot, compute: Compute | None = None
) -> Sequence[CoefficientImage]:
    """Return the pictures of a shot that an image with layers shows: one, or both eyes'."""
    if image.opacity_layers is None:
        return [image]
    with warnings.catch_warnings():
        # A material may be out of view in some frames.
        warnings.filterwarnings("ignore", ".* has no opacity in this picture", VolspecWarning)
        return shot.look.views(image, compute=compute)
