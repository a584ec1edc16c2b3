"""Prepare relighting in a compositor: lights as matrices in a coefficient image's header.

    basis, light groups, lights -> [compositing] -> EXR header -> Blender, Nuke, a script

    RGB = Σ_g M_g C_g  (+ (1 - A) backdrop)        linear Rec. 709, white 1, premultiplied by A
    M_g = RGB_from_XYZ · Bradford(white of the light -> D65) · D_g diag(e_g)

D_g diag(e_g) is the matrix of `Illumination` in the picture's mode. A compositor has no appearance
model, so a matrix adapts completely to the light's white, as in ICC profiles. docs/compositing.md
is the users' guide.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from volspec._exr import read_header, to_half
from volspec._parse import parse_json
from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import adaptation
from volspec.basis import Basis, MaterialBasis, SpectralBasis, visible_white
from volspec.errors import ImageError, ViewingError, quote
from volspec.export.exr import PRIMARIES
from volspec.export.spectral import flat_white_scale
from volspec.image import (
    MAX_LAYERS,
    SOLID_VERSION,
    CoefficientImage,
    Slot,
    channel_names,
    plain_names,
    stored_slots,
)
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.scene import NamedLight, Scene
from volspec.spectra import Spectrum

Array = NDArray[np.float64]

VERSION = 1
_JSON, _TEXT = "compositing", "relight"  # names of attributes, after "volspec:"
# Names made by `channel_names`.
_CHANNEL = re.compile(r"[A-Za-z][A-Za-z0-9_]*\.c[0-9]+\.V")
_MATERIAL = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_DIGITS = 9  # significant digits in a header; float32 has 7


@dataclass(frozen=True, slots=True, eq=False)
class CompositorLight:
    """Relighting by one light in a compositor."""

    matrices: Mapping[str, Array]  # (3, M) to linear Rec. 709, for each light group that is lit
    backdrop: Array  # (3,) colour of the diffuser behind
    # (M,) channels e_g by group, 1 for flat white of the same luminance; empty for a basis of
    # materials.
    numbers: Mapping[str, Array]
    illuminance_lux: float | None = None  # E_v on a surface that faces every source


@dataclass(frozen=True, slots=True, eq=False)
class Recipe:
    """Channel names and lights of a coefficient image, for compositors.

    >>> from volspec.basis import SpectralBasis
    >>> from volspec.spectra import light
    >>> basis = SpectralBasis.load("general-7")
    >>> recipe = Recipe.of(basis, {"light": 1.0}, {"tungsten": light("A")})
    >>> M = recipe.lights["tungsten"].matrices["light"]
    >>> M.shape, (M @ np.ones(7)).round(6).tolist()
    ((3, 7), [1.0, 1.0, 1.0])
    """

    channels: Mapping[str, tuple[str, ...]]  # names in the file, by light group
    lights: Mapping[str, CompositorLight]  # the first is used for the preview
    mode: str
    # Names in the file of a basis' materials, in the order of the channels.
    materials: Mapping[str, str] = field(default_factory=dict)
    layers: int = 0  # of opacity, in the file that the recipe was read from
    shadows: tuple[Slot, ...] = ()  # of these layers
    solid: bool = False  # the last layer is of surfaces
    fades: frozenset[str] = frozenset()  # materials that the layers' scales change

    def __post_init__(self) -> None:
        if not self.lights:
            raise ImageError("has no lights", "give at least one", code="missing", field="recipe")
        for channel in (name for names in self.channels.values() for name in names):
            # Names become part of expressions that compositors evaluate.
            if not (isinstance(channel, str) and _CHANNEL.fullmatch(channel)):
                raise ImageError(
                    f"{quote(channel)} is not a channel of a cast",
                    "give names such as key.c00.V",
                    code="unknown",
                    field="recipe",
                    given=channel,
                )
        for material in self.materials.values():
            if not (isinstance(material, str) and _MATERIAL.fullmatch(material)):
                raise ImageError(
                    f"{quote(material)} is not a name of a material in a file",
                    "give letters, digits and _",
                    code="unknown",
                    field="recipe",
                    given=material,
                )
        for name, light in self.lights.items():
            _require_fit(f"light {quote(name)}", light, self.channels)

    @classmethod
    def of(
        cls,
        basis: Basis,
        groups: Mapping[str, float],
        lights: Mapping[str, Spectrum | LightRig],
        spec: RelightSpec | None = None,
    ) -> Self:
        """Compute the lights of an image with this basis and these groups.

        Mode, backdrop, level and exposure of ``spec`` apply, adaptation does not. If a light has
        no lux, all are at level ``"relative"``. Errors as in `Illumination.of`.
        """
        if not (isinstance(lights, Mapping) and lights):
            raise ViewingError(
                f"the lights are {quote(lights)}",
                "give at least one by name, such as {'day': volspec.light('D65')}",
                code="missing",
                field="recipe",
                given=lights,
            )
        spec, size = (spec or RelightSpec()).for_lights(lights.values()), basis.size
        names = channel_names(groups, size)
        channels = {g: tuple(names[k * size : (k + 1) * size]) for k, g in enumerate(groups)}
        rows = {}
        for name, light in lights.items():
            rig = LightRig.of(light)
            illumination = Illumination.of(basis, rig, spec, groups)
            to_RGB = _RGB_from_XYZ(illumination.white_XYZ)
            parts = np.split(to_RGB @ illumination.XYZ_from_channels, len(groups), axis=1)
            lit_parts = {g: part for g, part in zip(groups, parts, strict=True) if part.any()}
            numbers = _numbers(basis, groups, rig, illumination.gain)
            rows[name] = CompositorLight(
                lit_parts, to_RGB @ illumination.backdrop_XYZ, numbers, illumination.illuminance_lux
            )
        materials = {}
        if isinstance(basis, MaterialBasis):
            material_names = plain_names(basis.materials)
            materials = dict(zip(basis.materials, material_names, strict=True))
        return cls(channels, MappingProxyType(rows), spec.mode, materials)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read the recipe in an image's header."""
        name, header = os.fspath(path), read_header(path, ImageError)
        if "volspec:basis" not in header:
            raise ImageError(
                f"{name}: not a coefficient image", "`volspec render` makes them", code="type"
            )
        text = header.get(f"volspec:{_JSON}")
        if text is None:
            raise ImageError(
                f"{name}: has no lights for compositors",
                f"`volspec compositing {name} --light D65 -o NEW.exr` adds them",
                code="missing",
            )
        try:
            data = parse_json(text)
            if data["version"] != VERSION:
                raise ValueError(f"version {data['version']}, this volspec reads {VERSION}")
            lights = {
                light: CompositorLight(
                    _arrays(row["matrices"]),
                    np.array(row["backdrop"], np.float64),
                    _arrays(row["numbers"]),
                    float(row["illuminance_lux"]) if "illuminance_lux" in row else None,
                )
                for light, row in data["lights"].items()
            }
            channels = {g: tuple(names) for g, names in data["channels"].items()}
            materials = dict(data.get("materials", {}))
            about = parse_json(header.get("volspec:layers", '{"count": 0}'))
            layers = min(int(about["count"]), MAX_LAYERS) if materials else 0
            shadows = stored_slots(about, channels) if layers else ()
            solid = layers > 0 and about["version"] == SOLID_VERSION
            fades = frozenset(about.get("fades", materials))
            return cls(
                *(channels, lights, data["mode"], materials, layers, tuple(shadows), solid, fades)
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ImageError(
                f"{name}: volspec:{_JSON} cannot be read ({error}); write it again by "
                "`volspec compositing`",
                code="damaged",
            ) from None

    def texts(self) -> dict[str, str]:
        """Return header attributes: all data as JSON, and each light's sums as text to paste."""
        data = {
            "version": VERSION,
            "colours": "linear Rec. 709, white D65 = 1, premultiplied by A",
            "adapted": "Bradford, completely, from the white of each light",
            "mode": self.mode,
            "channels": {group: list(names) for group, names in self.channels.items()},
            **({"materials": dict(self.materials)} if self.materials else {}),
            "lights": {
                name: {
                    "matrices": {g: _round_floats(M) for g, M in light.matrices.items()},
                    "backdrop": _round_floats(light.backdrop),
                    "numbers": {g: _round_floats(e) for g, e in light.numbers.items()},
                    **_lux(light),
                }
                for name, light in self.lights.items()
            },
        }
        texts = {_JSON: json.dumps(data, ensure_ascii=False)}
        for number, name in enumerate(self.lights, start=1):
            sums = zip(("red", "green", "blue"), self.sums(name), strict=True)
            rows = (f"{colour}: {' + '.join(parts.values())}" for colour, parts in sums)
            texts[f"{_TEXT}.{number}"] = "\n".join((name, *rows))
        return texts

    def sums(self, light: str) -> list[dict[str, str]]:
        """Return the sums for R, G and B by light group, with Nuke's channel names."""
        matrices = self.lights[light].matrices
        return [
            {group: self._sum(group, M[row]) for group, M in matrices.items()} for row in range(3)
        ]

    def _sum(self, group: str, row: Array) -> str:
        """Return ``(0.12*key_c00.V-0.03*key_c01.V…)``."""
        names = (name.replace(".", "_", 1) for name in self.channels[group])
        terms = (f"{v:+.{_DIGITS}g}*{name}" for v, name in zip(row, names, strict=True))
        return f"({''.join(terms).removeprefix('+')})"

    def picture(self, image: CoefficientImage, light: str) -> NDArray[np.float32]:
        """Return (H, W, 3): an image under a light as a compositor computes it."""
        RGB = np.zeros((*image.alpha.shape, 3), np.float32)
        for group, M in self.lights[light].matrices.items():
            RGB += np.asarray(image.layer(group), np.float32) @ M.T.astype(np.float32)
        return RGB


def scene_recipe(scene: Scene, lights: Iterable[NamedLight], spec: RelightSpec) -> Recipe:
    """Return the recipe for casts of a scene; the first light is used for the preview."""
    rigs = {light.name: light.rig for light in lights}
    return Recipe.of(scene.basis, scene.raycast.shares(), rigs, spec)


def save_for_compositors(
    image: CoefficientImage, path: str | os.PathLike[str], recipe: Recipe
) -> None:
    """Write a coefficient image with lights in its header and a preview under the first light.

    The preview is of half floats, as renderers' pictures are.
    """
    preview = to_half(recipe.picture(image, next(iter(recipe.lights))))
    image.save(path, preview, recipe.texts())


def _RGB_from_XYZ(white_XYZ: Array) -> Array:
    """Return the (3, 3) matrix from XYZ under a white to linear Rec. 709 under D65."""
    space = PRIMARIES["Rec. 709"]
    whites = visible_white(white_XYZ), space.white_XYZ
    scene, display = (ViewingConditions(tuple(white.tolist())) for white in whites)
    adapted = adaptation("Bradford")(scene, display).apply(np.eye(3)).T
    return np.asarray(space.RGB_from_XYZ @ adapted)


def _numbers(
    basis: Basis, groups: Mapping[str, float], rig: LightRig, gain: float
) -> dict[str, Array]:
    """Return the channels of each group's light."""
    if not isinstance(basis, SpectralBasis):
        return {}
    kappa = flat_white_scale(basis, rig.facing(groups).mixed(basis.grid), gain)
    lit_parts = {group: rig.shining_from(group) for group in groups}
    return {
        group: kappa * basis.analyse(group_rig.mixed(basis.grid))
        for group, group_rig in lit_parts.items()
        if group_rig is not None
    }


def _require_fit(who: str, light: CompositorLight, channels: Mapping[str, tuple[str, ...]]) -> None:
    """Refuse a light whose arrays do not match the channels."""
    if not light.matrices:
        raise ImageError(
            f"{who}: has no matrix", f"give one for {', '.join(channels)}", code="missing"
        )
    _require_shape(f"{who}: backdrop", light.backdrop, (3,))
    for kind, rows, shape in (("matrix", light.matrices, (3,)), ("numbers", light.numbers, ())):
        for group, array in rows.items():
            if group not in channels:
                raise ImageError(
                    f"{who}: {kind} of unknown group {quote(group)}",
                    f"known: {', '.join(channels)}",
                    code="unknown",
                )
            name = f"{who}: {kind} of group {quote(group)}"
            _require_shape(name, array, (*shape, len(channels[group])))


def _require_shape(who: str, array: Array, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ImageError(f"{who} has shape {array.shape}", f"expected {shape}", code="shape")
    if not np.isfinite(array).all():
        raise ImageError(f"{who} has NaN or infinite numbers", "give finite ones", code="range")


def _arrays(data: Mapping[str, Any]) -> dict[str, Array]:
    return {group: np.array(numbers, np.float64) for group, numbers in data.items()}


def _lux(light: CompositorLight) -> dict[str, float]:
    lux = light.illuminance_lux
    return {} if lux is None else {"illuminance_lux": float(f"{lux:.{_DIGITS}g}")}


def _round_floats(values: Array) -> Any:
    if values.ndim > 1:
        return [_round_floats(row) for row in values]
    return [float(f"{v:.{_DIGITS}g}") for v in values]
