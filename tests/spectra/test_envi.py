"""ENVI hyperspectral pictures and spectral libraries."""

from pathlib import Path

import numpy as np
import pytest

from tests.spectra._files import fails
from volspec.spectra import PAPERS_GRID, SpectralImage, light, read_spectrum, reflectance

NM = [390.0, 550.0, 710.0]
# (lines, samples, bands)
CUBE = np.arange(2 * 4 * 3, dtype=np.float64).reshape(2, 4, 3) / 24.0
ORDERS = {"bsq": (2, 0, 1), "bil": (0, 2, 1), "bip": (0, 1, 2)}
HEADER = """ENVI
description = {{
  A wall in the
  sun}}
samples = 4
lines   = 2
bands   = 3
header offset = 0
file type = ENVI Standard
data type = 4
interleave = bsq
byte order = 0
wavelength units = Nanometers
wavelength = {{ 390.0,
 550.0, 710.0 }}
{more}"""


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    return write(tmp_path)


def write(
    folder: Path,
    header: str = HEADER,
    more: str = "",
    dtype: str = "<f4",
    interleave: str = "bsq",
    cube: np.ndarray = CUBE,
    data: str = "scan.img",
    head: bytes = b"",
) -> Path:
    path = folder / "scan.hdr"
    path.write_text(header.format(more=more), encoding="latin-1")
    (folder / data).write_bytes(head + cube.transpose(ORDERS[interleave]).astype(dtype).tobytes())
    return path


def changed(old: str, new: str) -> str:
    assert old in HEADER
    return HEADER.replace(old, new)


@pytest.mark.parametrize("interleave", ORDERS)
@pytest.mark.parametrize(
    ("code", "order", "dtype"),
    [(4, 0, "<f4"), (4, 1, ">f4"), (5, 0, "<f8"), (2, 1, ">i2"), (12, 0, "<u2"), (1, 0, "u1")],
)
def test_every_interleave_and_type_gives_the_same_pixels(tmp_path, interleave, code, order, dtype):
    header = changed("interleave = bsq", f"interleave = {interleave.upper()}")
    header = header.replace("data type = 4", f"data type = {code}")
    header = header.replace("byte order = 0", f"byte order = {order}")
    scale = "reflectance scale factor = 24"
    path = write(tmp_path, header, scale, dtype, interleave, CUBE * 24.0)
    image = SpectralImage.load(path)
    assert image.values == pytest.approx(CUBE, abs=1e-6)
    assert (image.wavelengths_nm.tolist(), image.kind, image.size) == (NM, "reflective", (4, 2))
    assert image.notes["description"] == "A wall in the sun"


def test_a_pixel_a_box_and_the_mean_are_addressed_as_in_spectral_exr(scan):
    assert read_spectrum(f"{scan}#3,1").values == pytest.approx(CUBE[1, 3])
    assert read_spectrum(f"{scan}#1,0,3,2").values == pytest.approx(CUBE[:, 1:3].mean(axis=(0, 1)))
    assert read_spectrum(scan).values == pytest.approx(CUBE.mean(axis=(0, 1)))
    assert read_spectrum(f"{scan}#3,1").name == "scan#3,1"
    assert SpectralImage.load(scan, box=(1, 0, 3, 2)).size == (2, 2)
    paint = reflectance(f"{scan}#3,1", PAPERS_GRID)
    assert paint.values[15] == pytest.approx(CUBE[1, 3, 1], abs=0.01)
    assert light(f"{scan}#3,1").values.min() > 0
    SpectralImage.load(scan).save(scan.with_suffix(".exr"))
    assert read_spectrum(f"{scan.with_suffix('.exr')}#3,1").values == pytest.approx(CUBE[1, 3])
    assert SpectralImage.load(scan.with_suffix(".exr"), box=(1, 0, 3, 2)).size == (2, 2)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("390.0,\n 550.0, 710.0", "0.39, 0.55, 0.71"),
        ("Nanometers", "Unknown"),
        ("wavelength units = Nanometers\n", ""),
        ("\n", "\r\n"),
        ("samples = 4", "Samples=4"),
        ("bands   = 3", "; a comment = 5\nbands = 3"),
    ],
)
def test_the_dialects_of_headers_are_read_alike(tmp_path, old, new):
    header = changed(old, new)
    if "0.39" in new:
        header = header.replace("Nanometers", "Micrometers")
    path = write(tmp_path, header)
    s = read_spectrum(f"{path}#0,0")
    assert (s.wavelengths_nm.tolist(), s.values.tolist()) == (NM, pytest.approx(CUBE[0, 0]))


@pytest.mark.parametrize("data", ["scan", "scan.dat", "scan.BIL", "scan.raw"])
def test_the_data_are_found_next_to_the_header(tmp_path, data):
    more = "\n".join(("data units = radiance", "sensor type = µ-scan"))
    path = write(tmp_path, changed("header offset = 0", "header offset = 5"), more, data=data,
                 head=b"12345")  # fmt: skip
    assert read_spectrum(f"{path}#1,1").values == pytest.approx(CUBE[1, 1])
    assert SpectralImage.load(path).kind == "emissive"
    assert read_spectrum(path).notes["sensor type"] == "µ-scan"


def test_bad_bands_are_left_out_and_overlapping_detectors_sorted(tmp_path):
    header = changed("390.0,\n 550.0, 710.0", "710, 390, 550")
    assert read_spectrum(write(tmp_path, header)).wavelengths_nm.tolist() == NM
    s = read_spectrum(f"{write(tmp_path, header, 'bbl = {1, 0, 1}')}#2,0")
    assert s.wavelengths_nm.tolist() == [550, 710]
    assert s.values == pytest.approx(CUBE[0, 2, [2, 0]])


def test_pixels_without_numbers_and_beyond_memory_do_not_hinder_others(tmp_path):
    assert read_spectrum(f"{with_a_hole(tmp_path)}#0,0").values == pytest.approx(CUBE[0, 0])
    assert read_spectrum(f"{beyond_memory(tmp_path)}#1,9").values.tolist() == [0, 0, 0]


def with_a_hole(folder: Path) -> Path:
    return write(folder, cube=np.where(CUBE[1, 2, 1] == CUBE, np.nan, CUBE))


def beyond_memory(folder: Path) -> Path:
    path = write(folder, changed("lines   = 2", "lines = 200000000"))
    with (folder / "scan.img").open("r+b") as file:
        file.truncate(4 * 3 * 4 * 200_000_000)
    return path


def write_library(folder: Path, names: str = "{grass dry,\n asphalt}") -> Path:
    header = changed("ENVI Standard", "ENVI Spectral Library")
    header = header.replace("samples = 4", "samples = 3").replace("bands   = 3", "bands = 1")
    more, cube = f"spectra names = {names}", CUBE[:, :1] * 100.0
    return write(folder, header, more, cube=cube, data="scan.sli", interleave="bip")


@pytest.mark.parametrize("selector", ["asphalt", "2"])
def test_a_spectral_library_is_chosen_from_by_name(tmp_path, selector):
    s = read_spectrum(f"{write_library(tmp_path)}#{selector}", kind="reflective")
    assert (s.name, s.values.tolist()) == ("scan#asphalt", pytest.approx(CUBE[1, 0]))


def without_data(folder: Path) -> Path:
    path = write(folder)
    path.with_suffix(".img").unlink()
    return path


HEADERS = [
    ("ENVI\n", "#?RADIANCE\n", "unsupported", ""),
    ("ENVI\n", "IDL\n", "unsupported", ""),
    ("samples = 4", "", "missing", "samples"),
    ("samples = 4", "samples = 4.5", "syntax", "samples"),
    ("samples = 4", "samples = 0", "syntax", "samples"),
    ("samples = 4", "samples = 999999999999", "size", ""),
    ("samples = 4", "samples = 5", "damaged", ""),
    ("data type = 4", "data type = 6", "unsupported", "data type"),
    ("byte order = 0", "byte order = 2", "unknown", "byte order"),
    ("interleave = bsq", "interleave = tile", "unknown", "interleave"),
    ("Nanometers", "Wavenumber", "unsupported", "wavelength units"),
    ("Nanometers", "Micrometers", "range", ""),
    ("550.0, 710.0", "550.0", "shape", "wavelength"),
    ("550.0, 710.0", "550.0, red", "syntax", "wavelength"),
    ("550.0, 710.0", "710.0, 710.0", "range", ""),
    ("wavelength =", "waves =", "missing", "wavelength"),
    ("lines   = 2", "lines = 2\nfile compression = 1", "unsupported", ""),
    ("lines   = 2", "lines = 2\nbbl = {{1, 1}}", "shape", "bbl"),
    ("lines   = 2", "lines = 2\nbbl = {{0, 0, 1}}", "shape", ""),
    ("lines   = 2", "lines = 2\nreflectance scale factor = 0", "range", "reflectance scale factor"),
    ("lines   = 2", "lines = 2\ndata ignore value = 0", "missing", ""),
]
REFUSED = [
    *(
        (f"{code} {field}", lambda f, old=old, new=new: read_spectrum(write(f, changed(old, new))))
        for old, new, code, field in HEADERS
    ),
    ("range", lambda f: read_spectrum(f"{write(f)}#4,0")),
    ("range", lambda f: read_spectrum(f"{write(f)}#0,0,5,1")),
    ("syntax", lambda f: read_spectrum(f"{write(f)}#a,b")),
    ("range", lambda f: read_spectrum(with_a_hole(f))),
    ("not-found", lambda f: read_spectrum(without_data(f))),
    ("size", lambda f: read_spectrum(beyond_memory(f))),
    ("missing", lambda f: read_spectrum(write_library(f))),
    ("unknown", lambda f: read_spectrum(f"{write_library(f)}#glass")),
    ("type", lambda f: SpectralImage.load(write_library(f))),
    ("shape spectra names", lambda f: read_spectrum(write_library(f, "{asphalt}"))),
]


@pytest.mark.parametrize(("fault", "call"), REFUSED)
def test_bad_headers_are_refused(tmp_path, fault, call):
    fails(call, tmp_path, fault)
