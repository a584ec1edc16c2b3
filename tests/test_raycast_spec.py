"""Raycast settings, lights and cuts refuse nonsense at birth, in one line that names it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from volspec.errors import RaycastError
from volspec.raycast import (
    Ambient,
    Camera,
    ClipPlane,
    Directional,
    Headlight,
    LightGroup,
    Point,
    RaycastSpec,
)
from volspec.raycast.checks import MAX_WEIGHT
from volspec.raycast.lights import MAX_GROUPS, MAX_NAME, MAX_SOURCES
from volspec.raycast.reach import MAX_REACH, check_reach
from volspec.raycast.spec import MAX_PLANES, MAX_STEPS
from volspec.volume import Volume, phantom

PLANE = ClipPlane((0, 0, 0), (1, 0, 0))


def group(name: str = "key", count: int = 1) -> LightGroup:
    return LightGroup(name, (Headlight(),) * count)


def cropped(*bounds: tuple[float, float]) -> dict[str, Any]:
    return {"crop_voxels": bounds}


def refuses(make: Callable[[], object], message: str) -> None:
    with pytest.raises(RaycastError) as refused:
        make()
    assert message in str(refused.value)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 250


WEIGHTS = ("ambient", "diffuse", "specular", "flat_gradient", "adaptive")
NUMBERS = (*WEIGHTS, "step_mm", "alpha_stop", "jitter", "first_opacity", "tile_ms")


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("half", "is 'half'; give a number"),
        ("1", "is '1'; give a number"),
        (True, "is True; give a number"),
        ((1, 2), "is (1, 2); give a number"),
        (1j, "is 1j; give a number"),
        (np.nan, "is nan; give a finite number"),
        (-np.inf, "is -inf; give a finite number"),
        (-1, "is -1"),
    ],
)
def test_what_is_no_number_in_range_is_named(name: str, given: Any, message: str) -> None:
    refuses(lambda: RaycastSpec(**{name: given}), f"raycast: {name} {message}")


@pytest.mark.parametrize("name", WEIGHTS)
def test_weights_have_an_end(name: str) -> None:
    assert getattr(RaycastSpec(**{name: MAX_WEIGHT}), name) == MAX_WEIGHT
    given: dict[str, Any] = {name: 1e200}
    refuses(lambda: RaycastSpec(**given), f"{name} is 1e+200; give a number of 0 or more, up to")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"step_mm": 0}, "step_mm is 0; give a number above 0"),
        ({"tile_ms": 0}, "tile_ms is 0; give a number above 0"),
        ({"alpha_stop": 0}, "alpha_stop is 0.0; give 0…1, above 0"),
        ({"alpha_stop": 1.5}, "alpha_stop is 1.5; give 0…1, above 0"),
        ({"first_opacity": 0}, "first_opacity is 0.0; give 0…1, above 0"),
        ({"jitter": 1.01}, "jitter is 1.01; give 0 to 1 step"),
        ({"shininess": 0}, "shininess is 0; give a whole number of 1 to 1024"),
        ({"shininess": 1025}, "shininess is 1025; give a whole number"),
        ({"shininess": 2.5}, "shininess is 2.5; give a whole number"),
        ({"shininess": "32"}, "shininess is '32'; give a whole number"),
        ({"shininess": True}, "shininess is True; give a whole number"),
        ({"seed": -1}, "seed is -1; give a whole number of 0 to 4294967295"),
        ({"seed": 1 << 32}, "seed is 4294967296; give a whole number"),
        ({"seed": np.nan}, "seed is nan; give a whole number"),
        ({"light_cells": 7}, "light_cells is 7; give a whole number of 8 to 512"),
        ({"light_cells": 513}, "light_cells is 513; give a whole number of 8 to 512"),
        ({"mode": "maximun"}, "mode is 'maximun'; did you mean 'maximum'"),
        ({"mode": None}, "mode is None; give composite, maximum, average"),
        ({"mode": "average", "preintegrated": True}, "no meaning with mode 'average'"),
        (cropped((0, 9), (0, 9), (5, 5)), "crop_voxels along z is 5 to 5; nothing would be left"),
        (cropped((9, 0), (0, 9), (0, 9)), "crop_voxels along x is 9 to 0; nothing would be left"),
        (cropped((0, 9), (0, 9)), "crop_voxels is ((0, 9), (0, 9)); give ((x0, x1), (y0"),
        (cropped((0, 9), (0, np.nan), (0, 9)), "crop_voxels is ((0, 9), (0, nan), (0, 9)); give"),
        ({"crop_voxels": "all"}, "crop_voxels is 'all'; give ((x0, x1)"),
        ({"crop_voxels": ((0, 9), 3, 4)}, "crop_voxels is ((0, 9), 3, 4); give ((x0, x1)"),
        ({"crop_voxels": 5}, "crop_voxels is 5; give ((x0, x1)"),
        ({"clip_planes": None}, "clip_planes is (None,); give up to 6 ClipPlanes"),
        ({"clip_planes": "xy"}, "clip_planes is ('xy',); give up to 6 ClipPlanes"),
        ({"clip_planes": ((1, 0, 0),)}, "clip_planes is ((1, 0, 0),); give up to 6"),
        ({"clip_planes": (PLANE,) * (MAX_PLANES + 1)}, "give up to 6 ClipPlanes"),
        ({"groups": ()}, "groups is (); give LightGroups, at least one"),
        ({"groups": None}, "groups is (None,); give LightGroups"),
        ({"groups": "key"}, "groups is ('key',); give LightGroups"),
        ({"groups": (Headlight(),)}, "groups is (Headlight("),
        ({"groups": (group(), group())}, "two light groups are named 'key'; rename one"),
        (
            {"groups": tuple(group(f"g{i}") for i in range(MAX_GROUPS + 1))},
            "9 light groups with 9 sources; at most 8 and 16 can be cast",
        ),
        (
            {"groups": (group("a"), group("b", MAX_SOURCES))},
            "2 light groups with 17 sources; at most 8 and 16 can be cast",
        ),
    ],
)
def test_settings_that_make_no_sense_are_named(settings: dict[str, Any], message: str) -> None:
    refuses(lambda: RaycastSpec(**settings), message)


def test_as_many_lights_and_planes_as_are_allowed_are_taken() -> None:
    groups = tuple(group(f"g{i}", MAX_SOURCES // MAX_GROUPS) for i in range(MAX_GROUPS))
    spec = RaycastSpec(groups=groups, clip_planes=(PLANE,) * MAX_PLANES)
    assert spec.groups == groups and len(spec.clip_planes) == MAX_PLANES


def test_one_of_a_kind_and_lists_are_taken_as_tuples() -> None:
    spec = RaycastSpec(groups=group(), clip_planes=[PLANE])
    assert spec.groups == (group(),) and spec.clip_planes == (PLANE,)
    assert LightGroup("key", Headlight()) == group()


BAD: Any = "much"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Headlight(-1), "headlight: intensity is -1; give a number of 0 or more"),
        (lambda: Headlight(BAD), "headlight: intensity is 'much'; give a number"),
        (lambda: Ambient(np.nan), "ambient light: intensity is nan; give a finite number"),
        (lambda: Ambient(1e39), "ambient light: intensity is 1e+39; give a number of 0 or more"),
        (lambda: Ambient(radius_mm=0), "ambient light: radius_mm is 0; give a number above 0"),
        (lambda: Ambient(radius_mm=np.inf), "ambient light: radius_mm is inf; give a finite"),
        (lambda: Ambient(radius_mm=BAD), "ambient light: radius_mm is 'much'; give a number"),
        (lambda: Directional((0, 0, 0)), "directional light: towards is (0, 0, 0); give a direc"),
        (lambda: Directional(BAD), "towards is 'much'; give three finite numbers"),
        (lambda: Directional((1, 2, np.nan)), "towards is (1, 2, nan); give three finite numbers"),
        (lambda: Directional((1, 2)), "towards is (1, 2); give three finite numbers"),
        (lambda: Directional(("1", "2", "3")), "towards is ('1', '2', '3'); give three"),
        (lambda: Directional((1, 0, 0), frame="eye"), "frame is 'eye'; give 'world' or 'camera'"),
        (lambda: Directional((1, 0, 0), intensity=-2), "directional light: intensity is -2"),
        (lambda: Point((1, 2, np.inf)), "point light: position_mm is (1, 2, inf); give three"),
        (lambda: Point(BAD), "point light: position_mm is 'much'; give three"),
        (lambda: Point((1, 2, 3), frame=None), "point light: frame is None; give 'world'"),
        (lambda: Point((1, 2, 3), falloff_mm=0), "point light: falloff_mm is 0; give a number"),
        (lambda: Point((1, 2, 3), falloff_mm=-5), "point light: falloff_mm is -5; give a number"),
        (lambda: Point((1, 2, 3), falloff_mm=BAD), "point light: falloff_mm is 'much'; give"),
        (lambda: LightGroup("", (Headlight(),)), "light group: name is ''; give a word"),
        (lambda: LightGroup("  ", (Headlight(),)), "light group: name is '  '; give a word"),
        (lambda: LightGroup(7, (Headlight(),)), "light group: name is 7; give a word"),
        (lambda: group("n" * (MAX_NAME + 1)), "the name has 65 characters; give 64 at most"),
        (lambda: LightGroup("key", ()), "light group 'key': no source; give at least one"),
        (lambda: LightGroup("key", (1,)), "light group 'key': 1 is no source; give Ambient"),
        (lambda: LightGroup("key", None), "light group 'key': None is no source; give"),
        (lambda: ClipPlane((0, 0, 0), (0, 0, 0)), "clip plane: normal is (0, 0, 0); give a direc"),
        (lambda: ClipPlane((0, 0, 0), (0, np.nan, 1)), "clip plane: normal is (0, nan, 1); give"),
        (lambda: ClipPlane(BAD, (0, 0, 1)), "clip plane: point_mm is 'much'; give three finite"),
        (lambda: ClipPlane(5, (0, 0, 1)), "clip plane: point_mm is 5; give three finite"),
        (lambda: ClipPlane((0, 0), (0, 0, 1)), "clip plane: point_mm is (0, 0); give three"),
    ],
)
def test_lights_and_planes_that_make_no_sense_are_named(
    make: Callable[[], object], message: str
) -> None:
    refuses(make, message)


def test_a_name_of_64_characters_is_taken() -> None:
    assert group("n" * MAX_NAME).name == "n" * MAX_NAME


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1.0, 1e200, 1e308])
def test_directions_are_unit_vectors_and_stay_what_they_are(length: float) -> None:
    """What is written and read again is equal, to the last bit."""
    rng = np.random.default_rng(8)
    for way in [(1, 0, 0), (0, -1, 1), *rng.normal(size=(50, 3)).clip(-1, 1)]:
        x, y, z = (float(v) for v in np.multiply(way, length))
        if not (x or y or z):
            continue
        light, plane = Directional((x, y, z)), ClipPlane((0, 0, 0), (x, y, z))
        assert np.linalg.norm(light.towards) == pytest.approx(1, abs=1e-15)
        assert light.towards == plane.normal
        assert Directional(light.towards) == light and replace(plane) == plane
        if length > 1e-300:
            assert np.allclose(light.towards, np.array(way) / np.linalg.norm(way), atol=1e-15)


def test_a_crop_outside_the_volume_leaves_nothing() -> None:
    volume = phantom.ball(16)
    for crop, message in (
        (((0, 9), (15, 20), (0, 9)), "along y is 15 to 20; ball reaches from 0 to 15, nothing"),
        (((-9, 0), (0, 9), (0, 9)), "along x is -9 to 0; ball reaches from 0 to 15, nothing"),
    ):
        spec = RaycastSpec(crop_voxels=crop)
        refuses(lambda spec=spec: spec.kept(volume), message.replace("ball", volume.name))
    low, high = RaycastSpec(crop_voxels=((-9, 3), (2.5, 1e300), (0, 15))).kept(volume)
    assert low.tolist() == [0, 2.5, 0] and high.tolist() == [3, 15, 15]


def test_steps_too_many_or_too_few_are_refused() -> None:
    volume = phantom.ball(16)
    across = 15 * np.sqrt(3)
    assert RaycastSpec(step_mm=1.01 * across / MAX_STEPS).step_of(volume) < 1e-3
    refuses(lambda: RaycastSpec(step_mm=1e-5).step_of(volume), "step_mm is 1e-05 and")
    refuses(lambda: RaycastSpec(step_mm=1e-5).step_of(volume), "give 1 to 131072, half a voxel is")
    refuses(lambda: RaycastSpec(step_mm=26).step_of(volume), "0.99926 steps; give 1 to 131072")


def test_the_default_step_is_refused_where_it_takes_too_many() -> None:
    volume = Volume(np.zeros((4, 64, 64), np.uint8), spacing_mm=(1, 1, 1e-4), name="slab")
    refuses(
        lambda: RaycastSpec().step_of(volume),
        "step_mm is left out, half of slab's smallest spacing is 5e-05 and it is 89.0955 mm "
        "across: 1.78191e+06 steps; give step_mm, 0.00068 or more",
    )
    assert RaycastSpec(step_mm=0.00068).step_of(volume) == 0.00068


def test_what_is_as_far_as_may_be_is_within_reach() -> None:
    volume = phantom.ball(16)
    far = 0.99 * MAX_REACH * 15 * np.sqrt(3)
    lamps = (Point((far, 0, 0), falloff_mm=far), Point((0, far, 0), frame="camera"))
    camera = Camera((far, 9, 0), (0, 0, 0), height_mm=far)
    check_reach(volume, camera, RaycastSpec(groups=LightGroup("lamps", lamps)))


def test_strengths_are_what_a_white_gets_and_shares_their_parts() -> None:
    assert sum(RaycastSpec().strengths().values()) == 1
    spec = RaycastSpec(
        ambient=0.5, diffuse=2, groups=(LightGroup("sky", (Ambient(3),)), group("key", 2))
    )
    assert spec.strengths() == {"sky": 1.5, "key": 4}
    assert spec.shares() == {"sky": 1.5 / 5.5, "key": 4 / 5.5}
    dark = replace(spec, ambient=0, diffuse=0)
    assert dark.shares() == {"sky": 0.5, "key": 0.5}
