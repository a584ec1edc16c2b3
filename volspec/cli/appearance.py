"""``volspec adapt`` and ``volspec appearance``: the colour models on triples and on pictures."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from volspec.cli.arguments import read_triples, require_image
from volspec.cli.shell import Json, Row, app, say, show_rows, tell_undefined
from volspec.cli.viewing import PictureOptions, SceneOptions, in_options, white_triple
from volspec.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from volspec.appearance import ViewingConditions
    from volspec.appearance.models import Appearance, Model


# Below this a hue is that of the last digits: black and the white have none.
_LEAST_CHROMA = 1e-6
XYZ, JCH = ("X", "Y", "Z"), ("J", "C", "h")
Table = Annotated[
    Path | None,
    Parameter(allow_leading_hyphen=True, help="A CSV table of triples; - is standard input."),
]
Values = Annotated[list[float] | None, Parameter(negative="", allow_leading_hyphen=True)]
_SCENE, _PICTURE = SceneOptions(), PictureOptions()


@app.command
def adapt(
    values: Values = None,
    /,
    *,
    source: Annotated[str, Parameter(name="--from", help="Light seen under, or X,Y,Z of white.")],
    target: Annotated[
        str, Parameter(name="--to", help="Light to be seen under, or X,Y,Z.")
    ] = "D65",
    method: str = "CAT02",
    table: Table = None,
    viewing: SceneOptions = _SCENE,
    json: Json = False,
) -> None:
    """Corresponding colours: the XYZ that look under one light as these do under another.

    Viewing options, `--preset` too, hold under both lights; left out they are 1000 lx, a background
    of 20 % and an average surround. A colour for which a method has no equations is counted, and
    its row says `defined` false.

    Example: `volspec adapt 40 35 10 --from A --to D65`

    Example: `volspec adapt --table patches.csv --from planck:3200 --method "Fairchild 1990" --json`

    Parameters
    ----------
    values
        X Y Z of each colour, Y = 100 for white.
    method
        none, von Kries, Bradford, Sharp, CAT02, CAT16, Nayatani, CIE 1994, Guth or Fairchild 1990.
    """
    import numpy as np

    from volspec.appearance.adaptation import ADAPTATIONS, adaptation, outside
    from volspec.appearance.models import APPEARANCE_MODELS

    _require_kind(
        method,
        ADAPTATIONS,
        APPEARANCE_MODELS,
        "an appearance model; use volspec appearance --model",
    )
    with in_options():
        transform = adaptation(method)(viewing.conditions(source), viewing.conditions(target))
    colours = read_triples(values or (), table, XYZ)
    adapted = transform.apply(colours)
    defined = ~outside(colours, transform) & np.isfinite(adapted).all(axis=-1)
    rows: list[Row] = [
        {
            **dict(zip(XYZ, to, strict=True)),
            **{f"{name}_from": value for name, value in zip(XYZ, seen, strict=True)},
            "defined": inside,
        }
        for seen, to, inside in zip(
            colours.tolist(), adapted.tolist(), defined.tolist(), strict=True
        )
    ]
    said = f", {viewing.said}" if viewing.preset else ""
    show_rows(f"{method}, {source} to {target}{said}", rows, json)
    tell_undefined({method: rows})


@app.command
def appearance(
    values: Values = None,
    /,
    *,
    white: Annotated[str, Parameter(help="The adopted white: a light, or X,Y,Z.")] = "D65",
    model: Annotated[list[str] | None, Parameter(negative="", help="Repeatable; all: all.")] = None,
    inverse: Annotated[bool, Parameter(negative="", help="From J C h to X Y Z.")] = False,
    table: Table = None,
    image: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    viewing: PictureOptions = _PICTURE,
    json: Json = False,
) -> None:
    """Predict colours' lightness, chroma, hue and more; or show a picture by every model.

    A colour outside of what a model was made for is counted, and its row says `defined` false;
    with `--inverse` a look that nothing has. Viewing options that are left out are 1000 lx, a
    background of 20 % and an average surround.

    Example: `volspec appearance 40 35 10 --white A --model CIECAM02 --json`

    Example: `volspec appearance --inverse 60 40 90 --white A --preset cinema`

    Example: `volspec appearance --image engine.exr --white A -o models.png`

    Parameters
    ----------
    values
        X Y Z of each colour, Y = 100 for white; with `--inverse` J C h.
    model
        CIECAM02 when left out; with `--image` all of `volspec relight --model`.
    image
        A coefficient image: shown under the light `--white`, by every model side by side.
    output
        The picture's PNG file.
    """
    from volspec.appearance.adaptation import ADAPTATIONS
    from volspec.appearance.models import APPEARANCE_MODELS
    from volspec.appearance.models import model as find

    if model is not None and "all" in model and len(model) > 1:
        other = next((name for name in model if name != "all"), "all")
        raise InputError(
            f"--model all with --model {other}: all is every model; give one of them",
            code="conflict",
        )
    if image is not None:
        given = {"--table": table, "--inverse": inverse, "--json": json, "colours": values}
        if others := [name for name, value in given.items() if value]:
            raise InputError(
                f"{' and '.join(others)} with --image: that makes a picture, and prints no "
                "figures; leave one of them out"
            )
        if output is None:
            raise InputError(f"{image}: a picture of models goes to a file; give -o FILE.png")
        write_comparison(image, white, None if model == ["all"] else model, viewing, output)
        return
    if output is not None:
        raise InputError(f"{output}: only --image makes a picture; numbers are printed")
    viewing.require_no_picture()
    with in_options():
        seen = viewing.conditions(white)
    asked = list(APPEARANCE_MODELS) if model == ["all"] else model or ["CIECAM02"]
    for name in asked:
        _require_kind(
            name, APPEARANCE_MODELS, ADAPTATIONS, "an adaptation; use volspec adapt --method"
        )
    models = {name: find(name) for name in asked}
    names = JCH if inverse else XYZ
    colours = read_triples(values or (), table, names)
    found = {}
    for name, chosen in models.items():
        look = _colours(chosen, colours, seen) if inverse else _correlates(chosen, colours, seen)
        shared = {"L_A": seen.L_A, "Y_b": seen.Y_b}
        found[name] = [
            {"model": name, **dict(zip(names, colour, strict=True)), **row, **shared}
            for colour, row in zip(colours.tolist(), look, strict=True)
        ]
    under = f", {viewing.said}" if viewing.said else ""
    show_rows(f"under {white}{under}", [row for rows in found.values() for row in rows], json)
    tell_undefined(found)


def _require_kind(name: str, own: Iterable[str], others: Iterable[str], theirs: str) -> None:
    """Refuse a name that is the other command's (``theirs`` calls it), or nearest to one of its."""
    foreign = {other.casefold(): other for other in others}
    known = [*(each.casefold() for each in own), *foreign]
    folded = " ".join(name.split()).casefold()
    if folded not in known:
        folded = next(iter(get_close_matches(folded, known, n=1, cutoff=0.7)), folded)
    if folded in foreign:
        meant = foreign[folded]
        raise InputError(f"{name!r}: {meant} is {theirs} {shlex.quote(meant)}")


def _correlates(model: Model, colours: NDArray[np.float64], seen: ViewingConditions) -> list[Row]:
    """A row of what a model gives for each XYZ."""
    import numpy as np

    from volspec.appearance.hue import composition

    look: Appearance = model.forward(colours, seen)
    given = {name: getattr(look, name) for name in (*"JChHQMs", "Q_WB", "L_N")}
    columns = {name: np.asarray(v).tolist() for name, v in given.items() if v is not None}
    rows: list[Row] = [
        {name: column[i] for name, column in columns.items()} for i in range(len(colours))
    ]
    for i, row in enumerate(rows):
        if "H" in row:
            told = math.isfinite(row["H"]) and row["C"] >= _LEAST_CHROMA
            row["composition"] = str(composition(row["H"])) if told else ""
        row["defined"] = bool(look.defined[i])
    return rows


def _colours(model: Model, looks: NDArray[np.float64], seen: ViewingConditions) -> list[Row]:
    """A row of the XYZ that look as each J, C, h."""
    J, C, h = looks.T
    back = model.inverse(J, C, h, seen).tolist()
    return [
        {**dict(zip(XYZ, row, strict=True)), "defined": all(map(math.isfinite, row))}
        for row in back
    ]


def write_comparison(
    image: Path, white: str, models: Sequence[str] | None, options: PictureOptions, output: Path
) -> None:
    """Write the sheet of an image under a light as a PNG; without models, all of them.

    What the options leave out is as `volspec.Viewing` has it, not as in the image's scene.
    """
    from volspec import __version__
    from volspec._files import require_suffix, require_writable
    from volspec.appearance.spec import MODELS
    from volspec.export.contact_sheet import SheetTile, comparison_sheet
    from volspec.export.frames import write_frame
    from volspec.pipeline import Relighter
    from volspec.raycast import CoefficientImage
    from volspec.relight import RelightSpec
    from volspec.spectra import light

    require_image(image, "cast it first: volspec render {file} -o IMAGE.exr")
    require_suffix(output, "pictures", ".png")
    require_writable(output)
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
