"""Volumes larger than memory: conversion, levels, what is read, and damage."""

import json
import os
import re
import resource
import shutil
import warnings
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import imageio.v3 as iio
import numpy as np
import pytest
import tifffile
import zarr

from tests.support.errors import raises
from tests.support.fixtures import slow_each
from tests.support.pyramids import stored
from tests.support.raycasts import oblique_world
from tests.support.scenes import scene_text
from tests.support.web import served
from volspec._files import exclusive_folder
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.cli import main
from volspec.errors import InputError, RaycastError, VolspecError, VolspecWarning, VolumeError
from volspec.export.exporter import export
from volspec.image import CoefficientImage
from volspec.large import conversion
from volspec.pipeline import GAPS, Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.scene import Scene
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume
from volspec.volume.labels import Label
from volspec.volume.levels.pyramid import BLOCK, Chunk, ChunkCache, Held, Level, block_ranges, halve
from volspec.volume.load import open_level
from volspec.volume.out_of_memory import level_of
from volspec.volume.summary import summarise

CHUNK = "v.zarr/0/c/1/1/1"
TRANSFER = TransferFunction(
    points=[(0.5, 0.0, "a"), (40, 0.02, "a"), (160, 0.5, "a")],
    materials={"a": reflectance("copper")},
    basis=SpectralBasis.load("general-7"),
)


@pytest.fixture(scope="module")
def ball() -> Volume:
    """Return a ball with a dense core and grains, in an empty box."""
    z, y, x = np.mgrid[-1:1:150j, -1:1:140j, -1:1:161j]
    radius = np.sqrt(x**2 + y**2 + z**2)
    values = np.clip(255 * (0.8 - radius), 0, 255) * (radius < 0.8)
    grains = np.random.default_rng(0).integers(0, 9, values.shape)
    return Volume((values + grains * (values > 20)).astype(np.uint8), spacing_mm=(1, 1, 1.5))


@pytest.fixture(scope="module")
def store(ball: Volume, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the ball converted; tests read it only."""
    folder = tmp_path_factory.mktemp("store")
    conversion.convert(level_of(ball), folder / "v.zarr", name="v")
    return folder


@pytest.fixture
def copy(store: Path, tmp_path: Path) -> Path:
    """A folder with a store to be damaged."""
    shutil.copytree(store / "v.zarr", tmp_path / "v.zarr")
    return tmp_path


@pytest.fixture
def big(store: Path) -> Volume:
    return opened(store)


@pytest.fixture(scope="module")
def whole(ball: Volume) -> CoefficientImage:
    return cast(ball, None)


def opened(folder: Path, memory: str = "2MB") -> Volume:
    return load_volume(f"{folder}/v.zarr?memory={memory}")


def cast(
    volume: Volume, level: int | None = 0, caster: Raycaster | None = None, **settings: object
) -> CoefficientImage:
    """Return a small picture of a level."""
    camera = Camera.orbit(volume, azimuth_deg=40)
    spec = RaycastSpec(level=level, step_mm=1.0, **settings)
    return raycast(volume, TRANSFER, camera, (48, 48), spec, caster=caster)


def test_a_converted_volume_is_the_volume(ball, store, big):
    finest, coarsest = big.pyramid.levels
    assert finest.shape == ball.values.shape
    assert np.array_equal(finest.read(((0, 150), (0, 140), (0, 161))), ball.values)
    assert np.allclose(finest.world_from_index, ball.world_from_index)
    assert np.array_equal(big.values, np.rint(halve(ball.values)))
    assert np.allclose(coarsest.world_from_index, ball.downsampled(2).world_from_index)
    assert np.array_equal(finest.ranges, block_ranges(ball.values))
    assert big.range == ball.range and big.pyramid.dtype == ball.values.dtype
    assert np.allclose(big.corners_mm, ball.corners_mm)
    # Other programs read it as any OME-Zarr, and so do we if there is memory for it.
    whole = load_volume(store / "v.zarr")
    assert whole.pyramid is None and np.array_equal(whole.values, ball.values)


def test_levels_are_seen_as_the_whole(big, ball, whole):
    assert np.abs(cast(big, 0).coefficients - whole.coefficients).max() < 2e-4
    assert np.abs(cast(big, 1).alpha - whole.alpha).mean() < 0.02
    # 48 pixels across 250 mm: a voxel of level 0 is smaller than a pixel, one of level 1 too.
    assert np.array_equal(cast(big, None).coefficients, cast(big, 1).coefficients)
    assert raycast(big, TRANSFER, Camera.orbit(ball, zoom=8), (300, 300)).alpha.max() > 0.5


def test_each_chunk_is_read_once_and_none_in_vain(big):
    big = replace(big, pyramid=replace(big.pyramid, memory_bytes=10**8))
    cast(big)
    counts = big.pyramid.counts
    before = counts.chunks
    # The ball does not reach the corners.
    assert counts.again_bytes == 0 and 0 < before <= np.prod(big.pyramid.levels[0].grid)
    cast(big)
    assert counts.chunks == before  # all of it is still in memory


RAMP = np.mgrid[0:40, 0:44, 0:136].sum(axis=0)


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.float32, np.float64, np.int8])
def test_types(dtype, tmp_path):
    values = np.minimum(RAMP - 20, 120).astype(dtype)
    big = stored(Volume(values), tmp_path, "200kB")
    assert np.array_equal(big.pyramid.levels[0].read(((0, 40), (0, 44), (0, 136))), values)
    assert big.range == (values.min(), values.max())


def test_labels_keep_names_and_are_not_averaged(tmp_path):
    values = np.zeros((40, 40, 140), np.uint8)
    values[10:30, 10:30, 10:30], values[18:22, 18:22, 18:22] = 3, 7
    labels = {3: Label("liver", (0.5, 0.2, 0.1)), 7: Label("vessel")}
    big = stored(Volume(values, labels=labels), tmp_path, "30kB")
    assert set(np.unique(big.values)) == {0, 3, 7}
    assert [label.name for number, label in big.labels.items() if number] == ["liver", "vessel"]


def test_directions_and_spacing_stay(tmp_path):
    volume = Volume(RAMP.astype(np.uint8), world_from_index=oblique_world())
    big = stored(volume, tmp_path, "30kB")
    assert np.allclose(big.pyramid.levels[0].world_from_index, volume.world_from_index)
    assert np.allclose(big.world_from_index, volume.downsampled(2).world_from_index)
    wide = big.with_spacing((2.0, 1.0, 3.0))
    assert np.allclose(wide.corners_mm, volume.with_spacing((2.0, 1.0, 3.0)).corners_mm)


def test_missing_voxels_stay_missing(tmp_path):
    values = RAMP.astype(np.float32)
    values[5:20, 8:30, 3:20] = np.nan
    with pytest.warns(VolspecWarning):
        big = stored(Volume(values), tmp_path, "200kB")
    chunk = big.pyramid.read(0, ((0, 40), (0, 44), (0, 64)))
    assert np.array_equal(chunk == big.missing, np.isnan(values[:, :, :64]))


def write_raw(values: np.ndarray, folder: Path) -> str:
    values.tofile(folder / "v.raw")
    return "v.raw?shape=161x140x150&dtype=uint8"


def write_tiff(values: np.ndarray, folder: Path) -> str:
    tifffile.imwrite(folder / "v.tif", values, compression="zlib")
    return "v.tif"


def write_plain_tiff(values: np.ndarray, folder: Path) -> str:
    tifffile.imwrite(folder / "v.tif", np.stack([values, values // 2], axis=1), imagej=True)
    return "v.tif?channel=0"


def write_slices(values: np.ndarray, folder: Path, suffix: str = ".tif") -> str:
    (folder / "slices").mkdir()
    for k, each in enumerate(values):
        iio.imwrite(folder / f"slices/z{k}{suffix}", each)
    return "slices"


def write_hdf5(values: np.ndarray, folder: Path) -> str:
    with h5py.File(folder / "v.h5", "w") as file:
        file.create_dataset("a/raw", data=values, chunks=(32, 48, 64), compression="gzip")
    return "v.h5"


def write_plain_hdf5(values: np.ndarray, folder: Path) -> str:
    with h5py.File(folder / "v.h5", "w") as file:
        file["steps"] = np.stack([values // 2, values])
    return "v.h5?time=1"


write_pngs = partial(write_slices, suffix=".png")
OTHERS = [write_tiff, write_plain_tiff, write_slices, write_pngs, write_plain_hdf5]


@pytest.mark.parametrize("write", [write_raw, write_hdf5, *slow_each(*OTHERS)])
def test_files_of_other_kinds_are_read_in_parts(write, ball, whole, tmp_path):
    name = f"{tmp_path}/{write(ball.values, tmp_path)}"
    file = Path(name.partition("?")[0])
    address = f"{name}{'&' if '?' in name else '?'}spacing=1,1,1.5"
    assert np.array_equal(load_volume(address).values, ball.values)
    with pytest.warns(VolspecWarning, match="volspec convert"):
        big = load_volume(f"{address}&memory=2MB")
    assert big.range == ball.range
    assert np.abs(cast(big).coefficients - whole.coefficients).max() < 2e-4
    level, *_ = open_level(f"{address}&memory=2MB")
    conversion.convert(level, tmp_path / "copy.zarr")
    copy = load_volume(tmp_path / "copy.zarr")
    assert np.array_equal(copy.values, ball.values)
    assert np.allclose(copy.spacing_mm, ball.spacing_mm)
    # What cannot be read is a gap, as in any other kind.
    if file.is_dir():
        shutil.rmtree(file)
    else:
        file.write_bytes(b"gone")
    with pytest.warns(VolspecWarning, match="cannot be read"):
        cast(replace(big, pyramid=replace(big.pyramid)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["url", *slow_each("zip")])
def test_a_store_in_a_zip_file_or_on_the_web(kind, ball, store, big, tmp_path):
    with served(store) as (server, asked):
        address = f"{server}/v.zarr"
        if kind == "zip":
            address = shutil.make_archive(str(tmp_path / "w.zarr"), "zip", store / "v.zarr")
        assert np.array_equal(load_volume(address).values, ball.values)
        far = load_volume(f"{address}?memory=2MB")
        assert np.array_equal(cast(far).coefficients, cast(big).coefficients)
        assert any("/0/c/" in path for path in asked) == (kind == "url")
        # A scene names the store as it was given, wherever the scene is saved.
        scene = Scene.from_volume(f"{address}?memory=2MB", volume=far)
        assert scene.render(far, size=(16, 16)).alpha.any()
        assert ("://" in scene.file.volume.file) == (kind == "url")
    if kind == "url":  # the server is gone
        with pytest.warns(VolspecWarning, match="cannot be read"):
            cast(replace(far, pyramid=replace(far.pyramid)))


def interrupted(level: Level, path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        conversion.convert(level, path)


def test_a_cut_off_conversion_goes_on(ball, tmp_path, monkeypatch):
    path, level = tmp_path / "v.zarr", level_of(ball)
    written: list[conversion.Block] = []
    own, most = conversion._write, 2

    def write(block: conversion.Block, *others: object) -> None:
        if len(written) == most:
            raise KeyboardInterrupt
        written.append(block)
        own(block, *others)

    monkeypatch.setattr(conversion, "_write", write)
    interrupted(level, path)
    assert not path.exists()
    most = -1
    conversion.convert(level, path)
    assert len(written) == len(set(written)), "a block was written twice"
    assert np.array_equal(zarr.open(str(path / "0"), mode="r")[:], ball.values)
    assert [each.name for each in tmp_path.iterdir()] == ["v.zarr"]


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["before the swap", "in the swap", "after the swap"])
def test_a_conversion_that_is_killed_at_its_end_goes_on(killed, ball, tmp_path, monkeypatch):
    path, level = tmp_path / "v.zarr", level_of(ball)
    conversion.convert(level_of(ball.downsampled(2)), path)
    own = Path.replace

    def swap(self: Path, target: Path) -> Path:
        return _interrupt() if self.suffix == ".unfinished" else own(self, target)

    with monkeypatch.context() as patch:
        if killed == "in the swap":
            patch.setattr(Path, "replace", swap)
        else:
            patch.setattr(conversion, "_attributes" if "before" in killed else "_clean", _interrupt)
        interrupted(level, path)
    if killed == "in the swap":  # of another source: what was there comes back first
        with suppress(VolumeError):
            conversion.convert(replace(level, array=Unreadable(level)), path)
        assert load_volume(path).shape_xyz == ball.downsampled(2).shape_xyz
    conversion.convert(level, path)
    assert np.array_equal(load_volume(path).values, ball.values)
    assert [each.name for each in tmp_path.iterdir()] == ["v.zarr"]
    assert {each.name for each in path.iterdir()} == {"0", "1", "volspec", "zarr.json"}


def _interrupt(*_: object) -> Any:
    raise KeyboardInterrupt


class Unreadable:
    def __init__(self, level: Level) -> None:
        self.shape, self.dtype = level.shape, level.dtype

    def __getitem__(self, _: object) -> Any:
        raise OSError("gone")


def test_a_conversion_goes_on_with_the_same_source_only(ball, tmp_path):
    values = ball.values.astype("<u2")
    values.tofile(tmp_path / "v.raw")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["a"], file["b"] = values, values[::-1]
    tifffile.imwrite(tmp_path / "v.tif", np.stack([values, values // 2], axis=1), imagej=True)
    write_slices(ball.values, tmp_path)

    def known(name: str) -> list[int]:
        return conversion._fingerprint(open_level(f"{tmp_path}/{name}&memory=1MB")[0])

    raw = "v.raw?shape=161x140x150&dtype=uint16"
    for one, other in (
        (raw, f"{raw}&order=big"),
        ("v.h5?dataset=a", "v.h5?dataset=b"),
        ("v.tif?channel=0", "v.tif?channel=1"),
    ):
        assert known(one) == known(one) != known(other)
    before = known("slices?spacing=1,1,1")
    os.utime(tmp_path / "slices/z70.tif", (1, 1))
    assert known("slices?spacing=1,1,1") != before


def test_a_full_disk_is_an_error_of_one_line(ball, tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (70, 70, 70)).astype(np.uint8)
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    try:
        with raises(InputError, "unwritable"):
            conversion.convert(level_of(Volume(noise)), tmp_path / "v.zarr")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, hard))
    conversion.convert(level_of(Volume(noise)), tmp_path / "v.zarr")
    assert np.array_equal(load_volume(tmp_path / "v.zarr").values, noise)


def test_the_cache_drops_what_is_needed_last():
    cache = ChunkCache(2)
    one, two, three = (Chunk(0, 0, 0, k) for k in range(3))
    cache.announce([[one], [two], [three], [one]])
    for turn, chunk in enumerate((one, two, three)):
        cache.put(chunk, Held(np.zeros(1, np.uint8), np.ones((1, 1, 1), bool)))
        cache.done(chunk, turn)
    # Of one and two, only one is needed again.
    assert cache.get(one) is not None and cache.get(two) is None and cache.nbytes == 2


@pytest.mark.parametrize("damage", ["missing", *slow_each("truncated", "corrupt", "other")])
def test_a_damaged_chunk_is_named_and_marked(damage, copy, whole):
    big, chunk = opened(copy), copy / CHUNK
    if damage == "missing":
        chunk.unlink()
    elif damage == "other":  # readable, but not what was written
        zarr.open_group(str(copy / "v.zarr"), mode="r+")["0"][64:128, 64:128, 64:128] = 255
    else:
        chunk.write_bytes(chunk.read_bytes()[:200] if damage == "truncated" else bytes(300))
    with pytest.warns(VolspecWarning, match="chunk 1/1/1 of level 0"):
        image = cast(big)
    assert "chunk 1/1/1" in image.notes[GAPS]
    apart = np.abs(image.alpha - whole.alpha) > 1e-3
    assert 0.01 < apart.mean() < 0.6, "only the gap differs"


@pytest.mark.slow
@pytest.mark.parametrize("command", ["render", *slow_each("export", "page")])
def test_commands_say_by_their_exit_status_that_there_are_gaps(command, copy):
    output = {"render": "a.png", "export": "frames", "page": "a.html"}[command]
    (copy / CHUNK).unlink()
    (copy / "s.toml").write_text(SCENE)
    with pytest.raises(SystemExit) as stop, pytest.warns(VolspecWarning):
        main([command, f"{copy}/s.toml", "-o", f"{copy}/{output}", "--size", "32x32"])
    assert stop.value.code == 3 and (copy / output).exists()


POINTS = [(0.5, 0.0, "a"), (160, 0.5, "a")]
LEVEL = "[raycast]\nlevel = 0\n"
SCENE = scene_text({"a": "copper"}, POINTS, file="v.zarr?memory=2MB", more=LEVEL)


def test_a_damaged_chunk_of_the_coarse_level_is_a_gap(copy, big):
    (copy / "v.zarr/1/c/0/0/0").write_bytes(b"short")
    with pytest.warns(VolspecWarning, match="chunk 0/0/0 of level 1"):
        damaged = opened(copy)
    assert (damaged.values != big.values)[:64, :64, :64].mean() > 0
    assert np.array_equal(damaged.values[64:], big.values[64:])
    assert "chunk 0/0/0 of level 1" in cast(damaged, 1).notes[GAPS]


def test_metadata_of_another_program_is_ignored(copy, big):
    edit_metadata(copy, lambda attributes, _: attributes.update(volspec=3))
    assert np.array_equal(opened(copy).values, big.values)


@pytest.mark.parametrize("damage", ["truncated", "reversed", *slow_each("block")])
def test_damaged_ranges_are_ignored(damage, copy, big):
    if damage == "truncated":
        files = (copy / "v.zarr/volspec/ranges/0/c").rglob("*")
        next(file for file in files if file.is_file()).write_bytes(b"short")
    elif damage == "reversed":
        edit_metadata(copy, lambda attributes, _: attributes["volspec"]["ranges"].reverse())
    else:
        edit_metadata(copy, lambda attributes, _: attributes["volspec"].update(block=8))
    with pytest.warns(VolspecWarning, match="volspec/ranges") as said:
        found = opened(copy)
    assert len(said) == 1 and found.pyramid.levels[0].chunk == (64, 64, 64)
    if damage == "block":
        image = cast(found)
        assert GAPS not in image.notes
        assert np.abs(image.coefficients - cast(big).coefficients).max() < 2e-4


@pytest.mark.slow
def test_a_server_is_asked_for_whole_chunks(store):
    with served(store) as (server, asked):
        far = load_volume(f"{server}/v.zarr?memory=2MB")
        asked.clear()
        cast(far)
        # Those at the volume's end, which are not whole, have an index that is read first.
        assert 0 < sum("/0/c/" in path for path in asked) <= 2 * far.pyramid.counts.chunks
    # Which chunks are read with their whole file is a matter of time: some, or none.
    whole = served(store, ranges=False)
    with whole as (server, _), warnings.catch_warnings(record=True, action="always") as told:
        try:
            load_volume(f"{server}/v.zarr?memory=2MB")
            said = str(told[0].message)
        except VolumeError as error:
            said = str(error)
    assert re.search(r"HTTP ranges.*use a server that answers them", said)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["store", "resumed", "raw", "float"])
def test_a_volume_in_parts_is_framed_and_coloured_as_the_whole(kind, ball, tmp_path, monkeypatch):
    values = ball.values * np.float32(0.1) + 1000 if kind == "float" else ball.values
    values.tofile(tmp_path / "v.raw")
    address = f"{tmp_path}/v.raw?shape=161x140x150&dtype={values.dtype}&spacing=1,1,1.5"
    whole = Scene.from_volume(address, preset="bone")
    if kind != "raw":
        level = open_level(address)[0]
        address = f"{tmp_path}/v.zarr"
        if kind == "resumed":
            with monkeypatch.context() as patch:
                patch.setattr(conversion, "_attributes", _interrupt)
                interrupted(level, Path(address))
        conversion.convert(level, Path(address))
    with pytest.warns(VolspecWarning) if kind == "raw" else nullcontext():
        volume = load_volume(f"{address}{'&' if kind == 'raw' else '?'}memory=2MB")
    parts = Scene.from_volume(address, preset="bone", volume=volume)
    assert (parts.file.transfer, parts.file.camera) == (whole.file.transfer, whole.file.camera)
    assert volume.range == load_volume(address).range
    assert summarise(volume).shape == (161, 140, 150)


@pytest.mark.slow
def test_a_store_that_is_there_again_is_read_again(copy, big):
    volume = opened(copy)
    caster = Raycaster(volume)
    (copy / "v.zarr").rename(copy / "away")
    with pytest.warns(VolspecWarning, match=r"chunks cannot be read.*folder is gone"):
        assert cast(volume, caster=caster).notes[GAPS]
    (copy / "away").rename(copy / "v.zarr")
    again = cast(volume, caster=caster)
    assert GAPS not in again.notes
    assert np.array_equal(again.coefficients, cast(big).coefficients)


@pytest.mark.slow
def test_frames_with_gaps_are_made_again(copy):
    kept = (copy / CHUNK).read_bytes()
    (copy / CHUNK).unlink()
    (copy / "s.toml").write_text(SCENE)
    scene = Scene.load(copy / "s.toml").exporting(format="coefficients")
    for made in (1, 1):
        with pytest.warns(VolspecWarning, match="chunk 1/1/1"):
            found = export(scene, copy / "frames", size=(32, 32))
        assert found.gaps and found.made == made
    (copy / CHUNK).write_bytes(kept)
    for made in (1, 0):
        found = export(scene, copy / "frames", size=(32, 32))
        assert not found.gaps and found.made == made


@pytest.mark.slow
def test_a_budget_below_a_part_is_refused_with_one_that_is_enough(store):
    with raises(VolumeError, "size") as error:
        cast(opened(store, "600kB"))
    (least,) = re.findall(r"[\d.]+MiB", error.value.remedy)
    assert cast(opened(store, least)).alpha.any()


Attributes = dict[str, Any]


def edit_metadata(folder: Path, edit: Callable[[Attributes, Attributes], object]) -> Path:
    """Edit the store's attributes and its picture's; return its path."""
    path = folder / "v.zarr/zarr.json"
    found = json.loads(path.read_text())
    edit(found["attributes"], found["attributes"]["ome"]["multiscales"][0])
    path.write_text(json.dumps(found))
    return path.parent


def opened_with(edit: Callable[[Attributes], object]) -> Callable[[Path], object]:
    def make(folder: Path) -> object:
        edit_metadata(folder, lambda _, picture: edit(picture))
        return opened(folder)

    return make


def coarser(scale: list[float], *shift: float) -> Callable[[Path], object]:
    """Open a store whose second level lies elsewhere."""
    moved = {"type": "translation", "translation": shift or (0.5,) * 3}
    steps = [{"type": "scale", "scale": scale}, moved]
    return opened_with(lambda p: p["datasets"][1].update(coordinateTransformations=steps))


def without_a_chunk(folder: Path) -> Path:
    (folder / CHUNK).unlink()
    return folder / "v.zarr"


def copied(volume: Volume, path: Path) -> None:
    conversion.convert(volume.pyramid.levels[0], path)


def in_a_folder_of_others(folder: Path, name: str) -> None:
    """Convert into a folder with a file of somebody else, which stays."""
    shutil.rmtree(folder / "v.zarr")
    (folder / name).mkdir()
    (folder / name / "notes.txt").write_text("mine")
    try:
        conversion.convert(level_of(SMALL), folder / "v.zarr")
    finally:
        assert (folder / name / "notes.txt").read_text() == "mine"


def twice_at_once(folder: Path) -> None:
    with exclusive_folder(folder / "v.zarr.unfinished", "another conversion"):
        conversion.convert(level_of(SMALL), folder / "v.zarr")


def zipped(folder: Path) -> None:
    path = Path(shutil.make_archive(str(folder / "w.zarr"), "zip", folder / "v.zarr"))
    path.write_bytes(path.read_bytes()[:3000])
    load_volume(path)


def missing_on_the_web(folder: Path) -> None:
    with served(folder) as (server, _):
        load_volume(f"{server}/other.zarr")


SMALL = Volume(np.arange(64, dtype=np.uint8).reshape(4, 4, 4))
REFUSED: list[tuple[Callable[[Path], object], type[VolspecError], str]] = [
    # Levels that are not of one picture.
    (coarser([9.0, 2.0, 2.0]), VolumeError, "conflict"),
    (coarser([3.0, 2.0, 2.0], 90.0, 0.5, 0.5), VolumeError, "conflict"),
    (coarser([3.0, -2.0, 2.0]), VolumeError, "damaged"),
    (opened_with(lambda picture: picture["datasets"].reverse()), VolumeError, "conflict"),
    (opened_with(lambda picture: picture.pop("axes")), VolumeError, "damaged"),
    (opened_with(lambda picture: picture["datasets"][0].update(path="x")), VolumeError, "damaged"),
    # A missing chunk is damage without a budget.
    (lambda folder: load_volume(without_a_chunk(folder)), VolumeError, "damaged"),
    (lambda f: copied(opened(without_a_chunk(f).parent), f / "copy.zarr"), VolumeError, "damaged"),
    (zipped, VolumeError, "damaged"),
    (lambda folder: load_volume(folder / "other.zarr.zip"), VolumeError, "not-found"),
    (missing_on_the_web, VolumeError, "damaged"),
    (lambda folder: cast(opened(folder), adaptive=0.01), RaycastError, "unsupported"),
    (lambda folder: cast(opened(folder), 7), RaycastError, "range"),
    (lambda folder: opened(folder).downsampled(2), VolumeError, "conflict"),
    (lambda _: Raycaster(SMALL, device="tcp://typo:1"), RaycastError, "conflict"),
    *((lambda f, m=m: opened(f, m), VolumeError, "syntax") for m in ("much", "-1GB", "0", "2 XB")),
    (lambda folder: in_a_folder_of_others(folder, "v.zarr"), InputError, "conflict"),
    (lambda folder: in_a_folder_of_others(folder, "v.zarr.unfinished"), InputError, "conflict"),
    (twice_at_once, InputError, "state"),
]


@pytest.mark.parametrize(("take", "error", "code"), REFUSED)
def test_what_cannot_be_read_or_cast_in_parts_is_refused(copy, take, error, code):
    with raises(error, code):
        take(copy)
    assert not (copy / "copy.zarr").exists()


def test_every_flipped_bit_is_found(copy):
    data = (copy / CHUNK).read_bytes()
    for at in np.linspace(0, len(data) - 1, 12).astype(int):
        flipped = bytearray(data)
        flipped[at] ^= 4
        (copy / CHUNK).write_bytes(flipped)
        with raises(VolumeError, "damaged"):
            load_volume(copy / "v.zarr")


def test_blocks_hold_the_next_voxels():
    values = np.random.default_rng(0).integers(0, 255, (40, 33, 50)).astype(np.uint8)
    low, high = block_ranges(values)
    for number in np.ndindex(low.shape):
        here = values[tuple(slice(k * BLOCK, (k + 1) * BLOCK + 1) for k in number)]
        assert (low[number], high[number]) == (here.min(), here.max())
