"""The grid and the spectrum: exact band means, strict inputs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, SpectralGrid, Spectrum, read_spectrum


def test_equal_grids_hash_alike_whatever_the_number_type():
    assert len({SpectralGrid(400, 700, 10), SpectralGrid(400.0, 700.0, 10.0)}) == 1


GRIDS = [SpectralGrid(400, 700, 10), SpectralGrid(360, 830, 5), SpectralGrid(360, 830, 1)]


def test_samples_on_the_grid_pass_through_unchanged_of_a_wider_table_too():
    assert DEFAULT_GRID.wavelengths_nm[[0, -1]].tolist() == [380.0, 780.0]
    assert (DEFAULT_GRID.size, PAPERS_GRID.size, SpectralGrid(360, 830, 5).size) == (81, 31, 95)
    w = np.arange(380, 781, 10.0)
    values = np.random.default_rng(1).random(w.size)
    assert np.array_equal(PAPERS_GRID.band_means(w, values), values[2:33])


def test_band_means_are_the_exact_integral_of_the_interpolant():
    rng = np.random.default_rng(2)
    w = np.sort(np.concatenate([[390.0, 710.0], rng.uniform(391, 709, 60)]))
    v = rng.random((w.size, 3))
    dense = np.linspace(395, 705, 31 * 2000 + 1)
    for k in range(3):
        f = np.interp(dense, w, v[:, k])
        cells = ((f[1:] + f[:-1]) / 2).reshape(31, 2000).mean(1)
        # The trapezoid rule misses a kink by up to a step of 0.005 nm: 1e-5.
        assert PAPERS_GRID.band_means(w, v)[:, k] == pytest.approx(cells, abs=1e-5)


# Half a nanometre off, so that no table lies on a grid: those are band values already.
@pytest.mark.parametrize("grid", GRIDS, ids=str)
@given(
    inner=st.lists(st.floats(351, 839), max_size=60, unique_by=lambda w: round(w, 3)),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=30, deadline=None)
def test_tables_keep_their_integral(grid, inner, seed):
    w = np.array([350.5, *sorted(inner), 840.5])
    v = np.random.default_rng(seed).random(w.size)
    low, high = grid.start_nm - grid.step_nm / 2, grid.stop_nm + grid.step_nm / 2
    at = np.concatenate([[low], w[(w > low) & (w < high)], [high]])
    before = float(np.trapezoid(np.interp(at, w, v), at))
    # The order of the sums differs: 500 float64 terms bound the relative error near 1e-13.
    assert grid.band_means(w, v).sum() * grid.step_nm == pytest.approx(before, rel=1e-12)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@given(centre=st.floats(405, 695), width=st.floats(0.01, 2), power=st.floats(0.1, 1000))
@settings(max_examples=30, deadline=None)
def test_lines_keep_energy(grid, centre, width, power):
    w = np.array([350, centre - width, centre, centre + width, 840])
    v = np.array([0, 0, power / width, 0, 0])
    means = grid.band_means(w, v)
    # A line 0.01 nm wide is a difference of wavelengths near 700: 1e-11 of it is rounding.
    assert means.sum() * grid.step_nm == pytest.approx(power, rel=1e-9)
    reach = np.abs(grid.wavelengths_nm - centre) > width + grid.step_nm / 2 + 1e-6
    assert means[reach] == pytest.approx(0.0, abs=1e-9 * power)


def test_end_bands_may_be_covered_in_part():
    means = SpectralGrid(400, 420, 10).band_means([400, 405, 420], [0, 1, 1])
    assert means == pytest.approx([0.5, 1, 1])


def test_spectrum_is_a_read_only_copy():
    source = np.ones(3)
    s = Spectrum(np.array([400.0, 500, 600]), source)
    source[0] = 5
    assert s.values[0] == 1 and not s.values.flags.writeable


def test_spectra_have_a_grid_factors_and_sums():
    assert Spectrum(np.arange(400.0, 701, 5), np.ones(61)).grid == SpectralGrid(400, 700, 5)
    a = Spectrum(np.array([400.0, 500]), np.array([1.0, 2.0]), "a")
    assert (2 * a + a).values.tolist() == [3.0, 6.0]


def test_colour_science_round_trip_keeps_every_sample():
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
def test_csv_tolerates_headers_comments_and_separators(tmp_path, text):
    path = tmp_path / "lamp.csv"
    path.write_text(text, encoding="utf-8", newline="")
    s = read_spectrum(path)
    assert (s.name, s.values.tolist()) == ("lamp", [1.0, 2.0])
