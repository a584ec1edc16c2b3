"""Launch the casting kernels: a volume stays on the device, casts follow.

    volume -> transfer -> [raycast] -> relight -> appearance

The twin is ``volspec/raycast/reference.py``.
"""

from __future__ import annotations

import threading
from contextlib import nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import C_TYPES, prelude
from volspec._gpu.sharing import Sharing
from volspec._gpu.sources import assemble
from volspec.errors import OpenCLError, RaycastError
from volspec.raycast import packed
from volspec.raycast.bands import Bands, Cancel, Progress, Receiver, Result
from volspec.raycast.bricks import (
    BRICK,
    brick_ranges,
    chessboard_leaps,
    opacity_spread,
    straddled_bricks,
    visible_bricks,
)
from volspec.raycast.camera import Camera
from volspec.raycast.checks import check_callable, checked_size
from volspec.raycast.light_volume.gpu import LightVolume
from volspec.raycast.reach import check_reach
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import MAX_CHANNELS, SurfaceTable, Transfer, TransferTable
from volspec.volume import Volume

# Packet shape by LANES, (width, height) in pixels; lanes.clh numbers the lanes row by row.
TILES = {1: (1, 1), 4: (2, 2), 8: (4, 2)}
# Work-items of a group: a packet is one by itself, as a loop over several takes two fifths longer
# to compile and runs no faster.
GROUPS = {1: (8, 8), 4: (1, 1), 8: (1, 1)}
# Codes of bricks from here on are strides (rays.clh).
STRIDES = 248


class Raycaster:
    """A volume on an OpenCL device, ready to be cast; threads take turns.

    Parameters
    ----------
    volume : Volume
    device : str, optional
        Part of a device's name; the first GPU, else the first CPU, when left out.
    lanes : int, optional
        Rays marched together by a work-item: 1, 4 or 8. Default 8 on CPUs, 1 on GPUs.
    context : moderngl.Context, optional
        Current on the thread that casts: the device is made to share its memory, and
        ``raycast(into=…)`` hands pictures to a Relighter of the same context without the host.

    Raises
    ------
    RaycastError
        If an argument is of another type.
    OpenCLError
        If there is no device, the volume does not fit it, or it does not share the context.
    """

    def __init__(
        self,
        volume: Volume,
        *,
        device: str | None = None,
        lanes: int | None = None,
        context: Any = None,
    ) -> None:
        if not isinstance(volume, Volume):
            raise RaycastError.refused("Raycaster: volume", volume, "give a volspec.Volume")
        if context is not None and not hasattr(context, "buffer"):
            raise RaycastError.refused("Raycaster: context", context, "give a moderngl.Context")
        # True and 8.0 are equal to numbers of rays, and are none.
        if lanes is not None and (type(lanes) is not int or lanes not in TILES):
            raise RaycastError.refused(
                "Raycaster: lanes", lanes, f"give one of {sorted(TILES)}", "missing"
            )
        self.volume = volume
        self._compute = Compute.open(device, context)
        self.lanes = lanes or (8 if self._compute.info.is_cpu else 1)
        values = volume.values
        if values.shape[2] < 4:  # the kernel loads four bytes of a row at once
            values = np.pad(values, ((0, 0), (0, 0), (0, 4 - values.shape[2])), mode="edge")
        if values.size > np.iinfo(np.int32).max:
            raise OpenCLError(
                f"{volume.name}: {values.size / 2**30:.1f} Gi voxels; at most 2 Gi can be cast, "
                "take volume.downsampled(2)"
            )
        if not self._compute.info.is_cpu:
            self._compute.require(values.nbytes, volume.name, "take volume.downsampled(2)")
        self._stored_shape = values.shape
        self._voxels = self._compute.upload(values, share=True)
        self._low, self._high = brick_ranges(volume.values)
        whole = self._voxels
        if values is not volume.values:
            whole = self._compute.upload(volume.values, share=True)
        self._lock, self._casting = threading.RLock(), False
        self._whole: bool | None = None  # whether float values are labels
        self._known: tuple[tuple[Any, ...], Any] | None = None
        self._baked: tuple[Transfer, TransferTable | SurfaceTable] | None = None
        self._lights = LightVolume(self._compute, volume, whole)

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._compute.info.name

    @property
    def sharing(self) -> Sharing | None:
        """The OpenGL context that the device shares; None without one."""
        return self._compute.sharing

    def table_of(self, transfer: Transfer) -> TransferTable | SurfaceTable:
        """A transfer function baked for the volume; the last one is kept.

        The light volume knows by the table itself that nothing has changed.
        """
        baked = self._baked
        if baked is None or baked[0] is not transfer:
            baked = self._baked = transfer, transfer.bake(min(self.volume.spacing_mm))
        return baked[1]

    def cast(
        self,
        table: TransferTable | SurfaceTable,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        receiver: Receiver | None = None,
    ) -> Result:
        """Cast a picture.

        Parameters
        ----------
        table : TransferTable or SurfaceTable
            From `table_of`.
        camera : Camera
        size : (width, height)
            Pixels.
        spec : RaycastSpec
        progress : callable, optional
            Called with the finished share, 0…1, after each band of the picture.
        cancel : callable, optional
            Asked between bands, every `RaycastSpec.tile_ms` or so; true ends the cast.
        receiver : Receiver, optional
            Also given each band, on the device; incomplete where the cast fails.

        Returns
        -------
        Result
            Coefficients, alpha and two depths; see there for shapes and units.

        Raises
        ------
        RaycastError
            If the size is not positive, progress or cancel cannot be called, or nothing is left
            to see by crop or table.
        CastCancelled
            If ``cancel`` said so.
        OpenCLError
            If memory does not suffice.
        """
        check_callable("raycast: progress", progress)
        check_callable("raycast: cancel", cancel)
        with self._lock:
            if self._casting:
                raise RaycastError(
                    "raycast: the caster is in the middle of a cast; start the next when "
                    "progress and cancel have returned"
                )
            self._casting = True
            try:
                return self._cast(table, camera, size, spec, progress, cancel, receiver)
            finally:
                self._casting = False

    def _cast(
        self,
        table: TransferTable | SurfaceTable,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None,
        cancel: Cancel | None,
        receiver: Receiver | None,
    ) -> Result:
        width, height = checked_size(size)
        self._check_labels(table)
        check_reach(self.volume, camera, spec)
        if table.size > MAX_CHANNELS:
            raise RaycastError(
                f"raycast: {table.size} channels; at most {MAX_CHANNELS} can be cast"
            )
        layers = len(spec.groups) * table.size
        dtype = np.float16 if spec.half else np.float32
        what = f"a picture of {width}x{height} with {layers} channels"
        remedy = "cast it smaller, with fewer light groups, or with half=True"
        # The picture, and two bands of it under way.
        under_way = min(height, 1024) * layers * 4
        self._compute.require(
            width * (height * (layers * np.dtype(dtype).itemsize + 12) + under_way),
            what,
            remedy,
        )
        struct = packed.cast_struct(self.volume, table, camera, size, spec)
        struct["row"] = self._stored_shape[2]
        struct["slice"] = self._stored_shape[1] * self._stored_shape[2]
        struct["bricks_x"], struct["bricks_y"] = self._low.shape[2], self._low.shape[1]
        program = packed.Program.of(table, spec, spec.step_of(self.volume))
        light, numbers = self._light(struct, table, spec, camera)
        inputs = [
            self._compute.upload(np.ascontiguousarray(array))
            for array in (*program.tables, packed.source_rows(self.volume, camera, spec))
        ]
        try:
            result = Result(
                np.empty((height, width, layers), dtype),
                *(np.empty((height, width), np.float32) for _ in range(3)),
            )
        except MemoryError:
            raise OpenCLError(f"raycast: no memory for {what}; {remedy}", code="size") from None
        kernel = self._kernel(program, spec, numbers)
        arguments = self._voxels, self._codes(table, spec), *inputs, light, struct
        tile, group = TILES[self.lanes], GROUPS[self.lanes]
        with receiver.receiving(self._compute, spec.half) if receiver else nullcontext() as pack:
            bands = Bands(self._compute, result, tile, group, spec.tile_ms, pack)
            bands.run(kernel, arguments, progress, cancel)
        unit = np.float32(min(self.volume.spacing_mm))
        result.depth_mm[...] *= unit
        result.first_mm[...] *= unit
        return result

    def _check_labels(self, table: TransferTable | SurfaceTable) -> None:
        values = self.volume.values
        if not (isinstance(table, TransferTable) and table.labels) or values.dtype.kind != "f":
            return
        if self._whole is None:
            self._whole = all(bool((part == np.rint(part)).all()) for part in values)
        if not self._whole:
            raise RaycastError(
                f"{self.volume.name}: its values are not whole numbers, as labels are; give a "
                "segmentation, or a TransferFunction"
            )

    def _light(
        self,
        struct: NDArray[np.void],
        table: TransferTable | SurfaceTable,
        spec: RaycastSpec,
        camera: Camera,
    ) -> tuple[Any, list[int]]:
        """The light volume's buffer, and each source's layer in it (-1: none)."""
        buffer, grid, layers = self._lights.layers(table, spec, camera)
        struct["light_x"], struct["light_y"], struct["light_z"] = grid.shape_xyz
        struct["light_scale"][:3] = grid.per_index
        struct["light_lift"] = grid.lift_mm / min(self.volume.spacing_mm)
        numbers = [-1] * len(packed.sources_of(spec))
        for number, layer in enumerate(layers):
            numbers[layer.source] = number
        return buffer, numbers

    def _codes(self, table: TransferTable | SurfaceTable, spec: RaycastSpec) -> Any:
        """What is known of each brick, on the device; made anew when opacities have changed."""
        key: tuple[Any, ...] = spec.mode, spec.adaptive
        if isinstance(table, SurfaceTable):
            key += (table.values.tobytes(),)
        else:
            step = spec.step_of(self.volume) / table.reference_step_mm
            key += table.domain, table.labels, step, table.opacity.tobytes()
        if self._known is None or self._known[0] != key:
            codes = np.ascontiguousarray(self._brick_codes(table, spec))
            self._known = key, self._compute.upload(codes)
        return self._known[1]

    def _brick_codes(self, table: TransferTable | SurfaceTable, spec: RaycastSpec) -> NDArray[Any]:
        """By brick what rays.clh wants, or for projections its greatest value."""
        low, high = self._low, self._high
        if spec.mode != "composite":
            return high
        if isinstance(table, SurfaceTable):
            return np.minimum(
                chessboard_leaps(straddled_bricks(low, high, table.values)), STRIDES - 1
            )
        visible = visible_bricks(low, high, table.domain, table.opacity, table.labels)
        codes = np.minimum(chessboard_leaps(visible), STRIDES - 1)
        if spec.adaptive > 0:
            opacity = table.step_opacity(spec.step_of(self.volume))
            spread = opacity_spread(low, high, table.domain, opacity, table.labels)
            codes[visible & (spread < spec.adaptive)] = STRIDES
            codes[visible & (spread < spec.adaptive / 4)] = STRIDES + 1
        return codes

    def _kernel(self, program: packed.Program, spec: RaycastSpec, layers: list[int]) -> Any:
        tile_width, tile_height = TILES[self.lanes]
        constants = {
            "LANES": self.lanes,
            "TILE_WIDTH": tile_width,
            "TILE_HEIGHT": tile_height,
            "BRICK": BRICK,
            "STRIDES": STRIDES,
            "ADAPTIVE": int(spec.adaptive > 0),
            "VOXEL": C_TYPES[self.volume.values.dtype.name],
            "VOXEL_BYTES": self.volume.values.itemsize,
            "VOXEL_SIGNED": int(self.volume.values.dtype.kind == "i"),
            **program.constants,
            **packed.definitions(spec, layers),
        }
        constants["NEIGHBOURS"] = int(constants["NORMALS"] or program.constants["TABLE_ROWS"] > 1)
        steps = 2 if constants["NEIGHBOURS"] else 4
        constants["STEPS"] = steps if self.lanes > 1 else 1
        text = prelude(constants, "opencl") + packed.CAST.declaration
        source = assemble(f"kernels/{program.name}.cl", text)
        return self._compute.kernel(source, program.name)
