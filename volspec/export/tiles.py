"""Cast pictures of any size, with several rays per pixel, in windows that fit the device.

    volume, transfer, camera -> [tiles] -> strips of coefficient images

A pixel's coefficients are averaged over its rays before relighting: they are linear in the scene,
so the mean is correct under every light. Averaging frames would average display codes, in which a
bright edge counts too little.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from volspec._checks import MAX_SIDE
from volspec.camera import Camera, RayField
from volspec.errors import VolspecWarning
from volspec.image import CoefficientImage
from volspec.pipeline import GAPS, Raycaster, raycast
from volspec.raycast import RaycastSpec, SurfaceCaster
from volspec.raycast.launch import Progress
from volspec.relight import ShiftedCamera
from volspec.transfer import Transfers

# Bytes of one cast; and of a relit strip, including its copy on the device.
CAST_BYTES = 2**28
STRIP_BYTES = 2**29
# Numbers of a strip of rows in float64.
STRIP_NUMBERS = 2**23
# Largest side relit at once: every OpenGL 4.1 device has textures of this size.
STRIP_SIDE = 8192
# Rows of a strip and columns of a window are multiples of ray packets and hatching bars.
_ALIGNED = 64


@dataclass(frozen=True, slots=True)
class WindowCamera(ShiftedCamera):
    """Camera of a window in a larger picture."""

    whole: tuple[int, int] = (1, 1)  # rays of the larger picture
    corner: tuple[int, int] = (0, 0)  # first ray of the window in the larger picture

    def ray_field(self, width: float, height: float) -> RayField:
        """Return the rays of the window; its size is not used."""
        field = ShiftedCamera.ray_field(self, *self.whole)
        x, y = field.middle
        return replace(field, middle=(x - self.corner[0], y - self.corner[1]))


@dataclass(frozen=True, slots=True)
class TileWindow:
    """Part of a picture: corner and size in pixels."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """Size of a picture, its rays per pixel, and its division into windows."""

    size: tuple[int, int]
    samples: int  # n × n rays per pixel
    channels: int  # in all light groups together

    def strips(self) -> list[list[TileWindow]]:
        """Return strips from top to bottom: adjacent windows, each relit at once."""
        width, height = self.size
        columns = _cuts(width, STRIP_SIDE)
        widest = max(end - start for start, end in columns)
        room = STRIP_BYTES // (4 * (self.channels + 1) * widest)
        rows = _cuts(height, max(_ALIGNED, min(STRIP_SIDE, room)))
        return [
            [TileWindow(x, y, right - x, bottom - y) for x, right in columns] for y, bottom in rows
        ]

    def windows(self, part: TileWindow) -> list[TileWindow]:
        """Divide a strip's window into windows small enough for one cast."""
        n = self.samples
        columns = _cuts(part.width, MAX_SIDE // n)
        widest = max(end - start for start, end in columns)
        room = CAST_BYTES // (4 * self.channels * n * n * widest)
        rows = _cuts(part.height, max(_ALIGNED, min(MAX_SIDE // n, room)))
        return [
            TileWindow(part.x + x, part.y + y, right - x, bottom - y)
            for y, bottom in rows
            for x, right in columns
        ]


def _cuts(length: int, maximum: int) -> list[tuple[int, int]]:
    """Cut a length into nearly equal pieces, all but the last of whole packets."""
    if length <= maximum:
        return [(0, length)]
    count = -(-length // (maximum // _ALIGNED * _ALIGNED))
    step = -(-length // (count * _ALIGNED)) * _ALIGNED
    return [(start, min(start + step, length)) for start in range(0, length, step)]


def row_strips(size: tuple[int, int], numbers: int) -> Iterator[slice]:
    """Yield slices of rows small enough for float64, given the numbers per pixel."""
    width, height = size
    step = max(1, STRIP_NUMBERS // (width * numbers))
    for y in range(0, height, step):
        yield slice(y, y + step)


@dataclass(frozen=True, slots=True, eq=False)
class TileCaster:
    """Caster of pictures of one volume in parts."""

    caster: Raycaster
    spec: RaycastSpec
    notes: Mapping[str, str]  # metadata of the images
    behind: Sequence[SurfaceCaster] = ()

    def strips(
        self, transfer: Transfers, camera: Camera, canvas: Canvas, progress: Progress
    ) -> Iterator[list[CoefficientImage]]:
        """Yield the picture from top to bottom as rows of adjacent images, usually a single one."""
        strips = canvas.strips()
        total, done, is_empty = canvas.size[0] * canvas.size[1], 0, True
        for strip in strips:
            images = []
            for part in strip:
                area = part.width * part.height
                part_progress = part_of(progress, done / total, area / total)
                images.append(self._part(transfer, camera, canvas, part, part_progress))
                done += area
                is_empty = is_empty and not images[-1].alpha.any()
            yield images
        if is_empty and (len(strips) > 1 or len(strips[0]) > 1):
            self._warn_empty()

    def picture(
        self, transfer: Transfers, camera: Camera, canvas: Canvas, progress: Progress
    ) -> CoefficientImage:
        """Cast the picture as one image in memory, whatever its size."""
        return self._part(transfer, camera, canvas, TileWindow(0, 0, *canvas.size), progress)

    def _part(
        self,
        transfer: Transfers,
        camera: Camera,
        canvas: Canvas,
        part: TileWindow,
        progress: Progress,
    ) -> CoefficientImage:
        """Cast one window of the picture, in several casts if it is large."""
        full = TileWindow(0, 0, *canvas.size)
        windows = canvas.windows(part)
        if canvas.samples == 1 and windows == [full]:
            return self.cast(transfer, camera, canvas.size, progress)
        n, image = canvas.samples, None
        gaps: dict[str, str] = {}
        coefficients = np.empty((part.height, part.width, canvas.channels), np.float32)
        alpha = np.empty((part.height, part.width), np.float32)
        # A mean of several rays' depths is not on any surface.
        depth, first = np.full_like(alpha, np.inf), None if n > 1 else np.empty_like(alpha)
        for i, window in enumerate(windows):
            window_camera = WindowCamera(
                **{field.name: getattr(camera, field.name) for field in fields(camera)},
                whole=(n * canvas.size[0], n * canvas.size[1]),
                corner=(n * window.x, n * window.y),
            )
            part_progress = part_of(progress, i / len(windows), 1 / len(windows))
            with warnings.catch_warnings():
                if part != full or len(windows) > 1:  # a single window may be empty
                    for phrase in ("the picture is empty", "nothing of it", "is outside the view"):
                        warnings.filterwarnings("ignore", f".*{phrase}", VolspecWarning)
                size = n * window.width, n * window.height
                image = self.cast(transfer, window_camera, size, part_progress)
            gaps |= {key: text for key, text in image.notes.items() if key == GAPS}
            y, x = window.y - part.y, window.x - part.x
            target = np.s_[y : y + window.height, x : x + window.width]
            coefficients[target] = _mean(np.asarray(image.coefficients, np.float32), n)
            alpha[target] = _mean(image.alpha[..., None], n)[..., 0]
            if first is not None and image.first_mm is not None:
                depth[target], first[target] = image.depth_mm, image.first_mm
        assert image is not None
        if part == full and len(windows) > 1 and not alpha.any():
            self._warn_empty()
        return replace(
            image,
            coefficients=coefficients.astype(image.coefficients.dtype, copy=False),
            alpha=alpha,
            depth_mm=depth,
            first_mm=first,
            camera=camera if part == full else None,
            notes={**image.notes, **gaps, "camera": repr(camera)},
        )

    def _warn_empty(self) -> None:
        """Warn as `volspec.raycast` does for a picture in one part."""
        warnings.warn(
            f"{self.caster.volume.name}: the picture is empty; look at the transfer function's "
            "opacities, the camera, crop and clip planes",
            VolspecWarning,
            stacklevel=3,
        )

    def cast(
        self,
        transfer: Transfers,
        camera: Camera,
        size: tuple[int, int],
        progress: Progress | None = None,
    ) -> CoefficientImage:
        """Cast a picture in one part."""
        return raycast(
            self.caster.volume,
            transfer,
            camera,
            size,
            self.spec,
            caster=self.caster,
            progress=progress,
            notes=self.notes,
            behind=self.behind,
        )


def part_of(progress: Progress, start: float, fraction: float) -> Progress:
    """Return the progress of a part of a picture."""
    return lambda done: progress(start + fraction * done)


def _mean(pixels: NDArray[np.float32], n: int) -> NDArray[np.float32]:
    """Average (n·H, n·W, C) to (H, W, C) with a box filter."""
    if n == 1:
        return pixels
    height, width, channels = pixels.shape
    parts = pixels.reshape(height // n, n, width // n, n, channels)
    return np.asarray(parts.mean(axis=(1, 3), dtype=np.float32))
