"""Masks: transfer functions by label of another field, against the float64 reference and limits."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import volspec as vs
from tests.support.errors import refuses
from tests.support.fixtures import slow
from tests.support.raycasts import METALS, assert_matches_reference, metal_function
from tests.twins.test_fields import SHADOWS, SIZE, view
from volspec.raycast import ClipPlane, RaycastSpec
from volspec.raycast.launch.masks import MaskLattice
from volspec.transfer import FieldFunctions, Mask, TransferFunction
from volspec.transfer.nan_voxels import bake_for_volume
from volspec.volume import Volume
from volspec.volume.labels import Label

N = 28
LIT = RaycastSpec(step_mm=0.5, alpha_stop=1, groups=SHADOWS, light_cells=16)
FLAT = RaycastSpec(step_mm=0.5, alpha_stop=1, ambient=1.0, diffuse=0.0)
# Of the same materials as the organs, and opaque at its end as they are: of the same kernels.
BODY = metal_function((-200, 0.0, "copper"), (100, 0.2, "copper"), (900, 1.0, "gold"))
LIVER = metal_function((-100, 0.0, "gold"), (150, 0.5, "gold"))
# On a domain of its own, opaque at its end.
BONE = metal_function((150, 0.0, "copper"), (200, 0.9, "gold"), (400, 1.0, "gold"))
ORGANS = {"liver": LIVER, 2: BONE, 5: None}


@pytest.fixture(scope="module")
def ct() -> Volume:
    """A soft body with two denser lobes, in Hounsfield units."""
    z, y, x = np.mgrid[-1 : 1 : N * 1j, -1 : 1 : N * 1j, -1 : 1 : N * 1j]
    values = -900 + 1000 * (x**2 + 1.2 * y**2 + z**2 < 0.8)
    for at in (-0.4, 0.4):
        values += 350 * (((x - at) ** 2 + y**2 + z**2) < 0.08)
    smooth = gaussian_filter(values.astype(float), 1.5)
    return Volume(np.rint(smooth).astype(np.int16), spacing_mm=(1.0, 1.0, 1.2), name="CT")


def segmentation(shape: tuple[int, int, int], **lattice: Any) -> Volume:
    """Ragged regions of labels 0, 1 (liver), 2, 5 and 9 (of which no mask says anything)."""
    noise = [gaussian_filter(np.random.default_rng(k).random(shape), 2.5) for k in range(5)]
    numbers = np.array([0, 1, 2, 5, 9], np.uint8)[np.argmax(noise, axis=0)]
    labels = {1: Label("liver"), 2: Label("bone"), 5: Label(), 9: Label()}
    return Volume(numbers, labels=labels, name="organs", **lattice)


@pytest.fixture(scope="module")
def turned(ct: Volume) -> Volume:
    """A coarser, rotated lattice that leaves out some of the body."""
    world = np.array([[1.6, -1.2, 0.1, 8], [1.2, 1.6, 0, -6], [0, 0.1, 2.0, 3], [0, 0, 0, 1.0]])
    return segmentation((14, 13, 12), world_from_index=world)


@pytest.fixture
def mask(ct: Volume, turned: Volume, lattice: str) -> Volume:
    """Regions on the volume's lattice, or on the other."""
    same = lattice == "same"
    return segmentation(ct.values.shape, world_from_index=ct.world_from_index) if same else turned


def masked(ct: Volume, mask: Volume, functions: Any = ORGANS) -> tuple[Volume, FieldFunctions]:
    made = FieldFunctions({"": BODY}, masks={"": Mask("organs", functions)})
    return ct.with_fields([mask]), made


@pytest.mark.parametrize(
    ("spec", "lattice"),
    [(LIT, "turned"), slow(LIT, "same"), slow(FLAT, "turned"), slow(FLAT, "same")],
)
def test_masks_match_the_reference(ct, mask, spec):
    volume, transfer = masked(ct, mask)
    assert_matches_reference(volume, transfer, view(volume), SIZE, spec)


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, None])
def test_a_cut_mask_on_a_third_lattice_matches_the_reference(ct, turned, lanes):
    """The volume's own field is plain; a further one has a mask, and a plane of its own."""
    own = Volume(ct.values[::2, ::2, ::2].copy(), spacing_mm=(2.0, 2.0, 2.4), name="MR")
    world = np.array([[0.9, -0.3, 0, 3], [0.3, 0.9, 0.1, -2], [0, 0.1, 1.1, 1], [0, 0, 0, 1.0]])
    volume = own.with_fields([Volume(ct.values, world_from_index=world, name="CT"), turned])
    masks = {"CT": Mask("organs", ORGANS)}
    transfer = FieldFunctions({"": LIVER, "CT": BODY}, {"": 0.3, "CT": 0.6}, masks)
    plane = ClipPlane((12.0, 10.0, 9.0), (1.0, 0.5, 0.2), fields=("CT",))
    spec = replace(LIT, crop_voxels=((1, 12), (0.5, 12.5), (1, 11)), clip_planes=(plane,), jitter=1)
    assert_matches_reference(volume, transfer, view(volume), SIZE, spec, lanes)


def test_bands_of_another_field_make_a_joint_function(ct):
    """Labels with their numbers where the values are make the same picture."""
    other = replace(ct, values=ct.values[:, ::-1].copy(), name="high")
    bands = {(-900, -300): None, (-300, 50): LIVER, (150, 5000): BONE}
    transfer = FieldFunctions({"": BODY}, masks={"": Mask("high", bands)})
    volume = ct.with_fields([other])
    found = assert_matches_reference(volume, transfer, view(volume), SIZE, LIT)
    numbers = np.digitize(other.values, [-900, -300, 50, 150, 5000]).astype(np.uint8)
    organs = replace(other, values=numbers, name="organs")
    labelled = masked(ct, organs, {1: None, 2: LIVER, 4: BONE})
    alike = vs.raycast(*labelled, view(volume), SIZE, LIT).coefficients
    assert np.abs(found.coefficients - alike).max() < 1e-6
    floats = ct.with_fields([replace(other, values=other.values.astype(np.float32))])
    as_float = vs.raycast(floats, transfer, view(volume), SIZE, LIT).coefficients
    assert np.abs(found.coefficients - as_float).max() < 1e-5


def picture(volume: Volume, transfer: vs.FieldFunctions | TransferFunction) -> NDArray[np.floating]:
    return vs.raycast(volume, transfer, view(volume), SIZE, FLAT).coefficients


@pytest.mark.slow
def test_inside_one_label_the_picture_is_that_of_its_function_alone(ct):
    whole = replace(ct, values=np.ones_like(ct.values, np.uint8), name="organs")
    found = picture(*masked(ct, whole, {1: BONE}))
    assert np.abs(found - picture(ct, BONE)).max() < 1e-6


@pytest.mark.slow
def test_equal_functions_of_all_labels_change_nothing(ct, turned):
    labels = (0, 1, 2, 5, 9)
    for functions in ({label: replace(BODY) for label in labels}, dict.fromkeys(labels, BODY)):
        found = picture(*masked(ct, turned, functions))
        assert np.abs(found - picture(ct, BODY)).max() < 1e-6


@pytest.mark.slow
def test_a_hidden_label_is_as_transparent_as_voxels_without_matter(ct):
    """Half of a homogeneous block is hidden: what stays has half of the extinction."""
    block = Volume(np.full((20, 20, 20), 100, np.int16), name="CT")
    halves = np.zeros(block.values.shape, np.uint8)
    halves[:, :, 10:] = 3
    mask = replace(block, values=halves, name="organs")
    volume, transfer = masked(block, mask, {3: None})
    camera = vs.Camera((-100, 9.5, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), height_mm=4.0)
    how = camera, (8, 8), replace(FLAT, step_mm=0.25)
    alpha = vs.raycast(volume, transfer, *how).alpha
    # The boundary is linear between the voxels 9 and 10: half of that millimetre is there.
    assert alpha == pytest.approx(np.full((8, 8), 1 - 0.8**9.5), abs=2e-4)
    hidden = replace(block, values=np.where(halves == 3, -200, 100).astype(np.int16))
    alone = vs.raycast(hidden, BODY, *how).alpha
    assert np.abs(alpha - alone).max() < 0.03  # half a voxel more or less


def test_a_weight_multiplies_every_row_s_extinction(ct, turned):
    volume, transfer = masked(ct, turned)
    halved = bake_for_volume(replace(transfer, weights={"": 0.5}), volume)
    whole = bake_for_volume(transfer, volume)
    for half, one in zip(halved.every, whole.every, strict=True):
        np.testing.assert_allclose((1 - half.opacity) ** 2, 1 - one.opacity, atol=1e-12)


@pytest.mark.parametrize("lattice", ["same", "turned"])
def test_ranges_of_bricks_hold_all_rows_of_their_samples(ct, mask):
    volume, transfer = masked(ct, mask)
    table = bake_for_volume(transfer, volume)
    made = MaskLattice.of(volume, "CT", table.masks["CT"])
    least, most = made.brick_ranges()
    point = np.random.default_rng(3).uniform(0, N - 1, (20_000, 3))
    weights = made.weights(point, 4)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    x, y, z = (point // 4).astype(int).T
    for row in range(4):
        here = weights[:, row] > 1e-9
        assert (least[z, y, x][here] <= row).all() and (row <= most[z, y, x][here]).all()


Parts = Callable[[Volume, Volume], object]


def baked(functions: object) -> Parts:
    return lambda ct, mask: bake_for_volume(*masked(ct, mask, functions)[::-1])


def of_label(label: Any) -> Parts:
    return lambda ct, mask: Mask("organs", {label: BONE})


def other_mask(functions: Any, field: str = "") -> Parts:
    return lambda ct, mask: FieldFunctions({"": BODY}, masks={field: Mask("organs", functions)})


MANY = {label: replace(BONE) for label in range(256)}
OTHER = TransferFunction([(0, 1.0, "gold")], METALS, vs.SpectralBasis.load("general-5"))


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (baked({"lever": BONE}), "unknown FieldFunctions.masks[''].functions['lever']"),
        (baked({1: BONE, "liver": None}), "duplicate FieldFunctions.masks[''].functions['liver']"),
        (baked({(0, 3): BONE, 2: None}), "duplicate FieldFunctions.masks[''].functions[2]"),
        (
            lambda ct, mask: bake_for_volume(*masked(ct, replace(ct, name="organs"))[::-1]),
            "type FieldFunctions.masks[''].functions['liver']",
        ),
        (
            lambda ct, mask: bake_for_volume(masked(ct, mask)[1], ct),
            "unknown FieldFunctions.masks[''].field",
        ),
        (of_label((3, 3)), "range Mask.functions[(3, 3)]"),
        (of_label(-1), "range Mask.functions[-1]"),
        (of_label(1.5), "type Mask.functions[1.5]"),
        (of_label(True), "type Mask.functions[True]"),
        (lambda ct, mask: Mask("organs", MANY), "size Mask.functions"),
        (other_mask(ORGANS, "PET"), "unknown FieldFunctions.masks['PET']"),
        (other_mask({1: OTHER}), "conflict FieldFunctions.masks[''].functions[1]"),
    ],
)
def test_what_cannot_be_a_mask_is_refused(ct, turned, make, fault):
    refuses(lambda: make(ct, turned), fault)
