"""Casts as a service: progress, cancel, coarse pictures first, memory, threads, arguments."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises, warns
from volspec.errors import CastCancelled, OpenCLError, RaycastError
from volspec.raycast.gpu import Raycaster
from volspec.raycast.row_batches import Result, RowBatches
from volspec.spectra import light_set, reflectance_set
from volspec.transfer import TransferTable
from volspec.volume import Volume, phantom

BASIS = vs.SpectralBasis.load("general-7")
COPPER = {"copper": vs.reflectance("copper")}
TRANSFER = vs.TransferFunction([(60, 0.0, "copper"), (200, 0.3, "copper")], COPPER, BASIS)


def test_a_cancelled_cast_ends_soon_and_leaves_the_caster_well(
    engine: Volume, engine_table: TransferTable
) -> None:
    """Two bands of 20 ms are in progress, and no other begins."""
    caster, camera = Raycaster(engine), vs.Camera.orbit(engine)
    spec = vs.RaycastSpec()
    before = caster.cast(engine_table, camera, (64, 64), spec)
    answers = [True, False, False, False]
    finished: list[float] = []
    with raises(CastCancelled):
        caster.cast(engine_table, camera, (2048, 2048), spec, finished.append, answers.pop)
    assert answers == [] and len(finished) == 3
    after = caster.cast(engine_table, camera, (64, 64), spec)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_casters_like_each_other_share_programs_and_cast_in_turn(
    engine: Volume, engine_table: TransferTable
) -> None:
    first, ball = Raycaster(engine), phantom.ball(24)
    second = Raycaster(ball, like=first)
    seen = [vs.Camera.orbit(each) for each in (engine, ball)]
    alone = Raycaster(ball).cast(engine_table, seen[1], (48, 32), vs.RaycastSpec())

    def cast(turn: int) -> Result:
        caster, camera = ((first, seen[0]), (second, seen[1]))[turn % 2]
        return caster.cast(engine_table, camera, (48, 32), vs.RaycastSpec())

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(cast, range(12)))
    for result in found[1::2]:
        assert all(np.array_equal(a, b) for a, b in zip(result, alone, strict=True))
    with raises(RaycastError, "conflict"):
        Raycaster(ball, like=first, lanes=1)


def test_bands_grow_and_shrink_with_what_they_cost() -> None:
    result = Result(*(np.empty((640, 64), np.float32) for _ in range(4)))
    bands = RowBatches(None, result, (4, 2), (8, 8), tile_ms=20)
    band = type("Band", (), {"first": 0, "last": 4})()
    assert bands._next_rows(4, band, 1.0) == 8  # no more than twice as many
    assert bands._next_rows(8, band, 40.0) == 2  # 10 ms a row
    assert bands._next_rows(2, band, 800.0) == 1  # never less than one


def test_pictures_come_coarse_first(engine: Volume) -> None:
    camera = vs.Camera.orbit(engine)
    images = list(vs.refine(engine, TRANSFER, camera, (101, 64)))
    assert [image.size for image in images] == [(26, 16), (51, 32), (101, 64)]
    whole = vs.raycast(engine, TRANSFER, camera, (101, 64))
    assert np.array_equal(images[-1].coefficients, whole.coefficients)


def test_half_pictures_differ_by_rounding_only(engine: Volume) -> None:
    camera = vs.Camera.orbit(engine)
    full, half = (
        vs.raycast(engine, TRANSFER, camera, (64, 64), vs.RaycastSpec(half=half))
        for half in (False, True)
    )
    assert half.coefficients.dtype == np.float16
    assert np.array_equal(half.coefficients, full.coefficients.astype(np.float16))
    with vs.Relighter(half) as relighter:
        assert relighter.frame(vs.light("D65")).max() > 60


def test_half_pictures_hold_the_largest_number_where_light_is_beyond_it(engine: Volume) -> None:
    lamp = vs.LightGroup("lamp", (vs.Headlight(1e6),))
    spec = vs.RaycastSpec(half=True, groups=(lamp,))
    with warns("65504"):
        image = vs.raycast(engine, TRANSFER, vs.Camera.orbit(engine), (32, 32), spec)
    assert np.isfinite(image.coefficients).all()


def test_an_edit_of_the_transfer_function_is_not_missed(engine: Volume) -> None:
    """The caster caches the last table that was baked."""
    caster, camera = Raycaster(engine), vs.Camera.orbit(engine)
    edited = replace(TRANSFER, points=[(100, 0.0, "copper"), (200, 0.3, "copper")])
    images = [
        vs.raycast(engine, transfer, camera, (48, 48), caster=caster)
        for transfer in (TRANSFER, edited, TRANSFER)
    ]
    assert not np.array_equal(images[0].alpha, images[1].alpha)
    assert np.array_equal(images[0].alpha, images[2].alpha)


def test_shadows_are_cached_while_only_the_camera_moves(engine: Volume) -> None:
    sun = vs.LightGroup("sun", (vs.Directional((1, 1, 2), shadows=True),))
    spec = vs.RaycastSpec(groups=(sun,), light_cells=32)
    caster = Raycaster(engine)
    filled = []
    fill = caster._lights._fill_extinction
    caster._lights._fill_extinction = lambda *a: (filled.append(a), fill(*a))
    for azimuth in (0, 40, 80):
        camera = vs.Camera.orbit(engine, azimuth_deg=azimuth)
        vs.raycast(engine, TRANSFER, camera, (48, 48), spec, caster=caster)
    assert len(filled) == 1


def test_groups_come_with_their_shares(engine: Volume) -> None:
    sky = vs.LightGroup("sky", (vs.Ambient(),))
    key = vs.LightGroup("key", (vs.Directional((1, 1, 1), frame="camera"),))
    spec = vs.RaycastSpec(ambient=0.25, diffuse=0.75, groups=(sky, key))
    image = vs.raycast(engine, TRANSFER, vs.Camera.orbit(engine), (48, 48), spec)
    assert image.groups == {"sky": 0.25, "key": 0.75}
    assert image.coefficients.shape == (48, 48, 14)
    with vs.Relighter(image) as relighter:
        rig = vs.LightRig((vs.light("A"), vs.light("D65")), groups=("key", "sky"))
        mixed, plain = relighter.frame(rig), relighter.frame(vs.light("D65"))
    assert mixed.shape == (48, 48, 3) and not np.array_equal(mixed, plain)


def test_a_volume_of_too_many_voxels_is_refused_with_the_remedy() -> None:
    """Nothing of its 5 GiB is ever touched: every voxel is the same byte."""
    values = np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (1700,) * 3, (0, 0, 0))
    volume = Volume.__new__(Volume)
    object.__setattr__(volume, "values", values)
    object.__setattr__(volume, "name", "whale")
    with raises(OpenCLError, "size"):
        Raycaster(volume)


@pytest.mark.parametrize(
    ("transfer", "spec"),
    [
        (vs.Isosurfaces([(90, 1, "copper")], COPPER, BASIS), {"mode": "maximum"}),
        (vs.LabelFunction({1: (1, "copper")}, COPPER, BASIS), {"mode": "average"}),
        (vs.LabelFunction({1: (1, "copper")}, COPPER, BASIS), {"preintegrated": True}),
        (vs.Isosurfaces([(90, 1, "copper")], COPPER, BASIS), {"adaptive": 0.1}),
    ],
)
def test_what_does_not_go_together_is_refused(
    transfer: vs.Isosurfaces, spec: dict[str, object]
) -> None:
    volume = Volume(np.zeros((4, 4, 4), np.uint8))
    with raises(RaycastError, "conflict"):
        vs.raycast(volume, transfer, vs.Camera.orbit(volume), spec=vs.RaycastSpec(**spec))


def test_the_error_of_spectral_absorption_is_measured(engine: Volume) -> None:
    """On a grid of 11 bands, whose kernel compiles quicker than that of 31."""
    amber = vs.reflectance("Vrhel/41 marigold orange")
    grid = vs.SpectralGrid(400, 700, 30)
    lights, paints = light_set("smooth", grid), reflectance_set("training", grid)
    fitted = vs.SpectralBasis.fit(lights, paints, 5, positive=True, grid=grid, restarts=0)
    glass = replace(TRANSFER, filters={"copper": amber}, basis=fitted)
    given = vs.Camera.orbit(engine), vs.light("A", grid)
    off = vs.absorption_error(engine, glass, *given, size=(24, 24))
    assert 0 < off.mean < 3
    bands = replace(glass, basis=vs.SpectralBasis.bands(grid))
    assert vs.absorption_error(engine, bands, *given, size=(24, 24)).max < 1e-3


def test_threads_take_turns_with_one_caster(engine: Volume) -> None:
    """A light that moves with the camera is another for each picture."""
    sun = vs.LightGroup("sun", (vs.Directional((1, 1, 1), frame="camera", shadows=True),))
    spec = vs.RaycastSpec(groups=(sun,), light_cells=24)
    caster = Raycaster(engine)
    cameras = [vs.Camera.orbit(engine, azimuth_deg=azimuth) for azimuth in (0, 90, 180, 270)]

    def cast(camera: vs.Camera) -> np.ndarray:
        image = vs.raycast(engine, TRANSFER, camera, (40, 40), spec, caster=caster)
        return np.asarray(image.coefficients)

    alone = [cast(camera) for camera in cameras]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(cast, cameras * 3))
    assert all(np.array_equal(a, b) for a, b in zip(alone * 3, together, strict=True))


def test_a_cast_within_a_cast_is_refused(engine: Volume, engine_table: TransferTable) -> None:
    caster, camera = Raycaster(engine), vs.Camera.orbit(engine)

    def again(_: float) -> None:
        caster.cast(engine_table, camera, (8, 8), vs.RaycastSpec())

    with raises(RaycastError, "state"):
        caster.cast(engine_table, camera, (32, 32), vs.RaycastSpec(), progress=again)
    assert caster.cast(engine_table, camera, (8, 8), vs.RaycastSpec()).alpha.shape == (8, 8)


def test_labels_are_whole_numbers() -> None:
    volume = phantom.ball(8)
    labels = vs.LabelFunction({1: (1, "copper")}, COPPER, BASIS)
    with raises(RaycastError, "type"):
        vs.raycast(volume, labels, vs.Camera.orbit(volume), (8, 8))


@pytest.mark.parametrize(
    "given",
    [
        {"transfer": None},
        {"camera": (1, 2, 3)},
        {"spec": {}},
        {"spec": np.eye(4)},
        {"caster": np.eye(4)},
        {"into": np.eye(4)},
        {"progress": 3},
        {"cancel": 3},
        {"notes": 3},
        {"notes": {"dose": 3}},
    ],
    ids=str,
)
def test_arguments_of_another_type_are_named(given: dict[str, object]) -> None:
    volume = phantom.ball(8)
    good = {"transfer": TRANSFER, "camera": vs.Camera.orbit(volume)}
    with raises(RaycastError) as refused:
        vs.raycast(volume, **(good | given))
    assert str(refused.value).startswith(f"raycast: {next(iter(given))}")
    assert "|" not in str(refused.value) and "volspec." not in str(refused.value)


def test_the_path_of_a_volume_is_not_a_volume() -> None:
    with raises(vs.InputError) as caught:
        vs.raycast("engine.nrrd", TRANSFER, vs.Camera.orbit(phantom.ball(8)))
    assert "load_volume" in str(caught.value)


@pytest.mark.parametrize("coarsest", [0, True, 2.0, "4"])
def test_the_coarsest_picture_s_divisor_is_a_whole_number(coarsest: object) -> None:
    volume = phantom.ball(8)
    with raises(RaycastError, field="refine: coarsest"):
        next(vs.refine(volume, TRANSFER, vs.Camera.orbit(volume), coarsest=coarsest))


SIZES = [5, None, (40,), (40, 40, 3), (40, "a"), (40.5, 40), (0, 40), (10**6, 10**6), "big"]


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_caster_refuses_sizes_and_what_it_cannot_call(
    engine_table: TransferTable, size: object
) -> None:
    """A size under the name of the function that was called."""
    volume = phantom.ball(8)
    camera, caster = vs.Camera.orbit(volume), Raycaster(volume)
    with raises(RaycastError) as caught:
        list(vs.refine(volume, TRANSFER, camera, size))
    assert str(caught.value).startswith("refine: ")
    with raises(RaycastError):
        caster.cast(engine_table, camera, size, vs.RaycastSpec())
    for name in ("progress", "cancel"):
        with raises(RaycastError, "type", f"raycast: {name}"):
            caster.cast(engine_table, camera, (8, 8), vs.RaycastSpec(), **{name: 3})


def test_a_setting_that_is_none_of_refine_s_is_named_as_such() -> None:
    volume = phantom.ball(8)
    with pytest.raises(TypeError) as caught:
        vs.refine(volume, TRANSFER, vs.Camera.orbit(volume), bogus=1)
    assert "refine()" in str(caught.value) and "'bogus'" in str(caught.value)


@pytest.mark.parametrize(
    "given",
    [
        {"lanes": [8]},
        {"lanes": 0},
        {"lanes": True},
        {"lanes": 8.0},
        {"lanes": "8"},
        {"volume": np.eye(4)},
        {"context": np.eye(4)},
    ],
    ids=str,
)
def test_a_caster_names_what_it_cannot_be_made_of(given: dict[str, object]) -> None:
    with raises(RaycastError, field=f"Raycaster: {next(iter(given))}"):
        Raycaster(**({"volume": phantom.ball(8)} | given))


@pytest.mark.parametrize("device", [3, b"cpu", ["cpu"]])
def test_a_device_that_is_no_name_is_refused(device: object) -> None:
    volume = phantom.ball(8)
    for cast in (vs.raycast, lambda *a, **k: list(vs.refine(*a, **k))):
        with raises(OpenCLError, field="device"):
            cast(volume, TRANSFER, vs.Camera.orbit(volume), (8, 8), device=device)
