"""Compare volumes with the libraries of their formats: ``python -m benchmarks.public_files [-v]``.

    files of installed packages -> volspec, and nibabel, pydicom or pyvista -> a table

The files are those that nibabel, pydicom (also of ``pydicom-data``, if installed) and pyvista come
with. A file is read as its library reads it, or refused well: in one line, with a code, and not in
words of Python, where the library gives no volume either. The exit code is 1 below 98 %.
"""

from __future__ import annotations

import argparse
import gzip
import logging
import re
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError
from volspec.volume import Volume, load_volume
from volspec.volume.metadata import ONE_SLICE

MIN = 0.98
# Words of Python, which no message for users has.
_PYTHON = re.compile(
    r"Traceback|NoneType|object has no|\b\w*(Error|Exception)\b|ndarray|0x[0-9a-f]{6}"
)
_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
Expected = tuple[NDArray[np.float64], NDArray[np.float64] | None]
"""Values (Z, Y, X), and world_from_index in LPS (4, 4) or None if the library has none."""


def _folder(module: str, *parts: str) -> Path | None:
    spec = find_spec(module)
    roots = spec.submodule_search_locations if spec else None
    return Path(next(iter(roots)), *parts) if roots else None


def _of_nibabel(path: Path) -> Expected | None:
    """Return the first volume of an image."""
    import nibabel

    image = nibabel.load(path)
    values = np.asarray(image.dataobj)
    if values.dtype.kind not in "buif" or values.ndim < 3:
        return None
    while values.ndim > 3:
        values = values[0] if path.suffix == ".mnc" else values[..., 0]
    oriented = not hasattr(image.header, "get_xyzt_units") or any(
        int(image.header[key]) for key in ("sform_code", "qform_code")
    )
    world = _LPS @ image.affine if oriented and path.suffix not in (".hdr", ".img") else None
    return values.T.astype(np.float64), world


def _of_pydicom(path: Path) -> Expected | None:
    """Return the rescaled pixels of a file of many greyscale frames, but of no segmentation."""
    import pydicom

    dataset = pydicom.dcmread(path, force=True)
    pixels = dataset.pixel_array
    if dataset.SamplesPerPixel != 1 or pixels.ndim != 3 or "SegmentSequence" in dataset:
        return None
    frames = dataset.get("PerFrameFunctionalGroupsSequence") or [dataset] * len(pixels)
    shared = dataset.get("SharedFunctionalGroupsSequence") or [dataset]
    values = np.empty(pixels.shape)
    for frame, value, target in zip(frames, pixels, values, strict=True):
        every = [
            *(frame.get("PixelValueTransformationSequence") or ()),
            *(shared[0].get("PixelValueTransformationSequence") or ()),
            dataset,
        ]
        stated = next((one for one in every if "RescaleSlope" in one), dataset)
        slope = float(stated.get("RescaleSlope", 1)) * float(dataset.get("DoseGridScaling", 1))
        target[...] = value * slope + float(stated.get("RescaleIntercept", 0))
    return values, None


def _of_pyvista(path: Path) -> Expected | None:
    import pyvista

    grid = pyvista.read(path)
    if not isinstance(grid, pyvista.ImageData) or min(grid.dimensions) < 2:
        return None
    values = np.asarray(grid.active_scalars if grid.active_scalars is not None else [])
    if values.ndim != 1 or values.size != grid.n_points:
        return None
    x, y, z = grid.dimensions
    world = np.diag([*grid.spacing, 1.0])
    world[:3, 3] = grid.origin
    return values.reshape(z, y, x).astype(np.float64), world


def _files() -> Iterator[tuple[str, Path, Callable[[Path], Expected | None]]]:
    nibabel, pydicom = _folder("nibabel", "tests", "data"), _folder("pydicom", "data", "test_files")
    for path in sorted(nibabel.iterdir()) if nibabel else ():
        if path.name.lower().endswith((".nii", ".nii.gz", ".hdr", ".mgz", ".par", ".mnc", ".head")):
            yield "nibabel", path, _of_nibabel
    dicom = [pydicom, _folder("data_store", "data"), _folder("nibabel", "nicom", "tests", "data")]
    for folder in filter(None, dicom):
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix in (".dcm", ".gz", ""):
                yield "DICOM", path, _of_pydicom
    for path in sorted((_folder("pyvista", "examples") or Path()).glob("*.vt[ikr]")):
        yield "pyvista", path, _of_pyvista


def _alone(path: Path, folder: Path) -> Path:
    """Copy a file into an empty folder, with what belongs to it; unpacked if DICOM is packed."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for each in path.parent.glob(f"{path.name.partition('.')[0]}.*"):
        shutil.copy(each, folder)
    copy = folder / path.name
    if path.name.endswith(".dcm.gz"):
        copy = folder / path.stem
        copy.write_bytes(gzip.decompress(path.read_bytes()))
        (folder / path.name).unlink()
    return copy


def _loaded(path: Path) -> Volume:
    """Load a volume, the first of several times or channels."""
    for options in ("", "?time=0", "?channel=0", "?time=0&channel=0"):
        try:
            return load_volume(f"{path}{options}")
        except VolspecError as error:
            last = error
            if error.code not in ("missing", "range", "conflict"):
                break
    raise last


def _outcome(path: Path, expect: Callable[[Path], Expected | None]) -> tuple[str, str]:
    """Return the outcome of a file: same, refused, or a fault; and details."""
    try:
        expected = expect(path)
    except Exception:  # whatever a library raises for what it cannot read
        expected = None
    try:
        volume = _loaded(path)
    except VolspecError as error:
        text = str(error).replace(str(path.parent), "")
        good = bool(error.code) and "\n" not in text and not _PYTHON.search(text)
        uniform = expected is not None and np.ptp(expected[0]) == 0
        told = expected is None or uniform or error.code == "shape"
        return ("refused" if good and told else "FAULT"), text
    except Exception as error:
        return "FAULT", repr(error)
    if expected is None:
        return "read", f"{volume.shape_xyz}, its library gives no volume"
    values, world = expected
    if ONE_SLICE in volume.metadata.assumed and 1 in values.shape:  # half a step to both sides
        axis = values.shape.index(1)
        values = np.repeat(values, 2, axis)
        half = np.eye(4)
        half[2 - axis, 3] = -0.5
        world = None if world is None else world @ half
    if values.size != volume.values.size:
        return "FAULT", f"{volume.shape_xyz}, not {values.shape[::-1]}"
    if world is not None and not np.allclose(volume.world_from_index, world, rtol=1e-4, atol=1e-3):
        return "FAULT", f"{volume.world_from_index.tolist()}, not {world.tolist()}"
    own = volume.nan_if_missing(volume.values).astype(np.float64)
    if world is None:  # frames may be in another order
        own, values = np.sort(own, axis=None), np.sort(values, axis=None)
    scale = max(float(np.nanmax(np.abs(values))), 1e-30)
    if not np.allclose(own, values, rtol=1e-5, atol=1e-6 * scale, equal_nan=True):
        return "FAULT", f"values up to {np.nanmax(np.abs(own - values)):g} off"
    return "same", f"{volume.shape_xyz}, {volume.spacing_mm}"


def main() -> int:
    """Print the table; return 1 if too few files are read or refused well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-v", "--verbose", action="store_true", help="print every file")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    counts: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, path, expect in _files():
            outcome, details = _outcome(_alone(path, Path(folder, "alone")), expect)
            counts.setdefault(kind, Counter())[outcome] += 1
            if given.verbose or outcome == "FAULT":
                print(f"{outcome:8} {path.name}: {details[:200]}")
    total: Counter[str] = sum(counts.values(), Counter())
    columns = "same", "read", "refused", "FAULT"
    print(f"{'files of':10}" + "".join(f"{name:>10}" for name in columns))
    for kind, row in {**counts, "all": total}.items():
        print(f"{kind:10}" + "".join(f"{row[name]:>10}" for name in columns))
    share = 1 - total["FAULT"] / max(sum(total.values()), 1)
    print(f"{share:.1%} read as their libraries do, or refused well")
    return int(share < MIN)


if __name__ == "__main__":
    sys.exit(main())
