"""Files that appear whole: their permissions, with other writers."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support.errors import raises
from volspec import _files
from volspec._files import captured_output, clear_unfinished, keep_newest, write_whole
from volspec.errors import InputError

# A writer that dies, as the kernel would kill it, or waits for a line.
WRITER = """
import os, signal, sys
from volspec._files import write_whole
with write_whole(sys.argv[1]) as temporary:
    temporary.write_text("half")
    print("begun", flush=True)
    if not sys.stdin.readline():
        os.kill(os.getpid(), signal.SIGKILL)
    temporary.write_text("whole")
"""
DAY_S = 86400.0


def left_by_a_kill(target: Path) -> list[Path]:
    """Files as a killed writer leaves them, and its lock; parents are made."""
    target.parent.mkdir(parents=True, exist_ok=True)
    locked, handle = _files._make_lock(target.parent)
    os.close(handle)
    part = locked.with_name(f"{locked.stem}.part{target.suffix}")
    part.write_bytes(b"half")
    return [part, locked]


def writer(target: Path) -> subprocess.Popen[str]:
    """A program that is amid writing a file."""
    command = [sys.executable, "-c", WRITER, str(target)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    return process


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(params=[0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_permissions_are_those_of_a_plain_open_beside_concurrent_writers(umask, tmp_path):
    def write(number: int) -> set[int]:
        with write_whole(tmp_path / f"{number}.txt") as temporary:
            temporary.write_text("whole")
        (tmp_path / f"{number}.plain").write_text("plain")
        return {(tmp_path / f"{number}.{end}").stat().st_mode & 0o777 for end in ("txt", "plain")}

    with ThreadPoolExecutor(8) as pool:
        modes = set().union(*pool.map(write, range(100)))
    assert modes == {0o666 & ~umask}


def test_a_full_disk_names_the_file_and_what_the_body_reads_does_not(tmp_path):
    with raises(InputError, "unwritable"), write_whole(tmp_path / "a.html"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(FileNotFoundError), write_whole(tmp_path / "a.html"):
        (tmp_path / "frame.png").read_bytes()
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """Else a power cut may leave the name of a file whose end was never written.

    No umask is set for it: files of other threads would have another's permissions.
    """
    monkeypatch.delattr(os, "umask")
    path, synced, sync = tmp_path / "a.txt", [], os.fsync

    def watched(handle: int) -> None:
        synced.append((path.exists(), os.fstat(handle).st_size))
        sync(handle)

    monkeypatch.setattr(os, "fsync", watched)
    with write_whole(path) as temporary:
        temporary.write_text("whole")
    assert synced == [(False, 5)] and path.read_text() == "whole"


def test_a_killed_writer_s_file_is_gone_after_the_next_write_in_its_folder(tmp_path):
    target = tmp_path / "a [b]?.txt"
    target.write_text("before")
    process = writer(target)
    process.communicate("")
    assert process.returncode == -signal.SIGKILL and target.read_text() == "before"
    assert len(names(tmp_path)) == 3
    with write_whole(tmp_path / "another.txt") as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == ["a [b]?.txt", "another.txt"] and target.read_text() == "before"


def test_a_living_writer_s_file_stays_however_old(tmp_path):
    process = writer(tmp_path / "a.txt")
    for path in tmp_path.iterdir():
        os.utime(path, (0, 0))
    clear_unfinished(tmp_path)
    process.communicate("go on\n")
    assert process.returncode == 0 and names(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "whole"


def test_what_a_user_made_stays(tmp_path):
    part, locked = left_by_a_kill(tmp_path / "a.txt")
    mine = tmp_path / "mine"
    mine.write_text("mine")
    (tmp_path / f"{locked.stem[:-8]}00000000.lock").symlink_to(mine)
    (tmp_path / f"{locked.stem[:-8]}11111111.lock").mkdir()
    others = (".volspec", ".volspec-notes.lock", f"{locked.stem}.txt", f"{locked.stem}0.part.txt")
    for name in others:
        (tmp_path / name).write_text("mine")
    before = names(tmp_path)
    clear_unfinished(tmp_path)
    assert names(tmp_path) == [name for name in before if name not in (part.name, locked.name)]
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("left", ["lock", "file", "both"])
def test_a_kill_at_any_step_leaves_what_the_next_run_clears(tmp_path, left):
    part, locked = left_by_a_kill(tmp_path / "a.txt")
    if left == "lock":
        part.unlink()
    if left == "file":
        locked.unlink()
    clear_unfinished(tmp_path)
    assert names(tmp_path) == []


@pytest.mark.parametrize("where", ["another machine", "no locks"])
def test_where_no_lock_can_tell_only_a_day_without_change_does(tmp_path, monkeypatch, where):
    left = left_by_a_kill(tmp_path / "a.txt")
    if where == "no locks":
        monkeypatch.setattr(_files, "lock_file_handle", lambda handle: None)
    else:
        monkeypatch.setattr(_files, "_machine", lambda: ("00000000", "11111111"))
    for age, stay in ((0.0, True), (0.9 * DAY_S, True), (-0.9 * DAY_S, True), (1.1 * DAY_S, False)):
        for path in left:
            os.utime(path, (time.time() - age,) * 2)
        clear_unfinished(tmp_path)
        assert [path.exists() for path in left] == [stay, stay], age


@pytest.mark.parametrize("same", [0, 1], ids=["name", "boot"])
def test_a_lock_tells_in_another_container_and_after_a_restart(tmp_path, monkeypatch, same):
    left_by_a_kill(tmp_path / "a.txt")
    ours = list(_files._machine())
    ours[1 - same] = "00000000"
    monkeypatch.setattr(_files, "_machine", lambda: tuple(ours))
    clear_unfinished(tmp_path)
    assert names(tmp_path) == []


def test_files_are_whole_where_no_lock_can_be_had(tmp_path, monkeypatch):
    monkeypatch.setattr(_files, "lock_file_handle", lambda handle: None)
    with write_whole(tmp_path / "a.txt") as temporary:
        clear_unfinished(tmp_path)
        temporary.write_text("whole")
    assert names(tmp_path) == ["a.txt"]


def test_windows_locks_do_the_same(tmp_path, monkeypatch):
    """Check the calls and their order, with Unix's locks in place of Windows'."""

    def locking(handle: int, mode: int, count: int) -> None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PermissionError(errno.EACCES, "Permission denied") from None

    windows = SimpleNamespace(locking=locking, LK_NBLCK=2)
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    monkeypatch.setattr(_files.sys, "platform", "win32")
    left_by_a_kill(tmp_path / "a.txt")
    with write_whole(tmp_path / "b.txt") as temporary:
        clear_unfinished(tmp_path)
        temporary.write_text("whole")
    assert names(tmp_path) == ["b.txt"]


def test_writers_and_those_who_clear_do_not_meet(tmp_path):
    """A file is there before it is locked; who clears it then takes nothing away."""

    def work(number: int) -> None:
        for turn in range(20):
            clear_unfinished(tmp_path)
            with write_whole(tmp_path / f"{number}-{turn % 4}.txt") as temporary:
                clear_unfinished(tmp_path)
                temporary.write_text("whole")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
    assert len(names(tmp_path)) == 32
    assert {path.read_text() for path in tmp_path.iterdir()} == {"whole"}


def test_a_lock_whose_file_another_has_made_again_is_given_up(tmp_path, monkeypatch):
    """Two who clear: one deletes the file that is not locked yet, the other makes it again."""
    locked = _files.lock_file_handle
    taken: list[Path] = []

    def lock(handle: int) -> bool | None:
        if not taken:
            taken.extend(tmp_path.iterdir())
            taken[0].unlink()
            taken[0].touch()
        return locked(handle)

    monkeypatch.setattr(_files, "lock_file_handle", lock)
    with write_whole(tmp_path / "a.txt") as temporary:
        assert temporary.stem != taken[0].stem
        temporary.write_text("whole")
    taken[0].unlink()
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("ahead_s", [0.0, 3600.0, 30 * 365 * DAY_S])
def test_the_file_just_written_stays_however_wrong_the_others_dates(tmp_path, ahead_s):
    now = time.time()
    for number in range(6):
        path = tmp_path / f"{number}.txt"
        path.touch()
        os.utime(path, (now + ahead_s + number,) * 2)
    written = tmp_path / "written.txt"
    written.touch()
    os.utime(written, (now, now))
    with write_whole(tmp_path / "another.txt") as temporary:
        temporary.write_text("whole")
        keep_newest(written, "*.txt", 4)
    (tmp_path / "another.txt").unlink()
    assert names(tmp_path) == ["3.txt", "4.txt", "5.txt", "written.txt"]
    assert _files.newest_first(tmp_path.iterdir())[0] == written


def test_threads_that_capture_the_output_at_once_leave_it_as_it_was():
    """Each had put back what it found: another's temporary file, if they overlapped."""
    before = os.fstat(1), os.fstat(2)

    def capture(k: int) -> bool:
        lines: list[str] = []
        for round_ in range(50):
            with captured_output(lines):
                os.write(2, f"{k} {round_}\n".encode())
        return {f"{k} {round_}" for round_ in range(50)} <= set(lines)

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(capture, range(4)))
    assert (os.fstat(1), os.fstat(2)) == before
