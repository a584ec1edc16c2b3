"""How far the m-channel picture is from the full spectra, in CIEDE2000.

    basis, lights, reflectances -> [report] -> error table -> figure

The reference is the XYZ of the full spectra, the white is the light. Every error is that of
one reflectance, or one product of reflectances, under one light; 1 is about what an eye can just
tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance import srgb
from volspec.basis.report.pairs import PairErrors, pair_errors
from volspec.basis.report.pairs import rgb_product_delta_e as rgb_product_delta_e
from volspec.errors import BasisError
from volspec.spectra.library import light_set, reflectance_set, reflectance_set_names
from volspec.spectra.photometry import stack
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]
Reflectances = Sequence[Spectrum] | ArrayLike

ADAPTATION = "CAT02, complete, to the display's D65"
"""How colours under other lights are carried to the display, to be shown side by side."""


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

    XYZ have Y = 100 for white; the sRGB codes are the same colours carried to the display
    (`ADAPTATION`).
    """

    light: str
    reflectance: str
    delta_e: float
    XYZ: tuple[float, ...] = ()
    XYZ_shown: tuple[float, ...] = ()
    sRGB: str = ""
    sRGB_shown: str = ""

    @classmethod
    def at(
        cls, pairs: PairErrors, light: int, reflectance: int, way: str = "componentwise"
    ) -> WorstPair:
        """One pair of many, shown one way: ``componentwise``, ``exact`` or ``linear_model``."""
        true, shown = pairs.XYZ[light, reflectance], pairs.shown_XYZ[way][light, reflectance]
        codes = displayed(np.array([true, shown]), pairs.white_XYZ[light])
        sRGB, sRGB_shown = (f"#{r:02x}{g:02x}{b:02x}" for r, g, b in codes.tolist())
        return cls(
            light=pairs.lights[light],
            reflectance=pairs.reflectances[reflectance],
            delta_e=float(getattr(pairs, way)[light, reflectance]),
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
    componentwise: ErrorSummary
    exact: ErrorSummary
    linear_model: ErrorSummary
    rgb_product: ErrorSummary
    products: dict[int, ProductErrors]
    """By the number of surfaces, 2 and 3; empty where channels do not multiply (materials)."""
    worst: WorstPair
    pairs: PairErrors = field(repr=False, compare=False)
    """Every single error, for figures."""

    def to_dict(self) -> dict[str, Any]:
        """As JSON types, without the single pairs."""
        kept = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "pairs"}
        kept["products"] = {str(n): asdict(p) for n, p in self.products.items()}
        return {
            name: value if isinstance(value, str | int | dict) else asdict(value)
            for name, value in kept.items()
        }

    def __str__(self) -> str:
        rows = [
            ("componentwise", self.componentwise),
            ("exact light matrix", self.exact),
            ("linear model", self.linear_model),
            ("RGB product", self.rgb_product),
        ]
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
                f"{self.worst.delta_e:.3f}",
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
    grid = basis.grid
    if lights is None:
        lights = light_set("smooth", grid)
    own = getattr(basis, "materials", None)
    if reflectances is None and own is not None:
        reflectances, names = list(own.values()), list(own)
    elif reflectances is None:
        reflectances = reflectance_set("test", grid)
        names = reflectance_set_names("test")
    if names is None and isinstance(reflectances, list | tuple):
        names = [r.name if isinstance(r, Spectrum) else "" for r in reflectances]
    lights = [light.on(grid) for light in lights]
    S = stack(reflectances, grid).reshape(-1, grid.size)
    if not lights or not len(S):
        raise BasisError("report: no lights or no reflectances given; nothing to compare")
    if names is not None and len(names) != len(S):
        raise BasisError(f"report: {len(names)} names for {len(S)} reflectances; give one each")
    names = [name or f"reflectance {i + 1}" for i, name in enumerate(names or [""] * len(S))]
    pairs = pair_errors(basis, lights, S, _channels(basis, S, names), names, chained=own is None)
    j, i = divmod(int(pairs.componentwise.argmax()), len(S))
    return BasisReport(
        basis=basis.name,
        size=basis.size,
        method=basis.method,
        trained_on=basis.trained_on,
        componentwise=ErrorSummary.of(pairs.componentwise),
        exact=ErrorSummary.of(pairs.exact),
        linear_model=ErrorSummary.of(pairs.linear_model),
        rgb_product=ErrorSummary.of(pairs.rgb_product),
        products={
            n: ProductErrors(ErrorSummary.of(d), ErrorSummary.of(pairs.rgb_products[n]))
            for n, d in pairs.products.items()
        },
        worst=WorstPair.at(pairs, j, i),
        pairs=pairs,
    )


def displayed(XYZ: Array, white_XYZ: Array) -> NDArray[np.uint8]:
    """(..., 3) sRGB codes of colours seen under a white, by `ADAPTATION`, clipped to the gamut."""
    CAT02 = k.CAT02_FROM_XYZ
    # A nearly monochromatic white may have a response near 0: keep its gain finite.
    white = np.maximum(CAT02 @ white_XYZ, 1e-3 * white_XYZ[1])
    adapted = (XYZ @ CAT02.T) * ((CAT02 @ k.DISPLAY_WHITE_XYZ) / white)
    return srgb.to_uint8(srgb.encode(srgb.linear_from_XYZ(adapted @ np.linalg.inv(CAT02).T)))


def _channels(basis: SpectralBasis | MaterialBasis, S: Array, names: Sequence[str]) -> Array:
    """(K, m): measured by the basis, or looked up among its materials."""
    own = getattr(basis, "materials", None)
    if own is None:
        return np.asarray(basis.analyze(S))  # type: ignore[union-attr]
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
