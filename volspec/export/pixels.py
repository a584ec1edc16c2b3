"""What stands in a frame's pixels: codes of a display, or linear light; with opacity or without.

coefficient image, shot -> [pixels] -> png | exr
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.spaces import space_of
from volspec.appearance.srgb import to_uint8
from volspec.errors import ViewingError
from volspec.export.frames import to_uint16
from volspec.export.plan import Shot
from volspec.export.primaries import PRIMARIES, XYZ_adapted
from volspec.export.spectral import SpectralIllumination
from volspec.export.tiles import row_strips
from volspec.raycast import CoefficientImage
from volspec.relight import Relighter
from volspec.relight.adapted import Adapting
from volspec.relight.illumination import Illumination
from volspec.scene.export import ExportTable

Array = NDArray[Any]

# Below this opacity a pixel's own colour is rounding.
_LEAST_ALPHA = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Pane:
    """A coefficient image ready to be relit for a kind of file.

    Parameters
    ----------
    image : CoefficientImage
        Of a transparent frame that of the surfaces alone, nothing shining through.
    alpha : (H, W) float32
        Opacity as cast.
    table : ExportTable
    """

    image: CoefficientImage
    alpha: NDArray[np.float32]
    table: ExportTable

    @classmethod
    def of(cls, image: CoefficientImage, table: ExportTable) -> Pane:
        """An image as the table's files need it."""
        alpha = np.asarray(image.alpha)
        if not table.transparent:
            return cls(image, alpha, table)
        own = (
            np.asarray(image.coefficients, np.float32) / np.maximum(alpha, _LEAST_ALPHA)[..., None]
        )
        own[alpha < _LEAST_ALPHA] = 0.0
        return cls(replace(image, coefficients=own, alpha=np.ones_like(alpha)), alpha, table)

    def pixels(self, relighter: Relighter, shot: Shot) -> Array:
        """(H, W, C) as the file holds them.

        Codes, uint8 or uint16, opacity not multiplied in; or linear float32, multiplied in; or
        half floats with a spectrum behind red, green and blue.

        Parameters
        ----------
        relighter : Relighter
            Of `image`.
        shot : Shot
        """
        table = self.table
        if table.spectral:
            given = self.image.basis, shot.rig, shot.spec, self.image.groups
            return np.concatenate([*SpectralIllumination.of(*given).strips(self.image)])
        if table.format == "exr":
            linear = self._linear(relighter, shot)
            return self._joined(linear * self._cover[..., None] if table.transparent else linear)
        if table.bits == 8 and not table.transparent:
            return relighter.frame(shot.rig, shot.spec)
        codes = relighter.frame(shot.rig, shot.spec, dtype=np.float32)
        joined = self._joined(codes)
        rounded = to_uint16(joined) if table.bits == 16 else to_uint8(joined)
        if table.transparent:
            rounded[rounded[..., 3] == 0] = 0  # what is not there has no colour
        return rounded

    @property
    def _cover(self) -> NDArray[np.float32]:
        return np.where(self.alpha < _LEAST_ALPHA, np.float32(0.0), self.alpha)

    def _joined(self, colours: Array) -> Array:
        if not self.table.transparent:
            return colours
        own = np.where(self._cover[..., None] > 0.0, colours, 0.0)
        return np.dstack([own, self._cover]).astype(np.float32)

    def _linear(self, relighter: Relighter, shot: Shot) -> Array:
        spec, to = shot.spec, PRIMARIES[self.table.primaries]
        if self.table.shows == "scene":
            lit = Illumination.of(self.image.basis, shot.rig, spec, self.image.groups)
            matrix = to.RGB_from_XYZ @ XYZ_adapted(PRIMARIES["Rec. 709"], to)
            # Light and white are not parted: the matrix is one of channels.
            both = replace(
                lit,
                XYZ_from_channels=matrix @ lit.XYZ_from_channels,
                backdrop_XYZ=matrix @ lit.backdrop_XYZ,
            )
            image, light = self.image, np.empty((*self.alpha.shape, 3), np.float32)
            for rows in row_strips(image.size, image.coefficients.shape[2]):
                light[rows] = both.scene_XYZ(image.coefficients[rows], image.alpha[rows])
            return light
        codes = relighter.frame(shot.rig, shot.spec, dtype=np.float32)
        space = space_of(spec.viewing.display.space)
        matrix = to.RGB_from_XYZ @ XYZ_adapted(space, to) @ space.XYZ_from_RGB
        return (space.decode(codes) @ matrix.T).astype(np.float32)


def measured(shot: Shot, image: CoefficientImage) -> Shot:
    """A shot whose eye is adapted to an opaque picture of all that is seen.

    Parameters
    ----------
    shot : Shot
        Its viewing asks for ``adapting = "picture"``.
    image : CoefficientImage
        The whole picture, which may be smaller.
    """
    spec = shot.spec
    light = Illumination.of(image.basis, shot.rig, spec, image.groups)
    found, _ = Adapting().measured(image, light)
    viewing = replace(spec.viewing, adapting="given", Y_b=found.Y_b, L_A=found.L_A)
    return replace(shot, spec=replace(spec, viewing=viewing))


def check_viewing(table: ExportTable, adapting: str, parts: int) -> None:
    """Refuse an eye that adapts to each pixel of a picture that is never there as a whole.

    Raises
    ------
    ViewingError
    """
    if adapting != "pixel" or not table.has_eye or (not table.transparent and parts == 1):
        return
    why = "has no backdrop" if table.transparent else "is relit in parts"
    raise ViewingError(
        f"export: adapting is 'pixel', which looks at all of the picture, and that {why}; take "
        "'picture' or 'given'"
    )
