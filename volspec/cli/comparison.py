"""A stored image under one light, by every model side by side: ``volspec appearance --image``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from volspec.cli.kinds import require_image
from volspec.cli.shell import say
from volspec.cli.viewing import PictureOptions, in_options, white_triple
from volspec.errors import InputError


def write_comparison(
    image: Path, white: str, models: Sequence[str] | None, options: PictureOptions, output: Path
) -> None:
    """Write the sheet.

    Parameters
    ----------
    image : Path
        A coefficient image.
    white : str
        The light.
    models : sequence of str, optional
        None is every model and adaptation.
    options : PictureOptions
        What is left out is as `volspec.Viewing` has it, not as in the image's scene.
    output : Path
        A PNG file.

    Raises
    ------
    InputError
        If something given cannot be used.
    """
    from volspec import __version__
    from volspec._files import require_writable
    from volspec.appearance.spec import MODELS
    from volspec.export.frames import write_frame
    from volspec.export.sheet import SheetTile, comparison_sheet
    from volspec.pipeline import Relighter
    from volspec.raycast import CoefficientImage
    from volspec.relight import RelightSpec
    from volspec.spectra import light

    require_image(image, "cast it first: volspec render {file} -o IMAGE.exr")
    require_writable(output)
    if output.suffix.lower() != ".png":
        raise InputError(f"{output}: the picture is a PNG file; name it .png")
    if white_triple(white) is not None:
        raise InputError(
            f"--white {white} with --image: a picture needs the light's spectrum; name a light, "
            "as A, planck:3200 or FILE.csv"
        )
    viewing = options.onto(RelightSpec()).viewing
    names: Sequence[Any] = models or MODELS
    with in_options():
        looks = [replace(viewing, model=name) for name in names]
    stored = CoefficientImage.load(image)
    lamp = light(white, stored.basis.grid)
    with Relighter(stored) as relighter:
        tiles = [
            SheetTile(look.model, NOTES[look.model], relighter.frame(lamp, look)) for look in looks
        ]
    words = [f"{image.stem} under {white}", f"{viewing.illuminance_lux:g} lx"]
    if viewing.L_A is not None:
        words[1] = f"L_A {viewing.L_A:g} cd/m²"
    space = looks[0].display.colours
    words += [each for each in (options.preset, space.name) if each not in (None, "sRGB")]
    sheet = comparison_sheet(", ".join(words), tiles, columns=4)
    notes = {"light": white, "Software": f"volspec {__version__}"}
    write_frame(output, sheet, notes, space)
    say(output)


# What a reader of the picture should know of each.
NOTES = {
    "CIECAM02": "appearance, CIE 159:2004",
    "CAM16": "CIECAM02 mended for saturated lights",
    "CIELAB": "von Kries on XYZ",
    "RLAB": "for pictures on other media",
    "Hunt": "the most complete, 1995",
    "Nayatani95": "for judging lights",
    "none": "the light's colour as it is",
    "von Kries": "adaptation on cones",
    "Bradford": "as ICC profiles adapt",
    "Sharp": "on sharpened responses",
    "CAT02": "CIECAM02's adaptation alone",
    "CAT16": "CAM16's adaptation alone",
    "Nayatani": "nonlinear, 1982",
    "CIE 1994": "Nayatani's with a factor",
    "Guth": "by gains of trolands, ATD",
    "Fairchild 1990": "incomplete, with cross terms",
}
