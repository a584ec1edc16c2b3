"""``volspec page``: a scene as one web page that can be relit, offline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from volspec._files import require_writable
from volspec.cli.kinds import RELIGHT, require_scene
from volspec.cli.setting import read_setting
from volspec.cli.shell import Device, app, as_written, bar, counted, say
from volspec.cli.size import Size, sides
from volspec.errors import ImageError, InputError


def _check_views(_: object, views: int) -> None:
    """A cyclopts validator: how many views a page may have."""
    from volspec.export.page import MOST_VIEWS

    if not 1 <= views <= MOST_VIEWS:
        raise ValueError(f"{views} views; give 1 to {MOST_VIEWS}")


def _check_bits(_: object, bits: int) -> None:
    """A cyclopts validator: what a channel can be kept in."""
    from volspec.export.page import BITS

    if not BITS[0] <= bits <= BITS[1]:
        raise ValueError(f"{bits} bits; give {BITS[0]} to {BITS[1]}")


@app.command
def page(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    views: Annotated[int, Parameter(converter=as_written, validator=_check_views)] = 1,
    light: Annotated[list[str] | None, Parameter(negative="")] = None,
    size: Size = None,
    bits: Annotated[int, Parameter(converter=as_written, validator=_check_bits)] = 8,
    title: str | None = None,
    caption: str = "",
    device: Device = None,
) -> None:
    """Write a scene as one web page whose light can be changed.

    The page is a single file that asks the network for nothing: open it from a disk, mail it, or
    frame it in another page. It mixes the lights, adapts the eye and draws with the desktop's own
    shaders on WebGL 2.

    Example: `volspec page engine.toml -o engine.html`

    Example: `volspec page engine.toml --views 36 --light planck:2000 -o around.html`

    Parameters
    ----------
    scene
        A scene file.
    output
        The HTML file to write.
    views
        Cameras on a circle around the scene's `up`, the scene's own the first: drag to turn.
    light
        A light besides the scene's: D65, planck:3200, FILE.csv, 'key=D65; fill=A*0.3', …;
        repeatable.
    size
        WIDTHxHEIGHT in pixels, in place of the scene's.
    bits
        Of each channel, 8 to 12: 8 for CIEDE2000 0.3, 12 for 0.03 and more than twice the size.
    title
        In place of the scene's.
    caption
        A few words below the title.
    """
    from volspec.export.page import PageSpec, scene_views, write_page
    from volspec.relight import LightRig
    from volspec.scene import Scene
    from volspec.scene.lights import NamedLight, require_lux

    if output.suffix.lower() not in (".html", ".htm"):
        raise ImageError(f"{output}: pages are HTML files; name it .html")
    require_writable(output)
    require_scene(
        scene, "a page is made of its scene: volspec page SCENE.toml -o PAGE.html; or " + RELIGHT
    )
    with bar() as tell:
        tell("load the scene", 0)
        loaded = Scene.load(scene)
        tell("load the scene", 1)
        require_lux(loaded.lights, loaded.relight, scene)
        lights = list(loaded.lights)
        shares = loaded.raycast.shares()
        if light and loaded.relight.level == "absolute":
            raise InputError(
                f'--light {light[0]}: has no lux, which [viewing] level = "absolute" of {scene} '
                "asks of all lights; leave it out, or make it a [[light]] with illuminance_lux",
                code="conflict",
            )
        for text in light or ():
            lamp = read_setting(text, shares, loaded.basis.grid)
            rig = lamp if isinstance(lamp, LightRig) else LightRig((lamp,))
            shown = rig.facing(shares).mixed(loaded.basis.grid)
            lights.append(NamedLight(text, text, shown, rig))
        cast = scene_views(
            loaded,
            views,
            size=sides(size) if size else None,
            device=device,
            progress=lambda share: tell("cast", share),
        )
        name = title or loaded.file.title or scene.stem
        count = write_page(output, cast, lights, loaded.relight, PageSpec(name, caption, bits))
    many = f", {views} views" if views > 1 else ""
    lit = counted(len(lights), "light")
    say(f"{output}: {count / 1e6:.2f} MB, {lit}{many}; open it in a browser")
