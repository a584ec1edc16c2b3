"""``volspec relight``: error maps, other reflectances, spectral pictures, warnings."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

from volspec import cli
from volspec.appearance import Viewing
from volspec.basis import Basis, MaterialBasis, SpectralBasis
from volspec.export import read_frame_text
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.pipeline import Relighter
from volspec.raycast import CoefficientImage
from volspec.relight import ErrorMap, LightRig, RelightSpec, error_map, relight
from volspec.spectra import DEFAULT_GRID, SpectralImage, light, reflectance, reflectance_set

GENERAL = SpectralBasis.load("general-7")
METALS = MaterialBasis({"rotor": reflectance("copper"), "case": reflectance("iron")})
CHART = reflectance_set("test").reshape(7, 12, 31)
NM = DEFAULT_GRID.wavelengths_nm


def call(*words: str | Path) -> int:
    """The command in this process; returns the exit code."""
    try:
        cli.main(["relight", *map(str, words)])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of a refusal."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("volspec: "), lines
    return lines[0]


def stored(path: Path, basis: Basis = GENERAL) -> Path:
    """The chart in a basis of spectra; or two metals beside each other, and a mix."""
    if isinstance(basis, MaterialBasis):
        shares = [[[0.9, 0.0, 0.0], [0.4, 0.4, 0.1], [0.0, 0.9, 0.0]]]
        coefficients = np.array(shares, np.float32)
    else:
        coefficients = (0.8 * basis.analyse(CHART)).astype(np.float32)
    alpha = np.full(coefficients.shape[:2], 0.9, np.float32)
    CoefficientImage(coefficients, alpha, np.ones_like(alpha), basis).save(path)
    return path


def measured(path: Path, kind: Any, values: np.ndarray = CHART) -> Path:
    SpectralImage(values, NM, kind).save(path)
    return path


def test_errors_writes_a_map_beside_each_frame_and_says_its_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = stored(tmp_path / "chart.exr")
    words = (chart, "--light", "FL4", "--light", "A", "-o", tmp_path / "F.png", "--backdrop", "0.5")
    assert call(*words, "--errors") == 0
    names = ("F-FL4.png", "F-FL4-errors.png", "F-A.png", "F-A-errors.png")
    assert {p.name for p in tmp_path.iterdir()} == {"chart.exr", *names}
    # Long paths are wrapped by the terminal.
    printed = "".join(capsys.readouterr().out.split())
    for name in ("FL4", "A"):
        found = error_map(CoefficientImage.load(chart), light(name), backdrop=0.5)
        drawn = tmp_path / f"F-{name}-errors.png"
        assert np.array_equal(iio.imread(drawn), found.image())
        assert read_frame_text(drawn)["light"] == name
        assert "".join(f"{drawn}: {found}".split()) in printed


def test_without_the_option_no_map_is_written(tmp_path: Path) -> None:
    chart = stored(tmp_path / "chart.exr")
    assert call(chart, "--light", "FL4", "-o", tmp_path / "F.png") == 0
    assert {p.name for p in tmp_path.iterdir()} == {"chart.exr", "F.png"}


def test_a_material_is_shown_with_another_reflectance(tmp_path: Path) -> None:
    """You should see gold where copper was; iron stays."""
    metals = stored(tmp_path / "metals.exr", METALS)
    words = (metals, "--light", "D65", "-o")
    assert call(*words, tmp_path / "plain.png") == 0
    assert call(*words, tmp_path / "gold.png", "--reflectance", "rotor=gold") == 0
    both = ("--reflectance", "rotor = gold", "--reflectance", "case=ColorChecker/cyan")
    assert call(*words, tmp_path / "both.png", *both) == 0
    plain, gold, two = (iio.imread(tmp_path / f"{n}.png") for n in ("plain", "gold", "both"))
    changes = {"rotor": reflectance("gold")}
    with Relighter(CoefficientImage.load(metals)) as relighter:
        assert np.array_equal(plain, relighter.frame(light("D65")))
        relighter.set_reflectances(changes)
        assert np.array_equal(gold, relighter.frame(light("D65")))
        relighter.set_reflectances({"case": reflectance("ColorChecker/cyan")})
        assert np.array_equal(two, relighter.frame(light("D65")))
    off = np.abs(gold.astype(int) - plain).max(axis=-1)[0]
    assert off[0] > 10 and off[1] > 5 and off[2] == 0


@pytest.mark.parametrize(
    ("basis", "word", "message"),
    [
        (GENERAL, "rotor=gold", "reflectances cannot be edited in basis 'general-7'"),
        (METALS, "rottor=gold", "did you mean 'rotor'"),
        (METALS, "rotor=goldd", "'gold'"),
        (METALS, "rotor", "write MATERIAL=REFLECTANCE"),
        (METALS, "=gold", "write MATERIAL=REFLECTANCE"),
        (METALS, "rotor=", "write MATERIAL=REFLECTANCE"),
    ],
)
def test_a_reflectance_that_cannot_be_shown_is_refused(
    basis: Basis, word: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = stored(tmp_path / "i.exr", basis)
    assert call(image, "--light", "A", "-o", tmp_path / "f.png", "--reflectance", word) == 1
    assert message in said(capsys)
    assert not (tmp_path / "f.png").exists()


def test_a_picture_of_reflectances_is_relit_in_the_basis_asked_for(tmp_path: Path) -> None:
    picture = measured(tmp_path / "chart.exr", "reflective")
    frames = {}
    for name in ("general-7", "general-5"):
        out = tmp_path / f"{name}.png"
        assert call(picture, "--basis", name, "--light", "FL2", "-o", out) == 0
        loaded, basis = SpectralImage.load(picture), SpectralBasis.load(name)
        image = CoefficientImage.from_spectral_image(loaded, basis)
        frames[name] = iio.imread(out)
        assert np.array_equal(frames[name], relight(image, light("FL2")))
    assert (frames["general-7"] != frames["general-5"]).any()
    assert frames["general-7"].std() > 30


def test_a_picture_of_radiances_is_relit_from_the_light_it_was_taken_under(tmp_path: Path) -> None:
    picture = measured(tmp_path / "chart.exr", "emissive", 2.5 * CHART * light("A").values)
    out = tmp_path / "f.png"
    words = ("--basis", "general-7", "--light", "D65", "-o", out)
    assert call(picture, *words, "--taken-under", "A") == 0
    right = iio.imread(out).astype(int)
    loaded = SpectralImage.load(picture)
    image = CoefficientImage.from_spectral_image(loaded, GENERAL, light("A"))
    assert np.array_equal(right, relight(image, light("D65")))
    assert call(picture, *words, "--taken-under", "D65") == 0
    assert np.abs(iio.imread(out) - right).max() > 30, "red, where the lamp is left in"


@pytest.mark.parametrize(
    ("kind", "words", "message"),
    [
        ("reflective", (), "not a coefficient image"),
        ("emissive", ("--basis", "general-7"), "radiances"),
        ("reflective", ("--taken-under", "A"), "--taken-under is for spectral pictures; add"),
        ("reflective", ("--basis", "general-7", "--taken-under", "A"), "only reflective ones"),
        ("reflective", ("--basis", "general-8"), "'general-7'"),
        ("emissive", ("--basis", "general-7", "--taken-under", "D56"), "'D65'"),
        ("emissive", ("--basis", "general-7", "--taken-under", "LPS"), "next to nothing at"),
    ],
)
def test_a_spectral_picture_that_cannot_be_relit_is_refused(
    kind: str,
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    picture = measured(tmp_path / "chart.exr", kind)
    assert call(picture, "--light", "A", "-o", tmp_path / "f.png", *words) == 1
    line = said(capsys)
    assert message in line
    assert not (tmp_path / "f.png").exists()


def test_spectra_do_not_replace_the_image_they_are_made_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = stored(tmp_path / "chart.exr")
    before = chart.read_bytes()
    assert call(chart, "--light", "A", "--spectral", "-o", chart) == 1
    assert "is the image that is relit; name another file" in said(capsys)
    assert chart.read_bytes() == before


def test_lights_without_lux_relight_the_image_of_a_scene_with_lux(tmp_path: Path) -> None:
    image = CoefficientImage.load(stored(tmp_path / "chart.exr"))
    absolute = replace(image, notes={"viewing": '{"level": "absolute"}'})
    absolute.save(tmp_path / "chart.exr")
    assert call(tmp_path / "chart.exr", "--light", "A", "-o", tmp_path / "F.png") == 0
    assert np.array_equal(iio.imread(tmp_path / "F.png"), relight(image, light("A")))


def grouped(path: Path) -> Path:
    """The chart under a key from the left and a fill from the right."""
    chart = (0.8 * GENERAL.analyse(CHART)).astype(np.float32)
    ramp = np.linspace(0, 1, chart.shape[1], dtype=np.float32)[None, :, None]
    alpha = np.full(chart.shape[:2], 0.9, np.float32)
    layers = np.concatenate([0.7 * (1 - ramp) * chart, 0.3 * ramp * chart], axis=-1)
    shares = {"key": 0.7, "fill": 0.3}
    CoefficientImage(layers, alpha, alpha, GENERAL, groups=shares).save(path)
    return path


SETTINGS = {
    "key=D65; fill=A*0.3": LightRig((light("D65"), light("A*0.3")), groups=("key", "fill")),
    " fill = planck:2500 ": LightRig((light("planck:2500"),), groups=("fill",)),
    "key=D65*0.5+A;FL2": LightRig((light("D65*0.5+A"), light("FL2")), groups=("key", "")),
    "A": LightRig((light("A"),)),
}


@pytest.mark.parametrize("text", SETTINGS)
def test_each_group_can_have_its_light(tmp_path: Path, text: str) -> None:
    chart = grouped(tmp_path / "chart.exr")
    assert call(chart, "--light", text, "-o", tmp_path / "F.png", "--errors") == 0
    stored = CoefficientImage.load(chart)
    frame = iio.imread(tmp_path / "F.png")
    assert np.array_equal(frame, relight(stored, SETTINGS[text]))
    assert read_frame_text(tmp_path / "F.png")["light"] == text
    found = error_map(stored, SETTINGS[text])
    assert np.array_equal(iio.imread(tmp_path / "F-errors.png"), found.image())


def test_a_setting_is_one_light_among_several(tmp_path: Path) -> None:
    chart = grouped(tmp_path / "chart.exr")
    words = ("--light", "key=A; fill=D65", "--light", "D65")
    assert call(chart, *words, "-o", tmp_path / "F.png") == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"chart.exr", "F-key-A--fill-D65.png", "F-D65.png"}


def test_a_light_stays_one_whatever_its_file_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here both a group's name stands before the first = and ; is in the name."""
    monkeypatch.chdir(tmp_path)
    chart = grouped(tmp_path / "chart.exr")
    Path("key=A; fill=D65.csv").write_text("390,1\n710,5\n")
    assert call(chart, "--light", "key=A; fill=D65.csv", "-o", "F.png") == 0
    whole = light("key=A; fill=D65.csv")
    assert np.array_equal(iio.imread("F.png"), relight(CoefficientImage.load(chart), whole))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "kye=D65",
            "--light 'kye=D65': no light group 'kye'; did you mean 'key'? the image has key",
        ),
        ("key=D65; key=A", "group 'key' has two lights; mix them"),
        ("D65; A", "all groups have two lights; mix them"),
        ("key=D56", "'D65'"),
        ("key=", "write GROUP=LIGHT; GROUP=LIGHT"),
        ("=D65", "write GROUP=LIGHT; GROUP=LIGHT"),
        ("key=D65;", "write GROUP=LIGHT; GROUP=LIGHT"),
        ("key D65", "'key D65' is unknown"),
    ],
)
def test_a_setting_that_cannot_be_read_is_refused(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = grouped(tmp_path / "chart.exr")
    assert call(chart, "--light", text, "-o", tmp_path / "F.png") == 1
    assert message in said(capsys)
    assert not (tmp_path / "F.png").exists()


def test_groups_of_an_image_without_any_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = stored(tmp_path / "chart.exr")
    assert call(chart, "--light", "key=D65", "-o", tmp_path / "F.png") == 1
    assert "no light group 'key'; the image has light" in said(capsys)


# One hundred pixels: their 95 % lies between the 95th and the 96th.
ERRORS = {
    "just below three": ([2.99] * 100, False),
    "just above three": ([3.01] * 100, True),
    "a few large ones": ([0.1] * 97 + [50.0] * 3, False),
    "a tenth of all": ([0.1] * 90 + [4.0] * 10, True),
}


@pytest.mark.parametrize("case", ERRORS)
def test_a_warning_tells_when_one_pixel_in_twenty_is_off_by_three(
    case: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    values, warned = ERRORS[case]
    asked = []

    def found(_: Relighter, lamp: Any, mode: str, backdrop: float, every: int) -> ErrorMap:
        asked.append((lamp.name, mode, backdrop, every))
        return ErrorMap(np.array([values], np.float32), np.ones((1, 100), np.float32))

    monkeypatch.setattr(Relighter, "error_map", found)
    chart = stored(tmp_path / "chart.exr")
    words = ("--mode", "linear-model", "--backdrop", "0.4", "--light", "A")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert call(chart, *words, "-o", tmp_path / "f.png") == 0
    assert asked == [("A", "linear-model", 0.4, 1)], "the picture's own mode and backdrop"
    err = capsys.readouterr().err
    if warned:
        assert err.count("warning") == 1 and "--mode exact" in err and "A: " in err
        assert f"{values[-1]:.1f}" in err
    else:
        assert err == ""


@pytest.mark.parametrize("level", ["relative", "absolute"])
def test_lux_of_the_scene_s_lights_are_told_and_can_be_given(
    level: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the note says to add gives the picture that an export has."""
    image = CoefficientImage.load(stored(tmp_path / "chart.exr"))
    noted = replace(image, notes={"viewing": f'{{"level": "{level}", "exposure": 0.8}}'})
    rig = LightRig((light("A"),), illuminance_lux=(500.0,))
    spec = RelightSpec(Viewing(exposure=0.8), level=level)
    recipe = Recipe.of(GENERAL, image.groups, {"lamp": rig}, spec)
    save_for_compositors(noted, tmp_path / "chart.exr", recipe)
    words = (tmp_path / "chart.exr", "--light", "A", "-o", tmp_path / "F.png")
    assert call(*words) == 0
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and told.startswith("volspec: note: ")
    more = ["--lux", "500"]
    if level == "absolute":
        more += ["--exposure", "0.4"]
        assert "volspec export SCENE.toml --light NAME -o FOLDER" in told
    else:
        assert "(lamp 500)" in told
    assert " ".join(more) in told or level == "relative"
    assert call(*words, *more) == 0
    assert capsys.readouterr().err == ""
    frame = iio.imread(tmp_path / "F.png")
    assert np.array_equal(frame, relight(image, rig, RelightSpec(spec.viewing, level=level)))


@pytest.mark.parametrize(
    ("exposure", "said"), [("1e-6", "all black under A"), ("1e6", "clipped all over under A")]
)
def test_a_frame_that_shows_nothing_is_told(
    exposure: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = stored(tmp_path / "chart.exr")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        words = ("--light", "A", "-o", tmp_path / "F.png", "--model", "none")
        assert call(chart, *words, "--exposure", exposure) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("volspec: warning: ") and f"F.png is {said}" in line
    assert line.endswith("--exposure")


def test_a_group_that_gave_no_light_is_told_by_its_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = CoefficientImage.load(grouped(tmp_path / "chart.exr"))
    replace(image, groups={"key": 1.0, "fill": 0.0}).save(tmp_path / "chart.exr")
    words = ("--light", "fill=A", "-o", tmp_path / "F.png")
    assert call(tmp_path / "chart.exr", *words) == 1
    assert "--light 'fill=A': there is no light, as group 'fill' gave none" in said(capsys)
