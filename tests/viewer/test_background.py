"""Background threads: requests replaced by newer ones, casts, memory returned to the system."""

import os
import platform
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.support.fixtures import Patch
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.viewer import opened, take_until
from tests.viewer._states import casts_of, job_of
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source
from volspec.appearance import Viewing
from volspec.basis import SpectralBasis
from volspec.errors import CastCancelled, RaycastError
from volspec.image import CoefficientImage
from volspec.pipeline import Raycaster, Relighter
from volspec.raycast import RaycastSpec
from volspec.raycast.progressive import DIVISORS, WHOLE, Pace, Pass
from volspec.relight import programs as programs_of_gl
from volspec.spectra import light
from volspec.transfer import FieldFunctions
from volspec.viewer.model import lighting
from volspec.viewer.model.lighting_aim import list_sources
from volspec.viewer.model.materials import with_material_basis
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import file_commands
from volspec.viewer.ui.context import Request, UiContext
from volspec.viewer.work import documents, precompile
from volspec.viewer.work.background import LatestWorker, Tasks
from volspec.viewer.work.cast_job import CastDone, CastJob
from volspec.viewer.work.casts import CastWorker
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screenshot import render_frame
from volspec.viewer.work.session import SUFFIX, save_session
from volspec.viewer.work.session_store import STATE_VARIABLE
from volspec.viewer.work.time_steps import TimeSteps
from volspec.volume import Metadata, Volume
from volspec.volume.labels import Label
from volspec.volume.metadata import NO_SPACING

pytestmark = pytest.mark.not_quick


class Slow(LatestWorker[str, str]):
    """Gives each letter of a word, the first as soon as it may."""

    _name = "slow"

    def __init__(self) -> None:
        super().__init__(lambda: None)
        self.go_on = threading.Event()
        self.begun: list[str] = []

    def _results(self, job: str) -> Iterator[str]:
        self.begun.append(job)
        assert self.go_on.wait(PATIENCE_S)
        if job == "fault":
            raise ZeroDivisionError
        for letter in job:
            yield letter
            if self._is_superseded():
                return


def all_of(worker: Slow) -> list[str]:
    """Collect results until it has nothing more to do."""
    return take_until(worker.take, lambda _: not worker.busy)


def test_what_waits_is_replaced_by_what_is_asked_for_next():
    worker = Slow()
    worker.request("ab")
    wait_until(lambda: worker.begun)
    for word in ("cd", "ef", "gh"):
        worker.request(word)
    assert worker.busy
    worker.go_on.set()
    assert all_of(worker) == ["a", "g", "h"] and worker.begun == ["ab", "gh"]
    # Its thread has ended, and another begins.
    worker.request("i")
    assert all_of(worker) == ["i"]


def test_a_closed_worker_begins_nothing_more():
    worker = Slow()
    worker.request("ab")
    wait_until(lambda: worker.begun)
    worker.request("cd")
    worker.close(0.0)
    worker.go_on.set()
    assert all_of(worker) == ["a"]
    worker.request("ef")
    assert worker.begun == ["ab"] and not worker.busy


def test_a_fault_ends_the_thread_and_not_the_work(monkeypatch):
    faults: list[object] = []
    monkeypatch.setattr(threading, "excepthook", faults.append)
    worker = Slow()
    worker.go_on.set()
    worker.request("fault")
    assert all_of(worker) == []
    worker.request("a")
    assert all_of(worker) == ["a"]
    # Neither what waited during the fault.
    worker.go_on.clear()
    worker.request("fault")
    wait_until(lambda: len(worker.begun) == 3)
    worker.request("b")
    worker.go_on.set()
    assert all_of(worker) == ["b"]
    wait_until(lambda: len(faults) == 2)


@pytest.mark.parametrize("in_order", [True, False])
def test_the_last_of_two_is_opened(tmp_path, monkeypatch, in_order):
    """A scene and a session: they were two kinds of task, of which each brought its own."""
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    state = opened(tmp_path)
    session = save_session(state, tmp_path / f"one{SUFFIX}")
    may_end = {name: threading.Event() for name in ("scene", "session")}

    def slow(name: str, result: object) -> Callable[..., Any]:
        return lambda *_: (may_end[name].wait(PATIENCE_S), result)[1]

    monkeypatch.setattr(documents, "open_document", slow("scene", state.document))
    resumed = replace(state, document=replace(state.document, title="resumed"))
    monkeypatch.setattr(documents, "restore_state", slow("session", resumed))
    ended = threading.Semaphore(0)
    tasks = Tasks(ended.release)
    each = documents.DocumentService(tasks, Notice(), None)
    titles: list[str] = []
    each.open(str(session))
    each.open("a.toml")
    for name in ("session", "scene") if in_order else ("scene", "session"):
        may_end[name].set()
        assert ended.acquire(timeout=PATIENCE_S)
        came = [each.finish_open(outcome, first=False) for outcome in tasks.take()]
        titles += [opened.state.document.title for opened in came if opened]
        assert titles == ["ball"] * (name == "scene" or not in_order)


def test_only_the_opening_s_message_ends_with_it(tmp_path, monkeypatch):
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    state, notice = opened(tmp_path), Notice()
    monkeypatch.setattr(documents, "open_document", lambda *_: state.document)
    each = documents.DocumentService(Tasks(lambda: None), notice, None)
    for later in ("", "later"):
        each.open("a.toml")
        assert "a.toml" in notice.text
        if later:
            notice.show(later)
        each.begin(documents.OpenResult(state), state)
        assert notice.text == later


def test_what_was_assumed_of_a_volume_is_a_message(tmp_path, monkeypatch):
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    state, notice = opened(tmp_path), Notice()
    volume = replace(state.document.volume, metadata=Metadata(assumed=(NO_SPACING,)))
    state = replace(state, document=replace(state.document, volume=volume))
    each = documents.DocumentService(Tasks(lambda: None), notice, None)
    each.begin(documents.OpenResult(state, "ball.npy"), None)
    assert NO_SPACING in notice.text


@pytest.mark.parametrize("written", [True, False])
def test_a_late_picture_is_saved(tmp_path, monkeypatch, written):
    def taken(_: ViewState, __: object, progress: Progress) -> Path:
        progress.ended = True
        if not written:
            raise CastCancelled("the picture was cancelled")
        return tmp_path / "late.png"

    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    monkeypatch.setattr(file_commands, "save_picture", taken)
    notice, came = Notice(), threading.Event()
    rest: tuple[Any, ...] = (
        UiContext(),
        notice,
        None,
        None,
        lambda *_: None,
        TimeSteps(came.set, notice),
    )
    each = file_commands.FileCommands(Tasks(came.set), cast(Any, None), *rest)
    each.run(Request("screenshot"), opened(tmp_path))
    assert came.wait(PATIENCE_S) and each.take(first=False)[0]
    assert notice.text and (str(tmp_path / "late.png") in notice.text) == written


def test_the_window_casts_while_a_picture_is_cast_for_a_file(tmp_path):
    """A picture held the document's caster for its whole cast."""
    state = opened(tmp_path)
    caster = Raycaster(state.document.volume)
    state = replace(state, document=replace(state.document, caster=caster))
    under_way, may_end = threading.Event(), threading.Event()

    class Held(Progress):
        def report(self, share: float) -> None:
            under_way.set()
            assert may_end.wait(PATIENCE_S)

    frames: list[Any] = []
    casts: list[Any] = []
    camera, table = state.view.camera(state.document.volume), caster.bake(state.transfer)
    saving, window = (
        threading.Thread(target=target, daemon=True)
        for target in (
            lambda: frames.append(render_frame(state, (64, 48), Held(""))),
            lambda: casts.append(caster.cast(table, camera, (32, 24), state.shading)),
        )
    )
    saving.start()
    assert under_way.wait(PATIENCE_S)
    window.start()
    window.join(PATIENCE_S)
    assert casts and not frames
    may_end.set()
    saving.join(PATIENCE_S)
    assert frames[0].shape == (48, 64, 3)


def job(state: ViewState, *divisors: int) -> CastJob:
    return job_of(state, (80, 60), *map(Pass, divisors))


class SlowCasts:
    """Fake of `volspec.raycast`: polls ``cancel`` while it is held up."""

    def __init__(self) -> None:
        self.begun: list[tuple[int, int]] = []
        self.polls = 0
        self.go_on = threading.Event()
        flat, basis = np.ones((2, 3), np.float32), SpectralBasis.load("general-7")
        self.image = CoefficientImage(np.ones((2, 3, 7), np.float32), flat, flat, basis)

    def __call__(self, *what: Any, cancel: Any, caster: Any, behind: Any) -> CoefficientImage:
        self.begun.append(what[3])
        while not self.go_on.wait(0.002):
            self.polls += 1
            if cancel():
                raise CastCancelled("ended")
        return self.image


@pytest.fixture
def casts(monkeypatch: Patch) -> SlowCasts:
    slow = SlowCasts()
    monkeypatch.setattr("volspec.viewer.work.casts.raycast", slow)
    return slow


def drained(scheduler: CastWorker, count: int) -> list[CastDone]:
    return take_until(scheduler.take, lambda done: len(done) == count)


def test_a_newer_request_ends_a_cast_and_what_waits(state, casts):
    scheduler = CastWorker(lambda: None)
    scheduler.request(job(state, 1))
    wait_until(lambda: casts.begun)
    scheduler.request(job(state, 4))
    wait_until(lambda: len(casts.begun) == 2)  # coarse, and let through: the next ones wait
    scheduler.request(job(state, 2))
    scheduler.request(last := job(state, 8))
    polls = casts.polls
    wait_until(lambda: casts.polls > polls + 1)
    casts.go_on.set()
    done = drained(scheduler, 3)
    assert [each.cast_pass.divisor for each in done] == [1, 4, 8]
    assert [each.image for each in done] == [None, casts.image, casts.image]
    # Packed where it was cast: the window's thread only uploads it.
    assert [each.packed is None for each in done] == [True, False, False]
    assert done[-1].job is last and casts.begun == [(80, 60), (20, 15), (10, 8)]
    scheduler.close()


def test_closing_ends_even_a_coarse_cast(state, casts):
    scheduler = CastWorker(lambda: None)
    scheduler.request(job(state, 8, 1))
    wait_until(lambda: casts.begun)
    scheduler.close()
    assert not casts.go_on.is_set() and len(casts.begun) == 1


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (RaycastError("no\nsuch thing"), "no such thing"),
        (MemoryError(), "no memory for the picture; make the window smaller"),
        # What a driver may raise when its device is gone.
        (RuntimeError("clFinish failed: OUT_OF_RESOURCES"), "clFinish failed: OUT_OF_RESOURCES"),
    ],
)
def test_the_thread_outlives_errors(state, monkeypatch, error, message):
    def fails(*what: Any, **more: Any) -> None:
        raise error

    monkeypatch.setattr("volspec.viewer.work.casts.raycast", fails)
    woken = threading.Event()
    scheduler = CastWorker(woken.set)
    for _ in range(2):
        scheduler.request(job(state, 4, 1))
        (done,) = drained(scheduler, 1)
        assert message in done.error
    assert woken.is_set()
    scheduler.close()


# The first block, freed, would teach glibc to keep blocks of this size in its heap.
_PICTURES = """
import re
from pathlib import Path

def taken():
    (kilobytes,) = re.findall(r"RssAnon:\\s*(\\d+)", Path("/proc/self/status").read_text())
    return int(kilobytes) / 1024

if {given}:
    from volspec.viewer.work.pictures import return_large_blocks
    from OpenGL import _configflags
    assert not _configflags.ERROR_CHECKING
    return_large_blocks()
import numpy as np
before, small = taken(), []
for _ in range(4):
    picture = np.ones(16 * 2**20, np.uint8)
    small += [np.ones(100_000, np.uint8) for _ in range(3)]
    del picture
print(taken() - before)
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_a_picture_s_memory_is_given_back_and_opengl_is_not_asked_after_every_call():
    """PyOpenGL asks how a call went unless that is switched off before its first import."""
    kept, back = (
        float(subprocess.check_output([sys.executable, "-c", _PICTURES.format(given=given)]))
        for given in (False, True)
    )
    # MiB, of which the small ones take 1.1.
    assert back < 3
    assert kept > back + 8


def test_a_moving_picture_gets_coarser_until_it_keeps_up():
    pace = Pace()
    for _ in range(9):
        pace = pace.after(pace.moving, 500.0)
    assert pace.divisor == DIVISORS[-1]
    for _ in range(9):
        pace = pace.after(pace.moving, 0.5)
    assert pace.moving == WHOLE and pace.after(WHOLE, 300.0).divisor == 2


def test_a_slow_picture_is_seen_at_full_size_with_long_steps_first():
    slow = Pace(whole_ms=5000.0)
    assert slow.to_whole("balanced") == (Pass(1, "fast"), WHOLE)
    assert slow.to_whole("fast") == (Pass(2), WHOLE)
    # Its time is not that of a whole picture, which would seem quick the next time.
    assert slow.after(Pass(1, "fast"), 50.0).whole_ms == 5000.0


def test_passes_lengthen_steps_and_nothing_else():
    volume = Volume(np.zeros((4, 4, 4), np.uint8), spacing_mm=(3.0, 2.0, 4.0))
    own = RaycastSpec(quality="exact", specular=0.1)
    long = replace(own, step_mm=5.0)
    moving = Pass(4, "voxel").spec(own, volume)
    assert moving.step_mm == 2.0 and moving.specular == 0.1
    assert moving.least_transmittance > own.least_transmittance
    assert Pass(4, "voxel").spec(long, volume).step_mm == 5.0
    assert Pass(1, "fast").spec(long, volume).step_mm is None
    assert WHOLE.spec(own, volume) is own
    assert WHOLE.spec(replace(own, layers=8), volume) == own, "a turned picture has no layers"


@pytest.mark.slow
def test_edits_of_lights_need_no_further_program(state, monkeypatch):
    built: set[str] = set()
    build, compiled = Compute._build, programs_of_gl.compile_program

    def recorded(compute: Compute, source: Source, *given: Any) -> Any:
        built.add(source.text)
        return build(compute, source, *given)

    def noted(context: Any, vertex: Source, fragment: Source) -> Any:
        built.add(fragment.text)
        return compiled(context, vertex, fragment)

    monkeypatch.setattr(Compute, "_build", recorded)
    monkeypatch.setattr(programs_of_gl, "compile_program", noted)
    document = replace(state.document, caster=Raycaster(state.document.volume))
    state = replace(state, document=document, transfer=with_material_basis(state.transfer))
    casts_of(job(state, 1))
    table, packet = document.caster.bake(state.transfer), document.caster.packet
    corner, device = precompile.few_voxels(document.volume), document.caster.device_index
    programs = precompile.Precompiler(
        corner, device, packet, table, state.shading, False, Viewing()
    )
    assert sum(1 for _ in programs.build()) > 4
    before = set(built)
    many, point, sky = (
        lighting.add_source(state, kind).state for kind in ("directional", "point", "ambient")
    )
    last = len(list_sources(many.shading)) - 1
    shadowless = lighting.set_source(many, "shadows", False, last)
    for edited in (many, shadowless, sky, point, state):
        (done,) = casts_of(job(edited, 1))
        for by_table in (False, True):
            with Relighter(done.image, "gl", lut3d=by_table) as relighter:
                relighter.frame(light("D65"))
    assert built == before


@pytest.mark.slow
def test_programs_are_built_by_a_child_that_ends_with_the_viewer(state, tmp_path, monkeypatch):
    if "Portable" not in Compute.open().info.platform:
        pytest.skip("the device in use is none of PoCL, whose cache is looked into")
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(precompile, "_REST_S", 0.0)
    volume = state.document.volume
    volume = replace(volume, labels={1: Label("bone")}, fields=(replace(volume, name="PET"),))
    document = replace(state.document, volume=volume, caster=Raycaster(volume))
    transfer = FieldFunctions({"": state.transfer, "PET": state.transfer})
    builder = precompile.ProgramBuilder(lambda: None)
    builder.request((job(replace(state, document=document, transfer=transfer), 1), Viewing()))
    # PoCL renames folders meanwhile, which `walk` forgives.
    wait_until(lambda: any("fields.so" in files for _, _, files in os.walk(tmp_path)))
    builder.close()
    assert not builder.busy
