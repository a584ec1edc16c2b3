"""Image files of textures, with their colour profiles.

PNG, JPEG, TIFF, BMP -> [pictures] -> texels, codes of sRGB or Display P3 -> texture
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec._extras import require_extra
from volspec._files import captured_output
from volspec.appearance.display import (
    D50_XYZ,
    SPACES,
    ColourSpace,
    D50_from_white,
    Transfer,
    space_from_profile,
    sRGB_CURVE,
    to_uint16,
)
from volspec.errors import MeshError, ViewingError

Array = NDArray[np.float64]
P3 = SPACES["Display P3"]
"""Space of texels whose profile is another than sRGB's."""
# Linear light and codes that differ by less count as equal.
_ALIKE = 0.004
_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def read_picture(path: Path) -> tuple[NDArray[Any], dict[Any, Any]]:
    """Return an image file's texels (H, W) or (H, W, channels), and its metadata by Pillow."""
    require_extra("vtk", str(path))
    import pyvista

    if path.suffix.lower() not in _FORMATS:
        problem, formats = f"{path}: not a known format of images", ", ".join(_FORMATS)
        raise MeshError(problem, f"known: {formats}", code="unsupported")
    require_inside(path, MeshError)
    if not path.exists():
        raise MeshError(f"{path}: no such file", "check the path", code="not-found")
    metadata = _read_metadata(path)
    cause: Exception | None = None
    image: Any = None
    with warnings.catch_warnings(), captured_output([]):
        warnings.simplefilter("ignore")
        try:
            # VTK's readers keep 16 bits.
            image = pyvista.read(path)
        except Exception as error:  # of any of VTK's readers
            cause = error
    scalars = None if image is None else image.active_scalars
    if scalars is None or not len(scalars):
        raise _damage_error(path) from cause
    width, height, _ = image.dimensions
    return np.asarray(scalars).reshape(height, width, *scalars.shape[1:])[::-1], metadata


def read_colours(path: Path) -> tuple[NDArray[Any], bool]:
    """Return texels as `read_picture`, and True if they are of `P3`, 16 bits, as profiles say.

    Raises MeshError also if a profile cannot be used.
    """
    texels, metadata = read_picture(path)
    try:
        space = _stated_space(metadata)
        if space is None or texels.dtype.kind != "u":
            return texels, False
        if isinstance(space, bytes):
            return to_uint16(P3.encode(_linear_by_icc(path, space))), True
    except (ViewingError, OSError, ValueError) as error:
        remedy = "convert it to sRGB or Display P3, or save it without a profile"
        raise MeshError(f"{path}: its colour profile is damaged", remedy, code="damaged") from error
    matrix = _p3_from(space)
    codes = np.linspace(0.0, 1.0, 256)
    off = np.abs(space.encode(sRGB_CURVE.decode(codes)) - codes).max()
    if max(off, np.abs(matrix - P3_FROM_sRGB).max()) < _ALIKE:
        return texels, False
    if texels.ndim == 2 or texels.shape[2] == 2:  # grey, with alpha
        texels = texels[..., [0, 0, 0, 1]] if texels.ndim == 3 else np.dstack([texels] * 3)
    white = np.iinfo(texels.dtype).max
    linear = space.decode(np.arange(white + 1) / white)
    converted = to_uint16(texels / white)  # alpha stays
    for row, line in enumerate(texels[..., :3]):
        converted[row, :, :3] = to_uint16(P3.encode(linear[line] @ matrix.T))
    return converted, True


def _p3_from(space: ColourSpace) -> Array:
    """Return (3, 3): linear RGB of a space to that of `P3`, by Bradford."""
    adapted = D50_from_white(space.white_XYZ / 100.0) @ space.XYZ_from_RGB
    return np.asarray(P3.RGB_from_XYZ @ np.linalg.solve(_D50_FROM_P3, adapted))


_D50_FROM_P3 = D50_from_white(P3.white_XYZ / 100.0)
P3_FROM_sRGB = _p3_from(SPACES["sRGB"])
"""(3, 3): linear sRGB to linear RGB of `P3`."""


def _stated_space(info: dict[Any, Any]) -> ColourSpace | bytes | None:
    """Return the space of a picture's metadata, or an ICC profile with tables; None for sRGB."""
    if profile := info.get("icc_profile"):
        try:
            return space_from_profile(profile, "ICC", "")
        except ViewingError:
            return bytes(profile)
    if "srgb" in info or not {"gamma", "chromaticity"} & {*info}:
        return None
    gamma, space = info.get("gamma", 1 / 2.2), SPACES["sRGB"]
    # 1 / 2.2 is sRGB's curve, as in browsers.
    curve = sRGB_CURVE if abs(gamma - 1 / 2.2) < 1e-3 else Transfer(gamma)
    default = (*space.white_xy, *(xy for pair in space.primaries_xy for xy in pair))
    wx, wy, rx, ry, gx, gy, bx, by = info.get("chromaticity", default)
    return ColourSpace("cHRM", ((rx, ry), (gx, gy), (bx, by)), (wx, wy), curve)


def _linear_by_icc(path: Path, profile: bytes) -> Array:
    """Return linear light of `P3` by a profile of any kind, in steps of 8-bit CIELAB."""
    from PIL import Image, ImageCms

    source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    mode = {"GRAY": "L", "CMYK": "CMYK"}.get(source.profile.xcolor_space.strip(), "RGB")
    out, intent = ImageCms.createProfile("LAB"), ImageCms.Intent.RELATIVE_COLORIMETRIC
    with Image.open(path) as image:
        try:
            lab = ImageCms.profileToProfile(image.convert(mode), source, out, intent, "LAB")
        except ImageCms.PyCMSError as error:
            raise ValueError from error
    L, a, b = np.moveaxis(np.asarray(lab), -1, 0)
    y = (L / 2.55 + 16.0) / 116.0
    f = np.stack([y + a.view(np.int8) / 500.0, y, y - b.view(np.int8) / 200.0], axis=-1)
    XYZ = D50_XYZ * np.where(f > 6 / 29, f**3, 108 / 841 * (f - 4 / 29))
    matrix = 100.0 * P3.RGB_from_XYZ @ np.linalg.inv(_D50_FROM_P3)
    return np.asarray(np.clip(XYZ @ matrix.T, 0.0, 1.0))


def _read_metadata(path: Path) -> dict[Any, Any]:
    """Return what Pillow knows of a picture; raise MeshError if it ends early, as VTK may crash."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large ones, which VTK reads
            with Image.open(path) as image:
                image.load()
                return image.info
    except Image.DecompressionBombError:
        pass
    except UnidentifiedImageError as error:
        if path.suffix.lower() not in (".tif", ".tiff"):  # of which VTK reads more
            raise _damage_error(path) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise _damage_error(path) from error
    return {}


def _damage_error(path: Path) -> MeshError:
    return MeshError(f"{path}: cannot be read", "save it again", code="damaged")
