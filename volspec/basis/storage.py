"""A basis as JSON: in ``data/bases``, in a user's file, in a coefficient image's header.

SpectralBasis <-> [storage] <-> JSON
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from volspec._files import write_whole
from volspec._gpu.sources import asset
from volspec._parse import parse_json
from volspec.errors import BasisError, SpectrumError, nearest
from volspec.spectra.grid import SpectralGrid

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

FORMAT = "volspec-basis"
FORMAT_VERSION = 1
MATERIALS = "materials"
"""The ``method`` of a `MaterialBasis`; any other is a `SpectralBasis`'."""

_Basis = TypeVar("_Basis")
_LONGEST_LABEL = 200


def to_dict(basis: SpectralBasis | MaterialBasis, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """JSON types; Python writes floats so that they read back to the last bit."""
    grid = basis.grid
    words = {} if basis.method == MATERIALS else {"trained_on": basis.trained_on}
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "name": basis.name,
        "method": basis.method,
        **words,
        "fingerprint": basis.fingerprint,
        "observer_deg": basis.observer_deg,
        "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm],
        **numbers,
    }


def is_material_basis(data: Any) -> bool:
    """Whether a dictionary means to be a `MaterialBasis`."""
    return isinstance(data, dict) and data.get("method") == MATERIALS


def require_unedited(basis: SpectralBasis | MaterialBasis, data: Mapping[str, Any]) -> None:
    """Refuse numbers that are not those the fingerprint was taken of.

    Files had no fingerprint at first; those pass.

    Raises
    ------
    BasisError
    """
    said = data.get("fingerprint", basis.fingerprint)
    if said != basis.fingerprint:
        raise BasisError(
            f"its numbers, grid and observer have the fingerprint {basis.fingerprint}, but it "
            f"says {said!r:.40}: were the numbers edited? Fit it again"
        )


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
    version = data.get("version")
    if isinstance(version, bool) or version != FORMAT_VERSION:
        raise BasisError(
            f"spectral basis of version {version!r:.40}; this volspec reads version "
            f"{FORMAT_VERSION}: fit it again, or use the volspec that wrote it"
        )
    missing = [n for n in (*names, "grid_nm") if n not in data]
    if missing:
        raise BasisError(f"spectral basis: field {missing[0]!r} is missing; fit it again")
    try:
        start_nm, stop_nm, step_nm = (float(v) for v in data["grid_nm"])
    except (TypeError, ValueError, OverflowError):
        raise BasisError(
            f"spectral basis: field 'grid_nm' is {data['grid_nm']!r:.40}, "
            "expected [start, stop, step]"
        ) from None
    try:
        grid = SpectralGrid(start_nm, stop_nm, step_nm)
    except SpectrumError as error:
        raise BasisError(f"spectral basis: field 'grid_nm': {error}") from None
    return {"grid": grid, "observer_deg": data.get("observer_deg", 2)}


def write(path: str | os.PathLike[str], data: dict[str, Any]) -> None:
    """One matrix row a line, so that two files can be compared.

    Raises
    ------
    BasisError
        If the path does not end in ``.json``, by which `load` knows a file from a name.
    InputError
        If nothing can be written there.
    """
    if isinstance(path, str | os.PathLike) and Path(path).suffix.lower() != ".json":
        raise BasisError(f"{os.fspath(path)!r:.80}: bases are JSON; name the file .json")
    lines = (f"  {json.dumps(key)}: {_rows(value)}" for key, value in data.items())
    with write_whole(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def load(name_or_path: str | os.PathLike[str], from_dict: Callable[[Any], _Basis]) -> _Basis:
    """A shipped basis by name, or a file; what is wrong with it is said of the file.

    Raises
    ------
    BasisError
        If it is missing, not JSON, or refused by ``from_dict``; an unknown name lists the
        shipped ones.
    """
    path = _path(name_or_path)
    data = _json(path)
    try:
        return from_dict(data)
    except BasisError as error:
        raise BasisError(f"{path}: {error}") from None


def _path(name_or_path: str | os.PathLike[str]) -> Path:
    """The file that a name or a path means."""
    if not isinstance(name_or_path, str | os.PathLike):
        raise BasisError(
            f"{name_or_path!r:.40} is neither the name of a basis nor the path of a .json file",
            code="not-found",
        )
    path = Path(name_or_path)
    if path.suffix.lower() == ".json" or path.name != str(name_or_path):
        return path
    shipped = shipped_names()
    if path.name not in shipped:
        raise BasisError(
            f"basis {path.name!r:.80} is unknown; {nearest(path.name, shipped)}"
            f"shipped: {', '.join(shipped) or 'none'}; or give the path of a .json file",
            code="unknown",
        )
    return asset("data/bases") / f"{path.name}.json"


def _json(path: Path) -> Any:
    """What a file holds; a mark of byte order is none of it."""
    label = str(path) if len(str(path)) <= _LONGEST_LABEL else f"{str(path)[:_LONGEST_LABEL]}…"
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise BasisError(f"{label}: no such file; check the path", code="not-found") from None
    except IsADirectoryError:
        raise BasisError(f"{label}: is a folder; give a .json file") from None
    except OSError as error:
        said = (error.strerror or str(error)).lower()
        raise BasisError(f"{label}: cannot be read: {said}", code="damaged") from None
    except UnicodeDecodeError:
        raise BasisError(
            f"{label}: cannot be read as JSON: it is not UTF-8 text", code="damaged"
        ) from None
    except ValueError:
        raise BasisError(f"{label!r} is no path; give a file name") from None
    try:
        return parse_json(text)
    except ValueError as error:
        raise BasisError(f"{label}: cannot be read as JSON: {error}", code="damaged") from None


def shipped_names() -> list[str]:
    """The bases that come with the package."""
    return sorted(path.stem for path in asset("data/bases").glob("*.json"))


def _rows(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n    " + ",\n    ".join(json.dumps(row) for row in value) + "\n  ]"
    return json.dumps(value)
