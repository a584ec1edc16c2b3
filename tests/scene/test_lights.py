"""``[[group]]`` and ``[[light]]``: groups, and settings of several rows."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.scenes import BALL, SMALL, write_scene_text
from volspec.errors import SceneError
from volspec.pipeline import raycast
from volspec.raycast import Ambient, Directional, Headlight, LightGroup, Point, RaycastSpec
from volspec.scene import Scene, SceneFile
from volspec.settings import plain, read_table
from volspec.spectra import light
from volspec.spectra.library.lamps import lamp_illuminance_lux

KEY = '{ kind = "directional", towards = [0, -1, 1], shadows = true, intensity = 2 }'
GROUPS = f"""
[[group]]
name = "key"
sources = [{KEY}]
[[group]]
name = "fill"
sources = [
    {{ kind = "ambient", occlusion = true, radius_mm = 3, intensity = 0.5 }},
    {{ kind = "headlight", intensity = 0.25 }},
    {{ kind = "point", position_mm = [1, 2, -9], frame = "camera", falloff_mm = 20 }},
]
"""
LIT = (
    LightGroup("key", (Directional((0, -1, 1), shadows=True, intensity=2),)),
    LightGroup(
        "fill",
        (
            Ambient(0.5, occlusion=True, radius_mm=3),
            Headlight(0.25),
            Point((1, 2, -9), frame="camera", falloff_mm=20),
        ),
    ),
)


def row(name: str, spectrum: str = "D65", group: str = "", more: str = "") -> str:
    where = f'group = "{group}"\n' if group else ""
    return f'[[light]]\nname = "{name}"\nspectrum = "{spectrum}"\n{where}{more}\n'


def load(folder: Path, text: str) -> Scene:
    return Scene.load(write_scene_text(folder, BALL + SMALL + text))


def test_groups_are_what_their_tables_say(tmp_path):
    assert load(tmp_path, GROUPS + row("day")).raycast == RaycastSpec(groups=LIT)


@pytest.mark.slow
def test_groups_are_cast_into_the_picture_of_their_light(tmp_path):
    scene = load(tmp_path, GROUPS + row("day"))
    image, volume = scene.render(), scene.volume()
    twin = raycast(volume, scene.transfer, scene.camera(volume), (24, 16), RaycastSpec(groups=LIT))
    assert image.groups == twin.groups == RaycastSpec(groups=LIT).shares()
    assert np.array_equal(image.coefficients, twin.coefficients)


def test_without_groups_there_is_the_default_one(tmp_path):
    scene = load(tmp_path, row("day") + row("lamp", "A", "light"))
    assert scene.raycast == RaycastSpec()
    assert scene.lights[1].rig.groups == ("light",)


def test_rows_of_one_name_are_one_setting(tmp_path):
    dusk = row("evening", "D75", "fill", 'label = "dusk"\nweight = 2') + row("evening", "FL2")
    rows = row("evening", "A", "key", "weight = 0.5") + row("noon") + dusk
    scene = load(tmp_path, GROUPS + rows)
    evening, noon = scene.lights
    assert (evening.name, evening.label, noon.label) == ("evening", "dusk", "noon")
    assert [spectrum.name for spectrum in evening.rig.lights] == ["A", "D75", "FL2"]
    assert evening.rig.weights == (0.5, 2, 1) and evening.rig.groups == ("key", "fill", "")
    facing = evening.rig.facing(scene.raycast.shares()).mixed(scene.basis.grid)
    assert np.array_equal(evening.spectrum.values, facing.values)
    assert np.array_equal(noon.spectrum.values, light("D65").values)


LAMP = "lamp:tungsten-2850"


def test_a_lamp_s_lux_are_counted_from_watts_and_metres(tmp_path):
    more = "power_W = 100\ndistance_m = 1.5"
    rows = (
        row("bulb", LAMP, more=more),
        row("spot", LAMP, more=f"{more}\nbeam_deg = 40"),
        row("both", LAMP, "key", more),
        row("both", "D65", "fill", "illuminance_lux = 300"),
    )
    scene = load(tmp_path, GROUPS + "".join(rows))
    bulb = lamp_illuminance_lux("tungsten-2850", 100, 1.5)
    spot = lamp_illuminance_lux("tungsten-2850", 100, 1.5, 40)
    assert [light.rig.illuminance_lux for light in scene.lights] == [(bulb,), (spot,), (bulb, 300)]


def test_a_scene_keeps_the_watts_that_were_written(tmp_path):
    scene = load(tmp_path, row("bulb", LAMP, more="power_W = 60\ndistance_m = 2"))
    (kept,) = scene.file.light
    assert plain(kept) == {"name": "bulb", "spectrum": LAMP, "power_W": 60, "distance_m": 2}
    assert read_table(SceneFile, plain(scene.file), SceneError) == scene.file


def test_a_basis_is_chosen_by_the_lights_of_every_row(tmp_path):
    (tmp_path / "led.csv").write_text("# designed: yes\n380,1\n500,2\n780,1\n")
    rows = row("x", "A", "key") + row("x", "led.csv", "fill")
    rows += '[viewing]\nmode = "componentwise"\n'
    assert load(tmp_path, GROUPS + rows).basis_reason.startswith("led ")


def group(sources: str, name: str = "key") -> str:
    return f'[[group]]\nname = "{name}"\nsources = [{sources}]\n'


DAY = row("day")
DARK = '{ kind = "headlight", intensity = 0 }'
BULB = "power_W = 60\ndistance_m = 1"
WRONG = [
    (GROUPS + DAY + row("x", "A", "kye"), "unknown light[1].group"),
    (row("x", "A", "lihgt"), "unknown light[0].group"),
    (GROUPS + row("x", "A", "key") + row("x", "D65", "key"), "duplicate light[1].name"),
    (DAY + DAY, "duplicate light[1].name"),
    (GROUPS + row("x", "A", "key", "illuminance_lux = 5") + row("x"), "missing light"),
    (row("x", LAMP, more=f"illuminance_lux = 5\n{BULB}"), "conflict light[0].illuminance_lux"),
    (row("x", LAMP, more="power_W = 60"), "missing light[0].distance_m"),
    (row("x", LAMP, more="distance_m = 1"), "missing light[0].power_W"),
    (row("x", LAMP, more="beam_deg = 60"), "missing light[0].power_W"),
    (row("x", "D65", more=BULB), "unsupported light[0]"),
    (row("x", f"{LAMP}+A", more=BULB), "unsupported light[0]"),
    (row("x", "lamp:candle-1900", more=BULB), "missing light[0]"),
    (row("x", LAMP, more="power_W = 60\ndistance_m = 0"), "range light[0]"),
    (GROUPS + row("x", LAMP, "key", BULB) + row("x"), "missing light"),
    (GROUPS + row("x", "A", "key", "weight = 0"), "impossible light[0].weights"),
    (group(DARK, "off") + GROUPS + row("x", "A", "off"), "invalid light[0]"),
    (GROUPS + row("x", "D56"), "unknown light[0]"),
    (GROUPS + group(KEY) + DAY, "duplicate group[2].name"),
    (group(KEY, "a=b") + DAY, "syntax group[0].name"),
    (group(KEY, "") + DAY, "missing group[0].name"),
    (group("") + DAY, "missing group[0].sources"),
    ("".join(group(KEY, str(i)) for i in range(9)) + DAY, "size group"),
    (group(f"{KEY}, {{ intensity = 1 }}") + DAY, "unknown group[0].sources[1].kind"),
    *(
        (group(source) + DAY, f"{code} group[0].sources[0]{key}")
        for source, code, key in (
            ('{ kind = "lamp" }', "unknown", ".kind"),
            ('"ambient"', "unknown", ""),
            ('{ kind = "directional" }', "missing", ".towards"),
            ('{ kind = "directional", towards = [0, 0, 0] }', "range", ".towards"),
            # Keys that belong to other kinds.
            ('{ kind = "ambient", towards = true }', "unknown", ".towards"),
            ('{ kind = "headlight", shadows = true }', "unknown", ".shadows"),
            (
                '{ kind = "directional", towards = [0, 0, 1], occlusion = true }',
                *("unknown", ".occlusion"),
            ),
            (
                '{ kind = "point", position_mm = [0, 0, 1], occlusion = true }',
                *("unknown", ".occlusion"),
            ),
        )
    ),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[message for _, message in WRONG])
def test_mistakes_are_named_in_one_line(tmp_path, text, message):
    with raises(SceneError, *message.split(" ")) as caught:
        load(tmp_path, text)
    assert "scene.toml: " in str(caught.value)
