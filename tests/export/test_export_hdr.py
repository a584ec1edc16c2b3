"""HDR pictures: luminances through the appearance model, PNG and AVIF, what is refused."""

import io
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.export.conftest import ffmpeg
from tests.export.test_export_png import chunks
from tests.support.browser import chromium, missing
from tests.support.commands import GENERAL
from tests.support.errors import raises
from tests.support.images import image, read_codes
from volspec.appearance import Display, Viewing
from volspec.appearance.display.hdr import Hdr
from volspec.appearance.display.spaces import SPACES, to_uint16
from volspec.appearance.spec import MODELS, PER_PIXEL
from volspec.errors import ImageError, SceneError, ViewingError
from volspec.export.avif import AvifWriter, YCbCr_codes
from volspec.export.exporter import export
from volspec.export.frames import encode, write_frame
from volspec.image import DepthEffects
from volspec.relight import LightRig, Relighter, RelightSpec, relight
from volspec.relight.hdr import hdr_frame, with_lux
from volspec.relight.look import Look
from volspec.relight.stereo import Stereo
from volspec.scene import Scene
from volspec.spectra import light, reflectance_set

LIT = LightRig((light("A"),), illuminance_lux=(500.0,))
ROOM = Display(L_A=40.0, surround="dim")


def steps(gain: tuple[float, ...] = (0.0, 0.2, 1.0, 2.5)) -> Any:
    """A white surface, and as bright as by highlights and a second lamp."""
    white = GENERAL.analyse(np.ones((1, GENERAL.grid.size)))[0]
    return image(np.array(gain)[None, :, None] * white, GENERAL)


def luminance(codes: np.ndarray, hdr: Hdr) -> np.ndarray:
    return hdr.luminances(codes) @ (SPACES["Rec. 2020"].XYZ_from_RGB[1] / 100.0)


@pytest.mark.parametrize("model", MODELS)
def test_white_is_at_its_luminance_and_highlights_are_above_it(model):
    hdr = Hdr()
    viewing = Viewing(model=model, D=1.0, display=ROOM)
    frame = hdr_frame(steps(), LIT, RelightSpec(viewing, mode="exact"), hdr)
    black, grey, white, bright = luminance(frame, hdr)[0]
    # An eye that is not wholly adapted to its display sees no neutral there; by ZCAM the white of A
    # has J = 101, by Hunt and Nayatani it depends on the level.
    near = {"CIECAM02": 0.005, "RLAB": 0.02, "ZCAM": 0.06, "Fairchild 1990": 0.08}
    near |= dict.fromkeys(("Hunt", "Nayatani95"), 0.2)
    assert white == pytest.approx(203.0, rel=near.get(model, 0.002))
    assert black < 1.0 < grey < 0.6 * white
    assert 1.4 * white < bright <= 1000.0


@pytest.mark.parametrize("adapting", ["given", "picture", "pixel"])
@pytest.mark.parametrize("model", PER_PIXEL)
def test_what_is_below_white_is_as_an_sdr_display_shows_it(model, adapting):
    """At any level; the eye is adapted to the light's lux in both."""
    chart = image(GENERAL.analyse(reflectance_set("test"))[:84].reshape(7, 12, -1), GENERAL)
    viewing = Viewing(model=model, display=ROOM, adapting=adapting, fov_deg=30.0, exposure=0.9)
    for spec in (RelightSpec(viewing), RelightSpec(viewing, level="absolute")):
        hdr = Hdr()
        found = hdr.luminances(hdr_frame(chart, LIT, spec, hdr)) / 203.0
        space = SPACES["Rec. 2020"]
        sdr = replace(spec, viewing=replace(viewing, display=replace(ROOM, space="Rec. 2020")))
        with Relighter(chart, "numpy") as relighter:
            shown = space.decode(relighter.frame(LIT, sdr, dtype=np.float32))
        below = (shown < 1.0).all(axis=-1)
        assert below.mean() > 0.95
        np.testing.assert_allclose(found[below], shown[below], rtol=2e-5, atol=1e-5)


def test_with_no_model_and_the_scene_s_own_white_luminances_are_the_scene_s():
    """500 lx on white are 159.2 cd/m²: shown as they are."""
    hdr = Hdr(white_cd_m2=500.0 / np.pi, peak_cd_m2=4000.0)
    spec = RelightSpec(Viewing(model="none", illuminance_lux=500.0), level="absolute")
    seen = luminance(relight(steps(), LIT, Look(spec, hdr=hdr), np.float32), hdr)[0]
    np.testing.assert_allclose(seen, 500.0 / np.pi * np.array([0, 0.2, 1.0, 2.5]), atol=0.05)
    # A second lamp as bright adds its light.
    both = LightRig((light("A"),), illuminance_lux=(1000.0,))
    twice = luminance(hdr_frame(steps(), both, spec, hdr), hdr)[0]
    np.testing.assert_allclose(twice, 2.0 * seen, rtol=1e-5, atol=1e-3)


def test_lux_of_a_mixture_of_groups():
    rig = LightRig((light("A"), light("D65")), (1.0, 0.5), groups=("key", "sky"))
    lit = with_lux(rig, 300.0, GENERAL.grid)
    assert lit.total_lux == pytest.approx(300.0)
    parts = zip(rig.weights, lit.lights, lit.illuminance_lux, strict=True)
    mixed = sum(
        weight * LightRig((each,), illuminance_lux=(lux,)).mixed(GENERAL.grid).values
        for weight, each, lux in parts
    )
    alike = mixed / rig.mixed(GENERAL.grid).values
    np.testing.assert_allclose(alike, alike[0], rtol=1e-9)


@pytest.mark.parametrize(("transfer", "curve"), [("PQ", 16), ("HLG", 18)])
def test_png_has_code_points_and_the_display_s_peak(tmp_path, transfer, curve):
    import SimpleITK

    codes = np.random.default_rng(1).integers(0, 65536, (9, 7, 3)).astype(np.uint16)
    path = tmp_path / "f.png"
    write_frame(path, codes, {"light": "A"}, Hdr(transfer))
    found = chunks(path.read_bytes())
    assert found[b"cICP"] == bytes([9, curve, 0, 1])
    numbers = struct.unpack(">8H2I", found[b"mDCV"])
    # Rec. 2020's primaries and D65 in steps of 0.00002; 1000 cd/m² in steps of 0.0001.
    assert numbers == (35400, 14600, 8500, 39850, 6550, 2300, 15635, 16450, 10_000_000, 0)
    # MaxCLL and MaxFALL, of all pixels' greatest.
    greatest = Hdr(transfer).luminances(codes / 65535.0).max(axis=-1)
    light = np.array(struct.unpack(">2I", found[b"cLLI"])) / 1e4
    assert light == pytest.approx([greatest.max(), greatest.mean()], abs=1e-4)
    names = list(found)
    assert names.index(b"cLLI") < names.index(b"IDAT")
    assert max(names.index(b"cICP"), names.index(b"mDCV")) < names.index(b"IDAT")
    assert not {b"sRGB", b"iCCP"} & set(found)
    assert np.array_equal(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path))), codes)


def decoded(path: Path, size: tuple[int, int], bits: int) -> np.ndarray:
    """(3, H, W) Y'CbCr of a file, by ffmpeg."""
    layout = ("-f", "rawvideo", "-pix_fmt", f"yuv444p{bits}le", "-")
    raw = ffmpeg("-loglevel", "error", "-i", path, *layout).stdout
    return np.frombuffer(raw, "<u2").reshape(3, size[1], size[0])


def ramp(width: int, height: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    return to_uint16(np.stack([x, y, 1.0 - 0.5 * x], axis=-1))


@pytest.mark.parametrize(("transfer", "bits", "curve"), [("PQ", 10, 16), ("HLG", 12, 18)])
def test_avif_has_its_bits_curve_and_codes(tmp_path, transfer, bits, curve):
    pytest.importorskip("imageio_ffmpeg")
    pixels, path = ramp(63, 41), tmp_path / "f.avif"
    path.write_bytes(encode(pixels, lambda file: AvifWriter(file, (63, 41), bits, Hdr(transfer))))
    data = path.read_bytes()
    assert data[4:12] == b"ftypavif"
    at = data.index(b"colrnclx") + 8
    # Primaries, curve and matrix of Rec. 2020, full range.
    assert struct.unpack(">HHHB", data[at : at + 7]) == (9, curve, 9, 0x80)
    at = data.index(b"pixi") + 8
    assert data[at : at + 4] == bytes([3, bits, bits, bits])
    greatest = Hdr(transfer).luminances(pixels / 65535.0).max(axis=-1)
    light = struct.unpack(">2H", data[data.index(b"clli") + 4 :][:4])
    assert light == pytest.approx([greatest.max(), greatest.mean()], abs=1.0)
    assert (
        f"MaxCLL={light[0]}, MaxFALL={light[1]}" in ffmpeg("-i", path, check=False).stderr.decode()
    )
    wanted = YCbCr_codes(pixels, bits)
    assert np.array_equal(decoded(path, (63, 41), bits), wanted), "lossless"
    with Image.open(path) as read:
        assert read.size == (63, 41)


def test_a_browser_shows_a_picture_without_highlights_as_its_sdr_frame(tmp_path):
    """On an SDR display: it does not dim what says that it is no brighter than white."""
    if why := missing():
        pytest.skip(why)
    codes = np.linspace(0.1, 1.0, 48)[:, None, None] * [1.0, 0.8, 0.6] * np.ones((1, 64, 1))
    space = SPACES["sRGB"]
    write_frame(tmp_path / "sdr.png", to_uint16(codes))
    names = ["sdr.png"]
    for curve in ("PQ", "HLG"):
        shown = to_uint16(Hdr(curve).codes(space.decode(codes) @ space.XYZ_from_RGB.T))
        for ending in ("png", "avif"):
            names.append(f"{curve}.{ending}")
            write_frame(tmp_path / names[-1], shown, space=Hdr(curve))
    style = "body { margin: 0 } img { display: block }"
    page = f"<style>{style}</style>" + "".join(f"<img src={name}>" for name in names)
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    with chromium() as browser:
        window = browser.new_page(viewport={"width": 64, "height": 48 * len(names)})
        window.goto((tmp_path / "page.html").as_uri())
        seen = np.asarray(Image.open(io.BytesIO(window.screenshot())).convert("RGB")).astype(int)
    sdr, *others = seen.reshape(len(names), 48, 64, 3)
    assert np.abs(sdr - codes * 255.0).max() <= 1.0
    assert max(np.abs(each - sdr).max() for each in others) <= 2


def test_write_frame_makes_avif_of_hdr_only(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    write_frame(tmp_path / "f.avif", ramp(16, 8), space=Hdr())
    assert (tmp_path / "f.avif").read_bytes()[4:12] == b"ftypavif"
    with raises(ImageError, "shape"):
        write_frame(tmp_path / "f.avif", np.zeros((8, 16, 3), np.uint8), space=Hdr())


def with_lights(scene: Any, export: str) -> Scene:
    """The ball under one light, with lux, before a bright backdrop."""
    lit = '[[light]]\nname = "sun"\nspectrum = "D65"\nilluminance_lux = 400\n'
    return scene(f'{lit}[export]\nlights = ["sun"]\n{export}\n')


def test_an_export_writes_hdr_frames_and_a_sheet(scene, tmp_path):
    made = export(with_lights(scene, "hdr = { peak_cd_m2 = 600 }"), tmp_path / "f")
    assert made.files == ("sun.png", "sheet.png")
    found = chunks((tmp_path / "f/sun.png").read_bytes())
    assert found[b"cICP"] == bytes([9, 16, 0, 1]) and found[b"IHDR"][8] == 16
    # The backdrop of 0.2 is the grey of an sRGB frame, not PQ's.
    assert export(with_lights(scene, ""), tmp_path / "g").files == made.files
    sheet, plain = (read_codes(tmp_path / name / "sheet.png").astype(int) for name in "fg")
    assert np.abs(sheet - plain).max() <= 6


def test_an_export_writes_avif_of_12_bits(scene, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    table = 'format = "avif"\nbits = 12\nhdr = { transfer = "HLG" }\nsheet = false'
    made = export(with_lights(scene, table), tmp_path / "f")
    assert made.files == ("sun.avif",)
    data = (tmp_path / "f/sun.avif").read_bytes()
    assert data[data.index(b"pixi") + 9] == 12
    again = export(with_lights(scene, table), tmp_path / "f")
    assert (again.frames, again.made) == (1, 0)


def shown_on(display: Display, rig: Any = LIT) -> object:
    return relight(steps(), rig, Look(RelightSpec(Viewing(display=display)), hdr=Hdr()))


@pytest.mark.parametrize(
    ("make", "kind", "field"),
    [
        (lambda *_: shown_on(ROOM, light("A")), ViewingError, "illuminance_lux"),
        (lambda *_: shown_on(Display(gamut="reduce")), ViewingError, "gamut"),
        (lambda *_: shown_on(Display(mark=True)), ViewingError, "mark"),
        (lambda *_: Look(hdr=Hdr(), stereo=Stereo()), ImageError, "hdr"),
        (lambda *_: Look(depth=DepthEffects(9.0), stereo=Stereo()), ImageError, "focus_mm"),
        (lambda path, _: write_frame(path, ramp(8, 8)), ImageError, None),
        (lambda path, _: write_frame(path, ramp(8, 8) > 0, space=Hdr()), ImageError, None),
        # The command's transcripts have the others.
        (lambda _, scene: with_lights(scene, f"{AVIF}transparent = true"), SceneError, None),
        (lambda _, scene: with_lights(scene, f"{AVIF}bits = 16"), SceneError, None),
        (lambda _, scene: with_lights(scene, 'hdr = {}\nannotate = ["scale"]'), SceneError, None),
    ],
)
def test_what_hdr_cannot_show_is_refused(make, kind, field, scene, tmp_path):
    with raises(kind, field=field):
        make(tmp_path / "g.avif", scene)
    assert list(tmp_path.iterdir()) == []


AVIF = 'format = "avif"\nhdr = {}\n'
