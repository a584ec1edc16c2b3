"""Launch the casting kernels: a volume stays on the device, casts follow.

    volume -> transfer -> [raycast] -> relight -> appearance

The twin is ``volspec/raycast/reference.py``.
"""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import assemble
from volspec.errors import CastCancelled, OpenCLError, RaycastError
from volspec.raycast import packed
from volspec.raycast.camera import Camera
from volspec.raycast.light_volume.gpu import LightVolume
from volspec.raycast.light_volume.spec import light_layers
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import MAX_CHANNELS, SurfaceTable, TransferTable
from volspec.volume import Volume
from volspec.volume.bricks import (
    BRICK,
    brick_ranges,
    chessboard_leaps,
    opacity_spread,
    straddled_bricks,
    visible_bricks,
)

Progress = Callable[[float], object]
Cancel = Callable[[], bool]

# Packet shape by LANES, (width, height) in pixels; lanes.clh numbers the lanes row by row.
TILES = {1: (1, 1), 4: (2, 2), 8: (4, 2)}
LOCAL = (8, 8)
# Codes of bricks from here on are strides (rays.clh).
STRIDES = 248
MAX_SIDE = 16384
_VOXEL_TYPES = {"uint8": "uchar", "uint16": "ushort", "int16": "short", "float32": "float"}
_OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable", "-cl-no-signed-zeros", "-w")
# The first launch of a cast, in rows of work-groups, before any has been timed.
_FIRST_ROWS = 2


class Result(NamedTuple):
    """What a cast gathers.

    ``coefficients`` (H, W, L·M) premultiplied by opacity, layer after layer; ``alpha`` (H, W);
    ``depth_mm`` (H, W) expected distance from the camera of what is seen, and ``first_mm`` (H, W)
    where it is first hit; both inf where nothing is.
    """

    coefficients: NDArray[np.floating]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    first_mm: NDArray[np.float32]


class Raycaster:
    """A volume on an OpenCL device, ready to be cast.

    Parameters
    ----------
    volume : Volume
    device : str, optional
        Part of a device's name; the first GPU, else the first CPU, when left out.
    lanes : int, optional
        Rays marched together by a work-item: 1, 4 or 8. Default 8 on CPUs, 1 on GPUs.

    Raises
    ------
    OpenCLError
        If there is no device, or the volume does not fit it.
    """

    def __init__(
        self, volume: Volume, *, device: str | None = None, lanes: int | None = None
    ) -> None:
        self.volume = volume
        self._compute = Compute.open(device)
        self.lanes = lanes or (8 if self._compute.info.is_cpu else 1)
        if self.lanes not in TILES:
            raise RaycastError(f"raycast: lanes is {lanes}; give one of {sorted(TILES)}")
        values = volume.values
        if values.size > np.iinfo(np.int32).max:
            raise OpenCLError(
                f"{volume.name}: {values.size / 2**30:.1f} Gi voxels; at most 2 Gi can be cast, "
                "take volume.downsampled(2)"
            )
        if values.shape[2] < 4:  # the kernel loads four bytes of a row at once
            values = np.pad(values, ((0, 0), (0, 0), (0, 4 - values.shape[2])), mode="edge")
        if not self._compute.info.is_cpu:
            self._compute.require(values.nbytes, volume.name, "take volume.downsampled(2)")
        self._stored_shape = values.shape
        self._voxels = self._compute.upload(values, share=True)
        self._low, self._high = brick_ranges(volume.values)
        whole = self._voxels
        if values is not volume.values:
            whole = self._compute.upload(volume.values, share=True)
        self._lights = LightVolume(self._compute, volume, whole)

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._compute.info.name

    def cast(
        self,
        table: TransferTable | SurfaceTable,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> Result:
        """Cast a picture.

        Parameters
        ----------
        size : (width, height)
            Pixels.
        progress : callable, optional
            Called with the finished share, 0…1, after each band of the picture.
        cancel : callable, optional
            Asked between bands, every `RaycastSpec.tile_ms` or so; true ends the cast.

        Raises
        ------
        RaycastError
            If the size is not positive, or nothing is left to see by crop or table.
        CastCancelled
            If ``cancel`` said so.
        OpenCLError
            If memory does not suffice.
        """
        width, height = _checked_size(size)
        if table.size > MAX_CHANNELS:
            raise RaycastError(
                f"raycast: {table.size} channels; at most {MAX_CHANNELS} can be cast"
            )
        layers = len(spec.groups) * table.size
        dtype = np.float16 if spec.half else np.float32
        self._compute.require(
            width * height * (layers * np.dtype(dtype).itemsize + 12),
            f"a picture of {width}x{height} with {layers} channels",
            "cast it smaller, with fewer light groups, or with half=True",
        )
        struct = packed.cast_struct(self.volume, table, camera, size, spec)
        struct["row"] = self._stored_shape[2]
        struct["slice"] = self._stored_shape[1] * self._stored_shape[2]
        struct["bricks_x"], struct["bricks_y"] = self._low.shape[2], self._low.shape[1]
        program = packed.Program.of(table, spec, spec.step_of(self.volume))
        light, numbers = self._light(struct, table, spec, camera)
        inputs = [
            self._compute.upload(np.ascontiguousarray(array))
            for array in (
                self._codes(table, spec),
                program.opacity,
                program.shares,
                program.channels,
                program.filters,
                packed.source_rows(self.volume, camera, spec),
            )
        ]
        result = Result(
            np.empty((height, width, layers), dtype),
            *(np.empty((height, width), np.float32) for _ in range(3)),
        )
        bands = _Bands(self._compute, result, TILES[self.lanes], spec.tile_ms)
        kernel = self._kernel(program, spec, numbers)
        bands.run(kernel, (self._voxels, *inputs, light, struct), progress, cancel)
        unit = np.float32(min(self.volume.spacing_mm))
        result.depth_mm[...] *= unit
        result.first_mm[...] *= unit
        return result

    def _light(
        self,
        struct: NDArray[np.void],
        table: TransferTable | SurfaceTable,
        spec: RaycastSpec,
        camera: Camera,
    ) -> tuple[Any, list[int]]:
        """The light volume's buffer, and each source's layer in it (-1: none)."""
        wanted = [(layer.group, layer.source) for layer in light_layers(spec, self.volume, camera)]
        buffer, grid, _ = self._lights.layers(table, spec, camera)
        struct["light_x"], struct["light_y"], struct["light_z"] = grid.shape_xyz
        struct["light_scale"][:3] = grid.per_index
        places = [(g, s) for g, group in enumerate(spec.groups) for s in range(len(group.sources))]
        return buffer, [wanted.index(place) if place in wanted else -1 for place in places]

    def _codes(self, table: TransferTable | SurfaceTable, spec: RaycastSpec) -> NDArray[Any]:
        """What is known of each brick: rays.clh, or its greatest value."""
        low, high = self._low, self._high
        if spec.mode != "composite":
            return high
        if isinstance(table, SurfaceTable):
            return np.minimum(
                chessboard_leaps(straddled_bricks(low, high, table.values)), STRIDES - 1
            )
        visible = visible_bricks(low, high, table.domain, table.opacity)
        codes = np.minimum(chessboard_leaps(visible), STRIDES - 1)
        if spec.adaptive > 0:
            opacity = table.step_opacity(spec.step_of(self.volume))
            spread = opacity_spread(low, high, table.domain, opacity)
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
            "VOXEL": _VOXEL_TYPES[self.volume.values.dtype.name],
            "VOXEL_BYTES": self.volume.values.itemsize,
            "VOXEL_SIGNED": int(self.volume.values.dtype.kind == "i"),
            **program.constants,
            **packed.definitions(spec, layers),
        }
        source = assemble(f"kernels/{program.name}.cl", prelude(constants, "opencl"))
        return self._compute.kernel(source, program.name, _OPTIONS)


class _Bands:
    """A picture cast band by band: no launch takes long, and none waits for the host.

    Two bands are under way at any time; each one's height follows from how long the last took.
    """

    def __init__(
        self, compute: Compute, result: Result, tile: tuple[int, int], tile_ms: float
    ) -> None:
        self._compute = compute
        self._result = result
        self._tile = tile
        self._tile_ms = tile_ms
        height, width = result.alpha.shape
        self._columns = -(-width // (tile[0] * LOCAL[0])) * LOCAL[0]
        self._group_rows = -(-height // (tile[1] * LOCAL[1]))

    def run(
        self,
        kernel: Any,
        arguments: tuple[Any, ...],
        progress: Progress | None,
        cancel: Cancel | None,
    ) -> None:
        """Launch and fetch every band; see `Raycaster.cast`."""
        under_way: deque[tuple[int, int, Any, list[Any]]] = deque()
        row, rows, began = 0, _FIRST_ROWS, time.perf_counter()
        try:
            while row < self._group_rows or under_way:
                if cancel is not None and cancel():
                    raise CastCancelled("raycast: cancelled")
                while row < self._group_rows and len(under_way) < 2:
                    last = min(row + rows, self._group_rows)
                    under_way.append(self._launch(kernel, arguments, row, last))
                    row = last
                first, last, done, buffers = under_way.popleft()
                done.wait()
                took = 1e3 * (time.perf_counter() - began)
                began = time.perf_counter()
                wanted = (last - first) * self._tile_ms / max(took, 1e-3)
                rows = int(np.clip(wanted, max(1, rows // 2), 4 * rows))
                self._fetch(first, last, buffers)
                if progress is not None:
                    progress(last / self._group_rows)
        finally:
            self._compute.queue.finish()

    def _launch(
        self, kernel: Any, arguments: tuple[Any, ...], first: int, last: int
    ) -> tuple[int, int, Any, list[Any]]:
        lines = self._lines(first, last)
        buffers = [
            self._compute.output(
                (lines.stop - lines.start) * array[0].size * np.dtype(np.float32).itemsize
            )
            for array in self._result
        ]
        done = kernel(
            self._compute.queue,
            (self._columns, (last - first) * LOCAL[1]),
            LOCAL,
            *arguments,
            *buffers,
            np.int32(first * LOCAL[1]),
        )
        self._compute.queue.flush()
        return first, last, done, buffers

    def _lines(self, first: int, last: int) -> slice:
        group = LOCAL[1] * self._tile[1]
        return slice(first * group, min(last * group, len(self._result.alpha)))

    def _fetch(self, first: int, last: int, buffers: list[Any]) -> None:
        lines = self._lines(first, last)
        for buffer, array in zip(buffers, self._result, strict=True):
            if array.dtype == np.float32:
                self._compute.download(buffer, array[lines])
            else:
                full = np.empty(array[lines].shape, np.float32)
                self._compute.download(buffer, full)
                array[lines] = full


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise RaycastError(
            f"raycast: size is {size!r:.40}; give (width, height) in whole pixels"
        ) from None
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise RaycastError(
            f"raycast: the picture is {width}x{height}; give 1x1 to {MAX_SIDE}x{MAX_SIDE}"
        )
    return width, height
