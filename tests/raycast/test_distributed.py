"""Casts on a Dask cluster: the picture of one machine, whatever becomes of the workers."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import raises
from tests.support.fixtures import slow
from tests.support.pyramids import stored
from tests.support.window import ENGINE
from tests.twins.test_parts import LIT, VEIL
from volspec.camera import Camera
from volspec.errors import DeviceError, RaycastError, VolumeError
from volspec.export.exporter import export
from volspec.large import cluster as distributed
from volspec.large.cluster import PartialPicture
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.scene import Scene
from volspec.volume import Volume, load_volume

# Rays of a part end by what the part itself hides; with alpha_stop 1 none ends early.
SPEC = RaycastSpec(step_mm=1.0, alpha_stop=1.0, level=0)
LIT_SPEC = replace(SPEC, groups=LIT)
SIZE = 64, 56


@pytest.fixture(scope="module")
def engine() -> Volume:
    return load_volume("engine")


@pytest.fixture(scope="module")
def caster(engine: Volume, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Raycaster]:
    """Return a caster with two workers, of an engine of which parts are read."""
    made = Raycaster(stored(engine, tmp_path_factory.mktemp("store"), "4MB"), device="local:2")
    yield made
    made.cluster.close()


def workers(caster: Raycaster) -> list[int]:
    """Return the process numbers of the workers."""
    return sorted(caster.cluster.client.run(os.getpid).values())


@pytest.mark.parametrize("spec", [SPEC, slow(LIT_SPEC)])
def test_the_picture_is_that_of_one_machine(engine, caster, spec):
    camera = Camera.orbit(engine, azimuth_deg=200)
    whole = raycast(engine, VEIL, camera, SIZE, spec)
    told: list[float] = []
    given = caster.volume, VEIL, camera, SIZE, spec
    far = raycast(*given, caster=caster, progress=told.append)
    assert np.abs(whole.coefficients - far.coefficients).max() < 2e-4
    assert np.abs(whole.alpha - far.alpha).max() < 2e-4
    seen = whole.alpha > 0.01
    assert np.allclose(whole.depth_mm[seen], far.depth_mm[seen], atol=2e-2)
    assert np.array_equal(np.isfinite(whole.first_mm), np.isfinite(far.first_mm))
    hit = np.isfinite(whole.first_mm)
    assert np.abs(whole.first_mm[hit] - far.first_mm[hit]).max() < 1e-3
    assert told == sorted(told) and told[-1] == 1.0


@pytest.mark.slow
def test_a_killed_worker_changes_nothing(engine, caster, monkeypatch):
    given = caster.volume, VEIL, Camera.orbit(engine), SIZE, SPEC
    calm = raycast(*given, caster=caster)
    killed = workers(caster)[0]
    own = distributed.ClusterCaster._wait

    def wait(*given: object) -> None:
        with suppress(ProcessLookupError):  # killed before
            os.kill(killed, signal.SIGKILL)  # all parts are with the workers
        own(*given)

    monkeypatch.setattr(distributed.ClusterCaster, "_wait", wait)
    picture = raycast(*given, caster=caster)
    assert killed not in workers(caster)
    assert np.array_equal(picture.coefficients, calm.coefficients)


@pytest.mark.slow
def test_frames_of_an_export_are_cast_side_by_side(caster, tmp_path, monkeypatch):
    scene = Scene.load(ENGINE).exporting(turntable={"frames": 3}, lights=["D65"])
    monkeypatch.setattr(scene, "raycast", replace(SPEC, groups=scene.raycast.groups))
    running, under_way = [], []
    own = distributed.ClusterCaster._wait

    def wait(*given: object) -> None:
        running.append(given)
        under_way.append(len(running))
        own(*given)
        running.pop()

    monkeypatch.setattr(distributed.ClusterCaster, "_wait", wait)
    exported = export(scene, tmp_path / "far", size=SIZE, caster=caster)
    assert exported.made == 3 and exported.casts == 3 and max(under_way) == 2
    export(scene, tmp_path / "near", size=SIZE, caster=Raycaster(caster.volume))
    for name in exported.files:
        pictures = [Image.open(tmp_path / each / name) for each in ("far", "near")]
        far, whole = (np.asarray(each.convert("RGB"), int) for each in pictures)
        assert np.abs(far - whole).max() <= 1


def test_too_little_memory_is_refused_as_on_one_machine(engine, caster, tmp_path, monkeypatch):
    small = stored(engine, tmp_path, "300KiB")
    given = small, VEIL, Camera.orbit(engine), (700, 700), SPEC
    texts = []
    for cluster in (None, caster.cluster):
        own = Raycaster(small)
        monkeypatch.setattr(own, "cluster", cluster)
        with raises(VolumeError, "size") as caught:
            raycast(*given, caster=own)
        texts.append(str(caught.value))
    assert texts[0] == texts[1]


def test_threads_share_one_connection(monkeypatch):
    monkeypatch.setattr(distributed.Cluster, "_connect", lambda _: [2 * k for k in range(10**6)])
    cluster = distributed.Cluster("local:1")
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(lambda _: cluster.client, range(2))
    assert one is other


def test_another_version_and_addresses_without_a_cluster_are_refused(engine, caster, monkeypatch):
    import distributed as dask

    import volspec

    given = caster.volume, VEIL, Camera.orbit(engine), SIZE, SPEC
    for address in ("local:0", "local:many"):
        with raises(DeviceError, "syntax"):
            raycast(*given, device=address)

    def connect(address: str, **settings: object) -> None:
        raise OSError(f"Timed out trying to connect to {address}")

    monkeypatch.setattr(dask, "Client", connect)
    with raises(DeviceError, "unsupported"):
        raycast(*given, device="tcp://127.0.0.1:9")
    monkeypatch.undo()
    monkeypatch.setattr(volspec, "__version__", "0.0.0")
    other = Raycaster(caster.volume, like=caster)  # as a program of that version makes it
    with raises(RaycastError, "conflict"):
        raycast(*given, caster=other)


def test_over_is_associative():
    random = np.random.default_rng(0)

    def picture(x: int, y: int) -> PartialPicture:
        alpha = random.uniform(0, 0.6, (4, 5)).astype(np.float32)
        channels = random.uniform(0, 1, (4, 5, 3)).astype(np.float32) * alpha[..., None]
        far = np.full((4, 5), np.inf, np.float32)
        return PartialPicture((x, y, x + 5, y + 4), channels, alpha, alpha * 7, far, 1 - alpha, {})

    a, b, c = picture(0, 0), picture(2, 1), picture(1, 3)
    left, right = (a.over(b)).over(c), a.over(b.over(c))
    assert left.rect == right.rect == (0, 0, 7, 7)
    for name in ("coefficients", "alpha", "depth", "transmittance"):
        assert np.allclose(getattr(left, name), getattr(right, name), atol=1e-6)
    assert np.allclose(left.transmittance, 1 - left.alpha, atol=1e-6)


def test_runs_are_neighbours_of_like_size(engine, caster):
    level = caster.at(Camera.orbit(engine), SIZE, SPEC)
    parts = level.plan(caster.bake(VEIL), Camera.orbit(engine), SIZE, SPEC)
    runs = distributed.runs(parts, 4)
    assert [part for run in runs for part in run] == parts and len(runs) <= 4
    work = [sum(part.work for part in run) for run in runs]
    assert max(work) < 2.5 * np.mean(work)
