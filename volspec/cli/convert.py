"""``volspec convert``: write a volume so that parts of it can be read, at several levels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from volspec.cli.shell import app, bar, say
from volspec.errors import InputError


@app.command
def convert(volume: str, /, *, output: Annotated[Path, Parameter(name=["--output", "-o"])]) -> None:
    """Convert a volume to a multiscale OME-Zarr, of which casts read what they show.

    Voxels are read and written block by block, in little memory. A conversion that was cut off goes
    on where it ended when the command is repeated.

    Example: `volspec convert 'scan.raw?shape=2048x2048x1024&dtype=uint8' -o scan.zarr`

    Example: `volspec convert head.nii.gz -o head.ome.zarr`

    Parameters
    ----------
    volume
        A volume file or folder, as for `volspec info`; of several channels one, as
        `FILE?channel=0`.
    output
        The folder to write; its name ends in .zarr.
    """
    from volspec._files import require_suffix
    from volspec.volume.convert import convert as write
    from volspec.volume.load import open_level

    require_suffix(output, "OME-Zarrs", ".zarr", error=InputError)
    with bar() as tell:
        level, name, labels = open_level(volume)
        write(
            level,
            output,
            name=name,
            labels=labels or None,
            progress=lambda share: tell("convert", share),
        )
    x, y, z = level.shape[::-1]
    say(f"{output}: {x}×{y}×{z} {level.dtype}")
