"""How a cast marches, shades and clips: settings, frozen and valid at birth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from volspec.errors import RaycastError, nearest, quoted
from volspec.raycast.checks import Vector, number, positive, unit_vector, vector, weight, whole
from volspec.raycast.lights import HEADLIT, MAX_GROUPS, MAX_SOURCES, Ambient, LightGroup
from volspec.volume import Volume

Bounds = tuple[float, float]
Mode = Literal["composite", "maximum", "average"]
MODES = ("composite", "maximum", "average")
MAX_PLANES = 6
# A ray of more samples than this is a slip of the step, not a picture.
MAX_STEPS = 1 << 17


@dataclass(frozen=True, slots=True)
class ClipPlane:
    """A plane that cuts the volume; the side its normal points to stays.

    Parameters
    ----------
    point_mm : (x, y, z)
        Any point of the plane.
    normal : (x, y, z)
        Towards what stays; of any length but 0, kept as a unit vector.
    """

    point_mm: Vector
    normal: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_mm", vector("clip plane: point_mm", self.point_mm))
        object.__setattr__(self, "normal", unit_vector("clip plane: normal", self.normal))


@dataclass(frozen=True, slots=True)
class RaycastSpec:
    """How a ray is marched and shaded.

    Parameters
    ----------
    step_mm : float, optional
        Distance of samples; half the volume's smallest spacing when left out.
    ambient, diffuse, specular : float
        How surfaces reflect: weights ≥ 0 of light from everywhere, two-sided Lambert and
        Blinn-Phong. With ``diffuse`` and ``specular`` 0 no gradient is computed;
        ``ambient=1, diffuse=0`` shows the plain reflectances.
    shininess : int
        Blinn-Phong exponent, 1 to 1024; whole, since integer powers cost a few products.
    alpha_stop : float
        A ray ends when its opacity passes this; above 0, up to 1 (never ends early).
    flat_gradient : float
        Gradients below this share of the volume's range per smallest spacing fade to
        unshaded, so that noise in flat regions leaves no speckle.
    groups : tuple of LightGroup
        Where light comes from; each group leaves a layer of channels. One group of ambient light
        and a headlight when left out.
    mode : {"composite", "maximum", "average"}
        What a ray gathers: opacity and colour; or the greatest or the mean value along it, which
        the transfer function then shows.
    jitter : float
        Share of a step, 0 to 1, by which the samples of a ray are shifted at random, against
        rings of wood grain; the picture stays the same for the same ``seed``.
    seed : int
        Of the jitter.
    preintegrated : bool
        Integrate the transfer function between a step's two ends instead of reading it once at
        the middle: far fewer bands where it is steep.
    adaptive : float
        Steps grow to 2 or 4 where the transfer function's opacity of a step varies by less than
        this within a brick of 4 voxels; 0 keeps every step.
    crop_voxels : ((x0, x1), (y0, y1), (z0, z1)), optional
        What stays, in voxel indices.
    clip_planes : tuple of ClipPlane
        Up to six.
    light_cells : int
        Cells of the light volume (shadows, ambient occlusion) along the longest axis, 8 to 512.
    half : bool
        Keep the picture's channels as float16: half the memory, three digits.
    first_opacity : float
        Opacity at which something counts as hit, for `CoefficientImage.first_mm`.
    tile_ms : float
        About how long one launch on the device may take; a driver kills long ones, and between
        two a cast can be cancelled.

    Raises
    ------
    RaycastError
        If a number is out of range, a crop is empty or there are too many lights or planes.
    """

    step_mm: float | None = None
    ambient: float = 0.3
    diffuse: float = 0.7
    specular: float = 0.0
    shininess: int = 32
    alpha_stop: float = 0.9995
    flat_gradient: float = 0.02
    groups: tuple[LightGroup, ...] = HEADLIT
    mode: Mode = "composite"
    jitter: float = 0.0
    seed: int = 0
    preintegrated: bool = False
    adaptive: float = 0.0
    crop_voxels: tuple[Bounds, Bounds, Bounds] | None = None
    clip_planes: tuple[ClipPlane, ...] = ()
    light_cells: int = 96
    half: bool = False
    first_opacity: float = 0.1
    tile_ms: float = 20.0

    def __post_init__(self) -> None:
        for name in ("preintegrated", "half"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise RaycastError(f"raycast: {name} is {quoted(getattr(self, name))}; give a bool")
        for name in ("ambient", "diffuse", "specular", "flat_gradient", "adaptive"):
            weight(f"raycast: {name}", getattr(self, name))
        whole("raycast: shininess", self.shininess, 1, 1024)
        whole("raycast: seed", self.seed, 0, 2**32 - 1)
        whole("raycast: light_cells", self.light_cells, 8, 512)
        if self.step_mm is not None:
            positive("raycast: step_mm", self.step_mm)
        positive("raycast: tile_ms", self.tile_ms)
        for name in ("alpha_stop", "first_opacity"):
            value = number(f"raycast: {name}", getattr(self, name))
            if not 0 < value <= 1:
                raise RaycastError(f"raycast: {name} is {value}; give 0…1, above 0")
        if not 0 <= number("raycast: jitter", self.jitter) <= 1:
            raise RaycastError(f"raycast: jitter is {self.jitter}; give 0 to 1 step")
        if self.mode not in MODES:
            raise RaycastError(
                f"raycast: mode is {quoted(self.mode)}; {nearest(str(self.mode), MODES)}"
                f"give {', '.join(MODES)}"
            )
        if self.preintegrated and self.mode != "composite":
            raise RaycastError(f"raycast: preintegrated has no meaning with mode {self.mode!r}")
        self._check_groups()
        self._check_cuts()

    def _check_groups(self) -> None:
        given = self.groups
        groups = tuple(given) if isinstance(given, list | tuple) else (given,)
        if not groups or not all(isinstance(group, LightGroup) for group in groups):
            raise RaycastError(
                f"raycast: groups is {quoted(groups, 60)}; give LightGroups, at least one"
            )
        names = [group.name for group in groups]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise RaycastError(f"raycast: two light groups are named {twice!r}; rename one")
        sources = sum(len(group.sources) for group in groups)
        if len(groups) > MAX_GROUPS or sources > MAX_SOURCES:
            raise RaycastError(
                f"raycast: {len(groups)} light groups with {sources} sources; at most "
                f"{MAX_GROUPS} and {MAX_SOURCES} can be cast"
            )
        object.__setattr__(self, "groups", groups)

    def _check_cuts(self) -> None:
        given = self.clip_planes
        planes = tuple(given) if isinstance(given, list | tuple) else (given,)
        if len(planes) > MAX_PLANES or not all(isinstance(p, ClipPlane) for p in planes):
            raise RaycastError(
                f"raycast: clip_planes is {quoted(planes, 60)}; give up to {MAX_PLANES} ClipPlanes"
            )
        object.__setattr__(self, "clip_planes", planes)
        if self.crop_voxels is None:
            return
        try:
            crop = np.asarray(self.crop_voxels, dtype=np.float64)
        except (TypeError, ValueError):
            crop = np.empty(0)
        if crop.shape != (3, 2) or not np.isfinite(crop).all():
            raise RaycastError(
                f"raycast: crop_voxels is {quoted(self.crop_voxels, 80)}; "
                "give ((x0, x1), (y0, y1), (z0, z1))"
            )
        for axis, (low, high) in zip("xyz", crop, strict=True):
            if not low < high:
                raise RaycastError(
                    f"raycast: crop_voxels along {axis} is {low:g} to {high:g}; nothing would be "
                    "left, give two that rise"
                )
        object.__setattr__(
            self, "crop_voxels", tuple((float(low), float(high)) for low, high in crop)
        )

    @property
    def shaded(self) -> bool:
        """Whether gradients are needed for shading."""
        directed = any(
            not isinstance(source, Ambient) for group in self.groups for source in group.sources
        )
        return directed and (self.diffuse > 0 or self.specular > 0)

    def strengths(self) -> dict[str, float]:
        """What each group gives a white surface that faces all of its sources.

        Layers keep their intensities: at relative level such a white has Y = 100 times the sum
        of the strengths, which is 1 by default.
        """
        return {
            group.name: sum(
                source.intensity * (self.ambient if isinstance(source, Ambient) else self.diffuse)
                for source in group.sources
            )
            for group in self.groups
        }

    def shares(self) -> dict[str, float]:
        """How much of the light on a surface that faces every source each group gives; sum 1.

        Layers are not divided by the sum of `strengths`: shares only part what there is.
        """
        strength = self.strengths()
        total = sum(strength.values())
        if total == 0:
            return dict.fromkeys(strength, 1 / len(strength))
        return {name: value / total for name, value in strength.items()}

    def step_of(self, volume: Volume) -> float:
        """The step in millimetres for a volume.

        Raises
        ------
        RaycastError
            If a ray through the volume would take more than `MAX_STEPS` or less than one.
        """
        half_a_voxel = 0.5 * min(volume.spacing_mm)
        diagonal = diagonal_mm(volume)
        if self.step_mm is None:
            if diagonal / half_a_voxel > MAX_STEPS:
                raise RaycastError(
                    f"raycast: step_mm is left out, half of {volume.name}'s smallest spacing is "
                    f"{half_a_voxel:g} and it is {diagonal:g} mm across: "
                    f"{diagonal / half_a_voxel:g} steps; give step_mm, {diagonal / MAX_STEPS:.2g} "
                    "or more"
                )
            return half_a_voxel
        if not 1 <= diagonal / self.step_mm <= MAX_STEPS:
            raise RaycastError(
                f"raycast: step_mm is {self.step_mm:g} and {volume.name} {diagonal:g} mm across: "
                f"{diagonal / self.step_mm:g} steps; give 1 to {MAX_STEPS}, half a voxel is "
                f"{half_a_voxel:g}"
            )
        return self.step_mm

    def kept(self, volume: Volume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest index (x, y, z) of what the crop leaves of a volume.

        Raises
        ------
        RaycastError
            If it leaves nothing.
        """
        last = np.array(volume.shape_xyz) - 1.0
        if self.crop_voxels is None:
            return np.zeros(3), last
        low, high = np.array(self.crop_voxels).T
        for axis, near, far, end in zip("xyz", low, high, last, strict=True):
            if near >= end or far <= 0:
                raise RaycastError(
                    f"raycast: crop_voxels along {axis} is {near:g} to {far:g}; {volume.name} "
                    f"reaches from 0 to {end:g}, nothing would be left"
                )
        return np.maximum(low, 0.0), np.minimum(high, last)

    def index_planes(self, volume: Volume) -> NDArray[np.float64]:
        """(P, 4) clip planes in index space: normal · index ≥ w is kept, normals per voxel."""
        world = volume.world_from_index
        rows = np.zeros((len(self.clip_planes), 4))
        for row, plane in zip(rows, self.clip_planes, strict=True):
            normal = np.asarray(plane.normal)
            row[:3] = normal @ world[:3, :3]
            row[3] = normal @ (np.asarray(plane.point_mm) - world[:3, 3])
            row /= np.linalg.norm(row[:3])
        return rows

    def gradient_scale(self, volume: Volume) -> float:
        """Value per smallest spacing -> share of the volume's range; 0 for a constant one."""
        low, high = volume.range
        return 1 / (high - low) if high > low else 0.0

    @property
    def gradient_floor_squared(self) -> float:
        """`flat_gradient` squared; never 0, so that 0/0 cannot arise."""
        return max(self.flat_gradient**2, 1e-12)


def diagonal_mm(volume: Volume) -> float:
    """Of the volume's box along the axes of the world."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
