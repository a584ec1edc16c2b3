"""How far the m-channel picture is from the full spectra, in CIEDE2000.

    basis, lights, reflectances -> [report] -> error table

The reference is the XYZ of the full spectra, the white is the light. Every error is that of
one reflectance under one light; 1 is about what an eye can just tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.models import cielab
from volspec.basis.display import NO_COLOUR
from volspec.errors import BasisError
from volspec.spectra._colour import colour_science
from volspec.spectra.library import light_set, reflectance_set, reflectance_set_names
from volspec.spectra.photometry import XYZ_of, color_matching_functions, stack, white_XYZ
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]


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
class WorstPair:
    """The light and reflectance with the largest componentwise error."""

    light: str
    reflectance: str
    delta_e: float


@dataclass(frozen=True, slots=True)
class BasisReport:
    """The error table of a basis; ``str`` prints it."""

    basis: str
    size: int
    method: str
    trained_on: str
    componentwise: ErrorSummary
    exact: ErrorSummary
    rgb_product: ErrorSummary
    worst: WorstPair

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return asdict(self)

    def __str__(self) -> str:
        return "\n".join(
            [
                f"{self.basis}: {self.method}, {self.size} channels, trained on {self.trained_on}",
                "CIEDE2000 against full spectra: mean / median / 95 % / max",
                f"  componentwise       {self.componentwise}",
                f"  exact light matrix  {self.exact}",
                f"  RGB product         {self.rgb_product}",
                f"  worst: {self.worst.reflectance} under {self.worst.light}, "
                f"{self.worst.delta_e:.3f}",
            ]
        )


def report(
    basis: SpectralBasis,
    lights: Sequence[Spectrum] | None = None,
    reflectances: Sequence[Spectrum] | ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> BasisReport:
    """Compare the componentwise and the exact picture with the full spectra.

    Parameters
    ----------
    basis : SpectralBasis
    lights : list of Spectrum, optional
        Default: the 26 smooth lights.
    reflectances : list of Spectrum or (K, N) array, optional
        Default: the 84 held-out samples of ``reflectance_set("test")``.
    names : list of str, optional
        What to call the reflectances when an array is given.

    Raises
    ------
    BasisError
        If a list is empty or the names do not match.
    SpectrumError
        If a spectrum does not cover the basis' grid.
    """
    grid = basis.grid
    if lights is None:
        lights = light_set("smooth", grid)
    if reflectances is None:
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
    c = basis.analyze(S)
    componentwise = delta_e_table(lights, S, [basis.xyz(c, light) for light in lights])
    exact = delta_e_table(lights, S, [c @ basis.light_matrix(light).T for light in lights])
    j, k = divmod(int(componentwise.argmax()), len(S))
    label = names[k] if names is not None and names[k] else f"reflectance {k + 1}"
    return BasisReport(
        basis=basis.name,
        size=basis.size,
        method=basis.method,
        trained_on=basis.trained_on,
        componentwise=ErrorSummary.of(componentwise),
        exact=ErrorSummary.of(exact),
        rgb_product=ErrorSummary.of(rgb_product_delta_e(lights, S)),
        worst=WorstPair(lights[j].name or f"light {j + 1}", label, float(componentwise[j, k])),
    )


def delta_e_table(lights: Sequence[Spectrum], reflectances: Array, XYZ: Sequence[Array]) -> Array:
    """(J, K) CIEDE2000 of predicted XYZ, J arrays (K, 3), against the full spectra."""
    reference, predicted = [], []
    for light, XYZ_light in zip(lights, XYZ, strict=True):
        white = _visible_white(light)
        reference.append(cielab(XYZ_of(light, reflectances), white))
        predicted.append(cielab(XYZ_light, white))
    return np.asarray(
        colour_science().delta_E(np.array(reference), np.array(predicted), method="CIE 2000")
    )


def rgb_product_delta_e(lights: Sequence[Spectrum], reflectances: Array) -> Array:
    """(J, K) CIEDE2000 of the RGB renderer's way: light times surface in three sharp sensors.

    The surface's XYZ under the flat light and the light's own XYZ are multiplied in the Sharp
    sensors of Finlayson and Suesstrunk (2000), the best of the usual ones here.
    """
    sharp = np.asarray(colour_science().CHROMATIC_ADAPTATION_TRANSFORMS["Sharp"])
    grid = lights[0].grid
    Q = color_matching_functions(grid)
    flat = Q.sum(1)
    surface = ((reflectances @ Q.T) @ sharp.T) / (sharp @ flat)
    back = np.linalg.inv(sharp)
    return delta_e_table(
        lights,
        reflectances,
        [(surface * (sharp @ white_XYZ(light))) @ back.T for light in lights],
    )


def _visible_white(light: Spectrum) -> Array:
    """The light's white; X and Z below a thousandth of Y, which no eye sees, are taken as that."""
    white = white_XYZ(light)
    return np.maximum(white, NO_COLOUR * white[1])
