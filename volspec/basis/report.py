"""CIEDE2000 errors of the m-channel picture against full spectra.

    basis, lights, reflectances -> [report] -> error table -> figure

Every error belongs to one reflectance, or one product of reflectances, under one light, which is
the white; 1 is about a just noticeable difference. A product of surfaces results from
interreflection and coloured absorption: light * S1 * S2 in full spectra, e * s1 * s2 in channels.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from itertools import combinations_with_replacement
from math import comb
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import constants as k
from volspec.appearance.display import encode_sRGB, linear_sRGB_from_XYZ, spaces, to_uint8
from volspec.appearance.models import cielab, delta_E_2000
from volspec.basis.base import StoredBasis
from volspec.basis.display import DEFAULT_MODE, MODES, Mode, visible_white
from volspec.errors import BasisError
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    colour_science,
    reflectance_values,
    stack,
    white_XYZ,
)
from volspec.spectra.library import light_set, reflectance_set, reflectance_set_names

Array = NDArray[np.float64]
Reflectances = Sequence[Spectrum] | ArrayLike
Indices = NDArray[np.intp]
# (J, P) errors by the number of surfaces: fitted, componentwise, and of the RGB renderer.
ProductPairs: TypeAlias = dict[str, dict[int, Array]]

RGB_PRODUCT = "rgb-product"
"""The RGB renderer's product, for comparison with the modes of a basis."""
PRODUCTS = (2, 3)
"""Numbers of surfaces whose products are compared."""
PRODUCT_MODES: tuple[Mode, ...] = ("fitted", "componentwise")
"""Modes in which products of surfaces are compared."""
NOTHING = 1e-6
"""Rounding of CIEDE2000."""
_MAX_PRODUCTS = 4000
_SEED = 20090128


def round_delta(delta_e: ArrayLike) -> Array:
    """Return colour differences in whole multiples of `NOTHING`, to be put in order.

    What is exact by construction differs by some 1e-14, and otherwise on each processor.
    """
    return np.round(np.asarray(delta_e, np.float64) / NOTHING)


@dataclass(frozen=True, eq=False)
class PairErrors:
    """CIEDE2000 of J lights x K reflectances, for all modes and the RGB renderer.

    Products of reflectances, some hundred times as many, are compared when they are first asked
    for.
    """

    lights: tuple[str, ...]
    reflectances: tuple[str, ...]
    delta_e: dict[str, Array]  # (J, K) by the modes of ``colour_matrix`` and `RGB_PRODUCT`
    XYZ: Array  # (J, K, 3) of the full spectra, Y = 100 for white
    shown_XYZ: dict[str, Array]  # (J, K, 3) of the channels, by mode
    white_XYZ: Array  # (J, 3), see `visible_white`
    compare_products: Callable[[], ProductPairs] = field(repr=False)

    @cached_property
    def products(self) -> ProductPairs:
        """(J, P) by way and number of surfaces, 2 and 3; empty if channels do not multiply."""
        return self.compare_products()

    @property
    def componentwise(self) -> Array:
        """(J, K) float64."""
        return self.delta_e["componentwise"]

    @property
    def rgb_product(self) -> Array:
        """(J, K) float64."""
        return self.delta_e[RGB_PRODUCT]


def pair_errors(
    basis: StoredBasis,
    lights: Sequence[Spectrum],
    surfaces: Sequence[Spectrum],
    channels: Array,
    chained: bool,
) -> PairErrors:
    """Compare all modes with full spectra, light by light.

    Lights and the K surfaces are on the grid of the full spectra; channels are (K, m).
    ``chained`` is True if channels multiply as spectra do, so that products have an error.
    """
    grid = lights[0].grid
    S = stack(list(surfaces), grid)
    rgb = sharp_surfaces(S, grid, basis.observer_deg)
    rows: list[dict[Any, Array]] = []
    for light in lights:
        against = _Reference(light, basis)
        true = against.XYZ(surfaces)
        matrices = {mode: basis.colour_matrix(light, mode) for mode in MODES}
        row: dict[Any, Array] = {
            "XYZ": true,
            "white_XYZ": against.white,
            RGB_PRODUCT: against.rgb_delta_e(rgb, true),
        }
        for mode, matrix in matrices.items():
            row["shown", mode] = channels @ matrix.T
            row[mode] = against.delta_e(row["shown", mode], true)
        rows.append(row)
    stacked: dict[Any, Array] = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    factors = PRODUCTS if chained else ()
    return PairErrors(
        lights=tuple(light.name or f"light {j + 1}" for j, light in enumerate(lights)),
        reflectances=tuple(surface.name for surface in surfaces),
        delta_e={mode: stacked.pop(mode) for mode in (*MODES, RGB_PRODUCT)},
        shown_XYZ={mode: stacked.pop(("shown", mode)) for mode in MODES},
        compare_products=partial(_product_errors, basis, lights, factors, S, channels, rgb),
        **stacked,
    )


def _product_errors(
    basis: StoredBasis,
    lights: Sequence[Spectrum],
    factors: Sequence[int],
    *surfaces: Array,
) -> ProductPairs:
    """Compare products of ``factors`` of the surfaces: reflectances, channels and Sharp sensors."""
    errors: ProductPairs = {mode: {} for mode in (*PRODUCT_MODES, RGB_PRODUCT)}
    for n in factors:
        rows = product_rows(len(surfaces[0]), n)
        spectra, mixed, rgb = (surface[rows].prod(axis=1) for surface in surfaces)
        by_mode: dict[str, list[Array]] = {mode: [] for mode in errors}
        for light in lights:
            against = _Reference(light, basis)
            true = against.XYZ(spectra)
            for mode in PRODUCT_MODES:
                predicted = mixed @ basis.colour_matrix(light, mode).T
                by_mode[mode].append(against.delta_e(predicted, true))
            by_mode[RGB_PRODUCT].append(against.rgb_delta_e(rgb, true))
        for key, values in by_mode.items():
            errors[key][n] = np.array(values)
    return errors


def product_rows(count: int, factors: int) -> Indices:
    """Return (P, factors) rows of ``count`` reflectances to multiply, repeats allowed.

    All pairs, and up to 4000 triples; above that, a fixed random sample (of pairs, too, if there
    are more than can be compared in a second).
    """
    total = comb(count + factors - 1, factors)
    if total <= _MAX_PRODUCTS or (factors == 2 and count <= 150):
        return np.array(list(combinations_with_replacement(range(count), factors)))
    drawn = np.random.default_rng(_SEED).integers(0, count, (_MAX_PRODUCTS, factors))
    return np.sort(drawn, axis=1)


def sharp_surfaces(reflectances: Array, grid: SpectralGrid, observer_deg: Observer) -> Array:
    """Return (K, 3) Sharp-sensor responses of surfaces under the flat light, 1 for white."""
    Q = colour_matching_functions(grid, observer_deg)
    sharp = _sharp()
    return np.asarray(((reflectances @ Q.T) @ sharp.T) / (sharp @ Q.sum(1)))


class _Reference:
    """Full-spectrum colours under one light, and distances from them.

    Each side has its own white, if the basis has other bands.
    """

    def __init__(self, light: Spectrum, basis: StoredBasis) -> None:
        self._light, self._observer = light, basis.observer_deg
        self._own_white = white_XYZ(light, basis.observer_deg)
        self.white = visible_white(self._own_white)
        self._shown_white = visible_white(white_XYZ(light.on(basis.grid), basis.observer_deg))

    def XYZ(self, reflectances: Reflectances) -> Array:
        return XYZ_from_spectra(self._light, reflectances, self._observer)

    def rgb_delta_e(self, surfaces: Array, true: Array) -> Array:
        """Multiply surfaces by the light in Sharp sensors, like an RGB renderer, and compare."""
        sharp = _sharp()
        product = (surfaces * (sharp @ self._own_white)) @ np.linalg.inv(sharp).T
        return delta_E_2000(cielab(true, self.white), cielab(product, self.white))

    def delta_e(self, predicted: Array, true: Array) -> Array:
        return delta_E_2000(cielab(true, self.white), cielab(predicted, self._shown_white))


def _sharp() -> Array:
    """Return XYZ to the Sharp sensors of Finlayson and Suesstrunk (2000), the best usual choice."""
    return np.asarray(colour_science().CHROMATIC_ADAPTATION_TRANSFORMS["Sharp"])


ADAPTATION = "CAT02, complete, to the display's D65"
"""Adaptation of colours under other lights to the display, for comparison side by side."""

WAYS = {
    "fitted": "fitted to the light",
    "componentwise": "componentwise",
    "exact": "exact light matrix",
    "linear-model": "linear model",
    RGB_PRODUCT: "RGB product",
}
"""Names of the modes of a basis, and of the RGB renderer's product."""


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """CIEDE2000 over all pairs of a light and a reflectance."""

    mean: float
    median: float
    p95: float
    max: float

    def __str__(self) -> str:
        return f"{self.mean:.3f} / {self.median:.3f} / {self.p95:.3f} / {self.max:.3f}"

    @classmethod
    def of(cls, delta_e: ArrayLike) -> ErrorSummary:
        """Return the mean, median, 95th percentile and maximum of an array of any shape."""
        d = np.asarray(delta_e, dtype=np.float64)
        return cls(*(float(f) for f in (d.mean(), np.median(d), np.percentile(d, 95), d.max())))


@dataclass(frozen=True, slots=True)
class ProductErrors:
    """CIEDE2000 of products of reflectances, by mode and by the RGB renderer."""

    fitted: ErrorSummary
    componentwise: ErrorSummary
    rgb_product: ErrorSummary


@dataclass(frozen=True, slots=True)
class WorstPair:
    """Pair of a light and a reflectance with a large error: true colour and channels' colour.

    ``way`` is the mode of the channels' colour. XYZ has Y = 100 for white; the sRGB codes are
    the same colours adapted to the display (`ADAPTATION`).
    """

    light: str
    reflectance: str
    delta_e: float
    way: str = DEFAULT_MODE
    XYZ: tuple[float, ...] = ()
    XYZ_shown: tuple[float, ...] = ()
    sRGB: str = ""
    sRGB_shown: str = ""

    @classmethod
    def at(
        cls, pairs: PairErrors, light: int, reflectance: int, way: str = DEFAULT_MODE
    ) -> WorstPair:
        """Return one pair in one mode of the basis."""
        true, predicted = pairs.XYZ[light, reflectance], pairs.shown_XYZ[way][light, reflectance]
        codes = sRGB_codes(np.array([true, predicted]), pairs.white_XYZ[light])
        sRGB, sRGB_shown = (f"#{r:02x}{g:02x}{b:02x}" for r, g, b in codes.tolist())
        return cls(
            light=pairs.lights[light],
            reflectance=pairs.reflectances[reflectance],
            delta_e=float(pairs.delta_e[way][light, reflectance]),
            way=way,
            XYZ=tuple(map(float, true)),
            XYZ_shown=tuple(map(float, predicted)),
            sRGB=sRGB,
            sRGB_shown=sRGB_shown,
        )


@dataclass(frozen=True)
class BasisReport:
    """Error table of a basis; ``str`` prints it."""

    basis: str
    size: int
    method: str
    trained_on: str
    errors: dict[str, ErrorSummary]
    """Keyed by `WAYS`."""
    worst: WorstPair
    """Worst pair in the default mode."""
    pairs: PairErrors = field(repr=False, compare=False)
    """All single errors, for figures."""

    @cached_property
    def products(self) -> dict[int, ProductErrors]:
        """Keyed by the number of surfaces, 2 and 3; empty if channels do not multiply (materials).

        Computed when first asked for.
        """
        ways = self.pairs.products
        return {
            n: ProductErrors(*(ErrorSummary.of(ways[mode][n]) for mode in ways))
            for n in ways["fitted"]
        }

    @property
    def fitted(self) -> ErrorSummary:
        """Errors of the matrix fitted to each light."""
        return self.errors["fitted"]

    @property
    def componentwise(self) -> ErrorSummary:
        """Errors of light times surface, channel by channel."""
        return self.errors["componentwise"]

    @property
    def exact(self) -> ErrorSummary:
        """Errors of the exact light matrix."""
        return self.errors["exact"]

    @property
    def linear_model(self) -> ErrorSummary:
        """Errors of the analysed product of two spectra in the basis."""
        return self.errors["linear-model"]

    @property
    def rgb_product(self) -> ErrorSummary:
        """Errors of the RGB renderer: light times surface in three sharp sensors."""
        return self.errors[RGB_PRODUCT]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON types, without single pairs."""
        return {
            "basis": self.basis,
            "size": self.size,
            "method": self.method,
            "trained_on": self.trained_on,
            "fitted": asdict(self.fitted),
            "componentwise": asdict(self.componentwise),
            "exact": asdict(self.exact),
            "linear_model": asdict(self.linear_model),
            "rgb_product": asdict(self.rgb_product),
            "products": {str(n): asdict(p) for n, p in self.products.items()},
            "worst": asdict(self.worst),
        }

    def __str__(self) -> str:
        rows = [(words, self.errors[mode]) for mode, words in WAYS.items()]
        for n, errors in self.products.items():
            rows += [
                (f"{n} surfaces", errors.fitted),
                (f"{n} surfaces, RGB", errors.rgb_product),
            ]
        return "\n".join(
            [
                f"{self.basis}: {self.method}, {self.size} channels, trained on {self.trained_on}",
                "CIEDE2000 against full spectra: mean / median / 95 % / max",
                *(f"  {name:19s}  {summary}" for name, summary in rows),
                f"  worst: {self.worst.reflectance} under {self.worst.light}, "
                f"{self.worst.delta_e:.3f} ({WAYS[self.worst.way]})",
            ]
        )


def basis_report(
    basis: ReportedBasis,
    lights: Sequence[Spectrum] | None = None,
    reflectances: Reflectances | None = None,
    names: Sequence[str] | None = None,
    grid: SpectralGrid | None = None,
) -> BasisReport:
    """Compare the colours of all modes, and of an RGB renderer, with full spectra.

    ``grid`` has the bands of the full spectra, by default the basis'. Other defaults are the 26
    smooth lights, and the 84 held-out samples of ``reflectance_set("test")`` or the materials of a
    `MaterialBasis`, which has no channels for others. Raises BasisError if a list is empty, the
    names do not match, or a reflectance is not one of the materials; SpectrumError if a spectrum
    does not cover the grid.
    """
    grid = grid or basis.grid
    lights = light_set("smooth", grid) if lights is None else [s.on(grid) for s in lights]
    if reflectances is None:
        reflectances, names = basis.test_surfaces(grid)
    surfaces = _samples(reflectances, names, grid)
    if not lights or not surfaces:
        raise BasisError(
            "report: no lights or no reflectances given; nothing to compare", code="missing"
        )
    channels = basis.surface_channels(surfaces)
    pairs = pair_errors(basis, lights, surfaces, channels, chained=basis.multiplies)
    j, i = divmod(int(round_delta(pairs.delta_e[DEFAULT_MODE]).argmax()), len(surfaces))
    return BasisReport(
        basis=basis.name,
        size=basis.size,
        method=basis.method,
        trained_on=basis.trained_on,
        errors={mode: ErrorSummary.of(pairs.delta_e[mode]) for mode in WAYS},
        worst=WorstPair.at(pairs, j, i),
        pairs=pairs,
    )


def sRGB_codes(XYZ: Array, white_XYZ: Array) -> NDArray[np.uint8]:
    """Return (..., 3) sRGB codes of colours under a white, by `ADAPTATION`, clipped."""
    CAT02 = k.CAT02_FROM_XYZ
    # A nearly monochromatic white may have a response near 0: keep the gain finite.
    white = np.maximum(CAT02 @ white_XYZ, 1e-3 * white_XYZ[1])
    adapted = (XYZ @ CAT02.T) * ((CAT02 @ spaces.sRGB_WHITE_XYZ) / white)
    return to_uint8(encode_sRGB(linear_sRGB_from_XYZ(adapted @ np.linalg.inv(CAT02).T)))


def _samples(
    reflectances: Reflectances, names: Sequence[str] | None, grid: SpectralGrid
) -> list[Spectrum]:
    """Return reflectances on a grid, each with a name, and with what it emits."""
    if isinstance(reflectances, Spectrum):
        reflectances = [reflectances]
    S = reflectance_values(reflectances, grid, "report: reflectances").reshape(-1, grid.size)
    spectra = list(reflectances) if isinstance(reflectances, list | tuple) else [None] * len(S)
    names = [getattr(s, "name", "") for s in spectra] if names is None else list(names)
    if len(names) != len(S):
        raise BasisError(
            f"report: {len(names)} names for {len(S)} reflectances; give one for each", code="shape"
        )
    surfaces = []
    for i, (row, name, spectrum) in enumerate(zip(S, names, spectra, strict=True), start=1):
        emitting = getattr(spectrum, "fluorescence", None)
        fluorescence = emitting and emitting.on(grid)
        name = name or f"reflectance {i}"
        surfaces.append(Spectrum(grid.wavelengths_nm, row, name, fluorescence=fluorescence))
    return surfaces


class ReportedBasis(StoredBasis):
    """A basis that reports its errors."""

    __slots__ = ()

    multiplies: ClassVar[bool] = True
    """True if channels multiply as spectra do, so that products of surfaces have an error."""

    def test_surfaces(self, grid: SpectralGrid) -> tuple[Reflectances, Sequence[str]]:
        """Return the default reflectances of a report, the held-out ones, and their names."""
        return reflectance_set("test", grid), reflectance_set_names("test")

    @abstractmethod
    def surface_channels(self, surfaces: Sequence[Spectrum]) -> Array:
        """Return (K, m) channels of reflectances; raise BasisError if there are none."""

    def report(
        self, lights: Sequence[Spectrum] | None = None, reflectances: Reflectances | None = None
    ) -> BasisReport:
        """Return CIEDE2000 errors against full spectra; see `volspec.basis.report.basis_report`.

        Defaults: the 26 smooth lights on the 84 held-out samples, or on the basis' materials.

        Examples
        --------
        >>> from volspec.basis import SpectralBasis
        >>> from volspec.spectra import light, reflectance
        >>> samples = [reflectance("gold"), reflectance("CES/5")]
        >>> table = SpectralBasis.load("general-7").report([light("D65"), light("A")], samples)
        >>> table.fitted.max < 0.1 < table.rgb_product.max
        True
        """
        return basis_report(self, lights, reflectances)
