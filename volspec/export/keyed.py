"""What holds at each time of a film: camera, eye, transfer function.

Scene, [[keyframe]] -> motion, moved -> [keyed] -> plan, checking
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import InputError, SceneError
from volspec.export.motion import Way, between_keys, ratios_between_keys, rows_of, tracks_between
from volspec.export.moved import at_each, moved_cameras, moved_transfers
from volspec.raycast import Camera
from volspec.raycast.packed import check_reach
from volspec.relight import RelightSpec
from volspec.scene import Scene
from volspec.scene.export import KeyframeTable
from volspec.scene.wording import in_keys
from volspec.transfer import Transfer
from volspec.volume import Volume

Keys = Sequence[KeyframeTable]
Times = NDArray[np.float64]

# How each number of the eye goes from key to key.
_TONE: dict[str, Way] = {
    "exposure": ratios_between_keys,
    "L_A": ratios_between_keys,
    "Y_b": between_keys,
    "D": between_keys,
}
# Digits of a number of frames that are no rounding: 2 s at 24 a second are 48 whatever 1/24 is.
_DIGITS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What holds at a time, whatever the light."""

    camera: Camera
    transfer: Transfer
    spec: RelightSpec


def times_s(keys: Keys, fps: float) -> Times:
    """When each frame of a film is, from the first key to the last, which always has one.

    Between keys that are no whole number of frames apart the last step is the shorter.
    """
    first, last = keys[0].time_s, keys[-1].time_s
    steps = math.ceil(round((last - first) * fps, _DIGITS))
    return np.append(first + np.arange(steps) / fps, last)


def keyed(scene: Scene, volume: Volume, spec: RelightSpec, at_s: Times) -> list[Moment]:
    """What holds at every time.

    Raises
    ------
    SceneError
        If it cannot be had; the message names file and time.
    """
    # Of a number that grows too large no time between the keys is to blame.
    for line in keyframe_faults(scene, volume):
        raise SceneError(line)
    keys = scene.file.keyframe
    with named(scene, "[[keyframe]] camera"):
        cameras = _cameras(scene, volume, keys, at_s)
    with named(scene, "[[keyframe]] viewing"):
        specs = _seen(spec, keys, at_s)
    with named(scene, "[[keyframe]] transfer"):
        transfers = moved_transfers(scene, keys, at_s)
    return [Moment(*each) for each in zip(cameras, transfers, specs, strict=True)]


def keyframe_faults(scene: Scene, volume: Volume) -> list[str]:
    """All that is wrong at the keyframes' own times, a line each: file, key, time, remedy."""
    parts: dict[str, Callable[[Keys, Times], object]] = {
        "camera": lambda keys, at_s: _cameras(scene, volume, keys, at_s),
        "viewing": lambda keys, at_s: _seen(scene.relight, keys, at_s),
        "transfer": lambda keys, at_s: _tables(scene, volume, keys, at_s),
    }
    keys, lines = scene.file.keyframe, []
    for name, part in parts.items():
        saying = [key for key in keys if getattr(key, name) is not None]
        together = [line for key in saying for line in _faults(scene, name, part, keys, key)]
        # What only one key says holds at the others, too, but who wrote it is to blame.
        alone = [line for key in saying for line in _faults(scene, name, part, [key], key)]
        lines += (alone or together) if together else []
    return list(dict.fromkeys(lines))


def _faults(
    scene: Scene,
    name: str,
    part: Callable[[Keys, Times], object],
    keys: Keys,
    at: KeyframeTable,
) -> list[str]:
    """What is wrong with a part of some keyframes at the time of one."""
    try:
        with named(scene, f"[[keyframe]] {name}"):
            part(keys, np.array([at.time_s]))
    except SceneError as error:
        return [str(error)]
    return []


def _cameras(scene: Scene, volume: Volume, keys: Keys, at_s: Times) -> list[Camera]:
    """The cameras, near enough to be cast from."""
    cameras = moved_cameras(scene, volume, keys, at_s)
    at_each(at_s, keys, cameras, lambda camera: check_reach(volume, camera, scene.raycast))
    return cameras


def _tables(scene: Scene, volume: Volume, keys: Keys, at_s: Times) -> list[object]:
    """The transfer functions as a cast takes them."""
    functions = moved_transfers(scene, keys, at_s)
    return at_each(at_s, keys, functions, lambda each: each.bake(min(volume.spacing_mm)))


def _seen(spec: RelightSpec, keys: Keys, at_s: Times) -> list[RelightSpec]:
    """The eye at every time."""
    tracks = tracks_between([(key.time_s, key.viewing) for key in keys], _TONE, at_s)

    def seen(row: dict[str, Any]) -> RelightSpec:
        return replace(spec, viewing=replace(spec.viewing, **row)) if row else spec

    return at_each(at_s, keys, rows_of(tracks, len(at_s)), seen)


@contextmanager
def named(scene: Scene, place: str = "") -> Iterator[None]:
    """Put the file's name and the place in it before the message of what goes wrong inside."""
    try:
        yield
    except InputError as error:
        where = f"{scene.path}: {place}: " if place else f"{scene.path}: "
        raise SceneError(where + in_keys(str(error))) from error
