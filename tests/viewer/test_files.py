"""Files: scripts, paths, choices, what is remembered, pictures and their names."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.fixtures import Patch, slow
from tests.support.images import read_codes
from tests.support.patience import PATIENCE_S
from tests.support.viewer import opened, picture, run_command
from tests.viewer._states import frame_of, save_ball, seen, under, worked_on
from volspec._checks import MAX_SIDE
from volspec.errors import ImageError, InputError, OpenGLError, VolspecWarning, VolumeError
from volspec.export.frames import read_frame_text
from volspec.scene import Scene
from volspec.viewer.app import ViewerOptions, view
from volspec.viewer.model.choices import (
    USES,
    Dropped,
    NeedsChoice,
    RawLayout,
    address_with,
    guess_layouts,
)
from volspec.viewer.model.document import demo
from volspec.viewer.model.paths import (
    Listing,
    PathRequest,
    dropped_documents,
    dropped_meshes,
    folder_places,
    list_paths,
)
from volspec.viewer.model.scene_file import export_python, export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import dialogs
from volspec.viewer.ui.dialogs import REQUESTS, initial_path
from volspec.viewer.work import background, outputs, screenshot
from volspec.viewer.work.documents import open_document, open_path
from volspec.viewer.work.probe import PixelProbe
from volspec.viewer.work.session import SUFFIX, read_session, restore_state, save_session
from volspec.viewer.work.session_store import MAX_FILES, STATE_VARIABLE, RecentFiles, state_folder
from volspec.volume import Choice, load_volume, phantom
from volspec.volume.series import series_address

ROOT = Path(__file__).resolve().parents[2]


def run_python(
    *arguments: str, path: str = os.environ["PATH"], **more: Any
) -> subprocess.CompletedProcess[str]:
    """Run Python with this package, outside of its folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PATH": path}
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, **more)


@pytest.mark.not_quick
@pytest.mark.parametrize(
    ("basis", "name"),
    [
        ('method = "materials"', "größer 'a' \"b\" {c} %d.py"),
        slow('train = "scene"\nsize = 4', "ball.py"),  # next to the scene that is open
    ],
)
def test_a_script_makes_the_frame_that_the_viewer_shows(tmp_path, basis, name):
    state = worked_on(opened(tmp_path, basis=basis))
    shading = replace(state.shading, preintegrated=True)
    seen = replace(state.relight, mode="exact")
    state = replace(state, shading=shading, relight=seen, other=None, size=(48, 36))
    (tmp_path / "elsewhere").mkdir()
    script = export_python(state, tmp_path / name)
    assert "# A remark" in script.with_suffix(".toml").read_text(encoding="utf-8")
    done = run_python(str(script), cwd=tmp_path / "elsewhere")
    assert done.returncode == 0, done.stderr
    shown = frame_of(state)
    assert shown.std() > 5
    assert np.abs(read_codes(script.with_suffix(".png")) - shown).max() <= 1


def test_a_document_knows_what_opens_it_again(tmp_path):
    document = opened(tmp_path).document
    assert document.source == str(document.path)
    assert replace(document, path=demo()).source is None


def test_scripts_and_sessions_next_to_their_data_name_no_folder(tmp_path):
    """They can be sent together, and are the same bytes wherever they were made."""
    written = []
    for name in "ab":
        (tmp_path / name).mkdir()
        state = opened(tmp_path / name)
        script = export_python(state, tmp_path / name / "it.py")
        session = save_session(state, tmp_path / name / f"it{SUFFIX}")
        files = script, script.with_suffix(".toml"), session
        written.append(b"".join(file.read_bytes() for file in files))
    assert written[0] == written[1] and os.fspath(tmp_path).encode() not in written[0]
    moved = (tmp_path / "b").rename(tmp_path / "c")
    assert restore_state(read_session(moved / session.name), cast=False).document.path == (
        moved / "ball.toml"
    )
    text = (moved / script.name).read_text(encoding="utf-8")
    names: dict[str, Any] = {"__file__": str(moved / script.name)}
    exec(compile(text[: text.index("image = ")], "script", "exec"), names)
    assert names["scene"].volume().shape_xyz == (12, 12, 12)


@pytest.mark.parametrize(
    ("paths", "documents"),
    [
        ("/a/x.nrrd", "/a/x.nrrd"),
        ("/a/x.raw /a/x.mhd", "/a/x.mhd"),
        ("/a/1.tif /a/2.tif /a/3.tif", "/a"),
        ("/a/1.dcm /a/2.DCM /b/1.dcm", "/a/1.dcm /b/1.dcm"),  # one file represents its series
        ("/a/1.tif /a/x.png", "/a/1.tif /a/x.png"),
        ("x.toml x.nrrd", "x.toml"),
        ("x.toml x.nrrd y.nrrd", "x.toml x.nrrd y.nrrd"),
        ("x.obj x.mtl x.tif", ""),
        ("x.obj x.nrrd y.hdr y.img lamp.csv", "x.nrrd y.hdr"),
    ],
)
def test_dropped_files_mean_scenes_and_volumes(paths, documents):
    assert dropped_documents(paths.split()) == tuple(documents.split())
    assert dropped_meshes(paths.split()) == ("x.obj",) * ("obj" in paths)


def test_what_dropped_files_cannot_be_is_said_with_a_name():
    def problems(*paths: str) -> list[str]:
        return [Dropped(paths).problem(use) for use in USES]

    assert problems("/a/x.nrrd", "/a/y.nrrd") == ["", "", ""]
    assert problems("/a/x.nrrd", "/b/y.nrrd")[1].startswith("y.nrrd is in another folder")
    assert problems("x.nrrd", "y.toml") == ["y.toml is a scene, not a volume"] * 2 + [""]
    assert "at most 8" in problems(*(f"{i}.nrrd" for i in range(9)))[0]
    assert Dropped(("b10.nii", "b9.nii")).ordered("steps") == ("b9.nii", "b10.nii")


@pytest.mark.not_quick
def test_dropped_volumes_are_saved_as_one_scene(tmp_path):
    for name in ("a.npy", "b1.npy", "b3.npy"):
        save_ball(tmp_path, name=name)
    np.save(tmp_path / "seg.npy", (phantom.ball(16).values * 3.4).astype(np.uint8))
    seg, a, b, c = (str(tmp_path / f"{name}.npy") for name in ("seg", "a", "b1", "b3"))
    (tmp_path / "in").mkdir()
    for path, fields, title, count in (
        (seg, (a, b), "a.npy + seg.npy + b1.npy", 1),
        (series_address((c, b)), (), "b*.npy", 2),
        (series_address((c, a)), (), "b3.npy|a.npy", 2),
    ):
        state = ViewState.first(open_document(path, fields=fields), (40, 30))
        assert np.abs(frame_of(state) - np.rint(255 * picture(state))).max() <= 1  # of all fields
        scene = Scene.load(export_scene(state, tmp_path / "in" / "it.toml"))
        volume, _ = scene.opened()
        assert (state.document.title, scene.file.title) == (title, title)
        assert scene.step_count() == count
        assert volume.by_role.keys() == state.document.volume.by_role.keys()
        assert all(
            np.array_equal(one.values, state.document.volume.by_role[name].values)
            for name, one in volume.by_role.items()
        )
        document = open_document(state.document.source, fields=state.document.field_files)
        assert document.title == title
        again = restore_state(read_session(save_session(state, tmp_path / f"{count}{SUFFIX}")))
        assert again.document.field_files == state.document.field_files
        assert Path(initial_path(REQUESTS["export-scene"], state.document)).stem in "ab3"


def test_a_path_is_completed_as_far_as_its_neighbours_agree(tmp_path):
    for name in ("Engine-a.toml", "engine-b.toml", "engine.nrrd", "notes.txt", ".hidden.toml"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    start = f"{tmp_path}/"
    everything = list_paths(start, (".toml",))
    assert names(everything) == ["folder/", "Engine-a.toml", "engine-b.toml"]
    assert everything.common == start and everything.other_files == 2
    some = list_paths(start + "en", (".toml",))
    assert some.common.casefold() == start.casefold() + "engine-"
    assert list_paths(start + "f").common == start + "folder/"
    assert names(list_paths(start + ".h", (".toml",))) == [".hidden.toml"]
    nothing = list_paths(missing := f"{tmp_path}/nosuch/a")
    assert nothing.rows == () and nothing.common == missing
    # A dialog shows a folder; what is typed starts from there.
    inside = list_paths("en", (".toml",), base=str(tmp_path))
    assert names(inside) == names(some)
    assert (inside.folder, inside.common.casefold()) == ("", "engine-")
    assert names(list_paths(start, base="/nosuch")) == names(list_paths(start))


def test_slices_are_listed_by_their_content_if_they_have_no_ending(tmp_path):
    head = bytes(128) + b"DICM"
    files = {"IM0001": head, "1.2.840": head, "a.dcm": b"", "README": b"text", "a.txt": b"text"}
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    plain = list_paths(f"{tmp_path}/", (".dcm", ".toml"))
    assert names(plain) == ["a.dcm"] and plain.other_files == 4
    found = list_paths(f"{tmp_path}/", (".dcm", ".toml"), slices=True)
    assert names(found) == ["1.2.840", "a.dcm", "IM0001", "README"]
    assert (found.other_files, found.dicom) == (1, 3)


def names(listing: Listing) -> list[str]:
    return [row.name for row in listing.rows]


def test_a_dialog_offers_each_folder_once(tmp_path, monkeypatch):
    folders = [tmp_path / name for name in ("home", "open", "examples", "a", "b")]
    for folder in folders:
        folder.mkdir()
    home, opened, examples, a, b = map(str, folders)
    monkeypatch.setenv("HOME", home)
    monkeypatch.chdir(home)
    recent = [f"{a}/1.nrrd", f"{opened}/2.nrrd", f"{a}/3.nrrd", "/nowhere/4.nrrd", f"{b}/5.nrrd"]
    offered = [place.folder for place in folder_places(opened, recent, examples)]
    assert [folder for folder in offered if folder != "/"] == [home, opened, examples, a, b]


@pytest.fixture
def pictures(tmp_path: Path, monkeypatch: Patch) -> Path:
    """The user's folder of pictures."""
    monkeypatch.setenv("XDG_PICTURES_DIR", str(tmp_path / "pictures"))
    (tmp_path / "pictures").mkdir()
    return tmp_path / "pictures"


@pytest.mark.not_quick
def test_nothing_is_saved_next_to_a_bundled_scene(tmp_path, pictures, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = open_document(str(demo().with_name("engine-cut.toml")))
    assert outputs.output_folder(document) == pictures
    save = PathRequest("x", "Save", True, (".toml",))
    assert initial_path(save, document) == f"{tmp_path}/engine-cut-view.toml"


@pytest.mark.not_quick
def test_a_volume_opens_in_the_view_that_commands_give_it(tmp_path):
    path = save_ball(tmp_path)
    document, scene = open_document(str(path)), Scene.from_volume(path)
    assert document.file == scene.file
    assert document.view.camera(document.volume) == scene.camera(scene.volume())


@pytest.mark.not_quick
def test_a_dialog_starts_at_the_last_file_or_at_home(tmp_path, monkeypatch):
    for name in ("home", "work"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir("/")
    read, save = PathRequest("x", "Open"), PathRequest("x", "Save", True, (".toml",))
    assert initial_path(read, None) == f"{tmp_path}/home/"
    assert initial_path(read, None, [f"{tmp_path}/work/a.nrrd"]) == f"{tmp_path}/work/"
    state = opened(tmp_path / "work")
    assert initial_path(save, state.document) == f"{tmp_path}/work/ball-view.toml"
    volume = open_document(str(tmp_path / "work" / "ball.npy"))
    assert initial_path(save, volume) == f"{tmp_path}/work/ball-view.toml"  # ball.toml exists
    script = REQUESTS["export-python"]  # which is written with a scene
    assert initial_path(script, volume) == f"{tmp_path}/work/ball-view.py"
    (tmp_path / "work" / "ball.toml").unlink()
    assert initial_path(save, volume) == f"{tmp_path}/work/ball.toml"


def test_a_name_to_be_written_gets_its_ending():
    save = PathRequest("x", "Save", True, (SUFFIX, ".json"))
    assert save.complete(" a ") == f"a{SUFFIX}"
    assert save.complete("a.json") == "a.json" and save.complete("") == ""
    read = PathRequest("x", "Open", suffixes=(".toml",))
    assert read.complete("~/a") == os.path.expanduser("~/a")


def test_a_scene_that_a_script_would_replace_is_asked_about(tmp_path, monkeypatch):
    """The system's dialog asks about the script alone."""
    document, path = opened(tmp_path).document, str(tmp_path / "ball.py")

    class Dialog:
        def __init__(self, request: PathRequest) -> None:
            self.request = request

        def answer(self) -> str:
            return path

    monkeypatch.setattr(dialogs, "NativeDialog", Dialog)
    monkeypatch.setattr(dialogs, "has_native_dialogs", lambda: True)
    asked = dialogs.FileDialogs()
    asked.ask(REQUESTS["export-python"], document, ())
    assert asked.take() is None and isinstance(asked._dialog, dialogs.PathDialog)
    assert asked._dialog.request.replaced(path) == [f"{tmp_path}/ball.toml"]
    (tmp_path / "ball.toml").unlink()
    (tmp_path / "ball.py").touch()
    asked.ask(REQUESTS["export-python"], document, ())
    assert (asked.take() or ())[1:] == (path,)


def test_recent_files_are_ten_newest_first_and_missing_ones_are_known(tmp_path):
    recent = RecentFiles(tmp_path / "state")
    assert recent.rows() == ()
    (tmp_path / "there.raw").touch()
    for number in range(MAX_FILES + 2):
        recent.add(f"/nowhere/{number}.toml")
    recent.add(f"{tmp_path}/there.raw?shape=2x2x2&dtype=uint8")
    recent.add("/nowhere/5.toml")
    rows = recent.rows()
    assert [Path(row.path).name[:5] for row in rows[:3]] == ["5.tom", "there", "11.to"]
    assert len(rows) == MAX_FILES and [row.exists for row in rows[:2]] == [False, True]
    assert rows[0].label.startswith("5.toml ")
    recent.clear()
    assert recent.rows() == ()
    (tmp_path / "state" / "recent.json").write_text("{broken", encoding="utf-8")
    assert recent.rows() == ()
    nowhere = RecentFiles(Path("/proc/nothing"))
    nowhere.add("x.toml")
    assert nowhere.rows() == ()


def test_where_things_are_remembered_can_be_said(monkeypatch):
    monkeypatch.setenv(STATE_VARIABLE, "/somewhere")
    assert state_folder() == Path("/somewhere")
    monkeypatch.delenv(STATE_VARIABLE)
    assert state_folder().name == "volspec"


def test_pictures_are_as_shown_and_films_have_even_sides():
    shown = (301, 200)
    assert outputs.PictureSize(even=True).pixels(shown) == (300, 200)
    sizes = {
        preset: outputs.PictureSize(preset, (99, 77)).pixels(shown) for preset in outputs.PRESETS
    }
    assert (
        sizes[outputs.SHOWN] == shown
        and sizes[outputs.TWICE] == (602, 400)
        and sizes[outputs.CUSTOM] == (99, 77)
    )
    assert (3840, 2160) in sizes.values()
    assert outputs.PictureSize(outputs.CUSTOM, (-5, 10**9)).pixels(shown) == (1, MAX_SIDE)


def test_files_get_free_names_after_and_next_to_what_was_opened(tmp_path):
    document = opened(tmp_path).document
    for name, stems in (("", ("ball", "ball-1")), ("a b.png", ("a-b", "a-b-1"))):
        for stem in stems:
            path = outputs.Destination(name=name).new_path(document, ".png")
            assert path == tmp_path / f"{stem}.png"
            path.touch()
    # A volume, and a scene that was saved of it, whose title is the file name.
    volume = replace(document.file.volume, file="head.nii.gz?time=2")
    scene = replace(document, title="head.nii.gz", file=replace(document.file, volume=volume))
    assert outputs.Destination().new_path(scene, ".gif").name == "head.gif"


def test_files_go_to_the_pictures_from_a_folder_that_cannot_be_written_to(
    tmp_path, pictures, monkeypatch
):
    document = opened(tmp_path).document
    with monkeypatch.context() as patched:
        patched.setattr(os, "access", lambda *_: False)
        assert outputs.output_folder(document) == pictures
    monkeypatch.delenv("XDG_PICTURES_DIR")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (tmp_path / "Bilder").mkdir()
    (tmp_path / "user-dirs.dirs").write_text(f'XDG_PICTURES_DIR="{tmp_path}/Bilder"\n')
    assert outputs.pictures_folder() == tmp_path / "Bilder"


@pytest.mark.not_quick
def test_a_picture_holds_both_sides_of_the_divide_and_says_what_made_it(tmp_path):
    # What the light does is plain where no eye adapts to it.
    day = replace(seen(opened(tmp_path), model="none"), size=(40, 30))
    lamp = under(day, 1)
    left, both, right = map(frame_of, (day, replace(day, other=lamp.lights, divide=0.5), lamp))
    np.testing.assert_array_equal(both[:, :20], left[:, :20])
    np.testing.assert_array_equal(both[:, 20:], right[:, 20:])
    assert (left != right).any()
    # A folder that is missing is made.
    folder = tmp_path / "new" / "deeper"
    path = screenshot.save_picture(
        day, screenshot.Still(to=outputs.Destination(str(folder))), outputs.Progress("")
    )
    assert path.parent == folder and read_frame_text(path)["scene"] == "ball"


def test_a_picture_has_the_scale_bar_of_the_screen(tmp_path):
    state = opened(tmp_path)
    assert screenshot.Still().marks_for(state) == ("scale",)
    hidden = run_command(state, "scale").state
    assert screenshot.Still().marks_for(hidden) == () == screenshot.Still(marks=()).marks_for(state)


_READING = PixelProbe((("XYZ", "1 2 3"),), *[cast(Any, None)] * 3)


@pytest.mark.parametrize(
    ("kind", "expected", "call"),
    [
        (InputError, "unwritable", lambda d: outputs.Destination(str(d.path)).new_path(d, ".png")),
        (InputError, "unwritable", lambda d: outputs.Destination("/proc/new").new_path(d, ".png")),
        (OpenGLError, "unsupported", lambda _: view(ViewerOptions())),
        (screenshot.ClipboardError, "missing", lambda _: screenshot.copy_values(None)),
        (screenshot.ClipboardError, "unsupported", lambda _: screenshot.copy_values(_READING)),
    ],
)
def test_what_cannot_be_is_refused_without_a_display(tmp_path, monkeypatch, kind, expected, call):
    if expected == "unsupported" and sys.platform != "linux":
        pytest.skip("elsewhere the system needs no display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    document = opened(tmp_path).document
    refuses(lambda: call(document), expected, kind)


_ZENITY = """#!/bin/sh
case "$*" in
*Wait*) exec sleep 60;;
*--save*) echo /tmp/saved.toml;;
*--file-selection*) echo /tmp/chosen.nrrd;;
esac
"""
_ASK = """
import psutil
from tests.support.patience import wait_until
from volspec.viewer.model.paths import PathRequest
from volspec.viewer.ui.dialogs import NativeDialog, has_native_dialogs
assert has_native_dialogs()
read = PathRequest("o", "Open", suffixes=(".nrrd",))
for request in (read, PathRequest("s", "Save", True, (".toml",), "x.toml")):
    dialog = NativeDialog(request)
    asked, library = [], dialog._dialog
    class Asked:  # what a program writes while the library is asked can be lost
        result = library.result
        def ready(self, timeout):
            asked.extend(child.status() for child in psutil.Process().children())
            return library.ready(timeout)
    dialog._dialog = Asked()
    paths = []
    wait_until(lambda: paths.append(dialog.answer()) or paths[-1] is not None)
    print(paths[-1])
    assert set(asked) == {psutil.STATUS_ZOMBIE}, asked
left_open = NativeDialog(PathRequest("w", "Wait"))
assert left_open.answer() is None
left_open.close()  # or the program would end with it
"""


@pytest.mark.not_quick
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system's dialog would open")
def test_the_system_s_dialog_is_asked_without_waiting(tmp_path):
    program = tmp_path / "zenity"
    program.write_text(_ZENITY, encoding="utf-8")
    program.chmod(0o755)
    done = run_python("-c", _ASK, path=f"{tmp_path}:{os.environ['PATH']}", timeout=PATIENCE_S)
    assert [Path(line).stem for line in done.stdout.split()] == ["chosen", "saved"], done.stderr


def test_a_fault_in_a_task_is_told_and_not_waited_for(capsys):
    def ends(task: Callable[[], object]) -> background.Outcome:
        woken = threading.Event()
        tasks = background.Tasks(woken.set)
        tasks.start("picture", task)
        assert woken.wait(PATIENCE_S)
        return tasks.take()[0]

    def fails() -> None:
        raise InputError("no\nsuch thing")

    assert ends(lambda: 3).result == 3
    assert "\n" not in ends(fails).error
    assert ZeroDivisionError.__name__ in ends(lambda: 1 / 0).error
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_closing_waits_for_files(tmp_path, closing, monkeypatch):
    def late(name: str) -> None:
        assert closing.wait(PATIENCE_S)
        (tmp_path / name).touch()

    def full() -> None:
        raise InputError("b.toml: the disk is full")

    tasks, may_end = background.Tasks(lambda: None), threading.Event()
    tasks.start("map", may_end.wait)  # nobody waits for it
    for name in ("a.toml", "b.toml"):  # the last of a kind and the one before
        tasks.start("export-scene", lambda name=name: late(name), writes=True)
    tasks.close()
    assert {path.name for path in tmp_path.iterdir()} == {"a.toml", "b.toml"}
    tasks.start("export-scene", full, writes=True)
    assert "b.toml" in warned(tasks.close)
    tasks.close()  # it has been reported
    monkeypatch.undo()
    monkeypatch.setattr(background, "_PATIENCE_S", 0.0)
    tasks.start("export-python", may_end.wait, writes=True)
    assert "export-python" in warned(tasks.close)
    may_end.set()


def warned(act: Callable[[], object]) -> str:
    """Return the warning of a call, which has one."""
    with pytest.warns(VolspecWarning) as caught:
        act()
    (warning,) = caught
    return str(warning.message)


SHAPE = (40, 64, 48)  # x, y, z


def blob(kind: str) -> bytes:
    """A smooth volume of square slices, as bytes of a type."""
    z, y, x = np.mgrid[0:40, 0:64, 0:64]
    far = ((x - 30) ** 2 + (y - 34) ** 2 + (z - 20) ** 2) / 500.0
    scaled = 200 * np.exp(-far) if kind == "u1" else 3000 * np.exp(-far) - 1000
    if kind.endswith("u2"):
        scaled += 1000
    return scaled.astype(kind).tobytes()


@pytest.mark.parametrize("kind", ["u1", "<u2", ">u2", "<i2", ">i2", "<f4", ">f4"])
def test_the_layout_of_raw_bytes_is_found_by_their_smoothness(kind, tmp_path):
    data = blob(kind)
    middle = len(data) // 2 // 8 * 8
    guesses = guess_layouts("scan.raw", len(data), data[middle : middle + 65536])
    dtype = np.dtype(kind)
    assert guesses[0].shape == (64, 64, 40)
    same = [g for g in guesses[:2] if g.dtype == dtype.newbyteorder("=").name]
    assert same and (dtype.itemsize == 1 or same[0].order == ("big" if ">" in kind else "little"))
    # The address reads the same voxels.
    path = tmp_path / "scan.raw"
    path.write_bytes(data)
    volume = load_volume(address_with(str(path), same[0].options))
    np.testing.assert_allclose(volume.values.ravel(), np.frombuffer(data, kind), rtol=1e-6)


def test_a_name_that_states_the_shape_is_believed_if_the_size_agrees():
    voxels = 40 * 64 * 48
    (first, *_) = guess_layouts("ct_40x64x48_uint16.raw", 2 * voxels + 348, b"")
    assert (first.shape, first.dtype, first.offset) == (SHAPE, "uint16", 348)
    assert all(guess.shape != (1, 2, 3) for guess in guess_layouts("v1.2_1x2x3.raw", voxels, b""))
    assert guess_layouts("odd.raw", 10007, b"") == ()


def test_a_layout_is_compared_with_the_size_of_its_file():
    layout = RawLayout(SHAPE, "int16", "big", 8, (0.5, 0.5, 2.0))
    assert layout.nbytes == 2 * 40 * 64 * 48
    fits = [layout.check(layout.nbytes + 8 + more)[0] for more in (-1, 0, 1)]
    assert fits == [False, True, True]
    assert not RawLayout((0, 4, 4)).check(64)[0]
    assert address_with("a.raw", layout.options) == (
        "a.raw?shape=40x64x48&dtype=int16&spacing=0.5,0.5,2&order=big&offset=8"
    )


@pytest.mark.not_quick
def test_values_over_decades_may_be_shown_by_their_logarithms(tmp_path):
    np.save(tmp_path / "v.npy", 10 ** (9 * phantom.ball(12).values - 3))
    for query, chosen in (("", "linear"), ("?scale=log", "log")):
        (choice,) = open_document(f"{tmp_path}/v.npy{query}").choices
        assert (choice.key, choice.chosen) == ("scale", chosen)
    np.save(tmp_path / "v.npy", phantom.ball(12).values)
    assert open_document(f"{tmp_path}/v.npy").choices == ()


@pytest.mark.not_quick
def test_what_is_ambiguous_is_asked(tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    ball = (phantom.ball(12).values * 1000).astype(np.uint16)
    several = tmp_path / "cells.ome.tif"
    notes = {"axes": "TCZYX", "Channel": {"Name": ["DAPI", "GFP"]}}
    notes |= {f"PhysicalSize{axis}": 1.0 for axis in "XYZ"}
    notes |= {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(several, np.stack([np.stack([ball, 2 * ball])] * 3), metadata=notes)
    found = open_path(str(several), None)
    document = found.state.document
    assert len(document.series) == 3 and document.choices == ()
    assert [look.name for look in found.state.fields] == ["", "GFP"]
    found = open_path(address_with(str(several), {"time": "1", "channel": "1"}), None)
    document = found.state.document
    assert {choice.key: choice.chosen for choice in document.choices} == {"channel": "1"}
    assert document.series is None
    raw = tmp_path / "scan.raw"
    raw.write_bytes(bytes(64))
    assert open_path(str(raw), None) == NeedsChoice(str(raw), (Choice("shape", (), ()),))


@pytest.mark.parametrize(
    ("name", "kind"), [("x.raw?shape=9x9x9&dtype=uint8", VolumeError), ("x.exr", ImageError)]
)
def test_what_is_damaged_is_refused(tmp_path, name, kind):
    (tmp_path / name.partition("?")[0]).write_bytes(b"no picture")
    refuses(lambda: open_path(str(tmp_path / name), None), "damaged", kind)
