"""``volspec render``, ``view`` and ``demo``: cast a scene, to disk or in a window."""

from __future__ import annotations

from contextlib import suppress
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.table import Table

from volspec import __version__
from volspec._files import require_writable
from volspec.cli.arguments import RELIGHT, Lights, Size, Sized, sides
from volspec.cli.inputs import (
    LAYERED,
    CameraOption,
    InputJob,
    Inputs,
    LayerOptions,
    Memory,
    Preset,
    Progress,
    jobs,
    memory_address,
    open_scene,
    run_jobs,
)
from volspec.cli.shell import Device, Json, Terminal, app, bar, print_json
from volspec.errors import InputError
from volspec.export import located_in

if TYPE_CHECKING:
    from volspec.scene import Scene


@app.command
def render(
    inputs: Inputs,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    preset: Preset = None,
    light: Lights = None,
    camera: CameraOption = None,
    size: Size = None,
    options: LayerOptions = LAYERED,
    memory: Memory = None,
    half: Annotated[bool, Parameter(negative="")] = False,
    device: Device = None,
) -> None:
    """Cast a scene, a volume or a mesh once, into a coefficient image or a picture.

    A picture (`-o FILE.png`) is under the first light. A coefficient image (`-o FILE.exr`) can be
    relit by `volspec relight` and `volspec view`, and opened by compositors: it has a layer of
    channels per light group, depth, a picture under the first light, and relighting data in the
    header (`volspec compositing --help`).

    Ctrl-C ends a cast within moments; an existing image stays as it is.

    Example: `volspec render engine.toml -o engine.exr --size 1024x768`

    Example: `volspec render head.nii.gz -o head.exr --preset bone --camera left`

    Example: `volspec render head.nii.gz -o head.png --light tungsten`

    Example: `volspec render engine.toml -o engine.exr --layers 8`

    Example: `volspec render scans -o images`

    Parameters
    ----------
    output
        The OpenEXR or PNG file to write; of a batch, a folder (of coefficient images), or a pattern
        such as `images/{name}.png`.
    light
        For a volume: a light such as D65 or planck:3200, instead of the default ones; repeatable.
    size
        WIDTHxHEIGHT in pixels, instead of the scene's.
    half
        Store the channels as float16: half the memory and file size, three digits.
    """
    from volspec.export import save_for_compositors, scene_recipe, write_frame
    from volspec.pipeline import GAPS, relight

    batch = jobs(inputs, output, "casts and pictures", ".exr", ".png")
    incomplete: list[str] = []

    def cast(job: InputJob, tell: Progress) -> str:
        tell("load the scene", 0)
        remedy = f"it is already cast; {RELIGHT}"
        scene, volume = open_scene(job.address, preset, light, camera, image=remedy, memory=memory)
        if volume is None and light:
            raise InputError(
                f"--light {light[0]}: {job.address} is a scene with lights of its own; leave it "
                "out, or give its volume",
                code="conflict",
            )
        scene = options.onto(scene)
        if job.output.suffix.lower() == ".png":
            scene = _flat(scene, options.layers, job.output)
        tell("load the scene", 1)
        image = scene.render(
            volume,
            size=sides(size) if size else None,
            spec=replace(scene.raycast, half=half or scene.raycast.half),
            device=device,
            progress=lambda fraction: tell("cast", fraction),
        )
        width, height = image.size
        if GAPS in image.notes:
            incomplete.append(job.address)
        if job.output.suffix.lower() == ".png":
            first, depth = scene.lights[0], scene.file.depth
            with located_in(scene, "[depth]"):
                image = image.recompose({}, depth) if depth.changes else image
            frame = relight(image, first.rig, scene.relight)
            notes = {"light": first.name, "Software": f"volspec {__version__}"}
            write_frame(job.output, frame, notes, scene.relight.viewing.display.space)
            return f"{job.output}: {width}×{height}, {first.label or first.name}"
        save_for_compositors(image, job.output, scene_recipe(scene, scene.lights, scene.relight))
        if image.opacity_layers is not None:
            near, far = image.opacity_layers.range_mm
            layered = f"{image.opacity_layers.count} layers of opacity, {near:.4g} to {far:.4g} mm"
            return f"{job.output}: {width}×{height}, {image.basis.size} channels, {layered}"
        groups = f" for each of {', '.join(image.groups)}" if len(image.groups) > 1 else ""
        return f"{job.output}: {width}×{height}, {image.basis.size} channels{groups}"

    run_jobs(batch, cast, incomplete=incomplete)


def _flat(scene: Scene, layers: int | None, output: Path) -> Scene:
    """Return a scene that is cast without layers, which a picture cannot hold, unless in depth."""
    if layers:
        raise InputError(
            f"--layers {layers}: {output} is a picture, which has none; name it .exr",
            code="conflict",
        )
    if scene.file.depth.changes:
        return scene
    scene = copy(scene)
    scene.file = replace(scene.file, keyframe=())  # of an export, and maybe in depth
    return scene.casting(layers=0)


@app.command
def view(
    file: str | None = None,
    /,
    *,
    size: Annotated[str, Sized] = "1280x720",
    screenshot: Size = None,
    restore: bool = False,
    trace: Path | None = None,
    memory: Memory = None,
    device: Device = None,
) -> None:
    """View a scene, a volume, a mesh or a cast image, and swap its lights; H shows the keys.

    Example: `volspec view`

    Example: `volspec view engine.toml --screenshot 3840x2160`

    Example: `volspec view --restore`

    Parameters
    ----------
    file
        A scene file, a volume (file or folder), a mesh, a coefficient image (.exr) or a session; by
        default the viewer offers three demonstrations at its first start, and then opens the
        bundled engine.
    size
        WIDTHxHEIGHT of the window.
    screenshot
        WIDTHxHEIGHT of the pictures that S saves; default: as shown.
    restore
        Resume the last session; if there is none, open FILE or the file that was open last.
    trace
        Log events to a file of JSON lines: `t`, `event`, `stage`, `ms`.
    """
    if trace is not None:
        require_writable(trace)
    from volspec.volume import locate_volume

    file = locate_volume(file) if file else file
    # Checked before a window opens for nothing.
    from volspec.volume import is_pattern

    exists = file is None or is_pattern(file) or Path(file.partition("?")[0]).exists()
    if not exists and file is not None:
        name, _, options = file.partition("?")
        raise InputError(
            f"{name if '=' in options else file}: no such file; check the path", code="not-found"
        )
    if memory is not None and (file is None or file.lower().endswith((".toml", ".exr"))):
        remedy = f"write ?memory={memory} after [volume] file, or give the volume"
        raise InputError(f"--memory {memory}: is for a volume", remedy, code="conflict")
    file = memory_address(file, memory) if file else file
    from volspec.viewer import ViewerOptions
    from volspec.viewer import view as open_window

    screenshot_size = _sides("--screenshot", screenshot) if screenshot else None
    open_window(
        ViewerOptions(file, trace, _sides("--size", size), screenshot_size, device, restore)
    )


def _sides(option: str, text: str) -> tuple[int, int]:
    """Return width and height, up to the largest picture size."""
    from volspec._checks import MAX_SIDE

    both = sides(text)
    if max(both) > MAX_SIDE:
        raise InputError(f"{option} {text}: a side is too long; give at most {MAX_SIDE}")
    return both


@app.command
def demo(*, out: Path = Path("volspec-demo"), device: Device = None, json: Json = False) -> None:
    """Cast the bundled engine CT once, and relight it under five lights.

    Writes relit frames, a labelled contact sheet, a relightable web page, the coefficient image, a
    report, and the scene with its volume, `engine.toml`, for a first try of the other commands.

    Example: `volspec demo --out engine-demo`

    Parameters
    ----------
    out
        Output folder.
    """
    from volspec._gpu import asset
    from volspec.export import run_demo
    from volspec.scene import Scene

    require_writable(out / "sheet.png")
    with bar(quiet=json) as tell:
        tell("fit the basis", 0)
        scene = Scene.load(asset("data/scenes/engine.toml"))
        tell("fit the basis", 1)
        try:
            report = run_demo(scene, out, tell, device=device)
        finally:
            with suppress(OSError):  # as on a full disk; a folder with files stays
                out.rmdir()
    if json:
        print_json(report.to_dict())
        return
    console = Terminal()
    table = Table(
        title=f"{report.scene}, {report.size[0]}×{report.size[1]}, {report.channels} channels: "
        f"cast in {report.cast_ms:.0f} ms"
    )
    table.add_column("light")
    table.add_column("", no_wrap=True)
    for heading in ("relight ms", "cast / relight", "ΔE00 mean", "max"):
        table.add_column(heading, justify="right")
    for row in report.lights:
        errors = (_error(row.delta_e_mean), _error(row.delta_e_max))
        table.add_row(row.name, row.label, f"{row.relight_ms:.1f}", f"{row.ratio:.0f}", *errors)
    console.print(table)
    console.print(
        "ΔE00: the basis's error on the scene's materials under its lights, against full spectra.\n"
        f"Cast on {report.cast_device}; relit on {report.relight_device}.\n"
        f"Written in {report.seconds:.1f} s to {out}/: open {out}/sheet.png\n\nNow try",
        highlight=False,
    )
    for words, text in NEXT:
        console.print(f"  volspec {words.format(out=out)}", f"  # {text}", sep="", soft_wrap=True)


# Commands to go on with, and what they do.
NEXT = (
    ("view {out}/engine.toml", "turn it, and swap its lights"),
    ("export {out}/engine.toml -o engine.gif --turntable 36 --light A", "a film"),
    ("page {out}/engine.toml --views 12 -o engine.html", "a web page to send"),
    ("wizard reveal {out}/engine.toml inserts --under D65 -o {out}/seen.toml", "a new material"),
    ("view YOUR-VOLUME.nii.gz", "your own data: NRRD, NIfTI, DICOM, TIFF, …"),
)


def _error(delta_e: float) -> str:
    return f"{delta_e:.3f}" if delta_e >= 0.001 else "< 0.001"
