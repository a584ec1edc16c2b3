"""Write palettes: as an update of the source that keeps its comments and order, or as a new file.

Palette | Design -> [storage] -> TOML
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volspec._files import line_end, require_suffix, write_whole
from volspec._toml import set_key
from volspec.appearance.display import is_profile
from volspec.basis import shipped_names
from volspec.errors import PaletteError, visible
from volspec.palette.file import palette_file, palette_text
from volspec.palette.model import Cell, Palette, hexadecimal, parse_colour
from volspec.palette.optimisation import Design
from volspec.palette.variables import SHARE_DECIMALS, PaletteSpectrum, fault, is_named
from volspec.settings import plain
from volspec.spectra import Spectrum, light, stack
from volspec.spectra.files import rebase_address, rebase_path
from volspec.spectra.library import rebase_light

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

_DECIMALS = 6


def save_palette(
    palette: Palette | Design,
    path: str | os.PathLike[str],
    source: str | os.PathLike[str] | None = None,
    *,
    comment: str = "",
) -> None:
    """Write a palette, designed or not, atomically.

    Parameters
    ----------
    palette : Palette or Design
    path : path
        A ``.toml``. Its spectra can then be used as ``FILE.toml#name``.
    source : path, optional
        File that the palette was loaded from: its text and comments are kept, designed values are
        added, and names of files become relative to the new folder. By default the file is new
        and contains the values of every spectrum.
    comment : str, optional
        First line of a new file.

    Raises
    ------
    PaletteError
        If the name is not ``.toml``, the source has different spectra, or the file format cannot
        express the viewing or the basis.
    """
    target = require_suffix(path, "palettes", ".toml", error=PaletteError)
    palette = palette.palette if isinstance(palette, Design) else palette
    if source is None:
        document, ends = _new_document(palette, comment), "\n"
    else:
        document, ends = _filled_source(palette, Path(source), target), line_end(source)
    with write_whole(target) as temporary:
        temporary.write_text(document.as_string(), encoding="utf-8", newline=ends)


def _filled_source(palette: Palette, source: Path, target: Path) -> TOMLDocument:
    """Return the source with designed values, and its file names relative to the target."""
    import tomlkit

    table = palette_file(source)
    document: Any = tomlkit.parse(palette_text(source))
    folders = source.parent, target.parent
    elsewhere = folders[0].resolve() != folders[1].resolve()
    for kind, members in (("light", palette.lights), ("reflectance", palette.reflectances)):
        rows = getattr(table, kind)
        names = [row.name for row in rows]
        if names != [member.name for member in members]:
            text = ", ".join(member.name for member in members)
            problem = f"{source}: its {kind}s are {', '.join(names)}, but the palette's are {text}"
            raise fault("source", f"{problem}; give the palette's own file", given=source)
        for entry, member in zip(document[kind], members, strict=True):
            if elsewhere and "spectrum" in entry:
                move = rebase_light if kind == "light" else rebase_address
                entry["spectrum"] = move(str(entry["spectrum"]), *folders)
            if elsewhere and "mixture" in entry:
                entry["mixture"] = [rebase_light(str(lamp), *folders) for lamp in entry["mixture"]]
            if member.free:
                if "design" not in entry:
                    set_key(entry, "design", True)
                if fractions := _fractions(member, palette):
                    set_key(entry, "shares", fractions)
                if member.spectrum is not None:
                    set_key(entry, "values", _values(member, palette))
    space = document.get("viewing", {}).get("display", {}).get("space")
    if elsewhere and isinstance(space, str) and is_profile(space):
        document["viewing"]["display"]["space"] = rebase_path(space, *folders)
    if palette.apart != table.apart:
        document["apart"] = _table_array([plain(row) for row in palette.apart])
    if table.auto_exposure:
        document["viewing"]["exposure"] = float(f"{palette.viewing.exposure:.6g}")
    if (basis := table.criteria.basis) and basis.endswith(".json"):
        document["criteria"]["basis"] = rebase_path(basis, *folders)
    return document


def _values(member: PaletteSpectrum, palette: Palette) -> list[float]:
    """Return a spectrum on the palette's bands; for lights, 1 is the equal-energy light."""
    assert member.spectrum is not None
    values = stack(member.spectrum, palette.grid)
    return [float(value) + 0.0 for value in values.round(_DECIMALS)]  # never -0


def _fractions(member: PaletteSpectrum, palette: Palette) -> list[float]:
    return [round(fraction, SHARE_DECIMALS) for fraction in member.lamp_shares(palette.grid)]


def _new_document(palette: Palette, comment: str) -> TOMLDocument:
    import tomlkit

    document = tomlkit.document()
    if comment:
        document.add(tomlkit.comment(visible(comment)))
    document["viewing"] = _viewing_keys(palette)
    document["criteria"] = _criteria_keys(palette)
    for kind, members in (("light", palette.lights), ("reflectance", palette.reflectances)):
        document[kind] = _table_array([_spectrum_keys(member, palette) for member in members])
    cells = [{"at": list(place), **dict(_cell_keys(cell))} for place, cell in palette.cells.items()]
    document["cell"] = _table_array(cells)
    if palette.apart:
        document["apart"] = _table_array([plain(row) for row in palette.apart])
    for kind in ("light", "reflectance"):
        for entry in document[kind]:
            if "values" in entry:
                set_key(entry, "values", entry["values"])
    return document


def _table_array(rows: Sequence[dict[str, Any]]) -> Any:
    import tomlkit

    array = tomlkit.aot()
    for row in rows:
        table = tomlkit.table()
        table.update(row)
        array.append(table)
    return array


def _viewing_keys(palette: Palette) -> dict[str, Any]:
    viewing = palette.viewing
    if viewing.is_measured or viewing.fov_deg is not None:
        problem = "it adapts to a picture, but a palette has none; give fixed conditions"
        raise fault("Palette.viewing", problem, "unsupported")
    # Designs compare colours before a simulation.
    normal = replace(viewing, deficiency="none", severity=1.0)
    return {"model": viewing.model, **plain(normal)}


def _criteria_keys(palette: Palette) -> dict[str, Any]:
    criteria, grid = palette.criteria, palette.grid
    keys = {
        name: getattr(criteria, name) for name in ("smoothness", "subspace", "metric", "rounds")
    }
    keys |= {"level": palette.level, "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm]}
    if palette.basis is not None:
        if palette.basis.name not in shipped_names():
            name = palette.basis.name
            remedy = "save it, name its file in a palette's [criteria], and give that as source"
            raise fault("Palette.basis", f"{name!r} is not built in; {remedy}", "unsupported", name)
        keys["basis"] = palette.basis.name
    return keys


def _spectrum_keys(member: PaletteSpectrum, palette: Palette) -> dict[str, Any]:
    keys: dict[str, Any] = {"name": member.name}
    if member.free:
        keys["design"] = True
        for name in ("lower", "upper"):
            bound = getattr(member, name)
            keys[name] = "none" if bound is None else bound
        if member.band_nm is not None:
            keys["band_nm"] = list(member.band_nm)
        if member.mixture:
            keys["mixture"] = [_lamp(lamp, palette) for lamp in member.mixture]
            if fractions := _fractions(member, palette):
                keys["shares"] = fractions
        if member.constant:
            keys["constant"] = True
    if member.spectrum is not None:
        keys["values"] = _values(member, palette)
    return keys


def _lamp(lamp: Spectrum, palette: Palette) -> str:
    """Return the name that finds a mixture's lamp when the file is loaded."""
    if is_named(lamp, light, palette.grid):
        return lamp.name
    problem = f"the lamp {lamp.name!r} is not the light of that name"
    remedy = "save it as a file and load it from there: volspec.light('FILE.csv')"
    raise fault("PaletteSpectrum.mixture", f"{problem}; {remedy}", "unknown", lamp.name)


def _cell_keys(cell: Cell) -> Iterator[tuple[str, Any]]:
    if cell.kind == "colour":
        yield "colour", _colour_value(cell.colour)
    elif cell.kind == "black":
        yield "black", True
    elif cell.kind == "free":
        yield "free", cell.group
        yield "low", _colour_value(cell.low)
        yield "high", _colour_value(cell.high)
    else:
        yield cell.kind, list(cell.other or ())
    if cell.kind == "distinct":
        yield "distance", cell.distance
    if math.isinf(cell.weight):
        yield "must", True
    elif cell.weight != 1.0:
        yield "weight", cell.weight


def _colour_value(codes: Any) -> str | list[float]:
    """Return display codes as hexadecimal if exact, else as numbers."""
    text = hexadecimal(codes)
    return text if parse_colour(text) == tuple(codes) else list(codes)
