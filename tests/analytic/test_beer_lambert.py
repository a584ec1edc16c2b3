"""Homogeneous matter has an exact answer along every ray, however short, dense or faint."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.fixtures import slow
from tests.support.raycasts import FLAT, WHOLE, chords_mm, cube, fog, turned
from volspec.camera import Camera
from volspec.large import Raycaster
from volspec.raycast import RaycastSpec, reference
from volspec.transfer import TransferTable
from volspec.volume import Volume, phantom

SIDE = 14
LANES = pytest.mark.parametrize("lanes", [1, 8])
# Each is a kernel of its own, which takes seconds to compile.
KINDS = pytest.mark.parametrize(
    ("kind", "lanes"),
    [
        *(("values", 1), ("values", 8)),
        *(slow("rows", lanes) for lanes in (1, 8)),
        *(slow("labels", lanes) for lanes in (1, 8)),
    ],
)


@pytest.mark.parametrize("step_mm", [0.25, 0.5, 0.7, 1.3])
@pytest.mark.parametrize("view", [(0, 90), (0, 0), (37, 23)])
def test_homogeneous_slab_matches_beer_lambert(step_mm, view):
    """Whatever the step, its phase and the angle: clipped steps make the product exact.

    About a hundred float32 multiplications bound the error near 6e-6; measured 3e-6.
    """
    volume = phantom.slab(size=32, thickness=16)
    camera, size = turned(volume, *view), (48, 40)
    given = fog(0.05, share=0.5), camera, size, replace(WHOLE, step_mm=step_mm)
    coefficients, alpha, *_ = Raycaster(volume).cast(*given)
    expected = 1 - 0.95 ** chords_mm(volume, camera, size)
    assert np.abs(alpha - expected).max() < 1e-5
    assert np.abs(coefficients - 0.5 * expected[..., None]).max() < 1e-5


def test_opacity_holds_per_reference_step_whatever_the_spacing():
    """Halving the voxels but not the millimetres leaves the picture as it is."""
    coarse = Volume(np.ones((9, 9, 9), np.float32), spacing_mm=(2, 2, 2))
    camera, table = Camera.orbit(coarse), fog(0.1, reference_step_mm=2.0)
    one, other = (Raycaster(v).cast(table, camera, (32, 32), WHOLE)[1] for v in (coarse, cube(17)))
    assert np.abs(one - other).max() < 1e-5


def test_depth_of_an_opaque_wall_is_its_distance():
    """Parallel rays onto a wall of full opacity stop within half a step of its face."""
    volume = phantom.slab(size=16, thickness=8)
    camera = turned(volume, 0, 90, orthographic=True)
    _, alpha, depth, _ = Raycaster(volume).cast(fog(1.0), camera, (33, 33), WHOLE)
    face = camera.position_mm[2] - 8.0
    assert alpha[16, 16] == 1
    assert abs(depth[16, 16] - face) <= 0.25 + 1e-4
    assert np.isinf(depth[0, 0]) and alpha[0, 0] == 0


RIGHT_ANGLES = [
    *((azimuth, 0) for azimuth in (0, 90, 180, 270, -90, 450, 36090)),
    *((azimuth, elevation) for azimuth in (0, 90, 270) for elevation in (90, -90)),
]


@pytest.mark.parametrize("lanes", [1, 8, None])
@pytest.mark.parametrize(("azimuth", "elevation"), RIGHT_ANGLES)
def test_faces_seen_from_the_side_are_seen_whole(azimuth, elevation, lanes):
    """Columns and rows of this picture lie in the faces: their rays pass all of the body, too.

    Each of the camera's directions has one 1 and two 0, to the last bit.
    """
    volume, table = Volume(np.ones((2, 3, 3), np.float32)), fog(0.4)
    for orthographic in (False, True):
        camera = turned(volume, azimuth, elevation, orthographic=orthographic)
        assert np.array_equal(np.sort(np.abs(camera.frame())), [(0, 0, 1)] * 3)
    given = table, camera, (25, 21), WHOLE
    if lanes is None:
        alpha = reference.cast(volume, *given)[1]
    else:
        alpha = Raycaster(volume, lanes=lanes).cast(*given).alpha
    whole = 0.4 if elevation else 1 - 0.6**2
    seen = alpha > 0
    assert np.abs(alpha[seen] - whole).max() < 1e-6
    # A pixel is 1/7 mm: the body is 2 mm wide and 1 mm high, 2 mm from above.
    assert seen[10].sum() == 15 and seen[:, 12].sum() == (15 if elevation else 7)


@LANES
def test_rays_that_lie_in_a_face_see_it(lanes):
    """Parallel rays along the faces' planes: 0/0 in the clipping, inside by definition."""
    volume, table = cube(9), fog(0.3)
    camera = Camera((4, 4, 100), (4, 4, 4), up=(0, 1, 0), height_mm=9)
    ours = Raycaster(volume, lanes=lanes).cast(table, camera, (9, 9), FLAT)
    true = reference.cast(volume, table, camera, (9, 9), FLAT)
    assert ours.alpha.min() > 0.9, "the border ring is culled"
    assert np.abs(ours.alpha - true[1]).max() < 1e-4


def volume_of(kind: str, values: NDArray[Any]) -> Volume:
    """Types for which other tests have compiled the kernel: each takes seconds."""
    return Volume(values.astype(np.float32 if kind == "values" else np.int16))


def matter(kind: str, opacity: float, reference_step_mm: float) -> TransferTable:
    """Opacity of 100; values around it are clear, so that nothing is constant in the table."""
    settings: dict[str, Any] = {}
    if kind == "labels":
        opacities, settings = opacity * (np.arange(102) == 100), {"labels": True}
    else:
        opacities = np.array([0, 0, opacity, 0, 0])
    if kind == "rows":
        opacities, settings = np.stack([opacities, 0.5 * opacities]), {"gradient_top": 4.0}
    top = 101.0 if kind == "labels" else 200.0
    weights = np.ones((*opacities.shape, 1))
    return TransferTable((0.0, top), opacities, weights, reference_step_mm, **settings)


def cut(thickness: float, **settings: float) -> RaycastSpec:
    """Leaves a slab that thick, square to z and away from the steps' borders."""
    crop = ((0, SIDE), (0, SIDE), (6.031, 6.031 + thickness))
    return replace(WHOLE, crop_voxels=crop, **settings)


BODY = np.full((SIDE,) * 3, 100)
MIDDLE = (SIDE - 1) / 2
THROUGH = Camera((MIDDLE, MIDDLE, 60.25), (MIDDLE,) * 3, up=(0, 1, 0), height_mm=4)


@pytest.mark.slow
@KINDS
@pytest.mark.parametrize(
    ("opacity", "reference_step_mm", "step_mm"),
    [(0.9999, 1, 2), (0.99, 0.1, 0.5), (0.99, 0.1, 2), (0.6, 1, 1), (0.3, 1, 1)],
)
def test_a_short_chord_takes_what_its_length_takes(
    kind, opacity, reference_step_mm, step_mm, lanes
):
    """Transmittances of a step down to 1e-40, far below the resolution of 1 − opacity.

    Ends of the chord rounded to 1e-6 of 14 mm, at 46 nepers a mm, bound the error near 2e-4.
    """
    caster = Raycaster(volume_of(kind, BODY), lanes=lanes)
    table = matter(kind, opacity, reference_step_mm)
    for thickness in (0.003, 0.03, 0.3):
        alpha = caster.cast(table, THROUGH, (5, 5), cut(thickness, step_mm=step_mm)).alpha
        true = 1 - (1 - opacity) ** (thickness / reference_step_mm)
        assert np.abs(alpha - true).max() < 2e-4, (alpha[2, 2], true)


@KINDS
@pytest.mark.parametrize("adaptive", [0.0, slow(0.1)])
def test_a_faint_medium_keeps_its_digits(kind, adaptive, lanes):
    """1 − opacity has none left at 1e-9; chords of clipped, whole and long steps alike.

    Five digits: float32 rounds the chord's ends to 1e-6 of 14 mm.
    """
    caster, table = Raycaster(volume_of(kind, BODY), lanes=lanes), matter(kind, 1e-9, 1.0)
    for thickness in (0.3, 6.3):
        spec = cut(thickness, step_mm=1.0, adaptive=adaptive)
        colour, alpha, depth, _ = caster.cast(table, THROUGH, (5, 5), spec)
        assert np.abs(alpha / (1e-9 * thickness) - 1).max() < 2e-5
        # Under flat white light the channels of a white medium are its alpha.
        assert np.allclose(colour[..., 0], alpha, rtol=1e-5) and np.isfinite(depth).all()


@LANES
def test_an_opaque_step_is_opaque_and_a_clear_one_clear_however_short(lanes):
    caster = Raycaster(volume_of("values", BODY), lanes=lanes)
    for opacity in (0.0, 1.0):
        alpha = caster.cast(matter("values", opacity, 1.0), THROUGH, (5, 5), cut(0.003)).alpha
        assert (alpha == opacity).all()


@KINDS
def test_dense_matter_between_entries_is_as_the_reference_has_it(kind, lanes):
    """Values, rows and labels mixed from clear to nearly opaque, seen through short chords."""
    values = np.random.default_rng(0).integers(60, 141, (SIDE,) * 3)
    if kind == "labels":
        values = np.where(values < 95, 100, np.where(values < 125, 50, 0))
    volume, table = volume_of(kind, values), matter(kind, 0.9999, 1.0)
    given = table, THROUGH, (24, 24), cut(0.03, step_mm=1.5)
    ours = Raycaster(volume, lanes=lanes).cast(*given).alpha
    true = reference.cast(volume, *given)[1]
    assert 0.005 < true.mean() < 0.9
    assert np.abs(ours - true).max() < 2e-4
