"""Films, pages and time steps: the frames of the preview, by the exporters of the commands."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import raises
from tests.support.fixtures import Patch
from tests.support.patience import wait_until
from tests.support.viewer import opened
from tests.support.window import Robot
from volspec.errors import CastCancelled, ViewingError, VolumeError
from volspec.pipeline import Raycaster
from volspec.scene import Scene
from volspec.scene.export import MARKS
from volspec.viewer.model import light_rows, light_states
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
from volspec.viewer.work.screenshot import Shot, render_frame, save_picture
from volspec.viewer.work.steps import Steps
from volspec.volume import Series, Volume, phantom

pytestmark = pytest.mark.not_quick

SMALL = PictureSize(CUSTOM, (40, 30))


def azimuths(state: ViewState, film: Film) -> list[float]:
    frames = (frame_state(state, film, i) for i in range(film.frames))
    return [frame.view.azimuth_deg - state.view.azimuth_deg for frame in frames]


def test_a_whole_turn_ends_before_its_start_and_a_part_at_its_angle(state: ViewState) -> None:
    assert azimuths(state, Film(360.0, seconds=1.0, fps=4.0)) == [0.0, 90.0, -180.0, -90.0]
    assert azimuths(state, Film(-90.0, seconds=1.0, fps=4.0)) == [0.0, -30.0, -60.0, -90.0]
    assert azimuths(state, Film(0.0, seconds=0.5, fps=4.0)) == [0.0, 0.0]


def weights(state: ViewState, film: Film) -> list[list[float]]:
    frames = (frame_state(state, film, i) for i in range(film.frames))
    return [[round(row.weight, 6) for row in frame.lights] for frame in frames]


def test_lights_fade_into_each_other_and_back(state: ViewState) -> None:
    state = replace(state, lights=state.lights[:2])
    fade = Film(0.0, LIGHTS, seconds=1.0, fps=4.0)
    assert weights(state, fade) == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [0.5, 0.5]]
    once = weights(state, replace(fade, loops=False, fps=3.0))
    assert once == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]


def test_a_film_fades_through_saved_states_and_between_sides(state: ViewState) -> None:
    assert light_changes(state)[1:] == (LIGHTS,)
    other = replace(state, lights=light_rows.only_row(state.lights, 1))
    saved = light_states.save(light_states.save(state).state).state.saved_lights
    dim = replace(saved[1], relight=replace(state.relight, backdrop=0.5))
    seen = replace(state, other=other.lights, saved_lights=(saved[0], dim))
    assert light_changes(seen)[1:] == (LIGHTS, STATES, SIDES)
    states = Film(0.0, STATES, False, seconds=1.0, fps=3.0)
    backdrops = [frame_state(seen, states, i).relight.backdrop for i in range(3)]
    start = state.relight.backdrop
    assert backdrops == pytest.approx([start, (start + 0.5) / 2, 0.5])
    sides = weights(seen, replace(states, lights=SIDES))
    assert [row[:2] for row in sides] == [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]


def test_the_frames_of_a_film_are_the_pictures_of_its_preview(tmp_path: Path) -> None:
    state = replace(opened(tmp_path), size=(40, 30))
    film = Film(120.0, LIGHTS, seconds=1.0, fps=3.0)
    to = Destination(str(tmp_path), "turn")
    file = FilmFile(film, FRAMES, SMALL, to)
    folder = save_film(state, file, Progress("", "film"))
    assert folder == tmp_path / "turn"
    assert sorted(path.name for path in folder.glob("*.png")) == [f"000{i}.png" for i in range(3)]
    for i in range(3):
        shown = render_frame(frame_state(state, film, i), (40, 30), Progress("")).astype(int)
        frame = np.asarray(Image.open(folder / f"000{i}.png")).astype(int)
        # The window's relighter may use a LUT, the exporter's does not.
        assert np.abs(shown - frame).max() <= 2
    # A turn is what the command line makes of the saved scene.
    whole = replace(file, film=Film(seconds=0.5, fps=8.0), to=replace(to, name="whole"))
    frames = save_film(state, whole, Progress("", "film"))
    scene = Scene.load(export_scene(state, tmp_path / "again.toml"))
    first = scene.lights[0].name
    made = scene.export(tmp_path / "cli", turntable={"frames": 4}, lights=[first], size=(40, 30))
    for i, name in enumerate(made.files[:4]):
        ours = np.asarray(Image.open(frames / f"000{i}.png")).astype(int)
        theirs = np.asarray(Image.open(made.output / name)).astype(int)
        assert np.abs(ours - theirs).max() <= 1


@pytest.mark.parametrize("kind", [".gif", FRAMES])
def test_gifs_and_folders_need_no_ffmpeg(tmp_path: Path, monkeypatch: Patch, kind: str) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert possible_kinds() == (".gif", FRAMES)
    film = Film(seconds=0.5, fps=10.0)
    path = save_film(opened(tmp_path), FilmFile(film, kind, SMALL), Progress("", "film"))
    if kind == ".gif":
        with Image.open(path) as gif:
            assert (gif.size, gif.n_frames, gif.info["duration"]) == ((40, 30), 5, 100)
    else:
        assert len(list(path.glob("*.png"))) == 5


def test_a_film_that_is_cancelled_leaves_nothing(tmp_path: Path) -> None:
    state = opened(tmp_path)
    before = set(tmp_path.iterdir())

    class Cancelled(Progress):
        def report(self, share: float) -> None:
            self.ended = share > 0.5

    for kind in (FRAMES, ".gif"):
        with pytest.raises(CastCancelled):
            save_film(state, FilmFile(kind=kind, size=SMALL), Cancelled("", "film"))
    with pytest.raises(CastCancelled):
        save_page(state, PageFile(size=SMALL), Cancelled("", "page"))
    ended = Progress("")
    ended.ended = True
    with pytest.raises(CastCancelled):
        save_picture(state, Shot(to=Destination(str(tmp_path))), ended)
    assert set(tmp_path.iterdir()) == before
    with raises(ViewingError, "missing"):
        dark = replace(state, lights=state.lights[1:])
        save_film(dark, FilmFile(kind=FRAMES, size=SMALL), Progress("", "film"))


def test_a_page_has_the_views_and_the_lights_of_the_window(tmp_path: Path) -> None:
    path = save_page(opened(tmp_path), PageFile(2, "A ball", SMALL), Progress("", "page"))
    text = path.read_text(encoding="utf-8")
    assert "<title>A ball" in text and text.count('"azimuth_deg":') == 2
    assert '"daylight"' in text and '"tungsten"' in text


@pytest.mark.slow
def test_a_film_and_a_page_are_made_by_mouse_in_few_actions(window: Robot, tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio_ffmpeg")
    np.save(tmp_path / "ball.npy", np.random.default_rng(1).random((12, 12, 12), np.float32))
    window.open(tmp_path / "ball.npy")
    actions = 0

    def click(name: str, at: float = 0.5) -> float:
        nonlocal actions
        before = window.rest()
        window.click(window.at(name, at))
        window.rest()
        actions += 1
        return before

    click("menu File")
    click("action film")
    click("film length", 0.01)
    click("film rate", 0.01)
    click("mark scale", 0.2)
    # The preview turns the picture, and the picture is as it was after it.
    before = click("film preview", 0.5)
    assert window.since(before, "cast")
    before = click("film ok")
    film = window.wait_for(lambda row: row["event"] in ("film", "error"), before)
    assert actions <= 12
    command = [imageio.get_ffmpeg_exe(), "-loglevel", "error", "-i", film["path"]]
    raw = subprocess.run(
        [*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True
    )
    frames = np.frombuffer(raw.stdout, np.uint8).reshape(-1, 120, 160, 3)
    assert len(frames) == 4
    assert np.abs(np.subtract(frames[0], frames[2], dtype=int)).mean() > 1
    click("menu File")
    click("action page")
    before = click("page ok")
    page = window.wait_for(lambda row: row["event"] in ("page", "error"), before)
    assert Path(page["path"]).parent == tmp_path
    assert '<script type="text/plain" id="view-0">' in Path(page["path"]).read_text("utf-8")


def test_a_turntable_of_36_frames_is_typed() -> None:
    for fps in (25.0, 24.0, 30.0, 7.0):
        assert with_frames(Film(fps=fps), 36).frames == 36
    assert with_frames(Film(), 0).frames == 1


def test_pictures_and_films_have_the_same_marks(tmp_path: Path) -> None:
    state = replace(opened(tmp_path), size=(120, 90))
    size, marks = PictureSize(CUSTOM, (120, 90)), MARKS
    film = Film(0.0, seconds=0.5, fps=2.0)
    folder = save_film(state, FilmFile(film, FRAMES, size, marks=marks), Progress("", "film"))
    picture = save_picture(state, Shot(size, marks=marks), Progress(""))
    plain = save_picture(state, Shot(size), Progress(""))
    frame, shown, bare = (
        np.asarray(Image.open(path)).astype(int) for path in (folder / "0000.png", picture, plain)
    )
    assert np.abs(frame - shown).max() <= 2
    assert (np.abs(shown - bare).max(axis=-1) > 20).mean() > 0.02


def of_series(tmp_path: Path, series: Series) -> ViewState:
    """Return the state of a document at the first step."""
    state = opened(tmp_path)
    document = replace(state.document, volume=series[0], series=series, caster=Raycaster(series[0]))
    return replace(state, document=document)


def balls(count: int) -> Series:
    return Series([Volume(phantom.ball(8).values * k) for k in range(1, count + 1)])


def ready(steps: Steps, document: Document) -> Document:
    """Wait for a step."""
    found: list[Document] = []

    def taken() -> bool:
        if (each := steps.take(document)) is not None:
            found.append(each)
        return bool(found)

    wait_until(taken)
    return found[0]


def test_steps_pressed_while_one_is_read_are_counted(tmp_path: Path) -> None:
    series, steps = balls(7), Steps(lambda: None, Notice())
    state = of_series(tmp_path, series)
    document = state.document
    for _ in range(3):
        steps.go(state, 1)
    assert steps.wanted(document) == 3
    shown = ready(steps, document)
    while shown.step != 3:
        shown = ready(steps, document)
    steps.go(replace(state, document=shown), -4)
    assert steps.wanted(document) == 6  # around the first
    shown = ready(steps, shown)
    assert shown.step == 6 and shown.is_of(document) and shown.caster is not None
    assert shown.volume.values.max() == series[6].values.max()
    assert shown.volume.range == series[0].range
    assert shown.data[""].volume is shown.volume and shown.saved()[0].volume.step == 6
    assert document.saved()[0].volume.step == 0
    steps.close()


def test_steps_play_in_a_loop_or_once(tmp_path: Path) -> None:
    steps = Steps(lambda: None, Notice())
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
    assert steps.wanted(last) == last.step == 2
    steps.toggle_loop()
    steps.tick(of_last, last, 3.0)
    wait_until(lambda: not steps._worker.busy)
    steps.tick(of_last, last, 3.0)
    assert not steps.playing
    steps.close()


def test_a_step_that_is_gone_is_reported(tmp_path: Path) -> None:
    read: list[int] = []

    def load() -> Volume:
        read.append(1)
        if len(read) > 1:
            raise VolumeError("b.nrrd: no such file", code="not-found")
        return Volume(phantom.ball(8).values * 2)

    series = Series([lambda: Volume(phantom.ball(8).values), load], kept_bytes=1)
    assert series[0].values.max()  # takes the room of the other
    notice = Notice()
    state, steps = of_series(tmp_path, balls(2)), Steps(lambda: None, notice)
    document = state.document
    object.__setattr__(document, "series", series)
    steps.toggle(state)
    steps.show(state, 1)
    wait_until(lambda: steps.take(document) is None and not steps.playing)
    assert "b.nrrd" in notice.text
    steps.close()


def test_another_document_is_shown_at_its_own_step_and_does_not_play(tmp_path: Path) -> None:
    state, steps = of_series(tmp_path, balls(3)), Steps(lambda: None, Notice())
    steps.go(state, 2)
    assert steps.wanted(state.document) == 2
    steps.toggle(state)
    assert steps.wanted(replace(state.document, opening=object(), step=1)) == 1
    steps.forget()
    assert not steps.playing and steps.wanted(state.document) == 0
    steps.close()


def test_without_steps_there_is_a_message(tmp_path: Path) -> None:
    state, notice = opened(tmp_path), Notice()
    steps = Steps(lambda: None, notice)
    steps.go(state, 1)
    assert "no time steps" in notice.text
    steps.toggle(state)
    assert not steps.playing and not steps.busy


def test_undo_leaves_the_step_as_it_is(tmp_path: Path) -> None:
    state = of_series(tmp_path, balls(2))
    history = History(state).step(replace(state, thickness=2.0))
    later = state.document.at_step(1, state.document.series[1], None)
    history = history.amend(replace(history.present, document=later))
    assert history.difference.stage == "cast"
    assert {id(each.document) for each in history.past} == {id(later)}
    undone = history.undo().present
    assert undone.thickness == 1.0 and undone.document is later


def test_a_film_plays_the_steps_at_their_own_rate(tmp_path: Path) -> None:
    document = of_series(tmp_path, balls(3)).document
    assert document.step_rate == 10.0
    assert film_steps(document, Film(seconds=0.5, fps=20.0)) == [0, 0, 1, 1, 2, 2, 0, 0, 1, 1]
    assert film_steps(document, Film(seconds=0.1, fps=20.0, steps=False)) == [None, None]
