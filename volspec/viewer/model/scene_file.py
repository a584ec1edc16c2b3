"""Export of a state as a scene file, and as a script that renders it.

    state -> [scene_file] -> SCENE.toml, SCENE.py

The current mix becomes the first light, under which the viewer opens a scene.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from volspec._files import require_suffix, write_whole
from volspec.basis import Basis, MaterialBasis, SpectralBasis, shipped_names
from volspec.errors import SceneError, SpectrumError
from volspec.raycast import HEADLIT
from volspec.scene import FieldSpec, Scene, SceneFile, grid_of, write_scene
from volspec.scene.tables import (
    ROOM_LIGHT,
    BasisSpec,
    CameraSpec,
    LightSpec,
    MaterialSpec,
    OutputSpec,
    SpectrumNumbers,
    TransferSpec,
    rows_by_name,
)
from volspec.settings import is_settings
from volspec.spectra import Spectrum, colour_matching_functions, light, reflectance
from volspec.transfer import OWN, Transfer, TransferFunction
from volspec.viewer.model import depth, light_rows
from volspec.viewer.model.materials import same_spectrum
from volspec.viewer.model.state import ViewState

# A folder without files: relative names must not be found in the working directory by chance.
_NOWHERE = "/"
T = TypeVar("T")
# Settings of values and places, which may differ little and be far from 0.
_FAR = "value", "values", "position_mm", "target_mm", "point_mm", "points_mm"
# Name of a light that combines several others.
_MIX = "mix"
# It names no file, as it finds the scene by its own name.
_SCRIPT = '''"""Render the scene that was saved with this script, in the .toml of the same name."""

from pathlib import Path

import volspec as vs

scene = vs.Scene.load(Path(__file__).with_suffix(".toml"))
image = scene.render()  # slow, once for all lights; size=(1920, 1080) makes it larger
if scene.file.depth.changes:  # cuts by distance, fog, focus
    image = image.recompose({}, scene.file.depth)
light = scene.lights[0]  # as it was shown; or vs.light("A"), vs.light("planck:3200")
spec = scene.relight  # or vs.RelightSpec(vs.Viewing("none"), backdrop=0.05)
with vs.Relighter(image) as relighter:
    frame = relighter.frame(light, spec)  # quick, for one light after another
space = spec.viewing.display.space
vs.write_frame(Path(__file__).with_suffix(".png"), frame, space=space)
# Under each light of the scene, with its annotations: vs.export(scene, "frames")
'''


def _light_tables(state: ViewState, file: SceneFile) -> list[LightSpec]:
    """Return the current mix first, then each light alone."""
    rows = state.lights
    if state.room is not None:
        rows = tuple(_with_unit_power(row, state.document.lights) for row in rows)
    weights = light_rows.effective_weights(rows)
    shining = [index for index, weight in enumerate(weights) if weight > 0]
    settings: list[tuple[light_rows.LightRow, float]] = [(row, 1.0) for row in rows]
    if len(shining) == 1:
        settings.insert(0, (settings.pop(shining[0])[0], weights[shining[0]]))
    else:
        rig = light_rows.light_rig(rows)
        assert rig is not None
        label = " + ".join(rows[index].name for index in shining)
        if len(set(rig.groups)) < len(rig.groups):  # a setting in a file has one light per group
            rig = light_rows.merge_groups(rig, rig.lights[0].grid)
        settings.insert(0, (light_rows.LightRow(_MIX, label, rig), 1.0))
    tables: dict[str, list[LightSpec]] = {}
    for row, weight in settings:
        name = light_rows.unused_name(row.name.strip() or "light", tables)
        as_opened = any(row.rig is other.rig for other in state.document.lights)
        in_file = rows_by_name(file.light).get(row.name) if as_opened else None
        if in_file is not None and name == row.name:
            tables[name] = [replace(t, weight=as_typed(t.weight * weight)) for t in in_file]
        else:
            tables[name] = [_part_table(name, row, j, weight) for j in range(len(row.texts))]
    return [table for setting in tables.values() for table in setting]


def _with_unit_power(row: light_rows.LightRow, opened: light_rows.Rows) -> light_rows.LightRow:
    """Return a row with spectra whose V-weighted mean is 1, unless it is as it was opened.

    In a room only their shapes and weights count.
    """
    if any(row.rig is other.rig for other in opened):
        return row
    lights = tuple(
        spectrum if math.isclose(_power(spectrum), 1.0) else spectrum * (1.0 / _power(spectrum))
        for spectrum in row.rig.lights
    )
    return replace(row, rig=replace(row.rig, lights=lights))


def _part_table(name: str, row: light_rows.LightRow, part: int, weight: float) -> LightSpec:
    """Return the table of one of a light's spectra."""
    rig, spectrum = row.rig, row.rig.lights[part]
    text = row.texts[part]
    of_room = text == ROOM_LIGHT and spectrum.name == text
    spec = (text if of_room else _library_name(text, spectrum)) or SpectrumNumbers.of(spectrum)
    # A file's numbers are normalised when they are read; with lux only their shape counts.
    scaled = isinstance(spec, SpectrumNumbers) and rig.illuminance_lux is None
    return LightSpec(
        name=name,
        label=row.label if row.label != name else None,
        spectrum=spec,
        group=rig.groups[part] or None,
        weight=as_typed(rig.weights[part] * weight * (_power(spectrum) if scaled else 1.0)),
        illuminance_lux=rig.illuminance_lux[part] if rig.illuminance_lux else None,
    )


def _library_name(
    text: str | None, spectrum: Spectrum, find: Callable[..., Spectrum] = light
) -> str | None:
    """Return a spectrum's notation if it yields that spectrum wherever the scene file is."""
    if not text:
        return None
    try:
        named = find(text, spectrum.grid, folder=_NOWHERE)
    except (SpectrumError, OSError):
        return None
    return text if same_spectrum(named, spectrum) else None


def _power(spectrum: Spectrum) -> float:
    """Return the V-weighted mean, which `volspec.light` normalises to 1."""
    V = colour_matching_functions(spectrum.grid)[1]
    return float(V @ spectrum.values / V.sum())


def as_typed(value: T) -> T:
    """Return settings whose numbers have no digits beyond float32's, as people type them.

    Sliders give 0.8500000238418579 for .85.

    >>> as_typed((0.8500000238418579, 1 / 3, 7))
    (0.85, 0.3333333, 7)
    """
    typed: Any = value
    if isinstance(value, float) and math.isfinite(value):
        typed = float(f"{value:.7g}")
    elif isinstance(value, tuple | list):
        typed = type(value)(map(as_typed, value))
    elif isinstance(value, dict):
        typed = {key: as_typed(element) for key, element in value.items()}
    elif is_settings(type(value)):
        settings: Any = value
        written = {f.name: _in_full if f.name in _FAR else as_typed for f in fields(settings)}
        typed = replace(settings, **{k: to(getattr(value, k)) for k, to in written.items()})
    return typed


def _in_full(value: Any) -> Any:
    """Return numbers with all their digits; those of sliders, float32 of few digits, with these.

    >>> _in_full((0.8500000238418579, 1000000.0312345, 1e-40))
    (0.85, 1000000.0312345, 1e-40)
    """
    if isinstance(value, tuple):
        return tuple(map(_in_full, value))
    few = float(f"{value or 0.0:.6g}")
    with np.errstate(over="ignore"):
        return few if float(np.float32(few)) == value else value


def export_scene(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write a state as a ``.toml``; a basis that the file cannot reproduce is written next to it.

    Raises SceneError if the name is not ``.toml``, the document has no file, or no scene file can
    represent the state; InputError if nothing can be written there.
    """
    target = require_suffix(path, "scenes", ".toml", error=SceneError)
    file, (_, opened) = scene_from_state(state), state.document.saved()
    # The basis itself is saved unless the file's numbers lead to the same one.
    reopened = Scene(file, opened, room=state.room)
    basis = state.transfer.basis
    if reopened.basis.fingerprint != basis.fingerprint:
        basis_path = target.with_suffix(".basis.json")
        basis.save(basis_path)
        named = BasisSpec(name=os.path.relpath(basis_path.resolve(), reopened.folder.resolve()))
        file = replace(file, basis=named)
    return write_scene(file, target, reopened)


def export_python(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write a state as a ``.toml``, and next to it a ``.py`` that renders it; both or neither.

    Raises InputError if the name is not ``.py``, and as `export_scene`.
    """
    target = require_suffix(path, "scripts", ".py")
    with write_whole(target) as temporary:
        temporary.write_text(_SCRIPT, encoding="utf-8")
        export_scene(state, target.with_suffix(".toml"))
    return target


def script_lacks(state: ViewState) -> str:
    """Return what the window has, but a script's picture has not; empty if none."""
    return ", ".join(filter(None, (left_out(state), "annotations" if state.annotations else "")))


def compared_lights(state: ViewState) -> str:
    """Return the lights that are compared with, which only pictures and sessions have, in words."""
    return f"{light_rows.lit_names(state.other)} right of the divide" if state.other else ""


def left_out(state: ViewState) -> str:
    """Return what the window has, but a scene or a page of it has not; empty if none."""
    omitted = depth.left_out(state), depth.shown_stereo(state) and "stereo", compared_lights(state)
    return ", ".join(filter(None, omitted))


def scene_from_state(state: ViewState) -> SceneFile:
    """Return a scene file that shows the same picture as the state.

    Relative file names start from the open file's folder.

    It lacks `left_out`. Raises SceneError if the document has no file, or no file can
    represent the state: no light is on, or the backdrop is a spectrum.
    """
    document, (file, _) = state.document, state.document.saved()
    if document.image is not None:
        raise SceneError(
            f"{document.title}: is a cast image, from which no scene can be made",
            "open the scene that it was cast from",
            code="unsupported",
        )
    if light_rows.light_rig(state.lights) is None:
        raise SceneError(
            "No light is on, but a scene opens under its first light, so none can show this; "
            "turn one on",
            code="missing",
        )
    if isinstance(state.relight.backdrop, Spectrum):
        raise SceneError(
            "a scene file cannot store a spectrum as the backdrop",
            "give a number from 0 to 1",
            code="unsupported",
            field="viewing.backdrop",
        )
    shading = depth.picture_spec(state)
    groups, room = file.group, file.room
    if state.room is not None:
        exact = isinstance(state.transfer.basis, MaterialBasis)  # without channels for walls
        room = replace(state.room.spec, walls=state.room.spec.walls and not exact)
    elif (file.group or HEADLIT) != shading.groups:
        groups = () if shading.groups == HEADLIT else as_typed(shading.groups)
    keys = file.keyframe
    if not shading.layers:
        keys = tuple(replace(key, depth=None) for key in keys)
    same_view = state.view == document.view
    same_cast, same_viewing = shading == document.shading, state.relight == document.relight
    return replace(
        file,
        material=tuple(_materials(state, file)),
        transfer=_own_transfer(state, file),
        field=tuple(_fields(state, file)),
        basis=_basis(state, file.basis),
        camera=file.camera if same_view else as_typed(CameraSpec(**asdict(state.view))),
        raycast=file.raycast if same_cast else as_typed(replace(shading, groups=HEADLIT)),
        group=groups,
        room=room,
        light=tuple(_light_tables(state, file)),
        viewing=file.viewing if same_viewing else as_typed(state.relight),
        depth=depth.focused_depth(state),
        keyframe=keys,
        output=OutputSpec(*(max(side, 1) for side in state.size)),
        annotation=as_typed(state.annotations),
        mesh=file.mesh if state.meshes == file.mesh else as_typed(state.meshes),
    )


def _own_transfer(state: ViewState, file: SceneFile) -> TransferSpec:
    """Return ``[transfer]``: as in the file if it is unchanged."""
    document = state.document
    if not state.fields:
        same = state.transfer is document.transfer
        return file.transfer if same else as_typed(TransferSpec.of(state.transfer))
    return _field_transfer(state, OWN, file.transfer)


def _field_transfer(state: ViewState, name: str, table: TransferSpec) -> TransferSpec:
    """Return a field's ``transfer``; as in the file if it is unchanged."""
    numbers = [look.name for look in state.fields]
    number = numbers.index(name)
    look, old = state.fields[number], state.document.fields[number]
    transfer = state.transfer if number == state.chosen_field else look.transfer
    if transfer is not old.transfer:
        kept = {key: getattr(table, key) for key in ("weight", "shown", "mask", "label")}
        table = replace(as_typed(TransferSpec.of(transfer)), **kept)
    if (look.weight, look.shown) != (old.weight, old.shown):
        table = replace(table, weight=as_typed(look.weight), shown=look.shown)
    return table


def _fields(state: ViewState, file: SceneFile) -> Iterator[FieldSpec]:
    for row in file.field:
        transfer = row.transfer and _field_transfer(state, row.name, row.transfer)
        yield replace(row, transfer=transfer)


def _materials(state: ViewState, file: SceneFile) -> list[MaterialSpec]:
    """Return the materials: as in the file if unchanged since then, else by name or as numbers."""
    old, new = state.document.transfer, state.transfer
    rows = {row.name: row for row in file.material}

    def spec_of(key: str, name: str, now: Spectrum | None, then: Spectrum | None) -> Any:
        if now is None:
            return None
        if name in rows and then is not None and same_spectrum(now, then):
            return getattr(rows[name], key)
        return _library_name(now.name, now, reflectance) or SpectrumNumbers.of(now)

    new_filters, old_filters = _filters(new), _filters(old)
    return [
        MaterialSpec(
            name=name,
            reflectance=spec_of("reflectance", name, spectrum, old.materials.get(name)),
            filter=spec_of("filter", name, new_filters.get(name), old_filters.get(name)),
        )
        for name, spectrum in new.materials.items()
    ]


def _filters(transfer: Transfer) -> Mapping[str, Spectrum]:
    return transfer.filters or {} if isinstance(transfer, TransferFunction) else {}


def _is_shipped(basis: Basis) -> bool:
    name = basis.name
    return name in shipped_names() and SpectralBasis.load(name).fingerprint == basis.fingerprint


def _basis(state: ViewState, table: BasisSpec) -> BasisSpec:
    """Return the file's table, unless the basis now has another source that can be named."""
    basis = state.transfer.basis
    if basis is state.document.transfer.basis and table.name is not None:
        return table
    if _is_shipped(basis):
        return BasisSpec(name=basis.name)
    grid = basis.grid
    nm = (grid.start_nm, grid.stop_nm, grid.step_nm)
    if isinstance(basis, MaterialBasis) and table.method != "materials":
        options: dict[str, Any] = {"grid_nm": nm, "observer_deg": basis.observer_deg}
        return BasisSpec(method="materials", **options)
    # The bands of a palette, to which the new scene need not refer.
    keeps_table = table.name is not None or grid == grid_of(table)
    return table if keeps_table else replace(table, grid_nm=nm)
