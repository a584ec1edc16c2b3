"""Read volumes from files; spacing and orientation kept.

NRRD, MetaImage and NIfTI come through SimpleITK, VTK files through pyvista, ``.npy`` through
NumPy, raw bytes by what the file name says after a question mark. World coordinates are
millimetres in ITK's patient frame (LPS) where the format states one. Why SimpleITK and not
VTK's readers for the medical formats: docs/decisions/0001.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np

from volspec._files import captured_output
from volspec.errors import VolspecWarning, VolumeError, quoted
from volspec.volume.adapt import read_vtk_image
from volspec.volume.headers import check_itk_header, warn_if_longer
from volspec.volume.model import Volume

_ITK_SUFFIXES = (".nrrd", ".nhdr", ".mhd", ".mha", ".nii", ".nii.gz")
_VTK_SUFFIXES = (".vti", ".vtk")
_KNOWN = "NRRD, MHD/MHA, NIfTI, VTI/VTK, .npy, or FILE.raw?shape=256x256x110&dtype=uint8"


def load_volume(path: str | os.PathLike[str]) -> Volume:
    """Read a volume from a file.

    Parameters
    ----------
    path : str or path
        ``.nrrd .nhdr .mhd .mha .nii .nii.gz .vti .vtk .npy``, or raw bytes as
        ``FILE.raw?shape=XxYxZ&dtype=uint8&spacing=1,1,1`` (also ``&offset=`` bytes and
        ``&order=big``).

    Raises
    ------
    VolumeError
        If the file is missing, truncated, of unknown format, not 3-D, constant, or its
        spacing is not positive.
    """
    if not isinstance(path, str | os.PathLike):
        raise VolumeError(f"volume: {quoted(path)} is no path; give text or a pathlib.Path")
    text = os.fspath(path)
    file, _, query = text.partition("?")
    target = Path(file)
    if not target.exists():
        raise VolumeError(f"{file}: no such file; check the path")
    if target.is_dir():
        raise VolumeError(
            f"{file}: is a folder; give a file, slices must be made one first ({_KNOWN})"
        )
    if target.stat().st_size == 0:
        raise VolumeError(f"{file}: the file is empty; copy or download it again")
    lower = target.name.lower()
    if lower.endswith((*_ITK_SUFFIXES, *_VTK_SUFFIXES, ".npy")) and query:
        raise VolumeError(f"{file}: ?{query} is for raw bytes; this format states its own layout")
    if lower.endswith(".raw") or query:
        volume = _load_raw(target, query)
    elif lower.endswith(".npy"):
        volume = _load_npy(target)
    elif lower.endswith(_ITK_SUFFIXES):
        volume = _load_with_itk(target)
    elif lower.endswith(_VTK_SUFFIXES):
        volume = read_vtk_image(target)
    else:
        raise VolumeError(f"{file}: unknown format; known are {_KNOWN}")
    low, high = volume.range
    if low == high:
        raise VolumeError(
            f"{file}: every voxel is {low:g}, there is nothing to show; was the right file "
            "or channel given?"
        )
    return volume


def _load_npy(path: Path) -> Volume:
    try:
        values = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise VolumeError(
            f"{path}: not a readable .npy file of numbers; is it complete, and saved by numpy.save?"
        ) from error
    return Volume(values, name=str(path))


def _load_raw(path: Path, query: str) -> Volume:
    options = dict(parse_qsl(query))
    unknown = sorted(set(options) - {"shape", "dtype", "spacing", "offset", "order"})
    if unknown:
        raise VolumeError(
            f"{path}: unknown option {unknown[0]!r}; known are shape, dtype, spacing, offset, order"
        )
    if missing := [key for key in ("shape", "dtype") if key not in options]:
        raise VolumeError(
            f"{path}: raw bytes need their layout, {missing[0]} is missing; write "
            f"{path.name}?shape=256x256x110&dtype=uint8&spacing=1,1,1"
        )
    try:
        key = "shape"
        shape = tuple(int(n) for n in options["shape"].lower().split("x"))
        key = "dtype"
        dtype = np.dtype(options["dtype"])
        if dtype.kind not in "buif":
            raise TypeError
        key = "spacing"
        spacing = tuple(float(s) for s in options.get("spacing", "1,1,1").split(","))
        key = "offset"
        offset = int(options.get("offset", "0"))
    except (ValueError, TypeError) as error:
        raise VolumeError(
            f"{path}: {key}={options[key]} cannot be read; write it as in "
            f"{path.name}?shape=256x256x110&dtype=uint8&spacing=1,1,1"
        ) from error
    if options.get("order", "little") not in ("little", "big"):
        raise VolumeError(f"{path}: order={options['order']}; give little or big")
    if options.get("order") == "big":
        dtype = dtype.newbyteorder(">")
    if len(shape) != 3 or min(shape) < 1:
        raise VolumeError(f"{path}: shape {options['shape']} is not XxYxZ with positive counts")
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    held = path.stat().st_size - offset
    if offset < 0 or held < expected:
        raise VolumeError(
            f"{path}: holds {max(held, 0)} bytes after the offset, but shape {options['shape']} "
            f"of {dtype} needs {expected}; truncated, or is the shape wrong?"
        )
    if held > expected:
        warnings.warn(
            f"{path}: holds {held} bytes, shape {options['shape']} of {dtype} takes {expected} of "
            "them; are shape, dtype and offset right?",
            VolspecWarning,
            stacklevel=3,
        )
    flat = np.fromfile(path, dtype, count=int(np.prod(shape)), offset=offset)
    return Volume(flat.reshape(shape[::-1]), spacing_mm=spacing, name=str(path))  # type: ignore[arg-type]


def _load_with_itk(path: Path) -> Volume:
    import SimpleITK as sitk

    check_itk_header(path)
    said: list[str] = []
    try:
        with captured_output(said):
            image = sitk.ReadImage(os.fspath(path))
    except RuntimeError as error:
        lines = [line.strip() for line in [*str(error).splitlines(), *said] if line.strip()]
        # The innermost complaint comes last: "expected 7208960 bytes but received 416449".
        raise VolumeError(
            f"{path}: cannot be read ({lines[-1]}); is the file complete and of the type its "
            "name says?"
        ) from error
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        size = "x".join(str(n) for n in image.GetSize())
        raise VolumeError(
            f"{path}: is {image.GetDimension()}-D ({size}) with "
            f"{image.GetNumberOfComponentsPerPixel()} components a voxel; a volume is 3-D with "
            "one. Choose one channel or time step"
        )
    values = sitk.GetArrayFromImage(image)
    warn_if_longer(path, values.nbytes)
    world = np.eye(4)
    spacing = np.array(image.GetSpacing())
    world[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * spacing
    world[:3, 3] = image.GetOrigin()
    return Volume(
        values,
        spacing_mm=tuple(spacing),
        world_from_index=world,
        name=str(path),
    )
