"""The state as a Python script in the public interface, which makes the same frame.

    state -> [script] -> FILE.py -> PNG

Spectra are written by their names if those give the same numbers, and as numbers if not.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

import volspec
from volspec._files import write_whole
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.storage import shipped_names
from volspec.errors import InputError, SceneError, SpectrumError, ViewingError
from volspec.export.frames import file_stem
from volspec.export.recipes import python_text
from volspec.relight import LightRig
from volspec.spectra import DEFAULT_GRID, Spectrum, light, reflectance
from volspec.viewer.model.light_rows import rig_of
from volspec.viewer.model.scene_file import NOWHERE, same_spectrum
from volspec.viewer.model.state import ViewState

_WIDTH = 88
_NUMBERS = 6
# Of a `RelightSpec`, what a frame takes beside the viewing.
# Left to the machine that runs the script.
_LEFT_OUT = ("tile_ms",)


def export_python(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write the script; a basis that does not ship goes beside it.

    Raises
    ------
    InputError
        If the name is not ``.py``, or nothing can be written there.
    SceneError
        If the document has no file, so that no script could load its volume.
    ViewingError
        If no light is on.
    """
    target = Path(path)
    if target.suffix.lower() != ".py":
        raise InputError(f"{target}: a script is Python; name it .py")
    basis = state.transfer.basis
    beside = target.with_suffix(".basis.json")
    text = script_of(state, beside.name)
    if beside.name in text:
        basis.save(beside)
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return target


def script_of(state: ViewState, basis_file: str = "basis.json") -> str:
    """The script.

    Parameters
    ----------
    state : ViewState
    basis_file : str
        What a basis that does not ship is called, beside the script.

    Raises
    ------
    SceneError, ViewingError
        As `export_python`.
    """
    document, rig = state.document, rig_of(state.lights)
    if document.file is None or document.path is None:
        raise SceneError(f"{document.title}: was not read from a file; no script could load it")
    if rig is None:
        raise ViewingError("No light is on, so there is no frame to make a script for; turn one on")
    code = _Code(_texts(state))
    title = f"{document.title}, as seen in volspec {volspec.__version__}"
    space = state.relight.viewing.display.space
    arguments = "volume", "transfer", "camera", f"size={state.size}", "spec=spec"
    lines = [
        f"volume = {_volume(state)}",
        f"materials = {code.of(dict(state.transfer.materials), 0)}",
        f"basis = {_basis(state, basis_file)}",
        f"transfer = {code.transfer(state)}",
        f"camera = {code.camera(state)}",
        f"spec = {code.of(state.shading, 0)}",
        f"rig = {code.of(rig, 0)}",
        f"relight_spec = {code.of(state.relight, 0)}",
        "",
        _call("image = vs.raycast", arguments, 0),
        "with vs.Relighter(image) as relighter:",
        "    frame = relighter.frame(rig, relight_spec)",
        f'vs.write_frame("{file_stem(document.title)}.png", frame, space={code.of(space, 0)})',
    ]
    head = [f'"""{python_text(title)[1:-1]}."""', ""]
    if any("Path(" in line for line in lines):
        head += ["from pathlib import Path", ""]
    imports = [f"from {module} import {name}" for module, name in sorted(code.imports)]
    return "\n".join([*head, "import volspec as vs", *imports, "", *lines, ""])


def _texts(state: ViewState) -> dict[str, str]:
    """What lights and reflectances may be called, and which of both each is."""
    assert state.document.file is not None
    file = state.document.file
    named: dict[str, str] = {}
    for row in file.light:
        if isinstance(row.spectrum, str):
            named[row.spectrum] = "light"
    for light_row in state.lights:
        named.update(dict.fromkeys((text for text in light_row.texts if text), "light"))
    for material in file.material:
        for text in (material.reflectance, material.filter):
            if isinstance(text, str):
                named[text] = "reflectance"
    return named


def _volume(state: ViewState) -> str:
    """How it is loaded, from anywhere."""
    document = state.document
    assert document.file is not None and document.path is not None
    table = document.file.volume
    name, _, query = table.file.partition("?")
    path = os.path.normpath(document.path.parent / name) + (f"?{query}" if query else "")
    text = f"vs.load_volume({python_text(path)})"
    if table.spacing_mm is not None:
        text += f".with_spacing({table.spacing_mm})"
    if table.downsample != 1:
        labels = ", labels=True" if document.file.transfer.kind == "labels" else ""
        text += f".downsampled({table.downsample}{labels})"
    return text


def _basis(state: ViewState, file: str) -> str:
    basis = state.transfer.basis
    if isinstance(basis, MaterialBasis):
        made = MaterialBasis(state.transfer.materials, basis.name)
        if made.fingerprint == basis.fingerprint:
            return f"vs.MaterialBasis(materials, {python_text(basis.name)})"
    shipped = basis.name in shipped_names() and SpectralBasis.load(basis.name)
    if shipped and shipped.fingerprint == basis.fingerprint:
        return f"vs.SpectralBasis.load({python_text(basis.name)})"
    return f"vs.load_basis(Path(__file__).with_name({python_text(file)}))"


class _Code:
    """Values as Python: constructors with what is not their default."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self.imports: set[tuple[str, str]] = set()
        self._named: list[tuple[str, Spectrum]] = []
        for text, kind in texts.items():
            look_up = light if kind == "light" else reflectance
            try:
                found = look_up(text, DEFAULT_GRID, folder=NOWHERE)
            except (SpectrumError, OSError):
                continue
            self._named.append((f"vs.{kind}({python_text(text)})", found))

    def of(self, value: Any, indent: int) -> str:
        """Any value; ``indent`` is where its line starts."""
        if isinstance(value, Spectrum):
            return self._spectrum(value, indent)
        if isinstance(value, LightRig):
            return self._rig(value, indent)
        if is_dataclass(value):
            return self._object(value, indent)
        if isinstance(value, str):
            return python_text(value)
        if isinstance(value, Mapping):
            rows = [
                f"{self.of(key, 0)}: {self.of(each, indent + 4)}" for key, each in value.items()
            ]
            return _wrapped("{", rows, "}", indent)
        if isinstance(value, tuple | list):
            rows = [self.of(each, indent + 4) for each in value]
            if isinstance(value, list):
                return _wrapped("[", rows, "]", indent)
            return _wrapped("(", rows, ",)" if len(rows) == 1 else ")", indent)
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return f'float("{value}")'
        return repr(value)

    def transfer(self, state: ViewState) -> str:
        """The transfer function, of names that the script has."""
        transfer = state.transfer
        given = {f.name: getattr(transfer, f.name) for f in fields(transfer)}
        parts = []
        for name, value in given.items():
            if name in ("materials", "basis"):
                parts.append(f"{name}={name}")
            elif name in ("points", "surfaces"):
                rows = [(v, o, _alone(mix)) for v, o, mix in value]
                parts.append(f"{name}={self.of(rows, 4)}")
            elif value is not None:
                parts.append(f"{name}={self.of(value, 4)}")
        return _call(f"vs.{type(transfer).__name__}", tuple(parts), 0)

    def camera(self, state: ViewState) -> str:
        """The orbit."""
        view = state.view
        changed = [f.name for f in fields(view) if getattr(view, f.name) != f.default]
        parts = (f"{name}={self.of(getattr(view, name), 4)}" for name in changed)
        return _call("vs.Camera.orbit", ("volume", *parts), 0)

    def _rig(self, rig: LightRig, indent: int) -> str:
        """Lights, and what is not the same of all."""
        given: dict[str, Any] = {"lights": rig.lights}
        if set(rig.weights) != {1.0}:
            given["weights"] = rig.weights
        if rig.illuminance_lux is not None:
            given["illuminance_lux"] = rig.illuminance_lux
        if any(rig.groups):
            given["groups"] = rig.groups
        parts = (f"{name}={self.of(value, indent + 4)}" for name, value in given.items())
        return _call("vs.LightRig", tuple(parts), indent)

    def _object(self, value: Any, indent: int) -> str:
        parts = []
        for field in fields(value):
            now = getattr(value, field.name)
            make = field.default_factory
            default = field.default if make is MISSING else make()
            if field.name not in _LEFT_OUT and now != default:
                parts.append(f"{field.name}={self.of(now, indent + 4)}")
        name = type(value).__name__
        if name in volspec.__all__:
            return _call(f"vs.{name}", tuple(parts), indent)
        self.imports.add((type(value).__module__, name))
        return _call(name, tuple(parts), indent)

    def _spectrum(self, spectrum: Spectrum, indent: int) -> str:
        for text, known in self._named:
            if same_spectrum(known, spectrum):
                return text
        grid = "vs.SpectralGrid().wavelengths_nm"
        same_grid = np.array_equal(spectrum.wavelengths_nm, DEFAULT_GRID.wavelengths_nm)
        nm = grid if same_grid else self.of(spectrum.wavelengths_nm.tolist(), indent + 4)
        parts = nm, self.of(spectrum.values.tolist(), indent + 4), python_text(spectrum.name)
        return _call("vs.Spectrum", parts, indent)


def _alone(mix: Any) -> Any:
    """A material's name, where a mix is of it alone."""
    alone = isinstance(mix, Mapping) and list(mix.values()) == [1.0]
    return next(iter(mix)) if alone else mix


def _call(name: str, parts: tuple[str, ...], indent: int) -> str:
    return _wrapped(f"{name}(", list(parts), ")", indent)


def _wrapped(start: str, parts: list[str], end: str, indent: int) -> str:
    """In one line where it fits, else part by part, numbers some to a line."""
    flat = start + ", ".join(parts) + end
    if "\n" not in flat and len(flat) + indent <= _WIDTH:
        return flat
    inner = " " * (indent + 4)
    if parts and all(_is_number(part) for part in parts):
        lines = range(0, len(parts), _NUMBERS)
        parts = [", ".join(parts[at : at + _NUMBERS]) for at in lines]
    rows = "".join(f"{inner}{part},\n" for part in parts)
    return f"{start}\n{rows}{' ' * indent}{end.lstrip(',')}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
