"""Layers of opacity along each ray, by which materials fade without a new cast.

    volume -> transfer -> [raycast with layers] -> recompose -> relight -> appearance

A pixel has up to L layers, near to far. A layer has an optical depth τ_k and a shade f_gk of every
material k, and a highlight g_g, for each light group g. With a scale s_k of each material's depth

    left = T exp(−Σ s_k τ_k)
    C_gk += (T − left) s_k τ_k f_gk / Σ s_k τ_k,   white_g += (T − left) g_g,   T ← left

which is the coefficient image that the scaled opacities would give, but for what differs within a
layer. A material's shade is the mean of its samples, weighted by its *own* transmittance within the
layer, so that a material alone is exact at scale 1 whatever is in front of it:

    f_gk = Σ e^(−τ_k before) (1 − e^(−τ_k,i)) f_g,i / (1 − e^(−τ_k))

`volspec.raycast.launch.layer_stream` says where layers begin and end. The last may be of opaque
surfaces, which no scale changes.

If lights have shadows, shades and highlights are stored without, and a layer has a part v of each
that shadows may take, and optical depths E_j of the materials on the way to the lights, so that

    f_gk(s) = f_gk (1 − v_g + v_g p_g),   p_g = (1 + Σ_j s_j (e^(b E_j) − 1))^(−1/b)

is at b → 0 the transmittance exp(−Σ s_j E_j) of one path, and at b > 0 the mean over paths whose
depths differ, gamma-distributed with relative variance b, as in a layer and in directions of the
sky. Ambient occlusion has v, b and E of its own, and p = min(1, 2 p). Both follow from means of the
transmittance of all materials (T_½ and T_1, at half of their depths and at the whole) and of each
alone at half (`shadow_of_means`).

Twins: ``shaders/recompose.frag`` and ``include/opacity.glsl``. Guide: ``docs/layers.md``.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from volspec._checks import number
from volspec.basis import MaterialBasis
from volspec.errors import (
    ImageError,
    ShapeError,
    VolspecWarning,
    nearest,
    quote,
)

Array = NDArray[np.float64]

MAX_LAYERS = 16
"""Layers of an image."""
OCCLUSION_GAIN = 2.0
"""Factor of the mean transmittance over the sphere: a point on a flat wall sees half of it, which
counts as all of the ambient light."""
MAX_MATERIALS = 4
"""Materials of an image with layers."""
MAX_TAU = 64.0
"""Optical depth of an opaque sample."""
MAX_LAYER_TAU = 1024.0
"""Optical depth of a layer: half-float has few more."""
DARKEST = 1e-9
"""Transmittance to a light that counts as none; at half of the depths its root."""
BEND = 1e-3, 16.0
"""Limits of b; the least is as 0."""
MAX_EXPONENT = 80.0
"""Exponent that float32 has, also times a scale."""
MIN_TAU = 1e-6
"""Optical depth below which a material has no shade."""
_MAX_SCALED, _STEP, _MAX_STEP = 4.0, 2.0**-10, 2.0**-5  # see `OpacityLayers.as_stored`


class Recomposed(NamedTuple):
    """Picture of scaled layers: channels (H, W, G, K + 1), alpha (H, W), alpha times depth."""

    channels: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]


class Solid(NamedTuple):
    """Picture of opaque surfaces behind a volume that lets all light pass.

    ``channels`` (H, W, G·(K + 1)) premultiplied by ``alpha`` (H, W), ``depth_mm`` (H, W), and of
    groups with shadows (H, W, 4 + materials) `shadow_of_means`' numbers.
    """

    channels: NDArray[np.floating]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    means: Mapping[Slot, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class OpacityLayers:
    """Layers of the materials' optical depths along each pixel's ray, near to far.

    Raises ShapeError if the arrays do not belong together, or there are too many of them.

    Parameters
    ----------
    tau : (H, W, L, K) float32 or float16
        Optical depth of each of the basis' K materials; 0 in unused layers.
    shade : (H, W, L, G, K)
        Factor of each material's reflectance, for each of G light groups.
    gloss : (H, W, L, G)
        Highlight, which adds white.
    depth_mm : (H, W, L)
        Expected distance from the camera; inf in unused layers.
    shadow, occlusion : (H, W, L, G, 3 + K), optional
        Parts of a group's shade and of its highlight that shadows, or ambient occlusion, may take;
        b; each material's optical depth on the way to the lights. Shade and gloss are then without
        them. None, or 0 in a group, if no light has any.
    solid : bool
        The last layer is of opaque surfaces, such as meshes, which no scale changes. It is the
        last in each pixel, also if layers before it are unused.
    """

    tau: NDArray[Any]
    shade: NDArray[Any]
    gloss: NDArray[Any]
    depth_mm: NDArray[Any]
    shadow: NDArray[Any] | None = None
    occlusion: NDArray[Any] | None = None
    solid: bool = False

    def __post_init__(self) -> None:
        shape = np.shape(self.tau)
        if len(shape) != 4 or not (1 <= shape[2] <= MAX_LAYERS and 1 <= shape[3] <= MAX_MATERIALS):
            raise ShapeError(
                f"shape {shape}",
                f"expected (H, W, L, K), L up to {MAX_LAYERS} and K up to {MAX_MATERIALS}",
                field="opacity layers: tau",
            )
        by_group = (*shape[:3], *(np.shape(self.gloss)[3:4] or (1,)))
        for name, expected in (
            ("tau", shape),
            ("shade", (*by_group, shape[3])),
            ("gloss", by_group),
            ("depth_mm", shape[:3]),
            ("shadow", (*by_group, 3 + shape[3])),
            ("occlusion", (*by_group, 3 + shape[3])),
        ):
            array = getattr(self, name)
            if array is None and name in ("shadow", "occlusion"):
                continue
            if np.shape(array) != expected:
                raise ShapeError(
                    f"shape {np.shape(array)}",
                    f"expected {expected}",
                    field=f"opacity layers: {name}",
                )
            kind = getattr(array, "dtype", type(array).__name__)
            if kind not in (np.float32, np.float16):
                raise ImageError(
                    f"type {kind}",
                    "give float32 or float16",
                    code="type",
                    field=f"opacity layers: {name}",
                )

    def __repr__(self) -> str:
        return f"OpacityLayers({self.count} layers of {self.materials} materials)"

    @property
    def count(self) -> int:
        """Number of layers, L."""
        return int(self.tau.shape[2])

    @property
    def materials(self) -> int:
        """Number of materials, K."""
        return int(self.tau.shape[3])

    @property
    def groups(self) -> int:
        """Number of light groups, G."""
        return int(self.gloss.shape[3])

    @property
    def range_mm(self) -> tuple[float, float]:
        """Distances of the nearest and the farthest layer from the camera; 0 if there is none."""
        used = self.depth_mm[np.isfinite(self.depth_mm)]
        return (float(used.min()), float(used.max())) if used.size else (0.0, 0.0)

    @property
    def fading(self) -> Self:
        """The layers that scales change: all but those of surfaces."""
        if not self.solid:
            return self
        return replace(self.changed(lambda array: array[:, :, :-1]), solid=False)

    @property
    def fades(self) -> list[bool]:
        """True of the materials that scales change: those with opacity in front of surfaces."""
        flags: list[bool] = np.any(self.fading.tau, axis=(0, 1, 2)).tolist()
        return flags

    def scaled(self, scales: Sequence[float]) -> NDArray[np.float32]:
        """Return (H, W, L, K) optical depths, with those of the K materials scaled."""
        tau = self.tau.astype(np.float32)
        tau *= self.factors(scales)
        return tau

    def factors(self, scales: Sequence[float]) -> NDArray[np.float32]:
        """Return (L, K) factors of the optical depths; 1 of surfaces."""
        factors = np.tile(np.asarray(scales, np.float32), (self.count, 1))
        factors[self.count - self.solid :] = 1
        return factors

    @property
    def slots(self) -> list[Slot]:
        """Groups with shadows or occlusion, as `shadow_slots`."""
        casts = ((False, self.shadow), (True, self.occlusion))
        return sorted(
            (group, occluded)
            for occluded, cast in casts
            for group in range(self.groups)
            if cast is not None and cast[..., group, :].any()
        )

    def slot(self, slot: Slot) -> NDArray[Any]:
        """Return (H, W, L, 3 + K) a group's numbers of `shadow` or `occlusion`."""
        group, occluded = slot
        cast = self.occlusion if occluded else self.shadow
        assert cast is not None
        return cast[..., group, :]

    @classmethod
    def of_rows(
        cls,
        rows: NDArray[Any],
        columns: Sequence[int],
        materials: int,
        groups: int,
        slots: Sequence[Slot] = (),
        surfaces: Solid | None = None,
    ) -> Self:
        """Return the layers of a cast's rows (H, W, L, `row_size`), and one of ``surfaces``.

        ``columns`` are the numbers in the basis, of K ``materials``, of the rows' materials;
        ``slots`` as `shadow_slots`.
        """
        K, shape = len(columns), rows.shape[:3]
        ends = np.cumsum([K, groups * K, groups, *[4 + K] * len(slots)])
        tau, shade, gloss, *means, depth = np.split(rows, ends, axis=3)
        used = tau.any(axis=3)
        count = shape[2] + (surfaces is not None)

        def spread(values: NDArray[Any], first: int = 0) -> NDArray[Any]:
            """Move the materials, which are last, from the rows' columns to the basis'."""
            full = np.zeros((*shape[:2], count, *values.shape[3:-1], first + materials), rows.dtype)
            full[:, :, : shape[2], ..., :first] = values[..., :first]
            for column, source in zip(columns, range(first, first + K), strict=True):
                full[:, :, : shape[2], ..., first + column] = values[..., source]
            return full

        shadows = []
        for mean in means:
            numbers = np.zeros((*shape, 3 + K), rows.dtype)
            numbers[used] = shadow_of_means(mean[used])
            shadows.append(spread(numbers, 3))
        highlights, place = (np.zeros((*shape[:2], count, n), rows.dtype) for n in (groups, 1))
        highlights[:, :, : shape[2]], place[:, :, : shape[2]] = gloss, depth
        shades = spread(shade.reshape(*shape, groups, K))
        layers = cls._of_arrays(spread(tau), shades, highlights, shadows, place, slots)
        return layers if surfaces is None else layers._ended_by(surfaces, columns)

    @classmethod
    def of_numbers(
        cls, numbers: NDArray[Any], materials: int, groups: int, slots: Sequence[Slot] = ()
    ) -> Self:
        """Return the layers of all their numbers (H, W, L, N), array after array."""
        K, shape = materials, numbers.shape[:3]
        ends = np.cumsum([K, groups * K, groups, *[3 + K] * len(slots)])
        tau, shade, gloss, *shadows, depth = np.split(numbers, ends, axis=3)
        shades = shade.reshape(*shape, groups, K)
        return cls._of_arrays(tau, shades, gloss, shadows, depth, slots)

    @classmethod
    def _of_arrays(
        cls,
        tau: NDArray[Any],
        shade: NDArray[Any],
        gloss: NDArray[Any],
        shadows: Sequence[NDArray[Any]],
        depth: NDArray[Any],
        slots: Sequence[Slot],
    ) -> Self:
        casts: dict[bool, NDArray[Any]] = {}
        for (group, occluded), numbers in zip(slots, shadows, strict=True):
            if occluded not in casts:
                shape = *numbers.shape[:3], shade.shape[3], numbers.shape[3]
                casts[occluded] = np.zeros(shape, numbers.dtype)
            casts[occluded][:, :, :, group] = numbers
        tau, shade, gloss, depth = map(np.ascontiguousarray, (tau, shade, gloss, depth[..., 0]))
        return cls(tau, shade, gloss, depth, casts.get(False), casts.get(True))

    def as_stored(self) -> Self:
        """Return the layers as a file holds them: half floats, without digits that do not show.

        Shades and highlights are rounded to 2^-10 of a pixel's white, that is to 2^-10 divided by
        the visibility of the layer, or of the material in it, at scale 4 (2^-5 at most), and
        optical depths to what changes a transmittance by 2^-10 at a scale from 1/4 to 4; distances
        are not. Files are a seventh smaller.
        """
        depths = _rounded_depths(self.tau)
        half = replace(self.changed(lambda array: array.astype(np.float16)), tau=depths)
        tau = depths.astype(np.float32)
        return replace(
            half,
            shade=_quantise_values(self.shade, tau[..., None, :]),
            gloss=_quantise_values(self.gloss, tau.sum(axis=-1)[..., None]),
        )

    def _ended_by(self, surfaces: Solid, columns: Sequence[int]) -> Self:
        """Fill the last layer by surfaces; arguments as of `of_rows`."""
        K, alpha = self.materials, surfaces.alpha.astype(np.float64)
        channels = surfaces.channels.reshape(*alpha.shape, self.groups, K + 1)
        channels = channels / np.where(alpha > 0, alpha, 1)[..., None, None]
        # Each material has a share of the depth, so that its shade is that of a surface of it.
        reflected = channels[..., :K].sum(axis=2)
        reflected[..., 0] += reflected.sum(axis=-1) == 0
        fraction = reflected / reflected.sum(axis=-1, keepdims=True)
        self.tau[:, :, -1] = sample_tau(alpha)[..., None] * fraction
        self.shade[:, :, -1] = ratio(channels[..., :K], fraction[:, :, None])
        self.gloss[:, :, -1] = channels[..., K]
        place = nearest_known(surfaces.depth_mm)
        # At edges, which only points of a pixel see, surfaces are behind all that is there.
        edge = (alpha > 0) & ~np.isfinite(surfaces.depth_mm)
        deepest = np.where(np.isfinite(self.depth_mm), self.depth_mm, 0)[edge][:, :-1]
        place[edge] = np.maximum(place[edge], deepest.max(axis=1, initial=0))
        self.depth_mm[:, :, -1] = np.where(alpha > 0, place, np.inf)
        for (group, occluded), means in surfaces.means.items():
            cast = self.occlusion if occluded else self.shadow
            assert cast is not None
            numbers = shadow_of_means(means.reshape(-1, means.shape[2]))
            placed = [0, 1, 2, *(3 + column for column in columns)]
            cast[:, :, -1, group, placed] = numbers.reshape(*alpha.shape, -1)
        return replace(self, solid=True)

    def at(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Self:
        """Return the layers of P pixels as those of a picture of one row, (1, P, …)."""
        return self.changed(lambda array: array[rows, columns][None])

    def changed(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Self:
        """Return the layers with a change of each array, such as to some of the pixels."""
        arrays: dict[str, Any] = {name: change(array) for name, array in self._arrays().items()}
        return replace(self, **arrays)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}

    def recompose(self, scales: Sequence[float]) -> Recomposed:
        """Composite the layers with the K materials' optical depths scaled."""
        height, width, count, K = self.tau.shape
        scale = np.asarray(scales, np.float32)
        channels = np.zeros((height, width, self.groups, K + 1), np.float32)
        alpha = np.zeros((height, width), np.float32)
        depth_mm = np.zeros((height, width), np.float32)
        clear = np.ones((height, width), np.float32)
        factors = self.factors(scales)
        for layer in range(count):
            tau = self.tau[:, :, layer].astype(np.float32) * factors[layer]
            total = tau.sum(axis=-1)
            if not total.any():
                continue
            weight = clear * -np.expm1(-total)
            part = weight / np.where(total > 0, total, 1)
            shade, gloss = self._shaded(layer, scale)
            channels[..., :K] += (part[..., None] * tau)[:, :, None] * shade
            channels[..., K] += weight[..., None] * gloss
            alpha += weight
            where = np.where(total > 0, self.depth_mm[:, :, layer], 0)
            depth_mm += weight * where
            clear -= weight
        return Recomposed(channels, alpha, depth_mm)

    def lit(self, scales: Sequence[float]) -> Self:
        """Return the layers with the shadows and occlusion of scaled materials in their shades."""
        if self.shadow is None and self.occlusion is None:
            return self
        scale = np.asarray(scales, np.float32)
        shades, highlights = zip(*(self._shaded(n, scale) for n in range(self.count)), strict=True)
        kind = self.shade.dtype
        return replace(
            self,
            shade=np.stack(shades, axis=2).astype(kind),
            gloss=np.stack(highlights, axis=2).astype(kind),
            shadow=None,
            occlusion=None,
        )

    def _shaded(
        self, layer: int, scale: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (H, W, G, K) shades and (H, W, G) highlights of a layer, with shadows."""
        shade = self.shade[:, :, layer].astype(np.float32)
        gloss = self.gloss[:, :, layer].astype(np.float32)
        kept = [1.0, 1.0]
        for casts, gain in ((self.shadow, 1.0), (self.occlusion, OCCLUSION_GAIN)):
            if casts is not None:
                cast = casts[:, :, layer].astype(np.float32)
                loss = 1 - np.minimum(gain * transmittance(cast[..., 2:], scale), 1)
                kept = [kept[n] - cast[..., n] * loss for n in (0, 1)]
        return shade * np.asarray(kept[0])[..., None], gloss * kept[1]


def _rounded_depths(tau: NDArray[Any]) -> NDArray[np.float16]:
    """Return optical depths in half precision, rounded to what shows."""
    low = np.exp2(np.floor(np.log2(np.maximum(tau, _STEP).astype(np.float32))))
    scale = np.clip(1 / low, 1 / _MAX_SCALED, _MAX_SCALED)  # at which a change shows most
    sensitivity = np.maximum(scale * np.exp(-scale * low), np.float32(1e-30))
    step = np.minimum(np.exp2(np.floor(np.log2(_STEP / sensitivity))), low / 4)
    rounded = np.rint(tau / step) * step
    # A used layer stays one: cuts take its neighbours for its surroundings.
    return np.where(rounded > 0, rounded, tau).astype(np.float16)


def _quantise_values(values: NDArray[Any], tau: NDArray[np.float32]) -> NDArray[np.float16]:
    """Return values of layers of some optical depths in half precision, rounded to what shows."""
    visibility = -np.expm1(-_MAX_SCALED * tau)
    step = np.minimum(_STEP / np.maximum(visibility, _STEP), _MAX_STEP)
    step = np.exp2(np.floor(np.log2(step)))
    return (np.rint(values / step) * step).astype(np.float16)


def nearest_known(depth_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return distances (H, W), mm; where there is none, as at edges, that of the nearest pixel.

    Unchanged if all are inf.
    """
    from scipy.ndimage import distance_transform_edt

    unknown = ~np.isfinite(depth_mm)
    if unknown.all():
        return depth_mm.copy()
    indices = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return depth_mm[tuple(indices)]


def warn_of_absent(
    basis: MaterialBasis, layers: OpacityLayers, scales: Sequence[float], fades: Sequence[bool]
) -> None:
    """Warn of materials that are to be scaled, but have no opacity in front of surfaces.

    ``fades`` are the layers' own.
    """
    for k, (name, scale) in enumerate(zip(basis.materials, scales, strict=True)):
        if scale == 1.0 or fades[k]:
            continue
        if layers.solid and layers.tau[:, :, -1, k].any():
            why = "only meshes have, and these keep theirs; leave one out with shown = false"
            text = f"opacity of {name!r} is scaled, which {why}"
        elif scale > 0:
            text = (
                f"{name!r} has no opacity in this picture, so {scale:g} times it is "
                "none; if it is not out of view, cast it with a little opacity, such as 0.02, and "
                "hide it with scale 0"
            )
        else:
            continue
        warnings.warn(text, VolspecWarning, stacklevel=3)


def checked_scales(scales: Any, basis: MaterialBasis) -> list[float]:
    """Return the scale of each material in the basis' order; 1 if it is left out.

    Raises ImageError if a name is unknown, or a scale is not a finite number of 0 or more.
    """
    if not isinstance(scales, Mapping):
        raise ImageError.refused("opacities", scales, "give {material: scale}", "type")
    for name in scales:
        if name not in basis.materials:
            raise ImageError(
                f"no material {quote(name)}; {nearest(str(name), basis.materials)}"
                f"it has {', '.join(basis.materials)}",
                code="unknown",
                field="opacities",
            )
    checked = []
    for name in basis.materials:
        field = f"opacity of {name!r}"
        scale = number(field, scales.get(name, 1.0), ImageError)
        if scale < 0:
            raise ImageError.refused(field, scale, "give 0 or more", "range")
        checked.append(scale)
    return checked


def residual_share(scales: Sequence[float], fades: Sequence[bool]) -> float:
    """Return how much of what the layers lack at scale 1 is added: √s of the least scale, up to 1.

    ``fades`` says which scales count, as `OpacityLayers.fades`. Layers lack about as much at
    greater scales, and less as a material fades: what is hidden lacks nothing, and a material alone
    is exact.
    """
    fading_scales = [scale for scale, counts in zip(scales, fades, strict=True) if counts]
    return math.sqrt(min(1.0, *fading_scales)) if fading_scales else 1.0


Slot = tuple[int, bool]
"""Number of a light group; True for ambient occlusion, False for shadows."""


def shadow_of_means(means: NDArray[Any]) -> NDArray[np.float32]:
    """Return (R, 3 + K) numbers of `OpacityLayers.shadow` from a cast's (R, 4 + K).

    These are the two parts, then T_½, T_1 and each material's T_½ alone. 1 + Σ x at scale 1 is
    T_1^(−b), and 1 + Σ x / 2 is T_½^(−b); with x_j = e^(b E_j) − 1 from each alone, and a factor so
    that the sum is right.
    """
    means = means.astype(np.float32)
    half = -np.log(np.clip(means[:, 2], math.sqrt(DARKEST), 1 - 1e-6))
    tau = -np.log(np.clip(means[:, 3], DARKEST, 1 - 1e-6))
    # b · half as a function of log T_1 / log T_½ − 1, solved to 2 %.
    more = np.clip(tau / half - 1, 1e-3, 1.0)
    bent = math.log(2) * (1 - more) / more * (1 + more * (1.1 - 0.66 * more))
    bend = np.clip(bent / half, *BEND)
    alone = -np.log(np.clip(means[:, 4:], math.sqrt(DARKEST), 1))
    x = 2 * np.expm1(np.minimum(bend[:, None] * alone, MAX_EXPONENT))
    fit = ratio(np.expm1(np.minimum(bend * tau, MAX_EXPONENT)), x.sum(axis=1))
    depths = np.log1p(np.where(fit > 0, fit, 1)[:, None] * x) / bend[:, None]
    return np.concatenate([means[:, :2], bend[:, None], depths], axis=1, dtype=np.float32)


def transmittance(cast: NDArray[np.float32], scale: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (…) p of (…, 1 + K) b and depths E, with the materials' depths scaled."""
    bend = np.maximum(cast[..., 0], BEND[0])
    x = np.expm1(np.minimum(bend[..., None] * cast[..., 1:], MAX_EXPONENT))
    return np.asarray(np.exp(-np.log1p(x @ scale) / bend), np.float32)


def ratio(part: Array, total: Array) -> Array:
    """Return a ratio, 0 of nothing."""
    return np.divide(part, total, out=np.zeros(np.broadcast(part, total).shape), where=total > 0)


def sample_tau(alpha: Array) -> Array:
    """Return the optical depth of samples; `MAX_TAU` if they are opaque."""
    with np.errstate(divide="ignore"):
        return np.minimum(-np.log1p(-alpha), MAX_TAU)
