"""The OpenEXR file of a coefficient image: as the raycaster left it, and as compositors read it.

    CoefficientImage -> [image_file] -> CoefficientImage | Blender, Nuke, …

Every channel of the basis is one float or half channel, ``key.c00.V``, ``key.c01.V``, …: the light
group is the layer. ``A`` is the opacity, ``Z`` the depth and ``first.Z`` the first hit, both in
millimetres from the camera and infinite where nothing is. ``R``, ``G``, ``B`` are a picture to look
at. The header's ``volspec:groups`` holds the groups' shares and ``volspec:basis`` the whole basis
(JSON), so that an image can be relit without the scene that made it, and one of another basis
version is refused; ``volspec:fov_deg`` the camera's vertical field of view, where it has one.

Up to format 2 a channel was called ``key.coefficients.00``, of one group ``coefficients.00``, and
the first hit ``ZFirst``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from volspec._exr import Channels, chromaticities, read_exr, write_exr
from volspec._parse import parse_json
from volspec.appearance.spaces import SPACES
from volspec.basis import basis_from_dict
from volspec.errors import BasisError, ImageError, ShapeError
from volspec.raycast.groups import ONE_GROUP, channel_names, checked_groups, old_channel_names

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

FORMAT = 3
_READ = (1, 2, FORMAT)  # images of format 1 have one light group
# Attributes of the header, after "volspec:".
_OWN = ("format", "basis", "groups", "notes", "fov_deg")
_ALPHA_ERROR = 1e-3  # what a compositor's rounding may add to an opacity


def write_image(
    path: str | os.PathLike[str],
    image: CoefficientImage,
    preview: ArrayLike | None,
    texts: Mapping[str, str],
) -> None:
    """Write an image; as `CoefficientImage.save`."""
    name = os.fspath(path)
    if Path(path).suffix.lower() != ".exr":
        raise ImageError(f"{name}: coefficient images are OpenEXR; name it .exr")
    header: dict[str, Any] = {
        "volspec:format": FORMAT,
        "volspec:basis": json.dumps(image.basis.to_dict()),
        "volspec:groups": json.dumps(image.groups),
        "volspec:notes": json.dumps(dict(image.notes)),
    }
    if image.fov_deg is not None:
        header["volspec:fov_deg"] = json.dumps(float(image.fov_deg))
    if own := [key for key in texts if key in _OWN]:
        raise ImageError(
            f"{name}: a text is named {own[0]!r}, as what the image keeps of its own; name it "
            "otherwise"
        )
    header |= {f"volspec:{key}": text for key, text in texts.items()}
    names = channel_names(image.groups, image.basis.size)
    channels: Channels = {key: image.coefficients[..., k] for k, key in enumerate(names)}
    channels |= {
        key: np.asarray(pixels, np.float32)
        for key, pixels in (("A", image.alpha), ("Z", image.depth_mm), ("first.Z", image.first_mm))
        if pixels is not None
    }
    if preview is not None:
        colours = np.asarray(preview)
        if colours.shape != (*image.alpha.shape, 3):
            raise ShapeError(
                f"{name}: the preview has shape {colours.shape}; expected {image.alpha.shape} and "
                "3 colours"
            )
        # Of one type with A: OpenEXR joins the four, and refuses to where they differ.
        finite = np.nan_to_num(colours.astype(np.float32), nan=0.0)
        channels |= {key: finite[..., k] for k, key in enumerate("RGB")}
        rec709 = SPACES["Rec. 709"]
        header["chromaticities"] = chromaticities(rec709.primaries_xy, rec709.white_xy)
    write_exr(path, header, channels, ImageError)


def read_image(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The fields of `CoefficientImage` in a file; errors are those of `CoefficientImage.load`."""
    name = os.fspath(path)
    missing = f"no such file; `volspec render SCENE -o {name}` makes one"
    header, pixels = read_exr(path, ImageError, missing=missing, again="render the scene again")
    if "volspec:basis" not in header:
        raise ImageError(
            f"{name}: not a coefficient image; `volspec render` makes them, and a spectral "
            "picture needs --basis"
        )
    if (version := header.get("volspec:format")) not in _READ:
        raise ImageError(
            f"{name}: format {version}, this volspec reads {', '.join(map(str, _READ))}; "
            "render the scene again",
            code="damaged",
        )
    try:
        basis = basis_from_dict(parse_json(header["volspec:basis"]))
        notes = dict(parse_json(header.get("volspec:notes", "{}")))
    except (BasisError, ValueError, KeyError, TypeError) as error:
        raise ImageError(
            f"{name}: its basis is refused ({error}); render again", code="damaged"
        ) from error
    try:
        stored = ONE_GROUP if version == 1 else parse_json(header["volspec:groups"])
        groups = checked_groups(stored)
    except (ImageError, ValueError, KeyError, TypeError) as error:
        raise ImageError(
            f"{name}: its light groups are refused ({error}); render again", code="damaged"
        ) from error
    names = channel_names if version == FORMAT else old_channel_names
    coefficients, alpha = _checked_pixels(name, pixels, names(groups, basis.size))
    first = pixels.get("first.Z" if version == FORMAT else "ZFirst")
    try:
        fov_deg = parse_json(header.get("volspec:fov_deg", "null"))
    except (ValueError, TypeError) as error:
        raise ImageError(
            f"{name}: volspec:fov_deg cannot be read ({error})", code="damaged"
        ) from error
    return {
        "coefficients": coefficients,
        "alpha": alpha,
        "depth_mm": pixels["Z"].astype(np.float32),
        "basis": basis,
        "notes": notes,
        "groups": groups,
        "first_mm": None if first is None else first.astype(np.float32),
        "fov_deg": fov_deg,
    }


def _checked_pixels(name: str, pixels: Channels, wanted: list[str]) -> tuple[Any, Any]:
    """(H, W, L·M) coefficients and (H, W) opacity of a file, where it holds what a cast leaves."""
    for key in (*wanted, "A", "Z"):
        if key not in pixels:
            raise ImageError(f"{name}: channel {key!r} is missing; render the scene again")
    coefficients = np.stack([pixels[key] for key in wanted], axis=-1)
    if not (np.isfinite(coefficients).all() and np.isfinite(pixels["A"]).all()):
        raise ImageError(f"{name}: holds NaN or infinite values; render the scene again")
    alpha = pixels["A"].astype(np.float32)
    low, high = float(alpha.min()), float(alpha.max())
    if low < -_ALPHA_ERROR or high > 1 + _ALPHA_ERROR:
        raise ImageError(
            f"{name}: channel 'A' runs from {low:g} to {high:g}; an opacity is 0…1, render "
            "the scene again"
        )
    return coefficients, alpha.clip(0, 1)
