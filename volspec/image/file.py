"""The OpenEXR file of a coefficient image, readable by compositors.

    CoefficientImage -> [file] -> CoefficientImage | Blender, Nuke, …

Every channel of the basis is one float or half channel, ``key.c00.V``, ``key.c01.V``, …: the light
group is the layer. ``A`` is the opacity, ``Z`` the depth and ``first.Z`` the first hit, both in
millimetres from the camera and infinite in empty pixels. ``R``, ``G``, ``B`` are a preview for
viewers. The header's ``volspec:groups`` holds each group's fraction of the light and
``volspec:basis`` the whole basis (JSON), so that an image can be relit without the scene that made
it, and an image of another basis version is refused; ``volspec:fov_deg`` the camera's vertical
field of view, if it has one, and ``volspec:camera`` the camera itself (JSON), from which nearby
views follow.

Layers of opacity (`CoefficientImage.opacity_layers`) are half channels, near to far:
``l3.tau.block.V``, ``l3.shade.key.block.V``, ``l3.gloss.key.V`` and ``l3.depth.Z``, of layer 3,
the material ``block`` and the light group ``key``. If lights have shadows, layers also have
``l3.shadow.part.key.V``, ``l3.shadow.gloss.key.V``, ``l3.shadow.bend.key.V`` and
``l3.shadow.depth.key.block.V``, and the same of ``occlusion`` (`OpacityLayers.shadow`). The
header's ``volspec:layers`` holds their version, number, groups with shadows, and the materials that
fade, if not all do; in version 3 the last layer is of surfaces (`OpacityLayers.solid`). Programs
that do not know them read the image without.
"""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._exr import Channels, chromaticities, read_exr, write_exr
from volspec._files import require_suffix
from volspec._parse import parse_json
from volspec.appearance.display import SPACES
from volspec.basis import Basis, MaterialBasis, basis_from_dict
from volspec.camera import Camera
from volspec.errors import ImageError, ShapeError, VolspecError
from volspec.image.fields import ImageFields, checked_groups
from volspec.image.layers import MAX_LAYERS, OpacityLayers, Slot

# Blender truncates names longer than 63 characters, channel included.
_MAX_NAME = 40


def channel_names(groups: Mapping[str, float], size: int) -> list[str]:
    """Return the channels' names in the file, in their order: ``key.c00.V``, ``key.c01.V``, ….

    Nuke reads them as ``key_c00.V``; in Blender ``key`` is a layer, ``c00`` one of its passes, and
    ``V`` means one number per pixel.

    >>> channel_names({"light": 1.0}, 2), channel_names({"3 é.": 0.5, "3_e": 0.5}, 1)
    (['light.c00.V', 'light.c01.V'], ['g3_e.c00.V', 'g3_e_2.c00.V'])
    """
    return [f"{layer}.c{k:02d}.V" for layer in plain_names(groups) for k in range(size)]


def layer_names(
    layer: int, materials: Iterable[str], groups: Iterable[str], slots: Iterable[Slot] = ()
) -> list[str]:
    """Return the channels' names of a layer of opacity, in the order of its arrays.

    ``slots`` are groups with shadows or occlusion, as `shadow_slots`. Nuke reads the first as
    ``l3_tau.block_V``; in Blender it is the pass ``block`` of ``l3.tau``.

    >>> layer_names(3, ["block"], ["key"])
    ['l3.tau.block.V', 'l3.shade.key.block.V', 'l3.gloss.key.V', 'l3.depth.Z']
    >>> layer_names(3, ["block"], ["key"], [(0, False)])[3:6]
    ['l3.shadow.part.key.V', 'l3.shadow.gloss.key.V', 'l3.shadow.bend.key.V']
    """
    kinds, lights = plain_names(materials), plain_names(groups)
    shadows = [(f"l{layer}.{CASTS[occluded]}", lights[group]) for group, occluded in slots]
    return [
        *(f"l{layer}.tau.{kind}.V" for kind in kinds),
        *(f"l{layer}.shade.{light}.{kind}.V" for light in lights for kind in kinds),
        *(f"l{layer}.gloss.{light}.V" for light in lights),
        *(
            name
            for cast, light in shadows
            for name in (
                *(f"{cast}.{number}.{light}.V" for number in ("part", "gloss", "bend")),
                *(f"{cast}.depth.{light}.{kind}.V" for kind in kinds),
            )
        ),
        f"l{layer}.depth.Z",
    ]


def plain_names(names: Iterable[str]) -> list[str]:
    """Return a name for files of each name, no two alike."""
    unique_names: list[str] = []
    taken: set[str] = set()
    for name in names:
        stem, number = _plain_name(name), 2
        unique = stem
        while unique.casefold() in taken:
            unique, number = f"{stem}_{number}", number + 1
        taken.add(unique.casefold())
        unique_names.append(unique)
    return unique_names


def _plain_name(group: str) -> str:
    """Return a name that no compositor changes: letters, digits and _, no digit first."""
    letters = unicodedata.normalize("NFKD", group).encode("ascii", "ignore").decode()
    stem = re.sub(r"[^A-Za-z0-9]+", "_", letters).strip("_")[:_MAX_NAME]
    return stem if stem[:1].isalpha() else f"g{stem}"


FORMAT = 3
# Attributes of the header, after "volspec:".
_OWN = ("format", "basis", "groups", "notes", "fov_deg", "camera", "layers")
# Without shadows, with, and with a last layer of surfaces.
PLAIN_VERSION, SHADOWS_VERSION, SOLID_VERSION = LAYERS_VERSIONS = 1, 2, 3
# Of layers' arrays, by `Slot`.
CASTS = "shadow", "occlusion"
_ALPHA_ERROR = 1e-3  # rounding of alpha by a compositor


def write_image(
    path: str | os.PathLike[str],
    image: ImageFields,
    preview: ArrayLike | None,
    texts: Mapping[str, str],
) -> None:
    """Write an image; see `CoefficientImage.save`."""
    name = os.fspath(path)
    require_suffix(path, "coefficient images", ".exr")
    header: dict[str, Any] = {
        "volspec:format": FORMAT,
        "volspec:basis": json.dumps(image.basis.to_dict()),
        "volspec:groups": json.dumps(image.groups),
        "volspec:notes": json.dumps(dict(image.notes)),
    }
    if image.fov_deg is not None:
        header["volspec:fov_deg"] = json.dumps(float(image.fov_deg))
    if type(image.camera) is Camera:  # not of a window or an eye
        header["volspec:camera"] = json.dumps(asdict(image.camera))
    if reserved := [key for key in texts if key in _OWN]:
        raise ImageError(
            f"{name}: a text is named {reserved[0]!r}, which is reserved for the image",
            "use another name",
            code="duplicate",
        )
    header |= {f"volspec:{key}": text for key, text in texts.items()}
    names = channel_names(image.groups, image.basis.size)
    channels: Channels = {key: image.coefficients[..., k] for k, key in enumerate(names)}
    channels |= {
        key: np.asarray(pixels, np.float32)
        for key, pixels in (("A", image.alpha), ("Z", image.depth_mm), ("first.Z", image.first_mm))
        if pixels is not None
    }
    if image.opacity_layers is not None:
        layers = image.opacity_layers
        slots = layers.slots
        version = SHADOWS_VERSION if slots else PLAIN_VERSION
        if layers.solid:
            version = SOLID_VERSION
        about: dict[str, Any] = {"version": version, "count": layers.count}
        for o, cast in enumerate(CASTS if version > PLAIN_VERSION else ()):
            about[cast] = [list(image.groups)[group] for group, occluded in slots if occluded == o]
        assert isinstance(image.basis, MaterialBasis)
        fading = [*compress(image.basis.materials, layers.fades)]
        if len(fading) < layers.materials:
            about["fades"] = fading
        header["volspec:layers"] = json.dumps(about)
        channels |= _layer_channels(image, layers, slots)
    if preview is not None:
        colours = np.asarray(preview)
        if colours.shape != (*image.alpha.shape, 3):
            raise ShapeError(
                f"{name}: the preview has shape {colours.shape}",
                f"expected {image.alpha.shape} and 3 colours",
                code="shape",
            )
        # float32 like A: OpenEXR groups the four, which must have one type.
        finite = np.nan_to_num(colours.astype(np.float32), nan=0.0)
        channels |= {key: finite[..., k] for k, key in enumerate("RGB")}
        rec709 = SPACES["Rec. 709"]
        header["chromaticities"] = chromaticities(rec709.primaries_xy, rec709.white_xy)
    write_exr(path, header, channels, ImageError)


def read_image(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the fields of a `CoefficientImage`; errors are those of `CoefficientImage.load`."""
    name = os.fspath(path)
    missing = f"no such file; `volspec render SCENE -o {name}` makes one"
    header, pixels = read_exr(path, ImageError, missing=missing, again="render the scene again")
    if "volspec:basis" not in header:
        raise ImageError(
            f"{name}: not a coefficient image",
            "`volspec render` makes them, and a spectral picture needs --basis",
            code="unsupported",
        )
    if (version := header.get("volspec:format")) != FORMAT:
        raise ImageError(
            f"{name}: format {version}, this volspec reads {FORMAT}",
            "render the scene again",
            code="unsupported",
        )
    with _wrap_faults(f"{name}: its basis is refused"):
        basis = basis_from_dict(parse_json(header["volspec:basis"]))
        notes = dict(parse_json(header.get("volspec:notes", "{}")))
    with _wrap_faults(f"{name}: its light groups are refused"):
        stored = parse_json(header["volspec:groups"])
        groups = checked_groups(stored)
    coefficients, alpha = _checked_pixels(name, pixels, channel_names(groups, basis.size))
    first = pixels.get("first.Z")
    with _wrap_faults(f"{name}: its volspec:fov_deg is refused"):
        fov_deg = parse_json(header.get("volspec:fov_deg", "null"))
    with _wrap_faults(f"{name}: its volspec:camera is refused"):
        placed = parse_json(header.get("volspec:camera", "null"))
        camera = None if placed is None else Camera(**placed)
    return {
        "coefficients": coefficients,
        "alpha": alpha,
        "depth_mm": pixels["Z"].astype(np.float32),
        "basis": basis,
        "notes": notes,
        "groups": groups,
        "first_mm": None if first is None else first.astype(np.float32),
        "fov_deg": fov_deg,
        "camera": camera,
        "opacity_layers": _read_layers(name, header, pixels, basis, groups),
    }


def _layer_channels(image: ImageFields, layers: OpacityLayers, slots: Sequence[Slot]) -> Channels:
    """Return the channels of layers of opacity."""
    assert isinstance(image.basis, MaterialBasis)
    height, width = image.alpha.shape
    channels: Channels = {}
    stored = layers.as_stored()
    for k in range(layers.count):
        shadows = [stored.slot(slot) for slot in slots]
        arrays = stored.tau, stored.shade, stored.gloss, *shadows, stored.depth_mm
        flat = [array[:, :, k].reshape(height, width, -1) for array in arrays]
        half = np.concatenate(flat, axis=2)
        names = layer_names(k, image.basis.materials, image.groups, slots)
        channels |= {name: half[..., n] for n, name in enumerate(names)}
    return channels


def _read_layers(
    name: str,
    header: Mapping[str, Any],
    pixels: Channels,
    basis: Basis,
    groups: Mapping[str, float],
) -> OpacityLayers | None:
    """Return a file's layers of opacity; None if it has none."""
    if "volspec:layers" not in header:
        return None
    with _wrap_faults(f"{name}: its layers of opacity are refused"):
        about = parse_json(header["volspec:layers"])
        version = about["version"]
    if isinstance(version, bool) or version not in LAYERS_VERSIONS:
        raise ImageError(
            f"{name}: layers of opacity of version {version}, this volspec reads "
            f"{', '.join(map(str, LAYERS_VERSIONS))}",
            "install a later volspec, or render the scene again",
            code="unsupported",
        )
    with _wrap_faults(f"{name}: its layers of opacity are refused"):
        count, minimum = int(about["count"]), 2 if version == SOLID_VERSION else 1
        if not (isinstance(basis, MaterialBasis) and minimum <= count <= MAX_LAYERS):
            problem = f"{count} layers in basis {basis.name!r}"
            raise ImageError(problem, f"{minimum} to {MAX_LAYERS} in one of materials are read")
        stored = sum(re.fullmatch(r"l\d+\.depth\.Z", name) is not None for name in pixels)
        if count != stored:
            raise ImageError(f"{count} layers are named and {stored} are there")
        slots = stored_slots(about, groups)
    materials, lights = len(basis.materials), len(groups)
    parts = []
    for k in range(count):
        names = layer_names(k, basis.materials, groups, slots)
        parts.append(_stack_channels(name, pixels, names))
    rows = np.stack(parts, axis=2)
    if not np.isfinite(rows[..., :-1]).all() or rows[..., :materials].min() < 0:
        raise ImageError(
            f"{name}: a layer of opacity contains NaN, infinite or negative values",
            "render the scene again",
            code="damaged",
        )
    with _wrap_faults(f"{name}: its layers of opacity are refused"):
        layers = OpacityLayers.of_numbers(rows.astype(np.float16), materials, lights, slots)
        return replace(layers, solid=version == SOLID_VERSION)


def stored_slots(about: Mapping[str, Any], groups: Iterable[str]) -> list[Slot]:
    """Return the groups with shadows or occlusion of a header's ``volspec:layers``."""
    numbers = {group: number for number, group in enumerate(groups)}
    return sorted(
        (numbers[group], bool(occluded))
        for occluded, cast in enumerate(CASTS)
        for group in (about[cast] if about["version"] > PLAIN_VERSION else ())
    )


def _stack_channels(name: str, pixels: Channels, keys: Iterable[str]) -> NDArray[Any]:
    """Return the channels of some names, or raise ImageError if one is missing."""
    for key in (names := list(keys)):
        if key not in pixels:
            raise ImageError(
                f"{name}: channel {key!r} is missing", "render the scene again", code="damaged"
            )
    return np.stack([pixels[key] for key in names], axis=-1)


@contextmanager
def _wrap_faults(problem: str) -> Iterator[None]:
    """Turn a fault in a header field into an ImageError."""
    try:
        yield
    except (ValueError, KeyError, TypeError) as error:
        # Python's own words are about code.
        why = f" ({error})" if isinstance(error, VolspecError) else ", its header is damaged"
        raise ImageError(f"{problem}{why}", "render again", code="damaged") from error


def _checked_pixels(name: str, pixels: Channels, keys: list[str]) -> tuple[Any, Any]:
    """Return a file's (H, W, L·M) coefficients and (H, W) alpha, checked."""
    _stack_channels(name, pixels, ("A", "Z"))
    coefficients = _stack_channels(name, pixels, keys)
    if not (np.isfinite(coefficients).all() and np.isfinite(pixels["A"]).all()):
        raise ImageError(
            f"{name}: contains NaN or infinite values", "render the scene again", code="damaged"
        )
    alpha = pixels["A"].astype(np.float32)
    low, high = float(alpha.min()), float(alpha.max())
    if low < -_ALPHA_ERROR or high > 1 + _ALPHA_ERROR:
        raise ImageError(
            f"{name}: channel 'A' runs from {low:g} to {high:g}",
            "an opacity is 0…1, render the scene again",
            code="damaged",
        )
    return coefficients, alpha.clip(0, 1)
