"""The room seen behind a volume: against a picture of the room, with direct light at each point."""

from __future__ import annotations

import numpy as np
import pytest

from tests.room.test_response import CUBE, two_lights
from volspec.basis import SpectralBasis
from volspec.room import Eye
from volspec.room.backdrop import CornerColours, corner_owners, seen_corners
from volspec.room.eye import picture_XYZ, pixel_rays
from volspec.room.form_factors import Rays
from volspec.spectra import DEFAULT_GRID, colour_matching_functions

EYE = Eye(position_m=(0.4, 0.4, 1.8), target_m=(2.0, 2.4, 0.8), fov_deg=60.0)
SIZE = (48, 36)


def test_it_is_the_picture_of_the_room() -> None:
    """31 bands: Y within 3 per cent of the mean, but at shadows' edges, with 500 patches."""
    response = two_lights()
    bands = SpectralBasis.bands(DEFAULT_GRID)
    rays = response.solved.rays
    ways = pixel_rays(EYE, SIZE, 1)
    seen = seen_corners(rays, np.broadcast_to(EYE.position_m, ways.shape), ways)
    colours = CornerColours.of(response, bands, np.ones(2), corner_owners(rays.mesh))
    power = np.array([*response.solved.room.lights.values()])
    spectra = np.einsum("klb,lb->kb", (seen @ colours.all).reshape(-1, 2, bands.size), power)
    irradiance = response.solved.irradiance[0]
    Q = colour_matching_functions(DEFAULT_GRID)
    found = spectra @ Q.T * (100.0 / float(irradiance @ Q[1]))
    true = picture_XYZ(response.solved, EYE, SIZE, irradiance, samples=1).reshape(-1, 3)
    off = np.abs(found - true)[:, 1] / true[:, 1].mean()
    assert np.median(off) < 0.03 and np.quantile(off, 0.95) < 0.3


def test_direct_light_is_a_part_of_all_light() -> None:
    response = two_lights()
    bands = SpectralBasis.bands(DEFAULT_GRID)
    colours = CornerColours.of(response, bands, np.ones(2), corner_owners(response.solved.mesh))
    assert (colours.direct <= colours.all + 1e-6).all() and colours.direct.any()


def test_backs_are_invisible() -> None:
    """An eye outside of a room sees its far side."""
    rays = Rays(CUBE)
    seen = seen_corners(rays, np.array([[-2.0, 1.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]))
    corners = CUBE.corners_m.reshape(-1, 3)
    assert seen @ corners == pytest.approx(np.array([[3.0, 1.0, 1.0]]))
    away = seen_corners(rays, np.array([[-2.0, 1.0, 1.0]]), np.array([[-1.0, 0.0, 0.0]]))
    assert away.sum() == 0.0


def test_corners_of_one_side_share_their_light() -> None:
    """Weights sum to 1, and stay on their side of an edge."""
    owners = corner_owners(CUBE)
    assert owners.sum(axis=1) == pytest.approx(1.0)
    sides = CUBE.surface[owners.tocoo().coords[1]]
    assert (sides == CUBE.surface[owners.tocoo().coords[0] // 3]).all()
