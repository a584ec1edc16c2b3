"""Interpolation of keyframes: smooth, level, never beyond the keys; cost in casts."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.export.conftest import METALS, Make
from tests.support.errors import raises, refuses
from tests.support.fixtures import slow
from volspec.camera import Camera
from volspec.errors import SceneError, ViewingError
from volspec.export import animation
from volspec.export.exporter import export
from volspec.export.plan import Plan, mix_lights, plan_export, sweep_weights
from volspec.pipeline import relight
from volspec.relight import LightRig
from volspec.relight.spec import mixed_rig
from volspec.scene import Scene, write_scene
from volspec.scene.tables.export import KeyCamera, Keyframe, KeyTransfer, KeyViewing
from volspec.spectra import light
from volspec.transfer import TransferFunction


def plan(scene: Scene, **changes: object) -> Plan:
    scene = scene.exporting(**changes)
    return plan_export(scene, scene.volume(), scene.file.export)


def test_numbers_never_leave_the_two_keys_they_lie_between():
    rng = np.random.default_rng(1)
    for _ in range(20):
        times, values = np.cumsum(rng.uniform(0.1, 2, 6)), rng.normal(size=6)
        at = np.linspace(times[0], times[-1], 500)
        found = animation.interpolate_keyframes(times, values, at)
        left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, 4)
        low, high = np.sort([values[left], values[left + 1]], axis=0)
        # 1e-12: rounding of a cubic of numbers near 1.
        assert np.all(found >= low - 1e-12) and np.all(found <= high + 1e-12)


def test_keys_are_met_and_stillness_kept_to_the_last_bit():
    times, values = [0.0, 0.1, 0.7, 1.0], [0.1, 0.3, 0.3, 7.7]
    for way in (animation.interpolate_keyframes, animation.interpolate_ratios):
        assert way(times, values, times).tolist() == values
        assert set(way(times, values, np.linspace(0.1, 0.7, 13)).tolist()) == {0.3}


def test_motion_has_no_kink_at_a_key():
    at = 1.0 + np.array([-2e-6, -1e-6, 0, 1e-6, 2e-6])
    speed = np.diff(animation.interpolate_keyframes([0, 1, 2, 3], [0, 1, 3, 4], at)) / 1e-6
    assert speed.max() - speed.min() < 1e-4  # a polygon's would jump by 1


def test_angles_go_the_short_way_round():
    met = animation.interpolate_angles([0, 1, 2], [350, 10, -170], [0, 1, 2])
    assert met.tolist() == [350, 370, 190]
    times = np.arange(5)
    turned = animation.interpolate_angles(times, [0, 170, 340, 150, 320], times)
    assert np.abs(np.diff(turned)).max() <= 180


K = "[[keyframe]]\ntime_s = {}\n{}\n".format
OF_DAY = '[export]\nfps = 10\nlights = ["day"]\n'
CAMERAS = (
    K(0, "camera = { azimuth_deg = 300, elevation_deg = 40, zoom = 1 }")
    + K(1, "camera = { azimuth_deg = 30, elevation_deg = 40, zoom = 4 }")
    + K(2, "camera = { azimuth_deg = 80, elevation_deg = 40 }")
    + OF_DAY
)


def test_an_orbit_keeps_its_height_its_way_round_and_its_last_zoom(scene):
    cameras = [shot.camera for shot in plan(scene(CAMERAS)).shots]
    assert len(cameras) == 21
    towards = np.array([np.subtract(each.position_mm, each.target_mm) for each in cameras])
    distances = np.linalg.norm(towards, axis=1)
    assert towards[:, 2] / distances == pytest.approx(np.sin(np.radians(40)), abs=1e-12)
    azimuth = np.unwrap(np.arctan2(towards[:, 0], -towards[:, 1]))
    assert np.all(np.diff(azimuth) > 0)
    assert np.degrees(azimuth[-1] - azimuth[0]) == pytest.approx(140)
    assert distances[0] / distances[10] == pytest.approx(4)
    assert distances[10:] == pytest.approx(distances[10])


def places(*each: object) -> str:
    """Keyframes of a camera at places, a second apart."""
    keys = (K(i, f"camera = {{ position_mm = {place} }}") for i, place in enumerate(each))
    return "".join(keys) + OF_DAY


def test_places_move_as_the_orbit_that_they_lie_on(scene):
    """Around the target at their distance; numbers of their own would lead through the ball."""
    turned = CAMERAS.replace("azimuth_deg = 80,", "azimuth_deg = 80, zoom = 4,")
    met = plan(scene(turned)).shots
    through = (list(met[i].camera.position_mm) for i in (0, 10, 20))
    shots = plan(scene(places(*through), "places.toml")).shots
    for placed, orbiting in zip(shots, met, strict=True):
        assert placed.camera.position_mm == pytest.approx(orbiting.camera.position_mm, abs=1e-9)
        assert placed.camera.frame()[1] == pytest.approx(orbiting.camera.frame()[1], abs=1e-9)


def test_a_camera_that_keeps_its_place_is_cast_once(scene):
    made = scene(places([0, -99, 50], [70, 0, 60], [70, 0, 60]))
    cameras = [shot.camera for shot in plan(made).shots]
    assert cameras[10].position_mm == pytest.approx((70, 0, 60), abs=1e-12)
    assert len(set(cameras[10:])) == 1 and len(set(cameras)) == 11


def test_a_camera_beside_its_target_flies_straight(scene):
    beside = (f"[{x}, -90, 8], target_mm = [{x}, 8, 8]" for x in (0, 50, 90))
    for shot in plan(scene(places(*beside))).shots:
        x, y, z = shot.camera.position_mm
        assert (x, y, z) == pytest.approx((shot.camera.target_mm[0], -90, 8), abs=1e-9)


def test_a_place_above_its_target_takes_its_azimuth_from_the_others(scene):
    key = "{}, target_mm = [8, 8, 8], up = [0, {}, {}]".format
    text = places(key([8, -92, 8], 0, 1), key([8, 8, 108], 1, 0), key([8, 8, 108], 1, 0))
    cameras = [shot.camera for shot in plan(scene(text)).shots]
    away = np.array([np.subtract(c.position_mm, c.target_mm) for c in cameras])
    assert np.linalg.norm(away, axis=1) == pytest.approx(100)
    assert away[:, 0] == pytest.approx(0, abs=1e-9) and np.all(np.diff(away[:11, 2]) > 0)
    assert cameras[10].up == (0, 1, 0)


def test_a_scene_with_a_place_is_moved_by_places_targets_and_angles(scene):
    camera = "[camera]\nposition_mm = [8, -92, 8]\ntarget_mm = [8, 8, 8]\n"
    look = "camera = {{ target_mm = [8, 8, {}], fov_deg = {} }}".format
    text = camera + K(0, look(8, 30)) + K(2, look(20, 50))
    middle = plan(scene(text), fps=1, lights=["day"]).shots[1].camera
    assert middle == Camera((8, -92, 8), (8, 8, 14), fov_deg=40)


def test_an_orbit_that_no_keyframe_uses_may_look_along_its_axis(scene):
    made = scene(places([0, -99, 50], [70, 0, 60], [70, 0, 60]))
    above = scene("[camera]\nelevation_deg = 90\n" + made.path.read_text().split("height = 24")[1])
    assert [s.camera for s in plan(above).shots] == [s.camera for s in plan(made).shots]


@pytest.mark.parametrize(
    ("table", "step_deg"),
    [({"frames": 8}, 45), ({"frames": 3, "degrees": -90}, -45)],
    ids=["whole", "part"],
)
def test_a_turntable_is_an_azimuth_in_even_steps(scene, table, step_deg):
    made = scene()
    volume = made.volume()
    shots = plan(made, turntable=table, lights=["day"]).shots
    assert len(shots) == table["frames"]
    for i, shot in enumerate(shots):
        orbit = Camera.orbit(volume, azimuth_deg=30 + step_deg * i, elevation_deg=20)
        assert shot.camera.position_mm == pytest.approx(orbit.position_mm, abs=1e-9)
        assert shot.camera.up == pytest.approx(orbit.up, abs=1e-12)
    assert shots[0].camera == made.camera(volume)


def test_a_cast_is_shared_by_all_lights_and_by_moments_that_are_alike(scene):
    assert len(plan(scene()).casts()) == 1
    turned = plan(scene(), turntable={"frames": 5})
    assert [len(shots) for shots in turned.casts()] == [3] * 5
    twice = plan(scene(), turntable={"frames": 8, "degrees": 720})
    assert [len(shots) for shots in twice.casts()] == [6] * 4
    assert len(plan(scene(), sweep={"frames": 9}).casts()) == 1


KEYS = (
    K(1, "transfer.shift = 0\nlights.day = 1\nviewing = { exposure = 0.25, L_A = 10, D = 0 }")
    + K(2, "lights.lamp = 1")
    + K(3, "transfer.shift = 0.2\nlights.lamp = 1\nviewing = { exposure = 4, L_A = 1000, D = 1 }")
    + "[export]\nfps = 2\n"
)


def test_keyframes_move_light_look_and_transfer_function(scene):
    made = scene(KEYS)
    shots = plan(made).shots
    # Into what will hold still it runs out slowly: half of the time is more than half the way.
    said = ["day", "day 0.312, lamp 0.688", "lamp", "lamp", "lamp"]
    assert [shot.light for shot in shots] == said
    assert shots[0].rig is made.lights[0].rig and shots[3].rig is made.lights[1].rig
    assert shots[1].rig.weights == pytest.approx((0.312, 0.688), abs=1e-3)
    middle = shots[2].spec.viewing
    assert (middle.exposure, middle.L_A, middle.D) == pytest.approx((1, 100, 0.5))
    assert shots[0].transfer is made.transfer
    moved = shots[4].transfer
    assert isinstance(moved, TransferFunction)
    assert [point[0] for point in moved.points] == pytest.approx([0.4, 0.8])
    assert len(plan(made).casts()) == 5


@pytest.mark.parametrize(
    ("last_s", "fps", "times"),
    [
        (1.2, 2, [0, 0.5, 1, 1.2]),
        (1.3, 2, [0, 0.5, 1, 1.3]),
        (0.1, 2, [0, 0.1]),
        (1.0, 3, [0, 1 / 3, 2 / 3, 1]),
    ],
)
def test_the_last_frame_is_the_last_keyframe_s(scene, last_s, fps, times):
    made = scene(K(0, "camera.azimuth_deg = 10") + K(last_s, "camera.azimuth_deg = 50"))
    assert animation.frame_times_s(made.file.keyframe, fps).tolist() == pytest.approx(times)
    orbit = Camera.orbit(made.volume(), azimuth_deg=50, elevation_deg=20)
    assert plan(made, fps=fps, lights=["day"]).shots[-1].camera == orbit
    assert len(animation.frame_times_s(scene(K(0, "") + K(2, "")).file.keyframe, 24)) == 49


def test_a_film_of_one_keyframe_is_one_frame(scene):
    made = scene(K(3, "viewing.exposure = 2"))
    (shot,) = plan(made, lights=["day"]).shots
    assert shot.spec.viewing.exposure == 2


def test_points_move_with_opacity_and_material(scene):
    points = 'transfer.points = [{}, {{ value = {}, opacity = {}, material = "{}" }}]'.format
    low = '{{ value = {}, opacity = 0.0, material = "grey" }}'.format
    text = K(0, points(low(0.2), 0.6, 0.2, "grey")) + K(1, points(low(0.4), 0.7, 0.6, "gold"))
    middle = plan(scene(text), fps=2, lights=["day"]).shots[1].transfer
    assert isinstance(middle, TransferFunction)
    (first, _, _), (second, opacity, mix) = middle.points
    assert (first, second, opacity) == pytest.approx((0.3, 0.65, 0.4))
    assert dict(mix) == pytest.approx({"gold": 0.5, "grey": 0.5})


def test_a_sweep_meets_every_light_and_gives_light_all_the_way():
    open_, closed = sweep_weights(3, 9), sweep_weights(3, 9, closed=True)
    assert np.all(open_.sum(axis=1) == 1) and np.all(closed.sum(axis=1) == 1)
    assert [row.argmax() for row in open_ if row.max() == 1] == [0, 1, 2]
    assert [row.argmax() for row in closed if row.max() == 1] == [0, 1, 2]
    assert closed[-1].argmax() in (0, 2) and closed[-1].max() < 1
    assert sweep_weights(2, 1).tolist() == [[1, 0]]


def test_a_turn_and_a_sweep_of_as_many_frames_go_together(scene):
    both = plan(scene(), turntable={"frames": 5}, sweep={"frames": 5})
    assert [shot.light for shot in both.shots[::2]] == ["day", "lamp", "tube"]
    assert len(both.casts()) == len(both.shots) == 5


def test_lux_count_where_all_that_shine_carry_them():
    day = LightRig((light("D65"), light("A")), (1, 0.5), (900, 100), ("key", "fill"))
    lamp, bare = LightRig((light("FL2"),), (2,), (50,)), LightRig((light("E"),))
    both = mixed_rig([day, bare, lamp], [0.5, 0.0, 1.0])
    assert (both.weights, both.illuminance_lux) == ((0.5, 0.25, 2), (900, 100, 50))
    assert both.groups == ("key", "fill", "")
    assert mixed_rig([day, bare], [0.5, 1.0]).illuminance_lux is None


PLACE, UP = "camera = { position_mm = [0, 0, 9] }", "camera = { up = [0, 0, 0] }"
SPECTRAL, COEFFICIENTS = 'format = "exr"\nspectral = true\n', 'format = "coefficients"\n'


@pytest.mark.parametrize(
    ("said", "more"),
    [
        ("missing export.lights", "[export]\nlights = []"),
        ("range export.turntable.degrees", "[export.turntable]\nframes = 9\ndegrees = nan"),
        ("range export.turntable.axis", "[export.turntable]\nframes = 9\naxis = [0, 0, 0]"),
        ("conflict export.sweep.frames", "[export]\nturntable.frames = 4\nsweep.frames = 3"),
        ("conflict export.shows", '[export]\nshows = "scene"'),
        ("conflict export.bits", '[export]\nformat = "exr"\nbits = 16'),
        ("conflict export.primaries", '[export]\nprimaries = "ACES AP0"'),
        ("conflict export.transparent", f"[export]\n{COEFFICIENTS}transparent = true"),
        ("conflict export.primaries", f'[export]\n{COEFFICIENTS}primaries = "ACES AP1"'),
        ("conflict export.sweep", f"[export]\n{COEFFICIENTS}sweep.frames = 3"),
        ("conflict export.spectral", "[export]\nspectral = true"),
        ("conflict export.spectral", f"[export]\n{SPECTRAL}transparent = true"),
        ("conflict export.primaries", f'[export]\n{SPECTRAL}primaries = "ACES AP0"'),
        ("range keyframe[0].time_s", K(-1, "")),
        ("range keyframe[1].time_s", K(1, "") + K(1, "")),
        ("range keyframe[0].lights", K(0, "lights = { day = 0 }")),
        ("unknown keyframe[0].lights", K(0, "lights = { dya = 1 }")),
        ("range keyframe[0].lights.day", K(0, "lights = { day = nan }")),
        ("conflict export.turntable", K(0, "") + "[export]\nturntable.frames = 3"),
        ("missing keyframe[1].lights", K(0, "lights = { day = 1 }") + K(9, "")),
        ("conflict export.lights", K(0, "lights = { day = 1 }") + '[export]\nlights = ["day"]'),
        ("range keyframe[0].camera.up", K(0, UP)),
        (
            "conflict keyframe[0].camera.position_mm",
            "[camera]\northographic = true\n" + K(0, PLACE),
        ),
        ("conflict keyframe[1].camera.zoom", K(0, PLACE) + K(1, "camera = { zoom = 2 }")),
        (
            "conflict keyframe[0].camera.azimuth_deg",
            "[camera]\nposition_mm = [0, 0, 9]\n" + K(1, "camera = { azimuth_deg = 2 }"),
        ),
        ("size keyframe", K(0, "") + K(1e9, "")),
        ("size keyframe", K(0, "") + K(1e308, "")),
    ],
)
def test_a_table_that_cannot_be_is_refused_by_name(scene, more, said):
    with raises(SceneError, *said.split(" ")):
        scene(more)


KEY = "[[keyframe]]\ntime_s = {}\ncamera = {{ {} = {}, target_mm = [8, 8, 8] }}\n".format
UPS = KEY(0, "up", [0, 1, 0.02]) + KEY(2, "up", [0, -1, 0.02])
MIXED = "lights = {{ lit = 1, day = {} }}".format
POINT = '{ value = 1, opacity = 0.1, material = "grey" },'
POINTS = "[[keyframe]]\ntime_s = 0\ntransfer = {{ points = [{}] }}".format
LUX = (
    '[viewing]\nlevel = "absolute"\n[[light]]\nname = "lit"\nspectrum = "E"\nilluminance_lux = 9\n'
)


def exposed(at_s: int) -> str:
    """Keyframes of which one is too bright: frames on the way are, too, but nobody wrote those."""
    return "".join(K(t, f"viewing.exposure = {1e9 if t == at_s else 1:g}") for t in (0, 2, 4))


@pytest.mark.parametrize(
    ("said", "more"),
    [
        ("shape transfer: points: 1 at 0 s", POINTS(POINT)),
        ("range transfer: at 0 s: ", POINTS(2 * POINT.replace("0.1", "1.5"))),
        ("impossible camera: position_mm at 2 s", KEY(2, "position_mm", [8, 8, 8])),
        ("impossible camera: up at 2 s", KEY(0, "up", [0, 0, 1]) + KEY(2, "up", [0, 0, -3])),
        ("conflict camera: at 1 s: ", f"[camera]\nposition_mm = [8, 8, 108]\n{UPS}"),
        (
            "conflict camera: at 2 s: ",
            KEY(0, "position_mm", [8, -92, 8]) + KEY(2, "position_mm", [8, 8, 108]),
        ),
        ("conflict viewing: at 0 s: D", "[viewing]\ndiscount = true\n" + K(0, "viewing.D = 0.5")),
        *((f"range viewing: at {at_s} s", exposed(at_s)) for at_s in (0, 2, 4)),
        ("missing", LUX),
        ("missing", LUX + K(0, MIXED(0)) + K(1, MIXED(0.5))),
        ("conflict", "[raycast]\nopacities = { gold = 0.5 }\n"),
    ],
)
def test_what_cannot_be_planned_is_refused_with_its_keyframe_s_time(scene, said, more):
    code, _, place = said.partition(" ")
    with raises(SceneError, code) as caught:
        plan(scene(more))
    assert (f"[[keyframe]] {place}" if place else "") in str(caught.value)
    # Another keyframe on the way helps between two alone.
    assert ("between" in caught.value.remedy) == ("at 1 s" in place or "up at" in place)


def test_at_absolute_level_lights_have_lux_or_are_relit_later(scene):
    made = scene(LUX)
    assert plan(made, lights=["lit"]).lights[0].name == "lit"
    assert plan(made, format="coefficients").shots, "they are relit at a level of their own"
    assert plan(scene(LUX + K(0, MIXED(0)) + K(1, MIXED(0)))).shots


def test_a_scene_with_an_export_is_written_back_as_it_was(scene):
    made = scene("# Why.\n[export]\nfps = 10 # slow\nsweep = { closed = true }\n")
    rows = (
        Keyframe(0, KeyCamera(azimuth_deg=1.5), viewing=KeyViewing(L_A=20)),
        Keyframe(2, KeyCamera(fov_deg=20), KeyTransfer(shift=-0.25)),
    )
    export = replace(made.file.export, fps=12.5, lights=("day", "lamp"))
    file, path = replace(made.file, keyframe=rows, export=export), made.path.with_name("new.toml")
    for source, kept in ((made, ("# Why.", "fps = 12.5 # slow")), (None, ())):
        write_scene(file, path, source)
        assert all(each in path.read_text() for each in kept)
        assert Scene.load(path).file == file


FADES = (
    "[raycast]\nlayers = {layers}\nopacities = {{ gold = 1.5 }}\n"
    + K(0, "opacities = {{ gold = 1.0 }}")
    + K(1, "opacities = {{ gold = 0.0{more} }}")
)


def fading(scene: Make, layers: int, more: str = "") -> Scene:
    """The scene in which a material fades; materials are its channels."""
    return scene(FADES.format(layers=layers, more=more), text=METALS)


@pytest.mark.parametrize(("layers", "casts"), [(8, 1), slow(0, 3)])
def test_a_material_fades_with_layers_from_one_cast(scene, tmp_path, layers, casts):
    made = fading(scene, layers).exporting(fps=2, lights=["lamp"])
    shots = plan(made).shots
    assert [shot.look.opacities["gold"] for shot in shots] == [1.0, 0.5, 0.0]
    done = export(made, tmp_path, sheet=False)
    assert (done.made, done.casts) == (3, casts)
    lamp = next(each.rig for each in made.lights if each.name == "lamp")
    for shot, file in zip(shots, done.files, strict=True):
        spec = replace(made.raycast, layers=0, opacities=dict(shot.look.opacities))
        exact = relight(made.render(spec=spec), lamp, made.relight, backend="numpy")
        found = np.asarray(Image.open(tmp_path / file))
        assert np.abs(found.astype(int) - exact.astype(int)).max() <= (4 if layers else 1)


def test_materials_that_are_not_there_and_lights_that_do_not_mix_are_refused(scene):
    with raises(SceneError, "unknown") as caught:
        plan(fading(scene, 0, ", silk = 1.0"))
    assert "silk" in str(caught.value) and "at 1 s" in str(caught.value)
    day, lamp, _ = scene().lights
    bright = replace(day, rig=replace(day.rig, illuminance_lux=(500.0,)))
    refuses(lambda: mixed_rig([day.rig], [0.0]), "missing LightRig.lights", ViewingError)
    refuses(lambda: mix_lights([bright, lamp], [0.5, 0.5]), "conflict", SceneError)
