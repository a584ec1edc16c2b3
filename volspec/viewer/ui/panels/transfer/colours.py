"""What materials look like under the lights that are on, to an eye adapted to them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.relight import RelightSpec
from volspec.spectra import SpectralGrid, Spectrum, XYZ_of, white_XYZ
from volspec.transfer import Transfer
from volspec.transfer.mixes import share_matrix
from volspec.viewer.model.lights.lighting import Rows, rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer.parts import parts_of
from volspec.viewer.ui.panels.lights.colours import Colour, adapted_to, as_colour

Array = NDArray[np.float64]


def part_colours(state: ViewState) -> tuple[Colour, ...]:
    """Of every part's mix; sRGB codes, 0 to 1."""
    return _part_colours(state.transfer, state.lights, state.seen)


def material_colours(state: ViewState) -> dict[str, Colour]:
    """Of every material by name."""
    return _material_colours(state.transfer, state.lights, state.seen)


def spectrum_colour(state: ViewState, spectrum: Spectrum) -> Colour:
    """Of a reflectance that is no material yet."""
    basis = state.transfer.basis
    return _spectrum_colour(spectrum, basis.grid, basis.observer_deg, state.lights, state.seen)


@lru_cache(maxsize=512)
def _spectrum_colour(
    spectrum: Spectrum, grid: SpectralGrid, observer_deg: int, lights: Rows, seen: RelightSpec
) -> Colour:
    light, shown = _adapted(lights, seen, grid, observer_deg)
    XYZ = np.zeros((1, 3)) if light is None else XYZ_of(light, [spectrum], observer_deg)
    return as_colour(shown(XYZ)[0])


@lru_cache(maxsize=64)
def _part_colours(transfer: Transfer, lights: Rows, seen: RelightSpec) -> tuple[Colour, ...]:
    names = list(transfer.materials)
    shares = share_matrix([part.mix for part in parts_of(transfer)], names)
    return _coloured(transfer, lights, seen, shares)


@lru_cache(maxsize=64)
def _material_colours(transfer: Transfer, lights: Rows, seen: RelightSpec) -> dict[str, Colour]:
    names = list(transfer.materials)
    shown = _coloured(transfer, lights, seen, np.eye(len(names)))
    return dict(zip(names, shown, strict=True))


def _coloured(
    transfer: Transfer, lights: Rows, seen: RelightSpec, shares: Array
) -> tuple[Colour, ...]:
    """Of mixes, (P, K) shares; of dark where no light is on."""
    basis = transfer.basis
    light, shown = _adapted(lights, seen, basis.grid, basis.observer_deg)
    XYZ = np.zeros((shares.shape[1], 3))
    if light is not None:
        XYZ = XYZ_of(light, list(transfer.materials.values()), basis.observer_deg)
    codes = shown(shares @ XYZ)
    return tuple(as_colour(each) for each in codes)


@lru_cache(maxsize=64)
def _adapted(
    lights: Rows, seen: RelightSpec, grid: SpectralGrid, observer_deg: int
) -> tuple[Spectrum | None, Callable[[Array], Array]]:
    """The light, and what makes of (P, 3) XYZ under it the (P, 3) codes that look alike."""

    def codes(XYZ: Array) -> Array:
        return encode(linear_from_XYZ(XYZ))

    rig = rig_of(lights)
    if rig is None:
        return None, codes
    light = rig.mixed(grid)
    passage = adapted_to(rig, seen, white_XYZ(light, observer_deg))
    return light, codes if passage is None else lambda XYZ: codes(passage.apply(XYZ))
