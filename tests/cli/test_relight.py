"""``volspec relight``: error maps, other reflectances, spectral pictures, viewing, warnings."""

import json
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from tests.support.commands import (
    CHART,
    GENERAL,
    METALS,
    write_grouped_image,
    write_image,
    write_spectral_image,
)
from tests.support.commands import call as command
from tests.support.fixtures import Capture
from volspec.appearance import Viewing
from volspec.appearance.display.monitors import preset
from volspec.appearance.display.spaces import SPACES
from volspec.basis import SpectralBasis
from volspec.cli.viewing import PictureOptions
from volspec.errors import SceneError
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.export.frames import read_frame_text
from volspec.export.png import icc_profile
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.relight import LightRig, RelightSpec, error_map, relight
from volspec.settings import read_table
from volspec.spectra import SpectralImage, light, reflectance

call = partial(command, "relight")


def shown(image: Path, *words: object) -> np.ndarray:
    """The frame of an image by the command, ``F.png`` next to it."""
    frame = image.with_name("F.png")
    assert call(image, *words, "-o", frame) == 0
    return iio.imread(frame)


def said(capsys: Capture, image: Path, *words: object) -> str:
    """Messages of a command on standard error while it makes its frame."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        shown(image, *words)
    return capsys.readouterr().err


def test_errors_writes_a_map_beside_each_frame_and_says_its_figures(tmp_path, capsys):
    chart = write_image(tmp_path / "chart.exr")
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


def test_a_material_is_shown_with_another_reflectance(tmp_path):
    """You should see gold where copper was; iron stays."""
    metals = write_image(tmp_path / "metals.exr", METALS)
    words = (metals, "--light", "D65", "--reflectance")
    plain, gold = shown(*words[:-1]), shown(*words, "rotor=gold")
    both = shown(*words, "rotor = gold", "--reflectance", "case=ColorChecker/cyan")
    with Relighter(CoefficientImage.load(metals)) as relighter:
        assert np.array_equal(plain, relighter.frame(light("D65")))
        relighter.set_reflectances({"rotor": reflectance("gold")})
        assert np.array_equal(gold, relighter.frame(light("D65")))
        relighter.set_reflectances({"case": reflectance("ColorChecker/cyan")})
        assert np.array_equal(both, relighter.frame(light("D65")))
    off = np.abs(gold.astype(int) - plain).max(axis=-1)[0]
    assert off[0] > 10 and off[1] > 5 and off[2] == 0


def test_a_picture_of_reflectances_is_relit_in_the_basis_asked_for(tmp_path):
    picture = write_spectral_image(tmp_path / "chart.exr", "reflective")
    seven, five = (
        shown(picture, "--basis", name, "--light", "FL2") for name in ("general-7", "general-5")
    )
    for frame, name in ((seven, "general-7"), (five, "general-5")):
        loaded, basis = SpectralImage.load(picture), SpectralBasis.load(name)
        image = CoefficientImage.from_spectral_image(loaded, basis)
        assert np.array_equal(frame, relight(image, light("FL2")))
    assert (seven != five).any() and seven.std() > 30


def test_a_picture_of_radiances_is_relit_from_the_light_it_was_taken_under(tmp_path):
    radiances = 2.5 * CHART * light("A").values
    picture = write_spectral_image(tmp_path / "chart.exr", "emissive", radiances)
    words = (picture, "--basis", "general-7", "--light", "D65", "--taken-under")
    right = shown(*words, "A").astype(int)
    image = CoefficientImage.from_spectral_image(SpectralImage.load(picture), GENERAL, light("A"))
    assert np.array_equal(right, relight(image, light("D65")))
    assert np.abs(shown(*words, "D65") - right).max() > 30, "red, where the lamp is left in"


SETTINGS = {
    "key=D65; fill=A*0.3": LightRig((light("D65"), light("A*0.3")), groups=("key", "fill")),
    " fill = planck:2500 ": LightRig((light("planck:2500"),), groups=("fill",)),
    "key=D65*0.5+A;FL2": LightRig((light("D65*0.5+A"), light("FL2")), groups=("key", "")),
    "A": LightRig((light("A"),)),
}


@pytest.mark.parametrize("text", SETTINGS)
def test_each_group_can_have_its_light(tmp_path, text):
    chart = write_grouped_image(tmp_path / "chart.exr")
    frame, stored = shown(chart, "--light", text, "--errors"), CoefficientImage.load(chart)
    assert np.array_equal(frame, relight(stored, SETTINGS[text]))
    assert read_frame_text(tmp_path / "F.png")["light"] == text
    errors = error_map(stored, SETTINGS[text]).image()
    assert np.array_equal(iio.imread(tmp_path / "F-errors.png"), errors)


def test_a_setting_is_one_light_among_several(tmp_path):
    chart = write_grouped_image(tmp_path / "chart.exr")
    words = ("--light", "key=A; fill=D65", "--light", "D65", "-o", tmp_path / "F.png")
    assert call(chart, *words) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"chart.exr", "F-key-A--fill-D65.png", "F-D65.png"}


def test_a_light_stays_one_whatever_its_file_is_called(tmp_path, monkeypatch):
    """A group's name before the first =, and a ; in the file's name."""
    monkeypatch.chdir(tmp_path)
    chart, file = write_grouped_image(tmp_path / "chart.exr"), "key=A; fill=D65.csv"
    Path(file).write_text("390,1\n710,5\n")
    whole = relight(CoefficientImage.load(chart), light(file))
    assert np.array_equal(shown(chart, "--light", file), whole)


@pytest.mark.parametrize(
    ("mode", "lamp", "advice"),
    [
        ("fitted", "D65", ""),
        ("componentwise", "D65", ""),
        ("componentwise", "LPS", "use the mode fitted"),
        ("fitted", "LPS", ""),
        # Blue light within 20 nm is beyond these channels.
        ("fitted", "led:470", "cast with more"),
    ],
)
def test_a_warning_tells_of_a_light_that_the_mode_does_not_hold(
    mode, lamp, advice, tmp_path, capsys
):
    chart = write_image(tmp_path / "chart.exr")
    err = said(capsys, chart, "--mode", mode, "--light", lamp)
    if advice:
        assert err.count("warning") == err.count(advice) == 1 and lamp in err
    else:
        assert err == ""


@pytest.mark.parametrize("level", ["relative", "absolute"])
def test_lux_of_the_scene_s_lights_are_told_and_can_be_given(level, tmp_path, capsys):
    """Options suggested by the note give the picture of an export."""
    path = write_image(tmp_path / "chart.exr")
    image = CoefficientImage.load(path)
    noted = replace(image, notes={"viewing": f'{{"level": "{level}", "exposure": 0.8}}'})
    rig = LightRig((light("A"),), illuminance_lux=(500.0,))
    spec = RelightSpec(Viewing(exposure=0.8), level=level)
    save_for_compositors(noted, path, Recipe.of(GENERAL, image.groups, {"lamp": rig}, spec))
    (note,) = said(capsys, path, "--light", "A").splitlines()
    assert note.startswith("volspec: note: ") and "500" in note
    # Lights without lux are at the relative level.
    assert np.array_equal(iio.imread(tmp_path / "F.png"), relight(image, light("A"), spec.viewing))
    more = ["--lux", "500"]
    if level == "absolute":
        more += ["--exposure", "0.4"]
        assert " ".join(more) in note
    frame = shown(path, "--light", "A", *more)
    assert capsys.readouterr().err == ""
    assert np.array_equal(frame, relight(image, rig, spec))


@pytest.mark.parametrize("exposure", ["1e-6", "1e6"])
def test_a_frame_that_shows_nothing_is_warned_of(exposure, tmp_path, capsys):
    chart = write_image(tmp_path / "chart.exr")
    words = ("--light", "A", "--model", "none", "--exposure", exposure)
    (line,) = said(capsys, chart, *words).splitlines()
    assert line.startswith("volspec: warning: ") and line.endswith("--exposure")


SCENE = {
    "model": "CAM16",
    "L_A": 5.0,
    "discount": True,
    "exposure": 0.5,
    "Y_b": 18.0,
    "display": {"preset": "cinema", "space": "DCI-P3", "mark": True, "L_A": 3.0},
}

OWN = read_table(RelightSpec, SCENE, SceneError)


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    """The test reflectances, with the viewing of a scene."""
    path = write_image(tmp_path / "chart.exr")
    replace(CoefficientImage.load(path), notes={"viewing": json.dumps(SCENE)}).save(path)
    return path


def onto(**options: object) -> Viewing:
    """The scene's viewing with options in place of what it says."""
    return PictureOptions(**options).onto(OWN).viewing


def test_what_is_left_out_is_as_in_the_scene():
    own = OWN.viewing
    assert onto() == own
    assert onto(exposure=2.0) == replace(own, exposure=2.0)
    assert onto(surround=0.1, Y_b=20.0, L_A=9.0) == replace(own, surround=0.1, Y_b=20.0, L_A=9.0)
    shown = replace(own.display, space="sRGB", gamut="reduce", mark=False)
    assert onto(space="sRGB", gamut="reduce", mark=False) == replace(own, display=shown)
    assert onto(deficiency="deutan") == replace(own, deficiency="deutan")
    mild = replace(own, deficiency="tritan", severity=0.25)
    assert onto(deficiency="tritan", severity=0.25) == mild


def test_what_says_the_same_in_the_scene_gives_way():
    own = OWN.viewing
    assert onto(illuminance_lux=50.0) == replace(own, illuminance_lux=50.0, L_A=None)
    assert onto(D=0.5) == replace(own, D=0.5, discount=False)
    room = replace(preset("dim room").display("DCI-P3"), mark=True)
    assert onto(preset="dim room") == replace(own, display=room)
    half = RelightSpec(Viewing(D=0.5))
    assert PictureOptions(discount=True).onto(half).viewing == Viewing(discount=True)


def test_lux_and_L_A_go_together_where_lights_are_held_against_the_lux():
    options = PictureOptions(illuminance_lux=50.0, L_A=9.0)
    viewing = options.onto(RelightSpec(level="absolute")).viewing
    assert (viewing.illuminance_lux, viewing.L_A) == (50.0, 9.0)


def test_a_frame_is_made_for_the_display_asked_for(chart):
    words = ("--space", "Display P3", "--gamut", "reduce", "--mark", "--lux", "200")
    found = shown(chart, "--light", "A", *words)
    viewing = onto(space="Display P3", gamut="reduce", mark=True, illuminance_lux=200.0)
    spec = RelightSpec(viewing, backdrop=0.2)
    assert np.array_equal(found, relight(CoefficientImage.load(chart), light("A"), spec))
    with Image.open(chart.with_name("F.png")) as frame:
        assert frame.info["icc_profile"] == icc_profile(SPACES[words[1]])


def test_flags_of_the_scene_can_be_taken_back(chart):
    found = shown(chart, "--light", "A", "--no-discount", "--no-mark", "--model", "CIECAM02")
    viewing = replace(onto(discount=False, mark=False), model="CIECAM02")
    assert np.array_equal(found, relight(CoefficientImage.load(chart), light("A"), viewing))
