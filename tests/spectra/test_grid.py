"""The grid and the spectrum: exact band means, strict inputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import SpectrumError
from volspec.spectra import DEFAULT_GRID, SpectralGrid, Spectrum, read_spectrum


def test_default_grid_is_the_papers_31_bands() -> None:
    assert DEFAULT_GRID.size == 31
    assert DEFAULT_GRID.wavelengths_nm[[0, -1]].tolist() == [400.0, 700.0]


@pytest.mark.parametrize(("args", "size"), [((360, 830, 1), 471), ((360, 830, 5), 95)])
def test_other_grids_have_their_own_size(args: tuple[float, float, float], size: int) -> None:
    assert SpectralGrid(*args).size == size


def test_equal_grids_hash_alike_whatever_the_number_type() -> None:
    assert len({SpectralGrid(400, 700, 10), SpectralGrid(400.0, 700.0, 10.0)}) == 1


@pytest.mark.parametrize(
    "args", [(400, 700, 0), (700, 400, 10), (400, 705, 10), (400, float("nan"), 10)]
)
def test_bad_grids_are_refused(args: tuple[float, float, float]) -> None:
    with raises(SpectrumError, "range", "grid"):
        SpectralGrid(*args)


def test_samples_on_the_grid_pass_through_unchanged() -> None:
    values = np.random.default_rng(0).random(31)
    assert np.array_equal(DEFAULT_GRID.band_means(DEFAULT_GRID.wavelengths_nm, values), values)


def test_a_wider_table_of_the_same_step_passes_through_too() -> None:
    w = np.arange(380, 781, 10.0)
    values = np.random.default_rng(1).random(w.size)
    assert np.array_equal(DEFAULT_GRID.band_means(w, values), values[2:33])


def test_narrow_line_keeps_its_energy_on_every_grid() -> None:
    # A triangle 2 nm wide and 1 high at 546.1 nm has area 1 nm.
    w, v = np.array([390, 545.1, 546.1, 547.1, 710]), np.array([0, 0, 1.0, 0, 0])
    for step in (1.0, 5.0, 10.0):
        grid = SpectralGrid(400, 700, step)
        assert grid.band_means(w, v).sum() * step == pytest.approx(1.0, rel=1e-12)


def test_band_means_are_the_exact_integral_of_the_interpolant() -> None:
    rng = np.random.default_rng(2)
    w = np.sort(np.concatenate([[390.0, 710.0], rng.uniform(391, 709, 60)]))
    v = rng.random((w.size, 3))
    dense = np.linspace(395, 705, 31 * 2000 + 1)
    for k in range(3):
        f = np.interp(dense, w, v[:, k])
        cells = ((f[1:] + f[:-1]) / 2).reshape(31, 2000).mean(1)
        # The trapezoid rule misses a kink by up to a step of 0.005 nm: 1e-5.
        assert DEFAULT_GRID.band_means(w, v)[:, k] == pytest.approx(cells, abs=1e-5)


def test_half_covered_end_bands_average_the_covered_half() -> None:
    means = SpectralGrid(400, 420, 10).band_means([400, 405, 420], [0, 1, 1])
    assert means == pytest.approx([0.5, 1, 1])


def test_an_uncovered_centre_names_the_missing_range() -> None:
    with raises(SpectrumError, "range"):
        DEFAULT_GRID.band_means([420, 690], [1, 1])


def test_spectrum_is_a_read_only_copy() -> None:
    source = np.ones(3)
    s = Spectrum(np.array([400.0, 500, 600]), source)
    source[0] = 5
    assert s.values[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        s.values[0] = 2


@pytest.mark.parametrize(
    ("w", "v", "code"),
    [
        ([400, 500], [1, 2, 3], "shape"),
        ([400], [1], "shape"),
        ([400, 400], [1, 1], "range"),
        ([500, 400], [1, 1], "range"),
        ([400, 500], [1, float("nan")], "range"),
        ([400, 500], ["a", "b"], "type"),
    ],
)
def test_bad_spectra_say_what_is_wrong(w: list[float], v: list[float], code: str) -> None:
    with raises(SpectrumError, code):
        Spectrum(np.array(w), np.array(v), "probe")


def test_grid_of_a_spectrum_is_found_and_irregular_ones_are_refused() -> None:
    assert Spectrum(np.arange(400.0, 701, 5), np.ones(61)).grid == SpectralGrid(400, 700, 5)
    with raises(SpectrumError, "conflict"):
        _ = Spectrum(np.array([400.0, 410, 430]), np.ones(3)).grid


def test_sums_need_the_same_wavelengths() -> None:
    a = Spectrum(np.array([400.0, 500]), np.array([1.0, 2.0]), "a")
    assert (2 * a + a).values.tolist() == [3.0, 6.0]
    with raises(SpectrumError, "conflict"):
        a + Spectrum(np.array([400.0, 510]), np.ones(2), "b")


def test_colour_science_round_trip_keeps_every_sample() -> None:
    s = Spectrum(np.array([400.0, 500, 700]), np.array([0.1, 0.2, 0.3]), "x")
    back = Spectrum.from_colour(s.to_colour())
    assert back.name == "x"
    assert np.array_equal(back.wavelengths_nm, s.wavelengths_nm)
    assert np.array_equal(back.values, s.values)


@pytest.mark.parametrize(
    "text",
    [
        "nm,value\n400,1\n500,2\n",
        "# lamp\n\n400;1\n# more\n500;2\n",
        "400 1\n500 2",
        "wavelength\tpower\n400\t1\n500\t2\n",
        "\ufeffnm,value\r\n400,1\r\n500,2\r\n",
    ],
)
def test_csv_tolerates_headers_comments_and_separators(tmp_path: Path, text: str) -> None:
    path = tmp_path / "lamp.csv"
    path.write_text(text, encoding="utf-8", newline="")
    s = read_spectrum(path)
    assert (s.name, s.values.tolist()) == ("lamp", [1.0, 2.0])


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("nm,value\n400,1\nx,2\n", "syntax"),
        ("400,1,7\n500,2\n", "shape"),
        ("400,1,7\n500,2,7\n", "missing"),
        ("400\n500\n", "missing"),
        ("400,2,1\n500,2,7\n600,,7\n", "syntax"),
        ("nm;value\n400;0,5\n500;0,6\n", "syntax"),
        ("400,1 W\n500,2\n600,2\n", "syntax"),
        ("0.4,1\n0.7,1\n", "range"),
        ("400,1\n", "missing"),
        ("", "missing"),
        ("500,1\n400,1\n", "range"),
        ("400,1\n500,nan\n", "range"),
    ],
)
def test_bad_csv_names_file_and_fault(tmp_path: Path, text: str, code: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with raises(SpectrumError, code):
        read_spectrum(path)


def test_missing_and_binary_csv_are_one_line_errors(tmp_path: Path) -> None:
    with raises(SpectrumError, "not-found"):
        read_spectrum(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(bytes(range(128, 256)))
    with raises(SpectrumError, "damaged"):
        read_spectrum(tmp_path / "binary.csv")
