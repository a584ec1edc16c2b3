"""One phantom with letters on its sides, in every format and orientation, seen from three sides.

``python -m tools.phantom_sheet`` writes it in each format, runs ``volspec render --camera SIDE`` on
every file, and joins the pictures in docs/images/orientations.png.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

OUTPUT = Path(__file__).resolve().parents[1] / "docs/images/orientations.png"
SPACING = 1.0, 1.25, 1.5
_SIZE, _BODY, _LETTER = (48, 40, 34), 60, 200
_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
SIDES = ("left", "anterior", "superior")
Array = NDArray[Any]
Oriented = tuple[Array, Array]
"""Values (Z, Y, X), and world_from_index (4, 4) in LPS."""


def _letter(text: str, width: int, height: int) -> NDArray[np.bool_]:
    """Return a letter as a mask (height, width), row 0 on top."""
    image = Image.new("L", (width, height))
    font = ImageFont.load_default(size=height * 0.8)
    ImageDraw.Draw(image).text((width / 2, height / 2), text, 255, font, anchor="mm")
    return np.asarray(image) > 127


def phantom() -> Oriented:
    """Return a block with a letter on each side, along LPS: L, R, A, P, S, I."""
    x, y, z = _SIZE
    values = np.zeros((z, y, x), np.uint8)
    values[4:-4, 4:-4, 4:-4] = _BODY
    side, front, top = _letter("L", y, z), _letter("A", x, z), _letter("S", x, y)
    # Rows of pictures run down: to the feet, or to the back seen from above.
    values[:, :, -4:-1][side[::-1]] = _LETTER
    values[:, :, 1:4][_letter("R", y, z)[::-1, ::-1]] = _LETTER
    for k in (1, 2, 3):
        values[:, k, :][front[::-1]] = _LETTER
        values[:, -1 - k, :][_letter("P", x, z)[::-1, ::-1]] = _LETTER
        values[-1 - k][top[::-1]] = _LETTER
        values[k][_letter("I", x, y)] = _LETTER
    world = np.diag([*SPACING, 1.0])
    world[:3, 3] = -20.0, 15.0, 40.0
    return values, world


def reoriented(one: Oriented, order: tuple[int, ...], flips: tuple[bool, ...]) -> Oriented:
    """Return the same voxels with their axes, x y z, in another order, and some reversed."""
    values, world = one
    values = values.transpose([2 - order[2 - k] for k in range(3)])
    index = np.zeros((4, 4))
    index[3, 3] = 1.0
    for new, (old, flip) in enumerate(zip(order, flips, strict=True)):
        index[old, new] = -1.0 if flip else 1.0
        if flip:
            values = np.flip(values, 2 - new)
            index[old, 3] = values.shape[2 - new] - 1
    return np.ascontiguousarray(values), world @ index


ORDERS, FLIPS = itertools.permutations(range(3)), itertools.product((False, True), repeat=3)
ORIENTATIONS = [*itertools.product(ORDERS, FLIPS)]
"""All 48 orders and directions of three axes."""


def _nrrd(path: Path, values: Array, world: Array, space: str = "left-posterior-superior") -> None:
    signs = {"right-anterior-superior": (-1, -1, 1), "LAS": (1, -1, 1)}.get(space, (1, 1, 1))
    map_ = np.diag([*signs, 1.0]) @ world
    vectors = " ".join("(" + ",".join(f"{v:g}" for v in map_[:3, k]) + ")" for k in range(3))
    origin = ",".join(f"{v:g}" for v in map_[:3, 3])
    sizes = " ".join(map(str, values.shape[::-1]))
    head = (
        f"NRRD0005\ntype: uint8\ndimension: 3\nspace: {space}\nsizes: {sizes}\n"
        f"space directions: {vectors}\nspace origin: ({origin})\nencoding: raw\n\n"
    )
    path.write_bytes(head.encode() + values.tobytes())


def _meta(path: Path, values: Array, world: Array) -> None:
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(values)
    spacing = np.linalg.norm(world[:3, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetOrigin(world[:3, 3].tolist())
    image.SetDirection((world[:3, :3] / spacing).ravel().tolist())
    sitk.WriteImage(image, str(path))


def _nifti(path: Path, values: Array, world: Array, codes: tuple[int, int] = (1, 0)) -> None:
    import nibabel

    image = nibabel.Nifti1Image(values.T, _LPS @ world)
    image.set_sform(_LPS @ world, codes[0])
    image.set_qform(_LPS @ world, codes[1])
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)


def _mgh(path: Path, values: Array, world: Array) -> None:
    import nibabel

    nibabel.save(nibabel.MGHImage(values.T, _LPS @ world), path)


def _mif(path: Path, values: Array, world: Array) -> None:
    ras = _LPS @ world
    spacing = np.linalg.norm(ras[:3, :3], axis=0)
    rows = "".join(
        "transform: " + ",".join(f"{v:g}" for v in (*(ras[k, :3] / spacing), ras[k, 3])) + "\n"
        for k in range(3)
    )
    head = (
        f"mrtrix image\ndim: {','.join(map(str, values.shape[::-1]))}\n"
        f"vox: {','.join(f'{v:g}' for v in spacing)}\nlayout: +0,+1,+2\ndatatype: UInt8\n{rows}"
        "file: . 512\nEND\n"
    )
    path.write_bytes(head.encode().ljust(512, b"\0") + values.tobytes())


def _dicom(path: Path, values: Array, world: Array) -> None:
    """Write a folder of slices along the voxels' z."""
    import pydicom
    from pydicom.dataset import FileMetaDataset

    path.mkdir()
    spacing = np.linalg.norm(world[:3, :3], axis=0)
    directions = world[:3, :3] / spacing
    series = pydicom.uid.generate_uid()
    for k, plane in enumerate(values):
        one = pydicom.Dataset()
        one.file_meta = FileMetaDataset()
        one.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
        one.SOPClassUID = pydicom.uid.MRImageStorage
        one.SOPInstanceUID = pydicom.uid.generate_uid()
        one.Modality, one.SeriesInstanceUID, one.InstanceNumber = "MR", series, k + 1
        one.ImagePositionPatient = [round(v, 6) for v in (world @ (0, 0, k, 1))[:3].tolist()]
        one.ImageOrientationPatient = directions[:, :2].T.ravel().round(6).tolist()
        one.PixelSpacing = [float(spacing[1]), float(spacing[0])]
        one.Rows, one.Columns = plane.shape
        one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
        one.BitsAllocated = one.BitsStored = 8
        one.HighBit, one.PixelRepresentation = 7, 0
        one.PixelData = plane.tobytes()
        one.save_as(path / f"s{k:02d}.dcm", enforce_file_format=True)


Write = Callable[[Path, Array, Array], None]
WRITERS: dict[str, tuple[str, Write]] = {
    "NRRD, LPS": ("lps.nrrd", _nrrd),
    "NRRD, RAS": ("ras.nrrd", lambda p, v, w: _nrrd(p, v, w, "right-anterior-superior")),
    "NRRD, LAS": ("las.nrrd", lambda p, v, w: _nrrd(p, v, w, "LAS")),
    "MetaImage": ("v.mha", _meta),
    "NIfTI, sform": ("s.nii.gz", _nifti),
    "NIfTI, qform": ("q.nii", lambda p, v, w: _nifti(p, v, w, (0, 1))),
    "NIfTI, pair": ("pair.img", _nifti),
    "FreeSurfer": ("v.mgz", _mgh),
    "MRtrix": ("v.mif", _mif),
    "DICOM": ("slices", _dicom),
}
"""Formats that state a patient's axes: a file's name, and what writes it."""
# Of each format an orientation of its own, by its number among `ORIENTATIONS`.
_SHOWN = (0, 9, 18, 23, 28, 33, 38, 43, 14, 21)


def main() -> None:
    """Write the phantom, render it by the command line, and join the pictures."""
    width, label = 150, 110
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for (title, (name, write)), number in zip(WRITERS.items(), _SHOWN, strict=True):
            path = Path(folder, name)
            values, world = reoriented(phantom(), *ORIENTATIONS[number])
            write(path, values, world)
            row = Image.new("RGB", (label + len(SIDES) * width, width), "white")
            letters = "".join(
                "RLAPIS"[2 * int(np.abs(c).argmax()) + int(c[np.abs(c).argmax()] > 0)]
                for c in world[:3, :3].T
            )
            ImageDraw.Draw(row).text((8, width / 2 - 16), f"{title}\nvoxels: {letters}", "black")
            for k, side in enumerate(SIDES):
                picture = Path(folder, f"{side}.png")
                command = [sys.executable, "-m", "volspec", "render", str(path), "-o", str(picture)]
                more = ["--camera", side, "--size", f"{width}x{width}", "--preset", "soft-hard"]
                subprocess.run([*command, *more], check=True, capture_output=True)
                row.paste(Image.open(picture).convert("RGB"), (label + k * width, 0))
            rows.append(row)
    half = -(-len(rows) // 2)
    sheet = Image.new("RGB", (2 * rows[0].width, half * width), "white")
    for k, row in enumerate(rows):
        sheet.paste(row, (k // half * row.width, k % half * width))
    sheet.quantize(128).save(OUTPUT)


if __name__ == "__main__":
    main()
