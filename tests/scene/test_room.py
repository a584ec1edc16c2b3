"""``[room]``: its light on a volume, its lamps' spectra, its walls behind, shadows, refusals."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.scenes import scene_text
from volspec.errors import SceneError
from volspec.pipeline import Raycaster
from volspec.raycast.surfaces import OpacityCaster, SurfaceCaster
from volspec.relight.illumination import Illumination
from volspec.room import load_room
from volspec.room.walls import Placement, ShadowMap
from volspec.scene import Scene
from volspec.scene.file import scene_data, scene_file
from volspec.scene.room import _digest
from volspec.scene.writing import rebase_scene

ROOM = """
title = "A room"
size_m = [3.0, 3.0, 2.5]
[[surface]]
name = "walls"
reflectance = "{walls}"
[[surface]]
name = "floor"
reflectance = "grey:0.5"
[[surface]]
name = "ceiling"
reflectance = "grey:0.8"
[[light]]
name = "lamp"
spectrum = "{lamp}"
on = "ceiling"
place_m = [1.2, 1.2, 0.6, 0.6]
lux = 5000
"""
SCENE = scene_text(
    {"white": "grey:1"},
    [(0, 0, "white"), (1, 1, "white")],
    file="block.npy",
    lights={"own": "room", "sodium": "HP1"},
    more="""[basis]
name = "general-7"
[camera]
azimuth_deg = 0
elevation_deg = 10
zoom = 0.3
[output]
width = 96
height = 64
[room]
file = "room.toml"
position_m = [1.5, 1.5, 0.5]
scale = 10
patches = 300
""",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("room")
    (folder / "room.toml").write_text(ROOM.format(walls="#f0d9b5", lamp="A"))
    (folder / "scene.toml").write_text(SCENE)
    block = np.zeros((40, 40, 40), np.float32)
    block[8:-8, 8:-8, 8:-8] = 1.0
    np.save(folder / "block.npy", block)
    return folder


@pytest.fixture(scope="module")
def scene(folder: Path) -> Scene:
    return Scene.load(folder / "scene.toml")


@pytest.fixture(scope="module")
def image(scene: Scene) -> vs.CoefficientImage:
    return scene.render()


@pytest.fixture(scope="module")
def opacity(scene: Scene) -> OpacityCaster:
    caster = Raycaster(scene.volume())
    return OpacityCaster(caster, caster.bake(scene.transfer), scene.raycast)


def edited(folder: Path, old: str, new: str) -> Path:
    assert old in SCENE
    path = folder / "edited.toml"
    path.write_text(SCENE.replace(old, new))
    return path


def in_room(folder: Path, more: str = "", walls: str = "#f0d9b5", lamp: str = "A") -> Scene:
    """Load the scene in another room."""
    (folder / "other.toml").write_text(ROOM.format(walls=walls, lamp=lamp) + more)
    return Scene.load(edited(folder, "room.toml", "other.toml"))


def frame(scene: Scene, image: vs.CoefficientImage, light: int = 0) -> np.ndarray:
    return vs.relight(image, scene.lights[light].rig, scene.relight)


@pytest.mark.not_quick
def test_the_groups_of_the_cast_are_the_room_s_light(scene, image):
    first, *directed, walls = scene.raycast.groups
    assert first.name == "ambient" and walls.name == "walls: lamp"
    assert "from lamp" in [group.name for group in directed]
    assert image.groups["walls: lamp"] == 0.0 and image.alpha.min() == 1.0


@pytest.mark.not_quick
def test_a_pickled_scene_has_its_room(scene, image):
    again = pickle.loads(pickle.dumps(scene)).render()
    assert np.array_equal(again.coefficients, image.coefficients)


@pytest.mark.not_quick
@pytest.mark.slow
def test_a_page_shows_a_room_under_other_lamps(folder, tmp_path):
    words = ("page", folder / "scene.toml", "--light", "A", "--size", "24x16")
    assert call(*words, "-o", tmp_path / "p.html") == 0
    assert "sodium" in (page := (tmp_path / "p.html").read_text()) and '"A"' in page


def test_a_white_that_gets_most_light_has_a_luminance_factor_of_100(scene):
    """The top of the block faces the lamp; its sides get less."""
    image = scene.with_camera(replace(scene.file.camera, elevation_deg=90.0, zoom=1.0)).render()
    lit = Illumination.of(image.basis, scene.lights[0].rig, scene.relight, image.groups)
    seen = lit.scene_XYZ(image.coefficients[32, 48], np.float32(1.0))
    assert seen[1] == pytest.approx(100.0, rel=0.1)


@pytest.mark.not_quick
def test_its_lamps_change_without_a_cast(folder, scene, image):
    """A sodium spectrum for the lamp: as in a room whose file has that lamp, within 3 codes."""
    swapped = frame(scene, image, light=1)
    other = in_room(folder, lamp="HP1")
    direct = frame(other, other.render())
    assert np.abs(swapped.astype(int) - direct).max() <= 3
    assert np.abs(swapped.astype(int) - frame(scene, image)).max() > 4


@pytest.mark.not_quick
def test_any_light_relights_the_picture_alone(scene, image):
    """Without the room, every group has the light's spectrum: as bright, less coloured."""
    alone = vs.relight(image, scene.lights[0].spectrum, scene.relight)
    assert alone.mean() == pytest.approx(frame(scene, image).mean(), rel=0.1)


@pytest.mark.not_quick
def test_a_light_that_does_not_reach_the_volume_is_refused(folder):
    """A sun below the floor: the walls' layer alone would have light."""
    sun = '[[light]]\nname = "sun"\nspectrum = "D65"\nlux = 9\n'
    low = "azimuth_deg = 0\nelevation_deg = -60\n"
    (folder / "sun.toml").write_text(ROOM.format(walls="#f0d9b5", lamp="A") + sun + low)
    path = edited(folder, "room.toml", "sun.toml")
    path.write_text(path.read_text() + 'group = "sun"\n')
    with raises(SceneError, "impossible"):
        Scene.load(path)


@pytest.mark.slow
@pytest.mark.not_quick
def test_paint_of_the_scene_replaces_that_of_the_room(folder, scene):
    path = edited(folder, "patches = 300", 'patches = 300\npaint = { walls = "#4060c0" }')
    blue, same = Scene.load(path), in_room(folder, walls="#4060c0")
    rooms = [each.room for each in (blue, same, scene)]
    light = [room.response.solved.irradiance.mean(axis=0) for room in rooms if room is not None]
    assert light[0] == pytest.approx(light[1], rel=1e-2)
    assert light[0] != pytest.approx(light[2], rel=0.05)
    # A cast is the same for all paints.
    assert blue.raycast == scene.raycast


@pytest.mark.not_quick
def test_viewing_conditions_are_those_of_an_eye_in_the_room(folder, scene):
    seen = scene.relight.viewing
    assert 1.0 < seen.Y_b < 100.0 and seen.Y_A is not None and 0.0 < seen.surround < 1.0
    assert seen.surround == pytest.approx(seen.Y_A / 100.0)
    # A dimmed lamp dims what the eye adapts to.
    rig = scene.lights[0].rig
    bright, dim = (seen.lit_by(lux).adapting_luminance for lux in (rig.total_lux, 1.0))
    assert rig.total_lux is not None and bright == pytest.approx(dim * rig.total_lux)
    turned = scene.with_camera(replace(scene.file.camera, azimuth_deg=90.0, elevation_deg=60.0))
    assert turned.relight.viewing.Y_b != seen.Y_b
    own = Scene.load(edited(folder, "[output]", '[viewing]\nY_b = 33\nsurround = "dim"\n[output]'))
    assert (own.relight.viewing.Y_b, own.relight.viewing.surround) == (33.0, "dim")


def test_turning_the_volume_turns_its_light():
    level = Placement.of((0, 0, 0), 1.0, 0.0, (0.0, 0.0, 1.0))
    assert level.axes == pytest.approx(np.eye(3))
    turned = Placement.of((0, 0, 0), 2.0, 90.0, (0.0, 0.0, 1.0))
    assert turned.axes @ (1.0, 0.0, 0.0) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert turned.metres_per_mm == 2e-3
    lying = Placement.of((0, 0, 0), 1.0, 0.0, (0.0, 1.0, 0.0))
    assert lying.axes @ (0.0, 1.0, 0.0) == pytest.approx((0.0, 0.0, 1.0))


@pytest.mark.not_quick
def test_an_opaque_volume_takes_the_lamp_from_the_floor_below_it(scene, opacity):
    """Below the middle only light from walls is left; far from it, the floor is as bright."""
    volume = scene.volume()
    (behind,) = scene.behind(volume)
    middle = volume.corners_mm.mean(axis=0)
    # From just below the block, down to the floor; and from next to it.
    below = vs.Camera(tuple(middle - (0, 0, 30)), tuple(middle - (0, 0, 40)), (0, 1, 0), 10.0)
    far = vs.Camera(tuple(middle + (120, 0, -30)), tuple(middle + (120, 0, -40)), (0, 1, 0), 10.0)

    def seen(
        camera: vs.Camera, behind: SurfaceCaster = behind, **shading: OpacityCaster
    ) -> np.ndarray:
        return behind.layers(camera, (8, 8), **shading).mean(axis=(0, 1))

    plain = seen(below), seen(far)
    shaded = seen(below, opacity=opacity)
    assert shaded.shape == (scene.basis.size,) and (shaded < 0.6 * plain[0]).all()
    assert seen(far, opacity=opacity) == pytest.approx(plain[1], rel=0.05)
    # Other paints keep the shadows.
    assert seen(below, behind.repainted(scene.room.response)) == pytest.approx(shaded)


@pytest.mark.slow
def test_furniture_in_front_hides_the_volume(folder):
    """A screen before the lower half of the block: rays end there."""
    screen = '[[surface]]\nname = "screen"\nreflectance = "grey:0.3"\n[[box]]\nname = "screen"\n'
    scene = in_room(folder, screen + "low_m = [0.5, 0.5, 0.01]\nhigh_m = [2.5, 0.6, 0.55]\n")
    scene = scene.with_camera(replace(scene.file.camera, elevation_deg=0.0))
    first = scene.render().first_mm
    assert first is not None
    assert np.isfinite(first[:31]).any() and not np.isfinite(first[40:]).any()
    volume = scene.volume()
    (behind,) = scene.behind(volume)
    camera = vs.Camera(tuple(volume.corners_mm.mean(axis=0)), (20.0, 100.0, 20.0))
    middle = behind.depths_mm(camera, (9, 9))[0][4, 4]
    assert middle == pytest.approx(150.0, rel=1e-3)  # 1.5 m to the back, at a scale of 10


@pytest.mark.slow
def test_edges_are_a_mean_of_points_in_their_pixels(scene):
    """Edges of walls in 16 × 12 pixels: nearer to means of a large picture than its pixels are."""
    (behind,) = scene.behind(scene.volume())
    camera = vs.Camera((20.0, 100.0, 45.0), (20.0, 60.0, 40.0), fov_deg=90.0)
    large = behind.layers(camera, (160, 120))
    coarse = behind.layers(camera, (16, 12))
    means = large.reshape(12, 10, 16, 10, -1).mean(axis=(1, 3))
    middles = large[5::10, 5::10]
    mean, middle = (np.abs(each - means).max() for each in (coarse, middles))
    assert mean < 0.6 * middle


@pytest.mark.not_quick
def test_what_is_between_the_lamp_and_the_volume_is_lit(scene, opacity):
    """A shadow map at points on the way to the light, and behind the volume."""
    middle = scene.volume().corners_mm.mean(axis=0)
    lamp = vs.Camera(tuple(middle + (0, 0, 200)), tuple(middle), (0, 1, 0), 30.0)
    found = ShadowMap.of(lamp, None, opacity).shadow(middle + np.array([[0, 0, 100], [0, 0, -50]]))
    assert found == pytest.approx([0.0, 1.0], abs=1e-3)


@pytest.mark.not_quick
def test_shadows_change_with_what_is_opaque(scene):
    caster = Raycaster(scene.volume())
    keys = set()
    for level in (0.2, 0.8):
        surfaces = vs.Isosurfaces(((level, 0.5, "white"),), scene.materials, scene.basis)
        keys.add(OpacityCaster(caster, caster.bake(surfaces), vs.RaycastSpec()).key)
    assert len(keys) == 2


def test_its_paths_follow_the_scene_to_another_folder(folder, tmp_path):
    path = edited(folder, "patches = 300", 'paint = { walls = "#4060c0", floor = "own.csv" }')
    moved = rebase_scene(scene_file(scene_data(path), path), folder, tmp_path / "scene.toml").room
    assert moved is not None
    assert (tmp_path / moved.file).resolve() == (folder / "room.toml").resolve()
    assert moved.paint["walls"] == "#4060c0"
    assert (tmp_path / moved.paint["floor"]).resolve() == (folder / "own.csv").resolve()


HEADLIGHT = '[[group]]\nname = "key"\nsources = [{ kind = "headlight" }]\n[room]'


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[room]", HEADLIGHT, "conflict"),
        ('spectrum = "HP1"', 'spectrum = "HP1"\ngroup = "lamb"', "unknown"),
        ('spectrum = "HP1"', 'spectrum = "HP1"\nilluminance_lux = 100', "conflict"),
        ("position_m = [1.5, 1.5, 0.5]", "position_m = [1.5, 1.5, 5]", "range"),
        ('file = "room.toml"', 'file = "rom.toml"', "not-found"),
        ("scale = 10", 'paint = { wall = "grey:0.5" }', "unknown"),
        ("scale = 10", 'paint = { walls = "puce" }', "unknown"),
        ("scale = 10", "scale = 0", "range"),
        ("[room]", "[raycast]\nambient = 0.1\n[room]", "conflict"),
        ("scale = 10", "scale = 60", "range"),  # the block is larger than the room
        ('name = "general-7"', 'method = "materials"', "conflict"),
    ],
)
def test_a_wrong_room_is_refused(folder, old, new, code):
    with raises(SceneError, code):
        Scene.load(edited(folder, old, new)).render()


def test_walls_may_be_left_out(folder):
    without = Scene.load(edited(folder, "scale = 10", "scale = 10\nwalls = false"))
    assert without.behind(without.volume()) == ()


SPOT = """IESNA:LM-63-2002
TILT=NONE
1 -1 1 3 1 1 2 0 0 0
1 1 20
0 90 180
0
{} 0 0
"""


def test_a_room_is_solved_again_for_another_beam(tmp_path):
    digests = set()
    for file, more in (("a", ""), ("b", ""), ("a", "aim = [-1, 0, 0]\n"), ("a", "turn_deg = 9\n")):
        (tmp_path / "a.ies").write_text(SPOT.format(100))
        (tmp_path / "b.ies").write_text(SPOT.format(100).replace("90 180", "80 180"))
        lamp = '[[light]]\nname = "spot"\nspectrum = "A"\nposition_m = [1, 1, 2]\nlumen = 900\n'
        text = ROOM.format(walls="grey:0.5", lamp="A") + f'{lamp}beam = "{file}.ies"\n{more}'
        (tmp_path / "room.toml").write_text(text)
        rooms = [load_room(tmp_path / "room.toml") for _ in range(2)]
        assert _digest(rooms[0]) == _digest(rooms[1])
        digests.add(_digest(rooms[0]))
    assert len(digests) == 4
