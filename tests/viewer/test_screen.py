"""The picture on the screen: bands, tables of models, timings, the probe, the error map."""

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.errors import refuses
from tests.support.fixtures import Patch
from tests.support.patience import PATIENCE_S, wait_until
from tests.viewer._states import job_of, of_volume, seen, under
from volspec.appearance import lut3d
from volspec.camera import Camera
from volspec.errors import RelightError, ViewingError
from volspec.image import CoefficientImage
from volspec.pipeline import raycast
from volspec.raycast import Headlight, LightGroup
from volspec.relight import Illumination
from volspec.relight.difference_maps import error_map
from volspec.spectra import colour_matching_functions
from volspec.viewer.model import light_rows
from volspec.viewer.model.camera import orbit
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.window import Window
from volspec.viewer.work import probe
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.cast_job import CastDone, Pass
from volspec.viewer.work.casts import WHOLE
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.pictures import Relit
from volspec.viewer.work.screen import SLOW_MS, ErrorMapTexture, Meter, Screen, TableWorker
from volspec.volume import Volume

pytestmark = pytest.mark.not_quick

SIZE = (8, 6)
BANDS = 3
AREA = (0, 0, 200, 100)


@pytest.fixture
def screen(context: Any, state: ViewState, monkeypatch: Patch) -> Iterator[Screen]:
    """Without a window, with a picture of all colours in it."""
    monkeypatch.setattr(Window, "wake", lambda: None)
    shown = Screen(context, lambda: None, Meter(Trace()), Notice())
    shown.take(done(state, 0), state)
    with context:
        yield shown
    shown.close()


@pytest.fixture
def slow(screen: Screen, state: ViewState) -> Screen:
    """A screen that shows a picture; the next one is to be relit in bands."""
    for _ in range(2):
        screen.relight(under(state, 0), held=False)
    screen._meter.bands = BANDS
    return screen


def lit(screen: Screen, state: ViewState) -> NDArray[np.uint8]:
    """The whole picture of a state."""
    screen.mark_stale()
    while screen.relight(state, held=False):
        pass
    return pixels(screen)


def test_each_frame_draws_a_band(slow, state):
    day, lamp = lit(slow, under(state, 0)), lit(slow, under(state, 1))
    slow.mark_stale()
    rows = SIZE[1] // BANDS
    for band in range(1, BANDS + 1):
        assert slow.relight(under(state, 0), held=False)
        drawn = pixels(slow)
        np.testing.assert_array_equal(drawn[: band * rows], day[: band * rows])
        np.testing.assert_array_equal(drawn[band * rows :], lamp[band * rows :])
        assert slow.ready == (band == BANDS)
    assert not slow.relight(under(state, 0), held=False)


def test_each_second_of_changing_lights_is_drawn_whole(slow, state):
    wanted = [lit(slow, under(state, light)) for light in (0, 1)]
    for light in (0, 1, 0, 1):
        slow.mark_stale()
        slow.relight(under(state, light), held=False)
        assert slow.ready == (light == 1)
    np.testing.assert_array_equal(pixels(slow), wanted[1])
    # One that is left alone has its bands again.
    slow.mark_stale()
    slow.relight(under(state, 0), held=False)
    assert not slow.ready


def test_values_under_the_mouse_stay_while_bands_are_drawn(slow, state):
    slow.probe(under(state, 0), (0.5, 0.5), held=False)
    before, lamp = slow.under_mouse, under(state, 1)
    slow.mark_stale()
    for _ in range(BANDS):
        slow.relight(lamp, held=False)
        slow.probe(lamp, (0.5, 0.5), held=False)
        assert slow.under_mouse is before
    slow.relight(lamp, held=False)
    slow.probe(lamp, (0.5, 0.5), held=False)
    assert str(slow.under_mouse) != str(before)


def test_the_last_frame_shows_the_values_of_its_picture(slow, state):
    """A coarse picture rests under the mouse, the whole one comes in bands, then nothing more."""
    bright = done(state, 1)
    coarse = replace(bright.image, coefficients=0.5 * bright.image.coefficients)
    turned = orbit(state, 0.2, 0.1)
    for ended in (replace(bright, image=coarse, cast_pass=Pass(2)), bright):
        slow.take(ended, state)
        frames, news = [slow.under_mouse], True
        while news:  # as the window's loop: a frame, after which the next picture is drawn
            frames.append(slow.under_mouse)
            drawn = slow.relight(under(state, 0), held=False)
            news = slow.probe(under(state, 0), (0.5, 0.5), held=False) or drawn
        assert frames[-1] is slow.under_mouse is not None
        assert slow.refines(state) == (ended is not bright) and not slow.refines(turned)
        code = slow.pictures.code(SIZE[0] // 2, SIZE[1] // 2)
        assert dict(frames[-1].rows)["RGB"] == "  ".join(map(str, code))


def test_an_empty_picture_says_so_and_a_fault_its_reason(slow, state):
    lit(slow, state)
    cast, painted = done(state, 0), slow.painted_picture(AREA, state)
    assert slow.missing_message(state, painted) == ""
    blank = replace(cast.image, alpha=np.zeros_like(cast.image.alpha))
    for divisor, empty in ((2, False), (1, True)):  # coarse, its rays may miss something small
        slow.take(replace(cast, image=blank, cast_pass=Pass(divisor)), state)
        assert bool(slow.missing_message(state, painted)) == empty
    # Another document that cannot be cast has no picture.
    other = replace(cast.job, document=replace(cast.job.document, opening=object()))
    slow.take(CastDone(other, WHOLE, 0.0, error="no device; see volspec doctor"), state)
    assert slow.painted_picture(AREA, state) is None
    assert slow.missing_message(state, None) == slow.fault == "no device; see volspec doctor"
    slow.forget()
    assert slow.ready and not slow.relight(state, held=False) and not slow.pictures.framebuffer


def test_a_picture_keeps_its_shape_until_another_is_drawn(slow, state):
    cast = done(state, 1)
    wide = replace(state, size=AREA[2:])
    before = slow.painted_picture(AREA, wide)
    slow.take(replace(cast, job=replace(cast.job, size=wide.size)), wide)
    for _ in range(BANDS):
        assert slow.painted_picture(AREA, wide) == before
        slow.relight(under(wide, 0), held=False)
    width = AREA[3] * SIZE[0] / SIZE[1]
    assert before.to == pytest.approx(((AREA[2] - width) / 2, 0, (AREA[2] + width) / 2, AREA[3]))
    assert slow.painted_picture(AREA, wide).to == AREA


def done(state: ViewState, seed: int) -> CastDone:
    width, height = SIZE
    ones = np.ones((height, width), np.float32)
    rng = np.random.default_rng(seed)
    coefficients = rng.random((height, width, state.transfer.basis.size)).astype(np.float32)
    image = CoefficientImage(coefficients, ones, ones, state.transfer.basis)
    return CastDone(job_of(state, SIZE, WHOLE), WHOLE, 1.0, image)


def seen_by(state: ViewState, model: str, light: int) -> ViewState:
    return seen(under(state, light), model=model)


def pixels(screen: Screen) -> NDArray[np.uint8]:
    return screen.pictures.pixels().copy()


def test_lights_from_groups_being_cast_wait_for_them(screen, state):
    screen.relight(state, held=False)
    before = pixels(screen)
    rig = replace(state.lights[1].rig, groups=("lamp",))
    lamp = replace(state, lights=(light_rows.LightRow("A", "A", rig, 1.0),))
    groups = tuple(LightGroup(name, (Headlight(),)) for name in ("lamp", "sky"))
    for awaited in (
        replace(lamp, shading=replace(state.shading, groups=groups)),
        replace(state, other=lamp.lights, shading=replace(state.shading, groups=groups)),
    ):
        screen.mark_stale()
        assert not screen.relight(awaited, held=False)
        assert screen._notice.text == "" and not screen.ready
        assert np.array_equal(pixels(screen), before) and not screen.pictures.current
    # No cast will bring a group that the scene lacks.
    screen.relight(lamp, held=False)
    assert "lamp" in screen._notice.text


def test_the_picture_waits_for_the_newest_table(screen, state, monkeypatch):
    screen.relight(seen_by(state, "CIECAM02", 0), held=False)
    before = pixels(screen)
    made: list[lut3d.LutKey] = []
    work_out = lut3d._bake_texels
    monkeypatch.setattr(
        lut3d, "_bake_texels", lambda key, end: (made.append(key), work_out(key, end))[1]
    )
    rests = threading.Event()

    def wait_idle(worker: TableWorker, seconds: float) -> bool:
        """Wait for another light however long it takes: the test may be slower than a mouse."""
        while not worker._is_superseded() and not rests.wait(0.002):
            pass
        return not worker._is_superseded()

    monkeypatch.setattr(TableWorker, "_wait_idle", wait_idle)
    by_light = [seen_by(state, "Nayatani95", light) for light in range(3)]
    for light in (0, 1, 2, 1):
        screen.mark_stale()
        screen.relight(by_light[light], held=True)
        assert np.array_equal(pixels(screen), before)
        assert "Nayatani95" in screen._notice.text
        # Values under the mouse would be of another light than its pixel.
        screen.probe(by_light[light], (0.5, 0.5), held=False)
        assert screen.under_mouse is None
    # A cast that comes meanwhile waits for the light, too.
    screen.take(done(state, 1), state)
    screen.relight(by_light[1], held=False)
    assert np.array_equal(pixels(screen), before) and not screen.pictures.current
    rests.set()
    wait_until(screen.take_tables)
    screen.relight(by_light[1], held=False)
    after = pixels(screen)
    assert not np.array_equal(after, before) and screen.pictures.current
    # Of lights that went by none was worked out, and the notice has gone.
    assert len(made) == 1 and screen._notice.text == ""
    assert np.array_equal(lit(screen, by_light[1]), after) and len(made) == 1


def test_another_light_ends_a_table(screen, state, monkeypatch):
    begun: list[lut3d.LutKey] = []
    work_out = lut3d._bake_texels

    def without_end(key: lut3d.LutKey, cancel: Callable[[], bool]) -> NDArray[np.float32]:
        begun.append(key)
        wait_until(lambda: len(begun) == 2 or cancel())
        return work_out(key, cancel)

    monkeypatch.setattr(lut3d, "_bake_texels", without_end)
    screen.relight(seen_by(state, "Nayatani95", 0), held=False)
    wait_until(lambda: begun)
    screen.mark_stale()
    screen.relight(seen_by(state, "Nayatani95", 1), held=False)
    wait_until(screen.take_tables)
    assert len(begun) == 2
    assert begun[0] not in screen.pictures.tables and begun[1] in screen.pictures.tables


def test_both_sides_of_the_divide_have_own_tables(screen, state):
    sides = [seen_by(state, "Nayatani95", light) for light in (0, 1)]
    both = replace(sides[0], other=sides[1].lights, divide=0.5)
    screen.relight(both, held=False)
    wait_until(screen.take_tables)
    screen.relight(both, held=False)
    assert screen.pictures.current
    split = pixels(screen)
    for side, columns in zip(sides, (slice(0, 4), slice(4, 8)), strict=True):
        np.testing.assert_array_equal(lit(screen, side)[:, columns], split[:, columns])


def test_a_failed_table_is_made_once(screen, state, monkeypatch):
    def fails(key: lut3d.LutKey, cancel: object) -> None:
        raise ViewingError("no colour at\nsome node")

    monkeypatch.setattr(lut3d, "_bake_texels", fails)
    hunt = seen_by(state, "Hunt", 0)
    for step in (lambda: wait_until(screen.take_tables), lambda: None):
        screen.relight(hunt, held=False)
        step()
        assert screen._notice.text.split() == ["no", "colour", "at", "some", "node"]
    # Another model is drawn at once.
    screen.mark_stale()
    screen.relight(seen_by(state, "CAM16", 0), held=False)
    assert screen.pictures.current


def test_a_picture_relit_in_bands_is_one_relight_of_all_their_time(tmp_path):
    file = tmp_path / "trace.jsonl"
    with Trace(file) as trace:
        meter = Meter(trace)

        def frame(
            ms: float | None, first: bool = True, ends: bool = True, whole: bool = True
        ) -> None:
            query = cast(Any, SimpleNamespace(elapsed=1e6 * (ms or 0.0)))
            relit = None if ms is None else Relit(query, 0.0)
            meter.note_relight(relit, first=first, ends=ends, full=whole)
            meter.note_frame(0.0, {})

        assert meter.bands == 1
        frame(2.5 * SLOW_MS)
        # Each of three bands takes less than what is slow.
        assert meter.bands == 3
        for i in range(3):
            frame(5.0, first=i == 0, ends=i == 2)
        assert meter.bands == 1
        # Fewer pixels teach nothing of the whole; no light is nothing.
        frame(9 * SLOW_MS, whole=False)
        frame(None)
        assert meter.bands == 1
        # The times are of one document, and so is that of a relight that has not ended.
        meter.note_relight(Relit(cast(Any, SimpleNamespace(elapsed=1.0)), 0.0), True, True, True)
        meter.forget()
        frame(None)
        assert [*meter.ms] == ["frame"]
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    said = [(row["ms"], row["whole"]) for row in rows if row["event"] == "relight"]
    assert said == [(pytest.approx(45.0), True), (pytest.approx(15.0), True), (162.0, False)]


MIDDLE = (16, 16)


def shot(state: ViewState) -> tuple[Camera, CoefficientImage]:
    document = state.document
    camera = state.view.camera(document.volume)
    return camera, raycast(document.volume, document.transfer, camera, (33, 33))


def read_middle(state: ViewState, patient: bool = False) -> dict[str, str]:
    """Return what the probe says of the middle of the picture."""
    camera, image = shot(state)
    rig = light_rows.light_rig(state.lights)
    read = probe.read(
        image, camera, state.document.volume, rig, state.relight, MIDDLE, (1, 2, 3), patient
    )
    return dict(read.rows)


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_probe_finds_the_hit_of_a_ball(state, orthographic):
    """The middle of the picture is hit on the near side, on the camera's axis."""
    state = replace(state, view=replace(state.view, orthographic=orthographic))
    rows = read_middle(state)
    assert {"Value", "mm", "RGB", "XYZ", "J  C  h", "Q  M  s", "H", "Colour error"} == set(rows)
    assert rows["RGB"] == "1  2  3"
    assert read_middle(state, patient=True)["mm LPS"] == rows["mm"]
    camera, image = shot(state)
    centre = state.document.volume.corners_mm.mean(axis=0)
    away = np.subtract(camera.position_mm, centre)
    nearer = probe.place_mm(image, camera, MIDDLE) - centre
    assert 0 < nearer @ away / np.linalg.norm(away) < 4.0
    # 8-voxel ball: within a tenth of a voxel of the axis.
    off = nearer - (nearer @ away) / (away @ away) * away
    assert np.linalg.norm(off) < 0.1
    assert probe.place_mm(image, camera, (0, 0)) is None


def test_a_value_is_that_of_the_nearest_voxel(document):
    volume = document.volume
    at = (volume.world_from_index @ [3.3, 4.4, 2.1, 1.0])[:3]
    assert probe.value_at(volume, at) == volume.values[2, 4, 3]
    assert probe.value_at(volume, at + 100.0) is None


def test_values_are_those_of_all_fields_in_digits_by_which_voxels_differ(state):
    values, fine = state.document.volume.values, {"spacing_mm": (0.00025,) * 3}
    second = Volume(2 * values, **fine, name="GFP")
    rows = read_middle(of_volume(state, Volume(values, **fine, name="DAPI").with_fields([second])))
    assert float(rows["GFP"]) == pytest.approx(2 * float(rows["DAPI"]), rel=1e-4) != 0
    assert len(rows["mm"].split()[0].partition(".")[2]) == 4


def test_the_reflected_spectrum_has_the_colour_that_is_told(state):
    """Q times the spectrum is the exact picture's XYZ, as both synthesise the same channels."""
    _, image = shot(state)
    rig, exact = light_rows.light_rig(state.lights), replace(state.relight, mode="exact")
    light, reflected = probe.spectra(image, rig, exact, MIDDLE)
    Q = colour_matching_functions(image.basis.grid)
    XYZ = 100.0 * (Q @ reflected) / (Q[1] @ light)
    lit = Illumination.of(image.basis, rig, exact, image.groups)
    x, y = MIDDLE
    wanted = lit.scene_XYZ(image.coefficients[y, x], image.alpha[y, x])
    # Negative powers of the synthesis are not drawn: a few thousandths of the white.
    np.testing.assert_allclose(XYZ, wanted, atol=0.3)
    assert light.max() == pytest.approx(1.0)
    # Next to the ball only the backdrop reflects.
    light, reflected = probe.spectra(image, rig, exact, (0, 0))
    np.testing.assert_allclose(reflected, 0.2 * light)


def test_the_probe_has_the_error_maps_figure(state):
    _, image = shot(state)
    rig, seen = light_rows.light_rig(state.lights), state.relight
    whole = error_map(image, rig, seen.mode, seen.backdrop)
    assert f"{whole.delta_e[16, 16]:.2f}" in read_middle(state)["Colour error"]
    exact = replace(state, relight=replace(seen, mode="exact"))
    assert "0.00" in read_middle(exact)["Colour error"]


def test_an_error_map_is_of_its_own_picture_and_light(context, state):
    came = threading.Event()
    overlay = ErrorMapTexture(context, came.set)
    _, image = shot(state)
    overlay.want(image, state)
    assert not overlay.shows(image, state)
    assert came.wait(PATIENCE_S)
    assert overlay.take() and overlay.shows(image, state)
    for other, lights in ((replace(image), state.lights), (image, state.lights[1:])):
        assert not overlay.shows(other, replace(state, lights=lights))
    overlay.close()


def test_the_error_map_is_made_once(state, monkeypatch):
    _, image = shot(state)
    begun = []
    monkeypatch.setattr(Tasks, "start", lambda self, kind, task: begun.append(task))
    overlay: Any = ErrorMapTexture(None, lambda: None)
    for lights in (state.lights, state.lights, state.lights[1:], state.lights[1:]):
        overlay.want(image, replace(state, lights=lights))
    shining, dark = begun
    assert shining().delta_e.shape == (33, 33)
    refuses(dark, "missing", RelightError)
