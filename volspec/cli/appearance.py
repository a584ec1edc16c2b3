"""``volspec adapt`` and ``volspec appearance``: the colour models on triples and on pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from volspec.cli.shell import Json, app, print_json
from volspec.cli.triples import read_triples
from volspec.errors import InputError

if TYPE_CHECKING:
    from volspec.appearance import ViewingConditions

XYZ = ("X", "Y", "Z")
Table = Annotated[
    Path | None,
    Parameter(allow_leading_hyphen=True, help="A CSV table of triples; - is standard input."),
]
Values = Annotated[list[float] | None, Parameter(negative="", allow_leading_hyphen=True)]
Lux = Annotated[float, Parameter(help="Illuminance; L_A is that of the background under it.")]
Background = Annotated[float, Parameter(name="--Y_b", help="The background, percent of white.")]
Round = Annotated[str, Parameter(name="--surround", help="average, dim, dark, or 0 to 1.")]
Degree = Annotated[float | None, Parameter(name="--D", help="Degree of adaptation, 0 to 1.")]
Discount = Annotated[bool, Parameter(negative="", help="Take the light's colour off whole.")]


def _conditions(
    white: str, lux: float, Y_b: float, surround: str, D: float | None, discount: bool
) -> ViewingConditions:
    """Conditions under a light, or under a white given as ``X,Y,Z``."""
    from volspec.appearance import ViewingConditions
    from volspec.spectra import light
    from volspec.spectra.photometry import white_XYZ

    numbers = white.split(",")
    try:
        given = [float(number) for number in numbers] if len(numbers) == 3 else None
    except ValueError:
        given = None
    X, Y, Z = white_XYZ(light(white)).tolist() if given is None else given
    others = {"Y_b": Y_b, "surround": _surround(surround), "D": D, "discount": discount}
    return ViewingConditions.of_lux((X, Y, Z), lux, **others)


def _surround(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


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
    lux: Lux = 1000.0,
    Y_b: Background = 20.0,
    surround: Round = "average",
    D: Degree = None,
    discount: Discount = False,
    table: Table = None,
    json: Json = False,
) -> None:
    """Corresponding colours: the XYZ that look under one light as these do under another.

    Example: `volspec adapt 40 35 10 --from A --to D65`

    Example: `volspec adapt --table patches.csv --from planck:3200 --method "Fairchild 1990" --json`

    Parameters
    ----------
    values
        X Y Z of each colour, Y = 100 for white.
    method
        none, von Kries, Bradford, Sharp, CAT02, CAT16, Nayatani, CIE 1994, Guth or Fairchild 1990.
    """
    from volspec.appearance.adaptation import adaptation, outside

    conditions = [_conditions(white, lux, Y_b, surround, D, discount) for white in (source, target)]
    passage = adaptation(method)(*conditions)
    colours = read_triples(values or (), table, XYZ)
    beyond = outside(colours, passage)
    rows = [
        {
            **dict(zip(XYZ, adapted.tolist(), strict=True)),
            **{f"{name}_from": value for name, value in zip(XYZ, seen.tolist(), strict=True)},
            "defined": not out,
        }
        for seen, adapted, out in zip(colours, passage.apply(colours), beyond, strict=True)
    ]
    _show(f"{method}, {source} to {target}", rows, json)


@app.command
def appearance(
    values: Values = None,
    /,
    *,
    white: Annotated[str, Parameter(help="The adopted white: a light, or X,Y,Z.")] = "D65",
    model: Annotated[list[str] | None, Parameter(negative="", help="Repeatable; all: all.")] = None,
    inverse: Annotated[bool, Parameter(negative="", help="From J C h to X Y Z.")] = False,
    lux: Lux = 1000.0,
    Y_b: Background = 20.0,
    surround: Round = "average",
    D: Degree = None,
    discount: Discount = False,
    table: Table = None,
    image: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    json: Json = False,
) -> None:
    """What colours look like: lightness, chroma, hue and the rest; or a picture by every model.

    Example: `volspec appearance 40 35 10 --white A --model CIECAM02 --json`

    Example: `volspec appearance --inverse 60 40 90 --white A`

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
    from volspec.appearance.models import MODELS
    from volspec.appearance.models import model as find

    if image is not None:
        if output is None or values or table:
            raise InputError(f"{image}: a picture of models goes to a file; give -o FILE.png alone")
        viewing = {"illuminance_lux": lux, "Y_b": Y_b, "surround": _surround(surround)}
        models = None if model == ["all"] else model
        _picture(image, white, models, viewing | {"D": D, "discount": discount}, output)
        return
    if output is not None:
        raise InputError(f"{output}: only --image makes a picture; numbers are printed")
    seen = _conditions(white, lux, Y_b, surround, D, discount)
    names = ("J", "C", "h") if inverse else XYZ
    colours = read_triples(values or (), table, names)
    asked = list(MODELS) if model == ["all"] else model or ["CIECAM02"]
    rows = []
    for name in asked:
        chosen = find(name)
        if inverse:
            J, C, h = colours.T
            back = chosen.inverse(J, C, h, seen)
            found = [dict(zip(XYZ, row.tolist(), strict=True)) for row in back]
        else:
            found = _correlates(chosen.forward(colours, seen), len(colours))
        for colour, each in zip(colours, found, strict=True):
            given = dict(zip(names, colour.tolist(), strict=True))
            rows.append({"model": name, **given, **each, "L_A": seen.L_A, "Y_b": seen.Y_b})
    _show(f"under {white}, {lux:g} lx", rows, json)


def _correlates(look: Any, count: int) -> list[dict[str, Any]]:
    """A row of what a model gives for each colour."""
    import numpy as np

    from volspec.appearance.hue import composition

    given = {name: getattr(look, name) for name in "JChHQMs"}
    columns = {name: np.asarray(v).tolist() for name, v in given.items() if v is not None}
    rows = [{name: column[i] for name, column in columns.items()} for i in range(count)]
    for i, row in enumerate(rows):
        if "H" in row:
            row["composition"] = str(composition(row["H"]))
        row["defined"] = look.defined is None or bool(np.asarray(look.defined)[i])
    return rows


def _finite(value: Any) -> Any:
    """JSON has no word for what is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _show(title: str, rows: list[dict[str, Any]], as_json: bool) -> None:
    """Print rows as JSON or as a table."""
    from rich.table import Table as Rich

    if as_json:
        print_json([{k: _finite(v) for k, v in row.items()} for row in rows])
        return
    names = list(dict.fromkeys(name for row in rows for name in row))
    # What is the same for all is told once, or not at all.
    if "L_A" in names:
        title += f", L_A {rows[0]['L_A']:.4g} cd/m², Y_b {rows[0]['Y_b']:g}"
    plain = all(row["defined"] for row in rows if "defined" in row)
    hidden = {"L_A", "Y_b", *(["defined"] if plain else [])}
    alike = [name for name in names[:4] if "model" in names and len({r[name] for r in rows}) == 1]
    for name in alike:
        title += f", {name} {rows[0][name]}"
        hidden.add(name)
    table = Rich(title=title, title_justify="left", box=None, pad_edge=False)
    shown = [name for name in names if name not in hidden]
    for name in shown:
        table.add_column(name, justify="left" if name == "model" else "right", no_wrap=True)
    for row in rows:
        cells = [row.get(name, "") for name in shown]
        table.add_row(*(f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in cells))
    # A narrow screen wraps lines; digits are never cut.
    console = Console()
    Console(width=max(console.width, 110)).print(table)


def _picture(
    image: Path, white: str, models: list[str] | None, viewing: dict[str, Any], output: Path
) -> None:
    """A stored image under a light, by every model."""
    from volspec import __version__
    from volspec._files import require_writable
    from volspec.appearance.spec import MODELS, Viewing
    from volspec.export.comparison import Seen, comparison_sheet
    from volspec.export.frames import write_frame
    from volspec.pipeline import Relighter
    from volspec.raycast import CoefficientImage
    from volspec.spectra import light

    require_writable(output)
    if output.suffix.lower() != ".png":
        raise InputError(f"{output}: the picture is a PNG file; name it .png")
    looks = [Viewing(name, **viewing) for name in models or MODELS]
    stored = CoefficientImage.load(image)
    lamp = light(white, stored.basis.grid)
    with Relighter(stored) as relighter:
        seen = [Seen(look.model, NOTES[look.model], relighter.frame(lamp, look)) for look in looks]
    lux = viewing["illuminance_lux"]
    sheet = comparison_sheet(f"{image.stem} under {white}, {lux:g} lx", seen, columns=4)
    write_frame(output, sheet, {"light": white, "Software": f"volspec {__version__}"})
    Console().print(f"{output}", highlight=False, soft_wrap=True)


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
