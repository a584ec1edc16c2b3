"""3-D LUTs of view transforms that have no closed form or a slow one.

    ViewTransform -> [lut3d] -> cpu | shaders/include/lut3d.glsl

Axes are the signed 5/16th powers of linear RGB in the display's primaries, adapted from the scene's
white; values are the display's codes, which continue below 0 and above 1. An adapted eye sees
nearly those colours, so a LUT is nearly linear; black is a node; and the output needs no further
arithmetic (docs/decisions/0011-tables-in-the-displays-own-codes.md).

Baking a LUT on the host takes tenths of a second to seconds, and no frame can be drawn before.
Callers that must not wait check `Relighter.missing_lut` and bake the LUT on another thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.display import constants as k
from volspec.appearance.display.spaces import ColourSpace
from volspec.appearance.scene_to_display import CLOSED, view_transform
from volspec.appearance.spec import Viewing
from volspec.appearance.transforms import ClosedTransform, ViewTransform, signed_power, triples
from volspec.errors import LutCancelled, ViewingError

Array = NDArray[np.float64]

# Along each axis: nodes, nodes below 0, and the linear light of the last node.
# The first is at -0.25: smooth reflectances under tungsten reach -0.22 in sRGB's primaries.
NODES, NODES_BELOW, TOP = 41, 15, 1.3
# A fourth root has too many nodes near black, 3/8 too few.
AXIS_POWER = 5.0 / 16.0
# Distance between nodes, of the 5/16th power.
STEP = TOP**AXIS_POWER / (NODES - 1 - NODES_BELOW)
# A cell is valid if the interpolation at its centre is off by no more than this, in clipped codes.
TOLERANCE = 0.006
# Validity is interpolated between nodes: less means that a neighbouring cell is not valid.
ALL_VALID = 0.999
SHADER_CONSTANTS = {
    "NODES": NODES,
    "NODES_BELOW": NODES_BELOW,
    "NODE_STEP": STEP,
    "LUT_TOP": TOP,
    "LUT_TOLERANCE": TOLERANCE,
    "LUT_ALL_VALID": ALL_VALID,
}

# A light is narrow if the ratio of CAT16's gains exceeds this: high-pressure sodium has 8,
# low-pressure sodium 28.
_NARROW = 15.0
# A LUT without a closed form is baked in this many slabs; more cost time.
_SLABS = 8
# Lower bound of a response to the white, relative to its Y: narrow lights leave some near 0.
_MIN_RESPONSE = 1e-6
# LUTs per cache, 1.1 MB each: for a handful of lights that a user alternates between.
MAX_LUTS = 12


def _relative_responses(cones: Array, white_XYZ: ArrayLike) -> Array:
    """Return (3, 3): XYZ to responses, 1 for the white."""
    white = np.asarray(white_XYZ, dtype=np.float64)
    return cones / np.maximum(cones @ white, _MIN_RESPONSE * white[1])[:, None]


def is_narrow(scene_white_XYZ: ArrayLike, space: ColourSpace) -> bool:
    """Return True if a light is so far from the display's white that CAT16 adapts badly.

    LUT axes then use cone responses, in which Hunt and Nayatani adapt, and closed forms are better
    drawn directly: under single-band lights LUTs are off by up to CIEDE2000 3.
    """
    scene, display = (
        _relative_responses(k.CAT16_FROM_XYZ, white) for white in (scene_white_XYZ, space.white_XYZ)
    )
    gains = (scene / display)[:, 0]
    return bool(gains.max() > _NARROW * gains.min())


def lut_nodes(offset: float = 0.0) -> Array:
    """Return (NODES, NODES, NODES, 3) adapted linear RGB of the nodes; red varies fastest.

    ``offset`` is in steps: 0.5 returns the centres of the cells.
    """
    roots = (np.arange(-NODES_BELOW, NODES - NODES_BELOW) + offset) * STEP
    axis = signed_power(roots, 1.0 / AXIS_POWER)
    blue, green, red = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack([red, green, blue], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class LutSpace:
    """The colour spaces of a LUT's axes and values."""

    adapted_from_XYZ: Array  # to the display's linear RGB, white to white, by CAT16 or by cones
    space: ColourSpace  # the display's

    @classmethod
    def between(cls, scene_white_XYZ: ArrayLike, space: ColourSpace) -> LutSpace:
        """Make the space of LUTs from a scene's white to a display."""
        narrow = is_narrow(scene_white_XYZ, space)
        cones = k.HPE_FROM_XYZ if narrow else k.CAT16_FROM_XYZ
        scene = _relative_responses(cones, scene_white_XYZ)
        adapted = np.linalg.solve(_relative_responses(cones, space.white_XYZ), scene)
        return cls(space.RGB_from_XYZ @ adapted, space)


@dataclass(frozen=True, slots=True, eq=False)
class Lut3D:
    """A view transform as a LUT, interpolated linearly between the nodes.

    Cells with an interpolation error above `TOLERANCE`, as at a model's cliffs and poles, fall back
    to the closed form if there is one; so do colours outside of the LUT. Without a closed form,
    colours brighter than the LUT's top are scaled down to it at constant chromaticity, and colours
    below its first node are clamped.
    """

    space: LutSpace
    codes: NDArray[np.float32]  # the display's, not clipped; blue, green, red, channel
    valid: NDArray[np.float32]  # 1 if the cell above a node is within the tolerance, else 0
    fallback: ViewTransform | None  # the closed form

    @classmethod
    def of(
        cls, transform: ViewTransform, space: LutSpace, cancel: Callable[[], bool] | None = None
    ) -> Lut3D:
        """Bake a view transform.

        Without a closed form, which takes seconds, ``cancel`` is called before each eighth. Raises
        LutCancelled if it returns True, ViewingError if the transform is not finite at a node.
        """
        if not isinstance(transform, ClosedTransform):
            slabs = []
            for adapted in np.array_split(lut_nodes(), _SLABS):
                if cancel is not None and cancel():
                    raise LutCancelled("appearance LUT: cancelled")
                slabs.append(_bake(transform, space, adapted))
            codes = np.concatenate(slabs)
            return cls(space, codes, np.ones(codes.shape[:3], np.float32), None)
        codes = _bake(transform, space, lut_nodes())
        centres = _bake(transform, space, lut_nodes(0.5))
        return cls(space, codes, _check_cells(codes, centres), transform)

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) display XYZ of scene XYZ."""
        from scipy.ndimage import map_coordinates

        scene = triples("lut3d.XYZ", XYZ)
        adapted = scene @ self.space.adapted_from_XYZ.T
        if self.fallback is None:
            adapted = adapted * (TOP / np.maximum(adapted.max(axis=-1, keepdims=True), TOP))
        nodes = np.clip(signed_power(adapted, AXIS_POWER) / STEP + NODES_BELOW, 0.0, NODES - 1.0)
        places = np.moveaxis(nodes[..., ::-1], -1, 0)
        codes = [map_coordinates(self.codes[..., i], places, order=1) for i in range(3)]
        linear = self.space.space.decode(np.stack(codes, axis=-1))
        displayed: Array = linear @ np.linalg.inv(self.space.space.RGB_from_XYZ).T
        if self.fallback is None:
            return displayed
        valid = map_coordinates(self.valid, places, order=1) > ALL_VALID
        return np.where(valid[..., None], displayed, self.fallback.apply(scene))


def _bake(transform: ViewTransform, space: LutSpace, adapted: Array) -> NDArray[np.float32]:
    """Return the display's codes of adapted linear RGB under a transform."""
    XYZ = transform.apply(adapted @ np.linalg.inv(space.adapted_from_XYZ).T)
    codes = space.space.encode(XYZ @ space.space.RGB_from_XYZ.T)
    if not np.isfinite(codes).all():
        raise ViewingError(
            "appearance LUT: the model has no colour at some node", code="impossible"
        )
    return codes.astype(np.float32)


def _check_cells(codes: NDArray[np.float32], centres: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return 1 for cells in which the corners' mean is close to the centre's code, else 0.

    Cells at the LUT's edges are invalid: colours outside of the LUT are looked up there.
    """
    last = NODES - 1
    corners = [codes[k : last + k, j : last + j, i : last + i] for k, j, i in np.ndindex(2, 2, 2)]
    between = np.clip(sum(corners) / 8.0, 0.0, 1.0)
    off = np.abs(between - np.clip(centres[:last, :last, :last], 0.0, 1.0)).max(axis=-1)
    valid = np.zeros(codes.shape[:3], np.float32)
    inner = slice(1, last - 1)
    valid[inner, inner, inner] = off[inner, inner, inner] <= TOLERANCE
    return valid


def needs_host_lut(model: str) -> bool:
    """Return True if a model's transform has no shader, only a LUT baked on the host.

    >>> needs_host_lut("Hunt"), needs_host_lut("CIECAM02")
    (True, False)
    """
    return model not in CLOSED and model not in ADAPTATIONS


@dataclass(frozen=True, slots=True)
class LutKey:
    """The inputs of a LUT: a viewing without what the screen applies, and a light's white."""

    viewing: Viewing
    white_XYZ: tuple[float, ...]

    @classmethod
    def of(cls, viewing: Viewing, white_XYZ: Array) -> LutKey:
        """Make the key of a viewing, without conditions yet to be measured, under a light."""
        # Transforms do not depend on gamut mapping, nor on who looks at the display.
        display = replace(viewing.display, gamut="clip", mark=False)
        white = tuple(float(value) for value in white_XYZ)
        return cls(replace(viewing, display=display, deficiency="none", severity=1.0), white)


class LutCache:
    """The latest `MAX_LUTS` LUTs baked on the host, shared by threads and Relighters."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # Latest last; a list because a viewing's parts need not be hashable.
        self._cached: list[tuple[LutKey, NDArray[np.float32]]] = []

    def __contains__(self, key: LutKey) -> bool:
        with self._lock:
            return any(cached == key for cached, _ in self._cached)

    def texels(self, key: LutKey, cancel: Callable[[], bool] | None = None) -> NDArray[np.float32]:
        """Return (NODES, NODES, NODES, 4): a LUT's codes and validity; baked if not cached.

        See `Lut3D.of` for ``cancel`` and errors; a cancelled LUT is not cached.
        """
        with self._lock:
            lut = next((texels for cached, texels in self._cached if cached == key), None)
        if lut is None:
            lut = _bake_texels(key, cancel)
        with self._lock:
            kept = [pair for pair in self._cached if pair[0] != key]
            self._cached = [*kept, (key, lut)][-MAX_LUTS:]
        return lut


def _bake_texels(key: LutKey, cancel: Callable[[], bool] | None) -> NDArray[np.float32]:
    space = LutSpace.between(key.white_XYZ, key.viewing.display.colours)
    lut = Lut3D.of(view_transform(key.viewing, key.white_XYZ), space, cancel)
    return np.ascontiguousarray(np.concatenate([lut.codes, lut.valid[..., None]], axis=-1))
