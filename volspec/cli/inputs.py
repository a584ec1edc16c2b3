"""Scenes and volumes that a command works on, one or many.

arguments -> [inputs] -> Scene, Volume | None; Job, Job, …
"""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from volspec._files import plain_stem, require_suffix, require_writable
from volspec.cli.arguments import RELIGHT, require_scene
from volspec.cli.options import Options
from volspec.cli.shell import INCOMPLETE, bar, count_of, note_everyday, print_json, say
from volspec.cli.viewing import in_options
from volspec.errors import InputError, VolspecError, one_line
from volspec.raycast import RaycastSpec

if TYPE_CHECKING:
    from volspec.camera import Orbit
    from volspec.scene import Scene
    from volspec.volume import Volume

Inputs = Annotated[
    list[str],
    Parameter(
        name="INPUT",
        negative="",
        help="A scene file, a volume (file or folder, as for `volspec info`) or a mesh. Several, a "
        "folder of them or a pattern such as 'scans/*.nii.gz' are a batch.",
    ),
]
Preset = Annotated[
    str | None,
    Parameter(help="For a volume: its transfer function, such as bone, skin or mr-head."),
]
CameraOption = Annotated[
    str | None,
    Parameter(
        name="--camera",
        allow_leading_hyphen=True,
        help="Side (front, back, left, right, top, bottom, isometric), or AZIMUTH,ELEVATION in "
        "degrees. If the volume states a patient's axes, left and right are theirs, and anterior, "
        "posterior, superior and inferior are sides, too.",
    ),
]
Memory = Annotated[
    str | None,
    Parameter(
        help="Most memory for voxels, such as 2GiB: of a larger volume (OME-Zarr, uncompressed "
        "files), only what a picture shows is read."
    ),
]
# Endings of a single output.
_FILES = (".exr", ".html", ".htm", ".png", ".mp4", ".webm", ".gif")
_NAME = "{name}"


def open_scene(
    address: str,
    preset: str | None = None,
    lights: Sequence[str] | None = None,
    camera: str | None = None,
    *,
    image: str = RELIGHT,
    memory: str | None = None,
) -> tuple[Scene, Volume | None]:
    """Load a scene file, or make a scene for a volume, whose voxels are returned, too.

    ``lights`` are for a volume, instead of the default ones; ``image`` is the remedy for a
    coefficient image; ``memory`` is the most that voxels may take. Raises VolspecError if the file
    cannot be read, or has no use for an option.
    """
    from volspec._triangles import is_mesh_file
    from volspec.scene import Scene
    from volspec.spectra import DEFAULT_GRID, light
    from volspec.volume import Volume, open_volume

    require_scene(Path(address), image)
    view = None if camera is None else _camera(camera)
    if is_mesh_file(Path(address)):
        if preset is not None:
            problem = f"--preset {preset}: {address} is a mesh, without values"
            raise InputError(f"{problem}; leave out --preset", code="conflict")
        orbit = None if view is None else _orbit(view, lambda: Volume.empty((0, 0, 0), (1, 1, 1)))
        scene = Scene.from_mesh(address, lights=lights or (), camera=orbit)
        return scene, scene.volume()
    if Path(address).suffix.lower() != ".toml":
        for text in lights or ():
            light(text, DEFAULT_GRID)  # refused before the volume is read
            note_everyday(text)
        address = memory_address(address, memory)
        volume, series = open_volume(address)
        orbit = None if view is None else _orbit(view, lambda: volume)
        with in_options({"preset": "--preset"}):
            scene = Scene.from_volume(
                address,
                preset=preset,
                lights=lights or (),
                camera=orbit,
                volume=volume,
                series=series,
            )
        return scene, volume
    scene = with_memory(Scene.load(address), memory)
    if preset is not None:
        raise InputError(
            f"--preset {preset}: {address} is a scene with a [transfer] of its own; leave out "
            "--preset, or give its volume",
            code="conflict",
        )
    if view is not None:
        orbit = _orbit(view, scene.volume)
        turned = replace(
            scene.file.camera,
            azimuth_deg=orbit.azimuth_deg,
            elevation_deg=orbit.elevation_deg,
            roll_deg=0.0,
            position_mm=None,
        )
        scene = scene.with_camera(turned)
    return scene, None


def with_memory(scene: Scene, memory: str | None) -> Scene:
    """Return a scene whose volume takes up to an amount of memory, if one is given."""
    if memory is None:
        return scene
    table = scene.file.volume
    volume = replace(table, file=memory_address(table.file, memory))
    return type(scene)(replace(scene.file, volume=volume), scene.path)


def memory_address(address: str, memory: str | None) -> str:
    """Return a volume's address with an amount of memory, if one is given, instead of its own.

    >>> memory_address("v.raw?dtype=uint8", "1GiB"), memory_address("v.zarr", None)
    ('v.raw?dtype=uint8&memory=1GiB', 'v.zarr')
    >>> memory_address("v.zarr?memory=2GiB&time=0", "1GiB")
    'v.zarr?time=0&memory=1GiB'
    """
    if memory is None:
        return address
    from volspec.volume.files import bytes_of

    bytes_of(memory, address)
    path, _, query = address.partition("?")
    options = [option for option in query.split("&") if option and not option.startswith("memory=")]
    return f"{path}?{'&'.join([*options, f'memory={memory}'])}"


class CastOptions(Options, group=Group("Cast", sort_key=2), of={RaycastSpec: ("quality",)}):
    """Settings of a cast, instead of the scene's."""

    def onto(self, scene: Scene) -> Scene:
        """Return a scene that is cast with the options; a quality replaces the scene's step.

        Raises InputError if one is out of range.
        """
        settings = self.given()
        if "quality" in settings:
            settings |= {"step_mm": None, "alpha_stop": None}
        with in_options(self.names):
            return scene.casting(**settings) if settings else scene


class LayerOptions(CastOptions, group=Group("Cast", sort_key=2), of={RaycastSpec: ("layers",)}):
    """Settings of a cast whose layers of opacity are kept."""


CAST, LAYERED = CastOptions(), LayerOptions()
"""No options, as defaults of commands."""


def _camera(camera: str) -> str | Orbit:
    """Return the name of a side, or the orbit of azimuth and elevation."""
    from volspec.camera import OF_PATIENT, SIDES, Orbit

    if camera.lower() in (*SIDES, *OF_PATIENT):
        return camera.lower()
    try:
        azimuth, elevation = map(float, camera.split(","))
        if not abs(elevation) <= 90:
            raise ValueError
        return Orbit(azimuth, elevation)
    except ValueError:  # not numbers, not two, not finite, or out of range
        sides = ", ".join((*SIDES, *OF_PATIENT))
        remedy = f"give a side ({sides}) or AZIMUTH,ELEVATION, as 45,20; elevation -90 to 90"
        raise InputError.refused("--camera", camera, remedy, "syntax") from None


def _orbit(camera: str | Orbit, read: Callable[[], Volume]) -> Orbit:
    """Return the orbit of a side, for which the volume is read; an orbit stays."""
    from volspec.camera import OF_PATIENT, Orbit, side_deg

    if not isinstance(camera, str):
        return camera
    volume = read()
    side = OF_PATIENT.get(camera, camera)
    if side != camera and not volume.metadata.is_patient:
        problem = f"{volume.name}: states no patient's axes, so that no side is {camera}"
        raise InputError(problem, f"give --camera {side}", code="conflict", given=camera)
    return Orbit(*side_deg(side, volume))


@dataclass(frozen=True, slots=True)
class InputJob:
    """An input of a batch, and its output."""

    address: str
    output: Path


def jobs(
    inputs: Sequence[str], output: Path, noun: str = "", *suffixes: str, series: bool = False
) -> list[InputJob]:
    """Pair inputs with outputs: one keeps its output, of several each gets a name in that folder.

    Names are the inputs' without their endings, plus the first suffix; or they replace ``{name}``
    in the output, as in ``films/{name}.mp4``. With suffixes, outputs are files that end with one;
    ``noun`` they are, in the plural. With ``series``, a pattern is one input. Raises InputError if
    a pattern or folder holds no input, or an output has another suffix or cannot be written.
    """
    batch = _pairs(inputs, output, *suffixes[:1], series=series)
    if suffixes:
        for job in batch:
            require_suffix(job.output, noun, *suffixes)
            require_writable(job.output)
    return batch


def _pairs(
    inputs: Sequence[str], output: Path, suffix: str = "", *, series: bool = False
) -> list[InputJob]:
    """Pair inputs with outputs, which are not checked."""
    if (braces := re.search(r"\{[^}]*\}", str(output))) and _NAME not in str(output):
        raise InputError(f"{output}: {braces[0]} is unknown; write {_NAME}", code="unknown")
    addresses: list[str] = []
    for text in inputs:
        addresses += [text] if series and "*" in text else _expand_input(text)
    if [*inputs] == addresses and len(addresses) == 1 and _NAME not in str(output):
        return [InputJob(addresses[0], output)]
    if _NAME not in str(output) and output.suffix.lower() in _FILES and not output.is_dir():
        raise InputError(
            f"{output}: is one file for {count_of(len(addresses), 'input')}; give a folder, or a "
            f"pattern such as {_NAME}{output.suffix}",
            code="conflict",
        )
    stems = [_stem(Path(text.partition("?")[0])) for text in addresses]
    names = [
        stem if stems.count(stem) == 1 else Path(text.partition("?")[0]).name
        for stem, text in zip(stems, addresses, strict=True)
    ]
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise InputError(
            f"two inputs are named {twice}, and would write the same output; rename one, or give "
            "them one at a time",
            code="duplicate",
        )
    pattern = str(output) if _NAME in str(output) else str(output / (_NAME + suffix))
    return [
        InputJob(text, Path(pattern.replace(_NAME, name)))
        for text, name in zip(addresses, names, strict=True)
    ]


def _stem(path: Path) -> str:
    """Return the name of a file without its ending, or of a folder."""
    name = path.name or path.resolve().name
    return name if path.is_dir() and path.suffix.lower() != ".zarr" else plain_stem(name)


def _expand_input(text: str) -> list[str]:
    """Return the files that a pattern or a folder means; anything else is itself."""
    from volspec._files import is_remote
    from volspec._triangles import is_mesh_file
    from volspec.volume import WHOLE_SUFFIXES, bundled_volume

    # A question mark begins options, KEY=VALUE, or is any letter of a name.
    pattern, *options = re.split(r"(?=\?\w+=)", text, maxsplit=1)
    if re.search(r"[*?[]", pattern) and not (is_remote(text) or Path(text).exists()):
        if matches := sorted(glob.glob(pattern)):
            return ["".join((file, *options)) for file in matches]
        name = pattern.partition("?")[0]
        if re.search(r"[*[]", pattern) or not (Path(name).exists() or bundled_volume(name)):
            raise InputError(f"{text}: no file matches; check the pattern", code="not-found")
    folder = Path(text)
    if not folder.is_dir():
        return [text]
    # Folders of slices and OME-Zarr are volumes themselves.
    volumes = sorted(
        str(path)
        for path in folder.iterdir()
        if path.name.lower().endswith((*WHOLE_SUFFIXES, ".toml")) and not path.name.startswith(".")
    )
    meshes = sorted(str(path) for path in folder.iterdir() if is_mesh_file(path))
    return volumes or meshes or [text]


Progress = Callable[[str, float], object]
Figures = str | dict[str, Any]
"""Result of a job: a line to print, or figures to print as JSON."""


def run_jobs(
    batch: Sequence[InputJob],
    work: Callable[[InputJob, Progress], Figures],
    *,
    json: bool = False,
    incomplete: Sequence[str] = (),
) -> None:
    """Run a command's work on each input, and print its line or, with ``json``, its figures.

    In a batch, an input that fails is reported and the others still run; then the exit code is 1.
    If the work adds to what is ``incomplete``, it is `INCOMPLETE`.
    """
    if len(batch) == 1:
        with bar(quiet=json, left=True) as tell:
            result = work(batch[0], tell)
        print_json(result) if isinstance(result, dict) else say(result)
        if incomplete:
            raise SystemExit(INCOMPLETE)
        return
    done: list[Figures] = []
    failed = 0
    with bar(quiet=json, left=True) as tell:
        for i, job in enumerate(batch):
            tell.describe("batch", f"{i + 1} of {len(batch)}: {Path(job.address).name}")

            def inner(step: str, fraction: float, i: int = i) -> None:
                tell("batch", (i + min(fraction, 1.0) * (step != "load the scene")) / len(batch))

            try:
                done.append(work(job, inner))
            except (VolspecError, OSError) as error:
                failed += 1
                tell.report(f"failed: {one_line(error)}")
        tell("batch", 1.0)
    if json:
        print_json([figures for figures in done if isinstance(figures, dict)])
    else:
        for line in done:
            say(line)
        failures = f"; {count_of(failed, 'input')} failed" if failed else ""
        say(f"{len(done)} of {count_of(len(batch), 'input')} done{failures}")
    if failed or incomplete:
        raise SystemExit(1 if failed else INCOMPLETE)
