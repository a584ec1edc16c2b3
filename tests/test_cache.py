"""The cache of arrays: cached ones equal computed ones, and a fault of its files does no harm."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.export.test_files_whole import left_by_a_kill
from tests.support.errors import warns
from tests.support.fixtures import Patch
from volspec import _cache, _files

ARRAYS = {
    "values": np.random.default_rng(1).standard_normal((3, 5)),
    "names": np.array(["a", "Illuminant Ω"]),
    "ends": np.array([3, 5]),
}
Make = Callable[[], dict[str, np.ndarray]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: Patch) -> Path:
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def never() -> dict[str, np.ndarray]:
    raise AssertionError("computed although it was cached")


def same(found: _cache.Arrays) -> bool:
    """Return True if arrays equal `ARRAYS` to the last bit, type and shape, and are read-only."""
    return list(found) == list(ARRAYS) and all(
        (array.dtype, array.shape, array.tobytes(), array.flags.writeable)
        == (ARRAYS[key].dtype, ARRAYS[key].shape, ARRAYS[key].tobytes(), False)
        for key, array in found.items()
    )


def test_cached_arrays_equal_computed_ones_to_the_last_bit(folder):
    assert same(_cache.cached_arrays("group/name", "maker 1", lambda: ARRAYS))
    assert [path.name for path in folder.rglob("*.*")] == ["name.npz"]
    assert same(_cache.cached_arrays("group/name", "maker 1", never))


def test_arrays_of_another_maker_are_computed_again(folder):
    _cache.cached_arrays("group/name", "maker 1", lambda: {"values": np.zeros(2)})
    assert same(_cache.cached_arrays("group/name", "maker 2", lambda: ARRAYS))
    assert same(_cache.cached_arrays("group/name", "maker 2", never))


def test_a_damaged_file_is_replaced(folder):
    _cache.cached_arrays("group/name", "maker", lambda: ARRAYS)
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
        assert same(_cache.cached_arrays("group/name", "maker", lambda: ARRAYS))
    file.write_bytes(whole[: len(whole) // 2])
    _cache.cached_arrays("group/name", "maker", lambda: ARRAYS)
    assert same(_cache.cached_arrays("group/name", "maker", never)), "and is whole again after that"


def test_a_folder_that_cannot_be_made_costs_only_time(folder):
    folder.write_text("a file instead of the folder")
    for _ in range(2):
        assert same(_cache.cached_arrays("group/name", "maker", lambda: ARRAYS))


@pytest.mark.parametrize(
    ("function", "error"),
    [
        ("volspec._files._make_lock", PermissionError(13, "Permission denied")),
        ("numpy.savez", OSError(28, "No space left on device")),
    ],
)
def test_a_folder_that_cannot_be_written_costs_only_time(folder, monkeypatch, function, error):
    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(function, fails)  # as root may write everywhere
    for _ in range(2):
        assert same(_cache.cached_arrays("group/name", "maker", lambda: ARRAYS))
    assert list((folder / "group").iterdir()) == []


@pytest.mark.parametrize("fault", ["full", "caches", "caches/pocl", "caches/volspec", "programs"])
def test_caches_that_cannot_be_written_are_temporary(tmp_path, monkeypatch, fault):
    variables = {"XDG_CACHE_HOME": "caches", "POCL_CACHE_DIR": "programs", "MPLCONFIGDIR": "."}
    for variable, name in variables.items():
        monkeypatch.setenv(variable, str(tmp_path / name))
    if fault == "full":
        monkeypatch.setattr("shutil.disk_usage", lambda folder: (2**30, 2**30, 0))
    else:
        (tmp_path / fault).parent.mkdir(exist_ok=True)
        (tmp_path / fault).write_text("a file instead of the folder")
    variable = "POCL_CACHE_DIR" if fault == "programs" else "XDG_CACHE_HOME"
    with warns("caches are temporary", f"set {variable}"):
        _files.ensure_writable_caches.__wrapped__()
    assert tmp_path not in Path(os.environ["XDG_CACHE_HOME"]).parents
    assert os.access(os.environ["XDG_CACHE_HOME"], os.W_OK) and "POCL_CACHE_DIR" not in os.environ


def test_a_failed_computation_is_not_cached(folder):
    def fails() -> dict[str, np.ndarray]:
        raise ValueError("no such spectrum")

    with pytest.raises(ValueError, match="no such spectrum"):
        _cache.cached_arrays("group/name", "maker", fails)
    assert not folder.exists()


def test_a_folder_keeps_its_newest_files(folder, monkeypatch):
    monkeypatch.setattr(_cache, "_MAX_FILES", 3)
    for number in range(5):
        _cache.cached_arrays(f"group/{number}", "maker", lambda: ARRAYS)
        os.utime(folder / "group" / f"{number}.npz", (number, number))
    _cache.cached_arrays("group/5", "maker", lambda: ARRAYS)
    assert sorted(path.stem for path in (folder / "group").iterdir()) == ["3", "4", "5"]


def test_leftovers_of_a_killed_run_are_cleared_by_one_that_only_reads(folder):
    _cache.cached_arrays("group/name", "maker", lambda: ARRAYS)
    left_by_a_kill(folder / "group" / "other.npz")
    assert same(_cache.cached_arrays("group/name", "maker", never))
    assert [path.name for path in (folder / "group").iterdir()] == ["name.npz"]
