"""Launch ``kernels/raycast.cl``: a volume stays on the device, casts follow.

    volume -> transfer -> [raycast] -> relight -> appearance

The twin is ``volspec/raycast/reference.py``.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import assemble
from volspec.errors import OpenCLError, RaycastError
from volspec.raycast.spec import Camera, RaycastSpec
from volspec.transfer import MAX_CHANNELS, TransferTable
from volspec.volume import Volume
from volspec.volume.bricks import BRICK, brick_ranges, leap_distances

Progress = Callable[[float], None]
Result = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]

# Packet shape by LANES, (width, height) in pixels; lanes.clh numbers the lanes row by row.
TILES = {1: (1, 1), 4: (2, 2), 8: (4, 2)}
_VOXEL_TYPES = {"uint8": "uchar", "uint16": "ushort", "int16": "short", "float32": "float"}
# The struct Cast of the kernel, field for field.
_CAST = np.dtype(
    [
        (name, np.float32, 4)
        for name in (
            *("target", "forward", "across", "down"),
            *("index_x", "index_y", "index_z", "top", "shade"),
        )
    ]
    + [
        (name, np.float32)
        for name in (
            *("middle_x", "middle_y", "distance", "perspective", "phase", "start"),
            *("domain_low", "domain_scale", "last_entry", "step", "opaque"),
            *("gradient_scale", "gradient_floor_squared"),
        )
    ]
    + [
        (name, np.int32)
        for name in ("width", "height", "row", "slice", "bricks_x", "bricks_y", "shininess")
    ]
)
_BANDS = 16
MAX_SIDE = 16384


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
        padded = np.pad(volume.values, ((1, 2),) * 3, mode="edge")
        if padded.size > np.iinfo(np.int32).max:
            raise OpenCLError(
                f"{volume.name}: {padded.size / 2**30:.1f} Gi voxels; at most 2 Gi can be cast, "
                "down-sample the volume"
            )
        self._padded_shape = padded.shape
        self._voxels = self._compute.upload(padded)
        self._low, self._high = brick_ranges(volume.values)

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._compute.info.name

    def cast(
        self,
        table: TransferTable,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
    ) -> Result:
        """Cast a picture.

        Parameters
        ----------
        size : (width, height)
            Pixels.
        progress : callable, optional
            Called with the finished share, 0…1, after each band of the picture.

        Returns
        -------
        coefficients : (H, W, M) float32, premultiplied by opacity
        alpha : (H, W) float32
        depth_mm : (H, W) float32
            Expected distance from the camera of what is seen; inf where nothing is.

        Raises
        ------
        RaycastError
            If the size is not positive.
        """
        width, height = _checked_size(size)
        step = spec.step_of(self.volume)
        opacity = table.step_opacity(step)
        channels = table.coefficients.shape[1]
        if channels > MAX_CHANNELS:
            raise RaycastError(f"raycast: {channels} channels; at most {MAX_CHANNELS} can be cast")
        kernel = self._kernel(channels, spec)
        compute = self._compute
        inputs = [
            compute.upload(array)
            for array in (
                leap_distances(self._low, self._high, table.domain, opacity),
                _with_differences(opacity),
                _colour_rows(table),
            )
        ]
        shapes = ((height, width, channels), (height, width), (height, width))
        results = tuple(np.empty(shape, np.float32) for shape in shapes)
        outputs = [compute.output(result.nbytes) for result in results]
        arguments = self._arguments(table, camera, size, spec, step, len(opacity))
        self._launch(kernel, (self._voxels, *inputs, arguments, *outputs), size, progress)
        for buffer, result in zip(outputs, results, strict=True):
            compute.download(buffer, result)
        coefficients, alpha, depth = results
        return coefficients, alpha, depth * np.float32(min(self.volume.spacing_mm))

    def _kernel(self, channels: int, spec: RaycastSpec) -> Any:
        tile_width, tile_height = TILES[self.lanes]
        constants = {
            "LANES": self.lanes,
            "TILE_WIDTH": tile_width,
            "TILE_HEIGHT": tile_height,
            "CHANNELS": channels,
            "PART": _part(channels),
            "PARTS": -(-channels // _part(channels)),
            "BRICK": BRICK,
            "SHADED": spec.shaded,
            "SPECULAR": spec.specular > 0,
            "VOXEL_BYTES": self.volume.values.itemsize,
            "VOXEL_SIGNED": self.volume.values.dtype.kind == "i",
        }
        voxel = _VOXEL_TYPES[self.volume.values.dtype.name]
        text = prelude(constants, "opencl") + f"#define VOXEL {voxel}\n"
        options = ("-cl-std=CL1.2", "-cl-mad-enable", "-cl-no-signed-zeros", "-w")
        return self._compute.kernel(assemble("kernels/raycast.cl", text), "raycast", options)

    def _arguments(
        self,
        table: TransferTable,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        step: float,
        table_size: int,
    ) -> NDArray[np.void]:
        volume = self.volume
        unit = min(volume.spacing_mm)
        matrix = volume.index_from_world
        field = camera.ray_field(*size)
        cast = np.zeros((), _CAST)
        cast["target"][:3] = matrix[:3, :3] @ field.target + matrix[:3, 3]
        cast["forward"][:3] = field.forward
        cast["across"][:3], cast["down"][:3] = field.across / unit, field.down / unit
        for axis, name in enumerate(("index_x", "index_y", "index_z")):
            cast[name][:3] = matrix[axis, :3] * unit
        cast["middle_x"], cast["middle_y"] = field.middle
        cast["distance"], cast["perspective"] = field.distance / unit, field.perspective
        # Steps are counted from the camera but numbered from the one next to the target.
        nearest = round(field.distance / step)
        cast["start"] = -nearest * step / unit
        cast["phase"] = (nearest * step - field.distance) / unit
        cast["top"][:3] = np.array(volume.shape_xyz) - 1
        cast["shade"] = spec.ambient, spec.diffuse, spec.specular, 0
        cast["shininess"] = spec.shininess
        low, high = table.domain
        if (table_size - 1) / (high - low) > np.finfo(np.float32).max:
            raise RaycastError(
                f"{volume.name}: the transfer function spans {high - low:g}, too little for "
                "float32; multiply the volume's values"
            )
        cast["last_entry"] = table_size - 1
        cast["domain_low"], cast["domain_scale"] = low, (table_size - 1) / (high - low)
        cast["step"], cast["opaque"] = step / unit, 1 - spec.alpha_stop
        cast["gradient_scale"] = 0.5 * spec.gradient_scale(volume)
        cast["gradient_floor_squared"] = spec.gradient_floor_squared
        cast["width"], cast["height"] = size
        cast["row"] = self._padded_shape[2]
        cast["slice"] = self._padded_shape[1] * self._padded_shape[2]
        cast["bricks_x"], cast["bricks_y"] = self._low.shape[2], self._low.shape[1]
        return cast

    def _launch(
        self,
        kernel: Any,
        arguments: tuple[Any, ...],
        size: tuple[int, int],
        progress: Progress | None,
    ) -> None:
        """Cast in bands of whole work-groups: progress can be told, drivers are not blocked."""
        tile_width, tile_height = TILES[self.lanes]
        local = (8, 8)
        columns = -(-size[0] // (tile_width * local[0])) * local[0]
        groups = -(-size[1] // (tile_height * local[1]))
        bands = min(_BANDS, groups)
        edges = np.linspace(0, groups, bands + 1).round().astype(int)
        for first, last in pairwise(edges):
            rows = int(last - first) * local[1]
            first_tile = np.int32(first * local[1])
            kernel(self._compute.queue, (columns, rows), local, *arguments, first_tile)
            if progress:
                self._compute.queue.finish()
                progress(float(last) / groups)
        self._compute.queue.finish()


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


def _with_differences(opacity: NDArray[np.float64]) -> NDArray[np.float32]:
    """(N, 2): each entry and its difference to the next, one load instead of two."""
    return np.stack([opacity, np.append(np.diff(opacity), 0.0)], axis=1).astype(np.float32)


def _part(channels: int) -> int:
    """Floats in a vector of channels. Never 16: PoCL 3.0 cannot compile float16 for AVX-512."""
    return 4 if channels <= 4 else 8


def _colour_rows(table: TransferTable) -> NDArray[np.float32]:
    """The table's channels and, as the last row, white's; padded to whole vectors."""
    channels = table.coefficients.shape[1]
    part = _part(channels)
    rows = np.zeros((len(table.coefficients) + 1, -(-channels // part) * part), np.float32)
    rows[:-1, :channels], rows[-1, :channels] = table.coefficients, table.white
    return rows
