"""Raycast settings, lights and cuts refuse nonsense at birth, in one line that names it."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, ClassVar, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import refuses
from volspec._checks import MAX_WEIGHT
from volspec.camera.camera import Orbit
from volspec.raycast.launch.kernel_arguments import MAX_REACH, check_reach
from volspec.raycast.lights import MAX_GROUPS, MAX_NAME, MAX_SOURCES
from volspec.raycast.spec import MAX_PLANES, MAX_STEPS

PLANE = vs.ClipPlane((0, 0, 0), (1, 0, 0))
BALL = vs.phantom.ball(16)
SLAB = vs.Volume(np.zeros((4, 64, 64), np.uint8), spacing_mm=(1, 1, 1e-4), name="slab")


def group(name: str = "key", count: int = 1) -> vs.LightGroup:
    return vs.LightGroup(name, (vs.Headlight(),) * count)


@pytest.mark.parametrize("unit", [1.0, 1e-200, 1e30])
@pytest.mark.parametrize("cone_deg", [0.5, 1.0, 60.0])
def test_a_sharp_cone_is_whole_on_its_axis_at_any_unit(unit, cone_deg):
    camera = vs.Camera((0, 0, 9), (0, 0, 0), (0, 1, 0))
    spot = vs.Spot((0, 0, 0), target_mm=(0, 3 * unit, 4 * unit), cone_deg=cone_deg, edge_deg=0)
    *plane, height = spot.beam(camera)
    assert np.dot(plane, (0, -0.6, -0.8)) + height >= 1.0
    tilt = np.radians(cone_deg)  # about x, to the rim
    rim = np.array([0, -0.6, -0.8]) * np.cos(tilt) + np.array([0, -0.8, 0.6]) * np.sin(tilt)
    assert np.dot(plane, rim) + height == pytest.approx(0.0, abs=1e-6)


def many_groups(count: int, sources: int = 1) -> tuple[vs.LightGroup, ...]:
    return tuple(group(f"g{i}", sources) for i in range(count))


NEEDED: dict[type, dict[str, Any]] = {
    **{kind: {} for kind in (vs.RaycastSpec, Orbit, vs.Ambient, vs.Headlight)},
    vs.Camera: {"position_mm": (0, 0, 0), "target_mm": (0, 9, 0)},
    vs.Directional: {"towards": (1, 0, 0)},
    vs.Point: {"position_mm": (1, 2, 3)},
    vs.Spot: {"position_mm": (1, 2, 3), "target_mm": (1, 2, 4)},
}


def wrong_numbers() -> Iterator[tuple[type, str, Any, str]]:
    """Class, field, a value that its type or a bound does not hold, and the error's code."""
    for kind in NEEDED:
        for name, hint in get_type_hints(kind, include_extras=True).items():
            inner = [each for each in (hint, *get_args(hint)) if hasattr(each, "__metadata__")]
            base = get_args(inner[0])[0] if inner else hint
            if base not in (int, float) or get_origin(hint) is ClassVar:
                continue
            yield from ((kind, name, wrong, "type") for wrong in ("half", True))
            yield kind, name, *((2.5, "type") if base is int else (np.nan, "range"))
            marks = (mark for each in inner for mark in each.__metadata__)
            for row in (row for mark in marks for row in getattr(mark, "metadata", [])):
                for bound, sign in (("ge", -1), ("gt", 0), ("le", 1), ("lt", 0)):
                    if hasattr(row, bound):
                        limit = getattr(row, bound)
                        yield kind, name, limit + sign * max(1, abs(limit)), "range"


def steps_of(volume: vs.Volume, **settings: Any) -> Callable[[], object]:
    return lambda: vs.RaycastSpec(**settings).step_of(volume)


def crops_of(*bounds: tuple[float, float]) -> Callable[[], object]:
    return lambda: vs.RaycastSpec(crop_voxels=bounds).kept(BALL)


SETTINGS: list[tuple[dict[str, Any], str, str]] = [
    ({"mode": "maximun"}, "unknown", "mode"),
    ({"mode": "average", "preintegrated": True}, "conflict", "preintegrated"),
    ({"crop_voxels": ((0, 9), (0, 9), (5, 5))}, "range", "crop_voxels"),
    ({"crop_voxels": ((9, 0), (0, 9), (0, 9))}, "range", "crop_voxels"),
    ({"crop_voxels": ((0, 9), (0, 9))}, "shape", "crop_voxels"),
    ({"crop_voxels": ((0, 9), (0, np.nan), (0, 9))}, "range", "crop_voxels"),
    ({"crop_voxels": "all"}, "type", "crop_voxels"),
    ({"crop_voxels": ((0, 9), 3, 4)}, "type", "crop_voxels[1]"),
    ({"clip_planes": ((1, 0, 0),)}, "type", "clip_planes[0]"),
    ({"clip_planes": (PLANE,) * (MAX_PLANES + 1)}, "size", "clip_planes"),
    ({"groups": ()}, "missing", "groups"),
    ({"groups": (vs.Headlight(),)}, "type", "groups[0]"),
    ({"groups": (group(), group())}, "duplicate", "groups"),
    ({"groups": many_groups(MAX_GROUPS + 1)}, "size", "groups"),
    ({"groups": (group("a"), group("b", MAX_SOURCES))}, "size", "groups"),
    ({"quality": "best"}, "unknown", "quality"),
    *(({"quality": wrong}, "type", "quality") for wrong in (0.0, 0.5, True, None)),
]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        *(
            (
                lambda kind=kind, name=name, wrong=wrong: kind(**NEEDED[kind], **{name: wrong}),
                f"{code} {kind.__name__}.{name}",
            )
            for kind, name, wrong, code in wrong_numbers()
        ),
        *(
            (lambda settings=settings: vs.RaycastSpec(**settings), f"{fault} RaycastSpec.{name}")
            for settings, fault, name in SETTINGS
        ),
        (lambda: vs.Directional((0, 0, 0)), "range Directional.towards"),
        (lambda: vs.Directional("much"), "type Directional.towards"),
        (lambda: vs.Directional((1, 2, np.nan)), "range Directional.towards[2]"),
        (lambda: vs.Directional((1, 2)), "shape Directional.towards"),
        (lambda: vs.Directional(("1", "2", "3")), "type Directional.towards[0]"),
        (lambda: vs.Directional((1, 0, 0), frame="eye"), "unknown Directional.frame"),
        (lambda: vs.Point((1, 2, np.inf)), "range Point.position_mm[2]"),
        (lambda: vs.Point((1, 2, 3), frame=None), "type Point.frame"),
        (lambda: vs.Spot((1, 2, 3), target_mm=(1, 2, 3)), "range Spot.target_mm"),
        (lambda: vs.LightGroup("", (vs.Headlight(),)), "missing LightGroup.name"),
        (lambda: vs.LightGroup("  ", (vs.Headlight(),)), "missing LightGroup.name"),
        (lambda: vs.LightGroup(7, (vs.Headlight(),)), "type LightGroup.name"),
        (lambda: group("n" * (MAX_NAME + 1)), "size LightGroup.name"),
        (lambda: vs.LightGroup("key", ()), "missing LightGroup.sources"),
        (lambda: vs.LightGroup("key", (1,)), "unknown LightGroup.sources[0]"),
        (lambda: vs.LightGroup("key", None), "unknown LightGroup.sources[0]"),
        (lambda: vs.ClipPlane((0, 0, 0), (0, 0, 0)), "range ClipPlane.normal"),
        (lambda: vs.ClipPlane((0, 0, 0), (0, np.nan, 1)), "range ClipPlane.normal[1]"),
        (lambda: vs.ClipPlane((0, 0), (0, 0, 1)), "shape ClipPlane.point_mm"),
        # Outside of the volume nothing is left.
        (crops_of((0, 9), (15, 20), (0, 9)), "range RaycastSpec.crop_voxels"),
        (crops_of((-9, 0), (0, 9), (0, 9)), "range RaycastSpec.crop_voxels"),
        (steps_of(BALL, step_mm=1e-5), "range RaycastSpec.step_mm"),
        (steps_of(BALL, step_mm=26), "range RaycastSpec.step_mm"),
        (steps_of(SLAB), "range RaycastSpec.step_mm"),
    ],
)
def test_settings_lights_and_planes_that_make_no_sense_are_named(make, message):
    refuses(make, message)


def test_weights_names_lights_and_planes_may_be_as_many_and_large_as_is_allowed():
    groups = many_groups(MAX_GROUPS, MAX_SOURCES // MAX_GROUPS)
    spec = vs.RaycastSpec(ambient=MAX_WEIGHT, groups=groups, clip_planes=(PLANE,) * MAX_PLANES)
    assert (spec.ambient, spec.groups, len(spec.clip_planes)) == (MAX_WEIGHT, groups, MAX_PLANES)
    assert group("n" * MAX_NAME).name == "n" * MAX_NAME


def test_one_of_a_kind_and_lists_are_taken_as_tuples():
    spec = vs.RaycastSpec(groups=group(), clip_planes=[PLANE])
    assert spec.groups == (group(),) and spec.clip_planes == (PLANE,)
    assert vs.LightGroup("key", vs.Headlight()) == group()


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1.0, 1e200, 1e308])
def test_directions_are_unit_vectors_and_stay_what_they_are(length):
    """Written and read again it is equal, to the last bit."""
    rng = np.random.default_rng(8)
    for way in [(1, 0, 0), (0, -1, 1), *rng.normal(size=(50, 3)).clip(-1, 1)]:
        x, y, z = (float(v) for v in np.multiply(way, length))
        if not (x or y or z):
            continue
        light, plane = vs.Directional((x, y, z)), vs.ClipPlane((0, 0, 0), (x, y, z))
        assert np.linalg.norm(light.towards) == pytest.approx(1, abs=1e-15)
        assert light.towards == plane.normal
        assert vs.Directional(light.towards) == light and replace(plane) == plane
        if length > 1e-300:
            assert np.allclose(light.towards, np.array(way) / np.linalg.norm(way), atol=1e-15)


def test_a_crop_is_cut_to_the_volume():
    low, high = vs.RaycastSpec(crop_voxels=((-9, 3), (2.5, 1e300), (0, 15))).kept(BALL)
    assert low.tolist() == [0, 2.5, 0] and high.tolist() == [3, 15, 15]


def test_the_shortest_steps_are_as_many_as_a_ray_may_take():
    across = 15 * np.sqrt(3)
    assert vs.RaycastSpec(step_mm=1.01 * across / MAX_STEPS).step_of(BALL) < 1e-3
    # What the error of the slab's default step advises.
    assert vs.RaycastSpec(step_mm=0.00068).step_of(SLAB) == 0.00068


def test_what_is_as_far_as_may_be_is_within_reach():
    far = 0.99 * MAX_REACH * 15 * np.sqrt(3)
    lamps = (vs.Point((far, 0, 0), falloff_mm=far), vs.Point((0, far, 0), frame="camera"))
    camera = vs.Camera((far, 9, 0), (0, 0, 0), height_mm=far)
    check_reach(BALL, camera, vs.RaycastSpec(groups=vs.LightGroup("lamps", lamps)))


def test_strengths_are_what_a_white_gets_and_shares_their_parts():
    assert sum(vs.RaycastSpec().strengths().values()) == 1
    groups = vs.LightGroup("sky", (vs.Ambient(3),)), group("key", 2)
    spec = vs.RaycastSpec(ambient=0.5, diffuse=2, groups=groups)
    assert spec.strengths() == {"sky": 1.5, "key": 4}
    assert spec.shares() == {"sky": 1.5 / 5.5, "key": 4 / 5.5}
    assert replace(spec, ambient=0, diffuse=0).shares() == {"sky": 0.5, "key": 0.5}
