"""A basis as JSON: in ``data/bases``, a user's file or a coefficient image's header.

StoredBasis <-> [storage] <-> JSON
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from volspec._confine import require_inside
from volspec._files import require_suffix, write_whole
from volspec._gpu import asset
from volspec._parse import parse_json
from volspec.errors import BasisError, SpectrumError, nearest
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, SpectralGrid

FORMAT = "volspec-basis"
FORMAT_VERSION = 1
MATERIALS = "materials"
"""The ``method`` of a `MaterialBasis`; any other belongs to a `SpectralBasis`."""

GRID_ENDINGS = MappingProxyType({DEFAULT_GRID: "", PAPERS_GRID: "-10nm"})
"""Endings of the shipped bases' names by grid."""

_Basis = TypeVar("_Basis")
_MAX_LABEL = 200


def is_material_basis(data: Any) -> bool:
    """Return True if a dictionary describes a `MaterialBasis`."""
    return isinstance(data, dict) and data.get("method") == MATERIALS


def head_from_dict(data: Any, names: Sequence[str]) -> dict[str, Any]:
    """Return the grid and observer of a basis, after checking that the named fields exist.

    The observer is 2 degrees if missing, as in the first files. Raises BasisError for another
    format or version, or a missing field.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise BasisError(f"not a spectral basis: field 'format' is not {FORMAT!r}", code="type")
    version = data.get("version")
    if isinstance(version, bool) or version != FORMAT_VERSION:
        raise BasisError(
            f"spectral basis of version {version!r:.40}; this volspec reads version "
            f"{FORMAT_VERSION}: fit it again, or use the volspec that wrote it",
            code="unsupported",
        )
    missing = [n for n in (*names, "grid_nm") if n not in data]
    if missing:
        raise BasisError(
            f"spectral basis: field {missing[0]!r} is missing; fit it again", code="missing"
        )
    try:
        start_nm, stop_nm, step_nm = (float(v) for v in data["grid_nm"])
    except (TypeError, ValueError, OverflowError):
        raise BasisError(
            f"spectral basis: field 'grid_nm' is {data['grid_nm']!r:.40}, "
            "expected [start, stop, step]",
            code="type",
        ) from None
    try:
        grid = SpectralGrid(start_nm, stop_nm, step_nm)
    except SpectrumError as error:
        raise error.within("spectral basis: field 'grid_nm'", BasisError) from None
    return {"grid": grid, "observer_deg": data.get("observer_deg", 2)}


def write(path: str | os.PathLike[str], data: dict[str, Any]) -> None:
    """Write one matrix row per line, so that two files can be compared.

    Raises BasisError unless the path ends in ``.json``, by which `load` recognises files.
    """
    require_suffix(path, "bases", ".json", error=BasisError)
    lines = (f"  {json.dumps(key)}: {_rows(value)}" for key, value in data.items())
    with write_whole(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def load(name_or_path: str | os.PathLike[str], from_dict: Callable[[Any], _Basis]) -> _Basis:
    """Load a shipped basis by name, or a file; a BasisError names the file."""
    path = _path(name_or_path)
    data = _json(path)
    try:
        return from_dict(data)
    except BasisError as error:
        raise error.within(str(path)) from None


def _path(name_or_path: str | os.PathLike[str]) -> Path:
    """Return the file for a basis name or a path."""
    path = Path(name_or_path)
    if path.suffix.lower() == ".json" or path.name != str(name_or_path):
        require_inside(path, BasisError)
        return path
    shipped = shipped_names()
    if path.suffix and not path.exists() and path.name not in shipped:
        raise BasisError(
            f"{path}: no such file; give a .json file or a shipped basis: {', '.join(shipped)}",
            code="not-found",
        )
    if path.name not in shipped:
        raise BasisError(
            f"basis {path.name!r:.80} is unknown; {nearest(path.name, shipped)}"
            f"shipped: {', '.join(shipped) or 'none'}; or give the path of a .json file",
            code="unknown",
        )
    return asset("data/bases") / f"{path.name}.json"


def _json(path: Path) -> Any:
    """Parse a JSON file, with or without a byte order mark."""
    label = str(path) if len(str(path)) <= _MAX_LABEL else f"{str(path)[:_MAX_LABEL]}…"
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise BasisError(f"{label}: no such file; check the path", code="not-found") from None
    except IsADirectoryError:
        raise BasisError(f"{label}: is a folder; give a .json file", code="type") from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise BasisError(f"{label}: cannot be read: {reason}", code="damaged") from None
    except UnicodeDecodeError:
        raise BasisError(
            f"{label}: cannot be read as JSON: it is not UTF-8 text", code="damaged"
        ) from None
    except ValueError:
        raise BasisError(f"{label!r} is not a path; give a file name", code="syntax") from None
    try:
        return parse_json(text)
    except ValueError as error:
        raise BasisError(f"{label}: cannot be read as JSON: {error}", code="damaged") from None


def shipped_names() -> list[str]:
    """Return the names of the shipped bases."""
    return sorted(path.stem for path in asset("data/bases").glob("*.json"))


def _rows(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n    " + ",\n    ".join(json.dumps(row) for row in value) + "\n  ]"
    return json.dumps(value)
