"""Spectra of a palette file, by the address ``PALETTE.toml#name``.

    TOML -> [palettes] -> files, lights, reflectances

The rest of the file is read by `volspec.palette`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from volspec._parse import parse_toml, toml_remedy
from volspec.errors import SpectrumError, nearest
from volspec.spectra.files.tables import file_content, fold_name
from volspec.spectra.grid import SpectralGrid, grid_of_values
from volspec.spectra.spectrum import Spectrum

SUFFIX = ".toml"
_NOTE = {"designed": "volspec design"}


def palette_spectrum(path: str, selector: str, role: str | None) -> Spectrum:
    """Return a spectrum with values in a palette file, usually a designed one.

    ``selector`` is a name in any case, or a number from 1; without a role (light, reflectance) both
    are searched. Raises SpectrumError if there is no such name, or it is not designed yet.
    """
    data, entry = _entry(path, selector, role)
    name = str(entry["name"])
    if "values" not in entry:
        if isinstance(target := entry.get("spectrum"), str) and not entry.get("design"):
            raise SpectrumError(
                f"{path}: {name!r} has no values of its own, only the name {target!r}",
                code="missing",
            )
        raise SpectrumError(
            f"{path}: {name!r} is open and not designed yet; run volspec design {Path(path).name} "
            "-o OUT.toml first, and use OUT.toml",
            code="missing",
        )
    grid = _grid(path, data, entry["values"])
    try:
        designed = entry.get("design", False) is True
        return Spectrum(
            grid.wavelengths_nm,
            entry["values"],
            f"{Path(path).stem}#{name}",
            _NOTE if designed else {},
        )
    except SpectrumError as error:
        raise SpectrumError(
            f"{path}: {name!r}: {error}; put its values on [criteria] grid_nm, {grid}",
            code=error.code,
        ) from None


def named_spectrum(path: str, selector: str, role: str) -> str | None:
    """Return the name by which a palette gives a spectrum, such as ``D65``; None if by values.

    Raises SpectrumError if the palette has no such spectrum.
    """
    _, entry = _entry(path, selector, role)
    target = entry.get("spectrum")
    if "values" in entry or entry.get("design") or not isinstance(target, str):
        return None
    if Path(path).name in target:
        raise SpectrumError(
            f"{path}: {entry['name']!r} refers to itself, {target!r}; name another", code="conflict"
        )
    return target


def palette_holds(path: str, selector: str, role: str) -> bool:
    """Return True if a file is a palette with a spectrum of that name."""
    if Path(path).suffix.lower() != SUFFIX:
        return False
    try:
        _entry(path, selector, role)
    except SpectrumError:
        return False
    return True


def _entry(path: str, selector: str, role: str | None) -> tuple[dict[str, Any], dict[str, Any]]:
    data = _content(path)
    roles = (role,) if role else ("light", "reflectance")
    rows = [row for kind in roles for row in _rows(data, kind)]
    names = [str(row["name"]) for row in rows]
    noun = role or "light or reflectance"
    if not names:
        raise SpectrumError(
            f"{path}: has no {noun}; add [[{role or 'light'}]] tables", code="missing"
        )
    if not selector:
        raise SpectrumError(
            f"{path}: is a palette; choose a {noun}: {Path(path).name}#{names[0]} "
            f"(the palette has {', '.join(names)})",
            code="missing",
        )
    folded = fold_name(selector)
    matches = [row for row, name in zip(rows, names, strict=True) if fold_name(name) == folded]
    if not matches and selector.isdecimal() and 1 <= int(selector) <= len(rows):
        matches = [rows[int(selector) - 1]]
    if len(matches) == 1:
        return data, matches[0]
    if matches:
        raise SpectrumError(
            f"{path}: {len(matches)} spectra are named {selector!r}; rename one", code="duplicate"
        )
    raise SpectrumError(
        f"{path}: no {noun} is named {selector!r}; {nearest(selector, names)}"
        f"the palette has {', '.join(names)}",
        code="unknown",
    )


def _content(path: str) -> dict[str, Any]:
    content = file_content(path)
    try:
        return parse_toml(content.decode("utf-8-sig"))
    except ValueError as error:  # not TOML, or not text
        remedy = toml_remedy(error, content.decode("utf-8-sig", "replace"))
        raise SpectrumError(f"{path}: not valid TOML: {error}", remedy, code="syntax") from None


def _rows(data: dict[str, Any], role: str) -> list[dict[str, Any]]:
    rows = data.get(role, [])
    tables = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return [row for row in tables if isinstance(row.get("name"), str)]


def _grid(path: str, data: dict[str, Any], values: Any) -> SpectralGrid:
    criteria = data.get("criteria")
    numbers = criteria.get("grid_nm") if isinstance(criteria, dict) else None
    if numbers is None:
        return grid_of_values(len(values) if isinstance(values, list) else 0)
    try:
        start, stop, step = (float(number) for number in numbers)
    except (TypeError, ValueError):
        raise SpectrumError.refused(
            f"{path}: [criteria] grid_nm", numbers, "give [start, stop, step] in nm", "type"
        ) from None
    return SpectralGrid(start, stop, step)
