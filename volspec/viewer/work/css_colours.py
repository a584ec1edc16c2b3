"""CSS colours as reflectances, made in the background.

    names -> [css_colours] -> panels

The first reflectance takes seconds, as colour-science and its base spectra are loaded; the others
take milliseconds.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache, partial

from volspec.errors import VolspecError
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    light,
    reflectances_from_colours,
    white_XYZ,
)
from volspec.spectra.construct import colour_XYZ
from volspec.viewer.model.materials import colour_names


class Colours:
    """Reflectances by name: None until they are made, empty if they cannot be."""

    def __init__(self, grid: SpectralGrid, observer_deg: Observer) -> None:
        self.spectra: Mapping[str, Spectrum] | None = None
        make = partial(self._make, grid, observer_deg)
        threading.Thread(target=make, name="volspec-colours", daemon=True).start()

    def _make(self, grid: SpectralGrid, observer_deg: Observer) -> None:
        spectra: Mapping[str, Spectrum] = {}
        try:
            with suppress(VolspecError):
                spectra = _reflectances(grid, observer_deg)
        finally:  # panels must not wait for ever
            self.spectra = spectra


@lru_cache(maxsize=1)
def colours(grid: SpectralGrid, observer_deg: Observer) -> Colours:
    """Return the colours on a grid; the first call starts making them."""
    return Colours(grid, observer_deg)


def _reflectances(grid: SpectralGrid, observer_deg: Observer) -> dict[str, Spectrum]:
    lamp = light("D65", grid)
    white = white_XYZ(lamp, observer_deg)
    XYZ = [colour_XYZ(name, white) for name in colour_names()]
    rows = reflectances_from_colours(XYZ, light=lamp, observer_deg=observer_deg, grid=grid).values
    pairs = zip(colour_names(), rows, strict=True)
    return {name: Spectrum(grid.wavelengths_nm, row, name) for name, row in pairs}
