"""``volspec light``: colour, temperature and lumens of a light, and the lux of a lamp."""

from __future__ import annotations

import warnings
from typing import Annotated

from cyclopts import Parameter
from rich.table import Table

from volspec.cli.shell import Json, Row, app, as_written, print_json, print_table, say
from volspec.cli.viewing import in_options
from volspec.errors import InputError, VolspecWarning

# nm: bands for the colour, the whole range of the CIE 1931 observer, without which a radiator of
# 7500 K comes out at 7497 K; and bands whose power counts as radiated, 380 to 780 nm exactly.
_COLOUR_NM, _RADIATED_NM = (360.0, 830.0, 1.0), (380.5, 779.5, 1.0)


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
    json: Json = False,
) -> None:
    """Print a light's colour, temperature and lumens; for a lamp, also the lux at a distance.

    Computed for the 2 degree observer over 360 to 830 nm; the efficacy counts the power radiated
    from 380 to 780 nm, exactly.

    Example: `volspec light D65*0.7+A*0.3`

    Example: `volspec light lamp:tungsten-2850 --power-W 100 --distance-m 2 --beam-deg 60`

    Example: `volspec light sodium`

    Example: `volspec light --list LED`

    Parameters
    ----------
    spectrum
        A LIGHT: D65, tungsten, planck:3200, lamp:halogen-3000, FILE.csv, a mix, …; with `--list`,
        words to search for.
    listed
        Print names and descriptions of lights instead: those that have the words, or all.
    """
    from volspec.spectra import SpectralGrid
    from volspec.spectra import light as find
    from volspec.spectra.lamps import (
        LAMPS,
        PREFIX,
        flux_lm,
        lamp_for_light,
        lamp_illuminance_lux,
        lumens_per_watt,
    )
    from volspec.spectra.library import describe_light, library_names
    from volspec.spectra.photometry import correlated_temperature, white_XYZ

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
    found = find(spectrum, SpectralGrid(*_RADIATED_NM))
    with warnings.catch_warnings():
        # A file that ends within the range is mentioned above; its end values continue.
        warnings.simplefilter("ignore", VolspecWarning)
        X, Y, Z = white_XYZ(find(spectrum, SpectralGrid(*_COLOUR_NM))).tolist()
    near = correlated_temperature((X, Y, Z))
    lamp = LAMPS.get(found.name.removeprefix(f"{PREFIX}:"))
    row: Row = {
        "light": found.name,
        "description": describe_light(found.name) if found.name in library_names() else None,
        "x": X / (X + Y + Z),
        "y": Y / (X + Y + Z),
        "X": X,
        "Y": Y,
        "Z": Z,
        "kelvin": near and near.kelvin,
        "Duv": near and near.Duv,
        "radiation_lm_per_W": lumens_per_watt(found),
        "lamp_lm_per_W": lamp and lamp.efficacy_lm_per_W,
    }
    with in_options():
        if power_W is not None:
            row |= {"power_W": power_W, "flux_lm": flux_lm(lamp_for_light(found.name), power_W)}
        if power_W is not None and distance_m is not None:
            lux = lamp_illuminance_lux(lamp_for_light(found.name), power_W, distance_m, beam_deg)
            row |= {"distance_m": distance_m, "beam_deg": beam_deg, "illuminance_lux": lux}
    if json:
        print_json(row)
    else:
        print_table(row["light"], _table(row))


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
