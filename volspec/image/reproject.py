"""Reprojection: a picture in layers of opacity, seen by another camera nearby, without a cast.

    CoefficientImage with layers, its camera -> [reproject] -> CoefficientImage of another camera

Every layer of a pixel is one or more points in its depth, which are splatted with their optical
depths, bilinearly. They are sorted once, by depth in the image: along a ray of the other camera's
that is the same order. Shades stay those of the cast, as light that is fixed in the world gives.

The kernel is ``kernels/reproject.cl``, its twin `reproject_reference`. Guide: ``docs/layers.md``.

References
----------
[1] Shade, Gortler, He & Szeliski (1998), "Layered depth images", SIGGRAPH, 231-242.
[2] Westover (1990), "Footprint evaluation for volume rendering", SIGGRAPH, 367-376.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec._checks import checked_size, whole
from volspec._gpu import Compute, Struct, assemble, prelude
from volspec.camera import Camera, RayField
from volspec.errors import ImageError
from volspec.image.layers import OpacityLayers
from volspec.image.model import CoefficientImage

Array = NDArray[np.float64]

NEAR = 1e-3
"""Nearest point that is shown, as a fraction of the distance from the camera to its target."""
BLOCK = 16
"""Side of the blocks of pixels whose points are stored together."""
BUCKETS = 256
"""Slices of depth in which points are sorted."""
PARTS = 3
"""Points that a deep layer becomes, at most."""
# Depth in pixels from which on a layer is as many: 10 for each of 3, which 5° turn into one.
_DEEP = 30.0
# Times that a layer may reach farther to one neighbour than to the other: there may be a void.
_FARTHER = 3.0
# Rows or columns of the target that a work-item splats on a CPU, and how many items a core has.
_ROWS, _ITEMS = (16, 64), 4
# Side of a work-item's tile on a GPU.
_GPU_TILE = 16
_COLOURS_AT = 4
# Pitches of the same camera, turned, differ by rounding.
_ROUNDING = 1e-6
VIEW = Struct(
    "View",
    (
        ("float4", "origin", "of the source's target, in pixels across and down, and mm ahead"),
        ("float4", "forward, across, down", "of a mm along the source's view, and of its pixels"),
        ("float", "middle_x, middle_y", "pixel of the source that looks at its target"),
        ("float", "distance", "from the source's camera to its target, mm"),
        ("float", "nearness", "1 / distance, or 0 for parallel rays"),
        ("float", "pitch", "of pixels in the target's plane, mm"),
        ("float", "other_middle_x, other_middle_y", "the same of the target's camera"),
        ("float", "other_distance, other_nearness, other_pitch", ""),
        ("float", "radius", "half width of splats, pixels"),
        ("float", "scale", "pitch by the other's, by the radius"),
        ("float", "first_ahead, buckets_per_mm", "of depth along the view"),
        ("int", "width, height", "pixels of the source"),
        ("int", "other_width, other_height", ""),
        ("int", "tile_width, tile_height", "of the target, by work-items"),
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Warp:
    """The way from pixels and depths of one camera to those of another."""

    source: RayField
    target: RayField
    size: tuple[int, int]
    other_size: tuple[int, int]

    @classmethod
    def of(
        cls, source: Camera, size: tuple[int, int], target: Camera, other_size: tuple[int, int]
    ) -> Warp:
        """Return the warp between two cameras' pictures."""
        return cls(source.ray_field(*size), target.ray_field(*other_size), size, other_size)

    @property
    def radius(self) -> float:
        """Half width of splats, pixels: 1, or more if the other camera magnifies."""
        wider = self.source.pitch_mm / self.target.pitch_mm
        return wider if wider > 1 + _ROUNDING else 1.0

    def axes(self) -> Array:
        """Return (4, 3) origin, forward, across, down in the other camera's pixels, and mm."""
        other = self.target
        rows = [
            other.across / (other.across @ other.across),
            other.down / (other.down @ other.down),
            other.forward,
        ]
        source = self.source
        vectors = [source.target - other.target, source.forward, source.across, source.down]
        return np.array(vectors) @ np.array(rows).T

    def places(self, columns: Array, lines: Array, ahead: Array) -> tuple[Array, ...]:
        """Return x, y, depth and relative size in the other picture; size is 0 behind it."""
        origin, forward, across, down = self.axes()
        wider = 1 + ahead * self.source.nearness
        u = (columns - self.source.middle[0]) * wider
        v = (lines - self.source.middle[1]) * wider
        X, Y, Z = (origin[n] + ahead * forward[n] + u * across[n] + v * down[n] for n in range(3))
        w = 1 + Z * self.target.nearness
        inverse = np.where(w < NEAR, 0.0, 1 / np.where(w < NEAR, 1, w))
        x, y = self.target.middle[0] + X * inverse, self.target.middle[1] + Y * inverse
        return x, y, Z, wider * inverse

    def reach(self, extents: NDArray[Any]) -> Array:
        """Return what blocks of pixels cover of the other picture, (B, 4): low x, y, high x, y.

        ``extents`` (B, 2) are their points' smallest and largest depth, the first above the second
        if a block has none.
        """
        width, height = self.size
        across = -(-width // BLOCK)
        number = np.arange(len(extents))
        corners = [
            self.places(
                np.minimum(number % across * BLOCK + i * (BLOCK - 1), width - 1.0),
                np.minimum(number // across * BLOCK + j * (BLOCK - 1), height - 1.0),
                np.where(np.isfinite(extents[:, k]), extents[:, k], 0.0),
            )
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ]
        x, y, _, scale = (np.stack(component) for component in zip(*corners, strict=True))
        bounds = np.stack([x.min(axis=0), y.min(axis=0), x.max(axis=0), y.max(axis=0)], axis=1)
        # Blocks that reach behind the camera may be anywhere.
        bounds[(scale == 0).any(axis=0)] = -np.inf, -np.inf, np.inf, np.inf
        bounds[extents[:, 0] > extents[:, 1]] = np.inf, np.inf, -np.inf, -np.inf
        return bounds

    def blocks_of_tiles(
        self, extents: NDArray[Any], tile: tuple[int, int]
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return where each tile's blocks begin, (T + 1,), and all tiles' blocks."""
        low_x, low_y, high_x, high_y = self.reach(extents).T
        width, height = self.other_size
        x = np.arange(0, width, tile[0])[:, None]
        y = np.arange(0, height, tile[1])[:, None]
        in_x = (low_x < x + tile[0] - 1 + self.radius) & (high_x > x - self.radius)
        in_y = (low_y < y + tile[1] - 1 + self.radius) & (high_y > y - self.radius)
        tiles, blocks = np.nonzero((in_y[:, None] & in_x).reshape(-1, len(extents)))
        firsts = np.searchsorted(tiles, np.arange(len(x) * len(y) + 1))
        # One more, as buffers cannot be empty.
        return firsts.astype(np.int32), np.append(blocks, 0).astype(np.int32)

    def struct(self, tile: tuple[int, int], depths: tuple[float, float]) -> NDArray[np.void]:
        """Return the kernel's View; ``depths`` are the points' smallest and largest."""
        view = np.zeros((), VIEW.dtype)
        for name, vector in zip(("origin", "forward", "across", "down"), self.axes(), strict=True):
            view[name] = (*vector, 0.0)
        for prefix, field, size in (
            ("", self.source, self.size),
            ("other_", self.target, self.other_size),
        ):
            view[prefix + "middle_x"], view[prefix + "middle_y"] = field.middle
            view[prefix + "distance"] = field.distance
            view[prefix + "nearness"] = field.nearness
            view[prefix + "pitch"] = field.pitch_mm
            view[prefix + "width"], view[prefix + "height"] = size
        view["radius"] = self.radius
        view["scale"] = self.source.pitch_mm / self.target.pitch_mm / self.radius
        view["tile_width"], view["tile_height"] = tile
        view["first_ahead"], view["buckets_per_mm"] = depths[0], _buckets_per_mm(depths)
        return view


def _buckets_per_mm(depths: tuple[float, float]) -> float:
    return BUCKETS / ((depths[1] - depths[0]) or 1.0)


class Points(NamedTuple):
    """Layers at given scales, as points: pixel, τ and depth (P,), colours (P, M)."""

    column: NDArray[np.int64]
    line: NDArray[np.int64]
    tau: Array
    ahead: Array
    colours: Array


def layer_points(
    layers: OpacityLayers, scales: list[float], warp: Warp, parts: int = PARTS
) -> Points:
    """Return the points of layers with the materials' optical depths scaled, pixel by pixel."""
    layers = layers.lit(scales)
    tau = layers.scaled(scales).astype(np.float64)
    total = tau.sum(axis=-1)
    depth = layers.depth_mm.astype(np.float64)
    used = np.isfinite(depth)
    deep = np.where(used, depth, np.nan)
    deep[:, :, layers.count - layers.solid :] = np.nan  # surfaces have no depth
    steps = np.diff(deep, axis=2)
    edge = np.full_like(depth[..., :1], np.nan)
    before = np.concatenate([edge, steps], axis=2)
    after = np.concatenate([steps, edge], axis=2)
    nearer = np.fmin(before, after)
    before, after = (
        np.nan_to_num(np.where(np.isnan(spacing), nearer, np.minimum(spacing, _FARTHER * nearer)))
        for spacing in (before, after)
    )
    deep = (before + after) / 2 / (_DEEP / parts * warp.source.pitch_mm)
    count = np.ceil(deep).clip(1, parts)[..., None]
    part = np.arange(parts)
    off = 0.5 * ((2 * part + 1) / count - 1)
    t_mm = depth[..., None] + off * np.where(off < 0, before[..., None], after[..., None])
    visible = (used & (total > 0))[..., None] & (part < count)
    line, column, layer, number = np.nonzero(visible)
    key = line, column, layer
    fraction = tau[key] / total[key][:, None]
    shade = fraction[:, None, :] * layers.shade[key]
    colours = np.concatenate([shade, layers.gloss[key][..., None]], axis=-1)
    return Points(
        column,
        line,
        total[key] / count[..., 0][key],
        t_mm[(*key, number)] * warp.source.cosines(*warp.size)[line, column] - warp.source.distance,
        colours.reshape(len(line), -1),
    )


class Sums(NamedTuple):
    """A splatted picture: channels (H, W, M), alpha and distance (H, W)."""

    coefficients: NDArray[Any]
    alpha: NDArray[Any]
    depth_mm: NDArray[Any]


def reproject_reference(
    layers: OpacityLayers, scales: list[float], warp: Warp, parts: int = PARTS
) -> Sums:
    """Splat the layers of a picture into another camera's: the kernel in float64."""
    points = layer_points(layers, scales, warp, parts)
    depths = _depths(layers.depth_mm, warp)
    bucket = ((points.ahead - depths[0]) * _buckets_per_mm(depths)).astype(int)
    blocks = points.column // BLOCK, points.line // BLOCK
    order = np.lexsort((*blocks, bucket.clip(0, BUCKETS - 1)))
    points = Points._make(array[order] for array in points)
    x, y, Z, size = warp.places(
        points.column.astype(float), points.line.astype(float), points.ahead
    )
    radius, (width, height) = warp.radius, warp.other_size
    ratio = warp.source.pitch_mm / warp.target.pitch_mm / radius
    tau = points.tau * (ratio * size) ** 2
    row = np.concatenate([Z[:, None], points.colours], axis=1)
    first = np.ceil(np.stack([x, y]) - radius).astype(int)
    pieces = []
    for down in range(int(2 * radius) + 1):
        for across in range(int(2 * radius) + 1):
            a, b = first[0] + across, first[1] + down
            h = np.maximum(1 - abs(a - x) / radius, 0) * np.maximum(1 - abs(b - y) / radius, 0)
            use = np.flatnonzero(
                (h > 0) & (tau > 0) & (a >= 0) & (a < width) & (b >= 0) & (b < height)
            )
            pieces.append((use, b[use] * width + a[use], (tau * h)[use]))
    number, pixel, added = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    order = np.lexsort((number, pixel))
    number, pixel, added = number[order], pixel[order], added[order]
    flat, clear = np.zeros((width * height, row.shape[1])), np.ones(width * height)
    if len(pixel):
        starts = np.flatnonzero(np.diff(pixel, prepend=-1))
        before = np.cumsum(added) - added
        before -= np.repeat(before[starts], np.diff(starts, append=len(pixel)))
        weight = np.exp(-before) * -np.expm1(-added)
        flat[pixel[starts]] = np.add.reduceat(weight[:, None] * row[number], starts)
        clear[pixel[starts]] = np.exp(-np.add.reduceat(added, starts))
    alpha, sums = 1 - clear.reshape(height, width), flat.reshape(height, width, -1)
    covered = alpha > 0
    mean = warp.target.distance + sums[..., 0] / np.where(covered, alpha, 1)
    depth = np.where(covered, mean / warp.target.cosines(width, height), np.inf)
    return Sums(sums[..., 1:], alpha, depth)


class Reprojector:
    """Nearby views of one image, whose layers stay on an OpenCL device.

    Raises ImageError if the image has no layers, or its camera is unknown.

    Parameters
    ----------
    image : CoefficientImage
        Cast with layers; it knows its camera.
    parts : int
        Points that a deep layer becomes at most, 1 to 16. Borders of layers show as dark dots in a
        turned view: fewer with 6; 1 is the fastest.
    device : str, optional
        Part of an OpenCL device's name.
    compute : Compute, optional
        The device, if it is already open; that of another Reprojector is its `compute`.
    """

    def __init__(
        self,
        image: CoefficientImage,
        *,
        parts: int = PARTS,
        device: str | None = None,
        compute: Compute | None = None,
    ) -> None:
        self.camera, self._layers = _camera_and_layers(image)
        self.image, self.compute = image, Compute.open(device) if compute is None else compute
        self._parts = whole("reproject: parts", parts, 1, 16)
        height, width = self._layers.tau.shape[:2]
        self._rows = -(-(_COLOURS_AT + image.coefficients.shape[2]) // 8)
        self._depths = _depths(
            self._layers.depth_mm, Warp.of(self.camera, image.size, self.camera, image.size)
        )
        layers = self._layers
        arrays = layers.tau, layers.shade, layers.gloss, layers.depth_mm
        self._inputs = [*map(self._input, arrays)]
        blocks = -(-width // BLOCK) * -(-height // BLOCK)
        self._extents = np.empty((blocks, 2), np.float32)
        self.points = 0
        self._points: Any = None
        self._starts: Any = None
        self._scales: list[float] | None = None
        self._sums: tuple[int, Any] = 0, None

    def view(
        self,
        camera: Camera,
        scales: Mapping[str, float] | None = None,
        size: tuple[int, int] | None = None,
    ) -> CoefficientImage:
        """Return the picture of another camera nearby, without layers and first hit.

        Lights that are fixed in the world are exact; those fixed to the camera, such as a
        headlight, stay where they were at the cast. ``scales`` are opacities, as of
        `CoefficientImage.recompose`; ``size`` is (width, height), the image's if left out. Raises
        ImageError if the camera looks elsewhere, or a scale or the size is refused.
        """
        width, height = checked_size(size or self.image.size, "reproject")
        _check_camera(camera, self.camera)
        factors = self.image.opacity_scales(scales or {})
        warp = Warp.of(self.camera, self.image.size, camera, (width, height))
        tile = self._tile(warp)
        view = warp.struct(tile, self._depths)
        self._arrange(factors, view)
        channels = self.image.coefficients.shape[2]
        pixels = width * height
        if self._sums[0] < pixels:
            self._sums = pixels, self.compute.output(pixels * self._rows * 32)
        sums = Sums(
            np.empty((height, width, channels), np.float32),
            *(np.empty((height, width), np.float32) for _ in range(2)),
        )
        outputs = [self.compute.output(array.nbytes, array) for array in sums]
        kernel = self._kernel("splat", warp.radius > 1)
        done = kernel(
            self.compute.queue,
            (-(-width // tile[0]), -(-height // tile[1])),
            (1, 1),
            self._points,
            self._starts,
            *map(self.compute.upload, warp.blocks_of_tiles(self._extents, tile)),
            np.int32(len(self._extents)),
            view,
            self._sums[1],
            *outputs,
        )
        for buffer, array in zip(outputs, sums, strict=True):
            self.compute.download(buffer, array, done)
        return replace(
            self.image,
            coefficients=sums.coefficients.astype(self.image.coefficients.dtype, copy=False),
            alpha=sums.alpha,
            depth_mm=sums.depth_mm,
            first_mm=None,
            opacity_layers=None,
            camera=camera,
            notes={**self.image.notes, "camera": repr(camera)},
            fov_deg=None if camera.height_mm is not None else camera.fov_deg,
        )

    def _input(self, array: NDArray[Any]) -> Any:
        return self.compute.upload(np.ascontiguousarray(array, np.float32), share=True)

    def _tile(self, warp: Warp) -> tuple[int, int]:
        """Return the size of the target's tiles, one a work-item."""
        info, (width, height) = self.compute.info, warp.other_size
        if not info.is_cpu:
            return _GPU_TILE, _GPU_TILE
        # Tiles are long where points move: few of them then see the same source.
        x, y = np.abs(warp.axes()[1, :2])
        side = height if x >= y else width
        rows = int(np.clip(side // (_ITEMS * info.compute_units), *_ROWS))
        return (width, rows) if x >= y else (rows, height)

    def _arrange(self, scales: list[float], view: NDArray[np.void]) -> None:
        """Make the points of some scales, unless they are there."""
        if scales == self._scales:
            return
        if self._layers.slots:  # shadows fade with their materials
            layers = self._layers.lit(scales)
            self._inputs[1:3] = map(self._input, (layers.shade, layers.gloss))
        kernel, compute = self._kernel("arrange"), self.compute
        blocks = len(self._extents)
        extents = compute.output(self._extents.nbytes, self._extents)
        cells = np.zeros((BUCKETS, blocks), np.int32)
        args = *self._inputs, compute.upload(np.array(scales, np.float32)), view
        points = compute.output(32 * self._rows)
        for store in (0, 1):
            counters = compute.output(cells.nbytes, cells, filled=True)
            done = kernel(
                compute.queue, (blocks,), None, *args, counters, extents, np.int32(store), points
            )
            if store:
                break
            compute.download(counters, cells, done)
            # Slice by slice, so that tiles read points that are stored behind one another.
            starts = np.zeros(cells.size + 1, np.int32)
            np.cumsum(cells, out=starts[1:])
            self._starts = compute.upload(starts)
            self.points = int(starts[-1])
            self._points = points = compute.output(max(self.points, 1) * 32 * self._rows)
            cells = starts[:-1].reshape(cells.shape).copy()
        compute.download(extents, self._extents, done)
        self._scales = scales

    def _kernel(self, name: str, wide: bool = False) -> Any:
        constants = {
            "LAYERED": self._layers.count,
            "SOLID": int(self._layers.solid),
            "MATERIALS": self._layers.materials,
            "GROUPS": self._layers.groups,
            "CHANNELS": self.image.coefficients.shape[2],
            "ROWS": self._rows,
            "WIDE": int(wide),
            "NEAR": NEAR,
            "BLOCK": BLOCK,
            "BUCKETS": BUCKETS,
            "COLOURS_AT": _COLOURS_AT,
            "PART": _DEEP / self._parts,
            "MAX_PARTS": self._parts,
            "FARTHER": _FARTHER,
        }
        text = prelude(constants, "opencl") + VIEW.declaration
        return self.compute.kernel(assemble("kernels/reproject.cl", text), name)


def _depths(depth_mm: NDArray[Any], warp: Warp) -> tuple[float, float]:
    """Return bounds of the layers' depths along the view, from the target's plane."""
    finite = np.isfinite(depth_mm)
    low = float(depth_mm.min(where=finite, initial=np.inf))
    high = float(depth_mm.max(where=finite, initial=-np.inf))
    if low > high:
        return 0.0, 1.0
    distance = warp.source.distance
    return low * float(warp.source.cosines(*warp.size).min()) - distance, high - distance


def _check_camera(camera: Camera, source: Camera) -> None:
    """Refuse a camera whose view is not nearby."""
    cosine = float(camera.frame()[2] @ source.frame()[2])
    if cosine < 0.1:
        raise ImageError(
            f"the view is turned by {math.degrees(math.acos(max(cosine, -1.0))):.0f}°, points "
            "would be shown in a wrong order",
            "turn it by less than 80°, better 10°, or cast it",
            code="range",
            field="reproject: camera",
        )


def _camera_and_layers(image: CoefficientImage) -> tuple[Camera, OpacityLayers]:
    """Return what reprojection needs of an image, or raise ImageError."""
    if image.opacity_layers is None:
        raise ImageError(
            "reproject: the image was cast without layers",
            "cast it with [raycast] layers = 8, RaycastSpec(layers=8)",
            code="unsupported",
        )
    if image.camera is None:
        raise ImageError(
            "reproject: the image does not know its camera", "cast it again", code="missing"
        )
    return image.camera, image.opacity_layers
