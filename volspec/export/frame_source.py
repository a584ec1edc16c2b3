"""Pixels of frames as their files hold them: display codes or linear light, opaque or not.

coefficient image, shot -> [frame_source] -> PNG | EXR
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import colour_space
from volspec.appearance.spaces import to_uint8
from volspec.errors import ViewingError
from volspec.export.exr import PRIMARIES, white_adaptation
from volspec.export.frames import to_uint16
from volspec.export.plan import Shot
from volspec.export.spectral import SpectralIllumination
from volspec.export.tiles import row_strips
from volspec.raycast import CoefficientImage
from volspec.relight import Relighter
from volspec.relight.illumination import Illumination
from volspec.relight.measured_viewing import ViewingMeter
from volspec.scene.export import ExportSpec

Array = NDArray[Any]

# Below this opacity a pixel's own colour is rounding error.
_LEAST_ALPHA = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class FrameSource:
    """A coefficient image prepared for a kind of file."""

    # For transparent frames the surfaces alone, with nothing shining through.
    image: CoefficientImage
    alpha: NDArray[np.float32]  # (H, W) float32: Opacity as cast
    table: ExportSpec

    @classmethod
    def of(cls, image: CoefficientImage, table: ExportSpec) -> FrameSource:
        """Prepare an image for the table's files."""
        alpha = np.asarray(image.alpha)
        if not table.transparent:
            return cls(image, alpha, table)
        coefficients = np.asarray(image.coefficients, np.float32)
        own = coefficients / np.maximum(alpha, _LEAST_ALPHA)[..., None]
        own[alpha < _LEAST_ALPHA] = 0.0
        return cls(replace(image, coefficients=own, alpha=np.ones_like(alpha)), alpha, table)

    def pixels(self, relighter: Relighter, shot: Shot) -> Array:
        """Return (H, W, C) as the file holds them; the relighter holds `image`.

        Display codes, uint8 or uint16, with straight alpha; or linear float32, premultiplied; or
        half floats with a spectrum after red, green and blue.
        """
        table = self.table
        if table.spectral:
            lit = SpectralIllumination.of(self.image.basis, shot.rig, shot.spec, self.image.groups)
            return np.concatenate([*lit.strips(self.image)])
        if table.format == "exr":
            linear = self._linear(relighter, shot)
            return self._with_alpha(
                linear * self._cover[..., None] if table.transparent else linear
            )
        if table.bits == 8 and not table.transparent:
            return relighter.frame(shot.rig, shot.spec)
        codes = self._with_alpha(relighter.frame(shot.rig, shot.spec, dtype=np.float32))
        rounded = to_uint16(codes) if table.bits == 16 else to_uint8(codes)
        if table.transparent:
            rounded[rounded[..., 3] == 0] = 0  # a fully transparent pixel has no colour
        return rounded

    @property
    def _cover(self) -> NDArray[np.float32]:
        return np.where(self.alpha < _LEAST_ALPHA, np.float32(0.0), self.alpha)

    def _with_alpha(self, colours: Array) -> Array:
        if not self.table.transparent:
            return colours
        own = np.where(self._cover[..., None] > 0.0, colours, 0.0)
        return np.dstack([own, self._cover]).astype(np.float32)

    def _linear(self, relighter: Relighter, shot: Shot) -> Array:
        spec, to = shot.spec, PRIMARIES[self.table.primaries]
        if self.table.shows == "scene":
            lit = Illumination.of(self.image.basis, shot.rig, spec, self.image.groups)
            matrix = to.RGB_from_XYZ @ white_adaptation(PRIMARIES["Rec. 709"], to)
            # From channels to the file's primaries in one matrix.
            to_file = replace(
                lit,
                XYZ_from_channels=matrix @ lit.XYZ_from_channels,
                backdrop_XYZ=matrix @ lit.backdrop_XYZ,
            )
            image, light = self.image, np.empty((*self.alpha.shape, 3), np.float32)
            for rows in row_strips(image.size, image.coefficients.shape[2]):
                light[rows] = to_file.scene_XYZ(image.coefficients[rows], image.alpha[rows])
            return light
        codes = relighter.frame(shot.rig, shot.spec, dtype=np.float32)
        space = colour_space(spec.viewing.display.space)
        matrix = to.RGB_from_XYZ @ white_adaptation(space, to) @ space.XYZ_from_RGB
        return (space.decode(codes) @ matrix.T).astype(np.float32)


class RelighterPool:
    """Relighters of the images at hand, a context manager: reused for images of equal shapes."""

    def __init__(self) -> None:
        self._held: list[tuple[FrameSource, Relighter]] = []

    def row(self, sources: Sequence[FrameSource], shot: Shot) -> Array:
        """Return the pixels of adjacent images under a shot's light."""
        if [source for source, _ in self._held] != list(sources):
            self._load(sources)
        return np.hstack([source.pixels(relighter, shot) for source, relighter in self._held])

    def _load(self, sources: Sequence[FrameSource]) -> None:
        held = [source.image.coefficients.shape for source, _ in self._held]
        if held == [source.image.coefficients.shape for source in sources]:
            relighters = [relighter for _, relighter in self._held]
            for source, relighter in zip(sources, relighters, strict=True):
                relighter.update(source.image)
        else:
            self.close()
            # Exact: with a table, pixels would depend on the frames before.
            relighters = [Relighter(source.image, lut3d=False) for source in sources]
        self._held = list(zip(sources, relighters, strict=True))

    def close(self) -> None:
        """Release the relighters."""
        for _, relighter in self._held:
            relighter.close()
        self._held = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def measured_shot(shot: Shot, image: CoefficientImage) -> Shot:
    """Return a shot with the adaptation measured in its whole picture, which may be smaller."""
    spec = shot.spec
    light = Illumination.of(image.basis, shot.rig, spec, image.groups)
    found, _ = ViewingMeter().measure_viewing(image, light)
    viewing = replace(spec.viewing, adapting="given", Y_b=found.Y_b, L_A=found.L_A)
    return replace(shot, spec=replace(spec, viewing=viewing))


def check_adapting(table: ExportSpec, adapting: str, parts: int) -> None:
    """Refuse local adaptation to a picture that is never in memory as a whole."""
    if adapting != "pixel" or not table.has_eye or (not table.transparent and parts == 1):
        return
    why = "has no backdrop" if table.transparent else "is relit in parts"
    raise ViewingError(
        f"export: adapting is 'pixel', which needs the whole picture, and that {why}",
        "take 'picture' or 'given'",
        code="conflict",
    )
