"""Any passage as a table of three dimensions, for what has no closed form or costs too much.

    Passage -> [table] -> host | shaders/include/table.glsl

Axes are the signed 5/16th powers of linear RGB in the display's primaries, adapted to the scene's
white; values are the display's codes, which go on below 0 and above 1. An eye that is adapted sees
nearly those colours, so a table bends little; black is a node; and what comes out of it needs no
further arithmetic (docs/decisions/0011-tables-in-the-displays-own-codes.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance.passages import ClosedPassage, Passage, signed_power, triples
from volspec.appearance.spaces import ColourSpace
from volspec.errors import TableCancelled, ViewingError

Array = NDArray[np.float64]

# Along each axis: how many nodes, how many of them below 0, and the linear light of the last.
# The first is at -0.25: smooth reflectances under tungsten reach -0.22 in sRGB's primaries.
NODES, NODES_BELOW, TOP = 41, 15, 1.3
# A fourth root has too many nodes near black, 3/8 too few.
AXIS_POWER = 5.0 / 16.0
# Between nodes, of the power.
STEP = TOP**AXIS_POWER / (NODES - 1 - NODES_BELOW)
# A cell is trusted in which half-way between its nodes the codes, clipped, are off by no more.
TRUST = 0.006
# Of trust interpolated between nodes: less means that a cell around does not hold.
WHOLLY = 0.999
SHADER_CONSTANTS = {
    "NODES": NODES,
    "NODES_BELOW": NODES_BELOW,
    "NODE_STEP": STEP,
    "TABLE_TOP": TOP,
    "TABLE_TRUST": TRUST,
    "TABLE_WHOLLY": WHOLLY,
}


# From this ratio of CAT16's gains on a light is narrow: high-pressure sodium has 8, low-pressure
# sodium 28.
_NARROW = 15.0
# Slabs of nodes that a table without a closed form is made in: more of them cost time.
_SLABS = 8
# Of the white's Y: a response that a narrow light's white lacks is counted on this much.
_LEAST_RESPONSE = 1e-6


def _relative(cones: Array, white_XYZ: ArrayLike) -> Array:
    """(3, 3): XYZ to responses, 1 for the white."""
    white = np.asarray(white_XYZ, dtype=np.float64)
    return cones / np.maximum(cones @ white, _LEAST_RESPONSE * white[1])[:, None]


def is_narrow(scene_white_XYZ: ArrayLike, space: ColourSpace) -> bool:
    """Whether a light is so far from the display's white that CAT16's responses adapt badly.

    Tables are then made over cone responses, as Hunt and Nayatani adapt, and what has a closed form
    is better drawn by it: under single bands tables are off by up to CIEDE2000 3.
    """
    scene, display = (_relative(k.CAT16_FROM_XYZ, w) for w in (scene_white_XYZ, space.white_XYZ))
    gains = (scene / display)[:, 0]
    return bool(gains.max() > _NARROW * gains.min())


def nodes(offset: float = 0.0) -> Array:
    """(NODES, NODES, NODES, 3): adapted linear RGB at the nodes, or beside them; red the fastest.

    ``offset`` is in steps: at 0.5 lie the middles of the cells.
    """
    roots = (np.arange(-NODES_BELOW, NODES - NODES_BELOW) + offset) * STEP
    axis = signed_power(roots, 1.0 / AXIS_POWER)
    blue, green, red = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack([red, green, blue], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class TableSpace:
    """What a table's axes and values stand for.

    Parameters
    ----------
    adapted_from_XYZ : (3, 3)
        Scene XYZ to linear RGB of the display, white to white, by CAT16's responses or by cones.
    space : ColourSpace
        The display's.
    """

    adapted_from_XYZ: Array
    space: ColourSpace

    @classmethod
    def between(cls, scene_white_XYZ: ArrayLike, space: ColourSpace) -> TableSpace:
        """The space of tables from a scene's white to a display."""
        narrow = is_narrow(scene_white_XYZ, space)
        cones = k.HPE_FROM_XYZ if narrow else k.CAT16_FROM_XYZ
        scene, display = (_relative(cones, w) for w in (scene_white_XYZ, space.white_XYZ))
        adapted = np.linalg.solve(display, scene)
        return cls(space.RGB_from_XYZ @ adapted, space)


@dataclass(frozen=True, slots=True, eq=False)
class TablePassage:
    """A passage looked up, linear between the nodes.

    What has a closed form is drawn by it in cells that bend too much, where the model has a cliff
    or a pole, and beyond the table. What has none is brought within the table's top at its
    chromaticity, and is the nearest where it lies below.

    Parameters
    ----------
    space : TableSpace
    codes : (NODES, NODES, NODES, 3) float32
        The display's, not clipped; blue, green, red, and which of them.
    trusted : (NODES, NODES, NODES) float32
        1 where the cell above a node holds, else 0.
    behind : Passage or None
        The closed form.
    """

    space: TableSpace
    codes: NDArray[np.float32]
    trusted: NDArray[np.float32]
    behind: Passage | None

    @classmethod
    def of(
        cls, passage: Passage, space: TableSpace, cancel: Callable[[], bool] | None = None
    ) -> TablePassage:
        """Tabulate a passage.

        Parameters
        ----------
        passage : Passage
        space : TableSpace
        cancel : callable, optional
            Asked before each eighth, where there is no closed form: the whole takes up to seconds.

        Raises
        ------
        ViewingError
            If the passage is not finite at a node.
        TableCancelled
            If ``cancel`` says so.
        """
        if not isinstance(passage, ClosedPassage):
            slabs = []
            for adapted in np.array_split(nodes(), _SLABS):
                if cancel is not None and cancel():
                    raise TableCancelled("appearance table: cancelled")
                slabs.append(_codes(passage, space, adapted))
            codes = np.concatenate(slabs)
            return cls(space, codes, np.ones(codes.shape[:3], np.float32), None)
        codes = _codes(passage, space, nodes())
        middles = _codes(passage, space, nodes(0.5))
        return cls(space, codes, _trusted(codes, middles), passage)

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) scene XYZ to display XYZ."""
        from scipy.ndimage import map_coordinates

        scene = triples("appearance table: XYZ", XYZ)
        adapted = scene @ self.space.adapted_from_XYZ.T
        if self.behind is None:
            adapted = adapted * (TOP / np.maximum(adapted.max(axis=-1, keepdims=True), TOP))
        at = np.clip(signed_power(adapted, AXIS_POWER) / STEP + NODES_BELOW, 0.0, NODES - 1.0)
        places = np.moveaxis(at[..., ::-1], -1, 0)
        codes = [map_coordinates(self.codes[..., i], places, order=1) for i in range(3)]
        linear = self.space.space.decode(np.stack(codes, axis=-1))
        shown: Array = linear @ np.linalg.inv(self.space.space.RGB_from_XYZ).T
        if self.behind is None:
            return shown
        held = map_coordinates(self.trusted, places, order=1) > WHOLLY
        return np.where(held[..., None], shown, self.behind.apply(scene))


def _codes(passage: Passage, space: TableSpace, adapted: Array) -> NDArray[np.float32]:
    """The display's codes of a passage."""
    XYZ = passage.apply(adapted @ np.linalg.inv(space.adapted_from_XYZ).T)
    codes = space.space.encode(XYZ @ space.space.RGB_from_XYZ.T)
    if not np.isfinite(codes).all():
        raise ViewingError("appearance table: the model gives no colour at some node")
    return codes.astype(np.float32)


def _trusted(codes: NDArray[np.float32], middles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Whether the mean of a cell's corners is what the passage has in its middle.

    Cells at the table's edges are not: what lies beyond is looked up there.
    """
    last = NODES - 1
    corners = [codes[k : last + k, j : last + j, i : last + i] for k, j, i in np.ndindex(2, 2, 2)]
    between = np.clip(sum(corners) / 8.0, 0.0, 1.0)
    off = np.abs(between - np.clip(middles[:last, :last, :last], 0.0, 1.0)).max(axis=-1)
    trusted = np.zeros(codes.shape[:3], np.float32)
    inner = slice(1, last - 1)
    trusted[inner, inner, inner] = off[inner, inner, inner] <= TRUST
    return trusted
