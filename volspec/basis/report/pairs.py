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

from volspec.appearance.models import cielab
from volspec.basis.display import NO_COLOUR
from volspec.spectra._colour import colour_science
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import XYZ_of, color_matching_functions, white_XYZ
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MODES = ("componentwise", "exact", "linear_model")
"""The modes of ``color_matrix``, as fields of `PairErrors`."""
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
    componentwise, exact, linear_model, rgb_product : (J, K) float64
    XYZ : (J, K, 3) float64
        The full spectra's colours, Y = 100 for white.
    shown_XYZ : {"componentwise", "exact", "linear_model": (J, K, 3)}
        The channels' colours.
    white_XYZ : (J, 3) float64
        Each light's, no component below what an eye sees.
    products, rgb_products : {2: (J, P), 3: (J, P)}
        Of two and of three reflectances, componentwise and the RGB renderer's; empty where a
        basis has no products.
    """

    lights: tuple[str, ...]
    reflectances: tuple[str, ...]
    componentwise: Array
    exact: Array
    linear_model: Array
    rgb_product: Array
    XYZ: Array
    shown_XYZ: dict[str, Array]
    white_XYZ: Array
    products: dict[int, Array]
    rgb_products: dict[int, Array]


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
        matrices = {way: basis.color_matrix(light, way.replace("_", "-")) for way in MODES}
        row: dict[Any, Array] = {
            "XYZ": true,
            "white_XYZ": against.white,
            "rgb_product": against.delta_e(against.lit(rgb), true),
        }
        for way, matrix in matrices.items():
            row["shown", way] = channels @ matrix.T
            row[way] = against.delta_e(row["shown", way], true)
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
        shown_XYZ={way: stacked.pop(("shown", way)) for way in MODES},
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


def rgb_product_delta_e(
    lights: Sequence[Spectrum], reflectances: Array, observer_deg: int = 2
) -> Array:
    """(J, K) CIEDE2000 of the RGB renderer's way: light times surface in three sharp sensors.

    The surface's XYZ under the flat light and the light's own XYZ are multiplied in the Sharp
    sensors of Finlayson and Suesstrunk (2000), the best of the usual ones here.
    """
    surfaces = sharp_surfaces(reflectances, lights[0].grid, observer_deg)
    references = [_Reference(light, observer_deg) for light in lights]
    return np.array([r.delta_e(r.lit(surfaces), r.XYZ(reflectances)) for r in references])


class _Reference:
    """One light's full-spectrum colours, and distances from them."""

    def __init__(self, light: Spectrum, observer_deg: int) -> None:
        self._light, self._observer = light, observer_deg
        self._own_white = white_XYZ(light, observer_deg)
        # X and Z below a thousandth of Y, which no eye sees, are taken as that.
        self.white = np.maximum(self._own_white, NO_COLOUR * self._own_white[1])

    def XYZ(self, reflectances: Array) -> Array:
        return XYZ_of(self._light, reflectances, self._observer)

    def lit(self, surfaces: Array) -> Array:
        """The RGB renderer's way: surface times light in Sharp sensors, back in XYZ."""
        sharp = _sharp()
        return np.asarray((surfaces * (sharp @ self._own_white)) @ np.linalg.inv(sharp).T)

    def delta_e(self, predicted: Array, true: Array) -> Array:
        Lab = (cielab(XYZ, self.white) for XYZ in (true, predicted))
        return np.asarray(colour_science().delta_E(*Lab, method="CIE 2000"))


def _sharp() -> Array:
    """XYZ to the Sharp sensors of Finlayson and Suesstrunk (2000), the best of the usual here."""
    return np.asarray(colour_science().CHROMATIC_ADAPTATION_TRANSFORMS["Sharp"])
