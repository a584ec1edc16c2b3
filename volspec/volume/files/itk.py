"""Single files through SimpleITK: NRRD, MetaImage, NIfTI.

load_volume -> [itk] -> Reading
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.headers import check_itk_header
from volspec.volume.files.lattice import affine
from volspec.volume.files.layout import NIFTI_SUFFIXES, Layout
from volspec.volume.files.query import Query, Reading


def read_itk(query: Query) -> Reading:
    """Read an image of three dimensions with one value a voxel.

    Raises
    ------
    VolumeError
    """
    import SimpleITK as sitk

    path = query.path
    if not path.name.lower().endswith(NIFTI_SUFFIXES):
        check_itk_header(path)
    layout = Layout.of(path)
    said: list[str] = []
    image: Any = sitk.ImageFileReader()
    image.SetFileName(os.fspath(path))
    try:
        with captured_output(said):
            image.ReadImageInformation()
            size, dtype = image.GetSize(), _scalar_type(path, image)
            nbytes = math.prod(size) * dtype.itemsize
            query.reserve(size, dtype.itemsize)
            held = None
            if layout is not None and layout.holds(dtype):
                values, held = layout.voxels(size, dtype)
                query.require_held(held, size, nbytes)
            else:
                lost = layout.non_finite(size, query) if layout is not None else []
                image = image.Execute()
                values = sitk.GetArrayViewFromImage(image)
                if lost:
                    values = values.copy()
                for each in lost:
                    each.put_back(values.reshape(-1))
    except RuntimeError as error:
        raise VolumeError(
            f"{path}: cannot be read ({complaint(error, said)}); is the file complete and of the "
            "type its name says?",
            code="damaged",
        ) from error
    spacing = np.array(image.GetSpacing())
    directions = np.array(image.GetDirection()).reshape(3, 3)
    return Reading(
        values,
        spacing_mm=tuple(spacing.tolist()),
        world_from_index=affine(directions * spacing, image.GetOrigin()),
        remarks=query.surplus(held, nbytes),
        owner=image,
    )


def _scalar_type(path: Path, reader: Any) -> np.dtype[Any]:
    """Return the type of a voxel; refuse what is not 3-D with one value a voxel."""
    import SimpleITK as sitk

    size, components = reader.GetSize(), reader.GetNumberOfComponents()
    if len(size) != 3 or components != 1:
        raise VolumeError(
            f"{path}: is {len(size)}-D ({'x'.join(map(str, size))}) with {components} components a "
            "voxel; a volume is 3-D with one. Choose one channel or time step"
        )
    dtype: np.dtype[Any] = sitk.GetArrayFromImage(sitk.Image([1, 1, 1], reader.GetPixelID())).dtype
    return dtype


def complaint(error: RuntimeError, said: list[str]) -> str:
    """ITK's innermost one, which comes last: "expected 7208960 bytes but received 416449"."""
    lines = [line.strip() for line in [*str(error).splitlines(), *said] if line.strip()]
    return lines[-1]
