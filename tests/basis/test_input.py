"""Refusals of bases: lights as surfaces, edited files, impossible sizes and options."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises, warns
from volspec.basis import MaterialBasis, SpectralBasis, basis_from_dict, load_basis
from volspec.basis.display import white_exact
from volspec.basis.make import fit_library, fit_shipped
from volspec.basis.report import basis_report
from volspec.basis.report_table import error_table
from volspec.errors import BasisError, ImageError, SpectrumError, TransferError
from volspec.image import CoefficientImage
from volspec.relight import Relighter
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light,
    reflectance,
    white_XYZ,
)
from volspec.spectra.spectrum import reflectance_values
from volspec.transfer import TransferFunction

NM, BANDS = DEFAULT_GRID.wavelengths_nm, DEFAULT_GRID.size
LIGHTS = [light(n) for n in ("D65", "A", "FL2")]
GOLD, COPPER = reflectance("gold"), reflectance("copper")
GENERAL = SpectralBasis.load("general-7")
PAINTS = MaterialBasis({"gold": GOLD, "copper": COPPER})
SAMPLES = np.array([GOLD.values, COPPER.values])
DARK = Spectrum(NM, np.zeros(BANDS), "dark")
MINUS = Spectrum(NM, 1.0 - 1.01 * np.eye(BANDS)[3], "minus")
SHORT = Spectrum(np.array([450.0, 600.0]), np.ones(2), "short")
DYE = Spectrum([380, 450, 720], [-0.5, -0.5, 1])
MANY = {f"m{k}": GOLD for k in range(32)}


def fit(lights: Any = LIGHTS, reflectances: Any = (GOLD,), **options: Any) -> SpectralBasis:
    return SpectralBasis.fit(lights, reflectances, **{"size": 3, **options})


def ones(rows: int, grid: SpectralGrid, size: int) -> SpectralBasis:
    return SpectralBasis.fit(*(np.ones((1, rows)),) * 2, size=size, grid=grid)


def edited(**change: object) -> SpectralBasis:
    return SpectralBasis.from_dict(GENERAL.to_dict() | change)


def without(basis: Any, key: str) -> Any:
    """Read a basis whose file lacks a key."""
    return basis_from_dict({k: v for k, v in basis.to_dict().items() if k != key})


def load(folder: Path, text: bytes | str) -> Any:
    path = folder / "hostile.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_basis(path)


def paints_as_sensors(folder: Path) -> SpectralBasis:
    PAINTS.save(folder / "paints.json")
    return SpectralBasis.load(folder / "paints.json")


def edit_image(folder: Path) -> None:
    grey, opaque = np.full((1, 1, 7), 0.5, np.float32), np.ones((1, 1), np.float32)
    with Relighter(CoefficientImage(grey, opaque, opaque, GENERAL), backend="numpy") as relighter:
        relighter.set_reflectances({"gold": GOLD})


HUGE = json.dumps(GENERAL.to_dict() | {"analysis": [[10**400]]})
FAR = json.dumps(GENERAL.to_dict() | {"grid_nm": [10**400, 1, 1]})
# With a `BasisError`.
REFUSED: list[tuple[str, Callable[[Path], object]]] = [
    *(
        (code, lambda f, option=option, value=value: fit(**{option: value}))
        for code, option, *values in (
            ("unknown", "method", "magic"),
            ("conflict", "method", "materials"),
            ("impossible", "method", "reduced-rank"),
            ("range", "size", BANDS + 1, 2, 5.5),
            ("range", "smoothness", -1.0, "a", 1e300),
            ("range", "restarts", -1, float("inf")),
            ("shape", "light_weights", [1.0]),
            ("range", "light_weights", [1, 0, 1]),
            ("type", "light_weights", "heavy"),
            ("shape", "reflectance_weights", np.ones(5)),
            ("range", "reflectance_weights", [np.nan]),
            ("unknown", "observer_deg", 4),
            ("type", "name", 5),
            ("syntax", "trained_on", "a\0"),
        )
        for value in values
    ),
    ("impossible", lambda f: fit(method="pca", size=20)),
    ("impossible", lambda f: fit(method="pca-sharpened", size=20)),
    ("conflict", lambda f: fit(method="pca-sharpened", positive=True)),
    ("conflict", lambda f: fit(method="reduced-rank", positive=True)),
    ("conflict", lambda f: fit(method="pca", smoothness=1e-6)),
    ("conflict", lambda f: fit(method="reduced-rank", restarts=2)),
    ("shape", lambda f: fit([LIGHTS[0], np.ones((2, BANDS))])),
    ("range", lambda f: fit([LIGHTS[0], np.full(BANDS, np.nan)])),
    ("range", lambda f: fit(np.array([np.ones(BANDS), np.full(BANDS, np.nan)]))),
    ("conflict", lambda f: fit([LIGHTS[0] * 1e-320])),
    ("conflict", lambda f: fit([LIGHTS[0], DARK])),
    ("missing", lambda f: fit([])),
    ("range lights: 'short'", lambda f: fit([SHORT])),
    ("impossible", lambda f: fit(LIGHTS, np.zeros((2, BANDS)))),
    ("range reflectances: 'short'", lambda f: fit(LIGHTS, [SHORT])),
    ("shape reflectances", lambda f: fit(LIGHTS, np.ones((2, 30)))),
    ("range", lambda f: fit(LIGHTS, [COPPER, GOLD * -1])),
    ("impossible", lambda f: fit(LIGHTS, [GOLD * 1e-200])),
    ("shape", lambda f: ones(2, SpectralGrid(500, 600, 100), 3)),
    ("range", lambda f: ones(4, SpectralGrid(400, 700, 100), 5)),
    ("unknown", lambda f: fit_library(5, lights="bright")),
    ("unknown", lambda f: fit_shipped("general7")),
    ("unknown", lambda f: MaterialBasis({"gold": GOLD}, observer_deg=4)),
    ("missing", lambda f: MaterialBasis({"gold": GOLD}, name="")),
    ("type", lambda f: MaterialBasis({"gold": GOLD}, name=None)),
    ("syntax", lambda f: MaterialBasis({"gold": GOLD}, name="a\ud800")),
    ("missing", lambda f: MaterialBasis({"": GOLD})),
    ("type", lambda f: MaterialBasis({5: GOLD})),
    ("missing", lambda f: MaterialBasis({})),
    ("type material 'gold'", lambda f: MaterialBasis({"gold": np.ones(BANDS)})),
    ("range", lambda f: MaterialBasis({"dye": DYE})),
    ("range material 'dye'", lambda f: MaterialBasis({"dye": Spectrum([380, 600], [0.5, 1])})),
    ("unknown", lambda f: PAINTS.with_reflectances({"goldd": GOLD})),
    ("range", lambda f: PAINTS.with_reflectances({"gold": light("A") * 10})),
    ("unknown", lambda f: PAINTS.channels_for_materials({"nickel": reflectance("nickel")})),
    ("conflict", lambda f: PAINTS.channels_for_materials({"gold": reflectance("silver")})),
    ("unknown", lambda f: basis_report(PAINTS, None, [reflectance("silver")])),
    ("missing", lambda f: error_table(GENERAL, {})),
    ("missing", lambda f: GENERAL.report([], [GOLD])),
    ("unknown", lambda f: GENERAL.colour_matrix(light("A"), "exakt")),
    ("missing", lambda f: replace(GENERAL, samples=None).fitted_matrix(light("D65"))),
    ("shape", lambda f: replace(GENERAL, samples=SAMPLES[0])),
    ("shape", lambda f: replace(GENERAL, samples=SAMPLES[:, :5])),
    ("range", lambda f: replace(GENERAL, samples=-SAMPLES)),
    # White is lost.
    ("damaged", lambda f: replace(GENERAL, analysis=GENERAL.analysis * 1.01)),
    ("type", lambda f: edited(format="x")),
    ("shape", lambda f: edited(analysis=[[1, 2]])),
    ("type", lambda f: edited(analysis="abc")),
    ("type", lambda f: edited(grid_nm=[400])),
    ("type", lambda f: edited(grid_nm=7)),
    ("range", lambda f: edited(grid_nm=[700, 400, 10])),
    ("unknown", lambda f: edited(observer_deg=5)),
    *(
        ("damaged", lambda f, by=by: edited(XYZ_from_channels=GENERAL.XYZ_from_channels * by))
        for by in (0, 100, -1)
    ),
    ("missing", lambda f: without(GENERAL, "synthesis")),
    ("missing", lambda f: without(PAINTS, "materials")),
    ("damaged", lambda f: load(f, "not json")),
    ("damaged", lambda f: load(f, "[" * 100_000)),
    ("damaged", lambda f: load(f, "1" * 5000)),
    ("damaged", lambda f: load(f, b"\xff\xfe\0")),
    ("damaged", lambda f: load(f, HUGE)),
    ("damaged", lambda f: load(f, FAR)),
    ("unknown", lambda f: load_basis("general-8")),
    ("syntax", lambda f: load_basis("a\0.json")),
    ("not-found", lambda f: load_basis(f / "absent.json")),
    ("type", lambda f: load_basis(f)),
    ("type", paints_as_sensors),
    ("type", lambda f: MaterialBasis.load("general-7")),
]
for _basis in (GENERAL, PAINTS):
    REFUSED += [
        *(
            ("missing", lambda f, b=_basis, of=of: b.channels_for_materials(of))
            for of in (None, {})
        ),
        ("shape", lambda f, b=_basis: b.xyz(np.ones(9), LIGHTS[0])),
        *(
            row
            for wrong in ("abc", ["1"] * 7, [[1, 2], [3]], [np.nan] * 7, None)
            for c in (wrong[: _basis.size] if isinstance(wrong, list) else wrong,)
            for row in (
                ("", lambda f, b=_basis, c=c: b.synthesise(c)),
                ("", lambda f, b=_basis, c=c: b.xyz(c, LIGHTS[0])),
            )
        ),
        # The fingerprint is another's.
        *(
            ("damaged", lambda f, b=_basis, change=change: basis_from_dict(b.to_dict() | change))
            for change in ({"observer_deg": 10}, {"grid_nm": [370, 770, 5]})
        ),
        ("unsupported", lambda f, b=_basis: basis_from_dict(b.to_dict() | {"version": True})),
        ("unsupported", lambda f, b=_basis: basis_from_dict(b.to_dict() | {"version": 99})),
        ("unsupported", lambda f, b=_basis: b.save(f / "plain")),
    ]
for _load in (load_basis, SpectralBasis.load, MaterialBasis.load):
    for _path in ("", ".", "a" * 300, "a" * 300 + ".json"):
        REFUSED.append(("", lambda f, load=_load, path=_path: load(path)))


OTHERS = [
    (TransferError, "type", lambda f: TransferFunction([(0, 0, "gold")], {"gold": GOLD}, "x")),
    (TransferError, "size", lambda f: TransferFunction([(0, 1, "m1")], MANY, MaterialBasis(MANY))),
    (ImageError, "unsupported", edit_image),
    (SpectrumError, "shape", lambda f: GENERAL.light_matrix(np.ones((2, BANDS)))),
    (SpectrumError, "shape", lambda f: GENERAL.analyse(np.ones(30))),
    # Reflectances are between black and fluorescent.
    (SpectrumError, "range", lambda f: reflectance_values(-0.25 * SAMPLES, DEFAULT_GRID, "")),
    (SpectrumError, "range", lambda f: reflectance_values(GOLD * 100, DEFAULT_GRID, "paint")),
]
for _of in (GENERAL.display_matrix, GENERAL.light_matrix, white_XYZ):
    OTHERS.append((SpectrumError, "conflict", lambda f, of=_of: of(DARK)))
    OTHERS.append((SpectrumError, "range", lambda f, of=_of: of(MINUS)))
UNKNOWN = SpectrumError, "unknown observer_deg"
for _eye in (3, True, "2", None, 2.5, "CIE 2015"):
    OTHERS.append((*UNKNOWN, lambda f, eye=_eye: colour_matching_functions(DEFAULT_GRID, eye)))


@pytest.mark.parametrize(
    ("error", "fault", "make"), [*((BasisError, *row) for row in REFUSED), *OTHERS]
)
def test_what_cannot_be_is_refused_in_one_line(error, fault, make, tmp_path):
    code, _, field = fault.partition(" ")
    with raises(error, code or None, field or None) as caught:
        make(tmp_path)
    # Names of shipped bases take 500; what a hostile file holds is not repeated.
    assert len(str(caught.value)) < 700


def test_reflectances_are_between_black_and_fluorescent():
    S = np.full((3, BANDS), 0.5)
    S[1, 2] = -4e-7
    assert reflectance_values(S, DEFAULT_GRID, "paints")[1, 2] == 0
    with warns("(gold)", "1.18167", "780"):
        reflectance_values([COPPER, GOLD * 1.2], DEFAULT_GRID, "paints")


@pytest.mark.not_quick
@pytest.mark.slow
@pytest.mark.parametrize(
    ("lights", "reflectances", "size"), [(LIGHTS, [GOLD, COPPER], 14), (LIGHTS[:1], [GOLD], 9)]
)
def test_too_many_sensors_are_refused(lights, reflectances, size):
    """The error has the size that works. Every start takes seconds: the first alone will do."""
    with raises(BasisError, "impossible") as caught:
        SpectralBasis.fit(lights, reflectances, size=size, restarts=0)
    works = int(re.findall(r"\d+", str(caught.value))[-1])
    assert SpectralBasis.fit(lights, reflectances, size=works, restarts=0).size == works


@pytest.mark.parametrize("basis", [GENERAL, PAINTS], ids=["sensors", "materials"])
def test_files_of_bases_are_read_by_their_fingerprint(basis, tmp_path):
    assert without(basis, "fingerprint").fingerprint == basis.fingerprint
    assert basis_from_dict(basis.to_dict() | {"name": "other"}).fingerprint == basis.fingerprint
    path = tmp_path / "marked.json"
    path.write_text(json.dumps(basis.to_dict()), encoding="utf-8-sig")
    assert load_basis(path).fingerprint == type(basis).load(path).fingerprint == basis.fingerprint


def test_the_library_trains_components_on_smooth_lights():
    """Virtual sensors: the recipe is that of the shipped bases (test_colour)."""
    assert "spiky" not in fit_library(5, "pca").trained_on


def test_white_stays_exact_and_continuous_where_its_prediction_crosses_zero():
    channels, white = np.array([1.0, 0.5]), np.array([90.0, 100.0, 110.0])
    shown = []
    for off in (-1e-9, 1e-9):
        matrix = np.array([[50.0, 80.0], [30.0, -60.0 + off], [70.0, 80.0]])
        shown.append(white_exact(matrix, channels, white))
        assert shown[-1] @ channels == pytest.approx(white)
    assert shown[0] == pytest.approx(shown[1], abs=1e-6)


@pytest.mark.not_quick
def test_a_stored_basis_loads_no_fitter():
    code = "import sys, volspec.basis as b; b.load_basis('general-7'); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not [name for name in run.stdout.split() if name.startswith("volspec.basis.fit")]
