"""A basis as JSON: in ``data/bases``, in a user's file, in a coefficient image's header.

SpectralBasis <-> [storage] <-> JSON
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volspec._files import write_whole
from volspec._gpu.sources import asset
from volspec.errors import BasisError, SpectrumError, nearest
from volspec.spectra.grid import SpectralGrid

if TYPE_CHECKING:
    from volspec.basis.model import SpectralBasis

FORMAT = "volspec-basis"
FORMAT_VERSION = 1


def to_dict(basis: SpectralBasis) -> dict[str, Any]:
    """JSON types; Python writes floats so that they read back to the last bit."""
    grid = basis.grid
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "name": basis.name,
        "method": basis.method,
        "trained_on": basis.trained_on,
        "observer_deg": basis.observer_deg,
        "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm],
        "analysis": basis.analysis.tolist(),
        "synthesis": basis.synthesis.tolist(),
        "XYZ_from_channels": basis.XYZ_from_channels.tolist(),
    }


def fields_from_dict(data: Any) -> dict[str, Any]:
    """The constructor's arguments; their values are checked by the constructor.

    Raises
    ------
    BasisError
        If it is not a basis, of another version, or a field is missing.
    """
    names = ("name", "method", "trained_on", "analysis", "synthesis", "XYZ_from_channels")
    return head_from_dict(data, names) | {n: data[n] for n in names}


def head_from_dict(data: Any, names: Sequence[str]) -> dict[str, Any]:
    """Grid and observer of a basis that has the named fields too.

    Returns
    -------
    {"grid": SpectralGrid, "observer_deg": object}
        2 degrees where the file does not say: files had no such field at first.

    Raises
    ------
    BasisError
        If it is not a basis, of another version, or a field is missing.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise BasisError(f"not a spectral basis: field 'format' is not {FORMAT!r}")
    if data.get("version") != FORMAT_VERSION:
        raise BasisError(
            f"spectral basis of version {data.get('version')!r}; this volspec reads version "
            f"{FORMAT_VERSION}: fit it again, or use the volspec that wrote it"
        )
    missing = [n for n in (*names, "grid_nm") if n not in data]
    if missing:
        raise BasisError(f"spectral basis: field {missing[0]!r} is missing; fit it again")
    try:
        start_nm, stop_nm, step_nm = (float(v) for v in data["grid_nm"])
    except (TypeError, ValueError):
        raise BasisError(
            f"spectral basis: field 'grid_nm' is {data['grid_nm']!r}, expected [start, stop, step]"
        ) from None
    try:
        grid = SpectralGrid(start_nm, stop_nm, step_nm)
    except SpectrumError as error:
        raise BasisError(f"spectral basis: field 'grid_nm': {error}") from None
    return {"grid": grid, "observer_deg": data.get("observer_deg", 2)}


def write(path: str | os.PathLike[str], data: dict[str, Any]) -> None:
    """One matrix row a line, so that two files can be compared."""
    lines = (f"  {json.dumps(key)}: {_rows(value)}" for key, value in data.items())
    with write_whole(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def read(name_or_path: str | os.PathLike[str]) -> tuple[Path, Any]:
    """The file a name or path means, and its JSON.

    Raises
    ------
    BasisError
        If it is missing or not JSON; an unknown name lists the shipped ones.
    """
    path = Path(name_or_path)
    if path.suffix != ".json" and path.name == str(name_or_path):
        path = asset("data/bases") / f"{path.name}.json"
        if not path.is_file():
            shipped = shipped_names()
            raise BasisError(
                f"basis {path.name!r} is unknown; {nearest(path.name, shipped)}"
                f"shipped: {', '.join(shipped) or 'none'}; or give the path of a .json file"
            )
    try:
        return path, json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BasisError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BasisError(f"{path}: cannot be read as JSON: {error}") from None


def shipped_names() -> list[str]:
    """The bases that come with the package."""
    return sorted(path.stem for path in asset("data/bases").glob("*.json"))


def _rows(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n    " + ",\n    ".join(json.dumps(row) for row in value) + "\n  ]"
    return json.dumps(value)
