"""``volspec basis``: what it reports on, what it writes, and what it says to bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from volspec import cli
from volspec.basis import MaterialBasis, SpectralBasis, load_basis
from volspec.pipeline import raycast
from volspec.raycast import Camera
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import phantom

ROOT = Path(__file__).resolve().parent.parent
SCENE = """
title = "Two metals"
volume = { file = "none.nrrd" }
basis = { name = "general-7" }
transfer = { points = [{ value = 0, opacity = 0.1, material = "rotor" }] }
material = [{ name = "rotor", reflectance = "copper" }, { name = "case", reflectance = "iron" }]
light = [{ name = "lamp", spectrum = "A" }, { name = "sun", spectrum = "D65" }]
"""


def call(*words: str) -> int:
    """The command in this process; returns the exit code."""
    try:
        cli.main(["basis", *words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def report(capsys: pytest.CaptureFixture[str], *words: str) -> dict:
    assert call(*words, "--json") == 0
    said = capsys.readouterr()
    assert said.err == ""
    return json.loads(said.out)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (tmp_path / "metals.toml").write_text(SCENE)
    return str(tmp_path / "metals.toml")


def test_without_a_subject_the_general_basis_is_measured(
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = report(capsys)
    assert (data["name"], data["method"], data["size"]) == ("general-7", "virtual-sensors", 7)
    assert data["fingerprint"] == load_basis("general-7").fingerprint
    smooth, spiky = data["classes"]["smooth"], data["classes"]["spiky"]
    assert (smooth["lights"], spiky["lights"], smooth["reflectances"]) == (26, 89, 84)
    # METHOD section 2: RGB product .95 / .62 / 3.1 / 9.1 under smooth lights.
    assert data["rgb_product"]["smooth"]["mean"] == pytest.approx(0.95, abs=0.01)
    assert smooth["mean"] < 0.03 < spiky["mean"] < smooth["rgb_product"]["mean"]
    assert data["worst"]["delta_e"] == max(smooth["max"], spiky["max"])
    assert data["worst"]["class"] == "spiky"


def test_people_get_a_table_of_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert call("general-7") == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "smooth lights (26)" in text and "RGB mean" in text and "worst: " in text
    assert text.count("#") == 2, "the worst pair's two colours"


def test_a_scene_is_measured_on_its_materials_under_its_lights_and_the_library_s(
    scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data = report(capsys, scene)
    assert data["name"] == "general-7" and data["measured_on"] == "the scene's 2 materials"
    lights = {name: row["lights"] for name, row in data["classes"].items()}
    assert lights == {"scene": 2, "smooth": 26, "spiky": 89}
    assert data["worst"]["reflectance"] in {"rotor", "case"}
    assert data["classes"]["scene"]["worst"]["light"] in {"lamp", "sun"}
    other = report(capsys, scene, "--reflectances", "training")
    assert other["classes"]["scene"]["reflectances"] == 128


def test_a_scene_can_be_asked_for_another_basis(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "own.json"
    data = report(capsys, scene, "--size", "3", "--method", "reduced-rank", "-o", str(out))
    assert (data["method"], data["size"], data["name"]) == ("reduced-rank", 3, "Two metals")
    assert load_basis(out).fingerprint == data["fingerprint"]
    data = report(capsys, scene, "--method", "materials")
    assert data["size"] == 3 and data["worst"]["delta_e"] < 1e-6
    assert data["classes"]["scene"]["products"] == {}


def test_a_basis_is_fitted_to_the_training_set_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figure = tmp_path / "own.json", tmp_path / "own.png"
    words = ("--method", "pca-sharpened", "--size", "5", "-o", str(out), "--figure", str(figure))
    data = report(capsys, *words)
    # METHOD section 2: 2.2 / 1.7 / 6.2 / 33 for five channels under smooth lights.
    assert data["classes"]["smooth"]["mean"] == pytest.approx(2.2, abs=0.1)
    assert "spiky" not in data["trained_on"] and "smooth" in data["trained_on"]
    assert load_basis(out).size == 5
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["own.json", "own.png"]
    again = report(capsys, str(out))
    assert again["fingerprint"] == data["fingerprint"]
    assert again["worst"]["delta_e"] == pytest.approx(data["worst"]["delta_e"])


def test_the_observer_of_ten_degrees_is_another_eye(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--method", "pca", "--size", "5")
    two, ten = (report(capsys, *words, "--observer", n) for n in ("2", "10"))
    assert (two["observer_deg"], ten["observer_deg"]) == (2, 10)
    assert two["rgb_product"]["mean"] != pytest.approx(ten["rgb_product"]["mean"], abs=1e-3)


@pytest.mark.parametrize("kind", ["general", "materials"])
def test_a_coefficient_image_is_measured_by_its_basis(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paint = {"rotor": reflectance("copper"), "case": reflectance("iron")}
    basis = MaterialBasis(paint) if kind == "materials" else SpectralBasis.load("general-7")
    transfer = TransferFunction([(0.1, 0.1, "rotor"), (0.7, 0.9, "case")], paint, basis)
    ball = phantom.ball(12)
    raycast(ball, transfer, Camera.orbit(ball), (16, 16)).save(tmp_path / "ball.exr")
    data = report(capsys, str(tmp_path / "ball.exr"))
    assert data["fingerprint"] == basis.fingerprint
    assert data["classes"]["smooth"]["reflectances"] == (2 if kind == "materials" else 84)


BAD = {
    "unknown basis": (("general-8",), 1, "'general-7'"),
    "missing file": (("none.json",), 1, "none.json: no such file"),
    "missing image": (("none.exr",), 1, "none.exr: no such"),
    "missing scene": (("none.toml",), 1, "none.toml: No such file"),
    "unreadable scene": (("BROKEN",), 1, "not valid TOML"),
    "unknown method": (("--method", "virtual-sensor"), 1, "did you mean 'virtual-sensors'"),
    "scene's method": (("--method", "materials"), 1, "give the scene"),
    "size too large": (("--size", "99"), 1, "3 to 31"),
    "size too small": (("--size", "2"), 1, "3 to 31"),
    "fitted twice": (("general-7", "--size", "5"), 1, "general-7 is fitted already, and --size"),
    "lights of a fitted one": (("general-7", "--lights", "all"), 1, "--lights would fit another"),
    "lights of a scene": (("SCENE", "--lights", "all"), 1, "fitted to its own lights"),
    "observer of a fitted one": (("general-7", "--observer", "10"), 1, "made for the 2° observer"),
    "unknown reflectances": (("--reflectances", "tset"), 1, "did you mean 'test'"),
    "no materials": (("--reflectances", "materials"), 1, "only a scene has them"),
    "figure's kind": (("--figure", "f.jpg"), 1, "name it .png"),
    "output's kind": (("-o", "b.toml"), 1, "name it .json"),
    "size is no number": (("--size", "seven"), 2, "--size"),
    "unknown lights": (("--lights", "dark"), 2, "--lights"),
    "unknown observer": (("--observer", "4"), 2, "--observer"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gives_one_line_and_its_exit_code(
    case: str,
    scene: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words, code, message = BAD[case]
    (tmp_path / "broken.toml").write_text("volume = [")
    named = {"SCENE": scene, "BROKEN": str(tmp_path / "broken.toml")}
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert call(*(named.get(word, word) for word in words), "--json") == code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("volspec: ") and message in lines[0]
    assert list((tmp_path / "empty").iterdir()) == []


def test_an_unwritable_figure_is_refused_before_the_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    assert call("--size", "9", "--figure", str(tmp_path / "file" / "f.png")) == 1
    assert "cannot write there" in capsys.readouterr().err


def test_the_report_s_worst_colours_differ_where_the_error_is_large(
    capsys: pytest.CaptureFixture[str],
) -> None:
    worst = report(capsys, "general-7")["worst"]
    assert worst["sRGB"] != worst["sRGB_shown"]
    assert np.abs(np.subtract(worst["XYZ"], worst["XYZ_shown"])).max() > 1
