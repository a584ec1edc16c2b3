"""How far the m-channel picture is from the full spectra, in CIEDE2000.

    basis, lights, reflectances -> [report] -> error table -> figure

The reference is the XYZ of the full spectra, the white is the light. Every error is that of
one reflectance, or one product of reflectances, under one light; 1 is about what an eye can just
tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance import srgb
from volspec.basis.materials import MaterialBasis
from volspec.basis.report.pairs import RGB_PRODUCT, PairErrors, pair_errors
from volspec.errors import BasisError
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.library import light_set, reflectance_set, reflectance_set_names
from volspec.spectra.spectrum import Spectrum
from volspec.spectra.values import reflectance_values

if TYPE_CHECKING:
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]
Reflectances = Sequence[Spectrum] | ArrayLike

ADAPTATION = "CAT02, complete, to the display's D65"
"""How colours under other lights are carried to the display, to be shown side by side."""

WAYS = {
    "componentwise": "componentwise",
    "exact": "exact light matrix",
    "linear-model": "linear model",
    RGB_PRODUCT: "RGB product",
}
"""The ways of making a colour, in words: the modes of a basis, and the RGB renderer's."""
# What a method is made for, where that is not light times surface by components.
_MADE_FOR = {"pca": "linear-model", "reduced-rank": "exact"}


def own_way(method: str) -> str:
    """The mode that a method's bases are made for: a key of `WAYS`."""
    return _MADE_FOR.get(method, "componentwise")


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
        """Mean, median, 95th percentile and maximum of an array of any shape."""
        d = np.asarray(delta_e, dtype=np.float64)
        return cls(*(float(f) for f in (d.mean(), np.median(d), np.percentile(d, 95), d.max())))


@dataclass(frozen=True, slots=True)
class ProductErrors:
    """CIEDE2000 of componentwise products of reflectances, and of the RGB renderer's."""

    componentwise: ErrorSummary
    rgb_product: ErrorSummary


@dataclass(frozen=True, slots=True)
class WorstPair:
    """A light and a reflectance far off: its true colour, and the one shown by the channels.

    ``way`` is the mode of the channels' colour. XYZ have Y = 100 for white; the sRGB codes are
    the same colours carried to the display (`ADAPTATION`).
    """

    light: str
    reflectance: str
    delta_e: float
    way: str = "componentwise"
    XYZ: tuple[float, ...] = ()
    XYZ_shown: tuple[float, ...] = ()
    sRGB: str = ""
    sRGB_shown: str = ""

    @classmethod
    def at(
        cls, pairs: PairErrors, light: int, reflectance: int, way: str = "componentwise"
    ) -> WorstPair:
        """One pair of many, shown one way: a mode of the basis."""
        true, shown = pairs.XYZ[light, reflectance], pairs.shown_XYZ[way][light, reflectance]
        codes = displayed(np.array([true, shown]), pairs.white_XYZ[light])
        sRGB, sRGB_shown = (f"#{r:02x}{g:02x}{b:02x}" for r, g, b in codes.tolist())
        return cls(
            light=pairs.lights[light],
            reflectance=pairs.reflectances[reflectance],
            delta_e=float(pairs.delta_e[way][light, reflectance]),
            way=way,
            XYZ=tuple(map(float, true)),
            XYZ_shown=tuple(map(float, shown)),
            sRGB=sRGB,
            sRGB_shown=sRGB_shown,
        )


@dataclass(frozen=True, slots=True)
class BasisReport:
    """The error table of a basis; ``str`` prints it."""

    basis: str
    size: int
    method: str
    trained_on: str
    errors: dict[str, ErrorSummary]
    """By way of making a colour (`WAYS`)."""
    products: dict[int, ProductErrors]
    """By the number of surfaces, 2 and 3; empty where channels do not multiply (materials)."""
    worst: WorstPair
    """Of the way that the basis' method is made for."""
    pairs: PairErrors = field(repr=False, compare=False)
    """Every single error, for figures."""

    @property
    def componentwise(self) -> ErrorSummary:
        """Light times surface, channel by channel."""
        return self.errors["componentwise"]

    @property
    def exact(self) -> ErrorSummary:
        """By the light's matrix."""
        return self.errors["exact"]

    @property
    def linear_model(self) -> ErrorSummary:
        """By the product of two spectra of the basis, measured again."""
        return self.errors["linear-model"]

    @property
    def rgb_product(self) -> ErrorSummary:
        """The RGB renderer's: light times surface in three sharp sensors."""
        return self.errors[RGB_PRODUCT]

    def to_dict(self) -> dict[str, Any]:
        """As JSON types, without the single pairs."""
        return {
            "basis": self.basis,
            "size": self.size,
            "method": self.method,
            "trained_on": self.trained_on,
            "componentwise": asdict(self.componentwise),
            "exact": asdict(self.exact),
            "linear_model": asdict(self.linear_model),
            "rgb_product": asdict(self.rgb_product),
            "products": {str(n): asdict(p) for n, p in self.products.items()},
            "worst": asdict(self.worst),
        }

    def __str__(self) -> str:
        rows = [(words, self.errors[way]) for way, words in WAYS.items()]
        for n, errors in self.products.items():
            rows += [
                (f"{n} surfaces", errors.componentwise),
                (f"{n} surfaces, RGB", errors.rgb_product),
            ]
        return "\n".join(
            [
                f"{self.basis}: {self.method}, {self.size} channels, trained on {self.trained_on}",
                "CIEDE2000 against full spectra: mean / median / 95 % / max",
                *(f"  {name:18s}  {summary}" for name, summary in rows),
                f"  worst: {self.worst.reflectance} under {self.worst.light}, "
                f"{self.worst.delta_e:.3f} ({WAYS[self.worst.way]})",
            ]
        )


def report(
    basis: SpectralBasis | MaterialBasis,
    lights: Sequence[Spectrum] | None = None,
    reflectances: Reflectances | None = None,
    names: Sequence[str] | None = None,
) -> BasisReport:
    """Compare the picture by components, by matrix and by RGB with the full spectra.

    Parameters
    ----------
    basis : SpectralBasis or MaterialBasis
    lights : list of Spectrum, optional
        Default: the 26 smooth lights.
    reflectances : list of Spectrum or (K, N) array, optional
        Default: the 84 held-out samples of ``reflectance_set("test")``; a `MaterialBasis` knows
        its own materials only.
    names : list of str, optional
        What to call the reflectances; a list of Spectrum brings its own.

    Raises
    ------
    BasisError
        If a list is empty, the names do not match, or a basis of materials is given a
        reflectance that is none of them.
    SpectrumError
        If a spectrum does not cover the basis' grid.
    """
    lights = light_set("smooth", basis.grid) if lights is None else _lights(lights, basis.grid)
    if reflectances is None:
        reflectances, names = _own_samples(basis)
    S, names = _samples(reflectances, names, basis.grid)
    if not lights or not len(S):
        raise BasisError("report: no lights or no reflectances given; nothing to compare")
    chained = not isinstance(basis, MaterialBasis)
    pairs = pair_errors(basis, lights, S, _channels(basis, S, names), names, chained=chained)
    way = own_way(basis.method)
    j, i = divmod(int(pairs.delta_e[way].argmax()), len(S))
    return BasisReport(
        basis=basis.name,
        size=basis.size,
        method=basis.method,
        trained_on=basis.trained_on,
        errors={way: ErrorSummary.of(pairs.delta_e[way]) for way in WAYS},
        products={
            n: ProductErrors(ErrorSummary.of(d), ErrorSummary.of(pairs.rgb_products[n]))
            for n, d in pairs.products.items()
        },
        worst=WorstPair.at(pairs, j, i, way),
        pairs=pairs,
    )


def displayed(XYZ: Array, white_XYZ: Array) -> NDArray[np.uint8]:
    """(..., 3) sRGB codes of colours seen under a white, by `ADAPTATION`, clipped to the gamut."""
    CAT02 = k.CAT02_FROM_XYZ
    # A nearly monochromatic white may have a response near 0: keep its gain finite.
    white = np.maximum(CAT02 @ white_XYZ, 1e-3 * white_XYZ[1])
    adapted = (XYZ @ CAT02.T) * ((CAT02 @ k.DISPLAY_WHITE_XYZ) / white)
    return srgb.to_uint8(srgb.encode(srgb.linear_from_XYZ(adapted @ np.linalg.inv(CAT02).T)))


def _lights(lights: Sequence[Spectrum], grid: SpectralGrid) -> list[Spectrum]:
    if not isinstance(lights, list | tuple) or not all(isinstance(s, Spectrum) for s in lights):
        raise BasisError(
            f"report: lights are {' '.join(repr(lights).split()):.60}; give a list of Spectrum, "
            "such as [volspec.light('A')]"
        )
    return [light.on(grid) for light in lights]


def _own_samples(
    basis: SpectralBasis | MaterialBasis,
) -> tuple[Reflectances, Sequence[str]]:
    """What a basis is measured with when nothing is asked for, and what it is called."""
    if isinstance(basis, MaterialBasis):
        return list(basis.materials.values()), list(basis.materials)
    return reflectance_set("test", basis.grid), reflectance_set_names("test")


def _samples(
    reflectances: Reflectances, names: Sequence[str] | None, grid: SpectralGrid
) -> tuple[Array, list[str]]:
    """(K, N) values of reflectances, and a name for each."""
    if isinstance(reflectances, Spectrum):
        reflectances = [reflectances]
    S = reflectance_values(reflectances, grid, "report: reflectances").reshape(-1, grid.size)
    if names is None and isinstance(reflectances, list | tuple):
        names = [r.name if isinstance(r, Spectrum) else "" for r in reflectances]
    given = [""] * len(S) if names is None else list(names)
    if len(given) != len(S):
        raise BasisError(f"report: {len(given)} names for {len(S)} reflectances; give one each")
    return S, [name or f"reflectance {i}" for i, name in enumerate(given, start=1)]


def _channels(basis: SpectralBasis | MaterialBasis, S: Array, names: Sequence[str]) -> Array:
    """(K, m): measured by the basis, or looked up among its materials."""
    if not isinstance(basis, MaterialBasis):
        return np.asarray(basis.analyze(S))
    own = basis.materials
    values = np.array([spectrum.on(basis.grid).values for spectrum in own.values()])
    found = []
    for row, name in zip(S, names, strict=True):
        match = np.flatnonzero(np.isclose(values, row, atol=1e-9).all(axis=1))
        if not match.size:
            raise BasisError(
                f"report: {name} is none of the materials of basis {basis.name!r}, which holds "
                f"{', '.join(own)}; it has no channels for others"
            )
        found.append(int(match[0]))
    return np.asarray(basis.channels_of(own))[found]
