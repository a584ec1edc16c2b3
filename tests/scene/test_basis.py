"""Choice of a scene's basis, with the reason."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.scenes import scene_text
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.report import BasisReport
from volspec.errors import InputError, SceneError, VolspecWarning
from volspec.relight import difference_map, error_map
from volspec.scene import Scene
from volspec.scene.basis import SceneSpectra, train_basis, use_of
from volspec.scene.tables.specs import BasisSpec
from volspec.scene.tables.transfer import PointSpec, TransferSpec
from volspec.spectra import (
    SpectralGrid,
    XYZ_from_spectra,
    light,
    light_set,
    reflectance,
    white_XYZ,
)
from volspec.volume import phantom

ROOT = Path(__file__).resolve().parents[2]
POINTS = [(0, 0, "block"), (9, 1, "part")]
MATERIALS = '[basis]\nmethod = "materials"'
COMPONENTWISE = '[viewing]\nmode = "componentwise"'


def scene(
    folder: Path, basis: str = "", block: str = "ColorChecker/cyan", lamp: str = "A"
) -> Scene:
    path = folder / "scene.toml"
    paints, lights = {"block": block, "part": "copper"}, {"day": "D65", "lamp": lamp}
    path.write_text(f"{scene_text(paints, POINTS, lights=lights)}{basis}\n")
    return Scene.load(path)


@pytest.mark.parametrize("size", [5, 7, 9])
def test_plain_spectra_take_the_general_basis_of_a_size(tmp_path, size):
    text = "" if size == 7 else f"[basis]\nsize = {size}"
    assert scene(tmp_path, text).basis.name == f"general-{size}"


def test_a_title_with_control_characters_names_a_basis(tmp_path):
    path = scene(tmp_path, MATERIALS, "white").path
    path.write_text('title = "a\\u0007b\\u202e"\n' + path.read_text())
    made = Scene.load(path)
    assert made.basis.name == r"a\x07b\u202e" and made.file.title == "a\x07b\u202e"


@pytest.mark.slow
@pytest.mark.not_quick
def test_spectra_that_the_general_basis_does_not_hold_are_trained_for(tmp_path):
    """A reflectance that oscillates, of which no note says that it is designed."""
    nm = np.arange(380, 781, 5)
    wave = 0.5 + 0.45 * np.cos(2 * np.pi * (nm - 380) / 60)
    rows = (f"{w},{v:.6f}" for w, v in zip(nm, wave, strict=True))
    (tmp_path / "wave.csv").write_text("\n".join(rows))
    found = scene(tmp_path, COMPONENTWISE, block="wave.csv", lamp="FL11")
    assert found.basis.name == "scene"
    assert "FL11" in found.basis_reason
    assert scene_errors(found).componentwise.max < 0.5


def test_fewer_materials_than_channels_take_the_general_basis_and_have_no_error(tmp_path):
    """The engine's metameric pair; no note says in this copy of it that it is designed."""
    text = (ROOT / "data/spectra/engine-inserts.csv").read_text()
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    (tmp_path / "wave.csv").write_text("\n".join(rows))
    found = scene(tmp_path, block="wave.csv", lamp="FL11")
    assert found.basis.name == "general-7"
    # The library's training set, of a thousandth of the weight, and the prior cost a little.
    assert scene_errors(found).fitted.max < 0.1


def scene_errors(made: Scene) -> BasisReport:
    """Errors of a scene's materials under its lights."""
    return made.basis.report([row.spectrum for row in made.lights], list(made.materials.values()))


@pytest.mark.not_quick
def test_a_designed_spectrum_is_trained_for(tmp_path):
    (tmp_path / "made.csv").write_text("# designed: yes\n380,0.2\n500,0.4\n780,0.3\n")
    found = scene(tmp_path, COMPONENTWISE, block="made.csv")
    assert found.basis.name == "scene" and found.basis_reason.startswith("made ")
    # Fitted, its colours are exact in any channels that distinguish it from the others.
    assert scene(tmp_path, block="made.csv").basis.name == "general-7"


def test_a_designed_light_is_trained_for(tmp_path, fits):
    (tmp_path / "led.csv").write_text("# designed: yes\n380,1\n500,2\n780,1\n")
    assert scene(tmp_path, COMPONENTWISE, lamp="led.csv").basis_reason.startswith("led ")
    assert len(fits) == 1 and fits[0]["lights"][1].name == "led"
    # The same light without the note is one of many that the general basis holds.
    (tmp_path / "led.csv").write_text("380,1\n500,2\n780,1\n")
    assert scene(tmp_path, lamp="led.csv").basis.name == "general-7" and len(fits) == 1


def comb_palette(folder: Path) -> None:
    """Write a palette whose light and reflectance alternate from band to band."""
    comb = np.arange(61) % 2
    text = "[criteria]\ngrid_nm = [400, 700, 5]\n"
    for kind, name, values in (("light", "comb", 2 * comb), ("reflectance", "odd", comb)):
        text += f'[[{kind}]]\nname = "{name}"\ndesign = true\nvalues = {values.tolist()}\n'
    (folder / "comb.toml").write_text(text)


def test_a_scene_takes_the_bands_of_its_palette(tmp_path, recwarn):
    """On bands of 10 nm each reflectance of the comb would be a grey of one half."""
    comb_palette(tmp_path)
    for light_name in ("A", "comb.toml#comb", "comb.toml#comb*0.5+A*0.5"):
        found = scene(tmp_path, MATERIALS, block="comb.toml#odd", lamp=light_name)
        bands = SpectralGrid(400, 700, 5)
        assert {row.spectrum.grid for row in found.lights} == {bands}
        assert found.materials["block"].values.tolist() == [0, 1] * 30 + [0]
        assert found.basis.grid == bands and "61" in found.basis_reason
    assert not recwarn.list


def test_a_scene_of_other_bands_than_its_palette_s_warns_with_the_difference(tmp_path):
    comb_palette(tmp_path)
    bands = "[basis]\ngrid_nm = [400, 700, 10]"
    with pytest.warns(VolspecWarning, match=r"61 bands.*scene has 31.*ΔE00 (\d+\.\d)") as warned:
        scene(tmp_path, bands, block="comb.toml#odd", lamp="comb.toml#comb")
    off = re.search(r"ΔE00 (\d+\.\d) \(block under lamp\)", str(warned[0].message))
    # Under the comb it reflects all light that there is, and half of it on bands of 10 nm.
    half, white = cielab(np.array([[0.5], [1.0]]) * [95.05, 100, 108.88], [95.05, 100, 108.88])
    assert off and float(off[1]) == pytest.approx(delta_E_2000(half, white), abs=0.5)


def test_spectra_are_trained_for_by_their_use(tmp_path, fits):
    """The second light at a quarter; the part, of a triangle of which the block has a tenth."""
    found = scene(tmp_path, 'weight = 0.25\n[basis]\ntrain = "scene"')
    (fit,) = fits
    library = len(light_set("smooth")) + len(light_set("spiky"))
    assert [e.name for e in fit["lights"][:2]] == ["D65", "A"]
    assert len(fit["lights"]) == 2 + library
    weights = np.asarray(fit["light_weights"])
    assert weights[:2] == pytest.approx([0.8, 0.2])
    # All of the library together a tenth of the scene's own.
    assert weights[2:] == pytest.approx(np.full(library, 0.1 / library))
    assert np.array(fit["reflectances"]) == pytest.approx(
        np.array([found.materials[name].values for name in ("block", "part")])
    )
    use = use_of(found.file.transfer)
    assert use["block"] < use["part"] == 1
    assert fit["reflectance_weights"] == pytest.approx([use["block"], 1])


def test_a_light_that_is_almost_off_still_counts_a_tenth(fits):
    lights = [light("D65"), light("A"), light("FL2")]
    paints = {"b": reflectance("gold"), "a": reflectance("copper")}
    seen = SceneSpectra(lights, [2.0, 0.5, 0.0], paints, {"a": 1.0, "b": 0.3})
    train_basis(BasisSpec(train="scene"), seen, "scene")
    own = np.array([1, 0.25, 0.1])
    assert fits[0]["light_weights"][:3] == pytest.approx(own / own.sum())
    assert fits[0]["reflectance_weights"] == [0.3, 1.0], "in the materials' order"


@pytest.mark.not_quick
def test_a_scene_may_name_ask_or_make_its_materials_the_channels(tmp_path):
    assert scene(tmp_path, '[basis]\nname = "general-5"').basis.name == "general-5"
    own = scene(tmp_path, '[basis]\ntrain = "scene"\nsize = 5')
    assert own.basis.name == "scene" and own.basis.size == 5
    fine = scene(tmp_path, "[basis]\ngrid_nm = [380, 730, 5]\nobserver_deg = 10\nsize = 5")
    assert isinstance(fine.basis, SpectralBasis)
    assert fine.basis.grid.size == 71 and fine.basis.observer_deg == 10
    cones = scene(tmp_path, f'{MATERIALS}\nobserver_deg = "CIE 2015 10"').basis
    assert cones.observer_deg == "CIE 2015 10"
    materials = scene(tmp_path, MATERIALS).basis
    assert isinstance(materials, MaterialBasis) and list(materials.materials) == ["block", "part"]


@pytest.mark.not_quick
def test_other_settings_are_tried_without_writing_them(tmp_path):
    path = scene(tmp_path, "[basis]\nsize = 5").path
    assert isinstance(Scene.load(path, {"method": "materials"}).basis, MaterialBasis)
    found = Scene.load(path, {"positive": True}).basis
    assert isinstance(found, SpectralBasis) and found.size == 5
    assert np.all(found.analysis >= 0)


@pytest.mark.parametrize(
    ("basis", "message"),
    [
        ('name = "general-7"\nsize = 5', "conflict basis.name"),
        ('method = "materials"\nsize = 5', "conflict basis.method"),
        ('name = "general-8"', "unknown basis"),
        ("size = 99", "range basis.size"),
        ('observer_deg = "CIE 2006 2"', "unknown basis.observer_deg"),
        ("grid_nm = [400, 705, 10]", "range basis"),
    ],
)
def test_settings_that_do_not_fit_are_named(tmp_path, basis, message):
    with raises(SceneError, *message.split(" ")):
        scene(tmp_path, "[basis]\n" + basis)


def test_use_is_opacity_over_values_and_none_is_forgotten():
    """Triangle of height 1 over 10 for the one, a hundredth of it for the other."""
    points = [
        PointSpec(value=0, opacity=0, material="a"),
        PointSpec(value=10, opacity=1, material="a"),
        PointSpec(value=10, opacity=0.01, material={"b": 1.0}),
        PointSpec(value=20, opacity=0.01, material="b"),
    ]
    assert use_of(TransferSpec(points=points)) == {"a": 1.0, "b": 0.1}


def test_a_mix_is_used_by_its_shares():
    """Computed by hand: the area under opacity times share, and a span's part for every point."""
    mix = {"a": 0.3, "b": 0.7}
    constant = [PointSpec(value=v, opacity=0.5, material=mix) for v in (0, 10)]
    assert use_of(TransferSpec(points=constant)) == pytest.approx({"a": 3 / 7, "b": 1.0})
    other = [*constant, PointSpec(value=20, opacity=0.5, material="a")]
    # Spans: a 10 * .15 + 5 * .15 + 5 * .5, b 10 * .35 + 5 * .35; points: 20/3 * opacity * share.
    a = 1.5 + 0.75 + 2.5 + 20 / 3 * (0.15 + 0.15 + 0.5)
    b = 3.5 + 1.75 + 20 / 3 * (0.35 + 0.35)
    assert use_of(TransferSpec(points=other)) == pytest.approx({"a": 1.0, "b": b / a})


DISC = """
[[mesh]]
shape = "disc"
size_mm = 8.0
material = "part"
turn_deg = [60.0, 0.0, 0.0]
grating = { spacing_um = 1.6, spread_deg = SPREAD }
"""


@pytest.mark.parametrize(("spread", "lamp"), [(1.0, "HP1"), (2.2, "FL11"), (4.0, "laser:532")])
def test_stripes_have_the_colours_of_full_bands(tmp_path, spread, lamp):
    """Against sums of the bands' reflectances, and with the number of a basis that is too small."""
    disc = DISC.replace("SPREAD", str(spread))
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    image = scene(tmp_path, disc, lamp=lamp).render(size=(64, 48))
    assert image.basis.method == "bands" and "approximated" not in image.notes
    S = np.float64(image.coefficients)
    for name in ("D65", lamp):
        shone, white = light(name), white_XYZ(light(name))
        exposure = 1.0 / max(S.max(), 1.0)
        own = exposure * XYZ_from_spectra(shone, S)
        shown = exposure * image.coefficients @ image.basis.colour_matrix(shone).T
        assert delta_E_2000(cielab(own, white), cielab(shown, white)).max() < 1e-4
    with pytest.warns(VolspecWarning, match=f"disc under {lamp}") as warned:
        small = scene(tmp_path, f'[basis]\nname = "general-5"\n{disc}', lamp=lamp)
    mean, most = map(
        float, re.findall(r"ΔE00 ([\d.]+) .* up to ([\d.]+)", str(warned[0].message))[0]
    )
    assert 1.0 < mean < most and most > 5.0
    picture = small.render(size=(64, 48))
    with raises(InputError, "unsupported"):
        error_map(picture, light(lamp))
    assert difference_map(picture, image, light(lamp)).max > 1.0
    assert error_map(image, light(lamp)).max < 1e-4


def test_bands_are_a_basis_of_any_scene(tmp_path):
    """A volume in all bands has the colours of its materials, which are exact as channels."""
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    bands = '[basis]\nmethod = "bands"'
    of_bands, exact = (scene(tmp_path, text).render(size=(16, 12)) for text in (bands, MATERIALS))
    assert of_bands.basis.size == 81
    lamp = light("FL11")
    XYZ = [image.coefficients @ image.basis.colour_matrix(lamp).T for image in (of_bands, exact)]
    assert np.abs(XYZ[0] - XYZ[1]).max() < 1e-3
    with raises(SceneError, "conflict"):
        scene(tmp_path, f"{bands}\nsize = 9")
