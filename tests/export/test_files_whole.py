"""Files that appear whole: their permissions, whoever else writes."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from volspec._files import clear_temporaries, write_whole
from volspec.errors import InputError


@pytest.fixture(params=[0o022, 0o027, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_permissions_are_those_of_a_plain_open_beside_concurrent_writers(
    umask: int, tmp_path: Path
) -> None:
    def write(number: int) -> set[int]:
        with write_whole(tmp_path / f"{number}.txt") as temporary:
            temporary.write_text("whole")
        (tmp_path / f"{number}.plain").write_text("plain")
        return {(tmp_path / f"{number}.{end}").stat().st_mode & 0o777 for end in ("txt", "plain")}

    with ThreadPoolExecutor(8) as pool:
        modes = set().union(*pool.map(write, range(200)))
    assert modes == {0o666 & ~umask}


def test_a_full_disk_names_the_file_and_what_the_body_reads_does_not(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    told = pytest.raises(InputError, match=r"a\.html: cannot be written: No space left")
    with told, write_whole(tmp_path / "a.html"):
        raise full
    with pytest.raises(FileNotFoundError), write_whole(tmp_path / "a.html"):
        (tmp_path / "frame.png").read_bytes()
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a power cut may leave the name of a file whose end was never written."""
    path, synced, sync = tmp_path / "a.txt", [], os.fsync

    def watched(handle: int) -> None:
        synced.append((path.exists(), os.fstat(handle).st_size))
        sync(handle)

    monkeypatch.setattr(os, "fsync", watched)
    with write_whole(path) as temporary:
        temporary.write_text("whole")
    assert synced == [(False, 5)] and path.read_text() == "whole"


def test_nobody_s_umask_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that other threads make meanwhile would have another's permissions."""
    monkeypatch.delattr(os, "umask")
    with write_whole(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole")
    assert (tmp_path / "a.txt").read_text() == "whole"


def test_what_a_kill_leaves_is_told_from_what_others_made(tmp_path: Path) -> None:
    with write_whole(tmp_path / "a [b]?.txt") as temporary:
        left = temporary.name
        temporary.write_text("whole")
    (tmp_path / left).write_text("half")
    others = ".a [b]?-12345678.png", ".a b-12345678.txt", ".a [b]?-mine.txt", ".a [b]?-my-notes.txt"
    for other in others:
        (tmp_path / other).write_text("mine")
    clear_temporaries(tmp_path / "a [b]?.txt")
    assert len(list(tmp_path.iterdir())) == 5 and not (tmp_path / left).exists()
