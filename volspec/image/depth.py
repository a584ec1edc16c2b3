"""Focus, fog, cuts and an opaque surface in a picture with layers of opacity, without a cast.

    layers of opacity, surface -> [depth] -> coefficient image -> relight -> appearance

A layer is taken for a slab of constant extinction. Its expected distance d and those of its
neighbours give its extent: light that reaches it goes m(τ) of its width w deep, on the mean,

    m(τ) = 1/τ − 1/(e^τ − 1),   w_l = τ_l · min (d_j − d_i) / (τ_i (1 − m_i) + τ_j m_j)

over the pairs of neighbours i, j = i + 1 to which l belongs. Then

- a cut or a surface takes the part of the optical depth that lies beyond it;
- fog of extinction σ between the camera and d leaves F(d) = exp(−σ d) of a layer's light, and adds
  T (F(d_i) − F(d_j)) white between two layers, T being what the layers in front let through;
- a lens with the opening A, focused at z₀, sees a point at z as a circle with the diameter
  A f |1/z₀ − 1/z| pixels [1], f being the picture's height over 2 tan(fov / 2). Layers are spread
  into slices of equal steps of that, and composited front to back for each part of the lens, from
  where a slice is shifted by its diameter: what hides what is as the lens sees it, which a blur
  of slices would not know.

Distances along the camera's axis are those along a ray times the cosine of its angle.

References
----------
[1] Potmesil & Chakravarty (1981), "A lens and aperture camera model for synthetic image
    generation", Computer Graphics 15(3), 297-305. doi:10.1145/965161.806818
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec.errors import ImageError, ShapeError
from volspec.image.fields import ImageFields
from volspec.image.layers import MAX_TAU, OpacityLayers, Recomposed
from volspec.settings import Fraction, NotNegative, Positive, Unit, settings

Image = TypeVar("Image", bound=ImageFields)
Array = NDArray[np.float32]
Index = NDArray[np.intp]

LEFT_AT_VISIBILITY = 0.05
"""Light that fog leaves at its visibility, by which meteorology defines that."""
F_NUMBER = 20.0
"""Distance of the focus over the opening of a lens that has none given."""
MAX_GAPS = 4.0
# Slices of the depth, their steps of the circle of confusion in pixels, and points of the lens,
# which are enough for one to every few pixels of the greatest such circle.
MAX_SLICES, SLICE_PX = 48, 1.0
MAX_POINTS, POINTS_PER_PX2 = 32, 1.0
# A larger circle of confusion is that of a point next to the lens.
_MAX_BLUR = 0.25


@settings(ImageError)
@dataclass(frozen=True, slots=True)
class DepthEffects:
    """``[depth]``: focus, fog and cuts, made from layers of opacity without a cast.

    Distances are from the camera, along its axis; those of fog are along each ray.
    """

    focus_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance of the plane in focus; everything is in focus if left out."""
    aperture_mm: Annotated[Positive, Unit("mm")] | None = None
    """Diameter of the lens's opening, its focal length over the f-number; 1/20 of focus_mm if left
    out."""
    fog_mm: Annotated[Positive, Unit("mm")] | None = None
    """Visibility in fog: the distance at which 5 % of the light is left. No fog if left out."""
    fog_from_mm: Annotated[NotNegative, Unit("mm")] = 0.0
    """Distance at which the fog begins; it ends at far_mm."""
    fog_white: Fraction = 0.5
    """Light that fog scatters to the eye, in each light group; a white surface that faces its
    sources has 1. Fog that absorbs nothing has 1 under light from all sides, 1/4 under a lamp."""
    near_mm: Annotated[NotNegative, Unit("mm")] = 0.0
    """Near cut: nothing nearer is shown."""
    far_mm: Annotated[Positive, Unit("mm")] | None = None
    """Far cut: nothing farther is shown."""

    def __post_init__(self) -> None:
        if self.far_mm is not None and not self.near_mm < self.far_mm:
            raise ImageError(
                f"is {self.near_mm:g} and what is beyond {self.far_mm:g} is hidden",
                "nothing would be left, give less",
                code="range",
                field="near_mm",
                given=self.near_mm,
            )

    @property
    def changes(self) -> bool:
        """True if a picture is changed."""
        return self.cuts or self.focus_mm is not None or self.fog_mm is not None

    @property
    def cuts(self) -> bool:
        """True if what is near or far is left out."""
        return self.near_mm > 0 or self.far_mm is not None

    @property
    def fog_per_mm(self) -> float:
        """Extinction of the fog, 0 without."""
        return 0.0 if self.fog_mm is None else -math.log(LEFT_AT_VISIBILITY) / self.fog_mm

    def blur_px(self, height: int, fov_deg: float | None) -> float:
        """Return the circle of confusion, pixels, of what is infinitely far away; 0 if sharp.

        At a distance z it is that times 1 − focus_mm / z, negative in front of the focus. Raises
        ImageError if the camera has no field of view.
        """
        if self.focus_mm is None:
            return 0.0
        if fov_deg is None:
            raise ImageError(
                f"is {self.focus_mm:g}, but the camera is orthographic or unknown",
                "cast with perspective, or leave focus_mm out",
                code="conflict",
                field="recompose: focus_mm",
            )
        aperture = self.aperture_mm or self.focus_mm / F_NUMBER
        return aperture / self.focus_mm * height / (2 * math.tan(math.radians(fov_deg) / 2))


class _Slab(NamedTuple):
    """Slab of constant extinction in each of P pixels; distances are along the rays."""

    begin: Array  # (P,) mm
    end: Array
    depth: Array  # expected distance
    tau: Array
    colours: Array  # (P, G·(K + 1)): its channels at an alpha of 1


def recompose_in_depth(
    image: ImageFields,
    scales: Sequence[float],
    effects: DepthEffects,
    surface: ImageFields | None,
) -> Recomposed:
    """Composite an image's layers with the K materials' optical depths scaled, and effects.

    Raises ImageError if the camera has no focus, or the surface is of another picture.
    """
    assert image.opacity_layers is not None
    layers = image.opacity_layers.lit(scales)
    height, width = image.alpha.shape
    _check_surface(image, surface)
    blur_px = effects.blur_px(height, image.fov_deg)
    cosine = axis_cosine((width, height), image.fov_deg)
    occupied = layers.tau.any(axis=(2, 3))
    if surface is not None:
        occupied |= surface.alpha > 0
    pixels = np.flatnonzero(occupied)
    near, far = _cuts(effects, cosine)
    slabs = _slabs(layers, scales, pixels, (near.ravel()[pixels], far.ravel()[pixels]), surface)
    fog = _Fog(effects, far)
    numbers = layers.groups * (layers.materials + 1)
    if blur_px > 0 and pixels.size:
        composite = _composite_focused([*slabs], numbers, pixels, cosine, fog, effects, blur_px)
    else:
        composite = _composite(slabs, numbers, pixels, fog)
    channels = composite.channels.reshape(height, width, layers.groups, layers.materials + 1)
    if effects.fog_mm is not None:
        fractions = np.array([*image.groups.values()], np.float32)
        channels[..., -1] += effects.fog_white * fractions * composite.fog[..., None]
    return Recomposed(channels, composite.alpha, composite.depth_mm)


def layers_in_depth(image: Image, scales: Sequence[float], effects: DepthEffects) -> Image:
    """Return an image whose layers are cut and in fog, for views nearby.

    ``scales`` of the K materials decide how deep what is left of a layer is, and its shadows. What
    fog is behind all layers, `fog_behind` adds to a view; they have no focus.
    """
    assert image.opacity_layers is not None
    layers = image.opacity_layers.lit(scales)
    height, width, count = layers.tau.shape[:3]
    cosine = axis_cosine((width, height), image.fov_deg)
    near, far = _cuts(effects, cosine)
    pixels = np.arange(height * width)
    tau, depth = layers.tau.astype(np.float32), layers.depth_mm.astype(np.float32)
    # What is cut away is at the cut: unused layers alone have no depth.
    depth = np.where(np.isfinite(depth), depth.clip(near[..., None], far[..., None]), depth)
    fog = _Fog(effects, far)
    shade, gloss = (array.astype(np.float32) for array in (layers.shade, layers.gloss))
    fractions = np.array([*image.groups.values()], np.float32)
    slabs = _slabs(layers, scales, pixels, (near.ravel(), far.ravel()), None)
    scaled = layers.scaled(scales).sum(axis=-1)
    for k, slab in zip(range(count), slabs, strict=True):
        left, total = slab.tau.reshape(height, width), scaled[:, :, k]
        tau[:, :, k] *= (left / np.where(total > 0, total, 1))[..., None]
        depth[:, :, k][left > 0] = slab.depth.reshape(height, width)[left > 0]
        clear = fog.left(slab.depth.reshape(height, width))[..., None]
        shade[:, :, k] *= clear[..., None]
        gloss[:, :, k] = clear * gloss[:, :, k] + effects.fog_white * (1 - clear) * fractions
    changed = replace(layers, tau=tau, shade=shade, gloss=gloss, depth_mm=depth)
    return replace(image, opacity_layers=changed)


def fog_behind(view: Image, effects: DepthEffects) -> Image:
    """Return a view of layers with the fog that is behind all of them, up to the far cut."""
    assert view.camera is not None
    cosine = view.camera.ray_field(*view.size).cosines(*view.size).astype(np.float32)
    added = (1 - view.alpha) * (1 - _Fog(effects, _cuts(effects, cosine)[1]).end)
    groups = np.array([*view.groups.values()], np.float32)
    channels = view.coefficients.astype(np.float32).reshape(*view.alpha.shape, len(groups), -1)
    channels[..., -1] += effects.fog_white * added[..., None] * groups
    coefficients = channels.reshape(view.coefficients.shape).astype(view.coefficients.dtype)
    return replace(view, coefficients=coefficients, alpha=view.alpha + added)


def axis_cosine(size: tuple[int, int], fov_deg: float | None) -> Array:
    """Return (H, W) cosines of rays to the camera's axis; 1 without a field of view."""
    width, height = size
    if fov_deg is None:
        return np.ones((height, width), np.float32)
    pixel = 2 * math.tan(math.radians(fov_deg) / 2) / height
    across = (np.arange(width) - (width - 1) / 2) * pixel
    down = (np.arange(height) - (height - 1) / 2) * pixel
    return np.asarray(1 / np.sqrt(1 + across**2 + down[:, None] ** 2), np.float32)


def _cuts(effects: DepthEffects, cosine: Array) -> tuple[Array, Array]:
    """Return the distances (H, W) of the near and the far cut along rays, mm."""
    near = np.float32(effects.near_mm) / cosine
    return near, np.float32(np.inf if effects.far_mm is None else effects.far_mm) / cosine


def mean_position(tau: Array) -> Array:
    """Return how deep light goes into slabs, as a fraction of their width: m(τ)."""
    thin = tau < 0.01
    safe = np.where(thin, 1, np.minimum(tau, MAX_TAU))
    return np.where(thin, 0.5 - tau / 12, 1 / safe - 1 / np.expm1(safe)).astype(np.float32)


def extents(tau: Array, depth: Array, solid: bool = False) -> tuple[Array, Array]:
    """Return where slabs (P, L) with optical and expected depths begin, and their widths, mm.

    A slab that is alone on its ray has no width, and none is wider than `MAX_GAPS` distances to
    its nearest neighbour: an opaque surface does not reach from one body to the next. If
    ``solid``, the last are surfaces, which have no width.
    """
    m = mean_position(tau)
    used = tau > 0
    if solid:
        begin, width = extents(tau[:, :-1], depth[:, :-1])
        end = np.where(used, depth, 0)[:, -1:]
        return np.hstack([begin, end]), np.hstack([width, np.zeros_like(end)])
    both = used[:, 1:] & used[:, :-1]
    before, after = tau[:, :-1] * (1 - m[:, :-1]), tau[:, 1:] * m[:, 1:]
    with np.errstate(invalid="ignore"):
        gap = np.maximum(np.where(both, depth[:, 1:] - depth[:, :-1], np.inf), 0)
    per_tau = np.where(both, gap / np.where(both, before + after, 1), np.inf)
    min_ratio = np.full(tau.shape, np.inf, np.float32)
    min_ratio[:, :-1] = per_tau
    min_ratio[:, 1:] = np.minimum(min_ratio[:, 1:], per_tau)
    alone = ~np.isfinite(min_ratio)
    nearest = np.full(tau.shape, np.inf, np.float32)
    nearest[:, :-1] = gap
    nearest[:, 1:] = np.minimum(nearest[:, 1:], gap)
    width = np.minimum(tau * np.where(alone, 0, min_ratio), MAX_GAPS * np.where(alone, 0, nearest))
    return np.where(used, depth, 0) - width * m, width


def _slabs(
    layers: OpacityLayers,
    scales: Sequence[float],
    pixels: Index,
    cut: tuple[Array, Array],
    surface: ImageFields | None,
) -> Iterator[_Slab]:
    """Yield the slabs of layers between two distances, near to far, and of a surface.

    The layers' shades have their shadows, `OpacityLayers.lit`.
    """
    near, far = cut
    count = layers.count
    flat = [
        array.reshape(-1, *array.shape[2:])[pixels]
        for array in (layers.tau, layers.shade, layers.gloss, layers.depth_mm)
    ]
    total = flat[0].astype(np.float32).sum(axis=2)
    begin, width = extents(total, flat[3].astype(np.float32), layers.solid)
    factors = layers.factors(scales)

    def parts(low: Array, high: Array) -> Iterator[_Slab]:
        for k in range(count):
            tau, shade, gloss = (array[:, k].astype(np.float32) for array in flat[:3])
            tau *= factors[k]
            total_tau = tau.sum(axis=1)
            first, thickness = begin[:, k], width[:, k]
            last = first + thickness
            start, stop = np.maximum(first, low), np.minimum(last, high)
            width_mm = np.where(thickness > 0, thickness, 1)
            inside = np.where(thickness > 0, (stop - start) / width_mm, start <= stop)
            left = total_tau * np.clip(inside, 0, 1)
            start, stop = (np.where(left > 0, edge, 0) for edge in (start, stop))
            fractions = tau / np.where(total_tau > 0, total_tau, 1)[:, None]
            colours = np.concatenate([fractions[:, None] * shade, gloss[..., None]], axis=2)
            depth = start + (stop - start) * mean_position(left)
            flat_colours = colours.reshape(len(total_tau), colours.shape[1] * colours.shape[2])
            yield _Slab(start, stop, depth, left, flat_colours)

    if surface is None:
        yield from parts(near, far)
        return
    alpha = surface.alpha.ravel()[pixels]
    surface_mm = np.where(alpha > 0, surface.depth_mm.ravel()[pixels], np.inf).astype(np.float32)
    yield from parts(near, np.minimum(far, surface_mm))
    opacity = np.where((near <= surface_mm) & (surface_mm <= far), alpha, 0)
    with np.errstate(divide="ignore"):
        tau = np.minimum(-np.log1p(-np.minimum(opacity, np.float32(1))), np.float32(MAX_TAU))
    coefficients = surface.coefficients.reshape(-1, surface.coefficients.shape[2])[pixels]
    per_alpha = 1 / np.where(alpha > 0, alpha, np.float32(1))
    colours = (coefficients * per_alpha[:, None]).astype(np.float32)
    place = np.where(np.isfinite(surface_mm), surface_mm, 0)
    yield _Slab(place, place, place, tau, colours)
    yield from parts(np.maximum(near, surface_mm), far)


class _Fog:
    """Transmittance of fog along rays."""

    def __init__(self, effects: DepthEffects, far: Array) -> None:
        self.per_mm, self.from_mm = np.float32(effects.fog_per_mm), effects.fog_from_mm
        self.end = self.left(far)  # (H, W) of all of it

    def left(self, distance: Array) -> Array:
        """Return the fog's transmittance up to distances, F(d)."""
        if self.per_mm == 0:
            return np.ones_like(distance)
        return np.exp(-self.per_mm * np.maximum(distance - self.from_mm, 0))


class _Seen(NamedTuple):
    """Picture of slabs, by pixel: channels (H, W, N), alpha, alpha · depth, the fog's alpha."""

    channels: Array
    alpha: Array
    depth_mm: Array
    fog: Array

    @classmethod
    def of(cls, sums: Array, fog: Array) -> _Seen:
        """Return the picture of sums (N + 2, H, W), the last alpha and alpha · depth, and fog."""
        opacity, weighted = sums[-2:]
        alpha = opacity + fog
        covered = opacity > 0
        depth = np.where(covered, weighted / np.where(covered, opacity, 1), np.inf)
        with np.errstate(invalid="ignore"):
            depth = np.where(alpha > 0, depth * alpha, 0)
        return cls(np.moveaxis(sums[:-2], 0, -1), alpha, depth, fog)


def _composite(slabs: Iterator[_Slab], numbers: int, pixels: Index, fog: _Fog) -> _Seen:
    """Composite slabs front to back, everything in focus."""
    sums = np.zeros((len(pixels), numbers + 2), np.float32)
    transmittance, previous = (np.ones(len(pixels), np.float32) for _ in range(2))
    white = np.zeros(len(pixels), np.float32)
    for slab in slabs:
        reached = np.where(slab.tau > 0, np.minimum(fog.left(slab.depth), previous), previous)
        weight = transmittance * -np.expm1(-slab.tau)
        part = reached * weight
        sums[:, :-2] += part[:, None] * slab.colours
        sums[:, -2] += part
        sums[:, -1] += part * slab.depth
        white += transmittance * (previous - reached)
        transmittance -= weight
        previous = reached
    picture = np.zeros((numbers + 2, *fog.end.shape), np.float32)
    picture.reshape(numbers + 2, -1)[:, pixels] = sums.T
    between = 1 - fog.end
    between.reshape(-1)[pixels] = white + transmittance * (previous - fog.end.ravel()[pixels])
    return _Seen.of(picture, np.maximum(between, 0))


def _composite_focused(
    slabs: Sequence[_Slab],
    numbers: int,
    pixels: Index,
    cosine: Array,
    fog: _Fog,
    effects: DepthEffects,
    blur_px: float,
) -> _Seen:
    """Composite slabs as a lens sees them, slice by slice."""
    shape = cosine.shape
    focus = effects.focus_mm
    assert focus is not None
    axis = cosine.ravel()[pixels]
    max_px = _MAX_BLUR * shape[0]

    def blur(distance: Array) -> Array:
        """Return the signed circle of confusion at distances along the rays, in pixels."""
        nearness = focus / np.maximum(distance * axis, 1e-9 * focus)
        return np.clip(blur_px * (1 - nearness), -max_px, max_px)

    ends = [(blur(slab.begin), blur(slab.end)) for slab in slabs]
    masks = [slab.tau > 0 for slab in slabs]
    if not any(m.any() for m in masks):
        return _composite(iter(slabs), numbers, pixels, fog)
    low_px = min(float(low[m].min()) for (low, _), m in zip(ends, masks, strict=True) if m.any())
    high_px = max(float(up[m].max()) for (_, up), m in zip(ends, masks, strict=True) if m.any())
    step = max(SLICE_PX, (high_px - low_px) / (MAX_SLICES - 2))
    lens = _Lens(shape, max(abs(low_px), abs(high_px)), numbers + 3)
    white, previous = np.zeros(shape, np.float32), np.ones(shape, np.float32)
    lit_by = [fog.left(slab.depth) for slab in slabs]
    spans = [_widen_spans(low / step, high / step) for low, high in ends]
    for number in range(math.floor(low_px / step), math.ceil(high_px / step) + 1):
        picture = np.zeros((len(pixels), numbers + 4), np.float32)
        clear = np.ones(len(pixels), np.float32)
        for slab, (low, high), left in zip(slabs, spans, lit_by, strict=True):
            index = np.flatnonzero((low < number + 0.5) & (high > number - 0.5) & (slab.tau > 0))
            part = np.minimum(high[index], number + 0.5) - np.maximum(low[index], number - 0.5)
            tau = slab.tau[index] * part / (high[index] - low[index])
            weight = clear[index] * -np.expm1(-tau)
            clear[index] -= weight
            unfogged = weight * left[index]
            picture[index, :-4] += unfogged[:, None] * slab.colours[index]
            picture[index, -4] += unfogged
            picture[index, -3] += unfogged * slab.depth[index]
        picture[:, -2] = picture[:, -1] = 1 - clear
        if fog.per_mm > 0:
            place = _depth_of(number * step, focus, blur_px) / cosine
            reached = np.minimum(fog.left(place), previous)
            white += lens.clear * (previous - reached)
            previous = reached
        lens.put(picture, pixels, number * step)
    *sums, weight = lens.sums
    clear = lens.clear
    white += clear * (previous - fog.end)
    scale = 1 / np.maximum(weight + clear, 1e-6)  # 1 but for the blur of what points see
    return _Seen.of(np.stack(sums) * scale, np.maximum(white * scale, 0))


def _depth_of(blur: float, focus: float, blur_px: float) -> float:
    """Return the distance along the axis of a circle of confusion."""
    nearness = 1 - blur / blur_px
    return focus / nearness if nearness > 0 else math.inf


def _widen_spans(low: Array, high: Array) -> tuple[Array, Array]:
    """Return spans that are a slice long at least, so that neighbouring slices share thin ones."""
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, 1)
    return middle - half, middle + half


class _Lens:
    """Points of a lens, (N, 2) from −1/2 to 1/2 of its opening, and what each sees (N, H, W).

    A slice is seen from a point shifted; what N points see of it is blurred by a point's own part
    of the lens. What hides what is found without that blur, by which the slices of a slope would
    let light through in between.
    """

    def __init__(self, shape: tuple[int, int], blur_px: float, numbers: int) -> None:
        count = min(MAX_POINTS, max(1, math.ceil(POINTS_PER_PX2 * blur_px**2)))
        turn = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
        # Less than to the edge: the parts around the points are as wide as the rest.
        radius = 0.5 * math.sqrt(1 - 1 / count) * np.sqrt((np.arange(count) + 0.5) / count)
        self.points = np.stack([radius * np.sin(turn), radius * np.cos(turn)], axis=1)
        self.transmittances = np.ones((count, *shape), np.float32)
        self.sums = np.zeros((numbers, *shape), np.float32)

    @property
    def clear(self) -> Array:
        """Mean of what the points see of what is behind (H, W)."""
        return np.asarray(self.transmittances.mean(axis=0), np.float32)

    def put(self, picture: Array, pixels: Index, blur_px: float) -> None:
        """Composite a slice (P, N + 1), the last its opacity, behind what is there."""
        height, width = self.transmittances.shape[1:]
        solid = picture[:, -1] > 0
        if not solid.any():
            return
        rows, columns = np.divmod(pixels[solid], width)
        part = abs(blur_px) * math.sqrt(0.25 * math.pi / len(self.points))
        room = math.ceil(0.5 * (abs(blur_px) + part)) + 1
        top, bottom = max(0, rows.min() - room), min(height, rows.max() + room + 1)
        left, right = max(0, columns.min() - room), min(width, columns.max() + room + 1)
        slice_ = np.zeros((picture.shape[1], bottom - top, right - left), np.float32)
        slice_[:, rows - top, columns - left] = picture[solid].T
        # What is beyond the picture's edge is taken for what is there.
        slice_ = np.pad(slice_, ((0, 0), (room, room), (room, room)), mode="edge")
        shifts: dict[tuple[int, int], list[int]] = {}
        for n, (down, across) in enumerate(np.rint(self.points * blur_px).astype(int).tolist()):
            shifts.setdefault((down, across), []).append(n)
        here = np.s_[top:bottom, left:right]
        accumulated = np.zeros((picture.shape[1] - 1, bottom - top, right - left), np.float32)
        for (down, across), points in shifts.items():
            y, x = room - down, room - across
            shifted = slice_[:, y : y + bottom - top, x : x + right - left]
            clear = 1 - shifted[-1]
            transmittance = np.zeros_like(clear)
            for n in points:
                point_transmittance = self.transmittances[n][here]
                transmittance += point_transmittance
                point_transmittance *= clear
            accumulated += transmittance * shifted[:-1]
        self.sums[(slice(None), *here)] += _box_blur(accumulated, part) / len(self.points)


def _box_blur(slice_: Array, size: float) -> Array:
    """Blur pictures (C, H, W) by a square with sides of a size, in pixels."""
    if size <= 1:
        return slice_
    from scipy.ndimage import correlate1d

    around = math.ceil((size - 1) / 2)
    weights = np.ones(2 * around + 1)
    weights[[0, -1]] = (size - (2 * around - 1)) / 2
    for axis in (1, 2):
        slice_ = correlate1d(slice_, weights / size, axis=axis, mode="nearest")
    return slice_


def _check_surface(image: ImageFields, surface: ImageFields | None) -> None:
    """Refuse a surface that is not of the image's picture."""
    if surface is None:
        return
    field = "recompose: surface"
    if surface.size != image.size:
        (width, height), (w, h) = surface.size, image.size
        raise ShapeError(f"is {width}x{height}, the image {w}x{h}", f"cast it {w}x{h}", field=field)
    if surface.basis.fingerprint != image.basis.fingerprint:
        raise ImageError(
            f"basis is {surface.basis.name!r}, the image's {image.basis.name!r}",
            "make the mesh in the image's basis",
            code="conflict",
            field=field,
        )
    if surface.opacity_layers is not None:
        raise ImageError(
            "is a volume's picture, with layers",
            "give a mesh's, such as of MeshCaster.alone",
            code="conflict",
            field=field,
        )
    for name in ("groups", "fov_deg", "camera"):
        expected, other = getattr(image, name), getattr(surface, name)
        if expected != other and not (name == "camera" and None in (expected, other)):
            raise ImageError(
                f"{name} is {other}, the image's {expected}",
                "cast both with the same camera and lights",
                code="conflict",
                field=field,
            )
