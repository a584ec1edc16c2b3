"""MRtrix images: layouts, types, scaling and transforms, and GIPL as SimpleITK writes it."""

import gzip
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from tests.support.errors import raises
from volspec.errors import VolumeError
from volspec.volume import load_volume
from volspec.volume.metadata import NO_SPACING, NO_UNIT

XYZ = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6)  # by x, y, z
TURN = np.array([[0.0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 30]])
SPACED = "vox: 0.5,0.7,2\n"
TURNED = SPACED + "".join(f"transform: {','.join(map(str, row))}\n" for row in TURN)
LAYOUTS = ("+0,+1,+2", "Int16LE"), ("-0,-1,+2", "Int16BE"), ("+2,-0,+1", "Int16LE")


def write(
    path: Path,
    values: np.ndarray = XYZ,
    layout: str = "+0,+1,+2",
    datatype: str = "Int16LE",
    lines: str = SPACED,
) -> Path:
    """A file of values (X, Y, Z, …), stored as the layout and the type say."""
    axes = layout.split(",")
    order = sorted(range(values.ndim), key=lambda axis: -int(axes[axis][1:]))
    flipped = values[tuple(slice(None, None, -1 if axis[0] == "-" else 1) for axis in axes)]
    data = flipped.transpose(order).astype(">i2" if "BE" in datatype else "<i2")
    if datatype == "Bit":
        data = np.packbits(data.ravel() != 0)
    head = (
        f"mrtrix image\ndim: {','.join(map(str, values.shape))}\nlayout: {layout}\n"
        f"datatype: {datatype}\n{lines}file: . 1000\nEND\n"
    )
    whole = head.encode().ljust(1000, b"\0") + data.tobytes()
    path.write_bytes(gzip.compress(whole) if path.suffix == ".gz" else whole)
    return path


@pytest.mark.parametrize("name", ["v.mif", "v.mif.gz"])
@pytest.mark.parametrize(("layout", "datatype"), LAYOUTS)
def test_axes_follow_the_layout_and_the_transform(tmp_path, name, layout, datatype):
    volume = load_volume(write(tmp_path / name, XYZ, layout, datatype, TURNED))
    assert np.array_equal(volume.values, XYZ.T)
    # Right to left and front to back: LPS from RAS.
    expected = np.diag([-1, -1, 1]) @ TURN * (0.5, 0.7, 2, 1)
    assert np.allclose(volume.world_from_index[:3], expected)
    assert volume.metadata.is_patient and not volume.metadata.assumed


def test_volumes_bits_and_scaling(tmp_path):
    series = np.stack([XYZ, XYZ + 1], axis=-1)
    path = write(tmp_path / "s.mif", series, "+1,+2,+3,-0", lines=f"{SPACED}scaling: 10,0.5\n")
    assert np.array_equal(load_volume(f"{path}?time=1").values, 10 + 0.5 * (XYZ.T + 1))
    volume = load_volume(write(tmp_path / "m.mif", XYZ % 7, "-0,+2,+1", "Bit", "vox: nan,1,1\n"))
    assert np.array_equal(volume.values, XYZ.T % 7 != 0)
    assert volume.metadata.assumed == (NO_SPACING,) and not volume.metadata.is_patient


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        (b"Int16LE", b"CFloat32LE", "unsupported"),
        (XYZ.T.tobytes(), b"1234", "damaged"),
        (b"layout: ", b"layout: +3,", "damaged"),
        (b"layout: ", b"file: other.dat 0\nlayout: ", "unsupported"),
        (b"layout: ", b"no colon\nlayout: ", "damaged"),
        (b"file: .", b"file: v.dat", "not-found"),
    ],
)
def test_what_is_no_volume_is_refused(tmp_path, old, new, code):
    path = write(tmp_path / "v.mif")
    path.write_bytes(path.read_bytes().replace(old, new))
    with raises(VolumeError, code) as caught:
        load_volume(path)
    if code == "not-found":
        assert "v.dat" in str(caught.value)
        (tmp_path / "v.dat").write_bytes(bytes(1000) + XYZ.T.tobytes())
        assert np.array_equal(load_volume(path).values, XYZ.T)


@pytest.mark.parametrize("name", ["v.gipl", "v.gipl.gz"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_gipl_is_what_simpleitk_writes(tmp_path, name, dtype):
    image = sitk.GetImageFromArray(XYZ.T.astype(dtype))
    image.SetSpacing((0.5, 0.75, 2))
    image.SetOrigin((1, 2, 3))
    sitk.WriteImage(image, str(tmp_path / name))
    volume = load_volume(tmp_path / name)
    assert np.array_equal(volume.values, XYZ.T.astype(dtype))
    assert volume.spacing_mm == (0.5, 0.75, 2) and volume.metadata.assumed == (NO_UNIT,)
    assert volume.world_from_index[:3, 3].tolist() == [1, 2, 3]
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-40])
    with raises(VolumeError, "damaged"):
        load_volume(tmp_path / name)
