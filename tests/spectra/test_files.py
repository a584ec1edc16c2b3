"""Spectra from files: text tables, IES TM-27, and what lights and reflectances make of them."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

import pytest

from tests.spectra._files import constant, fails, saved
from volspec.errors import VolspecWarning
from volspec.spectra import SpectralGrid, Spectrum, light, read_spectrum, reflectance

FINE = SpectralGrid(360, 830, 1)
TABLE = """# Manufacturer: Lamps&Sons
# quantity = irradiance
# designed: yes,,
# see https://example.org/lamps
# A sentence about this, with: a colon.
nm,Warm-white,cold
380,1,3
500,1,3
780,1,3
"""
SAMPLE = '<SpectralData wavelength="{}">{}</SpectralData>'
SPECTRAL_FLUX = "# spectral quantity: Spectral flux\n" + constant(0.5)


def spdx(quantity: str = "relative", samples: str | None = None, count: int = 1) -> str:
    if samples is None:
        samples = "".join(SAMPLE.format(w, 0.5) for w in range(380, 781, 20))
    block = (
        f"<SpectralDistribution><SpectralQuantity>{quantity}</SpectralQuantity>"
        "<BandwidthFWHM>1.0</BandwidthFWHM><BandwidthCorrected>true</BandwidthCorrected>"
        f"{samples}</SpectralDistribution>"
    )
    return (
        '<?xml version="1.0"?><IESTM2714 xmlns="http://www.ies.org/iestm2714" version="1.0">'
        "<Header><Manufacturer>Lamps&amp;Sons</Manufacturer><CatalogNumber/>"
        "<Description>Streetlamp</Description><Laboratory>N/A</Laboratory>"
        "<MeasurementEquipment>SR-1</MeasurementEquipment></Header>"
        f"{block * count}</IESTM2714>"
    )


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return Path(saved(tmp_path, "lamps.csv", TABLE))


def test_comments_of_key_and_value_become_notes(table):
    notes = read_spectrum(f"{table}#cold").notes
    assert notes == {"manufacturer": "Lamps&Sons", "quantity": "irradiance", "designed": "yes"}


@pytest.mark.parametrize("column", ["warm-white", "WARM-WHITE", "1"])
def test_a_column_is_found_by_name_or_number(table, column):
    s = read_spectrum(f"{table}#{column}")
    assert (s.name, s.values.tolist()) == ("lamps#Warm-white", [1, 1, 1])


def test_columns_are_numbered_and_headers_may_hold_separators(tmp_path):
    path = saved(tmp_path, "bare.tsv", "400\t1\t5\n500\t2\t6\n")
    assert read_spectrum(f"{path}#2").values.tolist() == [5, 6]
    path = saved(tmp_path, "lamp.txt", "Wavelength, nm\tA, warm\tB\n400\t1\t5\n500\t2\t6\n")
    assert read_spectrum(f"{path}#a, warm").values.tolist() == [1, 2]


def test_notes_are_read_only_lower_case_text():
    s = Spectrum([400, 500], [1, 1], notes={"Maker  \t": "me"})
    assert dict(s.notes) == {"maker": "me"}
    assert isinstance(s.notes, MappingProxyType)


def test_notes_survive_grids_factors_copies_and_pickles():
    s = Spectrum([390, 710], [1, 1], "s", {"maker": "me"})
    for other in (s.on(SpectralGrid()), 2 * s, copy.deepcopy(s), pickle.loads(pickle.dumps(s))):
        assert (other.name, other.notes) == ("s", s.notes)


def test_a_sum_keeps_the_notes_both_sides_agree_on_and_is_designed_if_a_part_is():
    a = Spectrum([400, 500], [1, 1], "a", {"maker": "x", "lab": "L"})
    b = Spectrum([400, 500], [1, 1], "b", {"maker": "y", "lab": "L"})
    assert dict((a + b).notes) == {"lab": "L"}
    measured = Spectrum([400, 500], [1, 1], notes={"designed": "no"})
    for note, is_designed in (("yes", True), ("No", False), ("", False)):
        part = Spectrum([400, 500], [1, 1], notes={"designed": note})
        assert (measured + part).designed is (part + measured).designed is is_designed


def test_tm27_header_fields_become_notes_and_the_description_the_name(tmp_path):
    path = saved(tmp_path, "lamp.spdx", spdx())
    assert reflectance(path).values == pytest.approx(0.5)
    for lamp in (path, saved(tmp_path, "flux.spdx", spdx("flux"))):
        assert light(lamp).values == pytest.approx(1.0)
    s = read_spectrum(path)
    assert s.name == s.notes["description"] == "Streetlamp"
    assert s.wavelengths_nm[[0, -1]].tolist() == [380, 780]
    assert {key.replace(" ", "_"): value for key, value in s.notes.items()} == {
        "manufacturer": "Lamps&Sons",
        "description": "Streetlamp",
        "measurement_equipment": "SR-1",
        "spectral_quantity": "relative",
        "bandwidth_fwhm": "1.0",
        "bandwidth_corrected": "yes",
    }


def test_the_fluorescent_lamp_of_colour_science_is_read_sample_by_sample():
    import colour

    path = Path(colour.__file__).parent / "io" / "tests" / "resources" / "Fluorescent.spdx"
    if not path.is_file():
        pytest.skip("colour-science was installed without its test files")
    s = read_spectrum(path)
    assert (s.values.max(), s.wavelengths_nm[int(s.values.argmax())]) == (0.999, 547.2)


def test_file_forms_mix_with_names_and_each_other(table, tmp_path):
    (tmp_path / "lamp.spdx").write_text(spdx())
    mix = light("lamp.spdx*0.5+lamps.csv#cold*0.25 + 0.25*E", folder=tmp_path)
    assert mix.values == pytest.approx(1.0)
    assert mix.name == "lamp.spdx*0.5+lamps.csv#cold*0.25+E*0.25"
    (tmp_path / "a+b.txt").write_text(constant(2))
    assert light("a+b.txt+lamps.csv#warm-white", folder=tmp_path).values == pytest.approx(2.0)


def test_designed_spectra_say_so_after_lookup_and_mixing(table):
    assert light(f"{table}#cold").notes.get("designed") == "yes"
    assert light(f"{table}#cold*0.5+A*0.5").designed
    assert not light(f"{table}#cold*0+A").designed
    table.with_name("paint.csv").write_text("# designed: yes\n" + constant(0.5))
    assert reflectance("paint.csv", folder=table.parent).notes.get("designed") == "yes"


def test_a_file_that_is_continued_warns_unless_it_covers_the_visible(tmp_path):
    path = saved(tmp_path, "short.csv", constant(0.5))
    for text in (path, f"{path}*0.5+E*0.5"):
        with pytest.warns(VolspecWarning) as caught:
            light(text, FINE)
        message = str(caught[0].message)
        assert all(part in message for part in ("short.csv", "380-780", "360-380", "780-830"))
        assert caught[0].filename == __file__, "the warning points at the caller"
    with pytest.warns(VolspecWarning) as caught:
        reflectance(path, FINE)
    assert caught[0].filename == __file__
    # Warnings are errors in this suite.
    light(saved(tmp_path, "full.csv", constant(1, 360, 830)), FINE)
    light(saved(tmp_path, "visible.csv", constant(1, 400, 700)))
    light("FL2", FINE)
    reflectance("CES/1", FINE)


def test_fluorescent_paper_is_kept_with_a_warning(tmp_path):
    path = saved(tmp_path, "paper.csv", "390,0.5\n440,1.3\n500,0.9\n710,0.9\n")
    with pytest.warns(VolspecWarning) as caught:
        assert reflectance(path).values.max() > 1
    assert "paper.csv" in str(caught[0].message)
    assert caught[0].filename == __file__


def lamps(folder: Path, column: str) -> Spectrum:
    return read_spectrum(saved(folder, "lamps.csv", TABLE) + column)


def xml(folder: Path, text: str, read: Callable[[str], Spectrum] = read_spectrum) -> Spectrum:
    return read(saved(folder, "lamp.xml", text))


def directory(path: Path) -> Path:
    path.mkdir()
    return path


REFUSED = [
    ("missing", lambda f: lamps(f, "")),
    ("unknown", lambda f: lamps(f, "#cool")),
    ("unknown", lambda f: lamps(f, "#0")),
    ("unknown", lambda f: read_spectrum(saved(f, "lamp.spdx", spdx()) + "#2")),
    *(
        (code, lambda f, text=text: xml(f, text))
        for text, code in (
            (spdx()[:300], "damaged"),
            ("<item/>", "unsupported"),
            ("<IESTM2714/>", "unsupported"),
            (spdx(count=2), "unsupported"),
            (spdx(count=0), "damaged"),
            (spdx(samples=SAMPLE.format(400, 1)), "damaged"),
            (spdx().replace('"1.0"?', '"1.0" encoding="klingon"?'), "damaged"),
            (spdx(samples=SAMPLE.format(400, "1_0")), "syntax"),
            (spdx().replace('"400"', '"nan"'), "range"),
            (spdx(samples="<SpectralData>1</SpectralData>"), "syntax"),
            (spdx(samples=SAMPLE.format(500, 1) + SAMPLE.format(400, 1)), "range"),
            (spdx(samples=SAMPLE.format(400, "nan") + SAMPLE.format(500, 1)), "range"),
            (spdx().replace("1.0</Bandwidth", "x</Bandwidth"), "damaged"),
        )
    ),
    *(
        ("type", lambda f, quantity=quantity: xml(f, spdx(quantity), light))
        for quantity in ("reflectance", "transmittance", "R-Factor", "absorptance")
    ),
    *(
        ("type", lambda f, quantity=quantity: xml(f, spdx(quantity), reflectance))
        for quantity in ("flux", "irradiance", "radiance", "intensity", "exitance")
    ),
    ("type", lambda f: reflectance(saved(f, "lamp.csv", SPECTRAL_FLUX))),
]
for _name, _fault in (("a.spdx", "damaged"), ("a.txt", "damaged"), ("a.exr", "type")):
    REFUSED += [
        ("not-found", lambda f, name=_name: read_spectrum(f / name)),
        ("damaged", lambda f, name=_name: read_spectrum(saved(f, name, bytes(range(128, 256))))),
        (_fault, lambda f, name=_name: read_spectrum(directory(f / name))),
    ]


@pytest.mark.parametrize(("fault", "call"), REFUSED)
def test_bad_files_are_refused(tmp_path, fault, call):
    fails(call, tmp_path, fault)
