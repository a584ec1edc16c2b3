"""``volspec room``: the light in a room, and how its surfaces appear there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import Sized, sides
from volspec.cli.shell import Json, Row, app, as_written, bar, say, show_rows
from volspec.cli.viewing import in_options
from volspec.errors import InputError

if TYPE_CHECKING:
    from volspec.room.eye import SurfaceAppearance


@app.command
def room(
    room: Path,
    /,
    *,
    picture: Path | None = None,
    size: Annotated[str, Sized] = "960x720",
    model: str = "CIECAM02",
    white: str | None = None,
    at: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    light: Path | None = None,
    patches: Annotated[int, Parameter(converter=as_written)] = 5000,
    json: Json = False,
) -> None:
    """Compute the light in a room, and the colours that an adapted eye sees there.

    Prints for each surface the lux on it, the appearance in which its colour was chosen (D65,
    2000 lx, on grey), that in the room, and how far apart these are in J, C cos h and C sin h.

    Example: `volspec room data/rooms/beige-tungsten.toml`

    Example: `volspec room data/rooms/beige-tungsten.toml --picture room.png`

    Example: `volspec room data/rooms/study.toml --at 2,2.5,1.2 --light study.csv`

    Parameters
    ----------
    room
        A ROOM.toml: size, surfaces, lights and furniture (docs/rooms.md).
    picture
        Write a picture from the room's eye, too: a PNG.
    size
        WIDTHxHEIGHT of the picture.
    model
        Appearance model of the picture; none is a camera for daylight, as without an adapted eye.
    white
        A surface that the eye takes for white; default: a perfect diffuser.
    at
        Place of a specimen, X,Y,Z in metres.
    light
        Write the light there as a spectrum, FILE.csv, which other commands take as `--light`: the
        mean over the faces of a small cube, W/(m² nm).
    patches
        Triangles, about: more give finer shadows.
    """
    from volspec.appearance.spec import Viewing
    from volspec.room import (
        default_eye,
        load_room,
        look,
        room_picture,
        solve_room,
        surface_appearance,
    )
    from volspec.spectra import illuminance_lux, write_spectrum

    if picture is not None:
        require_suffix(picture, "pictures", ".png")
        require_writable(picture)
    place = None if at is None else _place(at)
    if light is not None:
        require_suffix(light, "spectra", ".csv")
        require_writable(light)
    if (at is None) is not (light is None):
        raise InputError("--at and --light belong together", "give both", code="missing")
    with in_options():
        viewing = Viewing(model=model)  # type: ignore[arg-type]  # the constructor checks it
    found = load_room(room)
    if white is not None:
        found.reflectance(white)
    eye, name = default_eye(found), found.title or room.stem
    with bar(quiet=json) as tell:
        solved = solve_room(found, patches, tell)
        conditions = look(solved, eye, viewing, white)
        if picture is not None:
            from volspec.export.frames import write_frame

            codes = room_picture(solved, eye, conditions, sides(size), progress=tell)
            write_frame(picture, np.rint(255.0 * codes).astype(np.uint8), {"title": name})
        if place is not None and light is not None:
            shone = solved.light_at(place)
            write_spectrum(shone, light)
    rows = [
        _row(surface_appearance(solved, each))
        for each in found.mesh.names
        if found.reflectance(each).any()
    ]
    seen = conditions.viewing
    title = (
        f"{name}: {len(solved.mesh.surface)} patches, error {100 * solved.sampling_error:.2g} %; "
        f"the eye looks at {conditions.surface}: L_A {seen.L_A:.3g} cd/m², Y_b {seen.Y_b:.3g}, "
        f"surround {seen.surround:.2g}"
    )
    show_rows(title, rows, json)
    if json:
        return
    if picture is not None:
        say(picture)
    if light is not None:
        say(f"{light}: {illuminance_lux(shone):.4g} lx at ({at}) m")


def _place(at: str) -> tuple[float, float, float]:
    """Return a place's coordinates."""
    try:
        x, y, z = map(float, at.split(","))
    except ValueError:
        raise InputError.refused(
            "--at", at, "give X,Y,Z in metres, as 2,2.5,1.2", "syntax"
        ) from None
    return x, y, z


def _row(each: SurfaceAppearance) -> Row:
    chosen, seen = each.chosen, each.seen
    return {
        "surface": each.name,
        "lux": each.lux,
        "chosen J": float(chosen.J),
        "chosen C": float(chosen.C),
        "chosen h": float(chosen.h),
        "J": float(seen.J),
        "C": float(seen.C),
        "h": float(seen.h),
        "difference": each.difference,
    }
