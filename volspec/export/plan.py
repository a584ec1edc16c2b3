"""Plan the frames of an export, cameras in time × lights, grouped by shared casts.

    Scene, [export], [[keyframe]] -> [plan] -> exporter, volspec scene check

A scene is checked by planning its export.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import view_transform
from volspec.camera import Camera
from volspec.errors import InputError, SceneError
from volspec.export import animation
from volspec.export.animation import FrameState
from volspec.export.frames import distinct_stems
from volspec.raycast import SurfaceCaster
from volspec.raycast.launch import FieldCast, check_layers, check_reach
from volspec.relight import Illumination, LightRig, Look, RelightSpec, check_hdr, mixed_rig
from volspec.scene import (
    NamedLight,
    Resolver,
    Scene,
    SceneFaults,
    SceneFile,
    scene_data,
    scene_file,
)
from volspec.scene.tables import EMPTY, ROOM_LIGHT, ExportSpec, Play, require_lux
from volspec.settings import try_table
from volspec.transfer import Transfers, bake_for_volume, check_opacities
from volspec.volume import Series, Volume

# Stem of coefficient images; other frames are named after their light.
_CAST = "cast"
# Frames from one light to the next in a sweep if the number of frames is not given.
_FRAMES_A_FADE = 24


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame."""

    stem: str  # the file's path in the folder, without the suffix
    time_index: int  # shared by shots of several lights
    camera: Camera
    transfer: Transfers  # equal transfer functions are one object
    light: str  # a description for the file's notes
    rig: LightRig
    look: Look
    step: int | None = None  # of a series that plays

    @property
    def spec(self) -> RelightSpec:
        """Viewing, mode, backdrop and level."""
        return self.look.relight

    def cast(self, layered: bool) -> tuple[object, ...]:
        """Return the key of the cast: shots with equal keys share one.

        ``layered`` casts are shared by shots of other opacities.
        """
        opacities = () if layered else tuple(self.look.opacities.items())
        return self.camera, id(self.transfer), self.step, opacities


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All frames of an export, in the order of a film."""

    shots: tuple[Shot, ...]
    # Lights with frames of their own; empty if frames mix several lights.
    lights: tuple[NamedLight, ...]

    def casts(self, layered: bool = False) -> list[list[Shot]]:
        """Return the shots grouped by cast, in the order of each group's first shot."""
        groups: dict[object, list[Shot]] = {}
        for shot in self.shots:
            groups.setdefault(shot.cast(layered), []).append(shot)
        return list(groups.values())

    @property
    def plays(self) -> bool:
        """True if frames show time steps of a series."""
        return any(shot.step is not None for shot in self.shots)

    @property
    def deep(self) -> bool:
        """True if frames have effects of depth, which need casts with layers."""
        return any(shot.look.depth.changes for shot in self.shots)

    def fingerprint(self) -> str:
        """Return a hash that is equal for equal frames."""
        digest = hashlib.blake2b(digest_size=16)
        for shot in self.shots:
            rig, look = shot.rig, shot.look
            facts = shot.stem, shot.camera, shot.transfer, look.relight, rig.weights, rig.groups
            more: tuple[object, ...] = (look.opacities,) if look.opacities else ()
            more += (look.depth,) if look.depth.changes else ()
            digest.update(repr((*facts, rig.illuminance_lux, shot.step, *more)).encode())
            for light in rig.lights:
                digest.update(np.stack([light.wavelengths_nm, light.values]).tobytes())
        return digest.hexdigest()


def plan_export(
    scene: Scene, volume: Volume, table: ExportSpec, series: Series | None = None
) -> Plan:
    """Plan the frames of ``[export]``, or of another table that fits the scene.

    ``series`` are the volume's time steps, if they are open; else they are only counted. Raises
    SceneError if a setting is impossible at some time, or a light lacks the lux that the level
    needs.
    """
    lights = export_lights(scene, table)
    require_lux(_visible_lights(scene, table, lights), scene.relight, scene.path)
    states = _states(scene, volume, table, len(lights))
    with animation.located_in(scene, "[depth]"):
        for state in states:
            # A focus needs a camera that has one.
            camera = state.camera
            state.look.depth.blur_px(1, None if camera.height_mm is not None else camera.fov_deg)
        if table.stereo is not None and any(state.look.depth.focus_mm for state in states):
            problem = "focus_mm does not work with [export] stereo"
            raise InputError(problem, "leave out one of them", code="conflict")
        if table.samples > 1 and any(state.look.depth.changes for state in states):
            problem = f"does not work with [export] samples = {table.samples}"
            raise InputError(problem, "leave out one of them", code="conflict")
    states = [
        replace(state, look=replace(state.look, stereo=table.stereo, hdr=table.hdr))
        for state in states
    ]
    if table.play is not None:
        states = _play_series(scene, states, table.play, series)
    mixes = _mixes(scene, table, lights, len(states))
    digits = max(4, len(str(len(states) - 1)))
    numbers = [f"{i:0{digits}d}" for i in range(len(states))]
    if mixes is not None:
        frame_rows = zip(numbers, states, mixes, strict=True)
        shots = [_shot(stem, i, state, *mix) for i, (stem, state, mix) in enumerate(frame_rows)]
        _require_lit(scene, table, shots)
        return Plan(tuple(shots), ())
    # Coefficients have no light: one sequence of files, previewed under the first light.
    cast_only = table.format == "coefficients"
    rows = lights[:1] if cast_only else lights
    stems = [_CAST] if cast_only else distinct_stems([light.name for light in lights])
    shots = [
        _shot(stem if len(states) == 1 else f"{stem}/{number}", i, state, light.name, light.rig)
        for light, stem in zip(rows, stems, strict=True)
        for i, (number, state) in enumerate(zip(numbers, states, strict=True))
    ]
    if not cast_only:
        _require_lit(scene, table, shots)
    return Plan(tuple(shots), () if cast_only else tuple(lights))


def _shot(stem: str, number: int, state: FrameState, light: str, rig: LightRig) -> Shot:
    settings = state.camera, state.transfer, light, rig, state.look, state.step
    return Shot(stem, number, *settings)


def export_lights(scene: Scene, table: ExportSpec) -> list[NamedLight]:
    """Return the scene's lights named by ``[export]``, in that order; by default all."""
    by_name = {light.name: light for light in scene.lights}
    return [by_name[name] for name in table.lights or by_name]


def _visible_lights(
    scene: Scene, table: ExportSpec, lights: Sequence[NamedLight]
) -> Sequence[NamedLight]:
    """Return the lights in any frame; none for coefficient images, as they have their own level."""
    if table.format == "coefficients":
        return ()
    if (weights := _weights(scene)) is None:
        return lights
    names = {name for row in weights for name, weight in row.items() if weight > 0.0}
    return [light for light in scene.lights if light.name in names]


def _weights(scene: Scene) -> list[dict[str, float]] | None:
    """Return the light weights of the keyframes; None if they have none."""
    keys = scene.file.keyframe
    if not keys or keys[0].lights is None:
        return None
    return [key.lights or {} for key in keys]


def _play_series(
    scene: Scene, states: list[FrameState], play: Play, series: Series | None
) -> list[FrameState]:
    """Return the states with the time steps of a series; of a single one a frame for each."""
    steps = scene.step_count() if series is None else len(series)
    if steps == 1:
        raise SceneError(
            f"{scene.path}: [export] play: the volume has one time step",
            "leave it out, or give a series as [volume] file, such as beat/*.nrrd",
            code="conflict",
        )
    if len(states) == 1:
        states = states * (play.frames or steps * play.loops)
    frame_steps = animation.played_steps(len(states), steps, play.loops)
    return [replace(state, step=step) for state, step in zip(states, frame_steps, strict=True)]


def _states(scene: Scene, volume: Volume, table: ExportSpec, lights: int) -> list[FrameState]:
    # A spectrum has all bands; other modes would smooth a lamp's spectrum.
    spec = replace(scene.relight, mode="exact") if table.spectral else scene.relight
    look = Look(spec, opacities=scene.raycast.opacities, depth=scene.file.depth)
    still = FrameState(scene.camera(volume), scene.transfer, look)
    with animation.located_in(scene):
        check_reach(volume, still.camera, scene.raycast)
        check_opacities(scene.basis, scene.raycast.opacities)
    if table.turntable is not None:
        cameras = animation.turntable_cameras(scene, volume, table.turntable)
        return [replace(still, camera=camera) for camera in cameras]
    keys = scene.file.keyframe
    if keys:
        return animation.frame_states(scene, volume, spec, animation.frame_times_s(keys, table.fps))
    if table.sweep is not None:
        fades = lights if table.sweep.closed else lights - 1
        fading = _FRAMES_A_FADE * fades + (not table.sweep.closed)
        return [still] * (table.sweep.frames or (table.play and table.play.frames) or fading)
    return [still]


def _mixes(
    scene: Scene, table: ExportSpec, lights: Sequence[NamedLight], count: int
) -> list[tuple[str, LightRig]] | None:
    """Return each state's light and its description; None if every light has its own frames."""
    if table.format == "coefficients":
        return None
    if (weighted := _weights(scene)) is not None:
        times = [key.time_s for key in scene.file.keyframe]
        names = dict.fromkeys(name for weights in weighted for name in weights)
        rows = [[weights.get(name, 0.0) for name in names] for weights in weighted]
        by_name = {light.name: light for light in scene.lights}
        mixed = [by_name[name] for name in names]
        at_s = animation.frame_times_s(scene.file.keyframe, table.fps)
        mixes = []
        interpolated = animation.interpolate_keyframes(times, rows, at_s)
        for time, row in zip(at_s.tolist(), interpolated, strict=True):
            with animation.located_in(scene, f"[[keyframe]] lights: at {time:g} s"):
                mixes.append(mix_lights(mixed, row))
        return mixes
    if table.sweep is None:
        return None
    with animation.located_in(scene, "[export] sweep"):
        weights = sweep_weights(len(lights), count, table.sweep.closed)
        return [mix_lights(lights, row) for row in weights]


def _require_lit(scene: Scene, table: ExportSpec, shots: Sequence[Shot]) -> None:
    """Refuse, before the cast, lights and viewings with which no frame can be made."""
    keys, fractions = scene.file.keyframe, scene.raycast.shares()
    at_s = animation.frame_times_s(keys, table.fps) if keys else np.zeros(0)
    # Values never go beyond the keyframes, so the frames next to the keyframes are enough.
    checked = {int(np.abs(at_s - key.time_s).argmin()) for key in keys}
    # Equal specs are a single object.
    relevant = [shot for shot in shots if not keys or shot.time_index in checked]
    for shot in {(id(shot.rig), id(shot.spec)): shot for shot in reversed(relevant)}.values():
        when = f" at {at_s[shot.time_index]:g} s" if keys else ""
        with animation.located_in(scene, f"[[light]] {shot.light}{when}"):
            spec = shot.spec
            if table.hdr is not None:
                spec = check_hdr(shot.rig, spec, table.hdr)
            illumination = Illumination.of(scene.basis, shot.rig, spec, fractions)
            if table.has_eye and not shot.spec.viewing.is_measured:
                view_transform(illumination.viewing, illumination.white_XYZ)


def sweep_weights(lights: int, frames: int, closed: bool = False) -> NDArray[np.float64]:
    """Return (F, L) weights of lights that fade into each other; each row sums to 1.

    A closed sweep ends one frame before returning to its first light.

    >>> sweep_weights(3, 5).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]
    """
    steps = (frames, lights) if closed else (max(frames - 1, 1), lights - 1)
    rows = np.zeros((frames, lights))
    for i, row in enumerate(rows):
        index, part = divmod(i * steps[1], steps[0])
        row[index % lights] += 1.0 - part / steps[0]
        row[(index + 1) % lights] += part / steps[0]
    return rows


def mix_lights(lights: Sequence[NamedLight], weights: Sequence[float]) -> tuple[str, LightRig]:
    """Mix lights of a scene and describe the mix; lights of weight 0 are left out."""
    terms = [(light, float(w)) for light, w in zip(lights, weights, strict=True) if w > 0.0]
    if len(terms) == 1 and terms[0][1] == 1.0:
        return terms[0][0].name, terms[0][0].rig
    words = ", ".join(f"{light.name} {weight:.3g}" for light, weight in terms)
    if len({light.rig.illuminance_lux is None for light, _ in terms}) > 1:
        raise SceneError(
            f"{words}: some of these lights have illuminance_lux and some do not",
            "give it to all or to none",
            code="conflict",
        )
    return words, mixed_rig([light.rig for light, _ in terms], [weight for _, weight in terms])


@dataclass(frozen=True, slots=True)
class CheckedExport:
    """Contents of a scene, or its faults."""

    path: str
    # One line per fault: file, field, value, remedy. Empty if the scene loads and can be shown.
    errors: tuple[str, ...] = ()
    materials: int = 0
    lights: int = 0
    volume: tuple[int, int, int] | None = None  # (width, height, depth)
    basis: str = ""
    reason: str = ""  # for the choice of the basis
    # Of the groups that light the volume, as a part of the room's light; root mean square.
    room_error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON types."""
        return {"path": self.path, "ok": not self.errors, **asdict(self)}


def check_scene(path: str | os.PathLike[str]) -> CheckedExport:
    """Look up everything that a scene names, including its volume, and plan its export.

    Reports all faults that can be found without a cast.
    """
    name = os.fspath(path)
    try:
        data = scene_data(path)
    except SceneError as error:
        return CheckedExport(name, (str(error),))
    try:
        file = scene_file(data, path)
    except SceneFaults as error:
        valid = _valid_part(data, error, Path(path))
        unknown = [] if valid is None else _check_names(valid, Path(path))[0]
        return CheckedExport(name, (*error.lines, *unknown))
    coarse = file
    if file.room is not None:  # solved once more, below
        coarse = replace(file, room=replace(file.room, patches=_FEW_PATCHES))
    errors, volume = _check_names(coarse, Path(path))
    scene = None
    if volume is not None and not errors:
        try:
            scene = Scene(file, path)
            scene.camera(volume)
            _require_castable(scene, volume, scene.behind(volume))
            require_lux(scene.lights, scene.relight, path)
            errors += map(str, animation.keyframe_faults(scene, volume))
            if not errors:
                plan_export(scene, volume, scene.file.export)
        except SceneError as error:
            errors.append(str(error))
    if scene is None or volume is None or errors:
        return CheckedExport(name, tuple(errors))
    reason, output = scene.basis_reason, scene.file.output
    if scene.basis.method == "bands":
        channels = len(scene.raycast.groups) * scene.basis.size
        megabytes = output.width * output.height * channels * (2 if scene.raycast.half else 4) / 1e6
        reason += f"; a picture takes {megabytes:.3g} MB"
    return CheckedExport(
        name,
        materials=len(scene.materials),
        lights=len(scene.lights),
        volume=None if file.volume.file == EMPTY else volume.finest.shape_xyz,
        basis=scene.basis.name,
        reason=reason,
        room_error=None if scene.room is None else scene.room.extent_error(volume),
    )


def _require_castable(scene: Scene, volume: Volume, surfaces: Sequence[SurfaceCaster]) -> None:
    """Raise SceneError if settings of the cast do not fit what is cast."""
    try:
        tables = bake_for_volume(scene.transfer, volume)
        FieldCast.of(volume, tables, scene.raycast)
        if scene.raycast.layers:
            translucent = [surface.translucent for surface in surfaces]
            check_layers(scene.raycast, tables, scene.basis, translucent)
    except InputError as error:
        raise error.within(f"{scene.path}: [raycast]", SceneError) from error


# Of a room that is only looked at.
_FEW_PATCHES = 100
# Replacements for tables that have a fault; no file can have this name.
_NO_VOLUME = "\0"
_VALID = {
    "volume": {"file": _NO_VOLUME},
    "material": [{"name": "material", "reflectance": "grey:0.5"}],
    "light": [{"name": "light", "spectrum": "D65"}],
}


def _valid_part(data: Mapping[str, Any], error: SceneFaults, path: Path) -> SceneFile | None:
    """Return a scene of the tables and rows without a fault; None if they do not fit together."""
    wrong = {
        match[0] for fault in error.faults if (match := re.match(r"\w+(\[\d+\])?", fault.field))
    }
    tables: dict[str, Any] = dict(_VALID)
    for key in ("volume", "basis", "group", "material", "light"):
        table = data.get(key)
        if isinstance(table, list):
            table = [row for i, row in enumerate(table) if f"{key}[{i}]" not in wrong]
        if table and key not in wrong:
            tables[key] = table
    point = {"value": 0, "opacity": 0, "material": tables["material"][0]["name"]}
    tables["transfer"] = {"points": [point]}
    # A room's light is known only if all tables are valid.
    tables["light"] = [
        {**row, "spectrum": "D65"} if row.get("spectrum") == ROOM_LIGHT else row
        for row in tables["light"]
        if isinstance(row, dict)
    ]
    return try_table(SceneFile, tables, SceneError, path.parent)[0]


def _check_names(file: SceneFile, path: Path) -> tuple[list[str], Volume | None]:
    """Return messages on unknown names and numbers out of range, and the volume."""
    errors: list[str] = []
    names = Resolver(file, path, faults=errors)
    grid = names.grid(names.shipped_basis())
    names.reflectances("reflectance", grid)
    names.reflectances("filter", grid)
    names.lights(grid, file.cast, names.room(grid))
    try:
        if file.volume.file != _NO_VOLUME:
            return errors, names.opened()[0]
    except SceneError as error:
        errors.append(str(error))
    return errors, None
