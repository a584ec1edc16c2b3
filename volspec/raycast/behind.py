"""Opaque surfaces behind a volume and between its parts, and the volume's opacity for them.

meshes, rooms -> [behind] -> raycast
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.camera import Camera
from volspec.raycast.gpu import Raycaster
from volspec.raycast.light_volume import Clear
from volspec.raycast.lights import HEADLIT
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


class BehindImage(NamedTuple):
    """Picture of surfaces behind a volume."""

    channels: NDArray[np.float32]  # (H, W, K·M) of the last K light groups, times alpha
    alpha: NDArray[np.float32]  # (H, W)
    depth_mm: NDArray[np.float32] | None = None  # (H, W); None if it is not that of the picture


class Behind(Protocol):
    """Opaque surfaces around a volume, such as meshes or a room's."""

    @property
    def clear(self) -> Clear | None:
        """Test of what they keep from the volume, as in `Raycaster.cast`; None if nothing."""

    def depth_mm(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return (H, W) distances from the camera at which rays end; inf where nothing is seen."""

    def __call__(
        self,
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
        stop_mm: NDArray[np.float32],
    ) -> BehindImage:
        """Return the picture of what is seen up to ``stop_mm`` (H, W), in the volume's shadow."""
