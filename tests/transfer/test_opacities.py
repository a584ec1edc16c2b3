"""Scaled opacities of materials: Beer-Lambert's law per material, and what cannot be scaled."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.fixtures import slow_each
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.camera import Camera
from volspec.errors import RaycastError, TransferError
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.spectra import reflectance
from volspec.transfer import Isosurfaces, SurfaceTable, TransferFunction
from volspec.transfer.opacities import scale_opacities
from volspec.volume import Volume, phantom

MATERIALS = {name: reflectance(name) for name in ("copper", "gold")}
BASIS = MaterialBasis(MATERIALS)
POINTS = [(0.0, 0.2, "copper"), (0.5, 0.5, {"copper": 0.5, "gold": 0.5}), (1.0, 1.0, "gold")]
SURFACES = Isosurfaces([(0.3, 0.8, "copper"), (0.5, 0.8, "gold")], MATERIALS, BASIS)


def curve(basis: Any = BASIS) -> TransferFunction:
    return TransferFunction(POINTS, MATERIALS, basis, reference_step_mm=1.0)


def test_each_material_s_optical_depth_is_scaled():
    table = curve().bake(1.0)
    found = scale_opacities(table, BASIS, {"copper": 3.0, "gold": 0.5})
    tau = -np.log1p(-table.opacity[:-1])[:, None] * table.material_weights[:-1]
    wanted = tau * [3.0, 0.5]
    np.testing.assert_allclose(-np.log1p(-found.opacity[:-1]), wanted.sum(axis=1), rtol=1e-9)
    shares = wanted / wanted.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.material_weights[:-1], shares, atol=1e-12)
    assert found.opacity[-1] == 1  # opaque stays opaque


def test_scales_of_1_leave_a_table_as_it_is_and_0_hides():
    table = curve().bake(1.0)
    assert scale_opacities(table, BASIS, {"copper": 1.0}) is table
    hidden = scale_opacities(table, BASIS, {"gold": 0.0})
    assert hidden.opacity[-1] == 0 and hidden.opacity[0] == pytest.approx(0.2)
    channels = BASIS.channels_for_materials(MATERIALS)
    surfaces = SurfaceTable([0.2, 0.8], [0.5, 1.0], np.eye(2), channels)
    found = scale_opacities(surfaces, BASIS, {"copper": 2.0, "gold": 0.0})
    np.testing.assert_allclose(found.opacity, [0.75, 0.0])


def test_functions_that_step_are_scaled_on_both_sides():
    points = [(0.0, 0.2, "copper"), (0.5, 0.2, "copper"), (0.5, 0.6, "gold"), (1.0, 0.6, "gold")]
    table = TransferFunction(points, MATERIALS, BASIS, reference_step_mm=1.0).bake(1.0)
    found = scale_opacities(table, BASIS, {"copper": 2.0})
    step = np.flatnonzero(table.left.opacity != table.opacity)
    np.testing.assert_allclose(found.left.opacity[step], 1 - 0.8**2)
    np.testing.assert_allclose(found.opacity[step], 0.6)


@pytest.mark.not_quick
@pytest.mark.parametrize("transfer", [curve(), *slow_each(SURFACES)])
def test_a_cast_with_a_hidden_material_is_one_of_a_function_without_it(transfer):
    volume = Volume(phantom.ball(16).values)
    caster, camera = Raycaster(volume), Camera.orbit(volume)
    spec = RaycastSpec(step_mm=0.5, opacities={"gold": 0.0})
    plain = raycast(volume, transfer, camera, (16, 16), replace(spec, opacities={}), caster=caster)
    found = raycast(volume, transfer, camera, (16, 16), spec, caster=caster)
    again = raycast(volume, transfer, camera, (16, 16), replace(spec, opacities={}), caster=caster)
    gold = [*BASIS.materials].index("gold")
    assert plain.coefficients[..., gold].any() and not found.coefficients[..., gold].any()
    np.testing.assert_array_equal(again.coefficients, plain.coefficients)


@pytest.mark.parametrize(
    ("basis", "scales", "error"),
    [
        (BASIS, {"silver": 0.5}, TransferError),
        (SpectralBasis.load("general-7"), {"gold": 0.5}, TransferError),
        (BASIS, {"gold": -1.0}, RaycastError),
        (BASIS, {"gold": float("nan")}, RaycastError),
        (BASIS, {1: 2.0}, RaycastError),
    ],
)
def test_what_cannot_be_scaled_is_named(basis, scales, error):
    with raises(error):
        scale_opacities(curve(basis).bake(1.0), basis, RaycastSpec(opacities=scales).opacities)
