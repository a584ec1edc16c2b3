"""A state as a scene file.

    state -> [scene_file] -> SCENE.toml

The light that shines goes first, as the viewer opens a scene under its first light.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from volspec._tables import DisplayTable, SpaceTable, explained
from volspec.appearance import Display
from volspec.appearance.presets import PRESETS
from volspec.appearance.spaces import ColourSpace
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.storage import shipped_names
from volspec.errors import SceneError, SpectrumError
from volspec.raycast import RaycastSpec
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene, SceneFile
from volspec.scene.lights import GroupTable, LightTable, rows_by_name
from volspec.scene.spectra import SpectrumTable
from volspec.scene.tables import (
    BasisTable,
    CameraTable,
    MaterialTable,
    OutputTable,
    PlaneTable,
    RaycastTable,
    ViewingTable,
)
from volspec.scene.transfer import TransferTable
from volspec.scene.writing import require_toml, write_scene
from volspec.spectra import Spectrum, light
from volspec.spectra.observer import color_matching_functions
from volspec.transfer import Isosurfaces, LabelFunction, Transfer, TransferFunction
from volspec.transfer.mixes import Mix
from volspec.viewer.model.light_rows import LightRow, effective_weights, rig_of
from volspec.viewer.model.state import ViewState

# Names are not to find files by chance, that lie where the program runs.
NOWHERE = "/"
# What a light that several others make together is called.
MIX = "mix"


def light_tables(state: ViewState) -> list[LightTable]:
    """The light that shines first, then the others as they would be alone."""
    rows = list(state.lights)
    weights = effective_weights(state.lights)
    lit = [index for index, weight in enumerate(weights) if weight > 0]
    settings: list[tuple[LightRow, float]] = [(row, 1.0) for row in rows]
    if len(lit) == 1:
        settings.insert(0, (settings.pop(lit[0])[0], weights[lit[0]]))
    elif lit:
        rig = rig_of(state.lights)
        assert rig is not None
        label = " + ".join(rows[index].name for index in lit)
        settings.insert(0, (LightRow(MIX, label, _merged(rig)), 1.0))
    taken: set[str] = set()
    return [table for row, weight in settings for table in _tables(state, row, weight, taken)]


def _merged(rig: LightRig) -> LightRig:
    """One light from each group: a file has no more in a setting."""
    names = tuple(dict.fromkeys(rig.groups))
    if len(names) == len(rig.groups):
        return rig
    lights, lux = [], []
    for name in names:
        own = [index for index, group in enumerate(rig.groups) if group == name]
        given = rig.illuminance_lux and tuple(rig.illuminance_lux[index] for index in own)
        picked = tuple(rig.lights[index] for index in own)
        part = LightRig(picked, tuple(rig.weights[index] for index in own), given)
        lights.append(part.mixed(picked[0].grid))
        lux.append(part.total_lux or 0.0)
    return LightRig(tuple(lights), (), tuple(lux) if rig.illuminance_lux else None, names)


def _tables(
    state: ViewState, row: LightRow, weight: float, taken: set[str]
) -> Iterator[LightTable]:
    """One setting: its row as the open file has it, or a row for each of its lights."""
    name = next(n for n in _names(row.name) if n not in taken)
    taken.add(name)
    kept = _as_in_file(state, row)
    if kept is not None and name == row.name:
        yield from (t.model_copy(update={"weight": t.weight * weight}) for t in kept)
        return
    rig = replace(row.rig, weights=tuple(own * weight for own in row.rig.weights))
    for index, spectrum in enumerate(rig.lights):
        given = light_text(row, index) or SpectrumTable.of(spectrum)
        # A file's numbers are scaled when they are read; of lights with lux they are shapes.
        scaled = isinstance(given, SpectrumTable) and rig.illuminance_lux is None
        yield LightTable(
            name=name,
            label=row.label if row.label != name else None,
            spectrum=given,
            group=rig.groups[index] or None,
            weight=rig.weights[index] * (_power(spectrum) if scaled else 1.0),
            illuminance_lux=rig.illuminance_lux[index] if rig.illuminance_lux else None,
        )


def _names(name: str) -> Iterator[str]:
    """The name, then others that tell it from its like."""
    name = name.strip() or "light"
    yield name
    number = 2
    while True:
        yield f"{name} ({number})"
        number += 1


def _as_in_file(state: ViewState, row: LightRow) -> list[LightTable] | None:
    """What the open file says of a light that is as it was opened."""
    assert state.document.file is not None
    if all(row.rig is not other.rig for other in state.document.lights):
        return None
    return rows_by_name(state.document.file.light).get(row.name)


def light_text(row: LightRow, index: int) -> str | None:
    """What a library's light is called, by which it is found anywhere; None where by nothing."""
    text, spectrum = row.texts[index] if row.texts else None, row.rig.lights[index]
    if text is None:
        return None
    try:
        known = light(text, spectrum.grid, folder=NOWHERE)
    except (SpectrumError, OSError):
        return None
    return text if same_spectrum(known, spectrum) else None


def _power(spectrum: Spectrum) -> float:
    """The mean over the band, weighted by V: what `volspec.light` makes 1."""
    V = color_matching_functions(spectrum.grid)[1]
    return float(V @ spectrum.values / V.sum())


def same_spectrum(one: Spectrum, other: Spectrum) -> bool:
    """Whether two spectra are alike to the last bit."""
    return one is other or (
        np.array_equal(one.wavelengths_nm, other.wavelengths_nm)
        and np.array_equal(one.values, other.values)
    )


def export_scene(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write what is shown; a basis that the file would not lead to goes beside it.

    Parameters
    ----------
    state : ViewState
    path : path
        A ``.toml``.

    Raises
    ------
    SceneError
        If the name is not ``.toml``, the document has no file, or no scene can say what is shown.
    InputError
        If nothing can be written there.
    """
    target = require_toml(path)
    document, file = state.document, scene_of(state)
    assert document.path is not None
    # The numbers of the file lead to the same basis, or the basis itself is kept.
    like = Scene(file, document.path)
    basis = state.transfer.basis
    if like.basis.fingerprint != basis.fingerprint:
        beside = target.with_suffix(".basis.json")
        basis.save(beside)
        named = BasisTable(name=os.path.relpath(beside.resolve(), like.folder.resolve()))
        file = file.model_copy(update={"basis": named})
    return write_scene(file, target, like)


def scene_of(state: ViewState) -> SceneFile:
    """The tables of a scene that shows what a state shows; names start from the open file's folder.

    Raises
    ------
    SceneError
        If the document has no file, or something is shown that no file can say, as no light at
        all or a backdrop that is a spectrum.
    """
    document = state.document
    if document.file is None:
        raise SceneError(f"{document.title}: was not read from a file, so no scene can name it")
    if rig_of(state.lights) is None:
        raise SceneError(
            "No light is on, and a scene opens under its first light, so none shows this; "
            "turn one on"
        )
    try:
        return _made(state, document.file)
    except ValidationError as error:
        raise SceneError(f"{document.title}: {explained(error, SceneFile)}") from error


def _made(state: ViewState, file: SceneFile) -> SceneFile:
    document = state.document
    width, height = state.size
    groups = state.shading.groups
    same_groups = [row.group() for row in file.group] == list(groups)
    default_groups = groups == RaycastSpec().groups
    return file.model_copy(
        update={
            "material": _materials(state),
            "transfer": _transfer(state),
            "basis": _basis(state),
            "camera": file.camera if state.view == document.view else _camera(state),
            "raycast": file.raycast if state.shading == document.shading else _raycast(state),
            "group": file.group if same_groups else [] if default_groups else _groups(state),
            "light": light_tables(state),
            "viewing": file.viewing
            if state.relight is document.relight
            else viewing_table(state.relight),
            "output": OutputTable(width=width, height=height),
        }
    )


def _materials(state: ViewState) -> list[MaterialTable]:
    """Those that are as they were opened keep their names, others are numbers."""
    assert state.document.file is not None
    old, new = state.document.transfer, state.transfer
    rows = {row.name: row for row in state.document.file.material}

    def given(key: str, name: str, now: Spectrum | None, then: Spectrum | None) -> Any:
        if now is None:
            return None
        same = name in rows and then is not None and same_spectrum(now, then)
        return getattr(rows[name], key) if same else SpectrumTable.of(now)

    filters = _filters(new), _filters(old)
    return [
        MaterialTable(
            name=name,
            reflectance=given("reflectance", name, spectrum, old.materials.get(name)),
            filter=given("filter", name, filters[0].get(name), filters[1].get(name)),
        )
        for name, spectrum in new.materials.items()
    ]


def _filters(transfer: Transfer) -> Mapping[str, Spectrum]:
    return transfer.filters or {} if isinstance(transfer, TransferFunction) else {}


def _transfer(state: ViewState) -> TransferTable:
    if state.transfer is state.document.transfer and state.document.file is not None:
        return state.document.file.transfer
    return transfer_table(state.transfer)


def transfer_table(transfer: Transfer) -> TransferTable:
    """``[transfer]`` that says what a transfer function does."""
    data: dict[str, Any]
    if isinstance(transfer, Isosurfaces):
        return TransferTable.model_validate({"surfaces": list(_points(transfer.surfaces))})
    if isinstance(transfer, LabelFunction):
        looks = transfer.labels.items()
        rows = [{"label": k, "opacity": o, "material": _shares(m)} for k, (o, m) in looks]
        data = {"labels": rows}
    elif isinstance(transfer, TransferFunction):
        data = {"points": list(_points(transfer.points))}
        if transfer.gradient_opacity is not None:
            data["gradient_opacity"] = [list(pair) for pair in transfer.gradient_opacity]
    else:
        regions = [{f.name: getattr(row, f.name) for f in fields(row)} for row in transfer.regions]
        data = {"regions": [row | {"material": _shares(row["material"])} for row in regions]}
    return TransferTable.model_validate(data | {"reference_step_mm": transfer.reference_step_mm})


def _points(points: Sequence[tuple[float, float, Mix]]) -> Iterator[dict[str, Any]]:
    for value, opacity, mix in points:
        yield {"value": float(value), "opacity": float(opacity), "material": _shares(mix)}


def _shares(mix: Mix) -> str | dict[str, float]:
    """A material by its name, where a mix is of it alone."""
    if isinstance(mix, str):
        return mix
    shares = {name: float(share) for name, share in mix.items()}
    return next(iter(shares)) if list(shares.values()) == [1.0] else shares


def _basis(state: ViewState) -> BasisTable:
    """The file's, unless the basis has another source that a name can say."""
    assert state.document.file is not None
    basis, table = state.transfer.basis, state.document.file.basis
    if basis is state.document.transfer.basis and table.name is not None:
        return table
    shipped = basis.name in shipped_names() and SpectralBasis.load(basis.name)
    if shipped and shipped.fingerprint == basis.fingerprint:
        return BasisTable(name=basis.name)
    if isinstance(basis, MaterialBasis) and table.method != "materials":
        grid = basis.grid
        nm = (grid.start_nm, grid.stop_nm, grid.step_nm)
        told = {"method": "materials", "grid_nm": nm, "observer_deg": basis.observer_deg}
        return BasisTable.model_validate(told)
    return table


def _camera(state: ViewState) -> CameraTable:
    return CameraTable(**asdict(state.view))


def _raycast(state: ViewState) -> RaycastTable:
    spec = state.shading
    settings = {name: getattr(spec, name) for name in RaycastTable.model_fields}
    planes = [PlaneTable(point_mm=p.point_mm, normal=p.normal) for p in spec.clip_planes]
    return RaycastTable(**settings | {"clip_planes": planes})


def _groups(state: ViewState) -> list[GroupTable]:
    """Each source with its kind, as ``[[group]]`` has it."""
    kinds = {"Ambient": "ambient", "Headlight": "headlight", "Directional": "directional"}
    rows = [
        {
            "name": group.name,
            "sources": [
                {"kind": kinds.get(type(source).__name__, "point")} | asdict(source)
                for source in group.sources
            ],
        }
        for group in state.shading.groups
    ]
    return [GroupTable.model_validate(row) for row in rows]


def viewing_table(spec: RelightSpec) -> ViewingTable:
    """``[viewing]`` that says how a picture is looked at.

    Raises
    ------
    SceneError
        If the backdrop is a spectrum.
    """
    if isinstance(spec.backdrop, Spectrum):
        raise SceneError("the backdrop is a spectrum; a scene's file takes a number from 0 to 1")
    viewing = spec.viewing
    own = {field.name: getattr(viewing, field.name) for field in fields(viewing)}
    own |= {"backdrop": spec.backdrop, "mode": spec.mode, "level": spec.level}
    return ViewingTable(**own | {"display": display_table(viewing.display)})


def display_table(display: Display) -> DisplayTable:
    """``[viewing.display]`` that says what a picture is made for: a preset, or numbers."""
    space = display.space
    given = SpaceTable.of(space) if isinstance(space, ColourSpace) else str(space)
    look: dict[str, Any] = {"space": given, "gamut": display.gamut, "mark": display.mark}
    for name, preset in PRESETS.items():
        if replace(preset.display(space, display.gamut), mark=display.mark) == display:
            return DisplayTable(preset=name, **look)
    room: tuple[str, ...] = ("white_cd_m2", "L_A", "Y_b", "surround")
    return DisplayTable(**look, **{name: getattr(display, name) for name in room})
