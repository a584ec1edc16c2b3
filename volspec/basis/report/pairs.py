"""The errors of every light and reflectance, and of products of reflectances.

    basis, lights, reflectances -> [pairs] -> errors

Predicted and true XYZ are compared in CIEDE2000 with the light as white. A product of surfaces is
what interreflection and coloured absorption make: light * S1 * S2 in full spectra, e * s1 * s2
in channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models.cielab import cielab, delta_E_2000
from volspec.basis.display import MODES, visible_white
from volspec.spectra._colour import colour_science
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.observer import color_matching_functions
from volspec.spectra.photometry import XYZ_of, white_XYZ
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

RGB_PRODUCT = "rgb-product"
"""The RGB renderer's way, beside the modes of a basis."""
PRODUCTS = (2, 3)
"""How many surfaces a ray may have met."""
_MOST_PRODUCTS = 4000
_SEED = 20090128


@dataclass(frozen=True, slots=True, eq=False)
class PairErrors:
    """CIEDE2000 of J lights x K reflectances, three ways and the RGB renderer's.

    Parameters
    ----------
    lights, reflectances : tuple of str
        What they are called.
    delta_e : {way: (J, K) float64}
        By the modes of ``color_matrix`` and `RGB_PRODUCT`.
    XYZ : (J, K, 3) float64
        The full spectra's colours, Y = 100 for white.
    shown_XYZ : {mode: (J, K, 3) float64}
        The channels' colours.
    white_XYZ : (J, 3) float64
        Each light's, no component below what an eye sees.
    products, rgb_products : {2: (J, P), 3: (J, P)}
        Of two and of three reflectances, componentwise and the RGB renderer's; empty where a
        basis has no products.
    """

    lights: tuple[str, ...]
    reflectances: tuple[str, ...]
    delta_e: dict[str, Array]
    XYZ: Array
    shown_XYZ: dict[str, Array]
    white_XYZ: Array
    products: dict[int, Array]
    rgb_products: dict[int, Array]

    @property
    def componentwise(self) -> Array:
        """(J, K) float64."""
        return self.delta_e["componentwise"]

    @property
    def rgb_product(self) -> Array:
        """(J, K) float64."""
        return self.delta_e[RGB_PRODUCT]


def pair_errors(
    basis: SpectralBasis | MaterialBasis,
    lights: Sequence[Spectrum],
    reflectances: Array,
    channels: Array,
    names: Sequence[str],
    chained: bool,
) -> PairErrors:
    """Compare everything, light by light.

    Parameters
    ----------
    basis : SpectralBasis or MaterialBasis
    lights : list of Spectrum
        On the basis' grid.
    reflectances : (K, N) float64
    channels : (K, m) float64
        Theirs.
    names : list of str
        Theirs.
    chained : bool
        Whether channels multiply like spectra do, so that products have an error.
    """
    chosen = {n: products_of(len(reflectances), n) for n in PRODUCTS} if chained else {}
    spectra = {n: reflectances[rows].prod(axis=1) for n, rows in chosen.items()}
    mixed = {n: channels[rows].prod(axis=1) for n, rows in chosen.items()}
    rgb = sharp_surfaces(reflectances, basis.grid, basis.observer_deg)
    rgb_mixed = {n: rgb[rows].prod(axis=1) for n, rows in chosen.items()}
    rows: list[dict[Any, Array]] = []
    for light in lights:
        against = _Reference(light, basis.observer_deg)
        true = against.XYZ(reflectances)
        matrices = {mode: basis.color_matrix(light, mode) for mode in MODES}
        row: dict[Any, Array] = {
            "XYZ": true,
            "white_XYZ": against.white,
            RGB_PRODUCT: against.delta_e(against.lit(rgb), true),
        }
        for mode, matrix in matrices.items():
            row["shown", mode] = channels @ matrix.T
            row[mode] = against.delta_e(row["shown", mode], true)
        for n in chosen:
            chain = against.XYZ(spectra[n])
            row[n] = against.delta_e(mixed[n] @ matrices["componentwise"].T, chain)
            row["rgb", n] = against.delta_e(against.lit(rgb_mixed[n]), chain)
        rows.append(row)
    stacked: dict[Any, Array] = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    return PairErrors(
        lights=tuple(light.name or f"light {j + 1}" for j, light in enumerate(lights)),
        reflectances=tuple(names),
        products={n: stacked.pop(n) for n in chosen},
        rgb_products={n: stacked.pop(("rgb", n)) for n in chosen},
        delta_e={way: stacked.pop(way) for way in (*MODES, RGB_PRODUCT)},
        shown_XYZ={mode: stacked.pop(("shown", mode)) for mode in MODES},
        **stacked,
    )


def products_of(count: int, factors: int) -> Indices:
    """(P, factors) rows of ``count`` reflectances to multiply, in no order, repeats allowed.

    All of two; all of three up to 4000, beyond that as many drawn at random, always the same.
    Two are drawn as well once there are more than can be compared in a second.
    """
    total = comb(count + factors - 1, factors)
    if total <= _MOST_PRODUCTS or (factors == 2 and count <= 150):
        return np.array(list(combinations_with_replacement(range(count), factors)))
    drawn = np.random.default_rng(_SEED).integers(0, count, (_MOST_PRODUCTS, factors))
    return np.sort(drawn, axis=1)


def sharp_surfaces(reflectances: Array, grid: SpectralGrid, observer_deg: int) -> Array:
    """(K, 3) Sharp-sensor responses of surfaces under the flat light, 1 for white."""
    Q = color_matching_functions(grid, observer_deg)
    sharp = _sharp()
    return np.asarray(((reflectances @ Q.T) @ sharp.T) / (sharp @ Q.sum(1)))


class _Reference:
    """One light's full-spectrum colours, and distances from them."""

    def __init__(self, light: Spectrum, observer_deg: int) -> None:
        self._light, self._observer = light, observer_deg
        self._own_white = white_XYZ(light, observer_deg)
        self.white = visible_white(self._own_white)

    def XYZ(self, reflectances: Array) -> Array:
        return XYZ_of(self._light, reflectances, self._observer)

    def lit(self, surfaces: Array) -> Array:
        """The RGB renderer's way: surface times light in Sharp sensors, back in XYZ."""
        sharp = _sharp()
        return np.asarray((surfaces * (sharp @ self._own_white)) @ np.linalg.inv(sharp).T)

    def delta_e(self, predicted: Array, true: Array) -> Array:
        return delta_E_2000(cielab(true, self.white), cielab(predicted, self.white))


def _sharp() -> Array:
    """XYZ to the Sharp sensors of Finlayson and Suesstrunk (2000), the best of the usual here."""
    return np.asarray(colour_science().CHROMATIC_ADAPTATION_TRANSFORMS["Sharp"])
