"""Slices: values, orientation, colours under the lights, tables of values."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.viewer import KINDS, of_kind
from tests.viewer._states import of_volume, relit
from volspec.basis import MaterialBasis
from volspec.camera.projection import is_patient
from volspec.image import CoefficientImage
from volspec.raycast import RaycastSpec
from volspec.relight import LightRig
from volspec.spectra import light, reflectance
from volspec.transfer import MAX_LABEL, FieldFunctions, Mask, TransferFunction
from volspec.viewer.model import camera, lights, slice_table, slices
from volspec.viewer.model.cuts import with_overlays
from volspec.viewer.model.slices import (
    PLANES,
    Plane,
    direction_letters,
    edge_letters,
    slice_layout,
    slice_values,
    with_slices,
)
from volspec.viewer.model.state import Slices, ViewState
from volspec.viewer.ui.slices import crossing_text, slice_sizes
from volspec.viewer.work.slice_pictures import SlicePictures
from volspec.volume import Metadata, Volume, load_volume


def numbered(world: Any = None) -> Volume:
    """Values that encode their index: x + 10 y + 100 z."""
    z, y, x = np.meshgrid(range(4), range(5), range(6), indexing="ij")
    values = (x + 10 * y + 100 * z).astype(np.uint16)
    return Volume(values, world_from_index=world, metadata=Metadata(is_patient=world is not None))


def test_slices_show_the_volumes_values_as_they_are_looked_at():
    volume = numbered()
    axial, coronal, sagittal = (
        slice_values(volume, slice_layout(volume, plane), 2) for plane in PLANES
    )
    # World axes are those of the voxels: rows run to +y, or from +z down.
    np.testing.assert_array_equal(axial, volume.values[2])
    np.testing.assert_array_equal(coronal, volume.values[::-1, 2, :])
    np.testing.assert_array_equal(sagittal, volume.values[::-1, :, 2])
    assert all(np.shares_memory(each, volume.values) for each in (axial, coronal, sagittal))
    assert slice_values(volume, slice_layout(volume, PLANES[0]), 2, step=2).shape == (3, 3)


def test_indices_of_a_slice_are_those_of_its_values():
    turned = np.array([[0, 0, -1, 0], [1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    for volume in (numbered(), numbered(turned)):
        for plane in PLANES:
            layout = slice_layout(volume, plane)
            x, y, z = np.moveaxis(slices.slice_index(volume, layout, 1, 2).astype(int), -1, 0)
            values = slice_values(volume, layout, 1, 2)
            np.testing.assert_array_equal(volume.values[z, y, x], values)


def test_slices_of_several_fields_show_all_with_their_masks():
    """The second field has a lattice of its own; where a mask hides, there are greys."""
    basis = MaterialBasis({name: reflectance(name) for name in ("copper", "gold")})
    copper, gold = (
        TransferFunction([(10, 0.0, name), (20, 0.9, name)], basis.materials, basis)
        for name in ("copper", "gold")
    )
    ramp = np.zeros((8, 8, 8), np.uint8)
    ramp[:, :, 4:] = 40
    place = np.diag([2.0, 2.0, 2.0, 1.0])
    other = Volume((ramp[::2, ::2, ::2].T > 0) * np.uint8(60), world_from_index=place, name="pet")
    labels = Volume((np.arange(8)[None, :, None] > 5) * np.ones((8, 8, 8), np.uint8), name="cut")
    volume = Volume(ramp, name="ct").with_fields([other, labels])
    functions = FieldFunctions({"": copper, "pet": gold}, masks={"": Mask("cut", {1: None})})
    made = slice_table.FieldSlices.of(volume, functions)

    def shown(number: int) -> np.ndarray:
        index = slices.slice_index(volume, slice_layout(volume, PLANES[0]), number)
        return made.image(index, (0.0, 1.0), RaycastSpec()).coefficients

    # Rows are y, columns x; pet is everywhere in this slice above z = 7.
    above, below = shown(7), shown(1)
    assert above.shape == (8, 8, 3)
    mixed = above[3, 6]
    assert 0.3 < mixed[0] < 0.7 and mixed.sum() == pytest.approx(1.0, abs=1e-6)
    for pixel, channels in (
        (above[3, 1], (0, 1, 0)),  # pet alone
        (above[7, 6], (0, 1, 0)),  # the mask hides the CT
        (below[3, 1], (0, 0, 0)),  # neither, black
        (below[3, 6], (1, 0, 0)),
        (below[7, 6], (0, 0, 1)),  # hidden: the grey of its value
    ):
        np.testing.assert_allclose(pixel, channels, atol=1e-6)


def test_an_axial_slice_lies_the_same_way_however_voxels_are_stored():
    """The patient's right is at the left and the face on top, for every order and direction."""
    plain = numbered()
    expected = slice_values(plain, slice_layout(plain, PLANES[0]), 1)
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0), (2, 1, 0)):
        for flips in np.ndindex(2, 2, 2):
            # Voxel axis n runs along world axis order[n], or against it.
            values = np.transpose(plain.values, [2 - order[2 - k] for k in range(3)])
            values = values[tuple(slice(None, None, -1 if f else 1) for f in flips[::-1])]
            world = np.eye(4)
            world[:3, :3] = 0.0
            for own in range(3):
                world[order[own], own] = -1.0 if flips[own] else 1.0
            volume = Volume(np.ascontiguousarray(values), world_from_index=world)
            layout = slice_layout(volume, PLANES[0])
            along = layout.normal
            number = volume.shape_xyz[along] - 2 if flips[along] else 1
            np.testing.assert_array_equal(slice_values(volume, layout, number), expected)
            assert edge_letters(volume, layout, True) == ("R", "L", "A", "P")


@pytest.mark.not_quick
def test_letters_of_a_nifti_file_are_the_patients(tmp_path):
    """A file whose voxels run to the right, the front and the top (RAS+), as NIfTI has them."""
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(np.arange(60, dtype=np.int16).reshape(3, 4, 5))
    image.SetDirection((-1, 0, 0, 0, -1, 0, 0, 0, 1))  # ITK counts to the left and the back
    image.SetSpacing((0.7, 0.7, 2.5))
    path = tmp_path / "head.nii.gz"
    sitk.WriteImage(image, str(path))
    volume = load_volume(path)
    assert is_patient(volume, None)
    found = [edge_letters(volume, slice_layout(volume, plane), True) for plane in PLANES]
    assert found == [("R", "L", "A", "P"), ("R", "L", "S", "I"), ("A", "P", "S", "I")]
    # The voxel at index 0 is the leftmost, hindmost one: the axial picture's lower right.
    axial = slice_values(volume, slice_layout(volume, PLANES[0]), 0)
    assert axial[-1, -1] == volume.values[0, 0, 0] and axial[0, 0] == volume.values[0, -1, -1]


def test_a_volume_without_orientation_has_axes_for_letters():
    volume = Volume(np.zeros((3, 4, 5), np.uint8), spacing_mm=(1.0, 2.0, 3.0))
    assert not is_patient(volume, None) and is_patient(volume, True)
    assert edge_letters(volume, slice_layout(volume, PLANES[1]), False) == ("-x", "+x", "+z", "-z")
    assert direction_letters(np.array([0.8, -0.6, 0.1]), True) == "LA"


def test_a_click_in_a_slice_moves_the_other_two(state):
    volume = numbered(np.diag([-1.0, 1.0, 2.0, 1.0]))
    state = of_volume(state, volume)
    layout = slice_layout(volume, PLANES[0])
    # The middle of the second column and the last row; x runs against the picture.
    moved = slices.point_at(state, 0, 1.5 / 6, 4.6 / 5)
    at = moved.interface.slices.at
    numbers = [slices.voxel_number(volume, axis, at[axis]) for axis in range(3)]
    assert numbers == [4, 4, 2]  # z as it was, in the middle
    assert slices.crossing_place(volume, layout, moved.interface.slices) == pytest.approx(
        (0.25, 0.9)
    )
    assert slices.point_at(moved, 0, 0.25, 0.9).interface.slices.at == pytest.approx(at)
    assert crossing_text(moved) == "244  at  -4.0  4.0  4.0 mm LPS"
    assert crossing_text(with_overlays(moved, patient=False)) == "244  at  -4.0  4.0  4.0 mm"


def test_what_a_crop_leaves_is_seen_in_the_slices():
    volume = numbered(np.diag([-1.0, 1.0, 2.0, 1.0]))  # x runs against the picture
    layout = slice_layout(volume, PLANES[0])
    assert slices.crop_extent(volume, layout, ((0.0, 5.0), (0.0, 4.0), (0.0, 3.0))) == (0, 0, 1, 1)
    left, top, right, bottom = slices.crop_extent(
        volume, layout, ((0.0, 2.0), (1.0, 4.0), (0.0, 3.0))
    )
    assert (left, top, right, bottom) == pytest.approx((0.5, 0.2, 1.0, 1.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steps_go_up_whichever_way_the_voxels_run(state, sign):
    volume = numbered(np.diag([1.0, 1.0, sign, 1.0]))
    given = of_volume(state, volume)
    before, after = (
        sign * slices.voxel_number(volume, 2, each.interface.slices.at[2])
        for each in (given, slices.step_slice(given, 0, 1.0))
    )
    assert after == before + 1


class _Texture:
    def __init__(self, size: tuple[int, int]) -> None:
        self.size, self.glo, self.written = size, 7, []

    def write(self, data: Any) -> None:
        self.written.append(np.array(data))


class _Context:
    """Fake of OpenGL that records what is written into textures."""

    def __init__(self) -> None:
        self.textures: list[_Texture] = []

    def texture(self, size: tuple[int, int], components: int) -> _Texture:
        self.textures.append(_Texture(size))
        return self.textures[-1]


def test_a_slice_is_written_again_only_where_it_changes(state):
    context = _Context()
    pictures = SlicePictures(context)
    layouts = [slice_layout(state.document.volume, plane) for plane in PLANES]
    moved = slices.move_slice(state, 0, 0.9)
    lit = lights.set_weight(moved, 1, 1.0)
    for shown, counts in (
        (state, [1, 1, 1]),
        (replace(state, view=replace(state.view, zoom=2.0)), [1, 1, 1]),
        (moved, [2, 1, 1]),
        (slices.move_slice(state, 0, 0.9), [2, 1, 1]),
        (lit, [3, 2, 2]),
        (camera.orbit(lit, 0.1, 0.0), [3, 2, 2]),
    ):
        for plane, layout in zip(PLANES, layouts, strict=True):
            assert pictures.texture(shown, plane.name, layout, 200.0) == 7
        assert [len(texture.written) for texture in context.textures] == counts


def slice_codes(state: ViewState, plane: Plane) -> np.ndarray:
    """Return the codes (H, W, 4) of a state's slice."""
    context = _Context()
    layout = slice_layout(state.document.volume, plane)
    SlicePictures(context).texture(state, plane.name, layout, 200.0)
    return context.textures[0].written[0].view(np.uint8).reshape(8, 8, 4)


def test_slices_are_relit_as_pixels_of_a_picture_are(state):
    """Voxels that are shown have their material's colour, under each light; to one code.

    The material comes to 1 - (1 - opacity)^16 of a voxel, which is all of gold's at 0.6.
    """
    transfer = replace(state.transfer, points=[(0.0, 0.0, "gold"), (0.01, 0.6, "gold")])
    gold = transfer.basis.analyse(transfer.materials["gold"].values)
    one = np.ones((1, 1), np.float32)
    image = CoefficientImage(gold[None, None].astype(np.float32), one, one, transfer.basis)
    for name in ("D65", "HP1"):
        rows = (replace(state.lights[0], rig=LightRig((light(name),))),)
        lit = replace(state, lights=rows, transfer=transfer)
        pixels = slice_codes(lit, PLANES[0])
        assert np.abs(pixels[4, 4, :3].astype(int) - relit(image, lit)[0, 0]).max() <= 1
        assert (pixels[..., 3] == 255).all()


def test_greys_are_the_values_between_black_and_white(state):
    plain = with_slices(state, lit=False, greys=(0.0, 1.0))
    volume = state.document.volume
    low, high = volume.range
    number = slices.voxel_number(volume, 0, 0.5)
    shown = slice_values(volume, slice_layout(volume, PLANES[2]), number)
    grey = slice_codes(plain, PLANES[2])[..., 1]
    # 4096 entries and rounding to codes: half a code.
    assert np.abs(grey - 255 * (shown - low) / (high - low)).max() <= 0.6
    narrow = slices.set_greys(plain, 0.7, 0.2).interface.slices.greys
    assert narrow[0] < narrow[1]


def test_greys_run_where_most_values_lie_unless_they_are_set():
    counts = np.zeros(256)
    counts[0], counts[100:151], counts[255] = 1e6, 1e3, 1.0
    low, high = slices.grey_window(Slices(), counts)
    assert (low, high) == pytest.approx((100 / 256, 151 / 256), abs=2 / 256)
    assert slices.grey_window(Slices(), np.zeros(256)) == (0.0, 1.0)
    assert slices.grey_window(Slices(greys=(0.2, 0.3)), counts) == (0.2, 0.3)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_transfer_function_has_a_table(state, kind):
    transfer = of_kind(state, kind).transfer
    volume = Volume(np.linspace(0, 8, 1000, dtype=np.float32).reshape(10, 10, 10))
    image = slice_table.table_image(volume, transfer, state.shading, (0.0, 1.0))
    assert np.isfinite(image.coefficients).all()
    assert image.coefficients[0, 0] == pytest.approx(0.0, abs=1e-6)  # black, not seen
    if kind in ("surfaces", "labels"):  # the last is gold and opaque
        gold = transfer.basis.analyse(transfer.materials["gold"].values)
        at = 7 if kind == "labels" else -1
        np.testing.assert_allclose(image.coefficients[0, at], gold, rtol=1e-6)


@pytest.mark.filterwarnings("ignore:.*finite")
def test_odd_volumes_have_slices(state):
    holes = np.random.default_rng(1).random((4, 5, 6), dtype=np.float32)
    holes[1:3, 2, 2] = np.nan
    least = np.arange(8, dtype=np.uint8).reshape(2, 2, 2)
    for values in (least, np.full((2, 3, 4), 5, np.int16), holes):
        volume, context = Volume(values), _Context()
        odd, pictures = of_volume(state, volume), SlicePictures(context)
        for plane in PLANES:
            pictures.texture(odd, plane.name, slice_layout(volume, plane), 5.0)
        assert len(context.textures) == 3
        # The slices cross at a missing voxel.
        assert np.isnan(float(crossing_text(odd).split()[0])) == (volume.missing is not None)


def test_slices_one_above_the_other_keep_one_scale_and_stay_within_the_room():
    sizes = slice_sizes([(250.0, 250.0), (250.0, 100.0), (250.0, 2.0)], (240.0, 300.0), 10.0)
    assert sizes[0][0] / 250.0 == pytest.approx(sizes[1][1] / 100.0)
    assert sum(height for _, height in sizes[:2]) <= 300 and sizes[2][1] == 10.0


@pytest.mark.parametrize(
    ("dtype", "top"),
    [(np.uint16, 300), (np.uint16, 65535), *((np.float32, top) for top in (300, 65535, 2**31))],
)
def test_a_table_of_labels_is_bounded_and_tells_names_apart(dtype, top):
    """Volumes of 32-bit integers are kept as floats: they had 4096 entries, evenly."""
    volume = Volume(np.array([0, 1, 2, top // 2, top - 1, top, 7, 8], dtype).reshape(2, 2, 2))
    entries = slice_table.table_entries(volume, labels=True)
    assert entries.count <= MAX_LABEL + 1 + slice_table.ENTRIES
    named = volume.values[volume.values <= MAX_LABEL]
    np.testing.assert_array_equal(entries.values[entries.codes(named)], named)
    # The others are grey by what they are.
    shades = slice_table.greys(entries, volume.range, (0.0, 1.0))
    np.testing.assert_allclose(
        shades[entries.codes(volume.values)], volume.values / top, atol=1 / slice_table.ENTRIES
    )
