"""Settings of a cast: marching, shading and clipping; frozen and validated on construction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from volspec._checks import Direction, Weight
from volspec.errors import InputError, RaycastError, nearest
from volspec.image import MAX_LAYERS
from volspec.raycast.lights import HEADLIT, MAX_GROUPS, MAX_SOURCES, Ambient, LightGroup, as_tuple
from volspec.raycast.step_search import ErrorTarget, Quality, target_of
from volspec.settings import (
    PYTHON_ONLY,
    Box,
    Fraction,
    Hint,
    NotNegative,
    Positive,
    Unit,
    Vector,
    settings,
)
from volspec.volume import Volume

Mode = Literal["composite", "maximum", "average"]
MODES: tuple[Mode, ...] = get_args(Mode)
MAX_PLANES = 6
# More samples per ray than this are due to a mistaken step.
MAX_STEPS = 1 << 17
Opacity = Annotated[float, Field(gt=0, le=1)]


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class ClipPlane:
    """A plane that cuts the volume; the side that its normal points to stays."""

    point_mm: Annotated[Vector, Field(examples=[[0, 0, 0]]), Unit("mm")]
    """Any point on the plane."""
    normal: Annotated[Direction, Field(examples=[[0, 0, 1]])]
    """Direction towards the side that stays; of any length but 0, stored as a unit vector."""
    fields: Annotated[tuple[str, ...], BeforeValidator(as_tuple), Field(strict=False)] = ()
    """Names of the fields that it cuts, ``""`` for the volume's own; all of them if empty."""


def _crop(box: Box) -> Box:
    for axis, (low, high) in enumerate(box):
        if not low < high:
            raise InputError(
                f"along {'xyz'[axis]} is {low:g} to {high:g}",
                "nothing would be left, give two increasing numbers",
                code="range",
                given=box,
            )
    return box


@settings(RaycastError)
@dataclass(frozen=True, slots=True)
class RaycastSpec:
    """Marching and shading of rays.

    Raises
    ------
    RaycastError
        If a number is out of range, a crop is empty or there are too many lights or planes.
    """

    quality: Annotated[
        Quality | Annotated[float, Field(ge=1e-6, le=0.1)],
        Hint("fast, balanced, exact, or an error of 1e-6 to 0.1", whole=True),
    ] = "balanced"
    """Error that a picture may have: fast, balanced, exact, or a number. It is the root mean square
    over the channels of what is seen, where 1 is a white surface that faces all lights: 0.02, 0.005
    and 0.0005. By trial casts of few of the picture's rays, the step becomes as long as it allows,
    from 2, 1 and 0.5 of the volume's smallest spacings down to 1/16, with a warning if that leaves
    more; rays end when what is behind can add no more. Isosurfaces are met at any step."""
    step_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance between samples; by quality if left out."""
    ambient: Weight = 0.3
    """Weight of light from all directions. With ``ambient`` 1 and ``diffuse`` 0 the plain
    reflectances are shown."""
    diffuse: Weight = 0.7
    """Weight of directed light: two-sided Lambert. With ``diffuse`` and ``specular`` 0 no
    gradient is computed."""
    specular: Weight = 0.0
    """Weight of highlights: Blinn-Phong."""
    shininess: Annotated[int, Field(ge=1, le=1024)] = 32
    """Blinn-Phong exponent, the sharpness of highlights; whole, since integer powers cost a few
    products."""
    alpha_stop: Opacity | None = None
    """A ray ends when its opacity passes this value; at 1 it never does; by quality if left out."""
    flat_gradient: Weight = 0.02
    """Gradients below this fraction of the volume's range per smallest spacing fade to unshaded, so
    that noise in flat regions leaves no speckle."""
    groups: Annotated[
        tuple[LightGroup, ...],
        BeforeValidator(as_tuple),
        Field(strict=False, min_length=1),
        PYTHON_ONLY,
    ] = HEADLIT
    """Light sources; each group fills a layer of channels. One group of ambient light and a
    headlight if left out."""
    mode: Mode = "composite"
    """Result of a ray: opacity and colour, or the greatest or the mean value along the ray, which
    the transfer function then maps."""
    jitter: Fraction = 0.0
    """Fraction of a step by which the samples of a ray are shifted at random, to avoid wood-grain
    artefacts."""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    """Seed of the jitter: the same seed gives the same picture."""
    preintegrated: bool = False
    """Integrate the transfer function between a step's two ends instead of reading it once at the
    middle: far fewer bands where it is steep."""
    adaptive: Weight = 0.0
    """Steps lengthen two- or fourfold where a step's opacity varies by less than this within a
    brick of 4 voxels; 0 keeps all steps equal."""
    crop_voxels: (
        Annotated[
            Box,
            AfterValidator(_crop),
            Hint("three pairs of numbers, [[x0, x1], [y0, y1], [z0, z1]]", whole=True),
        ]
        | None
    ) = None
    """Range that stays along x, y and z, in voxel indices (after downsample; of the finest level
    of a volume that is larger than memory)."""
    clip_planes: Annotated[
        tuple[ClipPlane, ...], BeforeValidator(as_tuple), Field(strict=False, max_length=MAX_PLANES)
    ] = ()
    """Up to six planes; the side that the normal points to stays."""
    level: Annotated[int, Field(ge=0)] | None = None
    """Level of detail of a volume that is larger than memory, 0 for the finest; if left out, the
    coarsest whose voxels are no larger than a pixel."""
    light_cells: Annotated[int, Field(ge=8, le=512)] = 96
    """Cells of the light volume (shadows, ambient occlusion) along the longest axis."""
    physical_light: bool = False
    """Shadows and occlusion as rays through the voxels give them: the light volume has a node for
    each voxel, up to 512 along an axis, instead of ``light_cells``, and is read where samples are,
    which makes rough surfaces darker; in front of opaque matter and of isosurfaces."""
    add_fields: bool = False
    """The light of several fields adds, as in fluorescence: each is cast by itself, and none
    absorbs or hides another's. Where green and magenta are both seen it is white."""
    half: bool = False
    """Store the picture's channels as float16: half the memory, three digits."""
    first_opacity: Opacity = 0.1
    """Opacity at which a ray counts as having hit something, for `CoefficientImage.first_mm`."""
    layers: Annotated[int, Field(ge=0, le=MAX_LAYERS)] = 0
    """Layers of opacity along each ray, by which up to four materials fade without a new cast: 8 to
    16, or 0 for none. The basis must be of materials; opaque meshes take one. See
    `CoefficientImage.recompose`."""
    opacities: Annotated[
        dict[str, NotNegative], Hint("{ material = scale, … }, each 0 or more", whole=True)
    ] = field(default_factory=dict, hash=False)
    """Scales of materials' optical depths: 0 hides one, 2 is twice as much of it. The basis must be
    of materials. Layers are those of the scaled depths, and are scaled further from there."""
    tile_ms: Annotated[Positive, Unit("ms"), PYTHON_ONLY] = 20.0
    """Approximate time of one launch on the device; drivers kill long launches, and a cast can be
    cancelled between two."""

    def __post_init__(self) -> None:
        if self.preintegrated and self.mode != "composite":
            raise RaycastError(
                f"has no meaning with mode {self.mode!r}",
                "leave out one of them",
                code="conflict",
                field="preintegrated",
                given=True,
            )
        if self.layers and (self.mode != "composite" or self.preintegrated):
            other = "preintegrated" if self.preintegrated else f"mode {self.mode!r}"
            raise RaycastError(
                f"{self.layers} layers do not work with {other}",
                "leave out one of them",
                code="conflict",
                field="layers",
                given=self.layers,
            )
        names = [group.name for group in self.groups]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise RaycastError(
                f"two light groups are named {twice!r}",
                "rename one",
                code="duplicate",
                field="groups",
                given=twice,
            )
        sources = sum(len(group.sources) for group in self.groups)
        if len(self.groups) > MAX_GROUPS or sources > MAX_SOURCES:
            raise RaycastError(
                f"{len(self.groups)} light groups with {sources} sources",
                f"give up to {MAX_GROUPS} and {MAX_SOURCES}",
                code="size",
                field="groups",
                given=sources,
            )

    @property
    def least_transmittance(self) -> float:
        """Transmittance at which a ray ends."""
        return self.target.error if self.alpha_stop is None else 1.0 - self.alpha_stop

    @property
    def target(self) -> ErrorTarget:
        """Error that a picture may have, and the longest step."""
        return target_of(self.quality)

    @property
    def shaded(self) -> bool:
        """True if shading needs gradients."""
        directed = any(
            not isinstance(source, Ambient) for group in self.groups for source in group.sources
        )
        return directed and (self.diffuse > 0 or self.specular > 0)

    def strengths(self) -> dict[str, float]:
        """Return the light of each group on a white surface that faces all of its sources.

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
        """Return each group's fraction of the light on a surface that faces every source; sum 1.

        Layers are not divided by the sum of `strengths`: shares only divide up existing light.
        """
        strength = self.strengths()
        total = sum(strength.values())
        if total == 0:
            return dict.fromkeys(strength, 1 / len(strength))
        return {name: value / total for name, value in strength.items()}

    def check_fields(self) -> None:
        """Raise RaycastError if a setting is for one field alone."""
        for name, is_set in (
            ("mode", self.mode != "composite"),
            ("preintegrated", self.preintegrated),
            ("adaptive", self.adaptive > 0),
        ):
            if is_set:
                raise RaycastError(
                    f"{name} does not work with several fields or a mask",
                    "leave it out, or show one field",
                    code="conflict",
                    field=f"RaycastSpec.{name}",
                    given=getattr(self, name),
                )

    def step_of(self, volume: Volume) -> float:
        """Return the step in millimetres for a volume; by default half of its finest spacing.

        Raises
        ------
        RaycastError
            If a ray through the volume would take more than `MAX_STEPS` steps or less than one.
        """
        half_a_voxel = 0.5 * volume.finest_mm
        diagonal = diagonal_mm(volume)
        if self.step_mm is None:
            if diagonal / half_a_voxel > MAX_STEPS:
                raise _at_cast(
                    "step_mm",
                    f"left out, half of {volume.name}'s smallest spacing is {half_a_voxel:g} and "
                    f"it is {diagonal:g} mm across: {diagonal / half_a_voxel:g} steps",
                    f"give step_mm, {diagonal / MAX_STEPS:.2g} or more",
                )
            return half_a_voxel
        if not 1 <= diagonal / self.step_mm <= MAX_STEPS:
            raise _at_cast(
                "step_mm",
                f"{self.step_mm:g}, and {volume.name} is {diagonal:g} mm across: "
                f"{diagonal / self.step_mm:g} steps",
                f"give 1 to {MAX_STEPS}, half a voxel is {half_a_voxel:g}",
            )
        return self.step_mm

    def world_planes(self, volume: Volume | None) -> NDArray[np.float64]:
        """Return all cuts that are not of single fields, (P, 4) normals and offsets in mm.

        A point p stays if n · p ≥ d. Of a volume's crop it is the sides within it.
        """
        planes = [
            [*plane.normal, np.dot(plane.normal, plane.point_mm)]
            for plane in self.clip_planes
            if not plane.fields
        ]
        if volume is not None and self.crop_voxels is not None:
            rows = volume.index_from_world[:3]
            for row, (low, high), n in zip(rows, self.crop_voxels, volume.shape_xyz, strict=True):
                if low > 0.0:
                    planes.append([*row[:3], low - row[3]])
                if high < n - 1:
                    planes.append([*-row[:3], row[3] - high])
        return np.reshape(planes, (-1, 4)).astype(np.float64)

    def kept(self, volume: Volume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and greatest index (x, y, z) that the crop leaves of a volume.

        Raises
        ------
        RaycastError
            If the crop leaves nothing.
        """
        last = np.array(volume.shape_xyz) - 1.0
        if self.crop_voxels is None:
            return np.zeros(3), last
        low, high = np.array(self.crop_voxels).T
        for axis, near, far, end in zip("xyz", low, high, last, strict=True):
            if near >= end or far <= 0:
                raise _at_cast(
                    "crop_voxels",
                    f"along {axis} is {near:g} to {far:g}, {volume.name} reaches from 0 to {end:g}",
                    "nothing would be left, give other numbers",
                )
        return np.maximum(low, 0.0), np.minimum(high, last)

    def for_lattice(self, volume: Volume) -> RaycastSpec:
        """Return the settings with the crop in the volume's own voxels.

        Given are those of the finest level, if it is larger than memory.
        """
        if self.crop_voxels is None or volume.pyramid is None:
            return self
        scale = np.diag(volume.finest_from_index)[:3]
        shift = volume.finest_from_index[:3, 3]
        crop = (np.array(self.crop_voxels) - shift[:, None]) / scale[:, None]
        x, y, z = ((float(low), float(high)) for low, high in crop)
        return replace(self, crop_voxels=(x, y, z))

    def for_field(self, name: str | None) -> RaycastSpec:
        """Return the settings with the planes that cut a field, or with None those that cut all.

        Fields have the names of `naming_fields`.
        """
        if not any(plane.fields for plane in self.clip_planes):
            return self
        cutting = (
            clip_plane
            for clip_plane in self.clip_planes
            if not clip_plane.fields or name in clip_plane.fields
        )
        return replace(self, clip_planes=tuple(replace(plane, fields=()) for plane in cutting))

    def naming_fields(self, volume: Volume) -> RaycastSpec:
        """Return the settings with the volume's name for its own field in clip planes.

        Given are ``""``, that name or its channel's.

        Raises
        ------
        RaycastError
            If a plane cuts a field that the volume does not have.
        """
        own_names = "", volume.name, volume.channel.name
        names = [channel.name for channel in volume.fields]
        if not any(plane.fields for plane in self.clip_planes):
            return self
        planes = []
        for number, plane in enumerate(self.clip_planes):
            for name in plane.fields:
                if name not in (*own_names, *names):
                    raise _at_cast(
                        f"clip_planes[{number}].fields",
                        f"{volume.name} has no field {name!r}",
                        f"{nearest(name, names)}it has {', '.join(map(repr, ['', *names]))}, of "
                        'which "" is its own',
                    )
            named = (name if name in names else volume.name for name in plane.fields)
            planes.append(replace(plane, fields=tuple(named)))
        return replace(self, clip_planes=tuple(planes))

    def index_planes(self, volume: Volume) -> NDArray[np.float64]:
        """Return (P, 4) clip planes in index space, normals per voxel: normal · index ≥ w stays."""
        world = volume.world_from_index
        rows = np.zeros((len(self.clip_planes), 4))
        for row, plane in zip(rows, self.clip_planes, strict=True):
            normal = np.asarray(plane.normal)
            row[:3] = normal @ world[:3, :3]
            row[3] = normal @ (np.asarray(plane.point_mm) - world[:3, 3])
            row /= np.linalg.norm(row[:3])
        return rows

    def gradient_scale(self, volume: Volume) -> float:
        """Factor from value per smallest spacing to fraction of the range; 0 if it is constant."""
        low, high = volume.typical_range
        return 1 / (high - low) if high > low else 0.0

    @property
    def gradient_floor_squared(self) -> float:
        """`flat_gradient` squared; never 0, so that 0/0 cannot arise."""
        return max(self.flat_gradient**2, 1e-12)


def _at_cast(field: str, problem: str, remedy: str) -> RaycastError:
    """Return the error for a field that does not suit a volume, as found when casting."""
    return RaycastError(problem, remedy, code="range", field=f"RaycastSpec.{field}")


def diagonal_mm(volume: Volume) -> float:
    """Diagonal of the volume's bounding box along the world's axes."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
