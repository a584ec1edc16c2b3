"""Errors of recomposed layers of opacity, estimated from the layers themselves.

    CoefficientImage with layers + scales + light -> [opacity_error] -> XYZ by which a pixel is off

What a layer lost can only be guessed, as its samples are gone. The guesses, each measured against
casts (`python -m benchmarks.layer_estimate`):

- **Order.** A layer counts its materials as mixed. If one lay in front of the other, it would be
  seen more: the difference bounds the error.
- **Neighbours.** Two layers that are merged, by the rule of `LayerStream`, change the picture; the
  layers' own samples were merged in the same way.
- **Highlights.** A layer has one number for all its materials. If they share the layer differently
  than at scale 1, the highlight may be any up to the brightest of the ray.
- **Shadows** and occlusion that other opacities change are wrong by a part of the change.

As light neighbours that are alike are merged first, parts of a layer are hardly heavier than the
lightest neighbours are now: a heavier layer is mostly a single sample. With r, the ratio of both
masses, order and highlights change by r², as a product of two parts, and neighbours by r³, as their
difference is smaller too. With shadows layers also end where light changes, which their masses do
not show; parts are then taken for `_SHADED` mean masses at least.

Transmittances are exact in front of each layer, whatever is merged, so the errors of layers add,
and as their signs are unknown, their squares do; those of occlusion add in a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.image import OpacityLayers, residual_share

Pixels = NDArray[np.float32]

_MERGED, _GLOSS, _SHADOW, _OCCLUSION, _MIN = 0.45, 0.3, 0.1, 0.3, 0.03
"""Parts of the guesses that are lost on average, and the least error, CIEDE2000: calibrated with
the benchmark's volumes."""
_SHADED = 1.5  # mean masses of a layer


class _Lit(NamedTuple):
    """Layers under a light: depths (K, L, P), XYZ (K, 3, L, P) of materials and of highlights."""

    tau: Pixels
    colours: Pixels
    gloss: Pixels

    @classmethod
    def of(cls, layers: OpacityLayers, XYZ_from_channels: NDArray[Any]) -> _Lit:
        """Return the layers of a row of pixels under a light."""
        tau, shade, gloss = (
            np.ascontiguousarray(np.moveaxis(array[0], 0, -1), np.float32)
            for array in (layers.tau, layers.shade, layers.gloss)
        )
        matrix = XYZ_from_channels.astype(np.float32).reshape(3, layers.groups, -1)
        return cls(
            np.moveaxis(tau, 1, 0),
            np.einsum("lgkp,cgk->kclp", shade, matrix[..., :-1]),
            np.einsum("lgp,cg->clp", gloss, matrix[..., -1]),
        )

    def scaled(self, scales: Sequence[float]) -> _Lit:
        """Return the layers with the materials' depths scaled."""
        factors = np.asarray(scales, np.float32)[:, None, None]
        return _Lit(self.tau * factors, self.colours, self.gloss)

    def separate(self) -> tuple[Pixels, Pixels]:
        """Return XYZ (3, L, P) of each layer by itself, and its transmittance (L, P)."""
        total = self.tau.sum(axis=0)
        opacity = -np.expm1(-total)
        part = opacity / np.maximum(total, 1e-12)
        XYZ = opacity * self.gloss
        for tau, colours in zip(self.tau, self.colours, strict=True):
            XYZ += part * tau * colours
        return XYZ, 1 - opacity

    def in_pairs(self) -> _Lit:
        """Return each layer merged with the next, as `LayerStream` merges."""
        colours = [_merge_layers(*pair) for pair in zip(self.colours, self.tau, strict=True)]
        gloss = _merge_layers(self.gloss, self.tau.sum(axis=0))
        return _Lit(self.tau[:, :-1] + self.tau[:, 1:], np.stack(colours), gloss)


def _merge_layers(values: Pixels, tau: Pixels) -> Pixels:
    """Return the mean of (3, L, P) values of neighbours, weighted by what they show."""
    front = -np.expm1(-tau[:-1])
    back = (1 - front) * -np.expm1(-tau[1:])
    fraction = back / np.maximum(front + back, 1e-12)
    return values[:, :-1] + fraction * (values[:, 1:] - values[:, :-1])


def opacity_deviation(
    layers: OpacityLayers, scales: Sequence[float], XYZ_from_channels: NDArray[Any]
) -> NDArray[Any]:
    """Return (P, 3): XYZ by which scaled layers of one row of pixels are off, on average.

    The sign is that of the greatest guess. ``XYZ_from_channels`` is that of an `Illumination`.
    """
    layers = layers.fading  # transmittances in front of surfaces are exact
    shaded = layers.shadow is not None or layers.occlusion is not None
    stack = _Lit.of(layers.lit(scales), XYZ_from_channels)
    merging = _merge_shares(stack.tau, _SHADED if shaded else 0)
    guesses = _guesses(stack, scales, *merging)
    fade = residual_share(scales, [True] * len(scales))
    if fade > 0:  # the error at scale 1 is known, and removed
        ones = [1.0] * len(scales)
        as_cast = _Lit.of(layers.lit(ones), XYZ_from_channels)
        guesses -= np.float32(fade) * _guesses(as_cast, ones, *merging)
    changes = _shadow_changes(layers, scales, XYZ_from_channels)
    guesses = np.concatenate([guesses, *changes], axis=1)
    greatest = np.abs(guesses[1]).argmax(axis=0)
    sign = np.sign(np.take_along_axis(guesses, greatest[None, None], axis=1)[:, 0])
    return (sign * np.sqrt(np.square(guesses).sum(axis=1))).T


def _merge_shares(tau: Pixels, mean_masses: float) -> tuple[Pixels, Pixels]:
    """Return the mass of the greatest merged part by that of each layer and pair, 1 at most.

    That is the mass of the lightest neighbours, or some mean masses of a layer.
    """
    cumulative = np.cumsum(tau, axis=1)
    quarter = np.exp(-0.25 * cumulative)  # the scales of `visibility`: 1/4, 1 and 4
    one = np.square(np.square(quarter))
    four = np.square(np.square(one))
    total = 3 * len(tau) - (quarter + one + four).sum(axis=0)
    mass = np.diff(total, axis=0, prepend=0)
    pairs = mass[:-1] + mass[1:]
    lightest = np.where(mass[1:] > 0, pairs, np.inf).min(axis=0, initial=np.inf)
    mean = total[-1] / np.maximum(1, (mass > 0).sum(axis=0))
    part = np.maximum(lightest, mean_masses * mean)
    layers, both = (np.minimum(1, part / np.maximum(total, 1e-9)) for total in (mass, pairs))
    return layers, both


def _guesses(stack: _Lit, scales: Sequence[float], layers: Pixels, pairs: Pixels) -> Pixels:
    """Return (3, guesses, P): XYZ by which a pixel is off, of layers and pairs with such parts."""
    scaled, merged = stack.scaled(scales), stack.in_pairs().scaled(scales)
    XYZ, clear = scaled.separate()
    front = _in_front(clear)
    alone = XYZ[:, :-1] + clear[:-1] * XYZ[:, 1:]
    terms = [_MERGED * pairs**3 * front[:-1] * (merged.separate()[0] - alone)]
    parts = np.square(layers) * front
    total = scaled.tau.sum(axis=0)
    for one, other in combinations(range(len(scaled.tau)), 2):
        a, b = scaled.tau[one], scaled.tau[other]
        both = a + b
        mixed = a * -np.expm1(-both) / np.maximum(both, 1e-12)
        in_front = -np.expm1(-a)
        more = np.maximum(in_front - mixed, mixed - np.exp(-b) * in_front)
        # The layer's other materials are in front of these half of the time.
        more *= _MERGED * parts * np.exp(-0.5 * (total - both))
        terms.append(more * (stack.colours[one] - stack.colours[other]))
    after, before = (tau / np.maximum(tau.sum(axis=0), 1e-12) for tau in (scaled.tau, stack.tau))
    shift = 0.5 * np.abs(after - before).sum(axis=0)
    terms.append(_GLOSS * parts * (1 - clear) * shift * stack.gloss.max(axis=1, keepdims=True))
    return np.concatenate(terms, axis=1)


def _shadow_changes(
    layers: OpacityLayers, scales: Sequence[float], XYZ_from_channels: NDArray[Any]
) -> list[Pixels]:
    """Return (3, …, P) parts of the changes by shadows, layer by layer, and by occlusion, added."""
    changes = []
    for part, selected in (
        (_SHADOW, replace(layers, occlusion=None)),
        (_OCCLUSION, replace(layers, shadow=None)),
    ):
        if selected.shadow is None and selected.occlusion is None:
            continue
        now, as_cast = (
            _Lit.of(selected.lit(factors), XYZ_from_channels).scaled(scales).separate()
            for factors in (scales, [1.0] * len(scales))
        )
        change = part * _in_front(now[1]) * (now[0] - as_cast[0])
        added = selected.occlusion is not None
        changes.append(change.sum(axis=1, keepdims=True) if added else change)
    return changes


def _in_front(transmittance: Pixels) -> Pixels:
    """Return the transmittance in front of each layer, of transmittances (L, P)."""
    front = np.ones_like(transmittance)
    np.cumprod(transmittance[:-1], axis=0, out=front[1:])
    return front


def with_neighbours(delta_e: Pixels, visible: NDArray[np.bool_]) -> Pixels:
    """Return the root mean square of each pixel's estimate and its neighbours', 3 by 3.

    Only pixels in which something is ``visible`` count. What a pixel lost is as good as random, so
    neighbours say as much of it.
    """
    squares = np.where(visible, np.square(delta_e) + _MIN**2, 0)
    total, count = (_box_sum(array) for array in (squares, visible.astype(np.float32)))
    return np.where(visible, np.sqrt(total / np.maximum(count, 1)), 0).astype(np.float32)


def _box_sum(values: Pixels) -> Pixels:
    for axis in (0, 1):
        rows = np.moveaxis(values, axis, 0)
        total = rows.copy()
        total[1:] += rows[:-1]
        total[:-1] += rows[1:]
        values = np.moveaxis(total, 0, axis)
    return values
