"""Casts as a service: progress, cancel, coarse pictures first, memory, threads, arguments."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises, refuses, warns
from volspec.errors import CastCancelled, RaycastError
from volspec.large import Raycaster
from volspec.raycast.launch.light_volume import LightVolume
from volspec.raycast.launch.row_batches import Result, RowBatches
from volspec.spectra import light_set, reflectance_set
from volspec.volume import Volume, phantom

COPPER = {"copper": vs.reflectance("copper")}
SKY = vs.LightGroup("sky", vs.Ambient())
BASIS = vs.MaterialBasis(COPPER)
TRANSFER = vs.TransferFunction([(60, 0.0, "copper"), (200, 0.3, "copper")], COPPER, BASIS)


def test_a_cancelled_or_nested_cast_ends_soon_and_leaves_the_caster_well(engine, three_channels):
    """Two bands of 20 ms are in progress, and no other begins."""
    caster, camera = Raycaster(engine), vs.Camera.orbit(engine)
    given = three_channels, camera, (64, 64), vs.RaycastSpec()
    before = caster.cast(*given)
    answers = [True, False, False, False]
    finished: list[float] = []
    large = three_channels, camera, (2048, 2048), vs.RaycastSpec()
    with raises(CastCancelled):
        caster.cast(*large, finished.append, answers.pop)
    assert answers == [] and len(finished) == 3
    with raises(RaycastError, "state"):
        caster.cast(*given, progress=lambda _: caster.cast(*given))
    after = caster.cast(*given)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


@pytest.mark.slow
def test_casters_like_each_other_share_programs_and_cast_in_turn(engine, three_channels):
    first, ball = Raycaster(engine), phantom.ball(24)
    second = Raycaster(ball, like=first)
    seen = [vs.Camera.orbit(each) for each in (engine, ball)]
    alone = Raycaster(ball).cast(three_channels, seen[1], (48, 32), vs.RaycastSpec())

    def cast(turn: int) -> Result:
        caster, camera = ((first, seen[0]), (second, seen[1]))[turn % 2]
        return caster.cast(three_channels, camera, (48, 32), vs.RaycastSpec())

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(cast, range(12)))
    for result in found[1::2]:
        assert all(np.array_equal(a, b) for a, b in zip(result, alone, strict=True))


def test_bands_grow_and_shrink_with_what_they_cost():
    result = Result(*(np.empty((640, 64), np.float32) for _ in range(4)))
    bands = RowBatches(None, result, (4, 2), (8, 8), tile_ms=20)
    band = type("Band", (), {"first": 0, "last": 4})()
    assert bands._next_rows(4, band, 1.0) == 8  # no more than twice as many
    assert bands._next_rows(8, band, 40.0) == 2  # 10 ms a row
    assert bands._next_rows(2, band, 800.0) == 1  # never less than one


def picture(volume: Volume, transfer: Any = TRANSFER, **more: Any) -> vs.CoefficientImage:
    """48 x 48 pixels, from an angle and with settings of a RaycastSpec."""
    camera = vs.Camera.orbit(volume, azimuth_deg=more.pop("azimuth_deg", 0.0))
    caster = more.pop("caster", None)
    return vs.raycast(volume, transfer, camera, (48, 48), vs.RaycastSpec(**more), caster=caster)


def test_pictures_come_coarse_first(engine):
    camera = vs.Camera.orbit(engine)
    images = list(vs.refine(engine, TRANSFER, camera, (101, 64)))
    assert [image.size for image in images] == [(26, 16), (51, 32), (101, 64)]
    whole = vs.raycast(engine, TRANSFER, camera, (101, 64))
    assert np.array_equal(images[-1].coefficients, whole.coefficients)


def test_half_pictures_differ_by_rounding_only_and_hold_the_largest_number(engine):
    full, half = (picture(engine, half=half) for half in (False, True))
    assert half.coefficients.dtype == np.float16
    assert np.array_equal(half.coefficients, full.coefficients.astype(np.float16))
    with vs.Relighter(half) as relighter:
        assert relighter.frame(vs.light("D65")).max() > 60
    with warns("65504"):
        bright = picture(engine, half=True, groups=vs.LightGroup("lamp", vs.Headlight(1e6)))
    assert np.isfinite(bright.coefficients).all()


def test_an_edit_of_the_transfer_function_is_not_missed(engine):
    """The caster caches the last table that was baked."""
    caster = Raycaster(engine)
    edited = replace(TRANSFER, points=[(100, 0.0, "copper"), (200, 0.3, "copper")])
    functions = TRANSFER, edited, TRANSFER
    one, other, again = (picture(engine, each, caster=caster).alpha for each in functions)
    assert not np.array_equal(one, other) and np.array_equal(one, again)


def test_shadows_are_cached_while_only_the_camera_moves(engine, monkeypatch):
    lights = SKY, vs.LightGroup("sun", vs.Directional((1, 1, 2), shadows=True))
    caster, filled = Raycaster(engine), []
    fill = LightVolume._fill_extinction
    monkeypatch.setattr(LightVolume, "_fill_extinction", lambda *a: (filled.append(a), fill(*a)))
    for azimuth in (0, 40, 80):
        picture(engine, azimuth_deg=azimuth, groups=lights, light_cells=32, caster=caster)
    assert len(filled) == 1


def test_threads_take_turns_with_one_caster(engine):
    """A light that moves with the camera is another for each picture."""
    key = vs.LightGroup("key", vs.Directional((1, 1, 1), frame="camera", shadows=True))
    caster, azimuths = Raycaster(engine), (0, 90, 180, 270)

    def cast(azimuth_deg: float) -> np.ndarray:
        how = {"groups": (SKY, key), "light_cells": 24, "caster": caster}
        return picture(engine, azimuth_deg=azimuth_deg, **how).coefficients

    alone = [cast(azimuth) for azimuth in azimuths]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(cast, azimuths * 3))
    assert all(np.array_equal(a, b) for a, b in zip(alone * 3, together, strict=True))


def test_groups_come_with_their_shares(engine):
    key = vs.LightGroup("key", vs.Directional((1, 1, 1), frame="camera", shadows=True))
    image = picture(engine, ambient=0.25, diffuse=0.75, groups=(SKY, key), light_cells=24)
    assert image.groups == {"sky": 0.25, "key": 0.75}
    assert image.coefficients.shape == (48, 48, 2 * BASIS.size)


@pytest.mark.slow
def test_the_error_of_spectral_absorption_is_measured(engine):
    """On a grid of 6 bands, whose kernel compiles quicker than that of 31."""
    amber = vs.reflectance("Vrhel/41 marigold orange")
    grid = vs.SpectralGrid(400, 700, 60)
    lights, paints = light_set("smooth", grid), reflectance_set("training", grid)
    fitted = vs.SpectralBasis.fit(lights, paints, 3, positive=True, grid=grid, restarts=0)
    glass = replace(TRANSFER, filters={"copper": amber}, basis=fitted)
    bands = replace(glass, basis=vs.SpectralBasis.bands(grid))
    given = vs.Camera.orbit(engine), vs.light("A", grid)
    measured = partial(vs.absorption_error, engine, size=(24, 24))
    off, none = (measured(transfer, *given) for transfer in (glass, bands))
    assert 0 < off.mean < 3 and none.max < 1e-3


SMALL = phantom.ball(8)
VIEW = vs.Camera.orbit(SMALL)
ZEROS = Volume(np.zeros((4, 4, 4), np.uint8))
SURFACES = vs.Isosurfaces([(90, 1, "copper")], COPPER, BASIS)
LABELS = vs.LabelFunction({1: (1, "copper")}, COPPER, BASIS)
Make = Callable[[], object]


def cast(volume: Any = SMALL, transfer: Any = TRANSFER, camera: Any = VIEW, **more: Any) -> Make:
    spec = more.pop("spec", vs.RaycastSpec())
    return lambda: vs.raycast(volume, transfer, camera, (8, 8), spec, **more)


def refined(size: Any = (8, 8), **more: Any) -> Make:
    return lambda: list(vs.refine(SMALL, TRANSFER, VIEW, size, **more))


def by_caster(size: Any = (8, 8), **more: Any) -> Make:
    table = TRANSFER.bake(1.0)
    return lambda: Raycaster(SMALL).cast(table, VIEW, size, vs.RaycastSpec(), **more)


def whale() -> Volume:
    """Nothing of its 5 GiB is ever touched: every voxel is the same byte."""
    values = np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (1700,) * 3, (0, 0, 0))
    volume = Volume.__new__(Volume)
    object.__setattr__(volume, "values", values)
    object.__setattr__(volume, "name", "whale")
    return volume


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (partial(Raycaster, whale()), "size "),
        *((partial(Raycaster, SMALL, lanes=n), "range Raycaster: lanes") for n in (3, 0)),
        (lambda: Raycaster(SMALL, like=Raycaster(SMALL), lanes=1), "conflict "),
        (cast(transfer=SURFACES, spec=vs.RaycastSpec(mode="maximum")), "conflict "),
        (cast(transfer=SURFACES, spec=vs.RaycastSpec(adaptive=0.1)), "conflict "),
        (cast(ZEROS, LABELS, spec=vs.RaycastSpec(mode="average")), "conflict "),
        (cast(ZEROS, LABELS, spec=vs.RaycastSpec(preintegrated=True)), "conflict "),
        (cast(transfer=LABELS), "type "),
        (cast("engine.nrrd"), "type "),
        (partial(Raycaster, "engine.nrrd"), "type "),
        *((cast(**{name: 3}), f"type raycast: {name}") for name in ("transfer", "camera")),
        (cast(device=b"cpu"), "invalid device"),
        (refined(device=3), "invalid device"),
        (refined(coarsest=0), "range refine: coarsest"),
        (refined(5), "type refine: size"),
        (refined((40, 40, 3)), "type refine: size"),
        (refined((0, 40)), "range "),
        (by_caster((10**6, 10**6)), "range "),
    ],
)
def test_what_cannot_be_cast_is_refused_by_name(make, fault):
    refuses(make, fault)


def test_a_setting_that_is_none_of_refine_s_is_named_as_such():
    with pytest.raises(TypeError, match=r"refine\(\).*'bogus'"):
        vs.refine(SMALL, TRANSFER, VIEW, bogus=1)
