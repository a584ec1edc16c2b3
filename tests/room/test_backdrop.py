"""The room seen behind a volume: against a picture of the room, with direct light at each point."""

from functools import cache

import numpy as np
import pytest

from tests.room.test_response import two_lights
from volspec.basis import SpectralBasis
from volspec.room import Eye
from volspec.room.eye import picture_XYZ, pixel_rays
from volspec.room.wall_colours import LitMesh, room_colours
from volspec.spectra import DEFAULT_GRID, colour_matching_functions

EYE = Eye(position_m=(0.4, 0.4, 1.8), target_m=(2.0, 2.4, 0.8), fov_deg=60.0)
SIZE = (48, 36)
BANDS = SpectralBasis.bands(DEFAULT_GRID)


@cache
def lit() -> LitMesh:
    return LitMesh.of(two_lights())


@pytest.mark.parametrize("lux", [(1.0, 1.0), (0.0, 1.0)], ids=["panel and lamp", "lamp"])
def test_it_is_the_picture_of_the_room(lux):
    """31 bands: Y within a per cent of the mean, and within 10 at edges of shadows, too."""
    response = two_lights()
    ways = pixel_rays(EYE, SIZE, 1)
    seen = lit().trace(np.broadcast_to(EYE.position_m, ways.shape), ways)
    colours = room_colours(response, BANDS, np.ones(2), lit())
    power = np.array([*response.solved.room.lights.values()]) * np.array(lux)[:, None]
    surfaces = len(response.solved.mesh.names)
    nothing = np.zeros(len(ways))
    spectra = sum(
        (seen.rows(light, surfaces, nothing) @ colours[light]) * power[light] for light in range(2)
    )
    solved = response.under(power)
    Q = colour_matching_functions(DEFAULT_GRID)
    white = solved.irradiance[0]
    found = spectra @ Q.T * (100.0 / float(white @ Q[1]))
    true = picture_XYZ(solved, EYE, SIZE, white, samples=1).reshape(-1, 3)
    off = np.abs(found - true)[:, 1] / true[:, 1].mean()
    assert np.median(off) < 0.01 and np.quantile(off, 0.99) < 0.1


def test_backs_are_invisible():
    """An eye outside of a room sees its far side."""
    start = np.array([[-2.0, 1.5, 2.2]])
    seen = lit().trace(start, np.array([[1.0, 0.0, 0.0]]))
    assert seen.points_m == pytest.approx(np.array([[3.0, 1.5, 2.2]]), abs=1e-5)
    away = lit().trace(start, np.array([[-1.0, 0.0, 0.0]]))
    assert away.weights.sum() == 0.0 and away.surface == [-1]


def test_vertices_belong_to_one_side_and_their_weights_sum_to_1():
    mesh, patches = two_lights().solved.mesh, lit().patches.tocoo()
    assert lit().patches.sum(axis=1) == pytest.approx(1.0)
    rows, columns = patches.coords
    assert (mesh.surface[columns] == lit().surface[rows]).all()


def test_triangles_are_small_where_shadows_end():
    """On the floor, below the table."""
    mesh = lit().rays.mesh
    floor = mesh.areas_m2[mesh.surface == mesh.names.index("floor")]
    assert len(mesh.surface) >= 4 * len(two_lights().solved.mesh.surface)
    assert floor.min() < 0.2 * floor.max()
