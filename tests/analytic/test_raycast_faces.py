"""An orbit by right angles looks straight at the faces, and sees all of them or none."""

from __future__ import annotations

import numpy as np
import pytest

from volspec.raycast import Camera, RaycastSpec, reference
from volspec.raycast.gpu import Raycaster
from volspec.transfer import TransferTable
from volspec.volume import Volume

FLAT = RaycastSpec(ambient=1, diffuse=0, alpha_stop=1)
RIGHT_ANGLES = [
    *((azimuth, 0) for azimuth in (0, 90, 180, 270, -90, 450, 36090)),
    *((azimuth, elevation) for azimuth in (0, 90, 270) for elevation in (90, -90)),
]


@pytest.mark.parametrize(("azimuth", "elevation"), RIGHT_ANGLES)
def test_an_orbit_by_right_angles_is_along_the_axes(azimuth: float, elevation: float) -> None:
    """Each of the camera's directions has one 1 and two 0, to the last bit."""
    volume = Volume(np.ones((2, 3, 3), np.float32))
    for orthographic in (False, True):
        camera = Camera.orbit(
            volume, azimuth_deg=azimuth, elevation_deg=elevation, orthographic=orthographic
        )
        assert np.array_equal(np.sort(np.abs(camera.frame())), [(0, 0, 1)] * 3)


@pytest.mark.parametrize("lanes", [1, 8, None])
@pytest.mark.parametrize(("azimuth", "elevation"), RIGHT_ANGLES)
def test_faces_seen_from_the_side_are_seen_whole(
    azimuth: float, elevation: float, lanes: int | None
) -> None:
    """Columns and rows of this picture lie in the faces: their rays pass all of the body, too."""
    volume = Volume(np.ones((2, 3, 3), np.float32))
    table = TransferTable((0.0, 2.0), np.full(8, 0.4), np.ones((8, 1)), 1.0)
    camera = Camera.orbit(volume, azimuth_deg=azimuth, elevation_deg=elevation, orthographic=True)
    given = table, camera, (25, 21), FLAT
    if lanes is None:
        alpha = reference.cast(volume, *given)[1]
    else:
        alpha = Raycaster(volume, lanes=lanes).cast(*given).alpha
    whole = 0.4 if elevation else 1 - 0.6**2
    seen = alpha > 0
    assert np.abs(alpha[seen] - whole).max() < 1e-6
    # A pixel is 1/7 mm: the body is 2 mm wide and 1 mm high, 2 mm from above.
    assert seen[10].sum() == 15 and seen[:, 12].sum() == (15 if elevation else 7)
