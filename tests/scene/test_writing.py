"""Scenes written: they load into the same tables, and what somebody wrote stays."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.scenes import comments, lines, read
from volspec.errors import InputError, SceneError
from volspec.scene import Scene, write_scene
from volspec.scene.tables.specs import BasisSpec, CameraSpec, MaterialSpec, OutputSpec
from volspec.scene.tables.transfer import PointSpec
from volspec.spectra import Spectrum
from volspec.volume import phantom

ROOT = Path(__file__).resolve().parents[2]

TEXT = """# What begins the file.
title = "Ball"  # a caption
version = 2

[volume]
file = "ball.npy"

# The outer one.
[[material]]
name = "shell"  # thin
reflectance = "shell.csv"

# The inner one.
[[material]]
name = "core"
reflectance = "copper"

[transfer]
points = [
    # air
    { value = 0.1, opacity = 0.0, material = "shell" },  # nothing
    { value = 0.6, opacity = 0.4, material = { shell = 0.5, core = 0.5 } },
    { value = 0.9, opacity = 0.5, material = "core" },  # dense
]

[camera]
azimuth_deg = 30  # the default, but said
zoom=   1.5

# By day.
[[light]]
name = "day"
spectrum = "D65"

# By night.
[[light]]
name = "night"
spectrum = "A*0.5+lamp.csv*0.5"

[output]
width = 24
height = 16
# The last line.
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    np.save(folder / "ball.npy", phantom.ball(12).values)
    for name in ("shell", "lamp"):
        (folder / f"{name}.csv").write_text("nm,value\n390,0.2\n710,0.8\n")
    (folder / "scene.toml").write_text(TEXT, encoding="utf-8")
    return folder


@pytest.fixture
def scene(folder: Path) -> Scene:
    return Scene.load(folder / "scene.toml")


def written(scene: Scene, **update: object) -> Path:
    """Write a changed scene to a new file."""
    return write_scene(replace(scene.file, **update), scene.folder / "new.toml", scene)


def test_saving_where_it_was_read_changes_nothing(scene):
    before = scene.path.read_bytes()
    assert scene.save() == scene.path
    assert scene.path.read_bytes() == before


def test_one_changed_value_is_one_changed_line(scene):
    path = written(scene, camera=replace(scene.file.camera, zoom=2.5))
    old, new = lines(scene.path), lines(path)
    assert [pair for pair in zip(old, new, strict=True) if pair[0] != pair[1]] == [
        ("zoom=   1.5", "zoom=   2.5")
    ]


def test_a_table_whose_keys_said_their_defaults_stays_where_it_is(scene):
    text = scene.path.read_text().replace("[volume]", "# Few.\n[basis]\nsize = 7\n\n[volume]")
    scene.path.write_text(text)
    again = Scene.load(scene.path)
    path = write_scene(replace(again.file, basis=BasisSpec(method="materials")), scene.path, again)
    assert path.read_text() == text.replace("size = 7", 'method = "materials"')


def test_defaults_are_left_out_unless_the_file_says_them(scene):
    table = CameraSpec(azimuth_deg=30.0, elevation_deg=20.0, zoom=1.0, fov_deg=10.0)
    there = lines(written(scene, camera=table))
    assert "azimuth_deg = 30  # the default, but said" in there
    assert "zoom=   1" in there and "fov_deg = 10" in there
    assert not any(line.startswith("elevation_deg") for line in there)


def test_keys_that_exclude_each_other_take_turns(scene):
    placed = CameraSpec(position_mm=(0, -40, 5))
    path = written(scene, camera=placed)
    assert read(path).camera == placed
    based = replace(scene.file, basis=BasisSpec(name="general-5"))
    there = Scene.load(write_scene(based, path, scene))
    back = write_scene(replace(there.file, basis=BasisSpec(method="materials")), path, there)
    assert read(back).basis == BasisSpec(method="materials")
    assert comments(back.read_text()) == comments(TEXT)


def test_comments_go_with_the_rows_below_them(scene):
    """Rows swapped, one renamed, one added: each keeps the comment above it."""
    shell, core = scene.file.material
    hull = MaterialSpec(name="hull", reflectance="white")
    text = written(scene, material=[core, hull, shell]).read_text()
    core_at, hull_at, shell_at = (text.index(f'name = "{n}"') for n in ("core", "hull", "shell"))
    assert text.index("# The inner one.") < core_at < hull_at
    assert hull_at < text.index("# The outer one.") < shell_at < text.index("[transfer]")
    assert '\n\n[[material]]\nname = "hull"\n' in text


def test_a_row_that_goes_takes_its_comment_and_no_other(scene):
    path = written(scene, light=scene.file.light[1:])
    assert comments(path.read_text()) == [c for c in comments(TEXT) if c != "# By day."]
    assert [row.name for row in read(path).light] == ["night"]


def test_a_renamed_row_keeps_its_lines(scene):
    day, night = scene.file.light
    path = written(scene, light=[replace(day, name="noon"), night])
    assert path.read_text() == TEXT.replace('name = "day"', 'name = "noon"')


@pytest.mark.parametrize("count", [2, 3, 4])
def test_points_are_added_and_taken_away_line_by_line(scene, count):
    low, middle, high = scene.file.transfer.points or ()
    added = PointSpec(value=0.75, opacity=0.45, material="core")
    points = {2: [low, high], 3: [low, added, high], 4: [low, middle, added, high]}[count]
    table = replace(scene.file.transfer, points=points)
    path = written(scene, transfer=table)
    assert read(path).transfer == table
    there = lines(path)
    assert '    { value = 0.1, opacity = 0.0, material = "shell" },  # nothing' in there
    assert '    { value = 0.9, opacity = 0.5, material = "core" },  # dense' in there
    assert ('    { value = 0.75, opacity = 0.45, material = "core" },' in there) == (count > 2)


def test_new_tables_stand_apart_and_the_last_comment_stays_last(scene):
    eye = scene.file.viewing.viewing
    display = replace(eye.display, white_cd_m2=120.0, L_A=None)
    viewing = replace(scene.file.viewing, viewing=replace(eye, exposure=2.0, display=display))
    path = written(scene, viewing=viewing)
    end = "\n[viewing]\nexposure = 2\n\n[viewing.display]\nwhite_cd_m2 = 120\n"
    assert path.read_text() == TEXT + end


def test_a_new_title_stands_on_top_below_what_begins_the_file(folder):
    source = folder / "scene.toml"
    source.write_text(TEXT.replace('title = "Ball"  # a caption\n', ""))
    path = written(Scene.load(source), title="New")
    assert lines(path)[:3] == ["# What begins the file.", "version = 2", 'title = "New"']


@pytest.mark.parametrize(
    "layout",
    [
        TEXT.replace('[volume]\nfile = "ball.npy"\n', 'volume.file = "ball.npy"\n'),
        TEXT.replace('[volume]\nfile = "ball.npy"\n', 'volume = { file = "ball.npy" }\n'),
        TEXT + "[viewing]\nexposure = 1\n[basis]\nsize = 5\n[viewing.display]\nL_A = 9",
        TEXT + '[[light]]\nname = "dawn"\nspectrum = "D50"\n',
        TEXT.replace("\n", "\r\n"),
    ],
    ids=["dotted", "inline", "in pieces", "rows in pieces", "of another system"],
)
def test_any_layout_says_what_it_is_told(folder, layout):
    source = folder / "scene.toml"
    source.write_bytes(layout.encode())
    scene = Scene.load(source)
    volume = replace(scene.file.volume, spacing_mm=(1.0, 1.0, 2.0))
    eye = scene.file.viewing.viewing
    eye = replace(eye, exposure=3.0, display=replace(eye.display, L_A=12.0, mark=True))
    viewing = replace(scene.file.viewing, viewing=eye, mode="exact")
    given = {"volume": volume, "viewing": viewing, "output": OutputSpec(), "basis": BasisSpec()}
    file = replace(scene.file, **given)
    path = write_scene(file, folder / "new.toml", scene)
    assert read(path) == file
    if b"\r\n" in source.read_bytes():
        assert path.read_bytes().count(b"\r\n") == path.read_bytes().count(b"\n")


def test_every_name_of_a_file_leads_back_from_another_folder(folder):
    (folder / "paint.toml").write_text(
        '[[light]]\nname = "x+y"\nspectrum = "D65"\n[[reflectance]]\nname = "red"\n'
        'spectrum = "copper"\n[[cell]]\nat = ["red", "x+y"]\nblack = true\n'
    )
    phantom.ball(12).values.astype("<f4").tofile(folder / "ball.raw")
    shutil.copy(ROOT / "data" / "bases" / "general-5.json", folder / "own.json")
    text = TEXT.replace("ball.npy", "ball.raw?shape=12x12x12&dtype=float32&spacing=1,1,2")
    text = text.replace('"copper"', '"paint.toml#red"\nfilter = "lamp.csv"')
    text = text.replace('"D65"', '"paint.toml#x+y"')
    source = folder / "scene.toml"
    source.write_text(text + '[basis]\nname = "own.json"\n')
    scene = Scene.load(source)
    path = scene.save(folder.parent / "far" / "away" / "scene.toml")
    away = Scene.load(path)
    assert away.file != scene.file and away.volume().spacing_mm == (1, 1, 2)
    assert 'file = "../../here/ball.raw?shape=12x12x12' in path.read_text()
    assert 'spectrum = "A*0.5+../../here/lamp.csv*0.5"' in path.read_text()
    for one, other in zip(scene.lights, away.lights, strict=True):
        assert np.array_equal(one.spectrum.values, other.spectrum.values)
    assert away.basis.fingerprint == scene.basis.fingerprint
    here, there = (each.transfer.bake(1.0) for each in (scene, away))
    assert np.array_equal(here.channels, there.channels)
    assert np.array_equal(here.filters, there.filters)


def test_a_link_to_a_folder_is_no_detour(folder):
    """`..` of a folder behind a link is the parent of the folder itself."""
    inner = folder / "inner"
    inner.mkdir()
    text = TEXT.replace("ball.npy", "../ball.npy").replace("lamp", "../lamp")
    (inner / "scene.toml").write_text(text.replace("shell.csv", "../shell.csv"))
    link = folder.parent / "deep" / "link"
    link.parent.mkdir()
    link.symlink_to(inner)
    scene = Scene.load(link / "scene.toml")
    assert Scene.load(scene.save(folder.parent / "new.toml")).volume().shape_xyz == (12, 12, 12)


def test_what_is_no_file_yet_is_written_as_numbers(scene):
    grid = scene.basis.grid
    paint = Spectrum(grid.wavelengths_nm, np.linspace(0.1, 0.7, grid.size), "paint")
    shell, core = scene.file.material
    shell = replace(shell, reflectance="new.toml#paint")
    made = Scene(replace(scene.file, material=[shell, core]), scene.path, {"new.toml#paint": paint})
    again = Scene.load(made.save(scene.folder / "made.toml"))
    assert np.array_equal(again.materials["shell"].values, paint.values)


def test_a_scene_whose_file_is_gone_is_written_anew(scene):
    scene.path.unlink()
    path = scene.save()
    assert read(path) == scene.file and not comments(path.read_text())


def test_what_is_no_scene_is_not_written(scene):
    before = scene.path.read_bytes()
    both = replace(scene.file.camera, zoom=2.0, position_mm=(0.0, 9.0, 0.0))
    with raises(SceneError) as caught:
        write_scene(replace(scene.file, camera=both), scene.path, scene)
    assert "position_mm" in str(caught.value) and scene.path.read_bytes() == before
    with raises(SceneError):
        scene.save(scene.folder / "scene.txt")
    with raises(InputError, "unwritable"):
        scene.save(scene.path / "below.toml")
    lost = replace(scene.file.light[0], spectrum="D56*0.5+A")
    with raises(SceneError, "unknown"):
        write_scene(replace(scene.file, light=[lost]), scene.folder.parent / "x.toml", scene)
