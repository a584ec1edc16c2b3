"""``volspec design`` and ``wizard``: design palettes, and lights and materials for a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from cyclopts import App, Parameter
from rich.table import Table

from volspec._files import require_suffix, require_writable
from volspec.cli.inputs import open_scene
from volspec.cli.shell import Json, Terminal, app, as_written, bar, note, print_json, say
from volspec.cli.viewing import in_options
from volspec.errors import InputError, PaletteError

if TYPE_CHECKING:
    from volspec.appearance.display import DeficiencyName
    from volspec.palette import Palette
    from volspec.scene import Scene
    from volspec.wizard import LightEvaluation, Redesigned


@app.command
def design(
    palette: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    figure: Path | None = None,
    again: Annotated[bool, Parameter(negative="")] = False,
    difference: Annotated[
        Literal["CIEDE2000", "CAM16-UCS"], Parameter(converter=as_written)
    ] = "CIEDE2000",
    apart: Annotated[list[str] | None, Parameter(negative="")] = None,
    under: Annotated[list[str] | None, Parameter(negative="")] = None,
    deficiency: Annotated[list[str] | None, Parameter(negative="")] = None,
    distance: Annotated[float | None, Parameter(converter=as_written)] = None,
    json: Json = False,
) -> None:
    """Design a palette's open lights and reflectances to give the wanted colours.

    A palette whose designed values already meet every cell is kept as it is.

    Example: `volspec design palette.toml -o designed.toml --figure palette.png`

    Example: `volspec design palette.toml --apart vein --apart nerve --deficiency deutan`

    Use the designed spectra as `designed.toml#name` wherever a light or a reflectance is given:
    `volspec relight engine.exr --light "designed.toml#split 1" -o frame.png`.

    JSON: `cells` has a row for each cell: `reflectance`, `light`, `kind`, `wanted` and
    `obtained` display codes, `X`, `Y`, `Z`, `delta_E_2000`, `delta_E_1976`, `delta_E_CAM16`,
    `in_gamut`; besides `metamers` (in `observers` what individual observers see instead of the
    standard one: the fraction to whom a pair is `alike`, below CIEDE2000 1, and `median` and
    `p95`), `spectra` (bands at their bounds), `cost`, `mean`, `max` (of `difference`),
    `suggestions`, and `apart`: of each pair to be distinguished, the CIEDE2000 under each of its
    `lights` and the `smallest`, for normal vision (`none`) and each deficiency.

    Parameters
    ----------
    palette
        A palette (.toml).
    output
        The .toml to write: the palette, with its comments, and the spectra filled in.
    figure
        Figure to write: .png, .svg or .pdf.
    again
        Design on from values that already meet every cell, say, after a change of [criteria].
    difference
        Measure of the report's differences: CIEDE2000, or CAM16-UCS, which also suits large ones.
    apart
        Reflectance to distinguish from the others named so; repeatable, "*" for all. Adds an
        [[apart]] to the palette.
    under
        Light under which to distinguish them; repeatable, all if omitted.
    deficiency
        Colour-vision deficiency with which to distinguish them, too: protan, deutan or tritan;
        repeatable. Without --apart, it is added to the palette's [[apart]].
    distance
        Sufficient ΔE (CIELAB) between them; 20 if omitted.
    """
    from volspec.palette import (
        FIGURE_SUFFIXES,
        DesignReport,
        load_palette,
        palette_file,
        render,
        save_palette,
        save_palette_figure,
        suggestions,
    )
    from volspec.palette import design as solved

    if output is not None:
        require_suffix(output, "palettes", ".toml", error=PaletteError)
        require_writable(output)
    if figure is not None:
        require_suffix(figure, "figures", *FIGURE_SUFFIXES)
        require_writable(figure)
    with bar(quiet=json) as tell:
        tell("design", 0)
        asked = load_palette(palette)
        asked = _with_apart(asked, apart or [], under or [], deficiency or [], distance)
        try:
            result = solved(asked, again=again)
        except InputError as error:
            raise PaletteError(f"{palette}: {str(error).removeprefix('palette: ')}") from error
        tell("design", 1)
        if output is not None:
            save_palette(result, output, source=palette)
        tell("report", 0)
        report = DesignReport.of(result, suggestions(result), difference=difference)
        tell("report", 1)
        if figure is not None:
            tell("draw the figure", 0)
            save_palette_figure(result, figure, report, palette_file(palette).title)
            tell("draw the figure", 1)
    if json:
        print_json(report.to_dict())
        return
    if result.kept:
        note(f"{palette}: its values meet every cell and are kept; --again designs on from them")
    console = Terminal(highlight=False)
    console.print(render(report, colours=console.color_system in ("256", "truecolor")))
    for path in (output, figure):
        if path is not None:
            say(path)


def _with_apart(
    palette: Palette,
    reflectances: list[str],
    lights: list[str],
    deficiencies: list[str],
    distance: float | None,
) -> Palette:
    """Return the palette with the reflectances to distinguish that the options give."""
    from volspec.palette import Apart

    with in_options(_APART):
        if reflectances:
            table: dict[str, Any] = {"reflectance": tuple(reflectances), "light": tuple(lights)}
            table = {
                key: "*" if "*" in names or not names else names for key, names in table.items()
            }
            if distance is not None:
                table["distance"] = distance
            table["deficiency"] = ("none", *deficiencies)
            return replace(palette, apart=(*palette.apart, Apart(**table)))
        for option, value in (("--under", lights), ("--distance", distance)):
            if value:
                raise InputError(
                    f"{option} without --apart; name the reflectances to be distinguished, or "
                    "leave it out",
                    code="conflict",
                )
        if deficiencies and not palette.apart:
            raise InputError(
                f"--deficiency {deficiencies[0]}: the palette has no [[apart]] to add it to; name "
                "the reflectances to be distinguished: --apart",
                code="conflict",
            )
        if not deficiencies:
            return palette
        rows = []
        for row in palette.apart:
            viewers: Any = tuple(dict.fromkeys((*row.deficiencies, *deficiencies)))
            rows.append(replace(row, deficiency=viewers))
        return replace(palette, apart=tuple(rows))


wizard = App(
    name="wizard", help="Hide, reveal, merge or keep materials; writes a new scene and its palette."
)
app.command(wizard)

Output = Annotated[
    Path,
    Parameter(name=["--output", "-o"], help="The new scene; its palette is written next to it."),
]
Under = Annotated[str, Parameter(help="A light of the scene; with --like, the name of a new one.")]
Like = Annotated[
    str | None, Parameter(help="Design a new light, under which the others look as under this one.")
]
Lamps = Annotated[
    list[str] | None,
    Parameter(name="--lamp", negative="", help="Lamp to mix the new light from; repeatable."),
]
# Options by the fields of `volspec.palette.Apart`.
_APART = {
    "apart": "--apart",
    "reflectance": "--apart",
    "light": "--under",
    "deficiency": "--deficiency",
    "distance": "--distance",
}
# Options by the names of their parameters in `volspec.wizard`.
_OPTIONS = {name: f"--{name}" for name in ("under", "distance", "like", "split", "deficiency")} | {
    "within": "--in",
    "lamps": "--lamp",
    "colours": "--colour",
}
# ΔE below which nobody sees a difference, and ΔE that is noticed at a glance.
_UNSEEN, _AT_A_GLANCE = 1.0, 3.0


@wizard.command
def hide(
    scene: str,
    material: str,
    /,
    *,
    under: Under,
    within: Annotated[str | None, Parameter(name="--in")] = None,
    black: Annotated[bool, Parameter(negative="")] = False,
    like: Like = None,
    lamp: Lamps = None,
    output: Output,
    json: Json = False,
) -> None:
    """Make a material look like another material, or black, under a light.

    Under the scene's other lights it keeps its colour as far as possible.

    Example: `volspec wizard hide engine.toml inserts --under A -o hidden.toml`

    Example: `volspec wizard hide engine.toml inserts --under dark --black --like D65 -o dark.toml`

    Parameters
    ----------
    scene
        A scene file.
    material
        The material to hide.
    within
        The material to imitate; default: the one it is embedded in.
    black
        Make it reflect nothing: it disappears against a black backdrop. Needs a new light.
    """
    from volspec.wizard import hide

    loaded = _load_scene(scene, output)
    with in_options(_OPTIONS):
        result = hide(
            *(loaded, material),
            under=under,
            within=within,
            black=black,
            like=like,
            lamps=tuple(lamp or ()),
        )
    _finish(result, output, json)
    dE00 = max(
        max(row.changed.values(), default=0.0) for row in result.evaluations if row.light != under
    )
    if black and like is None and dE00 > _AT_A_GLANCE:
        note(
            f"{material!r} changes by ΔE {dE00:.1f} under other lights, as {under!r} has no gap in "
            "its spectrum to be black in; design a new light: --like"
        )


@wizard.command
def reveal(
    scene: str,
    material: str,
    /,
    *,
    under: Under,
    distance: Annotated[float, Parameter(converter=as_written)] = 20.0,
    like: Like = None,
    lamp: Lamps = None,
    deficiency: Annotated[list[str] | None, Parameter(negative="")] = None,
    output: Output,
    json: Json = False,
) -> None:
    """Make a material stand out from all others under a light.

    Under the scene's other lights it keeps its colour as far as the distance permits.

    Example: `volspec wizard reveal engine.toml inserts --under D65 --distance 15 -o seen.toml`

    Parameters
    ----------
    scene
        A scene file.
    material
        The material to reveal.
    distance
        CIEDE2000 to reach from every other material.
    deficiency
        Reach it to viewers with this colour-vision deficiency, too: protan, deutan or tritan;
        repeatable.
    """
    from volspec.wizard import evaluate_lights, reveal

    loaded, viewers = _load_scene(scene, output), deficiency or []
    with in_options(_OPTIONS):
        result = reveal(
            *(loaded, material),
            under=under,
            distance=distance,
            like=like,
            lamps=tuple(lamp or ()),
            deficiency=cast("list[DeficiencyName]", viewers),  # checked there
        )
    _finish(result, output, json)
    rows = evaluate_lights(loaded, loaded, (material,))
    before = next((row for row in rows if row.light == under), None)
    if before is not None and (smallest := min(before.apart.values())) >= distance:
        note(
            f"{material!r} was already ΔE {smallest:.1f} or more from every other under {under!r}, "
            f"and --distance is {distance:g}; raise it to set it further apart"
        )


@wizard.command
def merge(
    scene: str,
    /,
    *materials: str,
    under: Annotated[str, Parameter(help="The light of the scene under which they match.")],
    split: str | None = None,
    colour: Annotated[list[str] | None, Parameter(negative="")] = None,
    average: Annotated[bool, Parameter(negative="")] = False,
    lamp: Lamps = None,
    output: Output,
    json: Json = False,
) -> None:
    """Give materials the same colour under a light, and different colours under a new one.

    Example: `volspec wizard merge engine.toml block inserts --under D65 --split apart -o two.toml`

    Parameters
    ----------
    scene
        A scene file.
    materials
        Two or more.
    split
        Name of a new light that separates them.
    colour
        Colours under the new light, one each: #rrggbb or a CSS name; default: distant hues.
    average
        Use the mean of their colours as the shared one; by default the solver chooses it.
    """
    from volspec.palette import parse_colour
    from volspec.wizard import merge

    colours = [parse_colour(text) for text in colour or ()]
    with in_options(_OPTIONS):
        result = merge(
            *(_load_scene(scene, output), materials),
            under=under,
            split=split,
            colours=colours,
            average=average,
            lamps=tuple(lamp or ()),
        )
    _finish(result, output, json)


@wizard.command
def keep(scene: str, material: str, /, *, output: Output, json: Json = False) -> None:
    """Give a material the same colour under all lights of the scene.

    Prints how far its colour still moves from that under the first light.

    Example: `volspec wizard keep engine.toml block -o constant.toml`

    Parameters
    ----------
    scene
        A scene file.
    material
        The material to keep.
    """
    from volspec.wizard import keep

    _finish(keep(_load_scene(scene, output), material), output, json)


def _load_scene(path: str, output: Path) -> Scene:
    """Load or make the scene; refuse an output that would destroy something before the work."""
    from volspec.wizard import require_output

    scene, _ = open_scene(path)
    require_output(scene, output)
    return scene


def _finish(result: Redesigned, output: Path, json: bool) -> None:
    """Write the new scene and print its colour differences."""
    from volspec.palette import apart_text, mixture_text

    paths = result.save(output)
    if json:
        files = dict(zip(("scene", "palette"), map(str, paths), strict=True))
        print_json(
            files
            | {"lights": [_row(row) for row in result.evaluations], "lamps": result.lamps}
            | {"apart": [pair.to_dict() for pair in result.apart]}
        )
        return
    out = Terminal()
    out.print(_table(result))
    for row in result.evaluations:
        if row.like and row.changed:
            worst = max(row.changed, key=lambda name: row.changed[name])
            out.print(
                f"{row.light} shows the others as {row.like} does, to ΔE "
                f"{row.changed[worst]:.2f} ({worst})",
                highlight=False,
            )
    for pair in result.apart:
        out.print(f"under {apart_text(pair)}", highlight=False)
    if result.lamps:
        mix = mixture_text(result.lamps)
        out.print(f"{result.changes.light} = {mix}, shares of the illuminance", highlight=False)
    if result.changes.exact:
        out.print("cast by its materials, as a basis of its size would blur them", highlight=False)
    say(f"{paths[0]}, {paths[1]}")


def _row(row: LightEvaluation) -> dict[str, object]:
    pairs = [{"materials": list(pair), "delta_e": value} for pair, value in row.apart.items()]
    return {
        "light": row.light,
        "like": row.like,
        "apart": pairs,
        "changed": row.changed,
        "constancy": row.constancy,
    }


def _table(result: Redesigned) -> Table:
    """Return ΔE for each light: between materials, and of each before and after."""
    title = f"ΔE00 in the frames; below {_UNSEEN:g} it is invisible"
    table = Table(title=title, title_justify="left", box=None, header_style="dim")
    table.add_column("light", no_wrap=True)
    pairs: Sequence[tuple[str, str]] = list(result.evaluations[0].apart)
    for one, two in pairs:
        table.add_column(f"{one} – {two}", justify="right")
    for name in result.materials:
        table.add_column(f"{name} before – after", justify="right")
    for name in result.constant:
        table.add_column(f"{name} from {result.evaluations[0].light}", justify="right")
    for row in result.evaluations:
        distances = [f"{row.apart[pair]:.2f}" for pair in pairs]
        changed = ["" if row.like else f"{row.changed[n]:.2f}" for n in result.materials]
        constancy = [f"{row.constancy[name]:.2f}" for name in result.constant]
        table.add_row(row.light, *distances, *changed, *constancy)
    return table
