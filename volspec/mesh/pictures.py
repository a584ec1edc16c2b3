"""Image files of textures.

PNG, JPEG, TIFF, BMP -> [pictures] -> texels -> texture
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec._extras import require_extra
from volspec._files import captured_output
from volspec.errors import MeshError

_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def read_picture(path: Path) -> NDArray[Any]:
    """Return an image file's texels (H, W) or (H, W, channels)."""
    require_extra("vtk", str(path))
    import pyvista

    if path.suffix.lower() not in _FORMATS:
        problem, known = f"{path}: not a known format of images", ", ".join(_FORMATS)
        raise MeshError(problem, f"known: {known}", code="unsupported")
    require_inside(path, MeshError)
    if not path.exists():
        raise MeshError(f"{path}: no such file", "check the path", code="not-found")
    _require_whole(path)
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
    return np.asarray(scalars).reshape(height, width, *scalars.shape[1:])[::-1]


def _require_whole(path: Path) -> None:
    """Raise MeshError if a picture ends early; VTK's readers crash then, or say nothing."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large ones, which VTK reads
            with Image.open(path) as image:
                image.load()
    except Image.DecompressionBombError:
        return
    except UnidentifiedImageError as error:
        if path.suffix.lower() not in (".tif", ".tiff"):  # of which VTK reads more
            raise _damage_error(path) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise _damage_error(path) from error


def _damage_error(path: Path) -> MeshError:
    return MeshError(f"{path}: cannot be read", "save it again", code="damaged")
