"""Tables follow their curves: every pixel against curves evaluated in float64.

Steps, spikes, opaque points, faint ones and values far from 0, by three steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import DTypeLike
from scipy.ndimage import gaussian_filter

from tests.support.curves import cast_curve
from volspec.basis import SpectralBasis
from volspec.pipeline import Raycaster
from volspec.raycast import Camera, RaycastSpec
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume

MATERIALS = {name: reflectance(name) for name in ("copper", "gold")}
BASIS = SpectralBasis.load("general-7")
ASKED = 2e-4


class Case(NamedTuple):
    """A curve over values of a type that span a range.

    Attributes
    ----------
    most : float
        Greatest error. Spikes of a hundredth of a voxel or less feel the rounding of values to
        float32, and are allowed more.
    """

    dtype: DTypeLike
    span: tuple[float, float]
    points: tuple[tuple[float, float, str], ...]
    most: float = ASKED


U8, U16 = (0.0, 255.0), (0.0, 65535.0)
CASES = {
    "ramp": Case(np.uint8, U8, ((60, 0, "copper"), (110, 0.3, "gold"), (200, 0.8, "gold"))),
    "step": Case(np.uint8, U8, ((90, 0, "copper"), (90, 0.6, "gold"), (200, 0.6, "copper"))),
    "steps of odd values": Case(
        np.uint8,
        U8,
        (
            (60.123, 0, "copper"),
            (90.7654, 0, "copper"),
            (90.7654, 0.5, "gold"),
            (150.3217, 0.5, "gold"),
            (150.3217, 0.1, "copper"),
            (200, 0.1, "copper"),
        ),
    ),
    "steps at both ends": Case(
        np.uint8,
        U8,
        ((80, 0.0, "copper"), (80, 0.5, "gold"), (160, 0.5, "gold"), (160, 0, "gold")),
    ),
    "a step of materials": Case(
        np.uint8,
        U8,
        ((60, 0.2, "copper"), (128, 0.2, "copper"), (128, 0.2, "gold"), (200, 0.2, "gold")),
    ),
    "opaque": Case(np.uint8, U8, ((80, 0, "copper"), (140, 1, "gold"))),
    "a spike of 0.2 in 8 bits": Case(
        np.uint8,
        U8,
        (
            (0, 0, "gold"),
            (127.9, 0, "gold"),
            (128, 0.9, "gold"),
            (128.1, 0, "gold"),
            (255, 0, "gold"),
        ),
        5e-4,
    ),
    "a spike of 10 in 16 bits": Case(
        np.uint16,
        U16,
        (
            (0, 0, "gold"),
            (29995, 0, "gold"),
            (30000, 0.9, "gold"),
            (30005, 0, "gold"),
            (65535, 0, "gold"),
        ),
        5e-4,
    ),
    "two spikes far apart": Case(
        np.uint16,
        U16,
        (
            (100, 0, "gold"),
            (200, 0.9, "gold"),
            (300, 0, "copper"),
            (59900, 0, "gold"),
            (60000, 0.9, "gold"),
            (60100, 0, "gold"),
        ),
    ),
    "faint": Case(np.uint8, U8, ((60, 0, "copper"), (140, 1e-5, "gold"))),
    "far from 0": Case(
        np.float32, (1e6, 1e6 + 1), ((1e6 + 0.25, 0, "copper"), (1e6 + 0.75, 0.7, "gold"))
    ),
}


def volume_of(case: Case) -> Volume:
    """Return waves of noise that reach across the case's range."""
    noise = gaussian_filter(np.random.default_rng(7).random((24, 24, 24)), 3)
    share = (noise - noise.min()) / np.ptp(noise)
    low, high = case.span
    values = low + share * (high - low)
    return Volume((values if case.dtype == np.float32 else np.rint(values)).astype(case.dtype))


@pytest.mark.parametrize("step", [0.37, 0.5, 1.0])
@pytest.mark.parametrize("name", CASES)
def test_every_pixel_is_that_of_the_curve(name: str, step: float) -> None:
    case = CASES[name]
    volume = volume_of(case)
    transfer = TransferFunction(case.points, MATERIALS, BASIS)
    camera = Camera.orbit(volume, azimuth_deg=33, elevation_deg=21)
    spec = RaycastSpec(ambient=1, diffuse=0, alpha_stop=1, step_mm=step)
    caster = Raycaster(volume)
    ours = caster.cast(caster.bake(transfer), camera, (32, 32), spec)
    coefficients, alpha = cast_curve(volume, transfer, camera, (32, 32), step)
    assert alpha.max() > 0.25 * max(opacity for _, opacity, _ in case.points)
    assert np.abs(ours.alpha - alpha).max() < case.most
    assert np.abs(ours.coefficients - coefficients).max() < case.most
