"""Any passage as a table of three dimensions, for what has no closed form or costs too much.

    Passage -> [table] -> host | shaders/include/table.glsl

Values are the cube roots of CAT16 responses relative to the display's white, axes the 3/8th powers
of those relative to the scene's: nearly even in lightness, and black is a node. (Cube roots along
the axes are as good, and dearer.) XYZ as values are some ten times as far off, by the toe that
models have near black.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from volspec.appearance import constants as k
from volspec.appearance.passages import Passage, triples
from volspec.errors import ViewingError

Array = NDArray[np.float64]

# Nodes along each axis, from nothing to TOP times the white.
NODES = 41
TOP = 1.3
AXIS_POWER = 3.0 / 8.0


def response_matrix(white_XYZ: ArrayLike) -> Array:
    """(3, 3): XYZ to CAT16 responses, 1 for the white.

    A response that a narrow light's white lacks is counted on a thousandth of its Y instead.
    """
    white = np.asarray(white_XYZ, dtype=np.float64)
    responses = k.CAT16_FROM_XYZ @ white
    return k.CAT16_FROM_XYZ / np.maximum(responses, 1e-3 * white[1])[:, None]


def node_responses() -> Array:
    """(NODES, NODES, NODES, 3): the scene's responses at the nodes, 0 to 1, red the fastest."""
    axis = np.linspace(0.0, 1.0, NODES) ** (1.0 / AXIS_POWER)
    blue, green, red = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack([red, green, blue], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class TableSpace:
    """What a table's axes and values stand for.

    Parameters
    ----------
    response_from_XYZ : (3, 3)
        The scene's `response_matrix` over TOP.
    XYZ_from_response : (3, 3)
        The inverse of the display's.
    """

    response_from_XYZ: Array
    XYZ_from_response: Array

    @classmethod
    def between(cls, scene_white_XYZ: ArrayLike, display_white_XYZ: ArrayLike) -> TableSpace:
        """The space of tables from one white to another."""
        shown: Array = np.asarray(np.linalg.inv(response_matrix(display_white_XYZ)), np.float64)
        return cls(response_matrix(scene_white_XYZ) / TOP, shown)


@dataclass(frozen=True, slots=True, eq=False)
class TablePassage:
    """A passage looked up, linear between the nodes; total, beyond them the nearest.

    Parameters
    ----------
    space : TableSpace
    roots : (NODES, NODES, NODES, 3) float32
        Cube roots of the display's relative responses; blue, green, red, and which of them.
    """

    space: TableSpace
    roots: NDArray[np.float32]

    @classmethod
    def of(cls, passage: Passage, space: TableSpace) -> TablePassage:
        """Tabulate a passage.

        Raises
        ------
        ViewingError
            If the passage is not finite at a node.
        """
        XYZ = node_responses() @ np.linalg.inv(space.response_from_XYZ).T
        roots = np.cbrt(passage.apply(XYZ) @ np.linalg.inv(space.XYZ_from_response).T)
        if not np.isfinite(roots).all():
            raise ViewingError("appearance table: the model gives no colour at some node")
        return cls(space, roots.astype(np.float32))

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) scene XYZ to display XYZ."""
        responses = triples("appearance table: XYZ", XYZ) @ self.space.response_from_XYZ.T
        at = np.clip(responses, 0.0, 1.0) ** AXIS_POWER * (NODES - 1)
        places = np.moveaxis(at[..., ::-1], -1, 0)
        roots = [map_coordinates(self.roots[..., i], places, order=1) for i in range(3)]
        return np.stack(roots, axis=-1).astype(np.float64) ** 3 @ self.space.XYZ_from_response.T
