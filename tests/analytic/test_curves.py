"""Tables follow their curves: every pixel against curves evaluated in float64.

Steps, spikes, opaque points, faint ones and values far from 0, by three steps.
"""

import numpy as np
import pytest
from numpy.typing import DTypeLike
from scipy.ndimage import gaussian_filter

import volspec as vs
from tests.support.curves import cast_curve
from tests.support.fixtures import slow_each
from tests.support.raycasts import METAL_BASIS, METALS

ASKED = 2e-4
Point = tuple[float, float, str]
# Values of a type that span a range, and a curve over them.
Case = tuple[DTypeLike, tuple[float, float], list[Point]]


def bytes_(*points: Point) -> Case:
    return np.uint8, (0.0, 255.0), [*points]


def spike(at: float, half: float, end: str = "gold") -> list[Point]:
    return [(at - half, 0, "gold"), (at, 0.9, "gold"), (at + half, 0, end)]


def shorts(*points: Point) -> Case:
    return np.uint16, (0.0, 65535.0), [*points]


CASES = {
    "ramp": bytes_((60, 0, "copper"), (110, 0.3, "gold"), (200, 0.8, "gold")),
    "step": bytes_((90, 0, "copper"), (90, 0.6, "gold"), (200, 0.6, "copper")),
    "steps of odd values": bytes_(
        *((60.123, 0, "copper"), (90.7654, 0, "copper"), (90.7654, 0.5, "gold")),
        *((150.3217, 0.5, "gold"), (150.3217, 0.1, "copper"), (200, 0.1, "copper")),
    ),
    "steps at both ends": bytes_(
        *((80, 0.0, "copper"), (80, 0.5, "gold"), (160, 0.5, "gold"), (160, 0, "gold"))
    ),
    "a step of materials": bytes_(
        *((60, 0.2, "copper"), (128, 0.2, "copper"), (128, 0.2, "gold"), (200, 0.2, "gold"))
    ),
    "opaque": bytes_((80, 0, "copper"), (140, 1, "gold")),
    "a spike of 0.2 in 8 bits": bytes_((0, 0, "gold"), *spike(128, 0.1), (255, 0, "gold")),
    "a spike of 10 in 16 bits": shorts((0, 0, "gold"), *spike(30000, 5), (65535, 0, "gold")),
    "two spikes far apart": shorts(*spike(200, 100, "copper"), *spike(60000, 100)),
    "faint": bytes_((60, 0, "copper"), (140, 1e-5, "gold")),
    "far from 0": (
        np.float32,
        (1e6, 1e6 + 1),
        [(1e6 + 0.25, 0, "copper"), (1e6 + 0.75, 0.7, "gold")],
    ),
}
USUAL = ("ramp", "two spikes far apart")


def volume_of(dtype: DTypeLike, span: tuple[float, float]) -> vs.Volume:
    """Return waves of noise that reach across a range."""
    noise = gaussian_filter(np.random.default_rng(7).random((24, 24, 24)), 3)
    share = (noise - noise.min()) / np.ptp(noise)
    values = span[0] + share * (span[1] - span[0])
    return vs.Volume((values if dtype == np.float32 else np.rint(values)).astype(dtype))


@pytest.mark.parametrize("step", [0.37, *slow_each(0.5, 1.0)])
@pytest.mark.parametrize(
    "name", [*USUAL, *slow_each(*(name for name in CASES if name not in USUAL))]
)
def test_every_pixel_is_that_of_the_curve(name, step):
    dtype, span, points = CASES[name]
    volume, transfer = volume_of(dtype, span), vs.TransferFunction(points, METALS, METAL_BASIS)
    camera = vs.Camera.orbit(volume, azimuth_deg=33, elevation_deg=21)
    spec = vs.RaycastSpec(ambient=1, diffuse=0, alpha_stop=1, step_mm=step)
    caster = vs.Raycaster(volume)
    ours = caster.cast(caster.bake(transfer), camera, (32, 32), spec)
    coefficients, alpha = cast_curve(volume, transfer, camera, (32, 32), step)
    assert alpha.max() > 0.25 * max(opacity for _, opacity, _ in points)
    # Spikes of a hundredth of a voxel or less feel the rounding of values to float32.
    most = 5e-4 if name.startswith("a spike") else ASKED
    assert np.abs(ours.alpha - alpha).max() < most
    assert np.abs(ours.coefficients - coefficients).max() < most
