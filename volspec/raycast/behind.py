"""Surfaces behind a volume and between its parts, and the volume's opacity for them.

meshes, rooms -> [behind] -> raycast
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.camera import Camera
from volspec.raycast.gpu import Raycaster
from volspec.raycast.image import CoefficientImage
from volspec.raycast.light_volume import Arrives, Clear
from volspec.raycast.lights import HEADLIT
from volspec.raycast.row_batches import Progress
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable


@dataclass(frozen=True, slots=True, eq=False)
class OpacityCaster:
    """Casts of a volume's opacity alone, such as from a light: its shadow."""

    caster: Raycaster
    table: TransferTable | SurfaceTable
    spec: RaycastSpec

    @property
    def _flat(self) -> RaycastSpec:
        flat = replace(self.spec, ambient=1.0, diffuse=0.0, specular=0.0)
        return replace(flat, groups=HEADLIT, half=False)

    @property
    def key(self) -> object:
        """Value that is equal for equal opacities."""
        table = self.table
        if isinstance(table, SurfaceTable):
            return self._flat, table.values.tobytes(), table.opacity.tobytes()
        filters = None if table.filters is None else table.filters.tobytes()
        scale = table.domain, table.reference_step_mm, table.gradient_top, table.labels
        return self._flat, scale, table.opacity.tobytes(), filters

    def __call__(
        self, camera: Camera, size: tuple[int, int]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the opacity (H, W) that a camera sees, and its expected distance, mm."""
        cast = self.caster.cast(self.table, camera, size, self._flat)
        return cast.alpha, cast.depth_mm

    def arrivals(self, camera: Camera, clear: Clear) -> dict[int, Arrives]:
        """Return the part of each source's light that the volume lets pass; see `Raycaster`."""
        return self.caster.arrivals(self.table, self.spec, camera, clear)


class BehindImage(NamedTuple):
    """Picture of surfaces behind a volume."""

    channels: NDArray[np.float32]  # (H, W, K·M) of the last K light groups, times alpha
    alpha: NDArray[np.float32]  # (H, W)
    depth_mm: NDArray[np.float32] | None = None  # (H, W); None if it is not that of the picture


class Behind(Protocol):
    """Surfaces around and in a volume, such as meshes or a room's; opaque, unless they say so."""

    @property
    def clear(self) -> Clear | None:
        """Return the light they let pass, as for `Raycaster.cast`; None if all."""
        return None

    def depth_mm(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return (H, W) distances from the camera at which rays end; inf where nothing is seen."""

    def __call__(
        self,
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
        stop_mm: NDArray[np.float32],
    ) -> BehindImage:
        """Return opaque surfaces up to ``stop_mm`` (H, W), in the volume's shadow."""

    def sheets(
        self,
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
        stop_mm: NDArray[np.float32],
    ) -> Sequence[BehindImage]:
        """Return pictures of translucent surfaces in front of ``stop_mm``, front to back."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Pictures of the surfaces around and in a volume, for one camera.

    Rays are cast from sheet to sheet; `over` is associative, so the parts are composited after.
    """

    opaque: Sequence[BehindImage]
    sheets: Sequence[BehindImage]
    stop_mm: NDArray[np.float32] | None
    clear: Clear | None
    projected: bool

    @classmethod
    def of(
        cls,
        behind: Sequence[Behind],
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
    ) -> Surfaces:
        """Return the pictures of surfaces; see `volspec.raycast`."""
        if not behind:
            return cls((), (), None, None, projected=False)
        stop_mm = np.minimum.reduce([each.depth_mm(camera, size) for each in behind])
        clear = next((each.clear for each in behind if each.clear is not None), None)
        given = camera, size, opacity, stop_mm
        sheets = [sheet for each in behind for sheet in each.sheets(*given)]
        opaque = [each(*given) for each in behind]
        return cls(opaque, sheets, stop_mm, clear, opacity.spec.mode != "composite")

    def spans(
        self, progress: Progress | None
    ) -> Iterator[tuple[Progress | None, NDArray[np.float32] | None]]:
        """Yield the progress and the ``span_mm`` of each cast, front to back."""
        if self.stop_mm is None:
            yield progress, None
            return
        # A projection has no depth: what is translucent is in front of it.
        ends = [] if self.projected else [_depth(sheet) for sheet in self.sheets]
        begin = np.zeros_like(self.stop_mm)
        for number, end in enumerate((*ends, self.stop_mm)):
            end = np.minimum(end, self.stop_mm)
            yield _part(progress, number, len(ends) + 1), np.stack([begin, end], axis=2)
            begin = end

    def composite(self, images: Sequence[CoefficientImage]) -> CoefficientImage:
        """Return the picture of the casts between sheets, front to back, with all surfaces."""
        image, *later = images
        parts: list[tuple[Any, ...]] = [*self.sheets]
        if later:
            for number, each in enumerate(later):
                part = each.coefficients, each.alpha, each.depth_mm, each.first_mm
                parts.insert(2 * number + 1, part)
        elif parts:  # in front of a projection
            parts.append((image.coefficients, image.alpha, image.depth_mm, image.first_mm))
            image = image.emptied()
        for piece in (*parts, *self.opaque):
            image = image.before(*piece)
        return image


def _depth(sheet: BehindImage) -> NDArray[np.float32]:
    assert sheet.depth_mm is not None
    return sheet.depth_mm


def _part(progress: Progress | None, number: int, count: int) -> Progress | None:
    """Return the progress of one of several casts."""
    if progress is None or count == 1:
        return progress
    return lambda fraction: progress((number + fraction) / count)
