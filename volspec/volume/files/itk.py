"""Single files through SimpleITK: NRRD, MetaImage, NIfTI.

load_volume -> [itk] -> Volume
"""

from __future__ import annotations

import os

import numpy as np

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query
from volspec.volume.headers import check_itk_header, warn_if_longer
from volspec.volume.model import Volume


def read_itk(query: Query) -> Volume:
    """Read an image of three dimensions with one value a voxel.

    Raises
    ------
    VolumeError
    """
    import SimpleITK as sitk

    path = query.path
    check_itk_header(path)
    said: list[str] = []
    try:
        with captured_output(said):
            image = sitk.ReadImage(os.fspath(path))
    except RuntimeError as error:
        raise VolumeError(
            f"{path}: cannot be read ({complaint(error, said)}); is the file complete and of the "
            "type its name says?"
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
    spacing = np.array(image.GetSpacing())
    directions = np.array(image.GetDirection()).reshape(3, 3)
    return Volume(
        values,
        spacing_mm=tuple(spacing),
        world_from_index=affine(directions * spacing, image.GetOrigin()),
        name=str(path),
    )


def complaint(error: RuntimeError, said: list[str]) -> str:
    """ITK's innermost one, which comes last: "expected 7208960 bytes but received 416449"."""
    lines = [line.strip() for line in [*str(error).splitlines(), *said] if line.strip()]
    return lines[-1]
