"""The picture in the window's GL: textures of a cast, relit into a framebuffer.

CoefficientImage, lights -> [pictures] -> framebuffer -> window
"""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from volspec.appearance import LutCache, LutKey, needs_host_lut
from volspec.appearance.display import colour_space
from volspec.basis import Basis, MaterialBasis
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.relight import LightRig, Look, PackedOpacity, Stereo, StereoPass, TexturePlanes
from volspec.viewer.model.materials import same_channels
from volspec.viewer.work.room import Walls

if TYPE_CHECKING:
    from volspec.room import SeenRoom
    from volspec.scene import SceneRoom

# mallopt(3): blocks of this size or more get their own mapping; so much freed memory is kept.
_M_MMAP_THRESHOLD, _LARGE_BYTES = -3, 4_000_000
_M_TRIM_THRESHOLD, _KEPT_BYTES = -1, 32_000_000


def return_large_blocks() -> None:
    """Make glibc return large blocks to the system as soon as they are freed, and keep small ones.

    Otherwise glibc keeps up to twice the memory in use after casts of many sizes. What a frame
    frees, the next needs again, and new pages may take longer than what is computed in them. Other
    C libraries are left as they are.
    """
    libc: Any = ctypes.CDLL(None) if sys.platform == "linux" else None
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        libc.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


# Relighters: of the whole picture, of two coarser ones, and of the window before a resize.
MAX_SIZES = 5


@dataclass(frozen=True, slots=True)
class Painted:
    """A framebuffer to be shown."""

    framebuffer: int  # its GL name
    size: tuple[int, int]  # width and height in pixels
    to: tuple[float, float, float, float]  # left, top, right, bottom in window coordinates
    within: tuple[int, int, int, int]  # x, y, width, height of the visible part of that

    @property
    def fills(self) -> bool:
        """True if it covers the visible part."""
        x, y, width, height = self.within
        return self.to == (x, y, x + width, y + height)


@dataclass(frozen=True, slots=True)
class Relit:
    """A relight in progress on the GPU."""

    query: Any
    host_ms: float

    @property
    def ms(self) -> float:
        """Duration on the host and the GPU; waits until the relight is done."""
        return float(self.host_ms + self.query.elapsed / 1e6)


@dataclass(frozen=True, slots=True, eq=False)
class IdlePictures:
    """Pictures that are shown in place of the live one once nothing moves.

    The left and right eye's picture, or without ``stereo`` one with a focus.
    """

    stereo: Stereo | None
    images: tuple[CoefficientImage, ...]
    packed: tuple[TexturePlanes, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all as one."""
        size = self.images[0].size
        return self.stereo.frame_size(size) if self.stereo else size


class Pictures:
    """Relighters of the window's picture, one per size, in the window's context."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._relighters: dict[tuple[int, ...], Relighter] = {}
        self._relighter: Relighter | None = None
        self._half: tuple[Relighter, CoefficientImage] | None = None
        self._walls: tuple[SeenRoom, TexturePlanes] | None = None  # of the half picture
        # The last picture with layers of opacity.
        self._layered: tuple[Relighter, CoefficientImage] | None = None
        self.idle: IdlePictures | None = None  # shown in place of the picture
        self._idle: list[Relighter] = []
        self._idle_of: tuple[int, tuple[int, ...], int] | None = None  # number, shape, groups
        self._combining = StereoPass(context)
        self._frame: Any = None
        self._frame_of: Relighter | None = None
        self.current = False  # True if the last picture is drawn under the last lights
        self.tables = LutCache()  # of models that no shader draws; `missing` lists those to add
        self._queries = [context.query(time=True) for _ in range(2)]
        self.image: CoefficientImage | None = None

    @property
    def framebuffer(self) -> int:
        """GL's name of the drawn picture; 0 if there is none."""
        return 0 if self._frame is None else int(self._frame.glo)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the drawn picture."""
        width, height = self._frame.size
        return int(width), int(height)

    def show(self, image: CoefficientImage, packed: TexturePlanes | None = None) -> None:
        """Take a picture as it was cast, and its packed layers; the last stays until `relight`."""
        self.image = replace(image, opacity_layers=None)
        self._relighter = self._relighter_of(self.image, packed)
        self.idle = self._half = self._walls = None
        self.current = False

    def forget(self) -> None:
        """Show, copy and draw nothing until the next picture, which is of another document."""
        self._relighter = self.image = self.idle = self._frame = self._frame_of = None

    def take_layers(
        self, image: CoefficientImage, packed: TexturePlanes | None, opacity: PackedOpacity | None
    ) -> Iterator[None]:
        """Take a picture with layers of opacity, which `recompose` shows, step by step."""
        relighter = self._relighter_of(image, packed)
        self._layered = relighter, image
        if opacity is not None:
            yield
            yield from relighter.load_opacities(opacity)

    def recompose(self, look: Look) -> None:
        """Show the picture with layers, which can have a look, at the next relight.

        Raises ImageError if a scale of an opacity is refused.
        """
        assert self._layered is not None
        relighter, image = self._layered
        image.opacity_scales(look.opacities)
        if self._relighter is not relighter:
            self._relighter, self.image = relighter, image
            self._half = self._walls = None
        self.current = False

    def show_idle(self, idle: IdlePictures | None) -> None:
        """Show pictures in place of the one that is shown, or that again, at the next relight."""
        self.idle, self.current = idle, False
        if idle is None:
            return
        pairs = list(zip(idle.images, idle.packed, strict=True))
        first = idle.images[0]
        key = len(pairs), first.coefficients.shape, len(first.groups)
        if self._idle and self._idle_of == key:
            for relighter, (image, packed) in zip(self._idle, pairs, strict=True):
                relighter.update(image, packed)
        else:
            self._close_idle()
            self._idle = [
                Relighter(image, "gl", self._context, lut_cache=self.tables, packed=packed)
                for image, packed in pairs
            ]
            self._idle_of = key

    def focused(self) -> CoefficientImage | None:
        """Return the picture with a focus, in the reflectances of the other; None if not shown."""
        if self.image is None or self.idle is None or self.idle.stereo:
            return None
        (image,) = self.idle.images
        if image.basis is not self.image.basis:
            image = replace(image, basis=self.image.basis)
            self.idle = replace(self.idle, images=(image,))
        return image

    def _close_idle(self) -> None:
        for relighter in self._idle:
            relighter.close()
        self._idle = []

    def repaint(self, basis: Basis) -> None:
        """Replace the reflectances of the picture's materials, if they are its channels."""
        image = self.image
        if image is not None and image.basis is not basis and same_channels(image.basis, basis):
            self.image = replace(image, basis=basis)

    def show_walls(self, walls: Walls, room: SceneRoom, stride: int) -> None:
        """Show a room in other paints in every n-th row and column, until `show`."""
        if self.image is None:
            return
        if self._half is None or self._walls is None:
            self._half = self._half_relighter(self.image, stride)
            height, width = walls.transmission.shape
            full_size = walls.backdrop.seen(walls.camera, (width, height))
            visible = full_size.through(walls.transmission, stride)
            channels = len(room.response.names) * self.image.basis.size
            self._walls = visible, TexturePlanes.last(self._half[1], channels)
        (half, image), (visible, packed) = self._half, self._walls
        layers = visible.layers(walls.backdrop.colours(room.response))
        first = image.coefficients.shape[2] - sum(part.shape[2] for part in layers)
        for number, layer in enumerate(layers):
            packed.put(first + number * layer.shape[2], layer)
        half.update(image, packed)
        self.current = False

    def _half_relighter(
        self, image: CoefficientImage, stride: int = 2
    ) -> tuple[Relighter, CoefficientImage]:
        """Return a relighter of every n-th row and column, and these."""
        some = slice(None, None, stride)
        half = crop(image, some, some)
        return self._relighter_of(half), half

    def _relighter_of(
        self, image: CoefficientImage, packed: TexturePlanes | None = None
    ) -> Relighter:
        """Return a relighter of the image's size, with the image in it."""
        layers = 0 if image.opacity_layers is None else image.opacity_layers.count
        key = (*image.coefficients.shape, len(image.groups), layers)
        relighter = self._relighters.pop(key, None)
        if relighter is None:
            while len(self._relighters) >= MAX_SIZES:
                # The relighter of the shown picture stays until another one is drawn.
                kept = self._frame_of, self._layered and self._layered[0]
                relighters = self._relighters.items()
                oldest = next(key for key, entry in relighters if entry not in kept)
                self._relighters.pop(oldest).close()
            relighter = Relighter(image, "gl", self._context, lut_cache=self.tables, packed=packed)
        else:
            relighter.update(image, packed)
        self._relighters[key] = relighter  # the newest last
        return relighter

    def missing(
        self, rig: LightRig | None, look: Look, other: LightRig | None = None
    ) -> tuple[LutKey, ...]:
        """Return the tables that `relight` would have to wait for under the same lights."""
        relighter, image, model = self._relighter, self.image, look.relight.viewing.model
        if relighter is None or image is None or rig is None or not needs_host_lut(model):
            return ()
        look = self._look_of(image, look)
        keys = (relighter.missing_lut(lights, look) for lights in (rig, other) if lights)
        lut_keys = tuple(key for key in keys if key is not None)
        self.current &= not lut_keys
        return lut_keys

    def _look_of(self, image: CoefficientImage, look: Look) -> Look:
        """Return a look as that of an image, in the reflectances of the picture."""
        basis = self.image.basis if self.image else None
        if isinstance(basis, MaterialBasis):
            look = replace(look, reflectances=basis.materials)
        return look.fitting(image)

    def relight(
        self,
        rig: LightRig | None,
        look: Look,
        other: LightRig | None = None,
        divide: float = 1.0,
        coarse: bool = False,
        band: tuple[float, float] = (0.0, 1.0),
    ) -> Relit | None:
        """Start drawing the picture under lights; return its timing, for two relights at most.

        A picture of another size stays visible until the last band of this one is drawn; without
        lights there is no picture. Right of the divide, 0 to 1 of the width, are the ``other``
        lights, with an eye adapted to them. ``coarse`` draws every second row and column, ``band``
        is the range of rows to draw, 0 to 1 of the height.
        """
        if self._relighter is None or self.image is None or rig is None:
            self._frame = self._frame_of = None
            return None
        started = time.perf_counter()
        relighter = self._relighter
        if coarse and self.idle is None:
            self._half = self._half or self._half_relighter(self.image)
            relighter = self._half[0]
        self._queries.reverse()
        drawn = [relighter] if self.idle is None else self._idle
        images = self.idle.images if self.idle else (self.image,)
        look = self._look_of(images[0], look)
        width, height = drawn[0].size
        top, bottom = (round(fraction * height) for fraction in band)
        left = width if other is None else round(divide * width)
        with self._queries[0]:
            frames = []
            for eye_relighter in drawn:
                for lights, start, end in ((rig, 0, left), (other, left, width)):
                    if lights is not None and start < end:
                        within = start, top, end - start, bottom - top
                        frame = eye_relighter.draw(lights, look, within)
                frames.append(frame)
            if self.idle is not None and self.idle.stereo and bottom == height:
                space = colour_space(look.relight.viewing.display.space)
                frame = self._combining.draw(self.idle.stereo, frames[0], frames[1], space)
        GL.glFlush()
        self.current = bottom == height
        if self.current:
            self._frame, self._frame_of = frame, relighter
        return Relit(self._queries[0], 1e3 * (time.perf_counter() - started))

    def code(self, x: int, y: int) -> tuple[int, int, int]:
        """Return the 8-bit code of a drawn pixel."""
        data = self._frame.read((x, y, 1, 1), components=3, dtype="f1")
        return data[0], data[1], data[2]

    def pixels(self) -> NDArray[np.uint8]:
        """Return the drawn picture, (H, W, 3)."""
        width, height = self.size
        data = self._frame.read(components=3, dtype="f1", alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def close(self) -> None:
        """Release everything."""
        self._close_idle()
        self._combining.close()
        for relighter in self._relighters.values():
            relighter.close()
        self._relighters.clear()


def crop(image: CoefficientImage, rows: slice, columns: slice) -> CoefficientImage:
    """Return some rows and columns of an image."""
    part, layers = (rows, columns), image.opacity_layers
    if layers is not None:
        layers = layers.changed(lambda array: array[part])
    return replace(
        image,
        coefficients=np.ascontiguousarray(image.coefficients[part]),
        alpha=image.alpha[part],
        depth_mm=image.depth_mm[part],
        first_mm=None if image.first_mm is None else image.first_mm[part],
        opacity_layers=layers,
        camera=None,
    )
