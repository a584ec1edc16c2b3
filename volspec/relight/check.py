"""How far a componentwise picture is from the exact one, in CIEDE2000.

    coefficient image + light -> [check] -> one number

The basis is good for the lights it was trained on; this tells what it does with another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volspec.basis.report import delta_e_table
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

_PIXELS = 2048
_VISIBLE = 0.05


def componentwise_error(image: CoefficientImage, light: Spectrum) -> float:
    """CIEDE2000 that 95 % of a picture's pixels stay below, componentwise against exact.

    Parameters
    ----------
    image : CoefficientImage
        Up to 2048 of its pixels that are not nearly transparent are looked at.
    light : Spectrum
        On the basis's grid or wider.

    Returns
    -------
    float
        0 for an empty picture.

    Raises
    ------
    SpectrumError
        If the light is black or does not cover the grid.
    """
    rows = np.flatnonzero(image.alpha.ravel() > _VISIBLE)
    if not rows.size:
        return 0.0
    rows = rows[:: -(-rows.size // _PIXELS)]
    channels = image.coefficients.reshape(-1, image.basis.size)[rows]
    channels = channels / image.alpha.ravel()[rows, None]
    basis = image.basis
    spectra = basis.synthesize(channels)
    errors = delta_e_table([light.on(basis.grid)], spectra, [basis.xyz(channels, light)])
    return float(np.percentile(errors, 95))
