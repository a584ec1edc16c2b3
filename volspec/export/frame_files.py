"""Files of an export's frames: names, metadata, and encoding on all cores.

shot, pixels -> [frame_files] -> PNG | EXR | coefficient image
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from volspec import __version__
from volspec._exr import to_half
from volspec._files import write_whole
from volspec.appearance.display import colour_space
from volspec.export.compositing import save_for_compositors, scene_recipe
from volspec.export.exr import (
    PRIMARIES,
    ExrHeader,
    ExrWriter,
    encoding_threads,
    exr_bytes,
    exr_file,
)
from volspec.export.frame_source import Array
from volspec.export.frames import png_bytes, png_file
from volspec.export.manifest import ExportFolder
from volspec.export.plan import Shot, export_lights
from volspec.export.png import PngWriter
from volspec.export.spectral import SpectralIllumination
from volspec.raycast import CoefficientImage
from volspec.scene import Scene
from volspec.scene.export import ExportSpec

# Bytes of a pixel's red, green, blue and opacity as half floats, or in 16 bits.
_COLOUR_BYTES = 8
# Bytes of frames that may wait for a core.
_WAITING_BYTES = 2**29


class Encoders:
    """Encodes frames in background threads and writes the files in the order they were given.

    A context manager that ends when all files are written. If one cannot be, `put` or the end
    raises `InputError`, and complete files stay. The size of a frame's pixels, ``frame_bytes``,
    bounds the queue.
    """

    def __init__(self, frame_bytes: int) -> None:
        threads = encoding_threads()
        self._room = max(1, min(2 * threads, _WAITING_BYTES // max(frame_bytes, 1)))
        self._pool = ThreadPoolExecutor(threads)
        self._waiting: deque[tuple[Path, Future[bytes]]] = deque()

    def put(self, path: Path, encode: Callable[[], bytes]) -> None:
        """Queue a frame; it is written when a later one needs its room, or at the end."""
        while len(self._waiting) >= self._room or (self._waiting and self._waiting[0][1].done()):
            self._write()
        self._waiting.append((path, self._pool.submit(encode)))

    def _write(self) -> None:
        path, encoded = self._waiting.popleft()
        data = encoded.result()
        with write_whole(path) as temporary:
            temporary.write_bytes(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            while self._waiting and error is None:
                self._write()
        finally:
            self._pool.shutdown(cancel_futures=True)


@dataclass(frozen=True, slots=True, eq=False)
class FrameFiles:
    """The files of an export's folder."""

    scene: Scene
    folder: ExportFolder
    table: ExportSpec
    size: tuple[int, int]  # (width, height)

    def encoders(self) -> Encoders:
        """Return the queue for `put`; a context manager."""
        bands = self.scene.basis.grid.size if self.table.spectral else 0
        return Encoders((_COLOUR_BYTES + 2 * bands) * self.size[0] * self.size[1])

    def name(self, shot: Shot) -> str:
        """Return the name of a shot's file in the folder."""
        return f"{shot.stem}{self.table.suffix}"

    def put(self, shot: Shot, pixels: Array, notes: Mapping[str, str], encoders: Encoders) -> None:
        """Queue a complete frame, pixels as `FrameSource.pixels`, with the image's notes."""
        text = self._text(shot, notes)
        if self.table.format == "exr":
            encode = partial(exr_bytes, to_half(pixels), self._header(shot, text))
        else:
            space = colour_space(shot.spec.viewing.display.space)
            encode = partial(png_bytes, pixels, text, space)
        encoders.put(self._path(shot), encode)

    @contextmanager
    def opened(self, shot: Shot, notes: Mapping[str, str]) -> Iterator[PngWriter | ExrWriter]:
        """Open a frame's file for rows; it appears after the body. Parameters as of `put`."""
        path, table, text = self._path(shot), self.table, self._text(shot, notes)
        if table.format == "exr":
            with exr_file(path, self._header(shot, text)) as file:
                yield file
            return
        channels = 4 if table.transparent else 3
        space = colour_space(shot.spec.viewing.display.space)
        with png_file(path, self.size, channels, table.bits, text, space) as rows:
            yield rows

    def save(self, shot: Shot, image: CoefficientImage) -> None:
        """Write a coefficient image, as `volspec render` does, with the export's lights."""
        recipe = scene_recipe(self.scene, export_lights(self.scene, self.table), shot.spec)
        save_for_compositors(image, self._path(shot), recipe)

    def _path(self, shot: Shot) -> Path:
        return self.folder.path / self.name(shot)

    def _header(self, shot: Shot, text: Mapping[str, str]) -> ExrHeader:
        table, bands = self.table, None
        if table.spectral:
            groups = self.scene.raycast.shares()
            bands = SpectralIllumination.of(self.scene.basis, shot.rig, shot.spec, groups).bands
        return ExrHeader(self.size, PRIMARIES[table.primaries], text, table.transparent, bands)

    def _text(self, shot: Shot, notes: Mapping[str, str]) -> dict[str, str]:
        """Return the settings that made a frame, for its file."""
        spec, samples = shot.spec, self.table.samples
        text = {
            "Title": self.scene.file.title,
            "light": shot.light,
            "camera": repr(shot.camera),
            "transfer": repr(shot.transfer),
            "viewing": repr(spec.viewing),
            "relight": f"mode {spec.mode}, level {spec.level}, backdrop {spec.backdrop}",
            "samples": f"{samples} x {samples}",
            **{key: notes[key] for key in ("volume", "raycast")},
            "export": self.folder.fingerprint,
            "Software": f"volspec {__version__}",
        }
        return {key: value for key, value in text.items() if value}
