"""The colours of the web as reflectances, made in the background.

    names -> [css_colours] -> panels

The first reflectance of a colour takes seconds, as colour-science and its base spectra are read
for it; those after it take milliseconds.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import lru_cache

from volspec.errors import VolspecError
from volspec.spectra import SpectralGrid, Spectrum, light, reflectances_of, white_XYZ
from volspec.spectra.construct.colours import colour_XYZ
from volspec.viewer.model.materials import colour_names

_LIGHT = "D65"


class Colours:
    """Their reflectances, once they are made.

    Parameters
    ----------
    grid : SpectralGrid
    observer_deg : {2, 10}

    Attributes
    ----------
    spectra : {name: Spectrum} or None
        None until then; empty where none can be made.
    """

    def __init__(self, grid: SpectralGrid, observer_deg: int) -> None:
        self.spectra: Mapping[str, Spectrum] | None = None
        self._of = grid, observer_deg
        threading.Thread(target=self._make, name="volspec-colours", daemon=True).start()

    def _make(self) -> None:
        made: Mapping[str, Spectrum] = {}
        try:
            made = _made(*self._of)
        except VolspecError:
            return
        finally:  # nobody waits for what will not come, whatever the fault
            self.spectra = made


@lru_cache(maxsize=1)
def colours(grid: SpectralGrid, observer_deg: int) -> Colours:
    """Those of a grid; the first call begins to make them."""
    return Colours(grid, observer_deg)


def _made(grid: SpectralGrid, observer_deg: int) -> dict[str, Spectrum]:
    lamp = light(_LIGHT, grid)
    white = white_XYZ(lamp, observer_deg)
    XYZ = [colour_XYZ(name, white) for name in colour_names()]
    rows = reflectances_of(XYZ, light=lamp, observer_deg=observer_deg, grid=grid).values
    pairs = zip(colour_names(), rows, strict=True)
    return {name: Spectrum(grid.wavelengths_nm, row, name) for name, row in pairs}
