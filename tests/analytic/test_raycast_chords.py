"""Transmittance of a short chord through dense matter: Beer-Lambert, however opaque a step is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from volspec.raycast import Camera, RaycastSpec, reference
from volspec.raycast.gpu import Raycaster
from volspec.transfer import TransferTable
from volspec.volume import Volume

FLAT = RaycastSpec(ambient=1, diffuse=0, alpha_stop=1)
SIDE = 14
LANES = pytest.mark.parametrize("lanes", [1, 8])
KINDS = pytest.mark.parametrize("kind", ["values", "rows", "labels"])


def volume_of(kind: str, values: NDArray[Any]) -> Volume:
    """uint8, for which other tests have compiled the kernel: each takes seconds."""
    return Volume(values.astype(np.float32 if kind == "values" else np.int16))


def body(kind: str) -> Volume:
    """100 everywhere."""
    return volume_of(kind, np.full((SIDE,) * 3, 100))


def matter(kind: str, opacity: float, reference_step_mm: float) -> TransferTable:
    """Opacity of 100; values around it are clear, so that nothing is constant in the table."""
    if kind == "labels":
        opacities = np.zeros(102)
        opacities[100] = opacity
        return TransferTable(
            (0.0, 101.0), opacities, np.ones((102, 1)), reference_step_mm, labels=True
        )
    opacities = np.array([0, 0, opacity, 0, 0])
    if kind == "values":
        return TransferTable((0.0, 200.0), opacities, np.ones((5, 1)), reference_step_mm)
    rows = np.stack([opacities, 0.5 * opacities])
    return TransferTable(
        (0.0, 200.0), rows, np.ones((2, 5, 1)), reference_step_mm, gradient_top=4.0
    )


def cut(thickness: float) -> RaycastSpec:
    """Leaves a slab that thick, square to z and away from the steps' borders."""
    low = 6.031
    return replace(FLAT, crop_voxels=((0, SIDE), (0, SIDE), (low, low + thickness)))


def through() -> Camera:
    middle = (SIDE - 1) / 2
    return Camera((middle, middle, 60.25), (middle, middle, middle), up=(0, 1, 0), height_mm=4)


@LANES
@KINDS
@pytest.mark.parametrize(
    ("opacity", "reference_step_mm", "step_mm"),
    [(0.9999, 1, 2), (0.99, 0.1, 0.5), (0.99, 0.1, 2), (0.6, 1, 1), (0.3, 1, 1)],
)
def test_a_short_chord_takes_what_its_length_takes(
    kind: str, opacity: float, reference_step_mm: float, step_mm: float, lanes: int
) -> None:
    """Transmittances of a step down to 1e-40, far below the resolution of 1 − opacity.

    Ends of the chord rounded to 1e-6 of 14 mm, at 46 nepers a mm, bound the error near 2e-4.
    """
    caster = Raycaster(body(kind), lanes=lanes)
    table = matter(kind, opacity, reference_step_mm)
    for thickness in (0.003, 0.03, 0.3):
        spec = replace(cut(thickness), step_mm=step_mm)
        alpha = caster.cast(table, through(), (5, 5), spec).alpha
        true = 1 - (1 - opacity) ** (thickness / reference_step_mm)
        assert np.abs(alpha - true).max() < 2e-4, (alpha[2, 2], true)


@KINDS
@pytest.mark.parametrize(
    ("adaptive", "lanes"), [(0.0, 1), (0.0, 8), pytest.param(0.1, 8, marks=pytest.mark.slow)]
)
def test_a_faint_medium_keeps_its_digits(kind: str, adaptive: float, lanes: int) -> None:
    """1 − opacity has none left at 1e-9; chords of clipped, whole and long steps alike.

    Five digits: float32 rounds the chord's ends to 1e-6 of 14 mm.
    """
    table = matter(kind, 1e-9, 1.0)
    for thickness in (0.3, 6.3):
        spec = replace(cut(thickness), step_mm=1.0, adaptive=adaptive)
        alpha = Raycaster(body(kind), lanes=lanes).cast(table, through(), (5, 5), spec).alpha
        assert np.abs(alpha / (1e-9 * thickness) - 1).max() < 2e-5


@LANES
def test_an_opaque_step_is_opaque_and_a_clear_one_clear_however_short(lanes: int) -> None:
    caster = Raycaster(body("values"), lanes=lanes)
    for opacity in (0.0, 1.0):
        alpha = caster.cast(matter("values", opacity, 1.0), through(), (5, 5), cut(0.003)).alpha
        assert (alpha == opacity).all()


@LANES
@KINDS
def test_dense_matter_between_entries_is_as_the_reference_has_it(kind: str, lanes: int) -> None:
    """Values, rows and labels mixed from clear to nearly opaque, seen through short chords."""
    rng = np.random.default_rng(0)
    values = rng.integers(60, 141, (SIDE,) * 3)
    if kind == "labels":
        values = np.where(values < 95, 100, np.where(values < 125, 50, 0))
    volume = volume_of(kind, values)
    table = matter(kind, 0.9999, 1.0)
    spec = replace(cut(0.03), step_mm=1.5)
    ours = Raycaster(volume, lanes=lanes).cast(table, through(), (24, 24), spec).alpha
    true = reference.cast(volume, table, through(), (24, 24), spec)[1]
    assert 0.005 < true.mean() < 0.9
    assert np.abs(ours - true).max() < 2e-4
