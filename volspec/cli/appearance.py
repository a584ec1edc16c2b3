"""``volspec adapt`` and ``volspec appearance``: the colour models on triples and on pictures."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, Token

from volspec.cli.arguments import parse_triple, read_triples, require_image
from volspec.cli.shell import Json, Row, app, say, show_rows, warn_undefined
from volspec.cli.viewing import ModelOptions, PictureOptions, SceneOptions, in_options
from volspec.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from volspec.appearance import ViewingConditions
    from volspec.appearance.models import Appearance, Model


# Below this chroma the hue is rounding noise: black and the white have no hue.
_MIN_CHROMA = 1e-6
# In --json alone, as tables are wide.
_COMPONENTS = "M_RG", "M_YB"
XYZ, JCH = ("X", "Y", "Z"), ("J", "C", "h")
Table = Annotated[
    Path | None,
    Parameter(allow_leading_hyphen=True, help="A CSV table of triples; - is standard input."),
]


def _numbers(_: Any, tokens: Sequence[Token]) -> list[float]:
    """Convert numbers, for cyclopts; a file among them was meant for an option."""
    numbers = []
    for word in (token.value for token in tokens):
        try:
            numbers.append(float(word))
        except ValueError:
            option = _FILE_OPTIONS.get(Path(word).suffix.lower())
            remedy = f"for a file write {option} {shlex.quote(word)}" if option else "give numbers"
            raise ValueError(f"{word!r} is not a number; {remedy}") from None
    return numbers


# Options that take a file, by the file's suffix.
_FILE_OPTIONS = {".exr": "volspec appearance --image", ".csv": "--table"}
Values = Annotated[
    list[float] | None, Parameter(negative="", allow_leading_hyphen=True, converter=_numbers)
]
_SCENE, _PICTURE, _MODELS = SceneOptions(), PictureOptions(), ModelOptions()


@app.command
def adapt(
    values: Values = None,
    /,
    *,
    source: Annotated[str, Parameter(name="--from", help="Their light, or X,Y,Z of white.")],
    target: Annotated[str, Parameter(name="--to", help="Light to adapt to, or X,Y,Z.")] = "D65",
    method: str = "CAT02",
    table: Table = None,
    viewing: SceneOptions = _SCENE,
    json: Json = False,
) -> None:
    """Corresponding colours: the XYZ that match the given colours' appearance under another light.

    Viewing options, including `--preset`, apply to both lights; the defaults are 1000 lx, a
    background of 20 % and an average surround. Colours outside the domain of a method are counted,
    and their rows have `defined` false.

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
            **{f"{name}_from": value for name, value in zip(XYZ, original, strict=True)},
            "defined": inside,
        }
        for original, to, inside in zip(
            colours.tolist(), adapted.tolist(), defined.tolist(), strict=True
        )
    ]
    preset_note = f", {viewing.description}" if viewing.preset else ""
    show_rows(f"{method}, {source} to {target}{preset_note}", rows, json)
    warn_undefined({method: rows})


@app.command
def appearance(
    values: Values = None,
    /,
    *,
    white: Annotated[str, Parameter(help="The adopted white: a light, or X,Y,Z.")] = "D65",
    model: Annotated[list[str] | None, Parameter(negative="", help="Repeatable; or all.")] = None,
    inverse: Annotated[bool, Parameter(negative="", help="From J C h to X Y Z.")] = False,
    table: Table = None,
    image: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    viewing: PictureOptions = _PICTURE,
    own: ModelOptions = _MODELS,
    json: Json = False,
) -> None:
    """Predict lightness, chroma, hue and more of colours; or draw a picture with every model.

    Colours outside a model's domain (with `--inverse`: appearances that no colour has) are
    counted, and their rows have `defined` false. The viewing options default to 1000 lx, a
    background of 20 % and an average surround.

    Example: `volspec appearance 40 35 10 --white A --model CIECAM02 --json`

    Example: `volspec appearance 40 35 10 --white A --model Hunt --hunt-N_b 25 --hunt-helson-judd`

    Example: `volspec appearance --inverse 60 40 90 --white A --preset cinema`

    Example: `volspec appearance --image engine.exr --white A -o models.png`

    Parameters
    ----------
    values
        X Y Z of each colour, Y = 100 for white; with `--inverse` J C h.
    model
        Default: CIECAM02; with `--image`, all models of `volspec relight --model`.
    image
        A coefficient image to show under the light `--white`, by every model side by side.
    output
        The PNG file to write.
    """
    from volspec.appearance import MODELS, Viewing
    from volspec.appearance.adaptation import ADAPTATIONS
    from volspec.appearance.models import APPEARANCE_MODELS
    from volspec.appearance.models import model as find

    if model is not None and "all" in model and len(model) > 1:
        other = next((name for name in model if name != "all"), "all")
        raise InputError(
            f"--model all with --model {other}: all includes every model; give one of them",
            code="conflict",
        )
    if image is not None:
        incompatible = {"--table": table, "--inverse": inverse, "--json": json, "colours": values}
        if conflicts := [name for name, value in incompatible.items() if value]:
            raise InputError(
                f"{' and '.join(conflicts)} with --image: --image writes a picture and prints no "
                "figures; leave one of them out"
            )
        if output is None:
            raise InputError(f"{image}: --image needs an output file; give -o FILE.png")
        chosen_models = None if model == ["all"] else model
        if own.S is not None:
            raise InputError("--hunt-S with --image: a picture has no scotopic data; leave it out")
        own.require_models(chosen_models or MODELS)
        write_comparison(image, white, chosen_models, viewing, output, own)
        return
    if output is not None:
        raise InputError(f"{output}: -o is only for --image; numbers are printed")
    viewing.require_no_picture()
    with in_options():
        conditions = viewing.conditions(white)
    asked = list(APPEARANCE_MODELS) if model == ["all"] else model or ["CIECAM02"]
    for name in asked:
        _require_kind(
            name, APPEARANCE_MODELS, ADAPTATIONS, "an adaptation; use volspec adapt --method"
        )
    own.require_models(asked)
    inputs = own.onto(Viewing())
    models = {name: find(name) for name in asked}
    names = JCH if inverse else XYZ
    colours = read_triples(values or (), table, names)
    settings: dict[str, dict[str, Any]] = {
        "Hunt": {"settings": inputs.hunt, "S": _scotopic(own, len(colours))},
        "Nayatani95": {"settings": inputs.nayatani},
    }
    rows_of = {}
    for name, appearance_model in models.items():
        appearance_of = _colours if inverse else _correlates
        look = appearance_of(appearance_model, colours, conditions, **settings.get(name, {}))
        shared = {"L_A": conditions.L_A, "Y_b": conditions.Y_b}
        rows_of[name] = [
            {"model": name, **dict(zip(names, colour, strict=True)), **_cells(row, json), **shared}
            for colour, row in zip(colours.tolist(), look, strict=True)
        ]
    under = f", {viewing.description}" if viewing.description else ""
    show_rows(f"under {white}{under}", [row for rows in rows_of.values() for row in rows], json)
    warn_undefined(rows_of)


def _cells(row: Row, as_json: bool) -> Row:
    return {name: value for name, value in row.items() if as_json or name not in _COMPONENTS}


def _require_kind(name: str, ours: Iterable[str], other_names: Iterable[str], theirs: str) -> None:
    """Refuse a name, even misspelt, of the other command's; ``theirs`` says how to call that."""
    foreign = {other.casefold(): other for other in other_names}
    names = [*(candidate.casefold() for candidate in ours), *foreign]
    folded = " ".join(name.split()).casefold()
    if folded not in names:
        folded = next(iter(get_close_matches(folded, names, n=1, cutoff=0.7)), folded)
    if folded in foreign:
        meant = foreign[folded]
        raise InputError(f"{name!r}: {meant} is {theirs} {shlex.quote(meant)}")


def _scotopic(inputs: ModelOptions, colours: int) -> list[float] | float | None:
    """Return S / S_w of the colours, or one for all of them."""
    if inputs.S is None or len(inputs.S) == colours:
        return inputs.S
    if len(inputs.S) == 1:
        return inputs.S[0]
    raise InputError(
        f"--hunt-S: {len(inputs.S)} for {colours} colours; give one for each, or one for all",
        code="shape",
    )


def _correlates(
    model: Model, colours: NDArray[np.float64], conditions: ViewingConditions, **settings: Any
) -> list[Row]:
    """Return a row of correlates for each XYZ."""
    import numpy as np

    from volspec.appearance import composition

    look: Appearance = model.forward(colours, conditions, **settings)
    names = *"JChHQMs", "Q_WB", "L_N", "J_HK", *_COMPONENTS
    correlates = {name: getattr(look, name) for name in names}
    columns = {name: np.asarray(v).tolist() for name, v in correlates.items() if v is not None}
    rows: list[Row] = [
        {name: column[i] for name, column in columns.items()} for i in range(len(colours))
    ]
    for i, row in enumerate(rows):
        if "H" in row:
            has_hue = math.isfinite(row["H"]) and row["C"] >= _MIN_CHROMA
            row["composition"] = str(composition(row["H"])) if has_hue else ""
        row["defined"] = bool(look.defined[i])
    return rows


def _colours(
    model: Model, looks: NDArray[np.float64], conditions: ViewingConditions, **settings: Any
) -> list[Row]:
    """Return a row with the XYZ of each J, C, h."""
    J, C, h = looks.T
    back = model.inverse(J, C, h, conditions, **settings).tolist()
    return [
        {**dict(zip(XYZ, row, strict=True)), "defined": all(map(math.isfinite, row))}
        for row in back
    ]


def write_comparison(
    image: Path,
    white: str,
    models: Sequence[str] | None,
    options: PictureOptions,
    output: Path,
    inputs: ModelOptions = _MODELS,
) -> None:
    """Write a contact sheet of an image under a light as a PNG; default: all models.

    Options left out have the defaults of `volspec.Viewing`, not the values of the image's scene.
    """
    from volspec import __version__
    from volspec._files import require_suffix, require_writable
    from volspec.appearance import MODELS
    from volspec.export import SheetTile, comparison_sheet, write_frame
    from volspec.image import CoefficientImage
    from volspec.pipeline import Relighter
    from volspec.relight import RelightSpec
    from volspec.spectra import light
    from volspec.spectra.library import sent_name

    require_image(image, "cast it first: volspec render {file} -o IMAGE.exr")
    require_suffix(output, "pictures", ".png")
    require_writable(output)
    if parse_triple(white) is not None:
        raise InputError(
            f"--white {white} with --image: a picture needs the light's spectrum; name a light, "
            "such as A, planck:3200 or FILE.csv"
        )
    viewing = inputs.onto(options.onto(RelightSpec()).viewing)
    names: Sequence[Any] = models or MODELS
    with in_options():
        looks = [replace(viewing, model=name) for name in names]
    stored = CoefficientImage.load(image)
    lamp = light(white, stored.basis.grid)
    with Relighter(stored) as relighter:
        tiles = [
            SheetTile(look.model, NOTES[look.model], relighter.frame(lamp, look)) for look in looks
        ]
    words = [f"{image.stem} under {sent_name(white)}", f"{viewing.illuminance_lux:g} lx"]
    if viewing.L_A is not None:
        words[1] = f"L_A {viewing.L_A:g} cd/m²"
    space = looks[0].display.colours
    words += [part for part in (options.preset, space.name) if part not in (None, "sRGB")]
    sheet = comparison_sheet(", ".join(words), tiles, columns=4)
    notes = {"light": sent_name(white), "Software": f"volspec {__version__}"}
    write_frame(output, sheet, notes, space)
    say(output)


# A note on each model, printed below its picture.
NOTES = {
    "CIECAM02": "appearance, CIE 159:2004",
    "CAM16": "CIECAM02 corrected for saturated lights",
    "CIELAB": "von Kries on XYZ",
    "RLAB": "for cross-media reproduction",
    "Hunt": "the most complete model, 1995",
    "Nayatani95": "for judging lights",
    "Hellwig2022": "CAM16 with simpler chroma",
    "ZCAM": "high dynamic range, 2021",
    "none": "no adaptation",
    "von Kries": "adaptation of the cones",
    "Bradford": "as ICC profiles adapt",
    "Sharp": "on sharpened responses",
    "CAT02": "CIECAM02's adaptation alone",
    "CAT16": "CAM16's adaptation alone",
    "Nayatani": "nonlinear, 1982",
    "CIE 1994": "Nayatani with a factor K",
    "Guth": "ATD, gains from trolands",
    "Fairchild 1990": "incomplete, with cross terms",
}
