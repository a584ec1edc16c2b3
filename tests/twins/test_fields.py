"""Several fields in one cast, against the float64 reference and against what they must equal."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import volspec as vs
from tests.support.errors import refuses
from tests.support.fixtures import slow
from tests.support.raycasts import (
    METAL_BASIS,
    METALS,
    WHOLE,
    assert_matches_reference,
    carries_16_rays,
    metal_function,
)
from volspec.raycast import Ambient, ClipPlane, Directional, LightGroup, RaycastSpec
from volspec.transfer import FieldFunctions, TransferFunction
from volspec.volume import Volume

SIZE = 40, 32
TURNED = np.array([[0.6, -0.5, 0.1, 3], [0.5, 0.6, 0, -2], [0, 0.1, 0.7, 4], [0, 0, 0, 1.0]])
CURVES = {
    "a": [(80, 0.0, "copper"), (140, 0.5, "gold")],
    "b": [(400, 0.0, "gold"), (600, 0.8, "gold"), (700, 1.0, "copper")],  # opaque at its end
    "c": [(0.5, 0.0, "copper"), (0.8, 0.6, "copper")],
}


def noise(shape: tuple[int, int, int], seed: int, dtype: type, top: float) -> NDArray[np.generic]:
    values = gaussian_filter(np.random.default_rng(seed).random(shape), 2)
    return ((values - values.min()) / np.ptp(values) * top).astype(dtype)


def function(name: str) -> TransferFunction:
    return metal_function(*CURVES[name], reference_step_mm=None)


@pytest.fixture(scope="module")
def fields() -> dict[str, Volume]:
    """Bytes, shorts on the same lattice, and floats on a turned one."""
    spacing = 1.0, 1.0, 1.2
    return {
        "a": Volume(noise((20, 22, 24), 1, np.uint8, 200), spacing_mm=spacing, name="a"),
        "b": Volume(noise((20, 22, 24), 2, np.int16, 900), spacing_mm=spacing, name="b"),
        "c": Volume(noise((30, 26, 28), 3, np.float32, 1), world_from_index=TURNED, name="c"),
    }


def view(volume: Volume) -> vs.Camera:
    return vs.Camera.orbit(volume, azimuth_deg=30, elevation_deg=20)


SHADOWS = (LightGroup("g", (Ambient(occlusion=True), Directional((0.3, 0.2, 1), shadows=True))),)
LIT = {"groups": SHADOWS, "light_cells": 20}  # few, as the reference takes long
# It cuts the volume's own field only.
PLANE = ClipPlane((12.0, 10.0, 9.0), (1.0, 0.5, 0.2))
OPENED = replace(PLANE, fields=("",))


@pytest.mark.parametrize(
    ("shown", "settings", "lanes"),
    [
        ("abc", LIT, 8),
        *(slow("abc", LIT, lanes) for lanes in (1, 4, 16)),
        ("abc", {"add_fields": True, "crop_voxels": ((3, 20), (2, 18), (0, 15))}, 8),
        slow("ab", {}, None),
        slow("abc", {"crop_voxels": ((3, 20), (2, 18), (0, 15)), "jitter": 1.0}, None),
        slow("c", {"clip_planes": (PLANE,)}, None),
        ("abc", {**LIT, "clip_planes": (OPENED, replace(OPENED, fields="c"))}, None),
        slow("ab", {**LIT, "clip_planes": (OPENED, replace(OPENED, fields=("b",)))}, None),
    ],
    ids=[
        *(f"shadows-{lanes}" for lanes in (8, 1, 4, 16)),
        "added",
        *("one lattice", "crop", "one, cut", "cut apart, two lattices", "cut apart"),
    ],
)
def test_fields_match_the_reference(fields, shown, settings, lanes):
    volume = fields["a"].with_fields([fields["b"], fields["c"]])
    transfer = FieldFunctions({name: function(name) for name in shown}, {shown[-1]: 0.7})
    spec = RaycastSpec(step_mm=0.4, alpha_stop=1, **settings)
    if lanes == 16 and not carries_16_rays():
        pytest.skip("packets of 16 rays are not this device's, it may not compile them")
    assert_matches_reference(volume, transfer, view(volume), SIZE, spec, lanes)


@pytest.mark.slow
def test_extinctions_of_homogeneous_fields_add_and_materials_mix_by_extinction():
    """Beer–Lambert in closed form: two homogeneous blocks in one place, 24 mm across."""
    low = Volume(np.full((25, 25, 25), 10.0, np.float32), name="low")
    high = Volume(np.full((13, 13, 13), 20.0, np.float32), spacing_mm=(2, 2, 2), name="high")
    curves = {
        "low": metal_function((0, 0.02, "copper"), (30, 0.02, "copper")),
        "high": metal_function((0, 0.05, "gold"), (30, 0.05, "gold")),
    }
    volume = low.with_fields([high])
    camera = vs.Camera((12, 12, 200), (12, 12, 12), (0, 1, 0), height_mm=4.0)
    spec = replace(WHOLE, step_mm=0.75)
    for weight in (1.0, 2.5):
        transfer = FieldFunctions(curves, {"high": weight})
        image = vs.raycast(volume, transfer, camera, (8, 8), spec)
        tau = np.array([-np.log(0.98), -weight * np.log(0.95)])
        alpha = 1 - np.exp(-24.0 * tau.sum())
        assert image.alpha == pytest.approx(np.full((8, 8), alpha), abs=1e-5)
        expected = alpha * np.append(tau / tau.sum(), 0.0)
        assert np.abs(image.coefficients - expected).max() < 2e-5


@pytest.mark.slow
def test_fields_do_not_depend_on_their_order_and_hidden_ones_change_nothing(fields):
    a, b, c = fields.values()
    spec = RaycastSpec(step_mm=0.5)

    def cast(own: Volume, others: list[Volume], transfer: FieldFunctions) -> NDArray[np.floating]:
        return vs.raycast(own.with_fields(others), transfer, view(a), SIZE, spec).coefficients

    every = {name: function(name) for name in "abc"}
    one = cast(a, [b, c], FieldFunctions(every))
    other = cast(b, [c, a], FieldFunctions({name: every[name] for name in "cba"}))
    assert np.abs(one - other).max() < 1e-5
    hidden = cast(a, [b, c], FieldFunctions(every, {"b": 0.0, "c": 0.0}))
    alone = vs.raycast(a, function("a"), view(a), SIZE, spec).coefficients
    assert np.array_equal(hidden, alone)


@pytest.mark.slow
def test_two_lattices_differ_from_one_by_no_more_than_a_halved_step():
    """A second field on a lattice of its own, and resampled onto the first's."""
    z, y, x = np.mgrid[-1:1:33j, -1:1:33j, -1:1:33j]
    own = Volume((200 * np.exp(-3 * (x**2 + y**2 + z**2))).astype(np.float32), name="own")
    world = TURNED.copy()
    world[:3, 3] = 16 - world[:3, :3] @ np.full(3, 31.5)

    def bump(side: int, world: NDArray[np.float64]) -> Volume:
        index = np.moveaxis(np.indices((side,) * 3)[::-1], 0, -1)
        away = index @ world[:3, :3].T + world[:3, 3] - [18.0, 15.0, 16.0]
        values = (300 * np.exp(-(away**2).sum(axis=-1) / 60)).astype(np.float32)
        return Volume(values, world_from_index=world, name="other")

    turned, resampled = bump(64, world), bump(33, np.eye(4))
    copper = metal_function((60, 0.0, "copper"), (200, 0.2, "copper"))
    gold = metal_function((80, 0.0, "gold"), (300, 0.3, "gold"))
    transfer = FieldFunctions({"own": copper, "other": gold})

    def cast(other: Volume, step_mm: float) -> NDArray[np.floating]:
        spec = replace(WHOLE, step_mm=step_mm)
        return vs.raycast(own.with_fields([other]), transfer, view(own), SIZE, spec).coefficients

    one, two, halved = cast(resampled, 1.0), cast(turned, 1.0), cast(resampled, 0.5)

    def rms(difference: NDArray[np.floating]) -> float:
        return float(np.sqrt((difference**2).mean()))

    assert rms(two - one) < 2 * rms(halved - one)


@pytest.mark.parametrize("half", [False, slow(True)])
def test_light_of_fields_that_add_is_the_sum_of_each_alone(fields, half):
    volume = fields["a"].with_fields([fields["b"]])
    spec = RaycastSpec(step_mm=0.4, groups=SHADOWS, light_cells=20, half=half)
    added = vs.raycast(volume, BOTH, view(volume), SIZE, replace(spec, add_fields=True))
    one, other = (
        vs.raycast(volume, FieldFunctions({name: function(name)}), view(volume), SIZE, spec)
        for name in "ab"
    )
    total = np.float32(one.coefficients) + other.coefficients
    np.testing.assert_allclose(added.coefficients, total, atol=2e-3 if half else 1e-6)
    np.testing.assert_allclose(1 - added.alpha, (1 - one.alpha) * (1 - other.alpha), atol=1e-6)


def test_a_plane_that_names_every_field_is_lit_as_one_that_names_none(fields):
    volume = fields["a"].with_fields([fields["c"]])
    transfer = FieldFunctions({name: function(name) for name in "ac"})
    spec = RaycastSpec(step_mm=0.4, **LIT)
    all_cut, named = (
        vs.raycast(volume, transfer, view(volume), SIZE, replace(spec, clip_planes=(plane,)))
        for plane in (PLANE, replace(PLANE, fields=("", "c")))
    )
    np.testing.assert_allclose(all_cut.coefficients, named.coefficients, atol=2e-5)


@pytest.mark.slow
def test_a_plane_opens_one_field_and_leaves_the_other_whole(fields):
    volume = fields["a"].with_fields([fields["b"]])
    away = ClipPlane((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), fields=("b",))  # nothing of b stays
    one, both = (
        vs.raycast(volume, BOTH, view(volume), SIZE, RaycastSpec(clip_planes=planes))
        for planes in ((away,), ())
    )
    alone = vs.raycast(fields["a"], function("a"), view(volume), SIZE)
    np.testing.assert_allclose(one.alpha, alone.alpha, atol=2e-3)
    assert np.abs(both.alpha - alone.alpha).max() > 0.1


Parts = Callable[[Volume, Volume], object]


def shown(transfer: FieldFunctions, far: bool = False, **spec: Any) -> Parts:
    """Return a cast of the fields a and b, of which b may be a million times as large."""

    def cast(a: Volume, b: Volume) -> object:
        if far:
            b = replace(b, spacing_mm=(1e6, 1e6, 1e6), world_from_index=None)
        return vs.raycast(a.with_fields([b]), transfer, view(a), SIZE, RaycastSpec(**spec))

    return cast


A, B = function("a"), function("b")
BOTH = FieldFunctions({"a": A, "b": B})
OF_NO_FIELD = replace(OPENED, fields=("d",))
OTHER = TransferFunction(CURVES["b"], METALS, vs.SpectralBasis.load("general-5"))
STEEL: Any = vs.Isosurfaces([(80, 1.0, "gold")], METALS, METAL_BASIS)


def with_a_sheet(a: Volume, b: Volume) -> vs.CoefficientImage:
    sheet = vs.Mesh([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]], "gold", opacity=0.5)
    meshes, spec = vs.MeshCaster([sheet], METALS, METAL_BASIS), RaycastSpec(add_fields=True)
    return vs.raycast(a.with_fields([b]), BOTH, view(a), SIZE, spec, behind=[meshes])


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda a, b: a.with_fields([replace(b, name="a")]), "duplicate "),
        (lambda a, b: Volume(a.values, name="d").with_fields([a.with_fields([b])]), "conflict "),
        (lambda a, b: vs.raycast(a, BOTH, view(a), SIZE), "unknown "),
        (lambda a, b: FieldFunctions({"a": A}, {"c": 1.0}), "unknown FieldFunctions.weights['c']"),
        (lambda a, b: FieldFunctions({"a": A}, {"a": -1.0}), "range FieldFunctions.weights['a']"),
        (lambda *_: FieldFunctions({"a": A, "b": OTHER}), "conflict FieldFunctions.functions['b']"),
        (shown(FieldFunctions({"": A, "a": A})), "duplicate "),
        (shown(BOTH, mode="maximum"), "conflict RaycastSpec.mode"),
        (shown(BOTH, preintegrated=True), "conflict RaycastSpec.preintegrated"),
        (shown(BOTH, adaptive=0.01), "conflict RaycastSpec.adaptive"),
        (shown(BOTH, clip_planes=(OF_NO_FIELD,)), "range RaycastSpec.clip_planes[0].fields"),
        (shown(BOTH, far=True), "range "),
        (with_a_sheet, "conflict "),
    ],
)
def test_what_does_not_fit_together_is_refused(fields, make, fault):
    refuses(lambda: make(fields["a"], fields["b"]), fault)
