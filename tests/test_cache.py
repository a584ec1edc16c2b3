"""The user's cache folder: what is read from it is what was made, and it is never in the way."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.export.test_files_whole import left_by_a_kill
from volspec import _cache

ARRAYS = {
    "values": np.random.default_rng(1).standard_normal((3, 5)),
    "names": np.array(["a", "Illuminant Ω"]),
    "ends": np.array([3, 5]),
}
Make = Callable[[], dict[str, np.ndarray]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def never() -> dict[str, np.ndarray]:
    raise AssertionError("made anew, though it was kept")


def same(found: _cache.Arrays) -> bool:
    """To the last bit, type and shape, and read-only."""
    return list(found) == list(ARRAYS) and all(
        (array.dtype, array.shape, array.tobytes(), array.flags.writeable)
        == (ARRAYS[key].dtype, ARRAYS[key].shape, ARRAYS[key].tobytes(), False)
        for key, array in found.items()
    )


def test_what_is_read_is_what_was_made_to_the_last_bit(folder: Path) -> None:
    assert same(_cache.kept("group/name", "maker 1", lambda: ARRAYS))
    assert [path.name for path in folder.rglob("*.*")] == ["name.npz"]
    assert same(_cache.kept("group/name", "maker 1", never))


def test_what_another_maker_wrote_is_made_anew(folder: Path) -> None:
    _cache.kept("group/name", "maker 1", lambda: {"values": np.zeros(2)})
    assert same(_cache.kept("group/name", "maker 2", lambda: ARRAYS))
    assert same(_cache.kept("group/name", "maker 2", never))


def test_a_damaged_file_is_made_anew(folder: Path) -> None:
    _cache.kept("group/name", "maker", lambda: ARRAYS)
    file = folder / "group" / "name.npz"
    whole = file.read_bytes()
    # Every 3rd byte is flipped in turn: names, headers, sizes, numbers and checksums are all hit.
    damaged = [
        whole[:i] + bytes([whole[i] ^ 0x41]) + whole[i + 1 :] for i in range(0, len(whole), 3)
    ]
    cut = [whole[:i] for i in range(0, len(whole), 50)]
    for content in (*damaged, *cut, b"not an archive", b""):
        file.write_bytes(content)
        # What hits only a date within the archive does no harm.
        assert same(_cache.kept("group/name", "maker", lambda: ARRAYS))
    file.write_bytes(whole[: len(whole) // 2])
    _cache.kept("group/name", "maker", lambda: ARRAYS)
    assert same(_cache.kept("group/name", "maker", never)), "and is whole again after that"


def test_a_folder_that_cannot_be_made_costs_only_time(folder: Path) -> None:
    folder.write_text("a file stands where the folder would")
    for _ in range(2):
        assert same(_cache.kept("group/name", "maker", lambda: ARRAYS))


def test_a_folder_that_cannot_be_written_costs_only_time(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("volspec._files._make_lock", refused)  # as root may write everywhere
    for _ in range(2):
        assert same(_cache.kept("group/name", "maker", lambda: ARRAYS))
    assert list((folder / "group").iterdir()) == []


def test_a_full_disk_costs_only_time_and_leaves_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    assert same(_cache.kept("group/name", "maker", lambda: ARRAYS))
    assert list((folder / "group").iterdir()) == []


def test_what_cannot_be_made_is_not_kept(folder: Path) -> None:
    def fails() -> dict[str, np.ndarray]:
        raise ValueError("no such spectrum")

    with pytest.raises(ValueError, match="no such spectrum"):
        _cache.kept("group/name", "maker", fails)
    assert not folder.exists()


def test_a_folder_keeps_its_newest_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_cache, "_MOST_FILES", 3)
    for number in range(5):
        _cache.kept(f"group/{number}", "maker", lambda: ARRAYS)
        os.utime(folder / "group" / f"{number}.npz", (number, number))
    _cache.kept("group/5", "maker", lambda: ARRAYS)
    assert sorted(path.stem for path in (folder / "group").iterdir()) == ["3", "4", "5"]


def test_a_file_just_written_is_kept_though_all_others_come_from_the_future(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_cache, "_MOST_FILES", 3)
    for number in range(3):
        _cache.kept(f"group/{number}", "maker", lambda: ARRAYS)
        later = time.time() + 1e8 + number
        os.utime(folder / "group" / f"{number}.npz", (later, later))
    for number in (3, 4):
        _cache.kept(f"group/{number}", "maker", lambda: ARRAYS)
    assert sorted(path.stem for path in (folder / "group").iterdir()) == ["2", "3", "4"]


def test_what_a_killed_run_left_is_cleared_by_one_that_only_reads(folder: Path) -> None:
    _cache.kept("group/name", "maker", lambda: ARRAYS)
    left_by_a_kill(folder / "group" / "other.npz")
    assert same(_cache.kept("group/name", "maker", never))
    assert [path.name for path in (folder / "group").iterdir()] == ["name.npz"]
