"""The command line in this process, and files that its transcripts and tests use."""

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

from tests.support.wizards import SCENE as WIZARD_SCENE
from volspec.basis import Basis, MaterialBasis, SpectralBasis
from volspec.cli import main
from volspec.errors import VolspecError
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.image import CoefficientImage
from volspec.spectra import DEFAULT_GRID, SpectralImage, light, reflectance, reflectance_set
from volspec.volume import phantom

GENERAL = SpectralBasis.load("general-7")
METALS = MaterialBasis({"rotor": reflectance("copper"), "case": reflectance("iron")})
CHART = reflectance_set("test").reshape(7, 12, -1)
SCENE = """
version = 2
[volume]
file = "ball.npy"
[[material]]
name = "shell"
reflectance = "white"
[[material]]
name = "core"
reflectance = "copper"
[transfer]
points = [
    { value = 0.1, opacity = 0.0, material = "shell" },
    { value = 0.6, opacity = 0.4, material = "core" },
]
[[light]]
name = "day"
spectrum = "D65"
"""
METALS_SCENE = """
title = "Two metals"
version = 2
volume = { file = "none.nrrd" }
basis = { name = "general-7" }
transfer = { points = [{ value = 0, opacity = 0.1, material = "rotor" }] }
material = [{ name = "rotor", reflectance = "copper" }, { name = "case", reflectance = "iron" }]
light = [{ name = "lamp", spectrum = "A" }, { name = "sun", spectrum = "D65" }]
"""
PALETTE = """
title = "Two of them"
[[light]]
name = "day"      # given
spectrum = "D65"
[[reflectance]]
name = "a"
[[reflectance]]
name = "b"
[[cell]]
reflectance = "*"
light = "day"
colour = "steelblue"
"""


def call(*words: object) -> int:
    """Run a command; return its exit code."""
    try:
        main([*map(str, words)])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def refusal(*words: object) -> VolspecError:
    """Run a command that is refused; return the error behind its one line."""
    with pytest.raises(SystemExit) as caught:
        main([*map(str, words)])
    assert caught.value.code == 1
    assert isinstance(caught.value.__cause__, VolspecError)
    return caught.value.__cause__


def figures(capsys: pytest.CaptureFixture[str], *words: object, noted: bool = False) -> Any:
    """Run a command with ``--json``; return its figures, which notes may come with or not."""
    assert call(*words, "--json") == 0
    printed = capsys.readouterr()
    assert (printed.err != "") == noted
    return json.loads(printed.out)


def write_image(path: Path, basis: Basis = GENERAL) -> Path:
    """Write the chart in a basis of spectra; or two metals next to each other, and a mix."""
    if isinstance(basis, MaterialBasis):
        weights = [[[0.9, 0.0, 0.0], [0.4, 0.4, 0.1], [0.0, 0.9, 0.0]]]
        coefficients = np.array(weights, np.float32)
    else:
        coefficients = (0.8 * basis.analyse(CHART)).astype(np.float32)
    alpha = np.full(coefficients.shape[:2], 0.9, np.float32)
    CoefficientImage(coefficients, alpha, np.ones_like(alpha), basis).save(path)
    return path


def write_grouped_image(path: Path) -> Path:
    """Write the chart under a key from the left and a fill from the right."""
    chart = (0.8 * GENERAL.analyse(CHART)).astype(np.float32)
    ramp = np.linspace(0, 1, chart.shape[1], dtype=np.float32)[None, :, None]
    alpha = np.full(chart.shape[:2], 0.9, np.float32)
    layers = np.concatenate([0.7 * (1 - ramp) * chart, 0.3 * ramp * chart], axis=-1)
    weights = {"key": 0.7, "fill": 0.3}
    CoefficientImage(layers, alpha, alpha, GENERAL, groups=weights).save(path)
    return path


def write_lit_image(path: Path) -> Path:
    """Write a grey image whose header names two lights of its scene."""
    image = CoefficientImage(*(np.full(shape, 0.5, np.float32) for shape in _TINY), GENERAL)
    recipe = Recipe.of(GENERAL, image.groups, {"day": light("D65"), "lamp": light("A")})
    save_for_compositors(image, path, recipe)
    return path


def write_spectral_image(path: Path, kind: Any, values: np.ndarray = CHART) -> Path:
    """Write the chart's spectra as a picture."""
    SpectralImage(values, DEFAULT_GRID.wavelengths_nm, kind).save(path)
    return path


def write_wizard_scene(folder: Path) -> Path:
    """Write a scene whose materials are its channels, with what it reads."""
    np.save(folder / "ball.npy", phantom.ball(16).values)
    rows = zip(*(np.linspace(390, 710, 33), np.linspace(0.1, 0.6, 33)), strict=True)
    (folder / "stone.csv").write_text("\n".join(f"{nm:g},{value:g}" for nm, value in rows))
    text = WIZARD_SCENE.replace("ColorChecker/foliage", "stone.csv")
    text += '\n[basis]\nmethod = "materials"  # exact\n'
    (folder / "wizard.toml").write_text(text, encoding="utf-8")
    return folder / "wizard.toml"


def write_files(folder: Path) -> None:
    """Write what the transcripts name: volumes, images, and scenes with one fault each."""
    write_wizard_scene(folder)
    write_image(folder / "i.exr")
    write_image(folder / "metals.exr", METALS)
    write_grouped_image(folder / "groups.exr")
    whole = CoefficientImage.load(folder / "groups.exr")
    replace(whole, groups={"key": 1.0, "fill": 0.0}).save(folder / "dark-fill.exr")
    write_lit_image(folder / "lit.exr")
    write_spectral_image(folder / "reflective.exr", "reflective", CHART[:1, :1])
    write_spectral_image(folder / "emissive.exr", "emissive", CHART[:1, :1])
    for name, text in _TEXTS.items():
        (folder / name).write_text(text, encoding="utf-8")
    _write_open_volumes(folder)


def _write_open_volumes(folder: Path) -> None:
    """Write volumes whose addresses lack something."""
    (folder / "v_4x3x2_int16.raw").write_bytes(bytes(48))
    (folder / "a.raw").write_bytes(bytes(64 * 64 * 20))
    (folder / "m.stl").write_bytes(b"solid")
    (folder / "empty").mkdir()
    values = np.arange(48, dtype=np.int16)
    for name, shape in (("time.nii", (2, 2, 3, 4)), ("flat.nii", (6, 8))):
        image = sitk.GetImageFromArray(values.reshape(shape), isVector=False)
        sitk.WriteImage(image, str(folder / name))
    packed = gzip.compress((folder / "time.nii").read_bytes())
    (folder / "cut.nii.gz").write_bytes(packed[: len(packed) // 2])


_TINY = ((2, 2, GENERAL.size), (2, 2), (2, 2))
_KEY = "[[keyframe]]\ntime_s = {}\n{}\n".format
_OPAQUE = '{ value = 0.1, opacity = 5.0, material = "core" }'
_LIT = '[[light]]\nname = "lit"\nspectrum = "A"\nilluminance_lux = 9\n'
_TWICE = (
    '"day"\ncolour = "steelblue"\nmust = true\n[[reflectance]]\nname = "c"\n'
    '[[light]]\nname = "dusk"\nspectrum = "A"\n[[cell]]\nreflectance = "*"\n'
    'light = "dusk"\ncolour = "lime"\nmust = true'
)
_WRONG = SCENE.replace("spectrum", "spectrm").replace("opacity = 0.4", 'opacity = "much"')
_WRONG = _WRONG.replace('"white"', '"whit"')
_ROOM = """size_m = [4.0, 5.0, 2.7]
surface = [
    { name = "walls", reflectance = "grey:0.7" },
    { name = "floor", reflectance = "grey:0.3" },
    { name = "ceiling", reflectance = "white" },
]
[[light]]
name = "lamp"
spectrum = "A"
position_m = [2.0, 2.5, 2.0]
lumen = 1000
"""
# The ball, 15 mm wide, next to the lamp.
_LIT_BY_ROOM = SCENE.replace("D65", "room") + (
    '[room]\nfile = "room.toml"\nposition_m = [2.0, 2.5, 1.0]\npatches = 100\n'
)
_TEXTS = {
    "s.toml": SCENE,
    "room.toml": _ROOM.replace("white", "grey:0.9"),
    "coloured-room.toml": _ROOM.replace("white", "grey:0.9").replace(
        "surface = [", 'surface = [{ name = "left", reflectance = "grey:0.1" },'
    ),
    "empty-room.toml": _ROOM[: _ROOM.index("surface")] + "surface = []\n",
    "wrong-room.toml": _ROOM.replace("size_m", "sise_m").replace("lumen", "lux"),
    "bright-room.toml": _ROOM,
    "lamp-in-wall.toml": _ROOM.replace("white", "grey:0.9").replace("[2.0,", "[9.0,"),
    "unpainted-room.toml": _ROOM.replace('"floor"', '"flor"'),
    "large-room.toml": _ROOM.replace("[4.0, 5.0, 2.7]", "[4000, 5000, 2700]"),
    "misnamed-room.toml": _ROOM.replace('"walls"', '"wall"'),
    "spare-room.toml": _ROOM.replace(
        "surface = [", 'surface = [{ name = "lefft", reflectance = "black" },'
    ),
    "grey-room.toml": _ROOM.replace("grey:0.7", "grey:70"),
    "blind-room.toml": _ROOM.replace("white", "grey:0.9")
    + "[eye]\nposition_m = [34.0, 4.0, 1.6]\ntarget_m = [35.0, 4.0, 1.6]\n",
    "out-of-room.toml": _LIT_BY_ROOM.replace("[2.0,", "[2000.0,"),
    "too-large.toml": _LIT_BY_ROOM + "scale = 900.0\n",
    "room-basis.toml": _LIT_BY_ROOM + '[basis]\nmethod = "materials"\n',
    "room-key.toml": _LIT_BY_ROOM.replace("position_m", "position"),
    "room-lamp.toml": _LIT_BY_ROOM.replace('"room"', '"rom"'),
    "roomless.toml": SCENE.replace("D65", "room"),
    "comma.toml": SCENE.replace("= 0.4", "= 0,4"),
    "single.toml": SCENE.replace("[[material]]", "[material]"),
    "single-row.toml": SCENE.replace("[[material]]", "[material]", 1),
    "unquoted.toml": SCENE.replace('"copper"', "copper"),
    "watts.toml": _ROOM.replace("lumen", "watt"),
    "wrong.toml": _WRONG,
    "camera.toml": _WRONG.replace("[volume]", "[camera]"),
    "lost.toml": SCENE.replace('"white"', '"whit"').replace("D65", "D56").replace("ball", "bell"),
    "descending.toml": SCENE.replace("0.6", "0.05"),
    "broken.toml": "volume = [",
    "number.toml": "volume = 3\n",
    "surround.toml": SCENE + '[viewing]\nsurround = "dimm"\n',
    "no-lux.toml": SCENE + '[viewing]\nlevel = "absolute"\n',
    "lux.toml": SCENE + 'illuminance_lux = 9\n[viewing]\nlevel = "absolute"\n',
    "negative-lux.toml": SCENE + "illuminance_lux = -5.0\n",
    "dark.toml": SCENE + "illuminance_lux = 0.0\n",
    "nan.toml": SCENE + "weight = nan\n",
    "D.toml": SCENE + "[viewing]\nD = 3.0\n",
    "L_A.toml": SCENE + "[viewing]\nL_A = -1.0\n",
    "mode.toml": SCENE + '[viewing]\nmode = "x"\n',
    "gamut.toml": SCENE + '[viewing.display]\ngamut = "x"\n',
    "zoom.toml": SCENE + "[camera]\nzoom = 1e-300\n",
    "sweep.toml": SCENE + "[export]\nsweep = {}\n",
    "no-table.toml": SCENE + '[export]\nsweep = 12\n[[group]]\nname = "g"\nsources = ["x"]\n',
    "preset.toml": SCENE + "[viewing.display]\npreset = [1]\n",
    "keyframes.toml": SCENE
    + _KEY(0, "")
    + _KEY(1, "camera = { zoom = 1e-300 }")
    + _KEY(2.5, "viewing = { exposure = 1e9, D = 1 }")
    + _KEY(4, "viewing = { exposure = 1, Y_b = 1e9 }")
    + _KEY(6, f"transfer = {{ points = [{_OPAQUE}, {_OPAQUE}] }}"),
    "mixed-lux.toml": SCENE
    + _LIT
    + _KEY(0, "lights = { day = 1 }")
    + _KEY(1, "lights = { lit = 1 }")
    + "[export]\nfps = 2\n",
    "bright.toml": SCENE.replace('"D65"', '"D65"\nilluminance_lux = 9')
    + _LIT
    + '[viewing]\nlevel = "absolute"\n'
    + _KEY(0, "lights = { day = 1 }")
    + _KEY(1, "lights = { lit = 1e300 }"),
    "metals.toml": METALS_SCENE,
    "palette.toml": PALETTE,
    "must.toml": PALETTE.replace('"day"\ncolour = "steelblue"', _TWICE),
    "unlit.toml": PALETTE.replace('spectrum = "D65"', f"values = {[0.0] * 31}"),
    "atlas.csv": "nm,warm,cold\n400,0.4,0.8\n700,0.8,0.4\n",
    "bright.csv": "nm,warm,bright\n400,0.4,1\n700,0.8,1\n",
    "empty.csv": "",
    "empty.exr": "",
    "gone.toml": SCENE.replace("ball", "gone"),
    "names.csv": "a,b\n1,2\n",
    "letter.csv": "X,Y,Z\n1,2,x\n",
    "short.csv": "1,2\n",
    "mine-palette.toml": "# my own\n",
    "mine.toml": SCENE,
}
