"""``volspec basis``: what it reports on, what it writes, and what it says to bad input."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import GENERAL, METALS, METALS_SCENE, figures, write_image
from tests.support.commands import call as command
from tests.support.fixtures import Capture, Patch
from volspec.basis import SpectralBasis, load_basis
from volspec.basis import report_table as table
from volspec.basis.make import SPIKY_SHARE
from volspec.spectra import light_set

ROOT = Path(__file__).resolve().parents[2]


def noted_fits(monkeypatch: Patch) -> list[dict[str, Any]]:
    """Record the arguments of each fit, which returns a few channels at once."""
    asked: list[dict[str, Any]] = []
    quick = SpectralBasis.fit

    def fit(lights: Any, reflectances: Any, **settings: Any) -> SpectralBasis:
        asked.append({"lights": lights, **settings})
        kept = {key: settings[key] for key in ("observer_deg", "trained_on") if key in settings}
        return quick(lights[:3], reflectances, size=3, method="pca", **kept)

    monkeypatch.setattr(SpectralBasis, "fit", fit)
    # What it gives is for no other test.
    monkeypatch.setattr("volspec.basis.fit_cache.cached_arrays", lambda name, maker, make: make())
    return asked


call = partial(command, "basis")


def report(capsys: Capture, *words: str) -> dict:
    return figures(capsys, "basis", *words)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (tmp_path / "metals.toml").write_text(METALS_SCENE)
    return str(tmp_path / "metals.toml")


@pytest.mark.slow
def test_without_a_subject_the_general_basis_is_measured(capsys):
    data = report(capsys)
    assert (data["name"], data["method"], data["size"]) == ("general-7", "virtual-sensors", 7)
    assert data["fingerprint"] == load_basis("general-7").fingerprint
    smooth, spiky = data["classes"]["smooth"], data["classes"]["spiky"]
    assert (smooth["lights"], spiky["lights"], smooth["reflectances"]) == (26, 89, 84)
    # METHOD section 2: RGB product .95 / .62 / 3.1 / 9.1 under smooth lights.
    assert data["rgb_product"]["smooth"]["mean"] == pytest.approx(0.95, abs=0.01)
    assert smooth["mean"] < 0.03 < spiky["mean"] < smooth["rgb_product"]["mean"]
    assert data["worst"]["delta_e"] == max(smooth["max"], spiky["max"])
    worst = data["worst"]
    assert (worst["class"], worst["way"]) == ("spiky", "fitted")
    assert worst["sRGB"] != worst["sRGB_shown"]
    # Measured .93.
    assert np.abs(np.subtract(worst["XYZ"], worst["XYZ_shown"])).max() > 0.8


@pytest.mark.usefixtures("few_lights")
def test_people_get_a_table_of_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert call("general-7") == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "".join(lines).count("#") == 2, "the worst pair's two colours"


@pytest.mark.slow
def test_a_scene_is_measured_on_its_materials_under_its_lights_and_the_library_s(
    scene, capsys, request
):
    data = report(capsys, scene)
    assert data["name"] == "general-7" and " 2 " in data["measured_on"]
    lights = {name: row["lights"] for name, row in data["classes"].items()}
    assert lights == {"scene": 2, "smooth": 26, "spiky": 89}
    assert data["worst"]["reflectance"] in {"rotor", "case"}
    assert data["classes"]["scene"]["worst"]["light"] in {"lamp", "sun"}
    request.getfixturevalue("few_lights")
    other = report(capsys, scene, "--reflectances", "training")
    assert other["classes"]["scene"]["reflectances"] == 128


def test_a_scene_can_be_asked_for_another_basis(scene, tmp_path, capsys):
    out = tmp_path / "own.json"
    data = report(capsys, scene, "--size", "3", "--method", "reduced-rank", "-o", str(out))
    assert (data["method"], data["size"]) == ("reduced-rank", 3)
    assert load_basis(out).fingerprint == data["fingerprint"]
    data = report(capsys, scene, "--method", "materials")
    assert data["size"] == 3 and data["worst"]["delta_e"] < 1e-6
    assert data["classes"]["scene"]["products"] == {}


def test_a_basis_is_fitted_to_the_training_set_and_written(tmp_path, capsys):
    out, figure = tmp_path / "own.json", tmp_path / "own.png"
    words = ("--method", "pca-sharpened", "--size", "5", "-o", str(out), "--figure", str(figure))
    data = report(capsys, *words)
    # METHOD section 2: 2.2 / 1.7 / 6.2 / 33 for five channels under smooth lights, on 31 bands;
    # 2.07 on the default ones, and 1.52 in the default mode.
    smooth = data["classes"]["smooth"]
    assert smooth["componentwise"]["mean"] == pytest.approx(2.07, abs=0.1)
    assert smooth["mean"] == pytest.approx(1.52, abs=0.1)
    assert "spiky" not in data["trained_on"] and "smooth" in data["trained_on"]
    basis = load_basis(out)
    assert (basis.size, basis.fingerprint) == (5, data["fingerprint"])
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["own.json", "own.png"]


@pytest.mark.usefixtures("few_lights")
def test_the_observer_of_ten_degrees_is_another_eye(capsys):
    words = ("--method", "pca", "--size", "5")
    two, ten = (report(capsys, *words, "--observer", n) for n in ("2", "10"))
    assert (two["observer_deg"], ten["observer_deg"]) == (2, 10)
    assert two["rgb_product"]["mean"] != pytest.approx(ten["rgb_product"]["mean"], abs=1e-3)


@pytest.fixture
def few_lights(monkeypatch: Patch) -> None:
    """Reports under one light of each class: these tests do not ask for figures under all."""
    monkeypatch.setattr(table, "light_set", lambda name, grid: light_set(name, grid)[:1])


@pytest.mark.usefixtures("few_lights")
def test_a_scene_s_basis_may_be_for_the_eye_of_ten_degrees(scene, capsys):
    plain = report(capsys, scene, "--method", "materials")
    wide = report(capsys, scene, "--method", "materials", "--observer", "10")
    assert (plain["observer_deg"], wide["observer_deg"]) == (2, 10)
    two, ten = (row["classes"]["scene"]["worst"]["XYZ"] for row in (plain, wide))
    assert two != pytest.approx(ten, abs=0.01)


def test_the_observer_alone_fits_a_scene_s_basis_anew(scene, monkeypatch, capsys):
    """The scene names general-7, which is for 2 degrees."""
    asked = noted_fits(monkeypatch)
    assert report(capsys, scene, "--observer", "10")["name"] != "general-7"
    assert [fit["observer_deg"] for fit in asked] == [10]


@pytest.mark.slow
@pytest.mark.usefixtures("few_lights")
@pytest.mark.parametrize("lights", [None, "smooth", "all"])
@pytest.mark.parametrize("method", ["virtual-sensors", "reduced-rank", "pca", "pca-sharpened"])
def test_a_basis_is_fitted_under_the_lights_that_are_asked_for(method, lights, monkeypatch, capsys):
    asked = noted_fits(monkeypatch)
    words = () if lights is None else ("--lights", lights)
    data = report(capsys, "--method", method, "--size", "5", *words, "--reflectances", "test")
    (fit,) = asked
    names = [lamp.name for lamp in fit["lights"]]
    smooth, spiky = ([lamp.name for lamp in light_set(kind)] for kind in ("smooth", "spiky"))
    few = lights == "smooth" or (lights is None and method.startswith("pca"))
    assert names == (smooth if few else smooth + spiky)
    assert data["trained_on"].startswith("26 smooth")
    weights, weighed = fit.get("light_weights"), method == "virtual-sensors" and not few
    assert (weights is not None) == weighed
    if weights is not None:
        sums = weights[:26].sum(), weights[26:].sum()
        assert sums == pytest.approx((1, SPIKY_SHARE))
    if not few:
        assert (f" {SPIKY_SHARE:g}" in data["trained_on"].partition(";")[0]) == weighed


@pytest.mark.usefixtures("few_lights")
@pytest.mark.parametrize(("basis", "count"), [(GENERAL, 84), (METALS, 2)])
def test_a_coefficient_image_is_measured_by_its_basis(basis, count, tmp_path, capsys):
    data = report(capsys, str(write_image(tmp_path / "i.exr", basis)))
    assert data["fingerprint"] == basis.fingerprint
    assert data["classes"]["smooth"]["reflectances"] == count


ODD = "[/b] $x_$ \N{CJK UNIFIED IDEOGRAPH-5149} $6^"


@pytest.mark.filterwarnings("ignore:text. no installed font")
def test_names_are_shown_as_they_are_spelt(scene, tmp_path, capsys):
    """No markup, no mathtext, no complaint about glyphs that the font lacks."""
    odd, figure = tmp_path / "odd.toml", tmp_path / "odd.png"
    text = METALS_SCENE
    for name in ("Two metals", "rotor", "case", "lamp"):
        text = text.replace(f'"{name}"', f'"{ODD} {name}"')
    odd.write_text(text.replace('{ name = "general-7" }', '{ train = "scene", size = 3 }'))
    assert call(str(odd), "--method", "pca", "--figure", str(figure)) == 0
    said = capsys.readouterr()
    assert said.out.startswith(ODD)
    assert any(f"{ODD} {metal}" in said.out for metal in ("rotor", "case"))
    assert "Glyph" not in said.err and figure.exists()


def test_a_file_that_may_not_be_read_is_named_in_one_line(monkeypatch, capsys):
    def locked(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", "locked/b.json")

    monkeypatch.setattr("volspec.basis.load_basis", locked)
    assert call("locked/b.json") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("volspec: locked/b.json: Permission denied; check")
