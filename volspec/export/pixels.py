"""What stands in a frame's pixels: codes of a display, or linear light; with opacity or without.

coefficient image, shot -> [pixels] -> png | exr
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.curves import Transfer
from volspec.appearance.profile import D50_from_white
from volspec.appearance.spaces import SPACES, ColourSpace, space_of
from volspec.appearance.srgb import to_uint8
from volspec.errors import ViewingError
from volspec.export.frames import to_uint16
from volspec.export.plan import Shot
from volspec.raycast import CoefficientImage
from volspec.relight import Relighter
from volspec.relight.adapted import Adapting
from volspec.relight.illumination import Illumination
from volspec.scene.export import ExportTable

Array = NDArray[Any]

_LINEAR = Transfer.gamma(1.0)
_ACES_WHITE_XY = (0.32168, 0.33767)
PRIMARIES: Mapping[str, ColourSpace] = MappingProxyType(
    {
        "Rec. 709": replace(SPACES["Rec. 709"], transfer=_LINEAR),
        # SMPTE ST 2065-1 and the Academy's S-2014-004.
        "ACES AP0": ColourSpace(
            *("ACES AP0", ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077))),
            *(_ACES_WHITE_XY, _LINEAR),
        ),
        "ACES AP1": ColourSpace(
            *("ACES AP1", ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044))),
            *(_ACES_WHITE_XY, _LINEAR),
        ),
    }
)
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
        """(H, W, 3 or 4) as the file holds them.

        Codes, uint8 or uint16, opacity not multiplied in; or linear float32, multiplied in.

        Parameters
        ----------
        relighter : Relighter
            Of `image`.
        shot : Shot
        """
        table = self.table
        if table.format == "exr":
            linear = self._linear(relighter, shot)
            return self._joined(linear * self._cover[..., None] if table.transparent else linear)
        spec = shot.spec
        shown = spec.viewing, spec.mode, spec.backdrop, spec.level
        if table.bits == 8 and not table.transparent:
            return relighter.frame(shot.rig, *shown)
        codes = relighter.frame(shot.rig, *shown, dtype=np.float32)
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
            light = Illumination.of(self.image.basis, shot.rig, spec, self.image.groups)
            matrix = to.RGB_from_XYZ @ XYZ_adapted(PRIMARIES["Rec. 709"], to)
            # Light and white are not parted: the matrix is one of channels.
            both = replace(
                light,
                XYZ_from_channels=matrix @ light.XYZ_from_channels,
                backdrop_XYZ=matrix @ light.backdrop_XYZ,
            )
            return both.scene_XYZ(self.image.coefficients, self.image.alpha).astype(np.float32)
        shown = spec.viewing, spec.mode, spec.backdrop, spec.level
        codes = relighter.frame(shot.rig, *shown, dtype=np.float32)
        space = space_of(spec.viewing.display.space)
        matrix = to.RGB_from_XYZ @ XYZ_adapted(space, to) @ space.XYZ_from_RGB
        return (space.decode(codes) @ matrix.T).astype(np.float32)


def XYZ_adapted(space: ColourSpace, to: ColourSpace) -> Array:
    """(3, 3): XYZ beside one space's white to XYZ beside another's (Bradford)."""
    if space.white_xy == to.white_xy:
        return np.eye(3)
    return np.asarray(
        np.linalg.solve(D50_from_white(to.white_XYZ / 100.0), D50_from_white(space.white_XYZ / 100))
    )


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
    viewing, _ = Adapting().seen(image, light, spec.viewing)
    return replace(shot, spec=replace(spec, viewing=viewing))


def check_viewing(table: ExportTable, adapting: str, parts: int) -> None:
    """Refuse an eye that adapts to each pixel of a picture that is never there as a whole.

    Raises
    ------
    ViewingError
    """
    if adapting != "pixel" or (not table.transparent and parts == 1):
        return
    why = "has no backdrop" if table.transparent else "is relit in parts"
    raise ViewingError(
        f"export: adapting is 'pixel', which looks at all of the picture, and that {why}; take "
        "'picture' or 'given'"
    )
