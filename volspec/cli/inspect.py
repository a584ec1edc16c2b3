"""``volspec doctor``, ``info``, ``convert`` and ``scene``: devices and files before a cast."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import RELIGHT, Lights, require_scene
from volspec.cli.inputs import CameraOption, Preset, open_scene
from volspec.cli.shell import Json, Terminal, app, bar, count_of, print_json, say
from volspec.errors import InputError, SceneError, one_line

if TYPE_CHECKING:
    from volspec.export import CheckedExport


@app.command
def doctor(*, json: Json = False) -> None:
    """List OpenCL and GL devices, versions, the device for casts, and missing parts.

    Example: `volspec doctor`
    """
    from volspec.doctor import examine

    report = examine()
    if json:
        print_json(report.to_dict())
    else:
        report.print(Terminal(markup=True))
    if not report.healthy:
        raise SystemExit(1)


@app.command
def info(volume: str, /, *, json: Json = False) -> None:
    """Print size, spacing, orientation, range and histogram of a volume, and labels with names.

    Example: `volspec info engine.nrrd`

    Example: `volspec info 'patient?series=3'`

    Parameters
    ----------
    volume
        A volume file (NRRD, MHD/MHA, NIfTI, VTI/VTK, `.npy`, TIFF …), a folder (slices of DICOM,
        TIFF, PNG, BMP or JPEG; OME-Zarr), or
        `FILE.raw?shape=256x256x110&dtype=uint8&spacing=1,1,1`. Details follow a question mark:
        `FOLDER?series=3`, `FILE.tif?spacing=0.65,0.65,2`,
        `channel=`, `time=`, `level=`; `labels=FILE` names a table of a segmentation's labels,
        `unit=HU` the unit of values that the file leaves out, `scale=log` takes their logarithms.
    """
    from volspec.volume import open_volume, summarise

    path = Path(volume)
    require_scene(path, f"give a volume, or {RELIGHT}", "a volume")
    if path.suffix.lower() == ".toml":
        check = f"volspec scene check {shlex.quote(volume)}"
        raise InputError(f"{volume}: is a scene; give the volume of its [volume], or run {check}")
    loaded, series = open_volume(volume)
    summary = summarise(loaded, 1 if series is None else len(series))
    if json:
        print_json(summary.to_dict())
    else:
        Terminal().print(summary.table())


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
    from volspec.large import convert as write
    from volspec.volume import open_level
    from volspec.volume.files import ZIP_SUFFIXES

    if output.name.lower().endswith(ZIP_SUFFIXES):
        folder = output.with_name(f"{output.name.partition('.')[0]}.zarr")
        inside, packed = shlex.quote(str(folder)), shlex.quote(f"../{output.name}")
        raise InputError(
            f"{output}: a folder is written, which can then be packed",
            f"give -o {folder}, then: (cd {inside} && zip -0 -r {packed} .)",
            code="unsupported",
        )
    require_suffix(output, "OME-Zarrs", ".zarr", error=InputError)
    with bar() as tell:
        level, name, labels, metadata = open_level(volume)
        write(
            level,
            output,
            name=name,
            labels=labels or None,
            metadata=metadata,
            progress=lambda fraction: tell("convert", fraction),
        )
    x, y, z = level.shape[::-1]
    say(f"{output}: {x}×{y}×{z} {level.dtype}")


scene = App(
    name="scene", help="Make a scene file for a volume, check scene files, print their JSON schema."
)
app.command(scene)


@scene.command
def check(files: list[Path], /, *, json: Json = False) -> None:
    """Read scenes and look up everything that they name, without a cast.

    Prints a line for each valid file, and for each error a line with file, field, value and
    remedy. The exit code is 1 if there are errors.

    Example: `volspec scene check engine.toml`

    Parameters
    ----------
    files
        Scene files.
    """
    from volspec.export import check_scene

    reports = [check_scene(file) for file in files]
    if json:
        print_json([report.to_dict() for report in reports])
    else:
        for report in reports:
            for line in report.errors or (_line(report),):
                say(one_line(line))
    if any(report.errors for report in reports):
        raise SystemExit(1)


@scene.command
def new(
    volume: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    preset: Preset = None,
    light: Lights = None,
    camera: CameraOption = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Write a scene file for a volume or a mesh, as the viewer opens it, to edit and to export.

    Example: `volspec scene new head.nii.gz -o head.toml --preset bone`

    Parameters
    ----------
    volume
        A volume (file or folder, as for `volspec info`) or a mesh.
    output
        The scene file to write; it refers to the volume by a relative path.
    light
        A light such as D65 or planck:3200, instead of the default ones; repeatable.
    overwrite
        Replace an existing file.
    """
    require_suffix(output, "scenes", ".toml", error=SceneError)
    require_writable(output)
    if Path(volume).suffix.lower() == ".toml":
        raise InputError(f"{volume}: is a scene already; give a volume", code="type")
    if output.exists() and not overwrite:
        raise InputError(
            f"{output}: exists; give another name, or add --overwrite", code="conflict"
        )
    new_scene, _ = open_scene(volume, preset, light, camera)
    say(f"{new_scene.save(output)}: now try volspec view {shlex.quote(str(output))}")


@scene.command
def schema() -> None:
    """Print the JSON schema of scene files, for TOML editors.

    Example: `volspec scene schema > scene.schema.json`
    """
    from volspec.scene import scene_schema_text

    print(scene_schema_text(), end="")


def _line(checked: CheckedExport) -> str:
    volume = f"volume {' × '.join(map(str, checked.volume))}, " if checked.volume else ""
    room = ""
    if checked.room_error is not None:
        room = f", the room's light on it within {100 * checked.room_error:.2g} %"
    return (
        f"{checked.path}: ok: {count_of(checked.materials, 'material')}, "
        f"{count_of(checked.lights, 'light')}, {volume}basis {checked.basis} "
        f"({checked.reason}){room}"
    )
