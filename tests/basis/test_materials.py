"""Materials as channels: exact under any light, editable without a new cast."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volspec.basis import MaterialBasis, load_basis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.large import Raycaster
from volspec.pipeline import Relighter, raycast
from volspec.raycast import RaycastSpec
from volspec.spectra import SpectralGrid, Spectrum, XYZ_from_spectra, light, reflectance, white_XYZ
from volspec.transfer import TransferFunction
from volspec.volume import phantom

MATERIALS = {name: reflectance(name) for name in ("copper", "gold", "ColorChecker/cyan")}
BASIS = MaterialBasis(MATERIALS)
POINTS = [
    (0.1, 0.0, "copper"),
    (0.4, 0.2, {"copper": 0.5, "ColorChecker/cyan": 0.5}),
    (0.9, 0.6, "gold"),
]
SPEC = RaycastSpec(specular=0.4)


def cast(materials: dict[str, Spectrum], basis: MaterialBasis) -> CoefficientImage:
    volume, transfer = phantom.ball(32), TransferFunction(POINTS, materials, basis)
    return raycast(volume, transfer, Camera.orbit(volume), (48, 40), SPEC)


@pytest.fixture(scope="module")
def ball() -> CoefficientImage:
    return cast(MATERIALS, BASIS)


@pytest.mark.not_quick
def test_a_cast_of_materials_is_the_cast_of_all_bands():
    """The same rays with a channel for each of 4 bands: as many as of three materials and white.

    float32 sums of a hundred steps differ by 1e-5 of white's 1.
    """
    grid = SpectralGrid(400, 700, 100)
    basis = MaterialBasis(MATERIALS, grid=grid)
    volume = phantom.ball(32)
    caster, given = Raycaster(volume), (Camera.orbit(volume), (48, 40), SPEC)
    table = TransferFunction(POINTS, MATERIALS, basis).bake(1.0)
    spectra = basis.synthesise(table.coefficients)
    assert spectra.shape[1] == 4
    in_bands = replace(table, material_weights=spectra, channels=np.eye(4), white=np.ones(4))
    weights, bands = (caster.cast(each, *given).coefficients for each in (table, in_bands))
    assert np.allclose(basis.synthesise(weights), bands, atol=2e-5)
    for name in ("FL2", "A"):
        lamp = light(name, grid)
        shown = basis.xyz(weights, lamp)
        assert np.allclose(shown / 100, XYZ_from_spectra(lamp, bands) / 100, atol=2e-5), name


@pytest.mark.not_quick
def test_highlights_are_white_and_not_a_material_s(ball):
    assert ball.coefficients[..., -1].max() > 0.01
    lamp = light("A")
    assert np.allclose(BASIS.xyz(BASIS.white, lamp), white_XYZ(lamp))


@pytest.mark.not_quick
def test_an_edited_reflectance_shows_without_a_new_cast(ball):
    """Equal to a cast with that reflectance; it outlives `update`, as after a camera move."""
    blue = {"gold": reflectance("ColorChecker/blue")}
    changed = MATERIALS | blue
    with Relighter(ball) as edited, Relighter(cast(changed, MaterialBasis(changed))) as again:
        before = edited.frame(light("D65"))
        edited.set_reflectances(blue)
        after = edited.frame(light("D65"))
        assert np.array_equal(after, again.frame(light("D65")))
        edited.update(ball)
        assert np.array_equal(after, edited.frame(light("D65")))
    assert np.abs(after.astype(int) - before).max() > 10


@pytest.mark.not_quick
def test_files_keep_bases_and_images(ball, tmp_path):
    ball.save(tmp_path / "ball.exr")
    loaded = CoefficientImage.load(tmp_path / "ball.exr").basis
    assert isinstance(loaded, MaterialBasis) and list(loaded.materials) == list(MATERIALS)
    BASIS.save(tmp_path / "ball.json")
    assert load_basis(tmp_path / "ball.json").fingerprint == BASIS.fingerprint


@given(st.lists(st.floats(0, 1), min_size=4, max_size=4), st.sampled_from(["A", "FL11", "HP1"]))
@settings(max_examples=30, deadline=None)
def test_mixtures_are_the_colours_of_mixed_spectra(shares, name):
    lamp = light(name)
    mixed = BASIS.synthesise(shares)
    assert np.allclose(BASIS.xyz(shares, lamp), XYZ_from_spectra(lamp, mixed), atol=1e-9)


@pytest.mark.parametrize("grid", [SpectralGrid(360, 830, 5), SpectralGrid(360, 830, 1)])
@pytest.mark.parametrize("observer_deg", [2, 10])
def test_any_grid_and_observer(grid, observer_deg):
    names = ("copper", "ColorChecker/cyan")
    basis = MaterialBasis({n: reflectance(n, grid) for n in names}, "m", grid, observer_deg)
    lamp = light("FL2", grid)
    for k, spectrum in enumerate(basis.materials.values()):
        exact = XYZ_from_spectra(lamp, spectrum, observer_deg)
        assert np.allclose(basis.xyz(np.eye(3)[k], lamp), exact)
