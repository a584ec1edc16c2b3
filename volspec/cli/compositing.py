"""``volspec compositing``: a stored image for Blender and Nuke, with lights and recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from volspec._files import require_writable
from volspec.cli.kinds import require_image
from volspec.cli.setting import read_image_setting
from volspec.cli.shell import app, say
from volspec.cli.viewing import in_options
from volspec.errors import ImageError, InputError


@app.command
def compositing(
    image: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    light: Annotated[list[str] | None, Parameter(negative="")] = None,
    mode: str | None = None,
) -> None:
    """Relight a stored image in a compositor: Blender, Nuke or another.

    `volspec render` writes the lights of the scene into the header of an image, as sums of its
    channels. From there `-o FILE.py` makes a script that builds them as nodes in Blender
    (`blender --python FILE.py`), `-o FILE.nk` a group to paste into Nuke, with a knob for each
    light. `-o FILE.exr` writes the image once more, with other lights.

    Example: `volspec compositing engine.exr -o engine.py`

    Example: `volspec compositing engine.exr -o engine.nk`

    Example: `volspec compositing engine.exr --light D65 --light "key=A; sky=D65*0.3" -o new.exr`

    Parameters
    ----------
    image
        A coefficient image.
    output
        A `.py`, `.nk` or `.exr` file.
    light
        Of `-o FILE.exr`: as for `volspec relight`; the first is the preview's. Repeatable.
    mode
        Of `-o FILE.exr`: componentwise, exact or linear-model. As in the scene when left out.
    """
    from dataclasses import replace

    from volspec.export.compositing import Recipe, save_for_compositors
    from volspec.export.recipes import SUFFIXES, write_recipe
    from volspec.raycast import CoefficientImage
    from volspec.scene import stored_relight_spec

    require_image(image, "cast it first: volspec render {file} -o IMAGE.exr")
    suffix = output.suffix.lower()
    if suffix not in (*SUFFIXES, ".exr"):
        raise ImageError(
            f"{output}: name it .py for Blender, .nk for Nuke, or .exr for other lights"
        )
    require_writable(output)
    if suffix in SUFFIXES:
        if light or mode:
            raise ImageError(
                f"{output}: takes the lights that {image} names; give --light and --mode to "
                "-o NEW.exr first"
            )
        write_recipe(output, image)
    else:
        if not light:
            raise ImageError(f"{output}: which lights shall it name? add --light, such as D65")
        if twice := [text for text in dict.fromkeys(light) if light.count(text) > 1]:
            raise InputError(
                f"--light: {twice[0]!r} is given twice; give it once", code="duplicate"
            )
        stored = CoefficientImage.load(image)
        spec = stored_relight_spec(stored)
        with in_options():
            changes: dict[str, Any] = {} if mode is None else {"mode": mode}
            spec = replace(spec, **changes)
        lamps = {text: read_image_setting(image, text, stored) for text in light}
        recipe = Recipe.of(stored.basis, stored.groups, lamps, spec)
        save_for_compositors(stored, output, recipe)
    say(output)
