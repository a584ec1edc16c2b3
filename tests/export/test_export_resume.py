"""Exports that are killed, find the disk full, or come upon what others have left."""

import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest

from tests.export.conftest import SCENE
from tests.export.test_files_whole import left_by_a_kill
from tests.support.errors import raises, refuses
from tests.support.fixtures import Patch, slow
from volspec._files import exclusive_folder
from volspec.errors import InputError
from volspec.export.exporter import export

SETTINGS = {"turntable": {"frames": 4}, "lights": ["day", "lamp"]}
# An export that kills itself, as the kernel would, at a share of its work.
KILLED = """
import os, signal, sys
from volspec.export.exporter import export
from volspec.scene import Scene

def report(step, share):
    if step == "export" and share >= float(sys.argv[3]):
        os.kill(os.getpid(), signal.SIGKILL)

scene, lights = Scene.load(sys.argv[1]), ["day", "lamp"]
export(scene, sys.argv[2], turntable={"frames": 4}, lights=lights, progress=report)
"""


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize("share", [slow(0.2), 0.97])
def test_a_killed_export_goes_on_and_leaves_the_same_bytes(scene, tmp_path, share):
    made, folder = scene(), tmp_path / "killed"
    export(made, tmp_path / "whole", **SETTINGS)
    expected = contents(tmp_path / "whole")
    words = [sys.executable, "-c", KILLED, str(made.path), str(folder), str(share)]
    assert subprocess.run(words, check=False).returncode == -signal.SIGKILL
    there = contents(folder)
    del there["export.json"]  # it lists sizes when all is done
    for path, data in there.items():
        assert data == expected[path], "what is there is whole"
    assert "sheet.png" not in there
    left_by_a_kill(folder / "day" / "0003.png")
    done = export(made, folder, **SETTINGS)
    assert done.made == 8 - len(there) and contents(folder) == expected


def test_the_same_scene_gives_the_same_bytes_and_is_made_once(scene, tmp_path):
    def made_and_cast(name: str) -> tuple[int, int]:
        done = export(scene(), tmp_path / name, format="exr", transparent=True)
        return done.made, done.casts

    assert made_and_cast("a") == made_and_cast("b") == (3, 1)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert made_and_cast("a") == (0, 0)
    (tmp_path / "a" / "lamp.exr").unlink()
    assert made_and_cast("a") == (1, 1)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_a_frame_of_another_size_than_it_had_is_made_anew(scene, tmp_path):
    export(scene(), tmp_path, lights=["day", "lamp"])
    whole = contents(tmp_path)
    for name in ("lamp.png", "sheet.png"):
        (tmp_path / name).write_bytes(whole[name][: len(whole[name]) // 2])
    again = export(scene(), tmp_path, lights=["day", "lamp"])
    assert again.made == 1 and contents(tmp_path) == whole
    manifest = json.loads(whole["export.json"])
    assert manifest["sizes"] == {name: len(whole[name]) for name in manifest["files"]}
    del manifest["sizes"]  # as of before they were kept
    (tmp_path / "export.json").write_text(json.dumps(manifest))
    assert export(scene(), tmp_path, lights=["day", "lamp"]).made == 0


OWN = '[[light]]\nname = "own"\nspectrum = "lamp.csv"\n'


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "[viewing]\nexposure = 2"),
        slow("", "[raycast]\nstep_mm = 0.7"),
        slow("", '[viewing]\nmodel = "CAM16"'),
        (OWN, f"{OWN}# whose file has changed"),
    ],
)
def test_a_folder_of_another_scene_is_refused_unless_told(
    ball_folder, scene, tmp_path, before, after
):
    (ball_folder / "lamp.csv").write_text("380,1\n780,1\n")
    export(scene(before), tmp_path, lights=["day", "tube"])
    (tmp_path / "mine.txt").write_text("stays")
    there = contents(tmp_path)
    (ball_folder / "lamp.csv").write_text("380,1\n780,2\n")
    other = scene(after)
    refuses(lambda: export(other, tmp_path, lights=["lamp"]), "conflict", InputError)
    assert contents(tmp_path) == there
    export(other, tmp_path, lights=["lamp"], overwrite=True)
    assert set(contents(tmp_path)) == {"lamp.png", "sheet.png", "export.json", "mine.txt"}


def test_folders_of_others_are_not_written_into(scene, tmp_path):
    (tmp_path / "lamp.png").write_bytes(b"mine")
    refuses(lambda: export(scene(), tmp_path), "duplicate", InputError)
    assert contents(tmp_path) == {"lamp.png": b"mine"}
    (tmp_path / "export.json").write_text("{")
    refuses(lambda: export(scene(), tmp_path), "duplicate", InputError)
    with exclusive_folder(tmp_path / "busy"), raises(InputError, "state"):
        export(scene(), tmp_path / "busy")


def test_a_manifest_that_leads_elsewhere_deletes_nothing_there(scene, tmp_path):
    folder, victim = tmp_path / "out", tmp_path / "victim.png"
    folder.mkdir()
    victim.write_bytes(b"mine")
    manifest = {"fingerprint": "other", "files": ["../victim.png", str(victim), 7]}
    (folder / "export.json").write_text(json.dumps(manifest))
    export(scene(), folder, lights=["day"], overwrite=True)
    assert victim.read_bytes() == b"mine"


@contextmanager
def full_disk(monkeypatch: Patch, method: str = "write_bytes", room: int = 0) -> Iterator[None]:
    """Refuse what is written after some files, of which half of one still fits."""
    write, files = getattr(Path, method), count()

    def full(path: Path, data: bytes | str, **more: object) -> int:
        if next(files) < room:
            return write(path, data, **more)
        write(path, data[: len(data) // 2], **more)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched, raises(InputError, "unwritable"):
        patched.setattr(Path, method, full)
        yield


def test_a_full_disk_leaves_what_is_done_and_says_so_in_a_line(scene, tmp_path, monkeypatch):
    made = scene()
    with full_disk(monkeypatch, room=3):
        export(made, tmp_path / "out", **SETTINGS)
    there = contents(tmp_path / "out")
    assert len(there) == 4 and "export.json" in there  # three frames and no half one
    export(made, tmp_path / "out", **SETTINGS)
    export(made, tmp_path / "whole", **SETTINGS)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.parametrize("name", ["out", "film.gif"])
def test_a_disk_full_from_the_start_has_no_folder_left_on_it(scene, tmp_path, monkeypatch, name):
    made = scene()
    for method in ("write_bytes", "write_text"):  # the frames; the manifest
        with full_disk(monkeypatch, method):
            export(made, tmp_path / name, **SETTINGS)
        assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").touch()
    with full_disk(monkeypatch, "write_text"):
        export(made, tmp_path / "mine", **SETTINGS)
    assert [each.name for each in (tmp_path / "mine").iterdir()] == ["notes.txt"]


def test_a_folder_that_cannot_be_is_refused_before_the_cast(scene, tmp_path):
    (tmp_path / "file").write_text("")
    # Names of other endings are in the command's transcripts.
    for path, code in (("file", "type"), ("file/below", "unwritable")):
        with raises(InputError, code):
            export(scene(), tmp_path / path)
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_scenes_and_lights_of_any_name_are_exported(scene, tmp_path):
    hostile = "</script>\"'\u202e\u2066 .."
    text = SCENE.replace('"Ball"', f"'''{hostile}'''")
    text = text.replace('"day"', json.dumps(hostile, ensure_ascii=False))
    done = export(scene(text=text, name="hostile \u202e.toml"), tmp_path / "out")
    assert all(name.isprintable() and "/" not in name for name in done.files)
    assert len({(tmp_path / "out" / name).resolve().parent for name in done.files}) == 1
