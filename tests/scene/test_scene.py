"""Scene files: checked when loaded, errors name file, field and value."""

import json
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.scenes import SMALL, scene_text
from volspec import ClipPlane, RaycastSpec, Scene
from volspec.errors import CastCancelled, SceneError
from volspec.scene import stored_relight_spec
from volspec.settings import file_keys
from volspec.spectra import light
from volspec.volume import Volume, phantom

POINTS = [(0.1, 0.0, "shell"), (0.6, 0.4, "{ shell = 0.5, core = 0.5 }")]
GOOD = scene_text({"shell": "shell.csv", "core": "copper"}, POINTS) + SMALL


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "ball.npy", phantom.ball(12).values)
    (tmp_path / "shell.csv").write_text("nm,value\n390,0.2\n710,0.8\n")
    return tmp_path


def load(folder: Path, text: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text)
    return Scene.load(path)


def test_paths_are_relative_to_the_file(folder, monkeypatch):
    scene = load(folder, GOOD)
    monkeypatch.chdir("/")
    assert scene.volume().shape_xyz == (12, 12, 12)
    assert scene.materials["shell"].values[0] < 0.3


@pytest.mark.not_quick
def test_a_scene_always_loads_into_the_same_picture(folder):
    train = GOOD + '[basis]\ntrain = "scene"\nsize = 7\n'
    first, second = (load(folder, train).render() for _ in range(2))
    assert first.basis.name != "general-7" and first.basis.size == 7
    assert np.array_equal(first.coefficients, second.coefficients)
    assert first.basis.fingerprint == second.basis.fingerprint


@pytest.mark.parametrize(("given", "warned"), [(2.5, False), (2.5002, False), (2.501, True)])
def test_a_spacing_against_the_file_s_own_is_warned_about(folder, given, warned, recwarn):
    """Up to 1e-4 is what headers round away; a file without spacing has none to differ from."""
    raw = "ball.raw?shape=12x12x12&dtype=float32&spacing=1,1,2.5"
    phantom.ball(12).values.astype("<f4").tofile(folder / "ball.raw")
    scene = load(folder, GOOD.replace('"ball.npy"', f'"{raw}"\nspacing_mm = [1, 1, {given}]'))
    warnings.simplefilter("always")
    assert scene.volume().spacing_mm == pytest.approx((1, 1, given), rel=1e-12)
    said = [str(warning.message) for warning in recwarn]
    assert len(said) == warned
    for line in said:
        assert "spacing_mm" in line and "2.501" in line and "ball.raw" in line


def test_a_volume_is_down_sampled(folder):
    text = GOOD.replace('"ball.npy"', '"ball.npy"\ndownsample = 3\nspacing_mm = [1, 1, 2]')
    volume = load(folder, text).volume()
    assert volume.shape_xyz == (4, 4, 4) and volume.spacing_mm == (3, 3, 6)
    assert np.array_equal(volume.values, phantom.ball(12).downsampled(3).values)


def test_every_setting_of_a_cast_can_be_given(folder):
    """And has RaycastSpec's default; groups have tables of their own, tile_ms is the machine's."""
    table = set(file_keys(RaycastSpec))
    assert table == {field.name for field in fields(RaycastSpec)} - {"groups", "tile_ms"}
    asked = {
        "step_mm": 0.7, "ambient": 0.2, "diffuse": 0.6, "specular": 0.1, "shininess": 9,
        "alpha_stop": 0.9, "flat_gradient": 0.1, "mode": "average", "jitter": 0.5, "seed": 4,
        "preintegrated": False, "adaptive": 0.01, "crop_voxels": [[1, 9], [2, 8], [3, 7.5]],
        "clip_planes": [{"point_mm": [5, 5, 5], "normal": [1, 0, 2]}], "light_cells": 40,
        "half": True, "level": 2, "first_opacity": 0.3, "quality": "fast", "physical_light": True,
        "layers": 0, "opacities": {"block": 0.5}, "add_fields": True,
    }  # fmt: skip
    assert set(asked) == table
    rows = "\n".join(f"{key} = {_toml(value)}" for key, value in asked.items())
    asked["crop_voxels"] = ((1, 9), (2, 8), (3, 7.5))
    asked["clip_planes"] = (ClipPlane((5, 5, 5), (1, 0, 2)),)
    assert load(folder, GOOD + f"[raycast]\n{rows}\n").raycast == RaycastSpec(**asked)
    assert load(folder, GOOD + "[raycast]\npreintegrated = true\n").raycast.preintegrated
    assert load(folder, GOOD + "[raycast]\nlayers = 8\n").raycast.layers == 8


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


@pytest.mark.not_quick
def test_settings_reach_the_picture(folder):
    cut = "[raycast]\ncrop_voxels = [[0, 11], [0, 11], [0, 5]]\nhalf = true\n"
    whole, half = load(folder, GOOD).render(), load(folder, GOOD + cut).render()
    assert half.coefficients.dtype == np.float16
    assert 0.2 < (half.alpha > 0.1).sum() / (whole.alpha > 0.1).sum() < 0.9


@pytest.mark.not_quick
def test_a_cast_can_have_another_size_and_settings(folder):
    scene = load(folder, GOOD)
    image = scene.render(size=(10, 8), spec=replace(scene.raycast, half=True))
    assert image.size == (10, 8) and image.coefficients.dtype == np.float16


@pytest.mark.not_quick
def test_a_cast_can_be_cancelled(folder):
    with pytest.raises(CastCancelled):
        load(folder, GOOD).render(cancel=lambda: True)


def test_given_spacing_keeps_the_orientation():
    world = np.array([[0, -1, 0, 5], [2, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]], float)
    volume = Volume(np.zeros((2, 3, 4)), world_from_index=world).with_spacing((1, 1, 1))
    assert np.allclose(volume.world_from_index[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.allclose(volume.world_from_index[:3, 3], (5, 6, 7))


def test_files_beside_the_scene_win_over_those_where_the_program_runs(
    folder, monkeypatch, tmp_path_factory
):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "lamp.csv").write_text("nm,value\n390,1\n710,1\n")
    monkeypatch.chdir(elsewhere)
    mixed = GOOD.replace('"D65"', '"lamp.csv*0.5+A*0.5"')
    with raises(SceneError, "not-found", "light[0]"):
        load(folder, mixed)
    (folder / "lamp.csv").write_text("nm,value\n390,1\n710,3\n")
    values = load(folder, mixed).lights[0].spectrum.values
    assert values[-1] > 1.5 * values[0]


@pytest.mark.not_quick
def test_a_trained_basis_holds_under_lights_the_scene_does_not_have(folder):
    scene = load(folder, GOOD + '[basis]\ntrain = "scene"\n')
    lights = [light(name) for name in ("HP2", "LED-B1", "planck:2000", "FL11")]
    table = scene.basis.report(lights, list(scene.materials.values()))
    assert max(table.fitted.max, table.componentwise.max) < 0.5


@pytest.mark.not_quick
def test_viewing_and_lux_reach_the_picture(folder):
    text = GOOD.replace('spectrum = "D65"', 'spectrum = "D65"\nilluminance_lux = 50\nweight = 0.5')
    scene = load(folder, text + '[viewing]\nlevel = "absolute"\nilluminance_lux = 100\nY_b = 30\n')
    assert scene.lights[0].rig.total_lux == 25 and scene.relight.level == "absolute"
    assert scene.relight.viewing.Y_b == 30
    assert stored_relight_spec(scene.render()).viewing == scene.relight.viewing


def test_an_explicit_camera_is_taken(folder):
    text = GOOD + "[camera]\nposition_mm = [5, -40, 5]\ntarget_mm = [5, 5, 5]\nfov_deg = 20\n"
    camera = load(folder, text).camera(phantom.ball(12))
    assert camera.position_mm == (5, -40, 5) and camera.fov_deg == 20


CHANGES = [
    ("width = 24", "widht = 24", "unknown output.widht"),
    ("width = 24", 'width = "wide"', "type output.width"),
    ("width = 24", "width = 0", "range output.width"),
    ("[output]", "[otuput]", "unknown otuput"),
    ("[output]", "[rycast]\n[output]", "unknown rycast"),
    ("[transfer]", "[transfr]", "unknown transfr"),
    ('spectrum = "D65"', "", "missing light[0].spectrum"),
    ('"D65"', '"D56"', "unknown light[0]"),
    ('"D65"', '"D65"\nweight = -1', "range light[0].weight"),
    ('"copper"', '"cooper"', "unknown material[1].reflectance"),
    ('name = "shell"', 'name = " "', "missing material[0].name"),
    ('name = "core"', 'name = "shell"', "duplicate material[1].name"),
    ('material = "shell"', 'material = "shel"', "unknown transfer.points[0].material"),
    ("opacity = 0.4", "opacity = 1.4", "range transfer.points[1].opacity"),
    ("points = [", "points = []\nx = [", "unknown transfer.x"),
    ("[volume]\nfile", "volume", "type volume"),
    ("ball.npy", "bell.npy", "not-found volume"),
    *(
        ('"ball.npy"', f'"ball.npy"\n{row}', message)
        for row, message in (
            ("downsample = 12", "range volume"),  # no voxels are left
            ("downsample = 0", "range volume"),
            ("downsample = 1.5", "type volume.downsample"),
            ("spacing_mm = [1, 1]", "shape volume.spacing_mm"),
        )
    ),
    *(
        ("[output]", f"[raycast]\n{row}\n[output]", message)
        for row, message in (
            ("light_cell = 40", "unknown raycast.light_cell"),
            ("crop_voxels = [[9, 2], [0, 9], [0, 9]]", "range raycast.crop_voxels"),
            ("crop_voxels = [[90, 99], [0, 9], [0, 9]]", "range raycast.crop_voxels"),
            ("crop_voxels = [[2, 9]]", "shape raycast.crop_voxels"),
            ("clip_planes = [{ point_mm = [5, 5, 5] }]", "missing raycast.clip_planes[0].normal"),
            (
                "clip_planes = [{ point_mm = [5, 5, 5], normal = [0, 0, 0] }]",
                "range raycast.clip_planes[0].normal",
            ),
            ("step_mm = 1e-9", "range raycast.step_mm"),
        )
    ),
    *(
        ("[output]", f"{table}\n[output]", message)
        for table, message in (
            ("[camera]\nzoom = 2\nposition_mm = [0, 9, 0]", "conflict camera.position_mm"),
            ("[viewing]\nD = 0.5\ndiscount = true", "conflict viewing.D"),
            ('[viewing.display]\nspace = "gone.icc"', "not-found viewing.display.space"),
        )
    ),
    ("[volume]", "[volume", "syntax "),
    (GOOD, "", "missing volume"),
    (GOOD[GOOD.index("[[light]]") :], "", "missing light"),
]


@pytest.mark.not_quick
@pytest.mark.parametrize(("old", "new", "message"), CHANGES)
def test_mistakes_are_named_in_one_line(folder, old, new, message):
    assert old in GOOD
    with raises(SceneError, *message.split(" ")) as caught:
        load(folder, GOOD.replace(old, new)).render()
    assert "scene.toml: " in str(caught.value)


def test_a_byte_order_mark_is_read(folder):
    assert load(folder, "\ufeff" + GOOD).materials
