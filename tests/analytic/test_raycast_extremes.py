"""Known answers at the limits: constant volumes, clear matter, far lights."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import refuses
from tests.support.raycasts import WHOLE, along_z, chords_mm, cube, fog, labelled, turned
from volspec.errors import CameraError, RaycastError
from volspec.raycast import reference
from volspec.raycast.launch.row_batches import Result
from volspec.raycast.lights import Source
from volspec.transfer import TransferTable

Cast = Callable[..., Result | reference.Result]


CASTS = [lambda volume, *given: vs.Raycaster(volume).cast(*given), reference.cast]
BOTH = pytest.mark.parametrize("cast", CASTS, ids=["kernel", "reference"])


@pytest.mark.slow
def test_a_constant_volume_has_no_gradient_in_a_table_of_gradients():
    volume = cube(9)
    rows = np.linspace(0.1, 0.9, 9)[:, None] * np.ones(2)
    table = TransferTable((0.0, 2.0), rows, np.ones((9, 2, 1)), 1.0, gradient_top=4.0)
    alpha = vs.Raycaster(volume).cast(table, along_z(volume), (5, 5), WHOLE).alpha
    assert np.abs(alpha - (1 - 0.9**8)).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["maximum", "average"])
def test_projections_know_no_shadows(mode):
    """Every source counts as faced: the picture is the same with shadows and without."""
    values = np.zeros((17, 17, 17), np.uint8)
    values[4:13, 4:13, 4:13] = 2
    volume = vs.Volume(values)
    camera, caster = vs.Camera.orbit(volume, elevation_deg=-30), vs.Raycaster(volume)
    pictures = []
    for shadows in (False, True):
        sun = vs.LightGroup("sun", vs.Directional((0, 0, 1), shadows=shadows))
        spec = vs.RaycastSpec(mode=mode, groups=sun)
        pictures.append(caster.cast(fog(0.9), camera, (24, 24), spec).coefficients)
    assert np.array_equal(*pictures)


@pytest.mark.parametrize("base", [100.0, 1000.0])
def test_values_beyond_the_table_take_its_end_preintegrated_too(base):
    """A table that ends at opacity 0.1 is even fog to noise beyond it: Beer-Lambert."""
    noise = 0.01 * np.random.default_rng(0).normal(size=(12, 12, 12))
    volume = vs.Volume((base + noise).astype(np.float32))
    table = TransferTable((0.0, 1.0), np.full(1024, 0.1), np.ones((1024, 1)), 1.0)
    spec = replace(WHOLE, preintegrated=True)
    alpha = vs.Raycaster(volume).cast(table, along_z(volume), (24, 24), spec).alpha
    assert np.abs(alpha - (1 - 0.9**11)).max() < 1e-4


@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_a_plane_cuts_whatever_the_length_of_its_normal(length):
    volume = cube(9)
    spec = replace(WHOLE, clip_planes=(vs.ClipPlane((4, 4, 4), (0, 0, length)),))
    alpha = vs.Raycaster(volume).cast(fog(0.1), along_z(volume), (5, 5), spec).alpha
    assert np.abs(alpha - (1 - 0.9**4)).max() < 1e-5


def lit_by(source: Source) -> np.ndarray:
    """Coefficients of a ball in fog."""
    volume, spec = vs.phantom.ball(16), vs.RaycastSpec(groups=vs.LightGroup("lamp", source))
    return vs.Raycaster(volume).cast(fog(0.1), vs.Camera.orbit(volume), (16, 16), spec).coefficients


@pytest.mark.slow
@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_a_light_shines_whatever_the_length_of_its_direction(length):
    one, other = (lit_by(vs.Directional((scale, -scale, 0))) for scale in (1.0, length))
    assert np.abs(one - other).max() < 1e-6


@pytest.mark.slow
def test_a_lamp_very_far_away_is_a_light_far_away():
    """At the greatest distance allowed; rays of 1e8 diagonals are parallel to 1e-8."""
    lamp = vs.Point((0.9e9 * 26, 0, 0), falloff_mm=0.9e9 * 26)
    assert np.abs(lit_by(vs.Directional((1, 0, 0))) - lit_by(lamp)).max() < 1e-5


FAR = vs.Camera.orbit(vs.phantom.ball(16))


@BOTH
@pytest.mark.parametrize(
    ("given", "kind", "field"),
    [
        (vs.Point((1e20, 0, 0)), RaycastError, "its distance"),
        (vs.Point((0, 1e20, 0), frame="camera"), RaycastError, "its distance"),
        (vs.Point((9, 0, 0), falloff_mm=1e20), RaycastError, "falloff_mm"),
        (vs.Point((9, 0, 0), falloff_mm=1e-20), RaycastError, "falloff_mm"),
        (replace(FAR, position_mm=(1e20, 0, 0)), CameraError, "position_mm to target_mm"),
        (vs.Camera((1e20, 9, 0), (1e20, 0, 0)), CameraError, "target_mm to the volume"),
        (replace(FAR, height_mm=1e20), CameraError, "height_mm"),
    ],
)
def test_farther_than_squares_are_numbers_is_refused_by_name(cast, given, kind, field):
    camera, spec, subject = given, WHOLE, "camera"
    if isinstance(given, vs.Point):
        spec = vs.RaycastSpec(groups=(vs.LightGroup("lamp", (given,)),))
        camera, subject = FAR, "point light of 'lamp'"
    call = partial(cast, vs.phantom.ball(16), fog(0.1), camera, (4, 4), spec)
    refuses(call, f"range {subject}: {field}", kind)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(
    ("opacity", "filtered"), [(0.5, 0.5), (1.0, 0.5), (0.5, 1.0), (0.9, 0.5), (1.0, 0.0)]
)
def test_filtered_fog_reflects_the_same_at_any_step(cast, opacity, filtered):
    """A homogeneous body reflects its loss, s (1 − t^depth), and no more than all light."""
    volume = cube(17)
    table = fog(opacity, share=0.8, filters=np.full((8, 4), filtered))
    taken = 1 - (1 - opacity * (1 - filtered)) ** 16
    for step in (1.0, 0.7, 0.25):
        given = table, along_z(volume), (5, 5), replace(WHOLE, step_mm=step)
        coefficients, alpha, *_ = cast(volume, *given)
        assert np.abs(alpha - taken).max() < 1e-5
        assert np.abs(coefficients - 0.8 * taken).max() < 1e-5


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("step_mm", [0.25, 0.6, 2.0])
def test_every_channel_of_a_filtered_body_takes_what_beer_lambert_says(cast, step_mm):
    """T_k = (1 − opacity (1 − filter_k))^length, channel k reflects its loss, α is their mean."""
    volume, filters = cube(17), np.tile([0.0, 0.3, 0.9, 1.0], (8, 1))
    camera, size = turned(volume, 33, 12), (16, 16)
    given = fog(0.2, filters=filters), camera, size, replace(WHOLE, step_mm=step_mm)
    coefficients, alpha, *_ = cast(volume, *given)
    lost = 1 - (1 - 0.2 * (1 - filters[0])) ** chords_mm(volume, camera, size)[..., None]
    assert np.abs(coefficients - lost).max() < 1e-5
    assert np.abs(alpha - lost.mean(axis=-1)).max() < 1e-5


@pytest.mark.slow
@BOTH
def test_grey_filters_are_flat_absorption(cast):
    at = np.linspace(0, 0.6, 256)
    flat = TransferTable((0.0, 1.0), at, np.full((256, 4), 0.7), 1.0)
    grey = replace(flat, filters=np.zeros((256, 4)))
    ball = vs.phantom.ball(16)
    one, other = (cast(ball, table, FAR, (12, 12), WHOLE) for table in (flat, grey))
    assert np.abs(one[0] - other[0]).max() < 1e-5
    assert np.abs(one[1] - other[1]).max() < 1e-5


@pytest.mark.slow
@BOTH
def test_labels_that_a_table_has_not_are_nothing(cast):
    """Below 0 as beyond its last; label 0 itself is seen."""
    table = labelled([0.1] * 3, np.ones((3, 1)))
    for label, opacity in ((-1, 0.0), (-300, 0.0), (3, 0.0), (0, 1 - 0.9**8), (2, 1 - 0.9**8)):
        volume = vs.Volume(np.full((9, 9, 9), label, np.int16))
        alpha = cast(volume, table, along_z(volume), (5, 5), WHOLE)[1]
        assert np.abs(alpha - opacity).max() < 1e-5


def test_the_reference_of_opaque_labels_is_a_picture():
    volume = vs.Volume(np.random.default_rng(0).integers(1, 3, (7, 8, 9)).astype(np.uint8))
    given = labelled([0, 1, 1]), turned(volume, 33, 21), (24, 24), WHOLE
    assert all(np.isfinite(each).all() for each in reference.cast(volume, *given)[:2])


@pytest.mark.slow
def test_long_steps_know_that_labels_beyond_the_table_are_nothing():
    """Plates of label 2 and of 9, which the table has not: the opacity varies in every brick."""
    values = np.full((24, 24, 24), 2, np.uint8)
    values[::3] = 9
    volume, table = vs.Volume(values), labelled([0, 0, 0.3])
    camera, caster = vs.Camera.orbit(volume), vs.Raycaster(volume)
    whole, long = (
        caster.cast(table, camera, (24, 24), replace(WHOLE, adaptive=a)).alpha for a in (0, 1e-6)
    )
    assert np.array_equal(whole, long)


@pytest.mark.slow
@pytest.mark.parametrize("preintegrated", [False, True])
def test_a_homogeneous_body_is_the_same_in_long_steps(preintegrated):
    """Steps of four are four steps, and end with the brick and the chord.

    A hundred float32 multiplications bound the difference near 6e-6; measured 7e-7.
    """
    values = np.random.default_rng(0).uniform(0, 2, (20, 21, 22))
    volume, table = vs.Volume(values.astype(np.float32)), fog(0.07)
    camera, caster = vs.Camera.orbit(volume), vs.Raycaster(volume)
    for jitter in (0, 1):
        spec = replace(WHOLE, preintegrated=preintegrated, jitter=jitter)
        whole, long = (
            caster.cast(table, camera, (25, 25), replace(spec, adaptive=a)).alpha for a in (0, 0.01)
        )
        assert np.abs(whole - long).max() < 6e-6


@pytest.mark.slow
def test_a_caster_of_many_pictures_remembers_none():
    """Every order of tables, lights and cuts gives the same pictures, equal to the twin's."""
    rng = np.random.default_rng(2)
    volume = vs.Volume(rng.uniform(0, 2, (12, 13, 14)).astype(np.float32))
    camera, caster, tables = vs.Camera.orbit(volume), vs.Raycaster(volume), (fog(0.2), fog(0.6))
    ways, cuts = ((1, 2, 3), (-1, 0, 1)), (None, ((0.0, 9.0), (2.0, 20.0), (0.0, 20.0)))
    first: dict[tuple[int, ...], Result] = {}
    kinds = [*itertools.product((0, 1), repeat=3)]
    for t, g, c in [*kinds, *rng.permutation(kinds).tolist()]:
        light = vs.LightGroup("light", vs.Directional(ways[g], shadows=True))
        spec = vs.RaycastSpec(groups=light, light_cells=8, crop_voxels=cuts[c])
        picture = caster.cast(tables[t], camera, (9, 9), spec)
        if (t, g, c) in first:
            before = first[t, g, c]
            assert all(np.array_equal(a, b) for a, b in zip(before, picture, strict=True))
        else:
            first[t, g, c] = picture
            true = reference.cast(volume, tables[t], camera, (9, 9), spec)
            assert np.abs(picture.coefficients - true[0]).max() < 1e-4
    assert len({p.coefficients.tobytes() for p in first.values()}) == len(kinds)
