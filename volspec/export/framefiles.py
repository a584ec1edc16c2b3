"""The files of an export's frames: what each is called and says, made whole or row by row.

shot, pixels -> [framefiles] -> png | exr | coefficient image
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from volspec import __version__
from volspec._exr import to_half
from volspec.appearance.spaces import space_of
from volspec.export.compositing import save_for_compositors, scene_recipe
from volspec.export.encoders import Encoders
from volspec.export.exr import ExrHeader, ExrWriter, exr_bytes, exr_file
from volspec.export.frames import png_bytes, png_file
from volspec.export.manifest import Folder
from volspec.export.pixels import Array
from volspec.export.plan import Shot, lights_of
from volspec.export.png import PngWriter
from volspec.export.primaries import PRIMARIES
from volspec.export.spectral import SpectralIllumination
from volspec.raycast import CoefficientImage
from volspec.scene import Scene
from volspec.scene.export import ExportTable

# Of red, green, blue and opacity as half floats, or in 16 bits.
_COLOUR_BYTES = 8


@dataclass(frozen=True, slots=True, eq=False)
class FrameFiles:
    """The files of a folder.

    Parameters
    ----------
    scene : Scene
    folder : Folder
    table : ExportTable
    size : (width, height)
    """

    scene: Scene
    folder: Folder
    table: ExportTable
    size: tuple[int, int]

    def encoders(self) -> Encoders:
        """Where `put` leaves frames; a context manager."""
        bands = self.scene.basis.grid.size if self.table.spectral else 0
        return Encoders((_COLOUR_BYTES + 2 * bands) * self.size[0] * self.size[1])

    def name(self, shot: Shot) -> str:
        """Of a shot's file, in the folder."""
        return f"{shot.stem}{self.table.suffix}"

    def put(self, shot: Shot, pixels: Array, cast: Mapping[str, str], encoders: Encoders) -> None:
        """Have a whole frame encoded and written soon.

        Parameters
        ----------
        shot : Shot
        pixels : (H, W, C) array
            As `Pane.pixels`.
        cast : {str: str}
            What the cast has noted.
        encoders : Encoders
        """
        text = self._text(shot, cast)
        if self.table.format == "exr":
            encode = partial(exr_bytes, to_half(pixels), self._header(shot, text))
        else:
            colours = space_of(shot.spec.viewing.display.space)
            encode = partial(png_bytes, pixels, text, colours)
        encoders.put(self._path(shot), encode)

    @contextmanager
    def opened(self, shot: Shot, cast: Mapping[str, str]) -> Iterator[PngWriter | ExrWriter]:
        """A frame's file that takes rows; whole when the body is done. Parameters as of `put`."""
        path, table, text = self._path(shot), self.table, self._text(shot, cast)
        if table.format == "exr":
            with exr_file(path, self._header(shot, text)) as file:
                yield file
            return
        channels = 4 if table.transparent else 3
        colours = space_of(shot.spec.viewing.display.space)
        with png_file(path, self.size, channels, table.bits, text, colours) as rows:
            yield rows

    def save(self, shot: Shot, image: CoefficientImage) -> None:
        """Write a coefficient image, as `volspec render` does, with the export's lights."""
        lights = lights_of(self.scene, self.table)
        recipe = scene_recipe(self.scene, lights, shot.spec)
        save_for_compositors(image, self._path(shot), recipe)

    def _path(self, shot: Shot) -> Path:
        return self.folder.path / self.name(shot)

    def _header(self, shot: Shot, text: Mapping[str, str]) -> ExrHeader:
        table, bands = self.table, None
        if table.spectral:
            shares = self.scene.raycast.shares()
            lit = SpectralIllumination.of(self.scene.basis, shot.rig, shot.spec, shares)
            bands = lit.bands
        return ExrHeader(self.size, PRIMARIES[table.primaries], text, table.transparent, bands)

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
