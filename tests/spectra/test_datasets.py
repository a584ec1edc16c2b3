"""Named spectra are colour-science's to the last bit; observers are CIE's and vary as published."""

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest

from volspec import _cache
from volspec.spectra import DEFAULT_GRID, SpectralGrid, datasets, light
from volspec.spectra.datasets import observers
from volspec.spectra.observers import (
    _XYZ_FROM_LMS,
    cone_fundamentals,
    population,
    random_eyes,
    standard_eye,
)
from volspec.spectra.spectrum import extended_band_means

ROOT = Path(__file__).resolve().parents[2]
YEARS = {"CIE 1931": 2, "CIE 1964": 10, "CIE 2015 2": 2, "CIE 2015 10": 10}
OBSERVERS = [f"{name[:8]} {field} Degree Standard Observer" for name, field in YEARS.items()]
# What our groups are called there.
GROUPS: dict[str, Mapping[str, Any]] = {
    "observers": {name: colour.MSDS_CMFS[name] for name in OBSERVERS},
    "illuminants": colour.SDS_ILLUMINANTS,
    "light_sources": colour.SDS_LIGHT_SOURCES,
    "daylight_components": colour.colorimetry.SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES,
}
# Start of the viewer, commands that show a light, names in scenes.
START = """
import sys
from volspec.appearance.models.lab import delta_E_2000
from volspec.scene import Scene
from volspec.spectra import light, reflectance
from volspec.spectra.photometry import correlated_temperature
import volspec.pipeline
scene = Scene.load(sys.argv[1])
light("daylight:5000"), light("60 A/W (Soft White)"), reflectance("ColorChecker/orange")
delta_E_2000([50, 1, 1], [50, 2, 2]), correlated_temperature([95, 100, 108])
print(*sorted({"colour", "matplotlib", "scipy"} & set(sys.modules)), end="")
"""


def identical(ours: datasets.Table, theirs: tuple[Any, Any]) -> bool:
    return all(
        a.dtype == np.float64 and not a.flags.writeable and np.array_equal(a, b)
        for a, b in zip(ours, theirs, strict=True)
    )


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    return tmp_path


def test_tables_are_those_of_colour_science_to_the_last_bit(cache):
    for name, theirs in GROUPS.items():
        read = getattr(datasets, name).__wrapped__  # without what this process has read
        for ours in (read(), read()):  # with the cache empty, then filled
            assert list(ours) == list(theirs)
            for key, table in ours.items():
                assert identical(table, (theirs[key].wavelengths, theirs[key].values)), (name, key)


def test_reflectances_are_those_of_colour_science_to_the_last_bit(cache):
    fresh = datasets._reflectances()
    for ours in (datasets.reflectances.__wrapped__(), datasets.reflectances.__wrapped__()):
        assert list(ours) == list(fresh)
        for name, table in ours.items():
            assert identical(table, fresh[name]), name
    ces = colour.quality.cfi2017.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    assert identical(ours["CES/7"], (ces.wavelengths, ces.values[:, 6]))
    for name, group, key in (
        ("VS/15", colour.quality.datasets.SDS_VS["NIST CQS 9.0"], "VS15"),
        ("TCS/1", colour.quality.datasets.SDS_TCS["CIE 2024"], "TCS01"),
        ("PMC/Banana", colour.SDS_COLOURCHECKERS["PMC"], "Banana"),
    ):
        assert identical(ours[name], (group[key].wavelengths, group[key].values))


def test_another_version_is_read_again(cache, monkeypatch):
    read: list[object] = []
    original = datasets._tables
    monkeypatch.setattr(datasets, "_tables", lambda *given: read.append(given) or original(*given))
    for release, times in (("0.4.7", 1), ("0.4.7", 1), ("0.4.8", 2)):
        monkeypatch.setattr(datasets, "version", lambda _, release=release: release)
        datasets.daylight_components.__wrapped__()
        assert len(read) == times, release


@pytest.mark.parametrize("kelvin", [4000, 5003.5, 6504, 7000, 7001, 25_000])
def test_daylight_is_that_of_colour_science_to_the_last_bit(kelvin):
    theirs = colour.sd_CIE_illuminant_D_series(colour.temperature.CCT_to_xy_CIE_D(kelvin))
    means = extended_band_means(theirs.wavelengths, theirs.values, DEFAULT_GRID)
    ours = light(f"daylight:{kelvin}").values
    # Scaled to one illuminance: a constant quotient means the same shape.
    assert np.ptp(ours / means) <= 4 * np.finfo(float).eps * (ours / means).max()


@pytest.mark.not_quick
def test_a_second_start_imports_no_colour(tmp_path, monkeypatch):
    """This process does what a first start does: it fills the cache."""
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path / "volspec")
    for name in (*GROUPS, "reflectances"):
        getattr(datasets, name).__wrapped__()
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", START, str(ROOT / "data" / "scenes" / "engine.toml")]
    run = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert run.stdout == ""


@pytest.mark.parametrize("field", [2, 10])
def test_the_average_observer_is_that_of_cie_2015(field):
    nm, LMS = cone_fundamentals(standard_eye(), field)
    table_nm, xyz = observers()[f"CIE 2015 {field} Degree Standard Observer"]
    samples = xyz[np.isin(table_nm, nm)].T
    # The tables have 5 decimals, and a peak between two samples.
    assert np.abs(_XYZ_FROM_LMS[field] @ LMS[0] - samples).max() < 2e-3 * samples.max()


def test_populations_are_always_the_same_and_vary_as_published():
    eyes = random_eyes(20_000)
    again = random_eyes(20_000)
    for each in fields(eyes):
        assert np.array_equal(getattr(eyes, each.name), getattr(again, each.name))
    assert eyes.age.min() >= 20 and eyes.age.max() <= 70
    assert eyes.lens.std() == pytest.approx(0.187, rel=0.03)
    # Cut off at no density at all, 2.7 deviations below the mean.
    assert eyes.macula.min() >= -1 and eyes.macula.std() == pytest.approx(0.365, rel=0.03)
    shifts = [each.std() for each in (eyes.shift_L, eyes.shift_M, eyes.shift_S)]
    assert shifts == pytest.approx([2.0, 1.5, 1.3], rel=0.03)


def test_all_observers_see_equal_energy_as_white():
    whites = population(SpectralGrid(390, 780, 5)).sum(axis=2)
    assert whites == pytest.approx(np.broadcast_to(whites[0], whites.shape))
    assert whites[0] / whites[0, 1] == pytest.approx([1, 1, 1], abs=2e-3)


def test_lenses_grow_yellow_with_age_and_shifts_move_the_peaks():
    young, old = (cone_fundamentals(standard_eye(age))[1][0] for age in (20, 70))
    blue, yellow = 10, 36  # 440 and 570 nm
    assert old[2, blue - 6] / old[2, blue + 6] < 0.75 * young[2, blue - 6] / young[2, blue + 6]
    assert old[0, yellow] == pytest.approx(young[0, yellow], rel=0.06)
    for cone, name in enumerate(("shift_L", "shift_M", "shift_S")):
        nm, LMS = cone_fundamentals(replace(standard_eye(), **{name: np.array([4.0])}))
        standard = cone_fundamentals(standard_eye())[1]
        moved = (LMS - standard)[0] @ nm / LMS.sum(axis=2)[0]
        assert 1.5 < moved[cone] < 4.5 and np.abs(np.delete(moved, cone)).max() < 1e-9
    assert (LMS >= 0).all()
