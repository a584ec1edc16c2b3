"""``volspec design``: spectra for wanted colours, as a file, a report and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from volspec._files import require_writable
from volspec.cli.shell import Json, Terminal, app, bar, print_json, say
from volspec.errors import ImageError, InputError, PaletteError


@app.command
def design(
    palette: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    figure: Path | None = None,
    json: Json = False,
) -> None:
    """Design a palette's open lights and reflectances, so that wanted colours meet.

    Example: `volspec design palette.toml -o designed.toml --figure palette.png`

    What was designed is used as `designed.toml#name` wherever a light or a reflectance is:
    `volspec relight engine.exr --light "designed.toml#split 1" -o frame.png`.

    JSON: `cells` holds a row for each place: `reflectance`, `light`, `kind`, `wanted` and
    `obtained` display codes, `X`, `Y`, `Z`, `delta_E_2000`, `delta_E_1976`, `in_gamut`; besides
    `metamers`, `spectra` (bands at their bounds), `cost`, `mean`, `max` (CIEDE2000) and
    `suggestions`.

    Parameters
    ----------
    palette
        A palette (.toml).
    output
        A .toml to write: the palette as it is, comments too, with the spectra filled in.
    figure
        A .png, .svg or .pdf to draw.
    """
    from volspec.palette import DesignReport, load_palette, save_palette, suggestions
    from volspec.palette import design as solved
    from volspec.palette.figure import SUFFIXES, save_palette_figure
    from volspec.palette.file import palette_file
    from volspec.palette.text import render

    if output is not None:
        if output.suffix.lower() != ".toml":
            raise PaletteError(f"{output}: palettes are TOML; name it .toml")
        require_writable(output)
    if figure is not None:
        if figure.suffix.lower() not in SUFFIXES:
            raise ImageError(f"{figure}: figures are {', '.join(SUFFIXES)} files; name it .png")
        require_writable(figure)
    with bar(quiet=json) as tell:
        tell("design", 0)
        asked = load_palette(palette)
        try:
            made = solved(asked)
        except InputError as error:
            raise PaletteError(f"{palette}: {str(error).removeprefix('palette: ')}") from error
        tell("design", 1)
        if output is not None:
            save_palette(made, output, source=palette)
        tell("report", 0)
        report = DesignReport.of(made, suggestions(made))
        tell("report", 1)
        if figure is not None:
            tell("draw the figure", 0)
            save_palette_figure(made, figure, report, palette_file(palette).title)
            tell("draw the figure", 1)
    if json:
        print_json(report.to_dict())
        return
    console = Terminal(highlight=False)
    console.print(render(report, colours=console.color_system in ("256", "truecolor")))
    for path in (output, figure):
        if path is not None:
            say(path)
