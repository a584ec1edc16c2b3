"""Surfaces behind a volume and between its parts, and the volume's opacity for them.

meshes, rooms -> [behind] -> raycast
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, repeat
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from volspec.basis import Basis
from volspec.camera import Camera
from volspec.errors import CastCancelled
from volspec.image import Slot, Solid, nearest_known, ratio
from volspec.raycast.gpu import VolumeCaster
from volspec.raycast.launch.kernel_arguments import numbered_sources
from volspec.raycast.launch.light_volume import Transmittance, Visibility
from volspec.raycast.launch.row_batches import Cancel, Progress, Receiver, Result, part_of
from volspec.raycast.launch.sampling import world_rays
from volspec.raycast.lights import HEADLIT, Ambient
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import Tables, TransferTable
from volspec.volume import Volume

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SpanCast = Callable[[NDArray[np.float32]], Result]
"""Cast of a volume along parts (H, W, 2) of the pixels' rays, mm: their begin and end."""

# Places in such a pixel, in pixels from its middle.
_IN_PIXEL = np.array([(-1.0, -3.0), (3.0, -1.0), (1.0, 3.0), (-3.0, 1.0)]) / 8.0
POINTS = len(_IN_PIXEL)
"""Further points of each such pixel."""


class PictureCaster(Protocol):
    """Caster of a volume, or of a level of detail; see `VolumeCaster`."""

    def cast(
        self,
        table: Tables,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        receiver: Receiver | None = None,
        span_mm: NDArray[np.float32] | None = None,
    ) -> Result:
        """Cast a picture."""

    def transmittances(
        self, table: Tables, spec: RaycastSpec, camera: Camera, clear: Visibility
    ) -> Mapping[int, Transmittance]:
        """Return the part of each source's light that the volume lets pass."""


@dataclass(frozen=True, slots=True, eq=False)
class OpacityCaster:
    """Casts of a volume's opacity alone, such as from a light: its shadow."""

    caster: PictureCaster
    table: Tables
    spec: RaycastSpec
    arrives: Mapping[int, Transmittance] | None = None
    """Parts of the sources' light that the volume is taken to let pass; its own if None."""

    @property
    def flat(self) -> RaycastSpec:
        """The settings with light from all sides."""
        flat = replace(self.spec, ambient=1.0, diffuse=0.0, specular=0.0)
        return replace(flat, groups=HEADLIT, half=False)

    @property
    def key(self) -> object:
        """Value that is equal for equal opacities."""
        return self.flat, *self.table.opacity_key

    def __call__(
        self, camera: Camera, size: tuple[int, int]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the opacity (H, W) that a camera sees, and its expected distance, mm."""
        cast = self.caster.cast(self.table, camera, size, self.flat)
        return cast.alpha, cast.depth_mm

    def transmittances(self, camera: Camera, clear: Visibility) -> Mapping[int, Transmittance]:
        """Return the part of each source's light that the volume lets pass; see `VolumeCaster`."""
        if self.arrives is not None:
            return self.arrives
        return self.caster.transmittances(self.table, self.spec, camera, clear)


class SurfaceImage(NamedTuple):
    """Picture of surfaces behind a volume; ``part`` is the rows and columns that it has."""

    channels: NDArray[np.floating]  # (H, W, K·M) of the last K light groups, times alpha
    alpha: NDArray[np.float32]  # (H, W)
    depth_mm: NDArray[np.float32] | None = None  # (H, W); None if it is not that of the picture
    first_mm: NDArray[np.float32] | None = None  # (H, W); None if it is depth_mm
    part: tuple[slice, slice] = (slice(None), slice(None))
    loss: NDArray[np.float32] | None = None  # (H, W, M) kept of each channel; None if alpha


class SurfaceCaster(Protocol):
    """Surfaces around and in a volume, such as meshes or a room's."""

    @property
    def clear(self) -> Visibility | None:
        """Return the light they let pass, as for `VolumeCaster.cast`; None if all."""
        return None

    def within(self, volume: Volume, spec: RaycastSpec) -> SurfaceCaster | None:
        """Return what the planes and the crop leave of them; None if nothing."""
        return self

    @property
    def basis(self) -> Basis | None:
        """Return the basis of their channels, which has to be the volume's; None for any."""
        return None

    @property
    def translucent(self) -> str:
        """Return what is translucent, in words; empty if nothing is."""
        return ""

    @property
    def approximated(self) -> str:
        """Return what their basis stores only approximately, in words; empty if nothing."""
        return ""

    @property
    def materials(self) -> Sequence[str]:
        """Return the names of the surfaces' materials; empty if they have none of a basis'."""
        return ()

    def depths_mm(self, camera: Camera, size: tuple[int, int]) -> Sequence[NDArray[np.float32]]:
        """Return (H, W) distances from the camera, inf where nothing is seen.

        The first are those at which rays end; then those of translucent surfaces, front to back.
        """

    def pictures(
        self,
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
        ends_mm: Sequence[NDArray[np.float32]],
    ) -> Sequence[SurfaceImage]:
        """Return pictures of the surfaces in the volume's shadow, in the order of `depths_mm`.

        Each has its ``ends_mm`` (H, W): surfaces that are farther away cannot be seen.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Surfaces around and in a volume, for one camera.

    Rays are cast from sheet to sheet of what is translucent; `over` is associative, so the parts
    are composited after. Only what these casts let through is shaded.
    """

    behind: Sequence[SurfaceCaster]
    camera: Camera
    size: tuple[int, int]
    opacity: OpacityCaster
    depths_mm: Sequence[Sequence[NDArray[np.float32]]]
    stop_mm: NDArray[np.float32] | None

    @classmethod
    def of(
        cls,
        casters: Sequence[SurfaceCaster],
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
    ) -> Surfaces:
        """Return the surfaces; see `volspec.raycast`."""
        depths_mm = [caster.depths_mm(camera, size) for caster in casters]
        stop_mm = np.minimum.reduce([opaque for opaque, *_ in depths_mm]) if casters else None
        return cls(casters, camera, size, opacity, depths_mm, stop_mm)

    @property
    def clear(self) -> Visibility | None:
        """Light that the surfaces let pass, as for `VolumeCaster.cast`."""
        return next((caster.clear for caster in self.behind if caster.clear is not None), None)

    @property
    def _projected(self) -> bool:
        """True for a projection, which has no depth: translucent surfaces are in front of it."""
        return self.opacity.spec.mode != "composite"

    @property
    def _threshold(self) -> float:
        """Transmittance below which nothing behind a pixel's volume is seen; -1 for layers."""
        spec = self.opacity.spec
        return -1.0 if spec.layers else spec.least_transmittance

    def spans(
        self, progress: Progress | None
    ) -> Iterator[tuple[Progress | None, NDArray[np.float32] | None]]:
        """Yield the progress and the ``span_mm`` of each cast, front to back."""
        if self.stop_mm is None:
            yield progress, None
            return
        ends = [] if self._projected else [mm for _, *sheets in self.depths_mm for mm in sheets]
        begin = np.zeros_like(self.stop_mm)
        for number, end in enumerate((*ends, self.stop_mm)):
            end = np.minimum(end, self.stop_mm)
            yield part_of(progress, number, len(ends) + 1), np.stack([begin, end], axis=2)
            begin = end

    def composite(self, casts: Sequence[Result], cast: SpanCast) -> Result:
        """Return the picture of the casts between sheets, front to back, with all surfaces.

        They are changed in place. ``cast`` is for pixels that surfaces cover only in part.
        """
        front = casts[0]
        if not self.behind:
            return front
        opaque, sheets = self._pictures(casts)
        losses = [
            self._loss(layer, span_mm)
            for layer, (_, span_mm) in zip(casts, self.spans(None), strict=True)
        ]
        self._put_edges(casts, losses, opaque, cast)
        back = [SurfaceImage(*layer, loss=loss) for layer, loss in zip(casts, losses, strict=True)]
        if not self._projected:
            back = [layer for pair in zip(sheets, back[1:], strict=True) for layer in pair]
        elif sheets:
            front, back = (
                empty_result(front.coefficients.shape, front.coefficients.dtype),
                sheets + back,
            )
            losses = [front.alpha[..., None]]
        else:
            back = []
        for layer in (*back, *opaque):
            composite_under(front, layer, losses[0])
        return front

    def _loss(self, cast: Result, span_mm: NDArray[np.float32] | None) -> NDArray[np.float32]:
        """Return (H, W, M) the part of each channel that a cast keeps from what is behind it.

        Without spectral absorption it is (H, W, 1), alpha itself. With it, matter reflects as much
        as it keeps: the picture of white matter in light from all sides, which is cast once more.
        """
        table = self.opacity.table
        if not isinstance(table, TransferTable) or table.filters is None:
            return cast.alpha[..., None]
        flat = replace(self.opacity.flat, layers=0)
        caster = self.opacity.caster
        white = caster.cast(
            all_white(table), self.camera, self.size, flat, None, None, None, span_mm
        )
        return np.asarray(white.coefficients)

    def _put_edges(
        self,
        casts: Sequence[Result],
        losses: Sequence[NDArray[np.float32]],
        opaque: Sequence[SurfaceImage],
        cast: SpanCast,
    ) -> None:
        """Put the pixels that surfaces cover only in part into the casts, out of the pictures.

        Of the casts between sheets it is the one that reaches the surface: it ends there if the
        surface covers the pixel's middle, and else goes on. A further cast has the way that it
        lacks. The volume is seen before the surface, and next to it all of that way.
        """
        assert self.stop_mm is not None
        spans = [span_mm for _, span_mm in self.spans(None) if span_mm is not None]
        visible = np.prod([1.0 - layer.alpha for layer in casts], axis=0) > self._threshold
        for number, picture in enumerate(opaque):
            if picture.depth_mm is None:
                continue
            part, mesh_mm = picture.part, self.depths_mm[number][0][picture.part]
            # Thin tips may be seen by a pixel's middle alone.
            ends = np.isfinite(mesh_mm) & (mesh_mm <= self.stop_mm[part]) & visible[part]
            here = (picture.alpha > 0.0) | ends
            here &= (picture.alpha < 1.0) & np.isfinite(picture.depth_mm)
            if not here.any():
                continue
            depth_mm, passes = picture.depth_mm[here], np.isinf(mesh_mm[here])
            limits = np.stack([span[part][here] for span in spans])
            reaches = (limits[..., 1] >= depth_mm).argmax(axis=0)
            begin_mm = np.take_along_axis(limits[..., 0], reaches[None], axis=0)[0]
            other_mm = [mm[part][here] for k, (mm, *_) in enumerate(self.depths_mm) if k != number]
            end_mm = np.minimum.reduce([np.full_like(depth_mm, np.inf), *other_mm])
            span_mm = np.zeros((*self.size[::-1], 2), np.float32)
            span_mm[part][here, 0] = begin_mm
            span_mm[part][here, 1] = np.where(passes, depth_mm, end_mm)
            recast = cast(span_mm)
            further = [array[part][here] for array in (*recast, self._loss(recast, span_mm))]

            for k, result in enumerate(casts):
                some = reaches == k
                rows = tuple(index[some] for index in np.nonzero(here))
                surface = picture.channels[rows], picture.alpha[rows], depth_mm[some]
                views = [array[part] for array in (*result, losses[k])]
                _put_edge(views, rows, [array[some] for array in further], surface, passes[some])
            picture.channels[here], picture.alpha[here] = 0.0, 0.0

    def solid(self, slots: Sequence[Slot], cancel: Cancel | None = None) -> Solid:
        """Return what is opaque as the last of layers of opacity, for groups with shadows.

        Light is linear in its sources: each is rendered once, and past the volume's depths at half,
        the whole, and each material alone at half it is what these let pass.
        """
        picture = self._alone({})
        assert self.stop_mm is not None
        # Layers pass what they only touch, which is behind them all.
        picture.depth_mm[np.isinf(self.stop_mm)] = np.inf
        covered = picture.alpha > 0.0
        if not slots or not covered.any():
            return Solid(*picture[:3], {})
        assert isinstance(self.opacity.caster, VolumeCaster)
        arguments = self.opacity.table, self.opacity.spec, self.camera, self.clear or _all_passes
        split = self.opacity.caster.split_transmittances(*arguments)
        shape = (*covered.shape, len(self.opacity.spec.groups), -1)
        origins, directions = world_rays(self.camera, *self.size)
        points_mm = nearest_known(picture.depth_mm).reshape(-1, 1) * directions + origins
        points_mm = points_mm[covered.ravel()]
        channels = picture.coefficients.reshape(shape)[covered]
        may = {slot: np.zeros_like(channels[:, 0]) for slot in slots}
        passed = {slot: np.zeros((len(channels), len(split))) for slot in slots}
        sources = numbered_sources(self.opacity.spec)
        for number in split[0]:
            if cancel is not None and cancel():
                raise CastCancelled("raycast: cancelled", code="state")
            group, source = sources[number]
            slot = group, isinstance(source, Ambient)
            dark = self._alone({number: _none_arrives}).coefficients.reshape(shape)[covered]
            part = np.maximum(channels[:, group] - dark[:, group], 0)
            may[slot] += part
            arriving = np.stack([part[number](points_mm) for part in split], axis=1)
            passed[slot] += part.sum(axis=1)[:, None] * arriving
        means = {}
        for slot in slots:
            total, part = channels[:, slot[0]], may[slot]
            light = part.sum(axis=1, keepdims=True)
            coloured = ratio(part[:, :-1].sum(axis=1), total[:, :-1].sum(axis=1))
            white = ratio(part[:, -1], total[:, -1])
            passes = np.where(light > 0, ratio(passed[slot], light), 1.0)
            means[slot] = np.zeros((*covered.shape, 2 + len(split)), np.float32)
            means[slot][covered] = np.column_stack([coloured, white, passes])
        return Solid(*picture[:3], means)

    def _alone(self, arrives: Mapping[int, Transmittance]) -> Result:
        """Return what is opaque without the volume, which lets parts of the light pass."""
        clear = np.zeros(self.size[::-1], np.float32)
        surfaces = replace(self, opacity=replace(self.opacity, arrives=arrives))
        opaque, _ = surfaces._pictures([Result(clear[..., None], clear, clear, clear)])
        channels = len(self.opacity.spec.groups) * self.opacity.table.size
        result = empty_result((*clear.shape, channels), np.float32)
        for layer in opaque:
            composite_under(result, layer)
        return result

    def _pictures(self, casts: Sequence[Result]) -> tuple[list[SurfaceImage], list[SurfaceImage]]:
        """Return pictures of what is opaque and of sheets, as far as casts let them be seen."""
        assert self.stop_mm is not None
        from scipy.ndimage import binary_dilation  # loaded with surfaces alone

        # Where a ray would have ended, nothing is seen; in front of layers all may be.
        threshold = self._threshold
        transmittance: NDArray[np.float32] | float = 1.0
        masks = []
        for cast in casts:
            transmittance = transmittance * (1.0 - cast.alpha)
            masks.append(transmittance > threshold)
        sheets_seen = repeat(np.ones_like(masks[0])) if self._projected else iter(masks)
        opaque, sheets = [], []
        for number, caster in enumerate(self.behind):
            # Points of a pixel may see more of the same surface behind its middle.
            other_mm = [depth_mm for k, (depth_mm, *_) in enumerate(self.depths_mm) if k != number]
            stop_mm = np.minimum.reduce(other_mm) if other_mm else np.float32(np.inf)
            own_seen = masks[-1] & np.isfinite(self.depths_mm[number][0])
            # Next to them it may cover pixels in part, before the volume that these end in.
            ends = [np.where(masks[-1] | binary_dilation(own_seen, np.ones((3, 3))), stop_mm, 0.0)]
            for here in islice(sheets_seen, len(self.depths_mm[number]) - 1):
                ends.append(np.where(here, self.stop_mm, 0.0))
            first, *further = caster.pictures(self.camera, self.size, self.opacity, ends)
            opaque.append(first)
            sheets += further
        return opaque, sheets


def _put_edge(
    views: Sequence[NDArray[Any]],
    rows: tuple[NDArray[np.intp], ...],
    further: Sequence[NDArray[Any]],
    surface: tuple[NDArray[Any], NDArray[np.float32], NDArray[np.float32]],
    passes: NDArray[np.bool_],
) -> None:
    """Put a surface, which covers K pixels only in part, into ``rows`` of a cast's arrays.

    Parameters
    ----------
    views : arrays of a `Result`, and what they keep of each channel
        Changed in place.
    rows : tuple of arrays
        Indices of the pixels.
    further : arrays (K, …) as ``views``
        The pixels up to the surface if the cast ``passes`` (K,) it, else all of their way.
    surface : channels (K, L·M), alpha and depth in mm (K,)
    """
    mesh_channels, mesh_alpha, mesh_mm = surface
    cast, other = _premultiply_rows(*(view[rows] for view in views)), _premultiply_rows(*further)
    channels, alpha, depth_mm, first_mm, loss = views
    width = loss.shape[-1]
    mesh = np.zeros_like(other)
    mesh[:, -2 - width :] = mesh_alpha[:, None]
    mesh[:, -1] *= mesh_mm
    mesh[:, -2 - width - mesh_channels.shape[1] : -2 - width] = mesh_channels
    before = np.where(passes[:, None], other, cast)
    background = np.where(passes[:, None], cast, other)
    transmittance = 1.0 - before[:, -2 - width : -2]
    weight = np.empty_like(before)
    weight[:, :-2] = np.tile(transmittance, (before.shape[1] - 2) // width)
    weight[:, -2:] = 1.0 - before[:, -2:-1]
    total = before + weight * mesh + (1.0 - mesh_alpha[:, None]) * (background - before)

    limit = np.finfo(channels.dtype).max
    channels[rows] = np.clip(total[:, : -2 - width], -limit, limit)
    alpha[rows] = total[:, -2].clip(0.0, 1.0)
    loss[rows] = total[:, -2 - width : -2].clip(0.0, 1.0)
    far, covered = np.full(len(total), np.inf, np.float32), total[:, -2] > 0.0
    depth_mm[rows] = np.divide(total[:, -1], total[:, -2], out=far, where=covered)
    seen_mm = np.where(weight[:, -1] * mesh_alpha > 0.0, mesh_mm, np.inf)
    first_mm[rows] = np.minimum.reduce([first_mm[rows], further[3], seen_mm])


def _premultiply_rows(
    channels: NDArray[np.floating],
    alpha: NDArray[np.float32],
    depth_mm: NDArray[np.float32],
    _: NDArray[np.float32],
    loss: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return what adds up when composited, (K, L·M + M + 2).

    These are the channels, what of each is lost, alpha, and depth times alpha.
    """
    weighted = np.multiply(alpha, depth_mm, out=np.zeros_like(alpha), where=alpha > 0.0)
    return np.column_stack([channels, loss, alpha, weighted]).astype(np.float32)


def all_white(table: TransferTable) -> TransferTable:
    """Return a table of the same filters, whose matter is white.

    >>> table = TransferTable((0, 1), [0.5, 0.5], [[0.2], [0.1]], reference_step_mm=1)
    >>> all_white(table).coefficients.tolist()
    [[1.0], [1.0]]
    """
    weights = np.ones((*table.material_weights.shape[:-1], 1))
    left = None if table.left is None else table.left._replace(material_weights=weights)
    ones = np.ones((1, table.size))
    return replace(table, material_weights=weights, channels=ones, left=left)


def empty_result(shape: tuple[int, ...], dtype: DTypeLike) -> Result:
    """Return an empty picture of a shape (H, W, L·M)."""
    far = np.full(shape[:2], np.inf, np.float32)
    return Result(np.zeros(shape, dtype), np.zeros(shape[:2], np.float32), far, far.copy())


def _none_arrives(points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return zeros, of a volume that lets no light pass; an `Transmittance`."""
    return np.zeros(len(points_mm))


def _all_passes(starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ones, of surfaces that keep no light; a `Visibility`."""
    return np.ones(len(starts))


def composite_under(
    front: Result, other: SurfaceImage, loss: NDArray[np.float32] | None = None
) -> None:
    """Composite another picture behind one, which is changed in place.

    ``loss`` (H, W, M) is what the front keeps of each channel, which is changed, too: with spectral
    absorption alpha is its mean. Without, it is alpha.
    """
    coefficients, alpha, depth_mm, first_mm = (array[other.part] for array in front)
    channels = coefficients[..., coefficients.shape[2] - other.channels.shape[2] :]
    kept = alpha[..., None] if loss is None else loss[other.part]
    width = kept.shape[2]
    transmittance, before = 1.0 - kept, alpha.copy()
    weight = transmittance if width == 1 else np.tile(transmittance, channels.shape[2] // width)
    # A lamp that is seen may be brighter than half-float can store.
    limit = np.finfo(channels.dtype).max
    np.clip(channels + weight * other.channels, -limit, limit, out=channels, casting="same_kind")
    kept += transmittance * (other.alpha[..., None] if other.loss is None else other.loss)
    alpha[...] = kept[..., 0] if width == 1 else kept.mean(axis=2)
    if other.depth_mm is None:
        return
    added = alpha - before
    covered = (added > 0.0) & np.isfinite(other.depth_mm)
    part, total = added[covered], alpha[covered]
    own_mm = np.where(before[covered] > 0.0, depth_mm[covered], 0.0)
    depth_mm[covered] = (before[covered] * own_mm + part * other.depth_mm[covered]) / total
    other_first_mm = other.depth_mm if other.first_mm is None else other.first_mm
    first_mm[covered] = np.minimum(first_mm[covered], other_first_mm[covered])


def neighbour_pixels(across: NDArray[np.bool_], down: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the numbers of pixels that differ from a neighbour.

    ``across`` (H, W - 1) and ``down`` (H - 1, W) are True between those that do.
    """
    neighbours = np.zeros((across.shape[0], down.shape[1]), np.bool_)
    neighbours[:, 1:] |= across
    neighbours[:, :-1] |= across
    neighbours[1:] |= down
    neighbours[:-1] |= down
    return np.flatnonzero(neighbours)


def edge_sample_points(pixels: NDArray[np.intp], width: int) -> NDArray[np.float64]:
    """Return (4 E, 2) places, x and y in pixels, in E pixels."""
    middles = np.stack([pixels % width, pixels // width], axis=1)
    return (middles[:, None] + _IN_PIXEL).reshape(-1, 2)


def mean_of_points(pixels: NDArray[np.intp], count: int) -> csr_array:
    """Return weights (count, count + 4 E): of a pixel's middle, or of its further points."""
    from scipy.sparse import csr_array

    numbers = np.full(count, 1)
    numbers[pixels] = POINTS
    ends = np.concatenate([[0], np.cumsum(numbers)])
    columns = np.repeat(np.arange(count), numbers)
    first = ends[pixels][:, None] + np.arange(POINTS)
    columns[first] = count + np.arange(first.size).reshape(first.shape)
    weights = np.repeat(1.0 / numbers, numbers).astype(np.float32)
    return csr_array((weights, columns, ends), shape=(count, count + POINTS * len(pixels)))
