"""Recompose a picture with other opacities on the GPU, from its layers.

    OpacityLayers -> PackedOpacity -> [recompose] -> coefficients -> shaders/relight.frag

Layers are uploaded once, as half floats; a change of opacities is a draw (shaders/recompose.frag).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._gpu import assemble, compile_program, describe, prelude
from volspec.errors import OpenGLError
from volspec.image import (
    BEND,
    MAX_EXPONENT,
    OCCLUSION_GAIN,
    CoefficientImage,
    DepthEffects,
    OpacityLayers,
    Slot,
    extents,
    residual_share,
)
from volspec.relight.texture_planes import layer_count

_GLSL = "330 core"
# Targets of one draw; every device has at least four.
_MAX_TARGETS = 4
# Slices of layers that are uploaded at once.
_SLICES_A_STEP = 8
_LAYERS_UNIT, _BASE_UNIT = 5, 6
# Farther than any layer.
_FAR_MM = 1e30


def layer_slots(
    materials: int, groups: int, shadows: int = 0, *, extents: bool = False
) -> tuple[list[int], int]:
    """Return the places of a layer's numbers in the shader's texels, four to each, and the texels.

    Numbers are the depths, the shades group by group, the highlights; then of each of some shadows
    the depths, the parts of shade and highlight, and b; at last where the layer begins, and its
    width.
    """
    slots = list(range(materials))
    slots += [4 * (1 + g) + k for g in range(groups) for k in range(materials)]
    if materials < 4:
        slots += [4 * (1 + g) + materials for g in range(groups)]
    else:
        slots += [4 * (1 + groups) + g for g in range(groups)]
    texels = 1 + max(slots) // 4
    for first in range(4 * texels, 4 * texels + 8 * shadows, 8):
        slots += [*range(first, first + materials), *range(first + 4, first + 7)]
    texels += 2 * shadows
    if extents:
        slots += [4 * texels, 4 * texels + 1]
    return slots, texels + extents


def layer_planes(layers: OpacityLayers) -> list[NDArray[Any]]:
    """Return (H, W, L) planes of all numbers of layers, in the order of `layer_slots`."""
    planes = [layers.tau[..., k] for k in range(layers.materials)]
    planes += [
        layers.shade[..., g, k] for g in range(layers.groups) for k in range(layers.materials)
    ]
    planes += [layers.gloss[..., g] for g in range(layers.groups)]
    for slot in layers.slots:
        shadow = layers.slot(slot)
        planes += [shadow[..., n] for n in (*range(3, shadow.shape[-1]), 0, 1, 2)]
    return planes


def are_filled(used: NDArray[np.bool_], solid: bool) -> bool:
    """Return True if layers (H, W, L) are used from the first on; the last may be of surfaces."""
    fading = used[..., : used.shape[2] - solid]
    return not (fading.any(axis=2) & ~fading[..., 0]).any() if fading.shape[2] else False


def layer_extents(layers: OpacityLayers) -> tuple[NDArray[Any], float]:
    """Return (H, W, L, 2) where layers begin, beyond the nearest, and their widths; and its place.

    All are millimetres along the rays; `volspec.image.depth.extents` says of what slabs.
    """
    both = np.zeros((*layers.tau.shape[:3], 2), np.float32)
    nearest = math.inf
    # Row by row, which stays in a core's cache.
    for line, (tau, depth) in enumerate(zip(layers.tau, layers.depth_mm, strict=True)):
        total = tau.astype(np.float32).sum(axis=2)
        both[line, ..., 0], both[line, ..., 1] = extents(
            total, depth.astype(np.float32), layers.solid
        )
        nearest = min(nearest, both[line, ..., 0].min(initial=math.inf, where=total > 0))
    nearest = float(nearest) if math.isfinite(nearest) else 0.0
    both[..., 0] = np.maximum(both[..., 0] - nearest, 0)
    return both, nearest


def shadow_constants(materials: int, groups: int, slots: Sequence[Slot]) -> dict[str, float]:
    """Return the shader's constants of shadows and occlusion of some groups."""
    bits = [sum(1 << g for g, occluded in slots if occluded == kind) for kind in (False, True)]
    return {
        "SHADOWED": bits[0],
        "OCCLUDED": bits[1],
        "SHADOWS_AT": layer_slots(materials, groups)[1],
        "OCCLUSION_GAIN": OCCLUSION_GAIN,
        "BEND_MIN": BEND[0],
        "MAX_EXPONENT": MAX_EXPONENT,
    }


@dataclass(frozen=True, slots=True, eq=False)
class PackedOpacity:
    """Layers of opacity in the shader's layout: packed on one thread, uploaded on another.

    ``texels`` (L·TEXELS, H, W, 4) are float16. ``nearest_mm`` is the distance from which extents,
    the last texel of a layer, count; None without.
    """

    texels: NDArray[np.float16]
    count: int
    materials: int
    groups: int
    shadows: tuple[Slot, ...] = ()  # groups that have them, or occlusion
    solid: bool = False
    filled: bool = False
    fades: tuple[bool, ...] = ()
    nearest_mm: float | None = None

    @classmethod
    def of(cls, layers: OpacityLayers, depth: bool = False) -> Self:
        """Pack an image's layers, with their extents for effects of depth."""
        height, width, count, materials = layers.tau.shape
        planes, shadows = layer_planes(layers), tuple(layers.slots)
        slots, per_layer = layer_slots(materials, layers.groups, len(shadows), extents=depth)
        nearest = None
        if depth:
            extent, nearest = layer_extents(layers)
            planes += [extent[..., 0], extent[..., 1]]
        texels = np.zeros((count, per_layer, height, width, 4), np.float16)
        for i, plane in zip(slots, planes, strict=True):
            # (H, W, L) planes, layer by layer.
            texels[:, i // 4, :, :, i % 4] = np.moveaxis(plane, 2, 0)
        flat = texels.reshape(count * per_layer, height, width, 4)
        # Half floats have no depths below 3e-8.
        used = np.moveaxis(np.any(texels[:, 0, :, :, :materials], axis=3), 0, 2)
        filled = are_filled(used, layers.solid)
        about = shadows, layers.solid, filled, tuple(layers.fades)
        return cls(flat, count, materials, layers.groups, *about, nearest)

    def constants(self) -> dict[str, float]:
        """Return the constants compiled into the shader."""
        return {
            **shadow_constants(self.materials, self.groups, self.shadows),
            "COUNT": self.count,
            "SOLID": int(self.solid),
            "FILLED": int(self.filled),
            "MATERIALS": self.materials,
            "GROUPS": self.groups,
            "TEXELS": len(self.texels) // self.count,
            "EXTENTS": int(self.nearest_mm is not None),
        }


def depth_uniforms(effects: DepthEffects, image: CoefficientImage) -> dict[str, tuple[float, ...]]:
    """Return the shader's uniforms of an image's cut and fog."""
    fog_light = tuple(effects.fog_white * fraction for fraction in image.groups.values())
    angle = 0.0 if image.fov_deg is None else math.radians(image.fov_deg)
    return {
        "cut_mm": (effects.near_mm, _FAR_MM if effects.far_mm is None else effects.far_mm),
        "fog": (effects.fog_per_mm, effects.fog_from_mm),
        "fog_light": fog_light,
        "slope": (2 * math.tan(angle / 2) / image.size[1],),
    }


class Recomposer:
    """Layers of one picture on the device, and the picture recomposed from them.

    ``size`` is the width and height. All calls need the engine's context. Raises OpenGLError if
    the device has no room for the layers, or its driver refuses the shader.
    """

    def __init__(self, context: Any, packed: PackedOpacity, size: tuple[int, int]) -> None:
        self._context, self._size = context, size
        self._resources: list[Any] = []
        self._constants = packed.constants()
        channels = packed.groups * (packed.materials + 1)
        self._slices = layer_count(channels)
        device = describe(context)
        if len(packed.texels) > device["max_layers"]:
            raise OpenGLError(
                f"{packed.count} layers of opacity take {len(packed.texels)} slices, but "
                f"{device['device']} has textures of at most {device['max_layers']}",
                "cast with fewer layers, or fewer light groups",
                code="size",
                field="OpenGL",
            )
        self._programs: dict[tuple[int, int, bool, bool], tuple[Any, Any]] = {}
        self._nearest_mm = 0.0

    def allocate(self) -> None:
        """Make the textures; raises moderngl.Error if there is no memory."""
        context, size, array = self._context, self._size, (*self._size, self._slices)
        slices = int(self._constants["COUNT"] * self._constants["TEXELS"])
        self._layers = self._track(context.texture_array((*size, slices), 4, dtype="f2"))
        self._difference = self._track(context.texture_array(array, 4, dtype="f4"))
        self.texture = self._track(context.texture_array(array, 4, dtype="f4"))
        self._buffer = self._track(context.buffer(reserve=16 * math.prod(array)))
        count = min(self._slices, _MAX_TARGETS)
        targets = [self._track(context.texture(size, 4, dtype="f4")) for _ in range(count)]
        self._target = self._track(context.framebuffer(targets))

    def _track(self, resource: Any) -> Any:
        self._resources.append(resource)
        return resource

    def fits(self, packed: PackedOpacity) -> bool:
        """Return True if `load` takes these layers."""
        return packed.constants() == self._constants

    def load(self, packed: PackedOpacity, base: Any) -> Iterator[None]:
        """Upload layers of the picture in the texture ``base``, step by step."""
        self._nearest_mm, self._fades = packed.nearest_mm or 0.0, packed.fades
        count = len(packed.texels)
        size = self._size
        for first in range(0, count, _SLICES_A_STEP):
            part = packed.texels[first : first + _SLICES_A_STEP]
            self._layers.write(part, viewport=(0, 0, first, *size, len(part)))
            yield
        self._draw(base, self._difference, [1.0] * packed.materials, 0.0, difference=True)

    @property
    def has_extents(self) -> bool:
        """True if the layers have extents, which effects of depth need."""
        return bool(self._constants["EXTENTS"])

    def draw(
        self, scales: Sequence[float], depth: Mapping[str, tuple[float, ...]] | None = None
    ) -> None:
        """Recompose the picture into `texture`, with a scale of each material's optical depth.

        ``depth`` are `depth_uniforms`.
        """
        residual = residual_share(scales, self._fades) if depth is None else 0.0
        self._draw(self._difference, self.texture, scales, residual, depth, difference=False)

    def release(self) -> None:
        """Release everything."""
        for resource in reversed(self._resources):
            resource.release()
        self._resources.clear()

    def _draw(
        self,
        base: Any,
        into: Any,
        scales: Sequence[float],
        fade: float,
        depth: Mapping[str, tuple[float, ...]] | None = None,
        *,
        difference: bool,
    ) -> None:
        self._layers.use(_LAYERS_UNIT)
        base.use(_BASE_UNIT)
        bytes_of_slice = 16 * self._size[0] * self._size[1]
        self._target.use()
        self._context.enable_only(self._context.NOTHING)
        for first in range(0, self._slices, _MAX_TARGETS):
            drawn = min(self._slices - first, _MAX_TARGETS)
            program, triangle = self._program(first, drawn, difference, depth is not None)
            if depth is not None:
                for name, value in {**depth, "nearest_mm": (self._nearest_mm,)}.items():
                    if name in program:
                        # Drivers drop what a draw does not use, as an array's last entries.
                        uniform = program[name]
                        used = uniform.array_length * uniform.dimension
                        uniform.write(np.array(value[:used], np.float32).tobytes())
            program["scales"].value = tuple(scales) + (1.0,) * (4 - len(scales))
            if not difference:
                program["fade"].value = fade
            triangle.render(self._context.TRIANGLES, vertices=3)
            for j in range(drawn):
                self._target.read_into(
                    self._buffer,
                    components=4,
                    attachment=j,
                    dtype="f4",
                    write_offset=(first + j) * bytes_of_slice,
                )
        into.write(self._buffer)

    def _program(self, first: int, drawn: int, difference: bool, depth: bool) -> tuple[Any, Any]:
        key = first, drawn, difference, depth
        if key not in self._programs:
            constants: dict[str, ArrayLike] = {
                **self._constants,
                "FIRST_SLICE": first,
                "SLICES_DRAWN": drawn,
                "DIFFERENCE": int(difference),
                "DEPTH": int(depth),
                "CODED": 0,
            }
            lines = prelude(constants, "glsl")
            vertex = assemble("shaders/fullscreen.vert", lines, glsl_version=_GLSL)
            fragment = assemble("shaders/recompose.frag", lines, glsl_version=_GLSL)
            program = self._track(compile_program(self._context, vertex, fragment))
            program["layers"].value, program["base"].value = _LAYERS_UNIT, _BASE_UNIT
            self._programs[key] = program, self._track(self._context.vertex_array(program, []))
        return self._programs[key]
