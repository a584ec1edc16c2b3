"""What the light volume is: its grid, the sources that have a layer, and how they are sampled.

    volume -> transfer -> [light volume] -> raycast -> relight

Extinction is gathered on the nodes of a coarse grid [1]; from every node the light's way out is
followed through it [2]. Ambient occlusion is the same along directions over the whole sphere [3],
as far as the source's radius. Surfaces are offset along their normals against shadowing
themselves [4].

References
----------
[1] Behrens & Ratering (1998), "Adding shadows to a texture-based volume renderer",
    IEEE Symposium on Volume Visualization, 39-46.
[2] Kajiya & Von Herzen (1984), "Ray tracing volume densities", SIGGRAPH, 165-174.
[3] Hernell, Ljung & Ynnerman (2010), "Local ambient occlusion in direct volume rendering",
    IEEE TVCG 16(4), 548-559.
[4] Holbert (2011), "Saying 'goodbye' to shadow acne", Game Developers Conference, poster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from volspec.errors import RaycastError
from volspec.raycast.camera import Camera
from volspec.raycast.checks import Vector
from volspec.raycast.lights import Ambient, Directional, Point
from volspec.raycast.packed import sources_of
from volspec.raycast.spec import RaycastSpec
from volspec.volume import Volume

MIN_CELLS = 4
# −log(1 − opacity) has no value at 1.
OPAQUE = 1 - 1e-4
# In cells: where a node's own surroundings end, against surfaces that shadow themselves.
SHADOW_BIAS, OCCLUSION_BIAS = 1.0, 0.5
DIRECTIONS = 24
# A flat wall sees half a sphere, and that is all the light it can get.
OCCLUSION_GAIN = 2.0
# In cells: how far in front of surfaces light is read, along their normal; nodes within and behind
# them are dark. The gradient that tells shading from noise tells surfaces from even media.
LIFT = 2.0
# In smallest spacings: voxels as near as this to a cut stay, in float32 as in float64.
CUT_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class LightGrid:
    """Nodes spread from a volume's first to its last voxel along each axis.

    Parameters
    ----------
    shape_xyz : (int, int, int)
        Nodes along x, y, z; two or more.
    cell_mm : float
        Length of a step of the light: a cell along the longest axis.
    per_index : (x, y, z)
        Nodes per voxel: a grid position is ``index * per_index``.
    grid_from_world : (4, 4)
        Grid position of a place in mm.

    Raises
    ------
    RaycastError
        If a number is out of range.
    """

    shape_xyz: tuple[int, int, int]
    cell_mm: float
    per_index: Vector
    grid_from_world: NDArray[np.float64]

    def __post_init__(self) -> None:
        if min(self.shape_xyz) < 2:
            raise RaycastError(f"light grid: {self.shape_xyz} nodes; give 2 or more an axis")
        if not (math.isfinite(self.cell_mm) and self.cell_mm > 0):
            raise RaycastError.refused(
                "light grid: cell_mm", self.cell_mm, "give mm above 0", "range"
            )
        if np.shape(self.grid_from_world) != (4, 4):
            raise RaycastError("light grid: grid_from_world must be a (4, 4) matrix")

    @classmethod
    def of(cls, volume: Volume, cells: int) -> LightGrid:
        """``cells`` nodes along the longest side, as dense along the others, at least 4.

        >>> LightGrid.of(Volume(np.zeros((5, 9, 17), np.uint8)), 9).shape_xyz
        (9, 5, 4)
        """
        voxels = np.array(volume.shape_xyz)
        sides = (voxels - 1) * np.array(volume.spacing_mm)
        cell = sides.max() / (cells - 1)
        nodes = np.maximum(np.rint(sides / cell).astype(int) + 1, MIN_CELLS)
        per_index = (nodes - 1) / (voxels - 1)
        x, y, z = (int(n) for n in nodes)
        fx, fy, fz = (float(f) for f in per_index)
        matrix = np.diag([fx, fy, fz, 1.0]) @ volume.index_from_world
        return cls((x, y, z), float(cell), (fx, fy, fz), matrix)

    @property
    def nodes(self) -> int:
        """How many there are."""
        return math.prod(self.shape_xyz)

    @property
    def diagonal_steps(self) -> int:
        """Steps of a cell after which light has left the grid whatever its way."""
        world_from_grid = np.linalg.inv(self.grid_from_world[:3, :3])
        corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        across = world_from_grid @ (corners * (np.array(self.shape_xyz) + 1)).T
        return math.ceil(np.linalg.norm(across, axis=0).max() / self.cell_mm) + 1

    @property
    def lift_mm(self) -> float:
        """How far in front of surfaces light is read: `LIFT` cells, or voxels where these are
        larger."""
        return LIFT * self.cell_mm * max(1.0, *self.per_index)

    def per_step(self, direction: Vector | NDArray[np.float64]) -> NDArray[np.float64]:
        """(3,) the way in the grid of one cell along a unit direction of the world."""
        return self.grid_from_world[:3, :3] @ np.asarray(direction) * self.cell_mm


@dataclass(frozen=True, slots=True)
class LightLayer:
    """One source's layer of a light volume, for one camera.

    Parameters
    ----------
    source : int
        Which one, by its place in `volspec.raycast.packed.sources_of`.
    kind : {"directional", "point", "occlusion"}
    vector : (x, y, z)
        In the world: the unit direction towards a directional light, the place of a point light
        in mm; of no use for occlusion.
    radius_mm : float
        How far occluders reach; of no use for the others.
    """

    source: int
    kind: Literal["directional", "point", "occlusion"]
    vector: Vector = (0.0, 0.0, 0.0)
    radius_mm: float = 0.0

    @property
    def light(self) -> tuple[str, Vector, float]:
        """What the layer's content depends on besides the extinction."""
        return self.kind, self.vector, self.radius_mm


def light_layers(spec: RaycastSpec, volume: Volume, camera: Camera) -> tuple[LightLayer, ...]:
    """The sources that ask for a layer, in order of groups and of sources within them.

    None in projections, where every source counts as faced.
    """
    if spec.mode != "composite":
        return ()
    found = []
    for number, (_, source) in enumerate(sources_of(spec)):
        if isinstance(source, Directional) and source.shadows:
            x, y, z = camera.to_world(source.towards, source.frame).tolist()
            found.append(LightLayer(number, "directional", (x, y, z)))
        elif isinstance(source, Point) and source.shadows:
            x, y, z = camera.place_mm(source.position_mm, source.frame).tolist()
            found.append(LightLayer(number, "point", (x, y, z)))
        elif isinstance(source, Ambient) and source.occlusion:
            sides = np.multiply(np.array(volume.shape_xyz) - 1, volume.spacing_mm)
            radius = source.radius_mm or float(np.linalg.norm(sides)) / 10
            found.append(LightLayer(number, "occlusion", radius_mm=radius))
    return tuple(found)


def sphere_directions() -> NDArray[np.float64]:
    """(DIRECTIONS, 3) unit vectors spread over the sphere along a Fibonacci spiral."""
    i = np.arange(DIRECTIONS)
    z = 1 - (2 * i + 1) / DIRECTIONS
    turn = i * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def steps(begin: float, end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles and lengths of steps of one cell from ``begin`` to ``end``, the last cut short.

    >>> [a.tolist() for a in steps(0.5, 3.0)]
    [[1.0, 2.0, 2.75], [1.0, 1.0, 0.5]]
    """
    edges = np.append(np.arange(begin, end, 1.0), max(begin, end))
    return (edges[:-1] + edges[1:]) / 2, np.diff(edges)


def shadow_steps(grid: LightGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The steps of light from a node out of the grid."""
    return steps(SHADOW_BIAS, SHADOW_BIAS + grid.diagonal_steps)


def occlusion_steps(
    grid: LightGrid, radius_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The steps from a node as far as occluders reach, but not beyond the grid: there is none."""
    end = min(radius_mm / grid.cell_mm, OCCLUSION_BIAS + grid.diagonal_steps)
    return steps(OCCLUSION_BIAS, end)


def extinction_per_mm(opacity: NDArray[np.float64], length_mm: float) -> NDArray[np.float64]:
    """−log(1 − opacity) / length; opacity is held at `OPAQUE`."""
    return -np.log1p(-np.minimum(opacity, OPAQUE)) / length_mm
