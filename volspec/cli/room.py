"""``volspec room``: the light in a room, and how its surfaces appear there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import Sized, sides
from volspec.cli.shell import Json, Row, app, as_written, bar, note, print_json, say, show_rows
from volspec.cli.viewing import in_options
from volspec.errors import InputError

if TYPE_CHECKING:
    from volspec.appearance import Viewing
    from volspec.appearance.models import Appearance
    from volspec.room import LampRanking, MixingLaw, Room, RoomLight, SurfaceAppearance
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
    "white": "--white",
}


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
    lamp: Annotated[list[str] | None, Parameter(negative="")] = None,
    figure: Path | None = None,
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
        reflectance or #rrggbb. Repeatable.
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
    lamp
        Light to compare: a spectrum of all the room's lights, as bright as they are; LIGHT=SPECTRUM
        is one of them alone, and the spectrum room its own. Repeatable: paints are then ranked
        under each, and by the worst and the mean distance over all.
    figure
        Plot the colours as chosen and as seen, in x, y and in C cos h, C sin h: a PNG, PDF or SVG.
    """
    from volspec.appearance import Viewing
    from volspec.room import (
        Rays,
        RoomResponse,
        default_eye,
        lamp_powers,
        load_room,
        look,
        look_around,
        painted_surfaces,
        rank_paints_by_lamp,
        room_picture,
        save_room_figure,
        seen_triangle,
        solve_room,
    )
    from volspec.spectra import illuminance_lux, write_spectrum

    _require_files(picture, light, figure)
    place = None if at is None else _place(at)
    if (at is None) is not (light is None):
        raise InputError("--at and --light belong together", "give both", code="missing")
    with in_options():
        viewing = Viewing(model=model)  # type: ignore[arg-type]  # the constructor checks it
    loaded = load_room(room)
    powers = lamp_powers(loaded, lamp or ())
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
        lights = {"": solved}
        if lamp:
            response = RoomResponse.of(solved)
            lights = {label: response.under(power) for label, power in powers.items()}
        ranking = None
        if paints is not None:
            with in_options(_OPTIONS):
                ranking = rank_paints_by_lamp(lights, *paints, tell, white)
            [*_, best] = ranking.by_worst[0].by_lamp.values()
            painted = painted_surfaces(loaded, paints[1])
            solved = solved.painted(dict.fromkeys(painted, best.reflectance))
        conditions = look(solved, eye, viewing, white)
        if picture is not None:
            from volspec.export import write_frame

            codes = room_picture(solved, eye, conditions, sides(size), progress=tell)
            write_frame(picture, np.rint(255.0 * codes).astype(np.uint8), {"title": name})
        if place is not None and light is not None:
            shone = solved.light_at(place)
            write_spectrum(shone, light)
    if ranking is not None and paints is not None:
        _show_ranking(f"{name}: {paints[1]}", ranking, json)
        best_by_lamp = {lamp: [p.by_lamp[lamp] for p in ranking.by_worst] for lamp in lights}
        if figure is not None:
            save_room_figure(best_by_lamp, figure)
    else:
        surfaces = _show_surfaces(name, conditions.surface, conditions.viewing, lights, white, json)
        if figure is not None:
            save_room_figure(surfaces, figure)
    if json:
        return
    for path in filter(None, (picture, figure)):
        say(path)
    if light is not None:
        say(f"{light}: {illuminance_lux(shone):.4g} lx at ({at}) m")


def _require_files(picture: Path | None, light: Path | None, figure: Path | None) -> None:
    """Refuse files of other kinds, and those that cannot be written."""
    from volspec.spectra.files import TABLE_SUFFIXES

    files = (picture, "pictures", (".png",)), (light, "spectra", TABLE_SUFFIXES)
    for path, kind, suffixes in (*files, (figure, "figures", (".png", ".pdf", ".svg"))):
        if path is not None:
            require_suffix(path, kind, *suffixes)
            require_writable(path)


def _show_surfaces(
    title: str,
    name: str,
    eye: Viewing,
    lights: Mapping[str, RoomLight],
    white: str | None,
    as_json: bool,
) -> dict[str, list[SurfaceAppearance]]:
    """Print how surfaces appear by lamp; note what was taken for eyes that see no white."""
    from volspec.room import surface_appearance

    [*_, light] = lights.values()
    names = [surface for surface in light.mesh.names if light.room.reflectance(surface).any()]
    looks = {
        lamp: [surface_appearance(lit_room, surface, white) for surface in names]
        for lamp, lit_room in lights.items()
    }
    surfaces = [(lamp, surface) for lamp, seen_there in looks.items() for surface in seen_there]
    notes = {surface.name: surface.conditions.note for _, surface in surfaces}
    for text in dict.fromkeys(filter(None, notes.values())):
        before = ", ".join(surface for surface, other in notes.items() if other == text)
        note(f"{text} (before {before}); --white SURFACE takes another white")
    rows = [({"lamp": lamp} if lamp else {}) | _row(look, as_json) for lamp, look in surfaces]
    text = (
        f"{title}: {len(light.mesh.surface)} patches, error {100 * light.sampling_error:.2g} "
        f"%; the eye looks at {name}: L_A {eye.L_A:.3g} cd/m², "
        f"Y_b {eye.Y_b:.3g}, surround {eye.surround:.2g}"
    )
    show_rows(text, rows, as_json)
    return looks


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
) -> tuple[tuple[Spectrum, ...], str, Appearance, int]:
    """Return paints, surface, wanted look and number; refuse wrong ones before the solution."""
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
    return candidates, surface, appearance, top


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


def _show_ranking(title: str, ranking: LampRanking, as_json: bool) -> None:
    """Print the best paints under each lamp, and over several."""
    facts = {lamp: _ranking_facts(ranking, lamp) for lamp in ranking.by_lamp}
    over: dict[str, list[Row]] = {}
    for key, paints in (("worst", ranking.by_worst), ("mean", ranking.by_mean)):
        over[key] = [
            {"paint": paint.name, "worst": paint.worst, "mean": paint.mean}
            | {lamp: ranked.distance for lamp, ranked in paint.by_lamp.items()}
            for paint in paints
        ]
    if as_json:
        print_json(facts.get("", {"lamps": facts, **over}))
        return
    for lamp, fact in facts.items():
        looks = ", ".join(f"{key} {value:.1f}" for key, value in fact["wanted"].items())
        counts = f"{fact['candidates']} paints, {fact['solved']} of them solved"
        under = f" under {lamp}" if lamp else ""
        show_rows(f"{title}{under}; {counts}; wanted: {looks}", fact["paints"], as_json=False)
    for key, rows in over.items() if len(facts) > 1 else ():
        show_rows(f"{title} under all, by the {key} distance", rows, as_json=False)


def _ranking_facts(ranking: LampRanking, lamp: str) -> dict[str, Any]:
    """Return the ranking under one lamp as JSON has it."""
    under = ranking.by_lamp[lamp]
    rows: list[Row] = [
        {
            "paint": paint.name,
            "distance": paint.distance,
            "lux": paint.lux,
            **_J_C_h(paint.seen),
            **_J_C_h(paint.chosen, "chosen "),
        }
        for paint in under.best
    ]
    return {
        "surfaces": list(under.surfaces),
        "wanted": _J_C_h(under.wanted),
        "candidates": under.candidates,
        "solved": under.solved,
        "greys": under.greys,
        "paints": rows,
    }


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
