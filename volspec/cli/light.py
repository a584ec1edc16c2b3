"""``volspec light``: colour, lumens and colour rendition of a light, and the lux of a lamp."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.table import Table

from volspec._files import require_suffix, require_writable
from volspec.cli.shell import Json, Row, app, as_written, print_json, print_table, say
from volspec.cli.viewing import in_options
from volspec.errors import InputError, VolspecWarning

if TYPE_CHECKING:
    from volspec.appearance.comparison import LightFigures

_FIGURES = (".png", ".pdf", ".svg")
_LAMP = {"power_W": "--power-W", "distance_m": "--distance-m", "beam_deg": "--beam-deg"}


@app.command
def light(
    spectrum: str | None = None,
    /,
    *,
    listed: Annotated[bool, Parameter(name="--list", negative="")] = False,
    power_W: Annotated[
        float | None, Parameter(name="--power-W", converter=as_written, help="A lamp's power, W.")
    ] = None,
    distance_m: Annotated[
        float | None, Parameter(converter=as_written, help="Distance of a lamp, metres.")
    ] = None,
    beam_deg: Annotated[
        float | None,
        Parameter(converter=as_written, help="Full angle of a spotlight; default: all around."),
    ] = None,
    against: str | None = None,
    pair: Annotated[tuple[str, str] | None, Parameter(negative="")] = None,
    figure: Path | None = None,
    json: Json = False,
) -> None:
    """Print a light's colour, lumens and colour rendition; for a lamp, the lux at a distance.

    Computed for the 2 degree observer over 360 to 830 nm; the efficacy counts the power radiated
    from 380 to 780 nm, exactly. R_a and R_9 are of CIE 13.3, R_f of CIE 224 and ANSI/IES TM-30-18,
    R_g of TM-30, and SSI of SMPTE ST 2122, by default against the Planck radiator (below 4000 K) or
    the daylight of the same temperature.

    Example: `volspec light D65*0.7+A*0.3`

    Example: `volspec light lamp:tungsten-2850 --power-W 100 --distance-m 2 --beam-deg 60`

    Example: `volspec light LED-B3 --against D65 --figure led.png`

    Example: `volspec light A --pair spectra.csv#paint spectra.csv#cloth`

    Example: `volspec light sodium`

    Example: `volspec light --list LED`

    JSON: `R` has R_1 to R_14; `R_f_samples` the 99 of CIE 224; `R_f_hue`, `R_cs_hue` (a fraction)
    and `R_hs_hue` (radians) the 16 hue bins of TM-30; `metamerism` the figures of `--pair`.

    Parameters
    ----------
    spectrum
        A LIGHT: D65, tungsten, planck:3200, lamp:halogen-3000, FILE.csv, a mix, …; with `--list`,
        words to search for.
    listed
        Print names and descriptions of lights instead: those that have the words, or all.
    against
        A LIGHT, the reference of the spectral similarity index; with `--pair`, that under which the
        two are alike.
    pair
        Two reflectances that are alike under D65, or under `--against`: their differences if the
        light changes to SPECTRUM, and for other observers.
    figure
        Figure of the colour vector graphic to write: .png, .pdf or .svg.
    """
    from volspec.appearance.comparison import RENDITION_GRID, light_figures
    from volspec.spectra import light as find
    from volspec.spectra.library import (
        LAMP,
        LAMPS,
        describe_light,
        flux_lm,
        lamp_for_light,
        lamp_illuminance_lux,
        library_names,
    )

    for name, value, other, its in (
        ("--beam-deg", beam_deg, "--distance-m", distance_m),
        ("--distance-m", distance_m, "--power-W", power_W),
    ):
        if value is not None and its is None:
            raise InputError(f"{name} {value:g} without {other}; give both for a lamp's lux")
    if listed:
        _list(spectrum or "", json)
        return
    if spectrum is None:
        raise InputError("no light; give one, such as D65, or --list for all names")
    if figure is not None:
        require_suffix(figure, "figures", *_FIGURES)
        require_writable(figure)
    tested = find(spectrum, RENDITION_GRID)
    with warnings.catch_warnings():
        # A file that ends within the range is mentioned above; its end values continue.
        warnings.simplefilter("ignore", VolspecWarning)
        # Of a pair, it is the light under which the two are alike.
        similar_to = None if pair else against
        measured = light_figures(lambda grid: find(spectrum, grid), similar_to)
        metameric = _metamerism(pair, against or "D65", spectrum) if pair else {}
        if figure is not None:
            _draw(measured, spectrum, similar_to, figure)
    if similar_to and measured.similarity is None:
        problem = f"{tested.name} has no power from 375 to 675 nm, which SSI compares"
        raise InputError(f"--against: {problem}; leave it out")
    X, Y, Z = measured.white_XYZ.tolist()
    near = measured.temperature
    lamp = LAMPS.get(tested.name.removeprefix(f"{LAMP}:"))
    row: Row = {
        "light": tested.name,
        "description": describe_light(tested.name) if tested.name in library_names() else None,
        "x": X / (X + Y + Z),
        "y": Y / (X + Y + Z),
        "X": X,
        "Y": Y,
        "Z": Z,
        "kelvin": near and near.kelvin,
        "Duv": near and near.Duv,
        "radiation_lm_per_W": measured.lm_per_W,
        "lamp_lm_per_W": lamp and lamp.efficacy_lm_per_W,
    }
    row |= _rendition(measured) | metameric
    with in_options(_LAMP):
        if power_W is not None:
            row |= {"power_W": power_W, "flux_lm": flux_lm(lamp_for_light(tested.name), power_W)}
        if power_W is not None and distance_m is not None:
            lux = lamp_illuminance_lux(lamp_for_light(tested.name), power_W, distance_m, beam_deg)
            row |= {"distance_m": distance_m, "beam_deg": beam_deg, "illuminance_lux": lux}
    if json:
        print_json(row)
    else:
        print_table(row["light"], _table(row))
        if figure is not None:
            say(figure)


def _rendition(measured: LightFigures) -> Row:
    """Return the figures of a light's colour rendition, None without a reference."""
    rendition = measured.rendition
    row: Row = {"R_a": rendition and rendition.R_a, "R_9": rendition and float(rendition.R[8])}
    row |= {"R": rendition and rendition.R.tolist(), "near_white": rendition and rendition.is_white}
    row |= {"R_f": rendition and rendition.R_f, "R_g": rendition and rendition.R_g}
    row |= {"R_f_samples": rendition and rendition.fidelity.tolist()}
    row |= {"R_f_hue": rendition and rendition.hue_fidelity.tolist()}
    row |= {"R_cs_hue": rendition and rendition.chroma_shift.tolist()}
    row |= {"R_hs_hue": rendition and rendition.hue_shift.tolist()}
    return row | {"SSI": measured.similarity, "SSI_reference": measured.reference or None}


def _draw(measured: LightFigures, spectrum: str, against: str | None, figure: Path) -> None:
    """Write the figure of a light and what it is compared with."""
    from volspec.appearance.comparison import RENDITION_GRID, rendition_reference
    from volspec.basis import save_light_figure
    from volspec.spectra import light as find

    tested, rendition = find(spectrum, RENDITION_GRID), measured.rendition
    if rendition is None:
        problem = f"{tested.name} has no correlated temperature, and so no reference to draw"
        raise InputError(f"--figure: {problem}; give a light nearer to white")
    kelvin = rendition.temperature.kelvin
    other = find(against, RENDITION_GRID) if against else rendition_reference(kelvin)
    similar = measured.similarity
    facts = "" if similar is None else f"SSI {similar:.0f} against {measured.reference}"
    save_light_figure(tested, other, rendition, figure, facts)


def _metamerism(pair: tuple[str, str], reference: str, test: str) -> Row:
    """Return the metamerism of two reflectances that are alike under a reference light."""
    from volspec.appearance.comparison import RENDITION_GRID, metamerism
    from volspec.spectra import light as find
    from volspec.spectra import reflectance

    one, other = (reflectance(name, RENDITION_GRID) for name in pair)
    figures = metamerism(one, other, *(find(name, RENDITION_GRID) for name in (reference, test)))
    row = {
        "reflectances": list(pair),
        "reference": reference,
        "delta_E": figures.delta_E,
        "general": figures.general,
        "change_in_illuminant": figures.illuminant,
        "change_in_observer": {str(observer): d for observer, d in figures.observers.items()},
    }
    return {"metamerism": row}


def _list(text: str, as_json: bool) -> None:
    """Print the library's lights whose name or description has the words of a text.

    Raises `InputError` if there is none.
    """
    from volspec.spectra.library import describe_light, nearest_light, search_lights

    rows = [{"name": name, "description": describe_light(name)} for name in search_lights(text)]
    if not rows:
        raise InputError(
            f"--list {text!r}: no light has it in its name or description; {nearest_light(text)}"
            "leave it out to see all",
            code="unknown",
        )
    if as_json:
        print_json(rows)
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        say(f"{row['name']:{width}}  {row['description']}")


def _table(row: Row) -> Table:
    """Return the table of values, with a line for each that is known."""
    table = Table(box=None, show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    near = "none between 1000 and 100 000 K"
    if row["kelvin"] is not None:
        near = f"{row['kelvin']:.0f} K, Duv {round(row['Duv'], 4) + 0.0:+.4f}"  # never -0
    lines = {} if row["description"] is None else {"description": row["description"]}
    lines |= {
        "chromaticity x, y": f"{row['x']:.4f}, {row['y']:.4f}",
        "white X, Y, Z": f"{row['X']:.2f}, {row['Y']:.2f}, {row['Z']:.2f}",
        "correlated temperature": near,
        "efficacy of radiation": f"{row['radiation_lm_per_W']:.1f} lm/W",
    }
    if row["R_a"] is not None:
        far = "" if row["near_white"] else "; Duv is beyond CIE 13.3's ±0.0054"
        lines["colour rendering"] = f"R_a {row['R_a']:.0f}, R_9 {row['R_9']:.0f}{far}"
        lines["fidelity, gamut"] = f"R_f {row['R_f']:.0f}, R_g {row['R_g']:.0f}"
    if row["SSI"] is not None:
        lines["spectral similarity"] = f"SSI {row['SSI']:.0f} against {row['SSI_reference']}"
    if "metamerism" in row:
        lines |= _metameric_lines(row["metamerism"], row["light"])
    if row["lamp_lm_per_W"] is not None:
        lines["efficacy of the lamp"] = f"{row['lamp_lm_per_W']:g} lm/W"
    if "flux_lm" in row:
        lines[f"flux at {row['power_W']:g} W"] = f"{row['flux_lm']:.4g} lm"
    if "illuminance_lux" in row:
        beam = "" if row["beam_deg"] is None else f", within {row['beam_deg']:g}°"
        lines[f"at {row['distance_m']:g} m{beam}"] = f"{row['illuminance_lux']:.4g} lx"
    for label, words in lines.items():
        table.add_row(label, words)
    return table


def _metameric_lines(of: Row, test: str) -> dict[str, str]:
    """Return lines on two reflectances, which are metamers only if they are alike."""
    unlike = ", not alike" if of["delta_E"] > 1.0 else ""
    differences = ", ".join(f"{deg}° {d:.2f}" for deg, d in of["change_in_observer"].items())
    return {
        "pair": ", ".join(of["reflectances"]),
        f"under {of['reference']}": f"ΔE00 {of['delta_E']:.2f}{unlike}, general metamerism "
        f"{of['general']:.4f}",
        "change in illuminant": f"ΔE00 {of['change_in_illuminant']:.2f} under {test}",
        "change in observer": f"ΔE00 {differences}",
    }
