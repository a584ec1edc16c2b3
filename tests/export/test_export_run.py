"""Exported frames: pixels of relighting one cast, in any file and size; blank ones are reported."""

import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.commands import call, figures
from tests.support.errors import raises
from tests.support.fixtures import slow
from volspec._exr import read_exr
from volspec.appearance.display.spaces import SPACES
from volspec.errors import ImageError, InputError, VolspecWarning
from volspec.export import exporter, tiles
from volspec.export.exporter import export
from volspec.export.exr import PRIMARIES, white_adaptation
from volspec.export.frames import BlankFrames, read_frame_text
from volspec.pipeline import Relighter
from volspec.scene import Scene
from volspec.spectra import light, write_spectrum


def codes(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def linear(path: Path) -> np.ndarray:
    _, channels = read_exr(path, ImageError)
    return np.stack([channels[c] for c in "RGBA" if c in channels], axis=-1).astype(np.float64)


def relit(scene: Scene, light: int, **cast: object) -> np.ndarray:
    with Relighter(scene.render(**cast), lut3d=False) as relighter:
        return relighter.frame(scene.lights[light].rig, scene.relight.viewing)


def test_every_light_is_relit_from_one_cast(scene, tmp_path):
    made = scene()
    done = export(made, tmp_path / "out")
    assert (done.frames, done.made, done.casts) == (3, 3, 1)
    assert done.files == ("day.png", "lamp.png", "tube.png", "sheet.png")
    for i, name in enumerate(done.files[:3]):
        assert np.array_equal(codes(tmp_path / "out" / name), relit(made, i))
    text = read_frame_text(tmp_path / "out" / "lamp.png")
    assert text["Title"] == "Ball" and text["light"] == "lamp"
    assert {"camera", "transfer", "viewing", "relight", "raycast", "volume"} <= set(text)


def test_two_folders_give_the_same_bytes_without_their_paths(tmp_path, ball_folder):
    """Volume and light by absolute names, in PNG, OpenEXR, coefficients and the manifest."""
    for place in ("PATIENT", "other"):
        folder = tmp_path / place
        shutil.copytree(ball_folder, folder)
        write_spectrum(light("A"), folder / "lamp.csv")
        own = Scene.from_volume(folder / "ball.npy", lights=[str(folder / "lamp.csv")])
        assert [each.name for each in own.lights] == ["lamp.csv"]
        for kind in ("png", "exr", "coefficients"):
            export(own, tmp_path / f"{place}-{kind}", format=kind, size=(16, 12))
    made = [
        [path.read_bytes() for path in sorted(tmp_path.glob(f"{place}-*/*"))]
        for place in ("PATIENT", "other")
    ]
    assert made[0] == made[1] and len(made[0]) >= 6
    assert not any(str(tmp_path).encode() in each for each in made[0])


def test_a_turntable_has_a_folder_for_each_light(scene, tmp_path):
    made = scene()
    done = export(made, tmp_path, turntable={"frames": 2}, lights=["tube", "day"], sheet=False)
    assert done.files == ("tube/0000.png", "tube/0001.png", "day/0000.png", "day/0001.png")
    assert done.casts == 2
    assert np.array_equal(codes(tmp_path / "tube" / "0000.png"), relit(made, 2))


def test_windows_and_strips_make_the_picture_of_one_cast(scene, tmp_path, monkeypatch):
    settings = {"size": (200, 150), "bits": 16, "lights": ["lamp"]}
    export(scene(), tmp_path / "whole", **settings)
    monkeypatch.setattr(tiles, "CAST_BYTES", 4 * 7 * 64 * 100)
    export(scene(), tmp_path / "windows", **settings)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    export(scene(), tmp_path / "strips", **settings)
    canvas = tiles.Canvas((200, 150), 1, 7)
    assert [len(strip) for strip in canvas.strips()] == [2, 2]
    assert len(canvas.windows(canvas.strips()[0][0])) > 1
    whole, windows, strips = (tmp_path / f / "lamp.png" for f in ("whole", "windows", "strips"))
    assert windows.read_bytes() == whole.read_bytes()
    # Rows that came in parts are packed in parts: the same pixels in other bytes.
    assert np.array_equal(codes(strips), codes(whole))


@pytest.mark.parametrize(
    ("limit", "value"), [("CAST_BYTES", 4 * 7 * 64 * 100), ("STRIP_SIDE", 128)]
)
def test_an_empty_picture_is_told_however_it_is_cut(limit, value, scene, tmp_path, monkeypatch):
    made = scene("[camera]\ntarget_mm = [900, 0, 0]\n")
    monkeypatch.setattr(tiles, limit, value)
    with pytest.warns(VolspecWarning) as caught:
        export(made, tmp_path, size=(200, 150), lights=["lamp"], sheet=False)
    assert ["empty" in str(each.message) for each in caught] == [True]


def test_every_size_is_cut_into_windows_that_cover_it_once():
    for size, samples in (((1, 1), 1), ((20000, 9000), 3), ((65536, 10), 8), ((10, 65536), 2)):
        canvas = tiles.Canvas(size, samples, 8 * 16)
        strips = canvas.strips()
        parts = [part for strip in strips for part in strip]
        assert sum(part.width * part.height for part in parts) == size[0] * size[1]
        assert all(sum(part.width for part in strip) == size[0] for strip in strips)
        for part in parts:
            windows = canvas.windows(part)
            assert sum(w.width * w.height for w in windows) == part.width * part.height
            assert all(samples * max(w.width, w.height) <= 16384 for w in windows)


def test_more_rays_a_pixel_are_averaged_as_light_not_as_codes(scene, tmp_path):
    settings = {"lights": ["lamp"], "format": "exr", "shows": "scene"}
    for n in (1, 2):
        export(scene(), tmp_path / str(n), **settings, size=(64 // n, 48 // n), samples=n)
    fine, mixed = (linear(tmp_path / str(n) / "lamp.exr") for n in (1, 2))
    mean = fine.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3))
    # Half floats have 11 bits, both pictures are rounded to them.
    assert mixed == pytest.approx(mean, rel=2e-3, abs=1e-5)


def test_opacity_and_backdrop_put_together_are_the_opaque_picture(scene, tmp_path):
    made = scene("[viewing]\nbackdrop = 0.3\n")
    settings = {"format": "exr", "shows": "scene", "lights": ["day"], "size": (64, 48)}
    export(made, tmp_path / "opaque", **settings)
    export(made, tmp_path / "clear", **settings, transparent=True)
    opaque, clear = linear(tmp_path / "opaque" / "day.exr"), linear(tmp_path / "clear" / "day.exr")
    alpha = clear[..., 3:]
    assert alpha.min() == 0 and alpha.max() > 0.9
    # In 31 bands D65 is white to 3e-3.
    bare = opaque[alpha[..., 0] == 0]
    assert bare == pytest.approx(np.full_like(bare, 0.3), rel=3e-3)
    assert opaque == pytest.approx(clear[..., :3] + (1 - alpha) * bare[0], rel=3e-3, abs=1e-4)


def test_a_transparent_png_has_the_surfaces_own_colour(scene, tmp_path):
    export(scene(), tmp_path, lights=["day"], transparent=True, size=(64, 48))
    pixels = codes(tmp_path / "day.png")
    assert pixels.shape == (48, 64, 4) and (pixels[pixels[..., 3] == 0] == 0).all()
    edge = pixels[(pixels[..., 3] > 20) & (pixels[..., 3] < 120)]
    # Not darkened by what is not there: multiplied in, none of them would reach half of 180.
    assert len(edge) > 3 and edge[:, :3].min() > 90


def test_display_light_in_exr_is_the_codes_decoded(scene, tmp_path):
    made = scene()
    export(made, tmp_path / "exr", lights=["lamp"], format="exr")
    expected = SPACES["sRGB"].decode(relit(made, 1) / 255)
    # A code is half a step off, an eighth of its value in the dark.
    assert linear(tmp_path / "exr" / "lamp.exr") == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize("name", ["ACES AP0", "ACES AP1", "Rec. 709"])
def test_white_is_white_in_all_primaries(name, scene, tmp_path):
    to = PRIMARIES[name]
    for space in (SPACES["sRGB"], SPACES["DCI-P3"]):
        white = to.RGB_from_XYZ @ white_adaptation(space, to) @ space.white_XYZ
        assert white == pytest.approx([1, 1, 1], abs=1e-12)
    export(scene(), tmp_path, lights=["day"], format="exr", primaries=name, size=(8, 8))
    header, _ = read_exr(tmp_path / "day.exr", ImageError)
    chromaticities = [v for xy in (*to.primaries_xy, to.white_xy) for v in xy]
    assert header["chromaticities"] == pytest.approx(chromaticities, rel=1e-6)
    assert header["volspec:light"] == "day"


def test_rec_709_to_aces_is_the_published_matrix():
    """Bradford from D65 to ACES' white, as OpenColorIO's configs have it."""
    to, space = PRIMARIES["ACES AP0"], PRIMARIES["Rec. 709"]
    matrix = to.RGB_from_XYZ @ white_adaptation(space, to) @ space.XYZ_from_RGB
    published = [
        [0.43963298, 0.38298870, 0.17737832],
        [0.08977644, 0.81343943, 0.09678413],
        [0.01754117, 0.11154655, 0.87091228],
    ]
    assert matrix == pytest.approx(np.array(published), abs=2e-4)


@pytest.mark.parametrize(
    ("measured", "backdrop"), [slow('adapting = "picture"', 0.9), ('surround = "measured"', 0.0)]
)
def test_an_eye_adapts_to_the_whole_picture_in_parts_and_without_backdrop(
    scene, tmp_path, monkeypatch, measured, backdrop
):
    made = scene(f"[viewing]\n{measured}\nbackdrop = {backdrop}\n")
    settings = {"lights": ["lamp"], "size": (200, 150)}
    export(made, tmp_path / "whole", **settings)
    export(made, tmp_path / "clear", **settings, transparent=True)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    export(made, tmp_path / "strips", **settings)
    whole, strips, clear = (tmp_path / name / "lamp.png" for name in ("whole", "strips", "clear"))
    shown = codes(whole).astype(int)
    assert np.abs(codes(strips) - shown).max() <= 1
    seen = read_frame_text(strips)["viewing"]
    assert seen == read_frame_text(clear)["viewing"]
    assert "adapting='given'" in seen and "measured" not in seen
    other = scene(f"[viewing]\nbackdrop = {backdrop}\n")
    assert np.abs(relit(other, 1, size=(200, 150)) - shown).max() > 5, "it matters"


@pytest.mark.parametrize("lights", [3, slow(12)])  # columns of their own, and rows after each other
@pytest.mark.parametrize("size", [(1, 700), (1701, 1)])
def test_sheets_of_very_tall_and_very_wide_frames_stay_small(size, lights, scene, tmp_path):
    row = '[[light]]\nname = "{}"\nspectrum = "D65"\n'
    more = "".join(row.format(i) for i in range(lights - 3))
    export(scene(more), tmp_path, size=size)
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert max(sheet.size) < 4000


def test_many_frames_of_many_strips_are_made_in_batches(scene, tmp_path, monkeypatch):
    made, settings = scene(), {"size": (8, 160), "sheet": False}
    export(made, tmp_path / "whole", **settings)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    monkeypatch.setattr(exporter, "_OPEN_FILES", 2)
    done = export(made, tmp_path / "strips", **settings)
    assert (done.made, done.casts) == (3, 2)
    for name in done.files:
        assert np.array_equal(codes(tmp_path / "strips" / name), codes(tmp_path / "whole" / name))


@pytest.mark.parametrize(
    ("settings", "code", "field"),
    [
        ({"lights": ["dya"]}, "unknown", "export.lights[0]"),
        ({"turntable": {"frames": -1}}, "range", "export.turntable.frames"),
        ({"light": "day"}, "unknown", "export.light"),
        ({"size": (0, 4)}, "range", "size"),
        ({"size": (1 << 17, 4)}, "range", "size"),
        ({"format": "exr", "annotate": ["scale"]}, "conflict", "export.annotate"),
        ({"annotate": ["scal"]}, "unknown", None),
        ({"transparent": True}, "conflict", None),
    ],
)
def test_a_setting_that_is_none_is_refused_before_anything_is_made(
    scene, tmp_path, settings, code, field
):
    made = scene('[viewing]\nadapting = "pixel"\n' if "transparent" in settings else "")
    with raises(InputError, code, field):
        export(made, tmp_path / "out", **settings)
    assert not (tmp_path / "out").exists()


def test_the_command_makes_frames_and_tells_of_them(scene, tmp_path, capsys):
    out = tmp_path / "out"
    words = ("export", scene().path, "-o", out, "--size", "16x12", "--turntable", 2, "-l", "day")
    made = figures(capsys, *words)
    assert (made["frames"], made["made"], made["casts"]) == (2, 2, 2)
    assert all((out / name).is_file() for name in made["files"])
    assert call(*words) == 0
    printed = capsys.readouterr().out.rpartition(":")[2]
    assert re.findall(r"\b\d+\b", printed) == ["2", "0", "0", "2"]
    assert call(*words[:-2]) == 0
    assert "--light all makes a turn under each of 3" in capsys.readouterr().out


def test_a_turntable_is_one_turn_unless_more_lights_are_asked_for(scene, tmp_path, capsys):
    def files(name: str, *more: object, scene_text: str = "") -> list[str]:
        path = scene(scene_text).path
        words = (path, "-o", tmp_path / name, "--size", "8x6", "--turntable", 2, *more)
        made = figures(capsys, "export", *words)["files"]
        return sorted({name.partition("/")[0] for name in made} - {"sheet.png"})

    assert files("first") == ["day"]
    assert files("all", "--light", "all") == ["day", "lamp", "tube"]
    assert files("two", "--light", "lamp", "--light", "day") == ["day", "lamp"]
    # A scene's own lights and its sweep keep their meaning.
    own = '[export]\nlights = ["lamp", "tube"]'
    assert files("own", scene_text=own) == ["lamp", "tube"]
    assert files("every", "--light", "all", scene_text=own) == ["day", "lamp", "tube"]
    assert files("sweep", scene_text="[export.sweep]\n") == ["0000.png", "0001.png"]


LUX = """
[viewing]
level = "absolute"
[[light]]
name = "lit"
spectrum = "E"
illuminance_lux = {}
"""


@pytest.mark.parametrize(
    "settings", [{}, slow({"bits": 16}), slow({"transparent": True}), {"format": "exr"}]
)
def test_absurd_lux_are_told_whatever_the_file(settings, scene, tmp_path):
    for lux, problem in ((1e-9, "black"), (1e12, "clipped")):
        with pytest.warns(VolspecWarning) as caught:
            export(
                scene(LUX.format(lux)),
                tmp_path / problem,
                lights=["lit"],
                sheet=False,
                size=(8, 6),
                **settings,
            )
        assert problem in str(caught[0].message)


def test_a_bright_picture_is_not_told(scene, tmp_path):
    """Warnings are errors here; at 3000 lx, three times the viewing's, highlights are clipped."""
    export(scene(LUX.format(3000)), tmp_path, lights=["lit"], sheet=False)


def test_many_frames_and_their_strips_are_one_warning(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(tiles, "STRIP_SIDE", 64)
    made = scene(LUX.format(1e-9))
    with pytest.warns(VolspecWarning) as caught:
        export(made, tmp_path, lights=["lit"], turntable={"frames": 3}, size=(90, 80), sheet=False)
    (only,) = caught
    assert {"lit/0000.png", "black", "2"} <= set(str(only.message).split())


def messages(pixels: np.ndarray, alpha: np.ndarray) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        blanks = BlankFrames("exposure")
        blanks.add("f", "A", pixels, alpha.astype(np.float32))
        blanks.warn()
    return [str(each.message) for each in caught]


def test_of_what_is_covered_all_but_a_thousandth_must_be_blank():
    frame, opaque = np.zeros((100, 100, 3), np.uint8), np.ones((100, 100))
    frame.reshape(-1, 3)[:10] = 9
    assert ["black" in message for message in messages(frame, opaque)] == [True]
    frame.reshape(-1, 3)[10] = 9
    assert messages(frame, opaque) == []
    frame[:50] = 77
    below = opaque * (np.arange(100) >= 50)[:, None]
    assert len(messages(frame, below)) == 1, "backdrop counts not"
    assert messages(frame, 0 * opaque) == [], "an empty picture is reported by its cast"


def test_a_saturated_colour_is_clipped_where_no_channel_has_a_shade_left():
    opaque = np.ones((4, 4))
    assert "clipped" in messages(np.full((4, 4, 3), (255, 255, 0), np.uint8), opaque)[0]
    assert messages(np.full((4, 4, 3), (255, 200, 0), np.uint8), opaque) == []
    half = np.full((4, 4, 4), 0.5, np.float32)
    assert "clipped" in messages(half, opaque / 2)[0], "white times its opacity"
    assert messages(half, opaque) == []
