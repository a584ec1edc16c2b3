"""``volspec export``, ``page``, ``serve`` and ``compositing``: frames, films, web pages."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from volspec._files import require_writable
from volspec.cli.arguments import (
    RELIGHT,
    Lights,
    Size,
    read_image_setting,
    read_opacities,
    read_setting,
    require_image,
    sides,
)
from volspec.cli.inputs import (
    CAST,
    LAYERED,
    CameraOption,
    CastOptions,
    InputJob,
    Inputs,
    LayerOptions,
    Memory,
    Preset,
    Progress,
    jobs,
    open_scene,
    run_jobs,
)
from volspec.cli.options import Options
from volspec.cli.shell import (
    Device,
    Json,
    app,
    as_written,
    bar,
    count_of,
    note_everyday,
    say,
)
from volspec.cli.viewing import HdrOptions, StereoOptions, in_options
from volspec.errors import ImageError, InputError, nearest
from volspec.export.page import PageSpec
from volspec.scene.tables import ExportSpec

if TYPE_CHECKING:
    from volspec.scene import Scene
    from volspec.scene.tables import NamedLight
    from volspec.volume import Volume

_Whole = Annotated[int | None, Parameter(converter=as_written)]
_HDR, _STEREO = HdrOptions(), StereoOptions()
# The name of all lights of a scene, or of all marks, together.
_ALL = "all"


class FrameOptions(
    Options,
    group=Group("Frames", sort_key=2),
    of={ExportSpec: ("samples", "bits", "format", "spectral", "transparent", "fps")},
    negative="",
):
    """Format of frames, instead of the scene's; with --play, fps is by default its [volume]'s."""


_FRAMES = FrameOptions()


@app.command
def export(
    inputs: Inputs,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    preset: Preset = None,
    light: Lights = None,
    camera: CameraOption = None,
    turntable: _Whole = None,
    sweep: _Whole = None,
    play: Annotated[bool, Parameter(negative="")] = False,
    size: Size = None,
    cast: CastOptions = CAST,
    memory: Memory = None,
    frames: FrameOptions = _FRAMES,
    hdr: HdrOptions = _HDR,
    annotate: Annotated[list[str] | None, Parameter(negative="")] = None,
    stereo: StereoOptions = _STEREO,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    device: Device = None,
    json: Json = False,
) -> None:
    """Export re-lit frames of a scene or a volume: each light, from one camera, a turntable, keys.

    Each camera is cast once, however many lights there are. Options override the scene's
    `[export]`. To resume an interrupted export, repeat the command.

    Example: `volspec export engine.toml -o frames`

    Example: `volspec export engine.toml -o engine.mp4 --turntable 120`

    Example: `volspec export head.nii.gz -o head.mp4 --preset skin --turntable 120`

    Example: `volspec export heart.nii.gz -o heart.mp4 --play --fps 10 --light tungsten`

    Example: `volspec export 'scans/*.nrrd' -o 'films/{name}.mp4' --turntable 60`

    Example: `volspec export engine.toml -o shot --format coefficients --turntable 72`

    Example: `volspec export engine.toml -o hdr --format avif --hdr PQ --hdr-peak 600`

    Example: `volspec export engine.toml -o stereo.mp4 --turntable 120 --stereo side-by-side`

    Example: `volspec export engine.toml -o poster --size 12000x9000 --samples 2 --bits 16`

    Parameters
    ----------
    output
        A folder; or a film, `.gif` or (needs `volspec[video]`) `.mp4`, `.webm`, `.mov`, `.webp`
        or `.apng`. Of a batch, a folder of folders, or a pattern such as `films/{name}.mp4`.
    light
        Name of a light of the scene to export, or all; for a volume: a light such as D65 or
        planck:3200; repeatable. Default: all lights, but with --turntable and --play the first.
    turntable
        Number of frames in a full turn of the camera.
    sweep
        Number of frames in which one light fades into the next.
    play
        Show the time steps of a series one after the other, a frame each, or in as many as the
        camera or the lights have; a pattern of files is one series.
    size
        WIDTHxHEIGHT in pixels, instead of the scene's; large pictures are cast in tiles.
    annotate
        Marks in the pictures: scale, orientation, title, light or materials (with their colours),
        or all; repeatable.
    overwrite
        Replace files that an export of another scene left in the folder.
    """
    from volspec.export import export as export_scene
    from volspec.scene.tables import MARKS
    from volspec.settings import plain
    from volspec.spectra.library import sent_names

    incomplete: list[str] = []

    def export_frames(job: InputJob, tell: Progress) -> str | dict[str, Any]:
        tell("load the scene", 0)
        lights = None if light == [_ALL] else light
        scene, volume = open_scene(job.address, preset, lights, camera, memory=memory)
        scene = cast.onto(scene)
        current = scene.file.export
        changes: dict[str, Any] = {
            "fps": scene.file.volume.fps if play else None,
            **frames.given(),
            "annotate": MARKS if annotate == [_ALL] else annotate,
            "play": {} if play and current.play is None else None,
        }
        if (eyes := stereo.spec()) is not None:
            changes["stereo"] = plain(eyes, defaults=True)
        if hdr_table := hdr.table(current.hdr):
            changes["hdr"] = (plain(current.hdr) if current.hdr else {}) | hdr_table
        for key, count, table in (
            ("turntable", turntable, current.turntable),
            ("sweep", sweep, current.sweep),
        ):
            if count is not None:
                kept = {} if table is None else plain(table)
                changes[key] = kept | {"frames": count}
        names = tuple(lamp.name for lamp in scene.lights)
        fades = current.sweep is not None or sweep is not None
        # One turn under one light; coefficient images hold no light, and a sweep needs several.
        moves = turntable is not None or play
        one = moves and not (
            light or current.lights or fades or (frames.format or current.format) == "coefficients"
        )
        asked = light if volume is None or light is None else sent_names(light)
        changes["lights"] = names[:1] if one else names if light == [_ALL] else asked
        if unknown := [name for name in changes["lights"] or () if name not in names]:
            page = shlex.join(["volspec", "page", job.address, "-l", unknown[0], "-o", "PAGE.html"])
            guess = nearest(unknown[0], names)
            more = "" if guess else f"; add it to the scene as a [[light]], or to a page: {page}"
            raise InputError(
                f"--light: no [[light]] of {job.address} is named {unknown[0]!r}",
                f"{guess}known: {', '.join(names)}{more}",
                code="unknown",
                given=unknown[0],
            )
        settings = {key: value for key, value in changes.items() if value is not None}
        options = {key: f"--{key}" for key in (*settings, "size", "hdr")} | {"lights": "--light"}
        options |= hdr.names
        with in_options(options):
            scene = scene.exporting(**settings)
            tell("load the scene", 1)
            result = export_scene(
                scene,
                job.output,
                size=sides(size) if size else None,
                overwrite=overwrite,
                device=device,
                progress=tell,
                volume=volume,
            )
        if result.gaps:
            incomplete.append(job.address)
        if json:
            return {
                "output": str(result.output),
                "files": list(result.files),
                "frames": result.frames,
                "made": result.made,
                "casts": result.casts,
            }
        reused = result.frames - result.made
        line = (
            f"{result.output}: {count_of(result.frames, 'frame')}, {result.made} made from "
            f"{count_of(result.casts, 'cast')}" + (f"; {reused} already existed" if reused else "")
        )
        if one and len(names) > 1:
            turns = f"{'a turn' if turntable else 'them'} under each of {len(names)} lights"
            line += f", under {names[0]}; --light {_ALL} makes {turns}"
        return line

    run_jobs(jobs(inputs, output, series=play), export_frames, json=json, incomplete=incomplete)


def _check_views(_: object, views: int) -> None:
    """Validate the number of views of a page, for cyclopts."""
    from volspec.export.page import MAX_VIEWS

    if not 1 <= views <= MAX_VIEWS:
        raise ValueError(f"{views} views; give 1 to {MAX_VIEWS}")


class PageOptions(
    Options, group=Group("Page", sort_key=2), of={PageSpec: ("title", "caption", "bits")}
):
    """Texts and precision of a page."""


_PAGE = PageOptions()


@app.command
def page(
    inputs: Inputs,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    preset: Preset = None,
    camera: CameraOption = None,
    views: Annotated[int, Parameter(converter=as_written, validator=_check_views)] = 1,
    play: Annotated[bool, Parameter(negative="")] = False,
    light: Lights = None,
    size: Size = None,
    options: LayerOptions = LAYERED,
    memory: Memory = None,
    texts: PageOptions = _PAGE,
    device: Device = None,
) -> None:
    """Write a scene or a volume as a single web page with switchable lights.

    The page is one file that needs no network: open it from disk, mail it, or embed it in another
    page. It mixes the lights, applies the appearance model and draws with the desktop viewer's
    shaders on WebGL 2.

    Example: `volspec page engine.toml -o engine.html`

    Example: `volspec page engine.toml --views 36 --light planck:2000 -o around.html`

    Example: `volspec page head.nii.gz -o head.html --preset skin`

    Example: `volspec page head.toml --layers 8 -o head.html`

    Parameters
    ----------
    output
        The HTML file to write; of a batch, a folder, or a pattern such as `pages/{name}.html`.
    views
        Cameras on a circle around the scene's `up`, starting at the scene's own: drag to turn.
    play
        Hold all time steps of a series, with a slider and a button that plays them.
    light
        A light to add to the scene's: D65, planck:3200, FILE.csv, 'key=D65; fill=A*0.3', …;
        for a volume, instead of the default ones; repeatable.
    size
        WIDTHxHEIGHT in pixels, instead of the scene's.
    """
    from volspec.export.page import PageView, layers_size, scene_views, write_page
    from volspec.pipeline import GAPS

    batch = jobs(inputs, output, "pages", ".html", ".htm", series=play)
    incomplete: list[str] = []
    with in_options(texts.names):
        page_spec = PageSpec(**texts.given())

    def write(job: InputJob, tell: Progress) -> str:
        tell("load the scene", 0)
        remedy = "give its scene: volspec page SCENE.toml -o PAGE.html; or " + RELIGHT
        scene, volume = open_scene(job.address, preset, light, camera, image=remedy, memory=memory)
        scene, layers = options.onto(scene), options.layers
        tell("load the scene", 1)
        lights = _page_lights(scene, volume, light or [], job.address)
        series = scene.series() if play else None
        if play and series is None:
            raise InputError(
                f"--play: {job.address} has one time step; leave it out", code="conflict"
            )
        output_spec = scene.file.output
        pixels = sides(size) if size else (output_spec.width, output_spec.height)
        if layers and (count := views * (len(series) if series else 1)) > 1:
            raise InputError(
                f"--layers {layers}: a page of {count} pictures would have some "
                f"{layers_size(count, layers, pixels)} of layers; leave it out, or write a single "
                "picture",
                code="conflict",
            )
        cast = scene_views(
            scene,
            views,
            series=series,
            size=pixels,
            device=device,
            progress=lambda fraction: tell("cast", fraction),
            volume=volume,
        )
        title = texts.title or scene.file.title or Path(job.address).stem
        spec = replace(page_spec, title=title, fps=scene.file.volume.fps)

        layered: list[str] = []

        def watched() -> Iterator[PageView]:
            for view in cast:
                if GAPS in view.image.notes:
                    incomplete.append(job.address)
                if (opacity := view.image.opacity_layers) is not None:
                    layered.append(f", {opacity.count} layers of opacity")
                yield view

        count = write_page(job.output, watched(), lights, scene.relight, spec)
        many = f", {views} views" if views > 1 else ""
        many += f", {len(series)} time steps" if series else ""
        many += "".join(layered)
        lights_text = count_of(len(lights), "light")
        return f"{job.output}: {count / 1e6:.2f} MB, {lights_text}{many}; open it in a browser"

    run_jobs(batch, write, incomplete=incomplete)


def _page_lights(
    scene: Scene, volume: Volume | None, extra: Sequence[str], address: str
) -> list[NamedLight]:
    """Return a scene's lights, and those that a command adds to it; a volume's are its own.

    Raises VolspecError if a light cannot be read, or lacks the lux that the scene requires.
    """
    from volspec.relight import LightRig
    from volspec.scene.tables import NamedLight, require_lux
    from volspec.spectra.library import sent_name

    require_lux(scene.lights, scene.relight, address)
    lights = list(scene.lights)
    fractions = scene.raycast.shares()
    extra = extra if volume is None else []
    if extra and scene.relight.level == "absolute":
        raise InputError(
            f'--light {extra[0]}: has no lux, but [viewing] level = "absolute" of '
            f"{address} requires it; leave it out, or make it a [[light]] with "
            "illuminance_lux",
            code="conflict",
        )
    for text in extra:
        name = sent_name(text)
        note_everyday(text)
        if (room := scene.room) is not None:
            names = dict.fromkeys(room.response.names, 1.0)
            lamps = LightRig.of(read_setting(text, names, scene.basis.grid))
            lights.append(NamedLight(name, name, *room.rig(room.spectra(lamps))))
            continue
        rig = LightRig.of(read_setting(text, fractions, scene.basis.grid))
        mixed = rig.facing(fractions).mixed(scene.basis.grid)
        lights.append(NamedLight(name, name, mixed, rig))
    return lights


def _check_port(_: object, port: int) -> None:
    """Validate a port, for cyclopts."""
    if not 0 <= port <= 65535:
        raise ValueError(f"{port} is no port; give 0 to 65535")


@app.command
def serve(
    input: Annotated[
        str,
        Parameter(help="A scene file, a volume (file or folder, as for `volspec info`) or a mesh."),
    ],
    /,
    *,
    preset: Preset = None,
    camera: CameraOption = None,
    light: Lights = None,
    size: Size = None,
    cast: CastOptions = CAST,
    memory: Memory = None,
    host: str = "127.0.0.1",
    port: Annotated[int, Parameter(converter=as_written, validator=_check_port)] = 8765,
    insecure: Annotated[bool, Parameter(negative="")] = False,
    title: str | None = None,
    device: Device = None,
) -> None:
    """Serve a scene or a volume to a browser, which relights it and moves its camera.

    The volume stays on this machine: a picture's channels go to the browser once per view, and
    lights change there. The printed address holds a token, without which nothing is answered; one
    browser uses it up, and the next address is printed. From another machine, connect by
    `ssh -L 8765:localhost:8765 THIS_MACHINE` and open the address.

    Example: `volspec serve engine.toml`

    Example: `volspec serve scan.zarr --memory 2GiB --preset bone --size 800x600`

    Parameters
    ----------
    light
        A light to add to the scene's: D65, planck:3200, FILE.csv, 'key=D65; fill=A*0.3', …;
        for a volume, instead of the default ones; repeatable.
    size
        WIDTHxHEIGHT in pixels, instead of the scene's.
    host
        Address that it listens at; 0.0.0.0 is all of this machine's, with --insecure.
    port
        Port that it listens at; 0 is any that is free.
    insecure
        Let other machines connect, though they send and receive without encryption.
    title
        Title, instead of the scene's.
    """
    from volspec.export.page import PageSpec
    from volspec.export.serve import scene_server

    try:
        server = scene_server(host, port, insecure=insecure)
    except InputError as error:
        raise error.at(f"--{error.field}") from error
    try:
        with bar(left=True) as tell:
            tell("load the scene", 0)
            remedy = "give its scene: volspec serve SCENE.toml; or " + RELIGHT
            scene, volume = open_scene(input, preset, light, camera, image=remedy, memory=memory)
            scene = cast.onto(scene)
            tell("load the scene", 1)
            server.open(
                scene,
                _page_lights(scene, volume, light or [], input),
                PageSpec(title or scene.file.title or Path(input).stem),
                volume=volume,
                size=sides(size) if size else None,
                device=device,
                progress=lambda fraction: tell("cast", fraction),
            )
        with suppress(KeyboardInterrupt):
            server.run(lambda: print(f"{server.address}  (once; Ctrl-C ends it)", flush=True))
    finally:
        server.close()


@app.command
def compositing(
    image: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    light: Lights = None,
    mode: str | None = None,
    opacity: Annotated[list[str] | None, Parameter(negative="")] = None,
    deep: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Relight a stored image in a compositor: Blender, Nuke or another.

    `volspec render` writes the lights of the scene into the header of an image, as sums of its
    channels. From these, `-o FILE.py` makes a script that builds the lights as nodes in Blender
    (`blender --python FILE.py`), and `-o FILE.nk` a group to paste into Nuke, with a knob for each
    light. `-o FILE.exr` writes the image again with other lights or opacities; with `--deep`, as
    deep samples, for holdouts and merges by depth.

    Example: `volspec compositing engine.exr -o engine.py`

    Example: `volspec compositing engine.exr -o engine.nk`

    Example: `volspec compositing engine.exr --light D65 --light "key=A; sky=D65*0.3" -o new.exr`

    Example: `volspec compositing engine.exr --deep --opacity block=0.3 -o deep.exr`

    Parameters
    ----------
    image
        A coefficient image.
    output
        A `.py`, `.nk` or `.exr` file.
    light
        For `-o FILE.exr`: as for `volspec relight`; the first lights the preview. Repeatable.
    mode
        For `-o FILE.exr`: fitted, componentwise, exact or linear-model. Default: the scene's.
    opacity
        For `-o FILE.exr`: MATERIAL=SCALE, as for `volspec relight`. Repeatable.
    deep
        Write a deep OpenEXR file: each layer of an image that was cast with `--layers` is a sample.
        The first light lights R, G and B.
    """

    from volspec.export import (
        RECIPE_SUFFIXES,
        Recipe,
        save_deep,
        save_for_compositors,
        write_recipe,
    )
    from volspec.image import CoefficientImage
    from volspec.scene import stored_relight_spec

    require_image(image, "cast it first: volspec render {file} -o IMAGE.exr")
    suffix = output.suffix.lower()
    if suffix not in (*RECIPE_SUFFIXES, ".exr"):
        raise ImageError(
            f"{output}: name it .py for Blender, .nk for Nuke, or .exr for other lights"
        )
    require_writable(output)
    if suffix in RECIPE_SUFFIXES:
        if light or mode or opacity or deep:
            raise ImageError(
                f"{output}: has the lights of {image}, so --light, --mode, --opacity and --deep do "
                "not apply; make an -o NEW.exr with them first"
            )
        write_recipe(output, image)
    else:
        if opacity and output.exists() and output.samefile(image):
            raise ImageError(f"{output}: is the input image; name another file")
        if not (light or opacity or deep):
            raise ImageError(f"{output}: no lights for its header; add --light, such as D65")
        if mode and not light:
            raise ImageError(f"{output}: --mode is of lights; add --light, such as D65")
        light = light or []
        if twice := [text for text in dict.fromkeys(light) if light.count(text) > 1]:
            raise InputError(
                f"--light: {twice[0]!r} is given twice; give it once", code="duplicate"
            )
        stored, scales = CoefficientImage.load(image), read_opacities(opacity or ())
        spec = stored_relight_spec(stored)
        with in_options():
            changes: dict[str, Any] = {} if mode is None else {"mode": mode}
            spec = replace(spec, **changes)
        lamps = {text: read_image_setting(image, text, stored) for text in light}
        recipe = (
            Recipe.of(stored.basis, stored.groups, lamps, spec) if lamps else Recipe.load(image)
        )
        with in_options():
            if deep:
                counts = save_deep(stored, output, recipe, scales).counts
                say(f"{output}: {counts.sum()} samples in {(counts > 0).sum()} pixels")
                return
            save_for_compositors(stored.recompose(scales) if scales else stored, output, recipe)
    say(output)
