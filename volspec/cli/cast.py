"""``volspec render``: cast once, relight for ever."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from volspec._files import require_writable
from volspec.cli.kinds import RELIGHT, require_scene
from volspec.cli.shell import Device, app, bar, say
from volspec.cli.size import Size, sides
from volspec.errors import ImageError


@app.command
def render(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    size: Size = None,
    half: Annotated[bool, Parameter(negative="")] = False,
    device: Device = None,
) -> None:
    """Cast a scene once into a coefficient image.

    Compositors open it: a layer of channels a light group, depth, a picture under the first light,
    and in the header how to relight it (`volspec compositing --help`).

    Ctrl-C ends a cast within moments; an image that was there before stays as it is.

    Example: `volspec render engine.toml -o engine.exr --size 1024x768`

    Parameters
    ----------
    scene
        A scene file.
    output
        The OpenEXR file to write.
    size
        WIDTHxHEIGHT in pixels, in place of the scene's.
    half
        Keep the channels as float16: half the memory and file, three digits.
    """
    from volspec.export.compositing import save_for_compositors, scene_recipe
    from volspec.scene import Scene

    if output.suffix.lower() != ".exr":
        raise ImageError(f"{output}: coefficient images are OpenEXR; name it .exr")
    require_scene(scene, f"it is cast already; {RELIGHT}")
    require_writable(output)
    with bar() as tell:
        tell("load the scene", 0)
        loaded = Scene.load(scene)
        tell("load the scene", 1)
        spec = replace(loaded.raycast, half=half or loaded.raycast.half)
        recipe = scene_recipe(loaded, loaded.lights, loaded.relight)
        image = loaded.render(
            size=sides(size) if size else None,
            spec=spec,
            device=device,
            progress=lambda share: tell("cast", share),
        )
    save_for_compositors(image, output, recipe)
    groups = f" for each of {', '.join(image.groups)}" if len(image.groups) > 1 else ""
    said = f"{output}: {image.size[0]}×{image.size[1]}, {image.basis.size} channels{groups}"
    say(said)
