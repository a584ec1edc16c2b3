"""Files of one phantom in every order and direction of their axes: the same places hold the same.

The phantom has a letter on each side; docs/images/orientations.png shows it.
"""

import numpy as np
import pytest

from tests.support.volumes import load_silently
from tools.phantom_sheet import ORIENTATIONS, WRITERS, phantom, reoriented
from volspec.camera.projection import side_deg

# Places (N, 3) in LPS, in mm, all over the phantom.
INDEX = np.stack(np.meshgrid(*(range(0, n, 3) for n in (48, 40, 34))), axis=-1).reshape(-1, 3)


def values_at(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    x, y, z = np.rint(index).astype(int).T
    return values[z, y, x]


@pytest.mark.parametrize(
    ("title", "number"),
    [("NRRD, RAS", number) for number in range(48)]
    + [(title, number) for title in WRITERS for number in (9, 22, 37)],
)
def test_a_phantom_lies_in_its_place_whatever_the_order_of_its_voxels(tmp_path, title, number):
    values, world = phantom()
    name, write = WRITERS[title]
    write(tmp_path / name, *reoriented((values, world), *ORIENTATIONS[number]))
    volume = load_silently(tmp_path / name)
    places = INDEX @ world[:3, :3].T + world[:3, 3]
    own = (places - volume.world_from_index[:3, 3]) @ volume.index_from_world[:3, :3].T
    assert np.allclose(own, np.rint(own), atol=1e-3)
    assert np.array_equal(values_at(volume.values, own), values_at(values, INDEX))
    assert side_deg("left", volume) == (90.0, 0.0)
