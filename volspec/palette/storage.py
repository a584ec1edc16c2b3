"""Palettes written: into the text they came from, whose comments and order stay, or anew.

Palette | Design -> [storage] -> TOML
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from volspec._files import line_end, write_whole
from volspec._tables import DisplayTable
from volspec._tables.written import plain
from volspec._toml import put
from volspec.basis.storage import shipped_names
from volspec.errors import PaletteError, SpectrumError, visible
from volspec.palette.colours import hexadecimal, parsed_colour
from volspec.palette.file import palette_table, palette_text
from volspec.palette.members import PaletteSpectrum
from volspec.palette.model import Cell, Palette
from volspec.palette.solve import Design
from volspec.palette.tables import ViewingTable
from volspec.spectra import Spectrum, light
from volspec.spectra.files import rebase_address, rebase_path
from volspec.spectra.lights import rebase_light
from volspec.spectra.spectrum import stack

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
    """Write a palette, designed or not; whole or not at all.

    Parameters
    ----------
    palette : Palette or Design
    path : path
        A ``.toml``. Its spectra can then be used as ``FILE.toml#name``.
    source : path, optional
        The file it was loaded from: all that stands in it is kept, comments too, and what was
        designed goes beside it. Files it names are found from the new place as well. Left out,
        the file is written anew, with the values of every spectrum.
    comment : str, optional
        The first line of a file that is written anew.

    Raises
    ------
    PaletteError
        If the name is not ``.toml``, the source holds other spectra, or a viewing or basis has no
        words in a file.
    """
    target = Path(path)
    if target.suffix.lower() != ".toml":
        raise PaletteError(f"{target}: palettes are TOML; name it .toml")
    palette = palette.palette if isinstance(palette, Design) else palette
    if source is None:
        document, ends = _new(palette, comment), "\n"
    else:
        document, ends = _filled(palette, Path(source), target), line_end(source)
    with write_whole(target) as temporary:
        temporary.write_text(document.as_string(), encoding="utf-8", newline=ends)


def _filled(palette: Palette, source: Path, target: Path) -> TOMLDocument:
    import tomlkit

    table = palette_table(source)
    document: Any = tomlkit.parse(palette_text(source))
    folders = source.parent, target.parent
    elsewhere = folders[0].resolve() != folders[1].resolve()
    for kind, members in (("light", palette.lights), ("reflectance", palette.reflectances)):
        rows = getattr(table, kind)
        names = [row.name for row in rows]
        if names != [member.name for member in members]:
            raise PaletteError(
                f"{source}: its {kind}s are {', '.join(names)}, the palette's "
                f"{', '.join(member.name for member in members)}; give the file it came from"
            )
        for entry, member in zip(document[kind], members, strict=True):
            if elsewhere and "spectrum" in entry:
                move = rebase_light if kind == "light" else rebase_address
                entry["spectrum"] = move(str(entry["spectrum"]), *folders)
            if elsewhere and "mixture" in entry:
                entry["mixture"] = [rebase_light(str(lamp), *folders) for lamp in entry["mixture"]]
            if member.open:
                if "design" not in entry:
                    put(entry, "design", True)
                if member.spectrum is not None:
                    put(entry, "values", _values(member, palette))
    if elsewhere and (profile := table.viewing.display.profile):
        document["viewing"]["display"]["space"] = rebase_path(profile, *folders)
    if table.viewing.exposure == "auto":
        document["viewing"]["exposure"] = float(f"{palette.viewing.exposure:.6g}")
    if (basis := table.criteria.basis) and basis.endswith(".json"):
        document["criteria"]["basis"] = rebase_path(basis, *folders)
    return document


def _values(member: PaletteSpectrum, palette: Palette) -> list[float]:
    """A spectrum on the palette's bands; a light as `volspec.light`'s: 1 is an even one's."""
    assert member.spectrum is not None
    values = stack(member.spectrum, palette.grid)
    return [float(value) + 0.0 for value in values.round(_DECIMALS)]  # never -0


def _new(palette: Palette, comment: str) -> TOMLDocument:
    import tomlkit

    document = tomlkit.document()
    if comment:
        document.add(tomlkit.comment(visible(comment)))
    document["viewing"] = _viewing(palette)
    document["criteria"] = _criteria(palette)
    for kind, members in (("light", palette.lights), ("reflectance", palette.reflectances)):
        document[kind] = _array([_member(kind, member, palette) for member in members])
    document["cell"] = _array([{"at": list(at), **_cell(c)} for at, c in palette.cells.items()])
    for kind in ("light", "reflectance"):
        for entry in document[kind]:
            if "values" in entry:
                put(entry, "values", entry["values"])
    return document


def _array(rows: Sequence[dict[str, Any]]) -> Any:
    import tomlkit

    array = tomlkit.aot()
    for row in rows:
        table = tomlkit.table()
        table.update(row)
        array.append(table)
    return array


def _viewing(palette: Palette) -> dict[str, Any]:
    viewing, default = palette.viewing, type(palette.viewing)()
    if viewing.adapting != default.adapting or viewing.fov_deg is not None:
        raise PaletteError("palette: its viewing adapts to pictures, which no palette has")
    names = ("model", "illuminance_lux", "L_A", "Y_b", "surround", "D", "discount", "exposure")
    settings = {name: getattr(viewing, name) for name in names}
    if viewing.display != default.display:
        settings["display"] = DisplayTable.of(viewing.display)
    return {"model": viewing.model, **plain(ViewingTable(**settings))}


def _criteria(palette: Palette) -> dict[str, Any]:
    criteria, grid = palette.criteria, palette.grid
    told = {
        name: getattr(criteria, name) for name in ("smoothness", "subspace", "metric", "rounds")
    }
    told |= {"level": palette.level, "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm]}
    if palette.basis is not None:
        if palette.basis.name not in shipped_names():
            raise PaletteError(
                f"palette: the basis {palette.basis.name!r} does not ship; save it, name the file "
                "in a palette's [criteria], and give that as source"
            )
        told["basis"] = palette.basis.name
    return told


def _member(kind: str, member: PaletteSpectrum, palette: Palette) -> dict[str, Any]:
    told: dict[str, Any] = {"name": member.name}
    if member.open:
        told["design"] = True
        for name in ("lower", "upper"):
            bound = getattr(member, name)
            told[name] = "none" if bound is None else bound
        if member.band_nm is not None:
            told["band_nm"] = list(member.band_nm)
        if member.mixture:
            told["mixture"] = [_lamp(lamp, palette) for lamp in member.mixture]
        if member.constant:
            told["constant"] = True
    if member.spectrum is not None:
        told["values"] = _values(member, palette)
    return told


def _lamp(lamp: Spectrum, palette: Palette) -> str:
    """The name by which a lamp of a mixture is found again."""
    try:
        known = light(lamp.name, palette.grid).values
        shape = stack(lamp, palette.grid)
        if np.allclose(known / known.mean(), shape / shape.mean(), rtol=1e-3, atol=1e-3):
            return lamp.name
    except SpectrumError:
        pass
    raise PaletteError(
        f"palette: the lamp {lamp.name!r} of a mixture is no light of that name; save it as a file "
        "and take it from there: volspec.light('FILE.csv')"
    )


def _cell(cell: Cell) -> dict[str, Any]:
    return dict(_cell_words(cell))


def _cell_words(cell: Cell) -> Iterator[tuple[str, Any]]:
    if cell.kind == "colour":
        yield "colour", _colour(cell.colour)
    elif cell.kind == "black":
        yield "black", True
    elif cell.kind == "free":
        yield "free", cell.group
        yield "low", _colour(cell.low)
        yield "high", _colour(cell.high)
    else:
        yield cell.kind, list(cell.other or ())
    if cell.kind == "distinct":
        yield "distance", cell.distance
    if math.isinf(cell.weight):
        yield "must", True
    elif cell.weight != 1.0:
        yield "weight", cell.weight


def _colour(codes: Any) -> str | list[float]:
    """In hexadecimal where that says it whole."""
    text = hexadecimal(codes)
    return text if parsed_colour(text) == tuple(codes) else list(codes)
