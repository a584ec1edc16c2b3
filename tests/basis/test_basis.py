"""The basis' algebra, its files, and its refusals."""

import dataclasses
import json

import numpy as np
import pytest

from volspec.appearance.models.lab import cielab
from volspec.basis import SpectralBasis
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
    reflectance,
    reflectance_set,
    white_XYZ,
)
from volspec.spectra.datasets import colour_science

BANDS = DEFAULT_GRID.size
LIGHTS = [light(n) for n in ("D65", "A", "FL2")]
REFLECTANCES = [reflectance(f"ColorChecker/{n}") for n in ("red", "green", "blue", "yellow")]


@pytest.fixture(scope="module")
def scene() -> SpectralBasis:
    return SpectralBasis.fit(LIGHTS, REFLECTANCES, size=5, restarts=0)


@pytest.fixture(scope="module")
def sharpened() -> SpectralBasis:
    return SpectralBasis.fit(LIGHTS, REFLECTANCES, size=5, method="pca-sharpened")


@pytest.fixture(params=["general", "scene", "sharpened"])
def basis(request: pytest.FixtureRequest) -> SpectralBasis:
    return request.getfixturevalue(request.param)


def test_a_basis_that_holds_white_is_not_stretched(general):
    for lamp in (*LIGHTS, light("LPS")):
        Q = colour_matching_functions(general.grid)
        plain = 100.0 / (Q[1] @ lamp.values) * (Q * lamp.values) @ general.synthesis
        assert general.light_matrix(lamp) == pytest.approx(plain, abs=1e-9)


@pytest.mark.parametrize(
    ("names", "componentwise", "fitted"),
    # Largest CIEDE2000, measured .0003, .0005, .0007 and .024: K follows the light's white, so
    # the componentwise picture of a sum is not quite the sum of pictures. Nor is the fitted one,
    # by .008, .022, .043 and .48: a light that is mixed beforehand has a matrix of its own.
    [
        (("D65", "A"), 0.002, 0.02),
        (("D65", "planck:2000"), 0.002, 0.04),
        (("A", "FL2"), 0.002, 0.08),
        (("D65", "LPS"), 0.05, 0.6),
    ],
)
def test_pictures_under_two_lights_add_up(general, names, componentwise, fitted):
    # Named lights have equal luminous energy, so the mean picture is that of the mixed light.
    one, other = map(light, names)
    both = light(f"{names[0]}*0.5+{names[1]}*0.5")
    c = general.analyse(reflectance_set("test"))
    summed = [(general.light_matrix(one) + general.light_matrix(other)) / 2.0]
    assert summed[0] == pytest.approx(general.light_matrix(both), abs=1e-9)
    for mode, most in (("componentwise", componentwise), ("fitted", fitted)):
        of_both, of_one, of_other = (
            c @ general.colour_matrix(lamp, mode).T for lamp in (both, one, other)
        )
        Lab = [cielab(XYZ, white_XYZ(both)) for XYZ in (of_both, (of_one + of_other) / 2.0)]
        off = colour_science().delta_E(*Lab, method="CIE 2000")
        print(f"{names}, {mode}: CIEDE2000 mean {off.mean():.4f}, max {off.max():.4f}")
        assert off.max() <= most


@pytest.mark.parametrize("basis", ["general", "scene"], indirect=True)
def test_spectra_in_the_span_have_the_exact_colour(basis):
    # Not sharpened: where white lies outside the span, its exactness costs the others'.
    S = basis.synthesise(np.random.default_rng(4).random(basis.size))
    for lamp in LIGHTS:
        assert basis.light_matrix(lamp) @ basis.analyse(S) == pytest.approx(
            XYZ_from_spectra(lamp, S), abs=1e-5
        )


def test_colour_does_not_depend_on_the_lights_level(general):
    c = general.analyse(REFLECTANCES[0])
    assert general.xyz(c, LIGHTS[0] * 1e4) == pytest.approx(general.xyz(c, LIGHTS[0]))


def test_display_matrix_is_continuous_towards_a_light_without_blue(general):
    def matrix(share: float) -> np.ndarray:
        return general.display_matrix(light(f"LPS*{1 - share}+D65*{share}"))

    for share in np.linspace(0, 0.2, 21):
        # K moves in proportion to the change of light, without a jump.
        far = np.abs(matrix(share + 1e-4) - matrix(share)).max()
        near = np.abs(matrix(share + 1e-6) - matrix(share)).max()
        assert near < 0.05 * far + 1e-6, share


def test_spectra_on_other_grids_are_resampled(general):
    fine = reflectance("gold", SpectralGrid(390, 710, 1))
    # A 10 nm table seen through a 1 nm one loses a little at its bends.
    assert general.analyse(fine) == pytest.approx(general.analyse(reflectance("gold")), abs=5e-3)


def test_file_round_trip_keeps_every_bit(general, tmp_path):
    general.save(tmp_path / "b.json")
    back = SpectralBasis.load(tmp_path / "b.json")
    assert back.fingerprint == general.fingerprint
    assert np.array_equal(back.synthesis, general.synthesis)
    for name in ("name", "trained_on", "grid"):
        assert getattr(back, name) == getattr(general, name)
    again = SpectralBasis.from_dict(json.loads(json.dumps(back.to_dict())))
    assert again.to_dict() == general.to_dict()


def test_fingerprint_changes_with_the_numbers(general):
    other = dataclasses.replace(general, XYZ_from_channels=general.XYZ_from_channels * 1.01)
    renamed = dataclasses.replace(general, name="other")
    assert other.fingerprint != general.fingerprint == renamed.fingerprint


def test_rounding_below_zero_is_taken_as_no_power(general):
    dip = Spectrum(DEFAULT_GRID.wavelengths_nm, 1.0 - (1.0 + 1e-7) * np.eye(BANDS)[3])
    none = Spectrum(DEFAULT_GRID.wavelengths_nm, 1.0 - np.eye(BANDS)[3])
    assert np.array_equal(general.light_matrix(dip), general.light_matrix(none))


def test_matrices_are_read_only(general):
    assert not general.analysis.flags.writeable
