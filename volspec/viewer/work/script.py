"""The state as a Python script that renders the same frame with the public interface.

    state -> [script] -> FILE.py -> PNG

Spectra are written by name if the name yields the same numbers, and as numbers if not.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

import volspec
from volspec._files import is_remote, require_suffix, write_whole
from volspec.basis import MaterialBasis
from volspec.errors import SceneError, SpectrumError, ViewingError
from volspec.export import file_stem, python_text
from volspec.scene import SceneFile
from volspec.scene.tables import mix_as_written
from volspec.settings import default_of
from volspec.spectra import DEFAULT_GRID, Spectrum, light, reflectance
from volspec.transfer import Transfer
from volspec.viewer.model.depth import focused_depth, picture_spec
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.materials import same_spectrum
from volspec.viewer.model.paths import name_below
from volspec.viewer.model.scene_file import NOWHERE, is_shipped, left_out
from volspec.viewer.model.state import ViewState

_WIDTH = 88
_NUMBERS = 6
# Fields that the machine running the script chooses.
_LEFT_OUT = ("tile_ms",)


def export_python(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write the script; a basis that is not shipped goes into a file next to it.

    Raises VolspecError if the name is not ``.py``, if nothing can be written there, or as
    `script_from_state` does.
    """
    target = require_suffix(path, "scripts", ".py")
    basis_file = target.with_suffix(".basis.json")
    text = script_from_state(state, basis_file.name, target.absolute().parent)
    if f"with_name({python_text(basis_file.name)})" in text:
        state.transfer.basis.save(basis_file)
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return target


def script_lacks(state: ViewState) -> str:
    """Return what the window has, but its script has not, in words; empty if none."""
    return ", ".join(filter(None, (left_out(state), "annotations" if state.annotations else "")))


def script_from_state(
    state: ViewState, basis_file: str = "basis.json", folder: Path | None = None
) -> str:
    """Return the script, which loads a basis that is not shipped from a file next to it.

    A volume in or below the script's ``folder`` is named from there, so that both can be moved.
    The document must have a file, and a light must be on.
    """
    document, rig = state.document, light_rig(state.lights)
    file, path = document.saved()
    if document.image is not None:
        raise SceneError(
            f"{document.title}: is a cast image, for which no script can be made",
            "open the scene that it was cast from",
            code="unsupported",
        )
    if state.room is not None:
        raise SceneError(
            f"{document.title}: is in a room, for which no script can be made",
            "save the scene, and render it with volspec.Scene.load(…).render()",
            code="unsupported",
        )
    if any(row.shown for row in state.meshes):
        raise SceneError(
            f"{document.title}: has meshes, for which no script can be made",
            "save the scene, and render it with volspec.Scene.load(…).render()",
            code="unsupported",
        )
    if state.fields:
        raise SceneError(
            f"{document.title}: has several fields, for which no script can be made",
            "save the scene, and render it with volspec.Scene.load(…).render()",
            code="unsupported",
        )
    if rig is None:
        problem = "No light is on, so there is no frame to make a script for; turn one on"
        raise ViewingError(problem, code="missing")
    code = _Code(_spectrum_names(state, file))
    title = f"{document.title}, from volspec {volspec.__version__}"
    space, depth = state.relight.viewing.display.space, focused_depth(state)
    arguments = "volume", "transfer", "camera", f"size={state.size}", "spec=spec"
    lines = [
        f"volume = {_volume(file, path, document.series is not None, folder)}",
        f"materials = {code.of(dict(state.transfer.materials))}",
        f"basis = {_basis(state.transfer, basis_file)}",
        f"transfer = {code.transfer(state.transfer)}",
        f"camera = {_call('vs.Camera.orbit', ['volume', *code.changed_fields(state.view, 0)], 0)}",
        f"spec = {code.of(picture_spec(state))}",
        f"rig = {code.of(rig)}",
        f"relight_spec = {code.of(state.relight)}",
        "",
        _call("image = vs.raycast", arguments, 0),
        *([f"image = image.recompose({{}}, {code.of(depth)})"] if depth.changes else []),
        "with vs.Relighter(image) as relighter:",
        "    frame = relighter.frame(rig, relight_spec)",
        f'vs.write_frame("{file_stem(document.title)}.png", frame, space={code.of(space)})',
    ]
    head = [f'"""{python_text(title)[1:-1]}."""', ""]
    if any("Path(" in line for line in lines):
        head += ["from pathlib import Path", ""]
    imports = [f"from {module} import {name}" for module, name in sorted(code.imports)]
    return "\n".join([*head, "import volspec as vs", *imports, "", *lines, ""])


def _spectrum_names(state: ViewState, file: SceneFile) -> dict[str, str]:
    """Return "light" or "reflectance" by spectrum name."""
    names = {row.spectrum: "light" for row in file.light if isinstance(row.spectrum, str)}
    names |= {text: "light" for light_row in state.lights for text in light_row.texts if text}
    texts = (text for material in file.material for text in (material.reflectance, material.filter))
    return names | {text: "reflectance" for text in texts if isinstance(text, str)}


def _volume(file: SceneFile, scene: Path, is_series: bool, folder: Path | None) -> str:
    """Return the call that loads a scene's volume, from any working folder."""
    table = file.volume
    name, mark, query = table.file.partition("?")
    path = name if is_remote(name) else os.path.normpath(scene.parent / name)
    below = None if folder is None else name_below(path, str(folder))
    text = python_text((below or path) + mark + query)
    if below is not None:
        text = f"Path(__file__).parent / {text}"
    text = f"vs.load_series({text})[{table.step}]" if is_series else f"vs.load_volume({text})"
    if table.spacing_mm is not None:
        text += f".with_spacing({table.spacing_mm})"
    if table.downsample != 1:
        labels = ", labels=True" if file.transfer.kind == "labels" else ""
        text += f".downsampled({table.downsample}{labels})"
    return text


def _basis(transfer: Transfer, file: str) -> str:
    basis = transfer.basis
    if isinstance(basis, MaterialBasis):
        rebuilt = MaterialBasis(transfer.materials, basis.name)
        if rebuilt.fingerprint == basis.fingerprint:
            return f"vs.MaterialBasis(materials, {python_text(basis.name)})"
    if is_shipped(basis):
        return f"vs.SpectralBasis.load({python_text(basis.name)})"
    return f"vs.load_basis(Path(__file__).with_name({python_text(file)}))"


class _Code:
    """Values as Python: constructor calls without the defaults."""

    def __init__(self, spectrum_names: Mapping[str, str]) -> None:
        self.imports: set[tuple[str, str]] = set()  # (module, name)
        self._named: list[tuple[str, Spectrum]] = []
        for text, kind in spectrum_names.items():
            look_up = light if kind == "light" else reflectance
            try:
                spectrum = look_up(text, DEFAULT_GRID, folder=NOWHERE)
            except (SpectrumError, OSError):
                continue
            self._named.append((f"vs.{kind}({python_text(text)})", spectrum))

    def of(self, value: Any, indent: int = 0) -> str:
        """Return any value as code; ``indent`` is its line's indentation."""
        if isinstance(value, Spectrum):
            return self._spectrum(value, indent)
        if is_dataclass(value):
            return self._object(value, indent)
        if isinstance(value, str):
            return python_text(value)
        if isinstance(value, Mapping):
            rows = [f"{self.of(key)}: {self.of(entry, indent + 4)}" for key, entry in value.items()]
            return _wrap("{", rows, "}", indent)
        if isinstance(value, tuple | list):
            rows = [self.of(entry, indent + 4) for entry in value]
            if isinstance(value, list):
                return _wrap("[", rows, "]", indent)
            return _wrap("(", rows, ",)" if len(rows) == 1 else ")", indent)
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return f'float("{value}")'
        return repr(value)

    def transfer(self, transfer: Transfer) -> str:
        """Return a transfer function, with the names ``materials`` and ``basis`` of the script."""
        parts = []
        for field in fields(transfer):
            name, value = field.name, getattr(transfer, field.name)
            if name in ("materials", "basis"):
                parts.append(f"{name}={name}")
                continue
            if name in ("points", "surfaces"):
                value = [(v, o, mix_as_written(mix)) for v, o, mix in value]
            if value is not None:
                parts.append(f"{name}={self.of(value, 4)}")
        return _call(f"vs.{type(transfer).__name__}", parts, 0)

    def changed_fields(self, value: Any, indent: int) -> list[str]:
        """Return the fields of a dataclass that differ from their defaults, as arguments."""
        cls: Any = type(value)
        now = {field.name: getattr(value, field.name) for field in fields(value)}
        required = {name: v for name, v in now.items() if default_of(cls, name) is MISSING}
        defaults = cls(**required)
        return [
            f"{name}={self.of(v, indent + 4)}"
            for name, v in now.items()
            if name in required or (name not in _LEFT_OUT and v != getattr(defaults, name))
        ]

    def _object(self, value: Any, indent: int) -> str:
        name = type(value).__name__
        if name in volspec.__all__:
            name = f"vs.{name}"
        else:
            self.imports.add((type(value).__module__, name))
        return _call(name, self.changed_fields(value, indent), indent)

    def _spectrum(self, spectrum: Spectrum, indent: int) -> str:
        for text, named in self._named:
            if same_spectrum(named, spectrum):
                return text
        grid = "vs.SpectralGrid().wavelengths_nm"
        same_grid = np.array_equal(spectrum.wavelengths_nm, DEFAULT_GRID.wavelengths_nm)
        nm = grid if same_grid else self.of(spectrum.wavelengths_nm.tolist(), indent + 4)
        parts = nm, self.of(spectrum.values.tolist(), indent + 4), python_text(spectrum.name)
        return _call("vs.Spectrum", parts, indent)


def _call(name: str, parts: Sequence[str], indent: int) -> str:
    return _wrap(f"{name}(", parts, ")", indent)


def _wrap(start: str, parts: Sequence[str], end: str, indent: int) -> str:
    """Write one line if it fits, otherwise a line per part or per few numbers."""
    flat = start + ", ".join(parts) + end
    if "\n" not in flat and len(flat) + indent <= _WIDTH:
        return flat
    inner = " " * (indent + 4)
    if parts and all(_is_number(part) for part in parts):
        lines = range(0, len(parts), _NUMBERS)
        parts = [", ".join(parts[first : first + _NUMBERS]) for first in lines]
    rows = "".join(f"{inner}{part},\n" for part in parts)
    return f"{start}\n{rows}{' ' * indent}{end.lstrip(',')}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
