"""``volspec room``: the light in a room, and how its surfaces appear there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import Sized, sides
from volspec.cli.shell import Json, Row, app, as_written, bar, note, print_json, say, show_rows
from volspec.cli.viewing import in_options
from volspec.errors import InputError

if TYPE_CHECKING:
    from volspec.appearance.models import Appearance
    from volspec.room import MixingLaw, PaintRanking, Room, RoomLight, SurfaceAppearance
    from volspec.spectra import Spectrum

# Paints are compared in rooms of fewer patches: each of the best takes a solution.
_PATCHES, _PATCHES_OF_PAINTS = 5000, 1500
_OPTIONS = {
    "paint_set": "--paint-set",
    "paints": "--paint-set",
    "reflectance": "--paint-set",
    "surface": "--paint-surface",
    "wanted": "--wanted",
    "step": "--mix",
    "law": "--mix",
}


@dataclass(frozen=True, slots=True)
class _Paints:
    """Paints to rank, and the appearance to reach."""

    candidates: tuple[Spectrum, ...]
    surface: str
    target: Appearance
    top: int


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
    patches: Annotated[int | None, Parameter(converter=as_written)] = None,
    paint_set: Annotated[list[str] | None, Parameter(negative="")] = None,
    paint_surface: str | None = None,
    wanted: str | None = None,
    mix: str | None = None,
    top: Annotated[int | None, Parameter(converter=as_written)] = None,
    json: Json = False,
) -> None:
    """Compute the light in a room, and the colours that an adapted eye sees there.

    Prints for each surface the lux on it, the appearance in which its colour was chosen (D65,
    2000 lx, on grey), that in the room, and how far apart these are in J, C cos h and C sin h.

    Example: `volspec room data/rooms/beige-tungsten.toml`

    With `--paint-set`, ranks paints by how far the surface will look in the room from what is
    wanted; a picture and a light are those of the best.

    Example: `volspec room data/rooms/beige-tungsten.toml --picture room.png`

    Example: `volspec room data/rooms/study.toml --at 2,2.5,1.2 --light study.csv`

    Example: `volspec room data/rooms/study.toml --paint-set natural --wanted "#f0d9b5"`

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
        A surface that the eye takes for white; default: a perfect diffuser in the light on the
        white surfaces that it sees. Of a ranking, the white in place of the painted surface's.
    at
        Place of a specimen, X,Y,Z in metres.
    light
        Write the light there as a spectrum, FILE.csv or FILE.spd, which other commands take as
        `--light`: the mean over the faces of a small cube, W/(m² nm).
    patches
        Triangles, about: more give finer shadows; default: 5000, or 1500 to rank paints.
    paint_set
        Paints to rank: a set (training, test, natural, patches), a part of the library, such as
        ColorChecker, an atlas (FILE.csv with a paint in each column, FILE.ti3, FILE.cxf), or one
        reflectance. Repeatable.
    paint_surface
        The surface that is painted; default: walls, the four.
    wanted
        The colour that it shall have in the room: #rrggbb, a CSS name, X Y Z or a reflectance, as
        seen in an atlas; default: the present paint.
    mix
        STEP, such as 0.25, or STEP,additive: rank all mixtures of the paints in such shares; of
        stirred paints (Kubelka-Munk), or of small areas (additive).
    top
        Number of paints to print; default: 10.
    """
    from volspec.appearance import Viewing
    from volspec.room import (
        Rays,
        default_eye,
        load_room,
        look,
        look_around,
        rank_paints,
        room_picture,
        seen_triangle,
        solve_room,
    )
    from volspec.spectra import illuminance_lux, write_spectrum
    from volspec.spectra.files import TABLE_SUFFIXES

    if picture is not None:
        require_suffix(picture, "pictures", ".png")
        require_writable(picture)
    place = None if at is None else _place(at)
    if light is not None:
        require_suffix(light, "spectra", *TABLE_SUFFIXES)
        require_writable(light)
    if (at is None) is not (light is None):
        raise InputError("--at and --light belong together", "give both", code="missing")
    with in_options():
        viewing = Viewing(model=model)  # type: ignore[arg-type]  # the constructor checks it
    loaded = load_room(room)
    if white is not None:
        loaded.reflectance(white)
    paints = None
    if paint_set:
        with in_options(_OPTIONS):
            paints = _paints(loaded, paint_set, paint_surface, wanted, mix, top)
    else:
        settings = {"paint-surface": paint_surface, "wanted": wanted, "mix": mix, "top": top}
        if alone := [option for option, value in settings.items() if value is not None]:
            raise InputError(f"--{alone[0]} is for ranking paints; give --paint-set, too")
    if patches is None:
        patches = _PATCHES if paints is None else _PATCHES_OF_PAINTS
    eye, name = default_eye(loaded), loaded.title or room.stem
    look_around(loaded)
    seen_triangle(Rays(loaded.mesh), eye)  # refused before the solution
    with bar(quiet=json) as tell:
        solved = solve_room(loaded, patches, tell)
        ranking = None
        if paints is not None:
            wants = paints.surface, paints.target, paints.top
            ranking = rank_paints(solved, paints.candidates, *wants, tell)
            best = ranking.best[0].reflectance
            solved = solved.painted(dict.fromkeys(ranking.surfaces, best))
        conditions = look(solved, eye, viewing, white)
        if picture is not None:
            from volspec.export import write_frame

            codes = room_picture(solved, eye, conditions, sides(size), progress=tell)
            write_frame(picture, np.rint(255.0 * codes).astype(np.uint8), {"title": name})
        if place is not None and light is not None:
            shone = solved.light_at(place)
            write_spectrum(shone, light)
    if ranking is not None and paints is not None:
        _show_ranking(f"{name}: {paints.surface}", ranking, json)
    else:
        rows = [_row(surface, json) for surface in _surfaces(solved, white)]
        eye_viewing = conditions.viewing
        title = (
            f"{name}: {len(solved.mesh.surface)} patches, error {100 * solved.sampling_error:.2g} "
            f"%; the eye looks at {conditions.surface}: L_A {eye_viewing.L_A:.3g} cd/m², "
            f"Y_b {eye_viewing.Y_b:.3g}, surround {eye_viewing.surround:.2g}"
        )
        show_rows(title, rows, json)
    if json:
        return
    if picture is not None:
        say(picture)
    if light is not None:
        say(f"{light}: {illuminance_lux(shone):.4g} lx at ({at}) m")


def _surfaces(solved: RoomLight, white: str | None) -> list[SurfaceAppearance]:
    """Return how the surfaces appear; note what was taken for eyes that see no white."""
    from volspec.room import surface_appearance

    room = solved.room
    names = (name for name in room.mesh.names if room.reflectance(name).any())
    surfaces = [surface_appearance(solved, name, white) for name in names]
    notes = {surface.name: surface.conditions.note for surface in surfaces}
    for text in dict.fromkeys(filter(None, notes.values())):
        names = ", ".join(name for name, other in notes.items() if other == text)
        note(f"{text} (before {names}); --white SURFACE takes another white")
    return surfaces


def _place(text: str) -> tuple[float, float, float]:
    """Return a place's coordinates."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise InputError.refused(
            "--at", text, "give X,Y,Z in metres, as 2,2.5,1.2", "syntax"
        ) from None
    return x, y, z


def _paints(
    room: Room,
    names: list[str],
    surface: str | None,
    target: str | None,
    mix: str | None,
    top: int | None,
) -> _Paints:
    """Return the paints of the options; refuse wrong ones before the room is solved."""
    from volspec.room import (
        mix_paints,
        paint_set,
        painted_surfaces,
        present_appearance,
        require_reflectance,
        wanted_appearance,
    )

    surface = "walls" if surface is None else surface
    painted_surfaces(room, surface)
    if target is None:
        appearance = present_appearance(room, surface)
    else:
        appearance = wanted_appearance(target, room.grid)
    candidates = paint_set(names, room.grid)
    if mix is not None:
        step, law = _parse_mixing(mix)
        candidates = mix_paints(candidates, step, law, room.grid)
    require_reflectance(candidates, [candidate.name for candidate in candidates], room.grid)
    top = 10 if top is None else top
    if top < 1:
        raise InputError.refused("--top", top, "give 1 or more", "range")
    return _Paints(candidates, surface, appearance, top)


def _parse_mixing(text: str) -> tuple[float, MixingLaw]:
    """Return the step and the law of ``STEP`` or ``STEP,LAW``."""
    from volspec.room import MIXING_LAWS

    step, comma, law = (part.strip() for part in text.partition(","))
    laws: dict[str, MixingLaw] = {name: name for name in MIXING_LAWS}
    try:
        return float(step), laws[law] if comma else MIXING_LAWS[0]
    except (ValueError, KeyError):
        remedy = f"write STEP or STEP,LAW, as 0.25,additive; laws: {', '.join(MIXING_LAWS)}"
        raise InputError.refused("--mix", text, remedy, "syntax") from None


def _show_ranking(title: str, ranking: PaintRanking, as_json: bool) -> None:
    target = _J_C_h(ranking.wanted)
    rows: list[Row] = [
        {
            "paint": paint.name,
            "distance": paint.distance,
            "lux": paint.lux,
            **_J_C_h(paint.seen),
            **_J_C_h(paint.chosen, "chosen "),
        }
        for paint in ranking.best
    ]
    if as_json:
        print_json(
            {
                "surfaces": list(ranking.surfaces),
                "wanted": target,
                "candidates": ranking.candidates,
                "solved": ranking.solved,
                "greys": ranking.greys,
                "paints": rows,
            }
        )
        return
    looks = ", ".join(f"{key} {value:.1f}" for key, value in target.items())
    counts = f"{ranking.candidates} paints, {ranking.solved} of them solved"
    show_rows(f"{title}; {counts}; wanted: {looks}", rows, as_json=False)


def _J_C_h(appearance: Appearance, prefix: str = "") -> dict[str, float]:
    """Return lightness, chroma and hue by their columns' names."""
    return {f"{prefix}{key}": float(getattr(appearance, key)) for key in "JCh"}


def _row(surface: SurfaceAppearance, as_json: bool) -> Row:
    """Return a surface's figures; for JSON also a_C, b_C, H, x, y and the eye's conditions."""
    from volspec.appearance import composition

    row: Row = {
        "surface": surface.name,
        "lux": surface.lux,
        **_J_C_h(surface.chosen, "chosen "),
        **_J_C_h(surface.seen),
        "composition": str(composition(surface.seen.H)) if surface.seen.H is not None else "",
        "difference": surface.difference,
    }
    if as_json:
        for prefix, seen, xy in (
            ("chosen ", surface.chosen, surface.chosen_xy),
            ("", surface.seen, surface.seen_xy),
        ):
            angle, C = math.radians(float(seen.h)), float(seen.C)
            row |= {f"{prefix}a_C": C * math.cos(angle), f"{prefix}b_C": C * math.sin(angle)}
            row |= {f"{prefix}x": xy[0], f"{prefix}y": xy[1]}
            row[f"{prefix}H"] = None if seen.H is None else float(seen.H)
        eye = surface.conditions
        row |= {name: getattr(eye.viewing, name) for name in ("L_A", "Y_b", "surround")}
        row |= {"white_XYZ": eye.white_XYZ.tolist(), "L_Aw": eye.L_Aw, "note": eye.note}
    return row
