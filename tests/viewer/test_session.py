"""Sessions: what comes back, what is refused, and what is kept without being asked."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.viewer import assert_same_tables, opened
from tests.viewer._states import restored, save_ball, worked_on
from volspec import _cache
from volspec.errors import Code
from volspec.scene import Scene
from volspec.spectra import PAPERS_GRID
from volspec.viewer.model import camera, lights, transfer_edits
from volspec.viewer.model.document import Document
from volspec.viewer.model.light_rows import Fade
from volspec.viewer.model.state import ViewState
from volspec.viewer.work import session_store
from volspec.viewer.work.session import (
    SUFFIX,
    VERSION,
    BrokenSession,
    SessionError,
    read_session,
    restore_state,
    save_session,
    session_from_state,
)
from volspec.viewer.work.session_store import (
    EVERY_S,
    MAX_SESSIONS,
    REST_S,
    RecentFiles,
    SessionStore,
)
from volspec.volume import phantom


def again(state: ViewState, folder: Path) -> ViewState:
    return restored(state, folder, cast=False)


def test_all_that_was_made_comes_back_to_the_last_bit(tmp_path):
    state = worked_on(opened(tmp_path))
    back = again(state, tmp_path)
    assert session_from_state(back).data == session_from_state(state).data
    assert back.palette.targets.apart == state.palette.targets.apart != ()
    for name in ("view", "shift", "size", "divide", "interface", "shading"):
        assert getattr(back, name) == getattr(state, name), name
    assert_same_tables(back, state)
    # The scene's own is still what the file had: undo of everything goes back to it.
    assert back.document.view == state.document.view != back.view
    assert back.document.transfer.points == state.document.transfer.points
    assert back.document.title == "ball" and back.document.file == state.document.file


def test_what_was_one_is_one_again(tmp_path):
    """A light change must not cast, and what is unchanged must be known to be so."""
    state = opened(tmp_path)
    back = again(lights.set_weight(state, 1, 0.5), tmp_path)
    assert back.transfer is back.document.transfer and back.relight is back.document.relight
    assert back.lights[0].rig is back.document.lights[0].rig
    moved = again(transfer_edits.shift(state, 0.1), tmp_path)
    assert moved.transfer is not moved.document.transfer
    assert moved.transfer.basis is moved.document.transfer.basis


def test_a_fade_that_is_over_is_not_seen_again(tmp_path):
    state = opened(tmp_path)
    state = replace(state, fade=Fade(state.lights, state.relight, 1.0))
    session = session_from_state(state)
    assert "fade" not in session.data["state"] and restore_state(session, cast=False).fade is None
    # As files of before have it.
    old = session.data | {"state": session.data["state"] | {"fade": {"#": 0}}}
    assert restore_state(replace(session, data=old), cast=False).fade is None


def test_a_bare_volume_that_is_moved_with_its_session_is_found(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    scene = Scene.from_volume(str(save_ball(here, 12)))
    state = ViewState.first(Document.of(scene, scene.volume(), None), (40, 30))
    save_session(state, here / f"one{SUFFIX}")
    here.rename(there)
    back = restore_state(read_session(there / f"one{SUFFIX}"), cast=False)
    # Saved again, it is found again.
    for found in (back, restore_state(session_from_state(back), cast=False)):
        assert found.document.path == there / "ball.npy"


def test_masks_and_the_time_step_come_back(tmp_path):
    for step in range(3):
        np.save(tmp_path / f"beat{step}.npy", phantom.ball(10).values * (step + 1))
    np.save(tmp_path / "organs.npy", (np.mgrid[:10, :10, :10][2] > 4).astype(np.uint8))
    points = '[{ value = 0.1, opacity = 0.3, material = "a" }]'
    path = tmp_path / "beat.toml"
    path.write_text(
        f"""
        version = 2
        volume = {{ file = "beat*.npy", step = 2 }}
        material = [{{ name = "a", reflectance = "copper" }}]
        light = [{{ name = "day", spectrum = "D65" }}]
        basis.name = "general-5"
        field = [{{ name = "organs", file = "organs.npy" }}]
        [transfer]
        points = {points}
        mask = "organs"
        label = [{{ label = 0, shown = false }}, {{ values = [1, 4], points = {points} }}]
        """
    )
    scene = Scene.load(path)
    volume, series = scene.opened()
    state = ViewState.first(Document.of(scene, volume, None, series=series), (40, 30))
    assert state.document.step == 2
    back = again(replace(state, document=state.document.at_step(1, series[1], None)), tmp_path)
    assert back.document.step == 1
    assert np.array_equal(back.document.volume.values, series[1].values)
    functions = back.fields[0].mask.functions
    assert functions.keys() == {0, (1.0, 4.0)}
    assert functions[0] is None and functions[1.0, 4.0] is not None


@pytest.mark.parametrize("kind", ["gradients", "regions", "labels", "surfaces"])
def test_other_transfer_functions_come_back(tmp_path, kind):
    state = opened(tmp_path, kind)
    assert_same_tables(again(state, tmp_path), state)


def test_a_stored_session_loads(tmp_path):
    """Its volume is in its folder."""
    state = restore_state(read_session(fixture("v3-palette", tmp_path)), cast=False)
    assert [row.name for row in state.lights] == ["day", "tungsten", "mine", "3000 K"]
    assert state.lights[1].solo and state.lights[2].muted and state.lights[3].kelvin == 3000.0
    assert state.lights[2].rig.lights[0].designed
    assert state.divide == 0.3 and state.shift == 0.05
    assert state.relight.viewing.model == "CAM16" and state.relight.viewing.display.mark
    assert not state.interface.dark and state.interface.panels == {"Lights"}
    assert state.interface.overlays.planes and not state.interface.overlays.crop
    assert len(state.shading.clip_planes) == 1 and state.shading.groups[0].name == "key"
    assert state.view.azimuth_deg == pytest.approx(-6.0)
    # Colours stay as they were, and reset does not change them either.
    assert state.document.file.viewing.mode == state.relight.mode == "componentwise"
    assert state.transfer.basis.grid == PAPERS_GRID
    targets = state.palette.targets
    assert targets.cells["copper", "day"].kind == "colour" and targets.constant == {"grey"}
    assert targets.free == {("reflectance", "copper"), ("reflectance", "grey")}
    assert state.palette.is_pending and state.palette.designed_for is None
    assert state.saved_lights[0].name == "State 1"
    assert state.saved_lights[-1].relight.viewing.model == "CAM16"
    assert state.thickness == 1.7 and state.unthickened and state.unthickened[1] == 1.0


def fixture(name: str, folder: Path) -> Path:
    """Return a saved session with its scene and volume in a folder."""
    save_ball(folder, 12)
    (folder / "ball.toml").touch()
    session = Path(__file__).with_name("sessions") / f"{name}{SUFFIX}"
    return Path(shutil.copy(session, folder / f"one{SUFFIX}"))


def _spectrum(data: dict[str, Any]) -> dict[str, Any]:
    return next(each for each in data["objects"] if each.get("is") == "Spectrum")


_SAVED, _COPPER = "session.saved_lights 1", "session.transfer.materials.copper.values"
_EDITS: tuple[tuple[Code | None, str, Callable[[dict[str, Any]], Any]], ...] = (
    ("unsupported", "", lambda d: d.update(version=VERSION + 1)),
    ("unsupported", "", lambda d: d.update(version=VERSION - 1)),
    ("type", "", lambda d: d.update(version="1")),
    ("damaged", "format", lambda d: d.update(format="else")),
    ("damaged", "", lambda d: d.pop("objects")),
    ("damaged", "", lambda d: d.update(state=[])),
    ("damaged", "", lambda d: d.update(objects={"0": 1})),
    ("damaged", "", lambda d: d["file"].pop("volume")),
    ("damaged", "session.lights", lambda d: d["state"].update(lights=[])),
    ("missing", "session.lights", lambda d: d["state"].pop("lights")),
    ("type", "session.lights 1.name", lambda d: d["state"]["lights"][0].update(name="\ud800")),
    ("type", "session.divide", lambda d: d["state"].update(divide="half")),
    ("type", "session.relight", lambda d: d["state"].update(relight={"#": 999})),
    ("type", "session.view.up", lambda d: d["state"].update(view={"is": "View", "up": [0, 0]})),
    (None, "session.shading", lambda d: d["state"]["shading"].update(ambient=-1.0)),
    (None, "session.view", lambda d: d["state"]["view"].update(zoom=0.0)),
    # So far away that its camera is nowhere.
    (None, "session.view", lambda d: d["state"]["view"].update(zoom=1e-320)),
    ("type", "session.palette", lambda d: d["state"].update(palette="none")),
    ("type", "session.palette", lambda d: d["state"]["palette"].update({"is": "Plank"})),
    ("type", "session.palette.targets", lambda d: d["state"]["palette"].update(targets=7)),
    ("missing", f"{_SAVED}.relight", lambda d: d["state"]["saved_lights"][0].pop("relight")),
    ("type", _COPPER, lambda d: _spectrum(d).update(values=[[1.0], [2.0, 3.0]])),
)


@pytest.mark.parametrize(("code", "field", "change"), _EDITS)
def test_a_session_edited_by_hand_is_refused(tmp_path, code, field, change):
    path = fixture("v3-palette", tmp_path)
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with raises(SessionError, code, field):
        restore_state(read_session(path), cast=False)


def begun(folder: Path) -> tuple[ViewState, SessionStore]:
    """Return an opened scene, and a store with its session."""
    state, store = opened(folder), SessionStore(folder / "state")
    store.begin(state)
    return state, store


def turned(state: ViewState, share: float = 0.1) -> ViewState:
    return camera.orbit(state, share, 0.0)


def test_folders_of_sessions_and_caches_are_private(tmp_path, monkeypatch):
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path / "home" / "cache")
    state = opened(tmp_path)
    store = SessionStore(tmp_path / "home" / "state")
    store.begin(state)
    store.save(turned(state))
    RecentFiles(tmp_path / "home" / "recent").add("v.nrrd")
    _cache.cache_rows("rows.json", {"a": 1})
    _cache.cached_arrays("of/arrays", "1", lambda: {"a": np.zeros(1)})
    made = [path for path in (tmp_path / "home").rglob("*") if path.is_dir()]
    assert {path.stat().st_mode & 0o777 for path in made} == {0o700} and len(made) == 6


def test_nothing_is_kept_where_nothing_was_changed(tmp_path):
    state, store = begun(tmp_path)
    # A window of another size is no work of the user's.
    assert store.save(replace(state, size=(33, 44))) is None
    assert store.last() is None and not (tmp_path / "state").exists()


def test_a_session_is_kept_when_what_changed_rests_or_every_thirty_seconds(tmp_path):
    state, store = begun(tmp_path)
    changed = turned(state)
    assert not store.due(state, 100.0) and not store.due(state, 200.0)
    assert not store.due(changed, 300.0) and not store.due(changed, 300.0 + 0.9 * REST_S)
    assert store.due(changed, 300.0 + REST_S)
    # Asked for, it is not asked for again at once; where it failed, later.
    store.saving(changed, 304.0)
    assert not store.due(changed, 305.0) and store.due(changed, 304.0 + EVERY_S)
    assert store.save(changed) is not None and store.save(changed) is None
    assert not store.due(changed, 1000.0)
    seconds = range(int(EVERY_S) + 1)
    due = [store.due(turned(state, 0.01 * second), 2000.0 + second) for second in seconds]
    assert due == [False] * int(EVERY_S) + [True]


def test_a_state_that_is_late_to_be_written_does_not_overwrite_a_newer_one(tmp_path):
    """Simulate the end while a thread has not saved yet."""
    state, store = begun(tmp_path)
    older, newer = (turned(state, x) for x in (0.1, 0.2))
    late = store.saving(older, 1.0)
    own = store.save(newer)
    assert late() is None
    assert restore_state(read_session(own), cast=False).view == newer.view
    # What was written in its order is.
    assert store.saving(turned(newer), 2.0)() == own


def test_a_session_whose_program_died_is_told_of_once(tmp_path):
    state, store = begun(tmp_path)
    store.save(turned(state))
    # Another window, while the first is open, gets no message.
    assert not SessionStore(tmp_path / "state").ended_early()
    # What a dead program leaves is the same files, and no lock.
    shutil.copytree(tmp_path / "state", tmp_path / "left")
    after = SessionStore(tmp_path / "left")
    assert after.ended_early() and not after.ended_early()
    store.end()
    assert not SessionStore(tmp_path / "state").ended_early()


def test_another_file_does_not_overwrite_what_was_made_before(tmp_path):
    state, store = begun(tmp_path)
    first = store.save(turned(state))
    other = replace(state, document=replace(state.document, title="another"))
    store.begin(other)
    assert list((tmp_path / "state" / "running").iterdir()) == []  # ended as it should
    assert store.last() == first
    os.utime(first, (0, 0))  # files are sorted by when they were written
    second = store.save(turned(other, 0.3))
    assert second != first and store.last() == first
    # Restored, it goes on in its own file.
    back = restore_state(store.read(first), cast=False)
    store.begin(back, first)
    assert store.save(turned(back, 0.5)) == first
    assert store.last() == second


@pytest.mark.parametrize("ahead_s", [-1e9, 0.0, 1e8], ids=["past", "now", "future"])
def test_the_last_saved_session_is_last(tmp_path, monkeypatch, ahead_s):
    state = opened(tmp_path)
    names = iter(range(100, 0, -1))
    monkeypatch.setattr(session_store.time, "strftime", lambda _: f"{next(names):03}")
    for number in range(MAX_SESSIONS + 3):
        store = SessionStore(tmp_path / "state")
        store.begin(state)
        saved = store.save(turned(state))
        assert SessionStore(tmp_path / "state").last() == saved
        later = time.time() + ahead_s + number
        os.utime(saved, (later, later))
    left = sorted((tmp_path / "state" / "sessions").iterdir())
    # Named backwards: the first are the last saved.
    assert [path.name[:3] for path in left] == [f"{88 + rank:03}" for rank in range(MAX_SESSIONS)]


# Dies amid writing the session of the file that it is given.
KILLED_SAVE = """
import os, signal, sys
from pathlib import Path
from tests.support.viewer import opened
from volspec.viewer.model.camera import orbit
from volspec.viewer.work.session_store import SessionStore

def half(path, text, **settings):
    path.write_bytes(text[: len(text) // 2].encode())
    os.kill(os.getpid(), signal.SIGKILL)

folder = Path(sys.argv[1])
state, store = opened(folder), SessionStore(folder / "state")
store.begin(state, store.last())
Path.write_text = half
store.save(orbit(state, 0.2, 0.0))
"""


@pytest.mark.not_quick
def test_a_session_whose_save_is_killed_is_the_one_before(tmp_path):
    state, store = begun(tmp_path)
    saved = store.save(turned(state))
    store.end()
    before = saved.read_bytes()
    done = subprocess.run([sys.executable, "-c", KILLED_SAVE, str(tmp_path)], check=False)
    assert done.returncode == -signal.SIGKILL and saved.read_bytes() == before
    after = SessionStore(tmp_path / "state")
    assert after.ended_early() and after.last() == saved
    after.begin(state)
    assert restore_state(after.read(saved), cast=False).view == turned(state).view
    assert list((tmp_path / "state" / "sessions").iterdir()) == [saved]


@pytest.mark.parametrize(
    ("text", "kind", "ending"),
    [
        ('{"format": "volspec-ses', BrokenSession, ".broken"),
        (f'{{"format": "volspec-session", "version": {VERSION + 1}}}', SessionError, ""),
    ],
    ids=["broken", "later"],
)
def test_a_session_that_cannot_be_read_is_kept_and_put_aside_if_it_is_broken(
    tmp_path, text, kind, ending
):
    folder = tmp_path / "state" / "sessions"
    folder.mkdir(parents=True)
    (folder / "x.json").write_text(text, encoding="utf-8")
    with raises(kind):
        SessionStore(tmp_path / "state").read(folder / "x.json")
    kept = folder / f"x.json{ending}"
    assert list(folder.iterdir()) == [kept] and kept.read_text(encoding="utf-8") == text
