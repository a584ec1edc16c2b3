"""Which frames an export makes: cameras in time × lights, and which of them share a cast.

Scene, [export], [[keyframe]] -> [plan] -> run
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.live import passage_of
from volspec.errors import SceneError
from volspec.export.frames import distinct_stems
from volspec.export.keyed import Moment, keyed, named, times_s
from volspec.export.motion import between_keys
from volspec.export.moved import turned
from volspec.raycast import Camera
from volspec.raycast.packed import check_reach
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.relight.spec import mixed_rig
from volspec.scene import NamedLight, Scene
from volspec.scene.export import ExportTable
from volspec.scene.lux import require_lux
from volspec.transfer import Transfer
from volspec.volume import Volume

# What coefficient images are called, as frames are by their light.
_CAST = "cast"
# A fade of a sweep, where nothing else says how many frames it has.
_FRAMES_A_FADE = 24


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame.

    Parameters
    ----------
    stem : str
        Its file in the folder, without the suffix; ``/`` parts folders.
    moment : int
        Which place in time, from 0; shots of several lights share it.
    camera : Camera
    transfer : Transfer
        The same object wherever it is equal.
    light : str
        In words, for the file's notes.
    rig : LightRig
    spec : RelightSpec
    """

    stem: str
    moment: int
    camera: Camera
    transfer: Transfer
    light: str
    rig: LightRig
    spec: RelightSpec

    @property
    def cast(self) -> tuple[Camera, int]:
        """Equal for shots of which one cast is enough."""
        return self.camera, id(self.transfer)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All frames of an export, in the order of a film.

    Parameters
    ----------
    shots : tuple of Shot
    lights : tuple of NamedLight
        Those that have frames of their own; empty where each frame has a mix.
    """

    shots: tuple[Shot, ...]
    lights: tuple[NamedLight, ...]

    def casts(self) -> list[list[Shot]]:
        """The shots by what they are cast from, in the order of their first."""
        found: dict[tuple[Camera, int], list[Shot]] = {}
        for shot in self.shots:
            found.setdefault(shot.cast, []).append(shot)
        return list(found.values())


def plan_export(scene: Scene, volume: Volume, table: ExportTable) -> Plan:
    """What ``[export]`` asks for.

    Parameters
    ----------
    scene : Scene
    volume : Volume
        The scene's.
    table : ExportTable
        The scene's, or one that fits it as well.

    Raises
    ------
    SceneError
        If a camera, transfer function, viewing or light cannot be had; the message names the time.
        If a light lacks the lux that the scene's level needs.
    """
    lights = lights_of(scene, table)
    require_lux(_shining(scene, table, lights), scene.relight, scene.path)
    moments = _moments(scene, volume, table, len(lights))
    mixes = _mixes(scene, table, lights, len(moments))
    digits = max(4, len(str(len(moments) - 1)))
    numbers = [f"{i:0{digits}d}" for i in range(len(moments))]
    if mixes is not None:
        each = zip(numbers, moments, mixes, strict=True)
        shots = [_shot(stem, i, moment, *mix) for i, (stem, moment, mix) in enumerate(each)]
        _require_shown(scene, table, shots)
        return Plan(tuple(shots), ())
    # Coefficients are without light: one row of files, shown under the first.
    cast_only = table.format == "coefficients"
    rows = lights[:1] if cast_only else lights
    stems = [_CAST] if cast_only else distinct_stems([light.name for light in lights])
    shots = [
        _shot(stem if len(moments) == 1 else f"{stem}/{number}", i, moment, light.name, light.rig)
        for light, stem in zip(rows, stems, strict=True)
        for i, (number, moment) in enumerate(zip(numbers, moments, strict=True))
    ]
    if not cast_only:
        _require_shown(scene, table, shots)
    return Plan(tuple(shots), () if cast_only else tuple(lights))


def _shot(stem: str, number: int, moment: Moment, light: str, rig: LightRig) -> Shot:
    return Shot(stem, number, moment.camera, moment.transfer, light, rig, moment.spec)


def lights_of(scene: Scene, table: ExportTable) -> list[NamedLight]:
    """The scene's lights that ``[export]`` names, in its order; all where it names none."""
    by_name = {light.name: light for light in scene.lights}
    return [by_name[name] for name in table.lights or by_name]


def _shining(
    scene: Scene, table: ExportTable, lights: Sequence[NamedLight]
) -> Sequence[NamedLight]:
    """The lights that some frame shows; coefficient images are relit at a level of their own."""
    if table.format == "coefficients":
        return ()
    if (weights := _weights(scene)) is None:
        return lights
    lit = {name for row in weights for name, weight in row.items() if weight > 0.0}
    return [light for light in scene.lights if light.name in lit]


def _weights(scene: Scene) -> list[dict[str, float]] | None:
    """What the keyframes weigh lights by; None where they do not."""
    keys = scene.file.keyframe
    if not keys or keys[0].lights is None:
        return None
    return [key.lights or {} for key in keys]


def _moments(scene: Scene, volume: Volume, table: ExportTable, lights: int) -> list[Moment]:
    # Of a spectrum all bands are kept: the factor model would smooth those of a lamp.
    spec = replace(scene.relight, mode="exact") if table.spectral else scene.relight
    still = Moment(scene.camera(volume), scene.transfer, spec)
    with named(scene):
        check_reach(volume, still.camera, scene.raycast)
    if table.turntable is not None:
        cameras = turned(scene, volume, table.turntable)
        return [replace(still, camera=camera) for camera in cameras]
    keys = scene.file.keyframe
    if keys:
        return keyed(scene, volume, spec, times_s(keys, table.fps))
    if table.sweep is not None:
        fades = lights if table.sweep.closed else lights - 1
        frames = table.sweep.frames or _FRAMES_A_FADE * fades + (not table.sweep.closed)
        return [still] * frames
    return [still]


def _mixes(
    scene: Scene, table: ExportTable, lights: Sequence[NamedLight], count: int
) -> list[tuple[str, LightRig]] | None:
    """The light of each moment, in words too; None where every light has its own frames."""
    if table.format == "coefficients":
        return None
    if (weighted := _weights(scene)) is not None:
        times = [key.time_s for key in scene.file.keyframe]
        names = dict.fromkeys(name for weights in weighted for name in weights)
        rows = [[weights.get(name, 0.0) for name in names] for weights in weighted]
        by_name = {light.name: light for light in scene.lights}
        mixed = [by_name[name] for name in names]
        at_s = times_s(scene.file.keyframe, table.fps)
        mixes = []
        for time, row in zip(at_s.tolist(), between_keys(times, rows, at_s), strict=True):
            with named(scene, f"[[keyframe]] lights: at {time:g} s"):
                mixes.append(mix_of(mixed, row))
        return mixes
    if table.sweep is None:
        return None
    with named(scene, "[export] sweep"):
        weights = sweep_weights(len(lights), count, table.sweep.closed)
        return [mix_of(lights, row) for row in weights]


def _require_shown(scene: Scene, table: ExportTable, shots: Sequence[Shot]) -> None:
    """Refuse, before the cast, a light or an eye that no frame could be made with."""
    keys, shares = scene.file.keyframe, scene.raycast.shares()
    at_s = times_s(keys, table.fps) if keys else np.zeros(0)
    # Numbers never leave the keys they lie between: the frames next to these are enough.
    asked = {int(np.abs(at_s - key.time_s).argmin()) for key in keys}
    # What holds still is one object.
    shown = [shot for shot in shots if not keys or shot.moment in asked]
    for shot in {(id(shot.rig), id(shot.spec)): shot for shot in reversed(shown)}.values():
        when = f" at {at_s[shot.moment]:g} s" if keys else ""
        with named(scene, f"[[light]] {shot.light}{when}"):
            lit = Illumination.of(scene.basis, shot.rig, shot.spec, shares)
            if table.has_eye and shot.spec.viewing.adapting == "given":
                passage_of(lit.viewing, lit.white_XYZ)


def sweep_weights(lights: int, frames: int, closed: bool = False) -> NDArray[np.float64]:
    """Weights of lights that fade into each other one after the other, by frame.

    Returns
    -------
    (F, L) float64
        Each row sums to 1. A closed sweep ends one frame before its first light.

    Examples
    --------
    >>> sweep_weights(3, 5).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]
    """
    steps = (frames, lights) if closed else (max(frames - 1, 1), lights - 1)
    rows = np.zeros((frames, lights))
    for i, row in enumerate(rows):
        at, part = divmod(i * steps[1], steps[0])
        row[at % lights] += 1.0 - part / steps[0]
        row[(at + 1) % lights] += part / steps[0]
    return rows


def mix_of(lights: Sequence[NamedLight], weights: Sequence[float]) -> tuple[str, LightRig]:
    """Several lights of a scene as one, and what it is in words; dark ones are left out.

    Raises
    ------
    SceneError
        If some of them have lux and some have not.
    """
    lit = [(light, float(w)) for light, w in zip(lights, weights, strict=True) if w > 0.0]
    if len(lit) == 1 and lit[0][1] == 1.0:
        return lit[0][0].name, lit[0][0].rig
    said = ", ".join(f"{light.name} {weight:.3g}" for light, weight in lit)
    if len({light.rig.illuminance_lux is None for light, _ in lit}) > 1:
        raise SceneError(
            f"{said}: some of these lights have illuminance_lux and some have not; give it "
            "to all or to none"
        )
    return said, mixed_rig([light.rig for light, _ in lit], [weight for _, weight in lit])
