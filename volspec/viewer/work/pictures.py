"""The picture in the window's GL: textures of a cast, relit into a framebuffer.

    CoefficientImage, lights -> [pictures] -> framebuffer -> window

glibc keeps large blocks once it has seen them freed, and so holds up to twice the memory in use
after some minutes of casts of ever other sizes; here they are given back.
"""

from __future__ import annotations

import ctypes
import sys
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.pipeline import Relighter
from volspec.raycast import CoefficientImage
from volspec.relight import LightRig, RelightSpec
from volspec.relight.packed import PackedLayers
from volspec.relight.tables import HostTables, TableKey, is_tabled
from volspec.viewer.model.materials import same_channels
from volspec.viewer.work.gl import GL

# mallopt(3): blocks from this size on are the system's own, whatever has been freed.
_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1_000_000


def give_back_large() -> None:
    """Have large blocks given back as soon as they are freed, for the rest of the process.

    Nothing changes where the C library is another than glibc.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


WHOLE = (0.0, 1.0)
# Sizes kept: the whole picture, two coarser, and those of a window before it was resized.
MOST_SIZES = 5


@dataclass(frozen=True, slots=True)
class Painted:
    """A framebuffer to be shown.

    Parameters
    ----------
    framebuffer : int
        Its GL name.
    size : (width, height)
        Pixels.
    to : (left, top, right, bottom)
        Where in the window, in its coordinates.
    within : (x, y, width, height)
        What is seen of that.
    """

    framebuffer: int
    size: tuple[int, int]
    to: tuple[float, float, float, float]
    within: tuple[int, int, int, int]

    @property
    def fills(self) -> bool:
        """Whether it covers all that is seen of it; panels cover the rest."""
        x, y, width, height = self.within
        return self.to == (x, y, x + width, y + height)


@dataclass(frozen=True, slots=True)
class Relit:
    """A relight under way on the GPU."""

    query: Any
    host_ms: float

    @property
    def ms(self) -> float:
        """What it took on the host and the GPU; waits until it is done."""
        return float(self.host_ms + self.query.elapsed / 1e6)


class Pictures:
    """What the window shows.

    Parameters
    ----------
    context : moderngl.Context
        That of the window.

    Attributes
    ----------
    tables : HostTables
        Where `relight` finds what `missing` has told of.
    current : bool
        Whether what is drawn is the last picture under the last light, not one before.
    """

    def __init__(self, context: Any) -> None:
        self._context = context
        self._relighters: dict[tuple[int, ...], Relighter] = {}
        self._shown: Relighter | None = None
        self._half: Relighter | None = None
        self._painted: tuple[Relighter, Basis] | None = None
        self._frame: Any = None
        self._frame_of: Relighter | None = None
        self.current = False
        self.tables = HostTables()
        self._queries = [context.query(time=True) for _ in range(2)]
        self.image: CoefficientImage | None = None

    @property
    def framebuffer(self) -> int:
        """GL's name of what is drawn; 0 where nothing is."""
        return 0 if self._frame is None else int(self._frame.glo)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of what is drawn."""
        width, height = self._frame.size
        return int(width), int(height)

    def show(self, image: CoefficientImage, packed: PackedLayers | None = None) -> None:
        """Take a picture; until `relight` draws it, that before stays.

        Parameters
        ----------
        image : CoefficientImage
        packed : PackedLayers, optional
            The image's, made where it was cast.
        """
        self._shown, self.image = self._relighter_of(image, packed), image
        self._half, self.current = None, False

    def repaint(self, basis: Basis) -> None:
        """Give the picture's materials other reflectances, where they are its channels.

        Parameters
        ----------
        basis : Basis
            Of the state that is to be shown; a picture cast otherwise stays as it is.
        """
        if self.image is None or self.image.basis is basis:
            return
        if same_channels(self.image.basis, basis):
            self.image = replace(self.image, basis=basis)

    def _halved(self) -> Relighter:
        """A quarter of the picture's pixels."""
        if self._half is None:
            image = self.image
            assert image is not None
            fewer = (slice(None, None, 2),) * 2
            first = None if image.first_mm is None else image.first_mm[fewer]
            self._half = self._relighter_of(
                replace(
                    image,
                    coefficients=np.ascontiguousarray(image.coefficients[fewer]),
                    alpha=image.alpha[fewer],
                    depth_mm=image.depth_mm[fewer],
                    first_mm=first,
                )
            )
        return self._half

    def _relighter_of(
        self, image: CoefficientImage, packed: PackedLayers | None = None
    ) -> Relighter:
        """One of its size, with the image in it."""
        key = (*image.coefficients.shape, len(image.groups))
        relighter = self._relighters.pop(key, None)
        if relighter is None:
            while len(self._relighters) >= MOST_SIZES:
                # What is shown stays until another is drawn.
                known = self._relighters.items()
                self._release(next(key for key, each in known if each is not self._frame_of))
            relighter = Relighter(image, "gl", self._context, tables=self.tables, packed=packed)
        else:
            relighter.update(image, packed)
        self._relighters[key] = relighter  # the newest last
        return relighter

    def _release(self, key: tuple[int, ...]) -> None:
        self._relighters.pop(key).close()

    def missing(
        self, rig: LightRig | None, spec: RelightSpec, other: LightRig | None = None
    ) -> tuple[TableKey, ...]:
        """Tables that `relight` would have to wait for, under the same lights.

        Parameters
        ----------
        rig, spec, other
            As `relight`.
        """
        if self._shown is None or rig is None or not is_tabled(spec.viewing.model):
            return ()
        self._paint(self._shown)
        keys = [self._shown.missing_table(each, spec) for each in (rig, other) if each]
        found = tuple(key for key in keys if key is not None)
        self.current &= not found
        return found

    def _paint(self, shown: Relighter) -> None:
        """Give a relighter the picture's reflectances, where these are its channels."""
        basis = self.image.basis if self.image else None
        if isinstance(basis, MaterialBasis) and self._painted != (shown, basis):
            shown.set_reflectances(basis.materials)
            self._painted = shown, basis

    def relight(
        self,
        rig: LightRig | None,
        spec: RelightSpec,
        other: LightRig | None = None,
        divide: float = 1.0,
        coarse: bool = False,
        band: tuple[float, float] = WHOLE,
    ) -> Relit | None:
        """Have the picture drawn under lights, without waiting for it; nothing without.

        What is shown stays until the last band of a picture of another size has been drawn.

        Parameters
        ----------
        rig : LightRig or None
        spec : RelightSpec
        other : LightRig, optional
            Lights what is right of the divide, to an eye adapted to it.
        divide : float
            0 to 1 of the width.
        coarse : bool
            Draw every second row and column only.
        band : (top, bottom)
            The rows to draw, 0 to 1 of the height.

        Returns
        -------
        Relit or None
            What it takes; of the last two.
        """
        if self._shown is None or rig is None:
            self._frame = self._frame_of = None
            return None
        started = time.perf_counter()
        shown = self._halved() if coarse else self._shown
        self._paint(shown)
        self._queries.reverse()
        width, height = shown.size
        top, bottom = (round(share * height) for share in band)
        left = width if other is None else round(divide * width)
        with self._queries[0]:
            for lights, start, end in ((rig, 0, left), (other, left, width)):
                if lights is not None and start < end:
                    within = start, top, end - start, bottom - top
                    frame = shown.draw(lights, spec, within)
        GL.glFlush()
        self.current = bottom == height
        if self.current:
            self._frame, self._frame_of = frame, shown
        return Relit(self._queries[0], 1e3 * (time.perf_counter() - started))

    def code(self, x: int, y: int) -> tuple[int, int, int]:
        """The 8-bit code of a pixel as it is drawn."""
        data = self._frame.read((x, y, 1, 1), components=3, dtype="f1")
        return data[0], data[1], data[2]

    def pixels(self) -> NDArray[np.uint8]:
        """(H, W, 3) the picture as it is drawn."""
        width, height = self.size
        data = self._frame.read(components=3, dtype="f1", alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def close(self) -> None:
        """Release everything."""
        for relighter in self._relighters.values():
            relighter.close()
        self._relighters.clear()
