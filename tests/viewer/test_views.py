"""Views, handles over the picture, the orientation cube, the scale bar, annotations."""

import math
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.viewer import read_scene, run_command
from tests.viewer._states import of_volume
from volspec.camera.projection import Projection, cube_faces, cube_label, length_mm
from volspec.export.tiles import WindowCamera
from volspec.raycast import ClipPlane, framing
from volspec.raycast.framing import fit_view, shown_mm
from volspec.scene import Scene
from volspec.viewer.model import camera, cuts, measure, slices, transfer_edits
from volspec.viewer.model.commands import BY_KEY
from volspec.viewer.model.edit import with_interface
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import HALF, View, cube_middle, face_at
from volspec.viewer.ui.mouse import DRAGS, WHEELS
from volspec.volume import Volume

AREA = (40, 20, 800, 600)
VIEWS = (
    View(30.0, 20.0),
    View(30.0, 20.0, orthographic=True),
    View(-140.0, -35.0, zoom=1.7, fov_deg=70.0, roll_deg=35.0),
    View(200.0, 60.0, zoom=0.6, orthographic=True, up=(0.0, 1.0, 0.0), roll_deg=-120.0),
)


def oblique(shape: tuple[int, int, int] = (30, 40, 50)) -> Volume:
    """Anisotropic voxels on axes that lie along none of the world's."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    world = np.eye(4)
    world[:3, :3] = turn @ np.diag([0.7, 1.2, 2.5])
    world[:3, 3] = 12.0, -40.0, 900.0
    return Volume(np.random.default_rng(4).random(shape, dtype=np.float32), world_from_index=world)


@pytest.fixture
def tilted(state: ViewState) -> ViewState:
    """A state of an oblique volume."""
    return of_volume(state, oblique())


def seen_of(state: ViewState) -> Projection:
    return Projection(state.view.camera(state.document.volume), AREA)


def place(seen: Projection, point: NDArray[np.float64]) -> tuple[float, float]:
    x, y, _ = seen.to_window(point)
    return float(x), float(y)


@pytest.mark.parametrize("tile", [{}, {"whole": (3000, 2000), "corner": (900, 70)}])
@pytest.mark.parametrize("view", VIEWS)
def test_points_are_placed_where_the_raycaster_sees_them(state, view, tile):
    """A point on a pixel's ray is drawn at that pixel's middle, half a pixel from its corner.

    Also in a tile of a larger picture.
    """
    camera = view.camera(state.document.volume)
    if tile:
        camera = WindowCamera(*astuple(camera), shift=0.1, **tile)
    seen, rays = Projection(camera, AREA), camera.ray_field(800, 600)
    for x, y, depth in ((0, 0, 0.7), (399, 299, 1.3), (731, 120, 1.0)):
        offset = (x - rays.middle[0]) * rays.across + (y - rays.middle[1]) * rays.down
        spread = depth if rays.perspective else 1.0
        point = camera.position_mm + spread * offset + depth * rays.forward * rays.distance
        np.testing.assert_allclose(place(seen, point), (x + 40.5, y + 20.5), atol=1e-6)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("face", range(6))
def test_a_face_dragged_over_ten_voxels_moves_ten(tilted, view, face):
    """Also in perspective, where pixels are not alike along the way."""
    state = cuts.with_overlays(replace(tilted, view=view), crop=True)
    seen, volume = seen_of(state), state.document.volume
    handle = next(each for each in cuts.list_handles(state, seen, 1.0) if each.index == face)
    axis, far = divmod(face, 2)
    middle = (np.array(volume.shape_xyz) - 1) / 2
    middle[axis] = (volume.shape_xyz[axis] - 1) * far
    at = place(seen, framing.world_mm(volume, middle))
    np.testing.assert_allclose(at, handle.place, atol=1e-6)
    wanted = middle[axis] + (-10 if far else 10)
    middle[axis] = wanted
    at = place(seen, framing.world_mm(volume, middle))
    x, _ = cuts.drag_handle(state.shading, volume, handle, at, seen)
    moved = cuts.move_crop(state, face, x)
    assert framing.crop_bounds(moved.shading, volume)[axis][far] == pytest.approx(wanted, abs=0.5)
    assert abs(x - wanted) < 1e-6  # the half voxel is for hands; geometry is exact


@pytest.mark.parametrize("view", VIEWS)
def test_a_plane_follows_its_handles(tilted, view):
    state = run_command(replace(tilted, view=view), "plane-x").state
    seen, volume, plane = seen_of(state), state.document.volume, state.shading.clip_planes[0]
    handles = {handle.name: handle for handle in cuts.list_handles(state, seen, 1.0)}
    shift = handles.pop("plane-shift")
    (tilt,) = handles.values()
    there = np.asarray(plane.point_mm) + 5.0 * np.asarray(plane.normal)
    x, _ = cuts.drag_handle(state.shading, volume, shift, place(seen, there), seen)
    assert x == pytest.approx(5.0, abs=1e-6)

    def normal_after(to: tuple[float, float]) -> NDArray[np.float64]:
        x, y = cuts.drag_handle(state.shading, volume, tilt, to, seen)
        return np.asarray(cuts.tilt_plane(state, 0, x, y).shading.clip_planes[0].normal)

    # Where it is: nothing changes. Elsewhere: the axis is where the mouse is.
    np.testing.assert_allclose(normal_after(tilt.anchor), plane.normal, atol=1e-6)
    right, up, forward = seen.camera.frame()
    middle = place(seen, np.asarray(plane.point_mm))
    normal = normal_after((middle[0] + 0.6 * tilt.arm, middle[1] - 0.5 * tilt.arm))
    normal *= -math.copysign(1.0, float(normal @ forward))
    np.testing.assert_allclose([normal @ right, normal @ up], [0.6, 0.5], atol=1e-6)


def test_a_plane_that_faces_the_eye_goes_away_as_the_mouse_goes_up(state):
    for view in VIEWS:
        facing = run_command(replace(state, view=view), "p").state
        seen, volume = seen_of(facing), state.document.volume
        shift, tilt = cuts.list_handles(facing, seen, 1.0)
        assert math.dist(shift.place, tilt.place) > 20
        assert cuts.nearest_handle((shift, tilt), tilt.place, 1.0) is tilt
        to = shift.place[0], shift.place[1] - 30
        x, _ = cuts.drag_handle(facing.shading, volume, shift, to, seen)
        assert x == pytest.approx(30 * seen.mm_per_px, rel=1e-6)


def test_a_crop_leaves_a_voxel_and_a_whole_volume_is_no_crop(state):
    volume = state.document.volume  # 8 voxels along each axis
    cropped = cuts.move_crop(state, 0, 99.0)
    assert cropped.shading.crop_voxels == ((6.0, 7.0), (0.0, 7.0), (0.0, 7.0))
    cropped.shading.kept(volume)
    assert cuts.move_crop(cropped, 0, -99.0).shading == state.shading
    assert cuts.move_crop(cropped, 7, 3.0).shading is cropped.shading


def test_six_planes_are_the_most_none_twice_and_flipping_twice_is_nothing(state):
    once = run_command(state, "p").state
    # One that was moved away, or that cuts the other side, is another.
    for other in (cuts.shift_plane(once, 0, 1.0), cuts.flip_plane(once, 0)):
        assert run_command(other, "p").message == ""
    for azimuth in range(8):
        state = replace(state, view=View(azimuth_deg=10.0 * azimuth))
        state, message, _ = run_command(state, "p")
        assert bool(message) == (azimuth > 5)
    assert len(state.shading.clip_planes) == 6 and state.interface.overlays.plane == 5
    assert cuts.flip_plane(cuts.flip_plane(state, 2), 2).shading == state.shading
    assert len(cuts.remove_plane(state, 5).shading.clip_planes) == 5


def test_a_plane_cuts_a_hexagon_out_of_a_cube_across_its_diagonal():
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1)
    normal = np.ones(3) / math.sqrt(3)
    ring = cuts.outline_mm(np.full(3, 0.5), normal, corners)
    sides = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, [math.sqrt(0.5)] * 6)
    assert len(cuts.outline_mm(np.full(3, 5.0), normal, corners)) == 0


def test_lines_that_pass_the_camera_are_cut_there(document):
    camera = View().camera(document.volume)
    seen = Projection(camera, AREA)
    behind = 2 * np.asarray(camera.position_mm) - camera.target_mm
    ahead = np.asarray(camera.target_mm) + 1.0
    one, none = seen.segments(np.stack([ahead, behind]), np.stack([behind, 2 * behind - ahead]))
    assert none is None and one is not None
    assert one[0] == pytest.approx(place(seen, ahead)) and np.isfinite(one).all()


@pytest.mark.parametrize("view", VIEWS)
def test_the_scale_bar_is_as_long_as_it_says(state, view):
    """A line of its length in the plane through the target covers its pixels exactly."""
    seen = seen_of(replace(state, view=view))
    mm = length_mm(seen.mm_per_px, 130.0)
    right = seen.camera.frame()[0]
    target = np.asarray(seen.camera.target_mm)
    ends = [place(seen, target + share * mm * right) for share in (-0.5, 0.5)]
    assert math.dist(*ends) == pytest.approx(mm / seen.mm_per_px)
    assert 130 / 2.5 - 1 <= math.dist(*ends) <= 130
    assert float(f"{mm:.0e}"[0]) in (1, 2, 5)


def test_a_click_on_a_face_of_the_cube_looks_at_it(state):
    for up in ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0)):
        for view in (replace(each, up=up) for each in VIEWS):
            seen = seen_of(replace(state, view=view))
            shown = cube_faces(seen.camera)
            assert 1 <= len(shown) <= 3
            for face, corners, _ in shown:
                x, y = cube_middle(seen, 1.0) + HALF * corners.mean(axis=0)
                assert face_at(seen, (x, y), 1.0) == face
                there = seen_of(camera.look_at_face(replace(state, view=view), face))
                # Now it alone is seen, and whole.
                assert [each[0] for each in cube_faces(there.camera)] == [face]
    assert face_at(seen, (400.0, 300.0), 1.0) is None


def test_a_rolled_picture_turns_clockwise_and_follows_the_mouse(state):
    upright = replace(state, view=View(20.0, 10.0))
    rolled = camera.roll(upright, 90.0)
    (right, up, forward), turned = (seen_of(each).camera.frame() for each in (upright, rolled))
    # What was on top is at the right now.
    np.testing.assert_allclose(turned, [up, -right, forward], atol=1e-12)
    down, across = camera.orbit(rolled, 0.0, 0.1).view, camera.orbit(upright, 0.1, 0.0).view
    assert down.azimuth_deg == pytest.approx(across.azimuth_deg)
    assert down.elevation_deg == pytest.approx(across.elevation_deg)
    assert camera.roll(upright, 270.0).view.roll_deg == -90.0


def test_the_field_of_view_changes_and_the_volume_keeps_its_size(state):
    wide = camera.widen_notches(state, -5.0)
    assert wide.view.fov_deg > state.view.fov_deg
    one, other = (
        seen_of(each).camera.distance_mm * math.sin(math.radians(each.view.fov_deg) / 2)
        for each in (state, wide)
    )
    assert one == pytest.approx(other)
    assert camera.widen_notches(state, 1e6).view.fov_deg == 5.0


def test_everything_the_mouse_does_to_the_view_has_a_key(state):
    first = seen_of(state).camera.position_mm
    for pair in (("left", "right"), ("up", "down"), ("shift+left", "shift+right"), ("=", "-")):
        there, back = (BY_KEY[key].change for key in pair)
        assert there(state).view != state.view
        np.testing.assert_allclose(seen_of(back(there(state))).camera.position_mm, first, atol=1e-6)


def test_drags_go_by_button_and_keys_held():
    assert DRAGS["shift", "left"] == "roll" and WHEELS["ctrl"] is camera.widen_notches
    assert DRAGS["ctrl", "left"] is transfer_edits.window
    assert DRAGS["ctrl", "right"] is transfer_edits.thicken_by


BAD: dict[str, Callable[[], Volume]] = {
    "least": lambda: Volume(np.arange(8, dtype=np.uint8).reshape(2, 2, 2)),
    "flat": lambda: Volume(np.zeros((2, 64, 64), np.int16), spacing_mm=(1.0, 1.0, 40.0)),
    "constant": lambda: Volume(np.full((3, 4, 5), 7.0, np.float32)),
    "oblique": oblique,
}


@pytest.mark.parametrize("name", BAD)
def test_odd_volumes_have_handles_outlines_and_crops(state, name):
    volume = BAD[name]()
    state = of_volume(state, volume)
    for view in VIEWS:
        odd = replace(state, view=view)
        for edit, *given in (
            (cuts.move_crop, 1, 1.0),
            (cuts.shift_plane, 0, 1e6),
            (slices.move_slice, 0, 0.7),
        ):
            odd = edit(run_command(odd, "p").state, *given)
        odd.shading.kept(volume)
        seen = seen_of(odd)
        found = cuts.list_handles(cuts.with_overlays(odd, crop=True), seen, 1.0)
        assert np.isfinite([each.place for each in found]).all()
        assert len(cuts.box_edges(framing.crop_bounds(odd.shading, volume), volume, seen)) == 12


def test_a_scenes_plane_far_off_is_held_near_the_volume(document):
    at = cuts.anchor_mm(ClipPlane((1e5, 3.0, 3.0), (0.0, 0.0, 1.0)), document.volume)
    assert at[2] == pytest.approx(3.0)
    assert np.linalg.norm(at - document.volume.corners_mm.mean(axis=0)) < 10


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("aspect", (0.5, 1.0, 2.0))
def test_what_is_shown_is_fitted(tilted, view, aspect):
    """85 % of one side, centred on both; outermost points are those of a box, without rounding."""
    values = np.zeros((30, 40, 50), np.float32)
    values[3:9, 20:31, 30:42] = 1.0
    volume = replace(tilted.document.volume, values=values)
    found = fit_view(replace(view, roll_deg=0.0), volume, tilted.transfer, tilted.shading, aspect)
    assert (found.azimuth_deg, found.elevation_deg) == (view.azimuth_deg, view.elevation_deg)
    area = 0, 0, 1000 * aspect, 1000
    box = cuts.box_corners_mm(((29.5, 41.5), (19.5, 30.5), (2.5, 8.5)), volume).reshape(-1, 3)
    places = Projection(found.camera(volume), area).to_window(box)[:, :2]
    low, high = places.min(axis=0), places.max(axis=0)
    sides = (high - low) / np.array(area[2:])
    assert sides.max() == pytest.approx(0.85, abs=1e-3)
    np.testing.assert_allclose((low + high) / 2 / area[2:], 0.5, atol=0.01)


def test_where_nothing_is_shown_the_volume_is_fitted(state):
    volume, curve = state.document.volume, state.transfer
    clear = replace(curve, points=[(value, 0.0, mix) for value, _, mix in curve.points])
    np.testing.assert_array_equal(shown_mm([volume], clear, state.shading), volume.corners_mm)
    # What is cut away is not shown.
    cut = replace(state.shading, crop_voxels=((0.0, 3.0), (0.0, 7.0), (0.0, 7.0)))
    assert shown_mm([volume], curve, cut)[:, 0].max() <= 3.0


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_camera_becomes_the_orbit_there(document, orthographic):
    volume = document.volume
    for up in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)):
        view = View(40.0, 25.0, 1.7, 24.0, orthographic, target_mm=(3.0, 4.0, 2.0), up=up)
        given = view.camera(volume)
        again = View.of(given, volume).camera(volume)
        np.testing.assert_allclose(again.position_mm, given.position_mm, atol=1e-9)
        np.testing.assert_allclose(again.frame()[1], given.frame()[1], atol=1e-9)
        assert not orthographic or again.height_mm == pytest.approx(given.height_mm)


def test_a_point_follows_the_mouse_when_it_is_panned(state):
    """The target moves by as much of the picture's height as the mouse, the other way."""
    start = replace(state, view=View(zoom=1.3))
    before, panned = (seen_of(each).camera for each in (start, camera.pan(start, 0.1, 0.2)))
    right, up, _ = before.frame()
    height = 2 * before.distance_mm * math.tan(math.radians(before.fov_deg) / 2)
    step = np.subtract(panned.target_mm, before.target_mm) / height
    np.testing.assert_allclose([step @ right, step @ up], [-0.1, 0.2], atol=1e-9)


def test_front_right_and_top_look_along_the_axes(state):
    for side, towards in (("front", (0, 1, 0)), ("right", (-1, 0, 0)), ("top", (0, 0, -1))):
        there = seen_of(run_command(state, f"view-{side}").state).camera
        np.testing.assert_allclose(there.frame()[2], towards, atol=1e-9)


def test_sides_of_a_patient_are_named_as_on_the_cube(state):
    patient = cuts.with_overlays(state, patient=True)
    letters = {"left": "L", "right": "R", "front": "A", "back": "P", "top": "S", "bottom": "I"}
    # Without a patient, right is at +x.
    for given, side, name in (
        *((patient, *row) for row in letters.items()),
        (state, "right", "+x"),
    ):
        there = seen_of(run_command(given, f"view-{side}").state).camera
        nearest, _, _ = max(cube_faces(there), key=lambda face: face[2])
        assert cube_label(nearest, given is patient) == name, side
    assert [cube_label(face, True) for face in range(6)] == ["R", "L", "A", "P", "I", "S"]
    assert [cube_label(face, False) for face in (0, 1, 5)] == ["-x", "+x", "+z"]


POINTS = ((0.0, 0.0, 0.0), (3.0, 4.0, 0.0), (3.0, 8.0, 0.0))


def picked(state: ViewState, tool: str) -> ViewState:
    """The state after a tool has picked all of its points."""
    state = measure.start(measure.stop(state), tool)
    for point in POINTS[: measure.TOOLS[tool]]:
        state = measure.pick(state, point).state
    return state


@pytest.mark.parametrize(
    ("tool", "caption"), [("distance", "5 mm"), ("angle", "143.1°"), ("label", "label")]
)
def test_a_tool_annotates_and_stays_in_use(state, tool, caption):
    new = picked(state, tool)
    assert [each.caption for each in new.annotations] == [caption]
    assert new.interface.tool == tool and new.interface.tool_points == ()
    assert measure.hint(measure.stop(new)) == ""
    assert len(picked(new, tool).annotations) == 2
    # A session that was edited may have too many points.
    many = with_interface(new, tool_points=(POINTS[0],) * 3)
    assert measure.hint(many) and len(measure.pick(many, POINTS[1]).state.annotations) == 2


def test_texts_and_rows_are_edited(state):
    new = picked(picked(state, "label"), "distance")
    new = measure.rename(measure.rename(new, 0, "  aortic\nvalve ").state, 1, "width").state
    assert [each.caption for each in new.annotations] == ["aortic valve", "width 5 mm"]
    for refused in (" ", "x" * 81):  # a label has a text
        assert measure.rename(new, 0, refused)[:1] == (new,) and measure.rename(new, 0, refused)[1]
    assert measure.remove(new, 0).annotations == new.annotations[1:]
    assert measure.remove(new, 5) is new
    assert measure.remove_all(new).annotations == ()
    # Points without a tool are ignored.
    assert measure.pick(state, POINTS[0]).state is state
    assert measure.pick(measure.start(state, "ruler"), POINTS[0]).state.annotations == ()


@pytest.mark.slow
def test_points_of_the_picture_are_points_of_the_volume(window, tmp_path):
    values = np.zeros((40, 40, 40), np.float32)
    values[8:32, 8:32, 8:32] = 1.0
    np.save(tmp_path / "box.npy", values)
    window.open(tmp_path / "box.npy")
    window.command("preset surface")
    window.command("measure a distance")
    x, y, width, height = window.area("picture")
    places = [window.at("picture", 0.35, 0.45), window.at("picture", 0.65, 0.5)]
    window.click(*places)
    # A new label is typed at once; its letters are no commands.
    window.command("add a label")
    window.click(places[0])
    window.enter("a crust")
    window.keys("Escape")
    # The palette takes keys at once, before it is drawn: S saves no picture.
    window.do("key", "--delay", "0", "ctrl+p", "s")
    window.keys("Escape")
    # A double click on its caption in the picture edits the text.
    window.double_click("annotation 1", lambda: True)
    window.enter("the crust")
    before = window.keys("ctrl+s")
    window.key("Return")
    saved = window.event("export-scene", before)
    window.keys("ctrl+z")
    scene = Scene.load(saved["path"])
    found, label = scene.file.annotation
    assert label.text == "the crust"
    assert [path.suffix for path in tmp_path.iterdir()].count(".png") == 0
    assert 5 < (found.value or 0.0) < 24
    # The first hits lie on the box's surface, and appear where they were clicked.
    for point in found.points_mm:
        assert np.abs(np.abs(np.subtract(point, 19.5)).max() - 12.0) < 0.8
    projection = Projection(scene.camera(scene.volume()), (x, y, width, height))
    assert np.abs(projection.to_window(np.array(found.points_mm))[:, :2] - places).max() < 2.0
    assert read_scene(Path(saved["path"])).annotations == (found, label)
