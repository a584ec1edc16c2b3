"""Files of an export's frames: pixels, metadata, and encoding on all cores.

coefficient image, shot -> [frame_files] -> PNG | EXR | coefficient image
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from volspec import __version__
from volspec._exr import to_half
from volspec._files import write_whole
from volspec.appearance.display import ColourSpace, Hdr, colour_space, to_uint8, to_uint16
from volspec.errors import ViewingError
from volspec.export import exr
from volspec.export.annotate import MarkedPicture, Patch, picture_marks
from volspec.export.avif import AvifWriter
from volspec.export.compositing import save_for_compositors, scene_recipe
from volspec.export.frames import encode, row_file
from volspec.export.manifest import ExportFolder
from volspec.export.plan import Shot, export_lights
from volspec.export.png import PngWriter
from volspec.export.spectral import SpectralIllumination
from volspec.export.tiles import row_strips
from volspec.export.value_bars import material_colours, value_bars
from volspec.image import CoefficientImage
from volspec.relight import Illumination, Relighter, ViewingMeter
from volspec.scene import Scene
from volspec.scene.tables import ExportSpec
from volspec.volume import Volume

Array = NDArray[Any]
Writer = PngWriter | AvifWriter | exr.ExrWriter

# Below this opacity a pixel's colour is only rounding error.
_MIN_ALPHA = 1e-4
# Bytes of a pixel's red, green, blue and opacity in 16 bits.
_COLOUR_BYTES = 8
# Bytes of frames that may wait for a core.
_WAITING_BYTES = 2**29


@dataclass(frozen=True, slots=True, eq=False)
class FrameSource:
    """A coefficient image prepared for a kind of file."""

    # For transparent frames, the surfaces made opaque, without a backdrop shining through.
    image: CoefficientImage
    alpha: NDArray[np.float32]  # (H, W) opacity as cast
    table: ExportSpec

    @classmethod
    def of(cls, image: CoefficientImage, table: ExportSpec) -> FrameSource:
        """Prepare an image for the table's files."""
        alpha = np.asarray(image.alpha)
        if not table.transparent:
            return cls(image, alpha, table)
        coefficients = np.asarray(image.coefficients, np.float32)
        straight = coefficients / np.maximum(alpha, _MIN_ALPHA)[..., None]
        straight[alpha < _MIN_ALPHA] = 0.0
        return cls(replace(image, coefficients=straight, alpha=np.ones_like(alpha)), alpha, table)

    def pixels(self, relighter: Relighter, shot: Shot) -> Array:
        """Return the (H, W, C) pixels of the file, using a relighter that has `image` loaded.

        These are display codes, uint8 or uint16, with straight alpha; or linear float32,
        premultiplied; or half floats with a spectrum after red, green and blue.
        """
        table = self.table
        if table.spectral:
            lamp = SpectralIllumination.of(self.image.basis, shot.rig, shot.spec, self.image.groups)
            return np.concatenate([*lamp.strips(self.image)])
        if table.format == "exr":
            linear = self._linear(relighter, shot)
            return self._with_alpha(
                linear * self._cover[..., None] if table.transparent else linear
            )
        if table.depth == 8 and not table.transparent:
            return relighter.frame(shot.rig, shot.look.of_view)
        codes = self._with_alpha(relighter.frame(shot.rig, shot.look.of_view, np.float32))
        rounded = to_uint8(codes) if table.depth == 8 else to_uint16(codes)
        if table.transparent:
            rounded[rounded[..., 3] == 0] = 0  # a fully transparent pixel has no colour
        return rounded

    @property
    def _cover(self) -> NDArray[np.float32]:
        return np.where(self.alpha < _MIN_ALPHA, np.float32(0.0), self.alpha)

    def _with_alpha(self, colours: Array) -> Array:
        if not self.table.transparent:
            return colours
        covered = np.where(self._cover[..., None] > 0.0, colours, 0.0)
        return np.dstack([covered, self._cover]).astype(np.float32)

    def _linear(self, relighter: Relighter, shot: Shot) -> Array:
        spec, to = shot.spec, exr.PRIMARIES[self.table.primaries]
        if self.table.shows == "scene":
            illumination = Illumination.of(self.image.basis, shot.rig, spec, self.image.groups)
            matrix = to.RGB_from_XYZ @ exr.white_adaptation(exr.PRIMARIES["Rec. 709"], to)
            # A single matrix from channels to the file's primaries.
            to_file = replace(
                illumination,
                XYZ_from_channels=matrix @ illumination.XYZ_from_channels,
                backdrop_XYZ=matrix @ illumination.backdrop_XYZ,
            )
            image, light = self.image, np.empty((*self.alpha.shape, 3), np.float32)
            for rows in row_strips(image.size, image.coefficients.shape[2]):
                light[rows] = to_file.scene_XYZ(image.coefficients[rows], image.alpha[rows])
            return light
        codes = relighter.frame(shot.rig, shot.spec, dtype=np.float32)
        space = colour_space(spec.viewing.display.space)
        matrix = to.RGB_from_XYZ @ exr.white_adaptation(space, to) @ space.XYZ_from_RGB
        return (space.decode(codes) @ matrix.T).astype(np.float32)


class RelighterPool:
    """Relighters of the current images, reused for images of equal shapes; close after use."""

    def __init__(self) -> None:
        self._loaded: list[tuple[FrameSource, Relighter]] = []

    def row(self, sources: Sequence[FrameSource], shot: Shot) -> Array:
        """Return the pixels of adjacent images under a shot's light."""
        return np.hstack(self.parts(sources, shot))

    def parts(self, sources: Sequence[FrameSource], shot: Shot) -> list[Array]:
        """Return each image's pixels under a shot's light."""
        if [source for source, _ in self._loaded] != list(sources):
            self._load(sources)
        return [source.pixels(relighter, shot) for source, relighter in self._loaded]

    def _load(self, sources: Sequence[FrameSource]) -> None:
        shapes = [source.image.coefficients.shape for source, _ in self._loaded]
        if shapes == [source.image.coefficients.shape for source in sources]:
            relighters = [relighter for _, relighter in self._loaded]
            for source, relighter in zip(sources, relighters, strict=True):
                relighter.update(source.image)
        else:
            self.close()
            # Exact, as with a lookup table pixels would depend on the previous frames.
            relighters = [Relighter(source.image, lut3d=False) for source in sources]
        self._loaded = list(zip(sources, relighters, strict=True))

    def close(self) -> None:
        """Release the relighters."""
        for _, relighter in self._loaded:
            relighter.close()
        self._loaded = []


def measured_shot(shot: Shot, image: CoefficientImage) -> Shot:
    """Return a shot with the adaptation measured in its whole picture, possibly a smaller copy."""
    spec = shot.spec
    light = Illumination.of(image.basis, shot.rig, spec, image.groups)
    measured, _ = ViewingMeter().measure_viewing(image, light)
    viewing = replace(
        spec.viewing,
        adapting="given",
        surround=measured.surround,
        adopted_white=measured.adopted_white,
    )
    if spec.viewing.adapting != "given":
        viewing = replace(viewing, Y_b=measured.Y_b, L_A=measured.L_A)
    look = replace(shot.look, relight=replace(spec, viewing=viewing))
    return replace(shot, look=look)


def check_adapting(table: ExportSpec, adapting: str, parts: int) -> None:
    """Refuse local adaptation to a picture that is never in memory as a whole."""
    if adapting != "pixel" or not table.has_eye or (not table.transparent and parts == 1):
        return
    why = "has no backdrop" if table.transparent else "is relit in parts"
    raise ViewingError(
        f"export: adapting is 'pixel', which needs the whole picture, but the picture {why}",
        "use 'picture' or 'given'",
        code="conflict",
    )


class Encoders:
    """Encode frames in background threads and write the files in the order in which they came.

    If one cannot be written, `put` or the end of `running` raises `InputError`, and complete files
    are kept. The size of a frame's pixels, ``frame_bytes``, limits the queue's length.
    """

    def __init__(self, frame_bytes: int) -> None:
        threads = exr.encoding_threads()
        self._room = max(1, min(2 * threads, _WAITING_BYTES // max(frame_bytes, 1)))
        self._pool = ThreadPoolExecutor(threads)
        self._waiting: deque[tuple[Path, Future[bytes]]] = deque()

    def put(self, path: Path, encode: Callable[[], bytes]) -> None:
        """Queue a frame; it is written when a later frame needs room, or at the end."""
        while len(self._waiting) >= self._room or (self._waiting and self._waiting[0][1].done()):
            self._write()
        self._waiting.append((path, self._pool.submit(encode)))

    def _write(self) -> None:
        path, encoded = self._waiting.popleft()
        data = encoded.result()
        with write_whole(path) as temporary:
            temporary.write_bytes(data)

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Write the remaining frames when the context ends, unless it ends with an error."""
        try:
            yield self
            while self._waiting:
                self._write()
        finally:
            self._pool.shutdown(cancel_futures=True)


@dataclass(frozen=True, slots=True, eq=False)
class FrameFiles:
    """Files of an export's folder."""

    scene: Scene
    folder: ExportFolder
    table: ExportSpec
    size: tuple[int, int]  # (width, height)

    def marks(self, shot: Shot, volume: Volume) -> list[Patch]:
        """Return the marks of a shot's picture."""
        marks, scene = self.table.annotate, self.scene
        annotations = scene.file.annotation if self.table.format == "png" else ()
        if not marks and not annotations:
            return []
        materials = scene.materials if "materials" in marks else {}
        fractions = scene.raycast.shares()
        colours = material_colours(materials, scene.basis, shot.rig, shot.spec, fractions)
        picture = MarkedPicture(
            *(self.size, shot.camera, volume, scene.file.title, shot.light, colours),
            annotations=annotations,
            values=value_bars(scene.transfer, volume, scene.basis, shot.rig, shot.spec, fractions)
            if "values" in marks
            else (),
        )
        return picture_marks(marks, picture)

    def encoders(self) -> AbstractContextManager[Encoders]:
        """Return the queue for `put`."""
        bands = self.scene.basis.grid.size if self.table.spectral else 0
        width, height = self.table.frame_size(self.size)
        return Encoders((_COLOUR_BYTES + 2 * bands) * width * height).running()

    def name(self, shot: Shot) -> str:
        """Return the name of a shot's file in the folder."""
        return f"{shot.stem}{self.table.suffix}"

    def put(self, shot: Shot, pixels: Array, notes: Mapping[str, str], encoders: Encoders) -> None:
        """Queue a complete frame: the `FrameSource.pixels` and the image's notes."""
        writer = self._writer(shot, notes)
        if self.table.format == "exr":
            pixels = to_half(pixels)
        encoders.put(self._path(shot), partial(encode, pixels, writer))

    def opened(self, shot: Shot, notes: Mapping[str, str]) -> AbstractContextManager[Writer]:
        """Open a frame's file for rows; it appears when the context ends. Parameters: see `put`."""
        threads = exr.encoding_threads()
        return row_file(self._path(shot), self._writer(shot, notes, threads))

    def _writer(
        self, shot: Shot, notes: Mapping[str, str], threads: int = 1
    ) -> Callable[[BinaryIO], Writer]:
        table, text = self.table, self._text(shot, notes)
        if table.format == "exr":
            return partial(exr.ExrWriter, header=self._header(shot, text), threads=threads)
        size, hdr = table.frame_size(self.size), table.hdr
        if table.format == "avif" and hdr is not None:
            return lambda file: AvifWriter(file, size, table.depth, hdr)
        channels = 4 if table.transparent else 3
        space = hdr or colour_space(shot.spec.viewing.display.space)
        settings: tuple[int, int, ColourSpace | Hdr, Mapping[str, str]]
        settings = (channels, table.depth, space, text)
        return lambda file: PngWriter(file, size, *settings)

    def save(self, shot: Shot, image: CoefficientImage) -> None:
        """Write a coefficient image as `volspec render` does, with the export's lights."""
        recipe = scene_recipe(self.scene, export_lights(self.scene, self.table), shot.spec)
        save_for_compositors(image, self._path(shot), recipe)

    def _path(self, shot: Shot) -> Path:
        return self.folder.path / self.name(shot)

    def _header(self, shot: Shot, text: Mapping[str, str]) -> exr.ExrHeader:
        table, bands = self.table, None
        if table.spectral:
            groups = self.scene.raycast.shares()
            bands = SpectralIllumination.of(self.scene.basis, shot.rig, shot.spec, groups).bands
        return exr.ExrHeader(
            self.size, exr.PRIMARIES[table.primaries], text, table.transparent, bands
        )

    def _text(self, shot: Shot, notes: Mapping[str, str]) -> dict[str, str]:
        """Return the settings of a frame as metadata for its file."""
        spec, samples = shot.spec, self.table.samples
        text = {
            "Title": self.scene.file.title,
            "light": shot.light,
            "camera": repr(shot.camera),
            "transfer": repr(shot.transfer),
            "viewing": repr(spec.viewing),
            "relight": f"mode {spec.mode}, level {spec.level}, backdrop {spec.backdrop}",
            "samples": f"{samples} x {samples}",
            "hdr": repr(self.table.hdr) if self.table.hdr else "",
            "stereo": repr(self.table.stereo) if self.table.stereo else "",
            **{key: notes[key] for key in ("volume", "raycast")},
            **({} if shot.step is None else {"step": str(shot.step)}),
            "depth": repr(shot.look.depth) if shot.look.depth.changes else "",
            "export": self.folder.fingerprint,
            "Software": f"volspec {__version__}",
        }
        return {key: value for key, value in text.items() if value}
