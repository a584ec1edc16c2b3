"""Refusals of bases: lights as surfaces, edited files, impossible sizes and options."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises, warns
from volspec.basis import MaterialBasis, SpectralBasis, basis_from_dict, load_basis
from volspec.basis.display import white_exact
from volspec.basis.make import fit_library
from volspec.errors import BasisError, SpectrumError
from volspec.spectra import DEFAULT_GRID, SpectralGrid, light, reflectance
from volspec.spectra.spectrum import reflectance_values

BANDS = DEFAULT_GRID.size
LIGHTS = [light(n) for n in ("D65", "A", "FL2")]
GOLD, COPPER = reflectance("gold"), reflectance("copper")
GENERAL = SpectralBasis.load("general-7")
PAINTS = MaterialBasis({"gold": GOLD, "copper": COPPER})
BOTH = pytest.mark.parametrize("basis", [GENERAL, PAINTS], ids=["sensors", "materials"])


def test_reflectances_are_between_black_and_fluorescent() -> None:
    S = np.full((3, BANDS), 0.5)
    S[1, 2] = -4e-7
    assert reflectance_values(S, DEFAULT_GRID, "paints")[1, 2] == 0
    S[2, 3] = -0.25
    with raises(SpectrumError, "range"):
        reflectance_values(S, DEFAULT_GRID, "paints")
    with raises(SpectrumError, "range"):
        reflectance_values(GOLD * 100, DEFAULT_GRID, "paint")
    with warns("(gold)", "1.18167", "780"):
        reflectance_values([COPPER, GOLD * 1.2], DEFAULT_GRID, "paints")


def test_lights_and_negative_spectra_are_no_reflectances() -> None:
    with raises(BasisError, "range"):
        SpectralBasis.fit(LIGHTS, [COPPER, GOLD * -1], size=3)
    with raises(BasisError, "range"):
        PAINTS.with_reflectances({"gold": light("A") * 10})


@pytest.mark.parametrize(
    ("lights", "reflectances", "size"), [(LIGHTS, [GOLD, COPPER], 14), (LIGHTS[:1], [GOLD], 9)]
)
def test_more_sensors_than_the_spectra_determine_are_refused(
    lights: Any, reflectances: Any, size: int
) -> None:
    """The error has the size that works. Every start takes seconds: the first alone will do."""
    with raises(BasisError, "impossible") as caught:
        SpectralBasis.fit(lights, reflectances, size=size, restarts=0)
    works = int(re.findall(r"\d+", str(caught.value))[-1])
    assert SpectralBasis.fit(lights, reflectances, size=works, restarts=0).size == works


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"method": "magic"}, "unknown"),
        ({"method": "materials"}, "conflict"),
        ({"method": "reduced-rank"}, "impossible"),
        ({"method": "pca", "size": 20}, "impossible"),
        ({"method": "pca-sharpened", "size": 20}, "impossible"),
        ({"method": "pca-sharpened", "positive": True}, "conflict"),
        ({"method": "reduced-rank", "positive": True}, "conflict"),
        ({"method": "pca", "smoothness": 1e-6}, "conflict"),
        ({"method": "reduced-rank", "restarts": 2}, "conflict"),
        *(({"size": wrong}, "range") for wrong in (DEFAULT_GRID.size + 1, 2, 5.5)),
        *(({"smoothness": wrong}, "range") for wrong in (-1.0, "a", 1e300)),
        *(({"restarts": wrong}, "range") for wrong in (-1, float("inf"), "a")),
        ({"light_weights": [1.0]}, "shape"),
        ({"light_weights": [1, 0, 1]}, "range"),
        *(({"light_weights": wrong}, "type") for wrong in ("heavy", {})),
        ({"reflectance_weights": np.ones(5)}, "shape"),
        ({"reflectance_weights": [np.nan]}, "range"),
        ({"observer_deg": 4}, "unknown"),
        *(({"grid": wrong}, "type") for wrong in (None, (400, 700, 10))),
        ({"name": 5}, "type"),
        ({"trained_on": "a\0"}, "syntax"),
    ],
)
def test_bad_options_of_a_fit_are_refused(options: dict[str, Any], code: str) -> None:
    with raises(BasisError, code):
        SpectralBasis.fit(LIGHTS, [GOLD], **{"size": 3, **options})


@pytest.mark.parametrize(
    ("lights", "code"),
    [
        (None, "type"),
        ((lamp for lamp in LIGHTS), "type"),
        ([LIGHTS[0], np.ones((2, BANDS))], "shape"),
        ([LIGHTS[0], np.full(BANDS, np.nan)], "range"),
        (np.array([np.ones(BANDS), np.full(BANDS, np.nan)]), "range"),
        ([LIGHTS[0] * 1e-320], "conflict"),
    ],
)
def test_lights_of_the_wrong_kind_are_named(lights: Any, code: str) -> None:
    with raises(BasisError, code):
        SpectralBasis.fit(lights, [GOLD], size=3)


def test_a_scale_out_of_reach_is_named() -> None:
    with raises(BasisError, "impossible"):
        SpectralBasis.fit(LIGHTS, [GOLD * 1e-200], size=3)
    with raises(BasisError, "shape"):
        grid = SpectralGrid(500, 600, 100)
        SpectralBasis.fit(np.ones((1, 2)), np.ones((1, 2)), size=3, grid=grid)
    with raises(BasisError, "range"):
        grid = SpectralGrid(400, 700, 100)
        SpectralBasis.fit(np.ones((1, 4)), np.ones((1, 4)), size=5, grid=grid)


@pytest.mark.parametrize(
    "change",
    [{"observer_deg": 4}, {"name": ""}, {"name": None}, {"grid": None}, {"name": "a\ud800"}]
    + [{"materials": {"": GOLD}}, {"materials": {5: GOLD}}, {"materials": None}],
)
def test_a_basis_of_materials_is_valid_at_birth(change: dict[str, Any]) -> None:
    with pytest.raises(BasisError):
        MaterialBasis(**{"materials": {"gold": GOLD}, **change})


@BOTH
@pytest.mark.parametrize("wrong", ["abc", ["1"] * 7, [[1, 2], [3]], [np.nan] * 7, None])
def test_coefficients_are_finite_numbers(basis: Any, wrong: Any) -> None:
    for use in (basis.synthesise, lambda c: basis.xyz(c, LIGHTS[0])):
        with raises(BasisError):
            use(wrong[: basis.size] if isinstance(wrong, list) else wrong)


@BOTH
@pytest.mark.parametrize("wrong", [None, [], {}])
def test_channels_are_of_named_materials(basis: Any, wrong: Any) -> None:
    with raises(BasisError, "missing"):
        basis.channels_for_materials(wrong)


@BOTH
@pytest.mark.parametrize("change", [{"observer_deg": 10}, {"grid_nm": [370, 770, 5]}])
def test_a_file_is_refused_where_its_fingerprint_is_another(basis: Any, change: Any) -> None:
    data = basis.to_dict()
    with raises(BasisError, "damaged"):
        basis_from_dict(data | change)
    with raises(BasisError, "unsupported"):
        basis_from_dict(data | {"version": True})
    early = {key: value for key, value in data.items() if key != "fingerprint"}
    assert basis_from_dict(early).fingerprint == basis.fingerprint
    assert basis_from_dict(data | {"name": "other"}).fingerprint == basis.fingerprint


@pytest.mark.parametrize("factor", [0, 100, -1])
def test_an_edited_display_matrix_is_refused(factor: float) -> None:
    edited = (GENERAL.XYZ_from_channels * factor).tolist()
    with raises(BasisError, "damaged"):
        SpectralBasis.from_dict(GENERAL.to_dict() | {"XYZ_from_channels": edited})


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (b"[" * 100_000, "damaged"),
        (b"1" * 5000, "damaged"),
        (b"\xff\xfe\0", "damaged"),
        (json.dumps(GENERAL.to_dict() | {"analysis": [[10**400]]}).encode(), "damaged"),
        (json.dumps(GENERAL.to_dict() | {"grid_nm": [10**400, 1, 1]}).encode(), "damaged"),
    ],
)
def test_hostile_files_are_refused_in_one_line(tmp_path: Path, text: bytes, code: str) -> None:
    path = tmp_path / "hostile.json"
    path.write_bytes(text)
    with raises(BasisError, code) as error:
        load_basis(path)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)


@pytest.mark.parametrize("load", [load_basis, SpectralBasis.load, MaterialBasis.load])
@pytest.mark.parametrize("path", [None, 5, b"a.json", "", ".", "a" * 300, "a" * 300 + ".json"])
def test_what_is_no_path_is_refused(load: Callable[[Any], Any], path: Any) -> None:
    with pytest.raises(BasisError):
        load(path)


def test_paths_are_quoted_as_they_were_written(tmp_path: Path) -> None:
    with raises(BasisError, "unknown"):
        load_basis("nope")
    with raises(BasisError, "syntax"):
        load_basis("a\0.json")
    (tmp_path / "folder.json").mkdir()
    with raises(BasisError, "type"):
        load_basis(tmp_path / "folder.json")
    for basis in (GENERAL, PAINTS):
        with raises(BasisError, "unsupported"):
            basis.save(tmp_path / "plain")


def test_either_kind_of_file_names_the_other_s_reader(tmp_path: Path) -> None:
    path = tmp_path / "paints.json"
    PAINTS.save(path)
    assert MaterialBasis.load(path).fingerprint == PAINTS.fingerprint
    with raises(BasisError, "type"):
        SpectralBasis.load(path)
    with raises(BasisError, "type"):
        MaterialBasis.load("general-7")


def test_a_mark_of_byte_order_is_read_over(tmp_path: Path) -> None:
    path = tmp_path / "marked.json"
    path.write_text(json.dumps(GENERAL.to_dict()), encoding="utf-8-sig")
    assert load_basis(path).fingerprint == GENERAL.fingerprint


def test_the_library_trains_components_on_smooth_lights() -> None:
    """Virtual sensors: the recipe is that of the shipped bases (test_colour)."""
    assert "spiky" not in fit_library(5, "pca").trained_on
    with raises(BasisError, "unknown"):
        fit_library(5, lights="bright")


def test_white_stays_exact_and_continuous_where_its_prediction_crosses_zero() -> None:
    channels, white = np.array([1.0, 0.5]), np.array([90.0, 100.0, 110.0])
    shown = []
    for off in (-1e-9, 1e-9):
        matrix = np.array([[50.0, 80.0], [30.0, -60.0 + off], [70.0, 80.0]])
        shown.append(white_exact(matrix, channels, white))
        assert shown[-1] @ channels == pytest.approx(white)
    assert shown[0] == pytest.approx(shown[1], abs=1e-6)


def test_a_stored_basis_loads_no_fitter() -> None:
    code = "import sys, volspec.basis as b; b.load_basis('general-7'); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not [name for name in run.stdout.split() if name.startswith("volspec.basis.fit")]
