"""Films, pages and time steps: the frames of the preview, by the exporters of the commands."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.support.errors import raises
from tests.support.images import read_codes
from tests.support.patience import wait_until
from tests.support.viewer import opened, run_command, take_until
from tests.viewer._states import frame_of
from volspec.errors import CastCancelled, ViewingError, VolumeError
from volspec.export.exporter import export
from volspec.pipeline import Raycaster
from volspec.scene import Scene
from volspec.scene.tables.export import MARKS, ExportSpec
from volspec.viewer.model import depth, light_rows, light_states, opacities
from volspec.viewer.model.document import Document
from volspec.viewer.model.film import (
    LIGHTS,
    SIDES,
    STATES,
    Film,
    film_steps,
    frame_state,
    light_changes,
    with_frames,
)
from volspec.viewer.model.history import History
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.films import (
    FRAMES,
    FilmFile,
    PageFile,
    possible_kinds,
    save_film,
    save_page,
)
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.outputs import CUSTOM, Destination, PictureSize, Progress
from volspec.viewer.work.screenshot import Still, save_picture
from volspec.viewer.work.time_steps import TimeSteps
from volspec.volume import Series, Volume, phantom

pytestmark = pytest.mark.not_quick

SMALL = PictureSize(CUSTOM, (40, 30))


def frames_of(state: ViewState, film: Film) -> list[ViewState]:
    return [frame_state(state, film, i) for i in range(film.frames)]


def azimuths(state: ViewState, film: Film) -> list[float]:
    return [frame.view.azimuth_deg - state.view.azimuth_deg for frame in frames_of(state, film)]


def test_a_whole_turn_ends_before_its_start_and_a_part_at_its_angle(state):
    assert azimuths(state, Film(360.0, seconds=1.0, fps=4.0)) == [0.0, 90.0, -180.0, -90.0]
    assert azimuths(state, Film(-90.0, seconds=1.0, fps=4.0)) == [0.0, -30.0, -60.0, -90.0]
    assert azimuths(state, Film(0.0, seconds=0.5, fps=4.0)) == [0.0, 0.0]
    # A turntable of 36 frames is typed.
    for fps in (25.0, 24.0, 30.0, 7.0):
        assert with_frames(Film(fps=fps), 36).frames == 36
    assert with_frames(Film(), 0).frames == 1


def weights(state: ViewState, film: Film) -> list[list[float]]:
    return [[round(row.weight, 6) for row in frame.lights] for frame in frames_of(state, film)]


def test_lights_fade_into_each_other_and_back(state):
    state = replace(state, lights=state.lights[:2])
    fade = Film(0.0, LIGHTS, seconds=1.0, fps=4.0)
    assert weights(state, fade) == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [0.5, 0.5]]
    once = replace(fade, loops=False, fps=3.0)
    assert weights(state, once) == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]


def test_a_film_fades_through_saved_states_and_between_sides(state):
    assert light_changes(state)[1:] == (LIGHTS,)
    other = replace(state, lights=light_rows.only_row(state.lights, 1))
    saved = light_states.save(light_states.save(state).state).state.saved_lights
    dim = replace(saved[1], relight=replace(state.relight, backdrop=0.5))
    seen = replace(state, other=other.lights, saved_lights=(saved[0], dim))
    assert light_changes(seen)[1:] == (LIGHTS, STATES, SIDES)
    states = Film(0.0, STATES, False, seconds=1.0, fps=3.0)
    backdrops = [frame.relight.backdrop for frame in frames_of(seen, states)]
    start = state.relight.backdrop
    assert backdrops == pytest.approx([start, (start + 0.5) / 2, 0.5])
    sides = weights(seen, replace(states, lights=SIDES))
    assert [row[:2] for row in sides] == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]


def codes_of(path: Path) -> NDArray[np.int_]:
    return read_codes(path).astype(int)


def filmed(state: ViewState, *given: Any, **more: Any) -> Path:
    return save_film(state, FilmFile(*given, **more), Progress("", "film"))


@pytest.mark.parametrize("kind", ["plain", "cut", "anaglyph"])
def test_the_frames_of_a_film_are_the_pictures_of_its_preview(tmp_path, kind):
    state = replace(opened(tmp_path), size=(40, 30))
    if kind == "anaglyph":
        state = run_command(state, "stereo-anaglyph").state
    if kind == "cut":
        least, most = depth.limits_mm(state)
        faded = opacities.set_opacity(state, "copper", 0.5)
        state = depth.set_cut(faded, (least + most) / 2, most)
    film = Film(120.0, LIGHTS, seconds=1.0, fps=3.0)
    folder = filmed(state, film, FRAMES, SMALL, Destination(str(tmp_path), "turn"))
    assert folder == tmp_path / "turn"
    assert sorted(path.name for path in folder.glob("*.png")) == [f"000{i}.png" for i in range(3)]
    for i in range(3):
        shown = frame_of(frame_state(state, film, i))
        # The window's relighter may use a LUT, the exporter's does not.
        assert np.abs(shown - codes_of(folder / f"000{i}.png")).max() <= 2
    # A turn is what the command line makes of the saved scene.
    whole = Destination(str(tmp_path), "whole")
    frames = filmed(state, Film(seconds=0.5, fps=8.0), FRAMES, SMALL, whole)
    scene = Scene.load(export_scene(state, tmp_path / "again.toml"))
    first = scene.lights[0].name
    more = {"stereo": {"layout": kind}} if kind == "anaglyph" else {}
    turn = {"turntable": {"frames": 4}, "lights": [first], "size": (40, 30)}
    made = export(scene, tmp_path / "cli", **turn, **more)
    for i, name in enumerate(made.files[:4]):
        ours, theirs = map(codes_of, (frames / f"000{i}.png", made.output / name))
        assert np.abs(ours - theirs).max() <= 1


def test_gifs_and_folders_need_no_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert possible_kinds() == (".gif", FRAMES)
    state, film = opened(tmp_path), Film(seconds=0.5, fps=10.0)
    with Image.open(filmed(state, film, ".gif", SMALL)) as gif:
        assert (gif.size, gif.n_frames, gif.info["duration"]) == ((40, 30), 5, 100)
    assert len(list(filmed(state, film, FRAMES, SMALL).glob("*.png"))) == 5


def test_a_film_that_is_cancelled_leaves_nothing(tmp_path):
    state = opened(tmp_path)
    before = set(tmp_path.iterdir())

    class Cancelled(Progress):
        def report(self, share: float) -> None:
            self.ended = share > 0.5

    ended = Progress("")
    ended.ended = True
    for save, file, progress in (
        (save_film, FilmFile(kind=FRAMES, size=SMALL), Cancelled("", "film")),
        (save_film, FilmFile(kind=".gif", size=SMALL), Cancelled("", "film")),
        (save_page, PageFile(size=SMALL), Cancelled("", "page")),
        (save_picture, Still(to=Destination(str(tmp_path))), ended),
    ):
        with pytest.raises(CastCancelled):
            save(state, file, progress)
    assert set(tmp_path.iterdir()) == before
    with raises(ViewingError, "missing"):
        filmed(replace(state, lights=state.lights[1:]), kind=FRAMES, size=SMALL)


def test_a_page_has_the_views_and_the_lights_of_the_window(tmp_path):
    state = opened(tmp_path)
    file = replace(state.document.saved()[0], export=ExportSpec(annotate=("values",)))
    state = replace(state, document=replace(state.document, file=file))
    path = save_page(state, PageFile(2, "A ball", SMALL), Progress("", "page"))
    text = path.read_text(encoding="utf-8")
    assert "<title>A ball" in text and text.count('"azimuth_deg":') == 2
    assert all(f'"{word}"' in text for word in ("daylight", "tungsten", "ticks"))


@pytest.mark.slow
def test_a_film_and_a_page_are_made_by_mouse(window, tmp_path):
    imageio = pytest.importorskip("imageio_ffmpeg")
    np.save(tmp_path / "ball.npy", np.random.default_rng(1).random((12, 12, 12), np.float32))
    window.open(tmp_path / "ball.npy")

    def click(*places: tuple[str, float]) -> float:
        for name, at in places:
            before = window.rest()
            window.click(window.at(name, at))
            window.rest()
        return before

    def saved(event: str, after: float) -> Path:
        return Path(window.wait_for(lambda row: row["event"] in (event, "error"), after)["path"])

    # The preview turns the picture, and the picture is as it was after it.
    before = click(
        *(("menu File", 0.5), ("action film", 0.5), ("film length", 0.01), ("film rate", 0.01)),
        *(("mark scale", 0.2), ("film preview", 0.5)),
    )
    assert window.since(before, "cast")
    film = saved("film", click(("film ok", 0.5)))
    command = [imageio.get_ffmpeg_exe(), "-loglevel", "error", "-i", str(film)]
    raw = subprocess.check_output([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"])
    frames = np.frombuffer(raw, np.uint8).reshape(-1, 120, 160, 3)
    assert len(frames) == 4
    assert np.abs(np.subtract(frames[0], frames[2], dtype=int)).mean() > 1
    page = saved("page", click(("menu File", 0.5), ("action page", 0.5), ("page ok", 0.5)))
    assert page.parent == tmp_path
    assert '<script type="text/plain" id="view-0">' in page.read_text("utf-8")


def test_pictures_and_films_have_the_same_marks(tmp_path):
    state, size = replace(opened(tmp_path), size=(120, 90)), PictureSize(CUSTOM, (120, 90))
    folder = filmed(state, Film(0.0, seconds=0.5, fps=2.0), FRAMES, size, marks=MARKS)
    shots = (
        save_picture(state, shot, Progress("")) for shot in (Still(size, marks=MARKS), Still(size))
    )
    frame, shown, bare = map(codes_of, (folder / "0000.png", *shots))
    assert np.abs(frame - shown).max() <= 2
    assert (np.abs(shown - bare).max(axis=-1) > 20).mean() > 0.02


def of_series(tmp_path: Path, series: Series) -> ViewState:
    """Return the state of a document at the first step."""
    state = opened(tmp_path)
    document = replace(state.document, volume=series[0], series=series, caster=Raycaster(series[0]))
    return replace(state, document=document)


def balls(count: int) -> Series:
    return Series([Volume(phantom.ball(8).values * k) for k in range(1, count + 1)])


@pytest.fixture
def notice() -> Notice:
    return Notice()


@pytest.fixture
def steps(notice: Notice) -> Iterator[TimeSteps]:
    steps = TimeSteps(lambda: None, notice)
    yield steps
    steps.close()


def ready(steps: TimeSteps, document: Document) -> Document:
    """Wait for a step."""
    return take_until(lambda: [each for each in [steps.take(document)] if each], len)[0]


def test_steps_pressed_while_one_is_read_are_counted(tmp_path, steps):
    series = balls(7)
    state = of_series(tmp_path, series)
    document = state.document
    for _ in range(3):
        steps.go(state, 1)
    assert steps.requested(document) == 3
    shown = ready(steps, document)
    while shown.step != 3:
        shown = ready(steps, document)
    steps.go(replace(state, document=shown), -4)
    assert steps.requested(document) == 6  # around the first
    shown = ready(steps, shown)
    assert shown.step == 6 and shown.is_of(document) and shown.caster is not None
    assert shown.volume.values.max() == series[6].values.max()
    assert shown.volume.range == series[0].range
    assert shown.data[""].volume is shown.volume and shown.saved()[0].volume.step == 6
    assert document.saved()[0].volume.step == 0


def test_steps_play_in_a_loop_or_once(tmp_path, steps):
    state = of_series(tmp_path, balls(3))
    shown = [state.document]
    steps.toggle(state)

    def tick(now: float) -> None:
        steps.tick(replace(state, document=shown[-1]), shown[-1], now)

    for k in range(5):
        wait_until(lambda: not steps._worker.busy)
        tick(0.1 * k)  # makes the next one ready,
        wait_until(lambda: not steps._worker.busy)
        tick(0.1 * k)  # and shows it
        if k < 4:
            shown.append(ready(steps, shown[-1]))
    assert [each.step for each in shown] == [0, 1, 2, 0, 1]
    assert steps.patience(0.6) == float("inf")  # it waits for the present one to be shown
    assert steps.patience(0.41) == pytest.approx(0.09)
    last = ready(steps, shown[-1])
    wait_until(lambda: not steps._worker.busy)
    of_last = replace(state, document=last)
    steps.tick(of_last, shown[-1], 2.0)  # the picture of the last step is still cast
    assert steps.requested(last) == last.step == 2
    steps.toggle_loop()
    steps.tick(of_last, last, 3.0)
    wait_until(lambda: not steps._worker.busy)
    steps.tick(of_last, last, 3.0)
    assert not steps.playing


def test_a_step_that_is_gone_is_reported(tmp_path, steps, notice):
    read: list[int] = []

    def load() -> Volume:
        read.append(1)
        if len(read) > 1:
            raise VolumeError("b.nrrd: no such file", code="not-found")
        return Volume(phantom.ball(8).values * 2)

    series = Series([lambda: Volume(phantom.ball(8).values), load], kept_bytes=1)
    assert series[0].values.max()  # takes the room of the other
    state = of_series(tmp_path, balls(2))
    document = state.document
    object.__setattr__(document, "series", series)
    steps.toggle(state)
    steps.show(state, 1)
    wait_until(lambda: steps.take(document) is None and not steps.playing)
    assert "b.nrrd" in notice.text


def test_another_document_has_its_own_step_and_does_not_play(tmp_path, steps):
    state = of_series(tmp_path, balls(3))
    steps.go(state, 2)
    assert steps.requested(state.document) == 2
    steps.toggle(state)
    assert steps.requested(replace(state.document, opening=object(), step=1)) == 1
    steps.forget()
    assert not steps.playing and steps.requested(state.document) == 0


def test_without_steps_there_is_a_message(tmp_path, steps, notice):
    state = opened(tmp_path)
    steps.go(state, 1)
    assert "no time steps" in notice.text
    steps.toggle(state)
    assert not steps.playing and not steps.busy


def test_undo_leaves_the_step_as_it_is(tmp_path):
    state = of_series(tmp_path, balls(2))
    history = History(state).step(replace(state, thickness=2.0))
    later = state.document.at_step(1, state.document.series[1], None)
    history = history.amend(replace(history.present, document=later))
    assert history.difference.stage == "cast"
    assert {id(each.document) for each in history.past} == {id(later)}
    undone = history.undo().present
    assert undone.thickness == 1.0 and undone.document is later


def test_a_film_plays_the_steps_at_their_own_rate(tmp_path):
    document = of_series(tmp_path, balls(3)).document
    assert document.step_rate == 10.0
    assert film_steps(document, Film(seconds=0.5, fps=20.0)) == [0, 0, 1, 1, 2, 2, 0, 0, 1, 1]
    assert film_steps(document, Film(seconds=0.1, fps=20.0, steps=False)) == [None, None]
