"""The spectral transfer function: value -> opacity and a mix of materials.

    volume -> [transfer] -> raycast -> relight -> appearance

Between two points opacity and reflectance run linearly; beyond the first and the last they
stay. Baking analyses every material in the basis and samples the curve into a table, which is
all the raycaster sees: reflectances and opacities are gone from there on, channels remain.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis, SpectralBasis
from volspec.errors import TransferError, VolspecWarning, nearest
from volspec.spectra import Spectrum

Mix = str | Mapping[str, float]
Point = tuple[float, float, Mix]

# What the kernel's tables and a file's header can hold at ease.
MAX_CHANNELS = 24
# A table is long enough for four entries between the two closest points, within these limits.
SMALLEST_TABLE, LARGEST_TABLE = 1024, 65536


@dataclass(frozen=True, slots=True, eq=False)
class TransferTable:
    """A transfer function as the raycaster reads it.

    Parameters
    ----------
    domain : (float, float)
        Values of the first and the last entry; other values take the nearest end.
    opacity : (N,)
        Opacity per reference step, 0…1.
    coefficients : (N, M)
        The reflectance's channels, not premultiplied.
    reference_step_mm : float
        Length over which ``opacity`` holds.
    white : (M,), optional
        Channels of the perfect diffuser, to which a highlight adds; ones when left out.
    """

    domain: tuple[float, float]
    opacity: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    reference_step_mm: float
    white: NDArray[np.float64] = field(default_factory=lambda: np.ones(0))

    def __post_init__(self) -> None:
        low, high = self.domain
        opacity, coefficients = np.asarray(self.opacity), np.asarray(self.coefficients)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise TransferError(f"transfer table: the domain is {self.domain}; give two that rise")
        if opacity.ndim != 1 or len(opacity) < 2 or not ((opacity >= 0) & (opacity <= 1)).all():
            raise TransferError("transfer table: opacity must be (N,) of 0…1 with N of 2 or more")
        if coefficients.ndim != 2 or len(coefficients) != len(opacity):
            raise TransferError(
                f"transfer table: coefficients have shape {coefficients.shape}, opacity "
                f"{opacity.shape}; expected (N, M) and (N,)"
            )
        if not (math.isfinite(self.reference_step_mm) and self.reference_step_mm > 0):
            raise TransferError(f"transfer table: reference step {self.reference_step_mm} mm")
        M = coefficients.shape[1]
        white = np.asarray(self.white, dtype=np.float64) if len(self.white) else np.ones(M)
        if white.shape != (M,):
            raise TransferError(f"transfer table: white has shape {white.shape}; expected ({M},)")
        object.__setattr__(self, "white", white)

    def step_opacity(self, step_mm: float) -> NDArray[np.float64]:
        """(N,) opacity of one step: 1 − (1 − opacity)^(step / reference step), METHOD §3."""
        return 1 - (1 - self.opacity) ** (step_mm / self.reference_step_mm)


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """Points of value, opacity per reference step and material mix.

    Parameters
    ----------
    points : sequence of (value, opacity, material or {material: share})
        At least one; values must not decrease (two points of one value make a step).
        Opacities 0…1. Shares are ≥ 0 and sum to at most 1 (the rest is black).
    materials : {name: Spectrum}
        Reflectances the points name.
    basis : SpectralBasis or MaterialBasis
    reference_step_mm : float, optional
        Length over which an opacity holds; the volume's smallest spacing when left out.

    Raises
    ------
    TransferError
        If there is no point, an opacity is outside 0…1, values decrease, or a material is
        unknown (the nearest names are given).
    """

    points: Sequence[Point]
    materials: Mapping[str, Spectrum]
    basis: Basis
    reference_step_mm: float | None = None

    def __post_init__(self) -> None:
        if not self.points:
            raise TransferError(
                "transfer function: no points; give at least one (value, opacity, material)"
            )
        self._check_materials()
        step = self.reference_step_mm
        if step is not None and not (math.isfinite(step) and step > 0):
            raise TransferError(f"transfer function: reference_step_mm is {step}; give mm above 0")
        checked = tuple(self._checked(i, point) for i, point in enumerate(self.points))
        for i, (left, right) in enumerate(pairwise(checked)):
            if right[0] < left[0]:
                raise TransferError(
                    f"transfer function: point {i + 2} has value {right[0]:g} after "
                    f"{left[0]:g}; sort the points by value"
                )
        object.__setattr__(self, "points", checked)

    def _check_materials(self) -> None:
        if not isinstance(self.basis, SpectralBasis | MaterialBasis):
            raise TransferError(
                f"transfer function: basis is {self.basis!r:.40}; expected a SpectralBasis, "
                "such as SpectralBasis.load('general-7'), or a MaterialBasis"
            )
        if self.basis.size > MAX_CHANNELS:
            what = f"{self.basis.size} channels"
            if isinstance(self.basis, MaterialBasis):
                what = f"{len(self.basis.materials)} materials and white are {what}"
            raise TransferError(
                f"transfer function: {what}, at most {MAX_CHANNELS} can be cast; "
                "take a SpectralBasis of fewer channels"
            )
        if not isinstance(self.materials, Mapping):
            raise TransferError("transfer function: materials must be {name: Spectrum}")
        for name, spectrum in self.materials.items():
            if not isinstance(spectrum, Spectrum):
                raise TransferError(
                    f"transfer function: material {name!r} is {spectrum!r:.40}; expected a "
                    "Spectrum, such as reflectance('copper')"
                )
            worst = spectrum.values.min()
            if worst < 0:
                raise TransferError(
                    f"transfer function: material {name!r} reflects {worst:g} at "
                    f"{spectrum.wavelengths_nm[spectrum.values.argmin()]:g} nm; give 0…1"
                )
            if spectrum.values.max() > 1 + 1e-6:
                warnings.warn(
                    f"transfer function: material {name!r} reflects up to "
                    f"{spectrum.values.max():g}; more than 1 only fluorescent matter does, "
                    "was a light given?",
                    VolspecWarning,
                    stacklevel=5,
                )

    def __repr__(self) -> str:
        return f"TransferFunction({len(self.points)} points, {', '.join(self.materials)})"

    def _checked(self, index: int, point: Point) -> tuple[float, float, dict[str, float]]:
        where = f"transfer function: point {index + 1}"
        try:
            value, opacity, mix = point
            value, opacity = float(value), float(opacity)
            shares = {mix: 1.0} if isinstance(mix, str) else {k: float(v) for k, v in mix.items()}
        except (TypeError, ValueError, AttributeError) as error:
            raise TransferError(
                f"{where} is {point!r}; expected (value, opacity, material or mix)"
            ) from error
        if not math.isfinite(value):
            raise TransferError(f"{where} has value {value}; give a finite number")
        if not 0 <= opacity <= 1:
            raise TransferError(f"{where} (value {value:g}) has opacity {opacity}; give 0…1")
        for name, share in shares.items():
            if name not in self.materials:
                known = ", ".join(sorted(self.materials)) or "none"
                raise TransferError(
                    f"{where}: no material {name!r}; {nearest(name, self.materials)}known: {known}"
                )
            if not (math.isfinite(share) and share >= 0):
                raise TransferError(f"{where}: share {share} of {name!r}; give 0…1")
        total = sum(shares.values())
        if not 0 < total <= 1 + 1e-6:
            raise TransferError(f"{where}: shares sum to {total:g}; give above 0 and at most 1")
        return value, opacity, shares

    def bake(self, smallest_spacing_mm: float, size: int | None = None) -> TransferTable:
        """Sample the curve into a table over the span of the points.

        Parameters
        ----------
        smallest_spacing_mm : float
            The volume's, used where the function has no reference step of its own.
        size : int, optional
            Entries; chosen by the distance of the closest points when left out. Points closer
            than a 65536th of the span are warned about.
        """
        names = sorted(self.materials)
        channels = self.basis.channels_of({name: self.materials[name] for name in names})
        points = cast(Sequence[tuple[float, float, dict[str, float]]], self.points)
        values = np.array([value for value, _, _ in points])
        opacities = np.array([opacity for _, opacity, _ in points])
        mixes = np.array([[mix.get(name, 0.0) for name in names] for _, _, mix in points])
        low, high = values[0], values[-1]
        if low == high:  # one value: a table needs two ends
            low, high = low - 0.5, high + 0.5
        at = np.linspace(low, high, size or _table_size(values))
        # np.interp wants rising positions: of two points of one value the later moves up by
        # one unit in the last place, which leaves a sharp step.
        for i in range(1, len(values)):
            values[i] = max(values[i], np.nextafter(values[i - 1], np.inf))
        opacity = np.interp(at, values, opacities)
        shares = np.stack([np.interp(at, values, mix) for mix in mixes.T], axis=1)
        # Beyond the ends the first and the last point hold, also where a step lies there.
        opacity[[0, -1]], shares[[0, -1]] = opacities[[0, -1]], mixes[[0, -1]]
        return TransferTable(
            domain=(float(low), float(high)),
            opacity=opacity,
            coefficients=shares @ channels,
            reference_step_mm=self.reference_step_mm or smallest_spacing_mm,
            white=self.basis.white,
        )


def _table_size(values: NDArray[np.float64]) -> int:
    """A power of two that puts four entries between the closest points of different value."""
    gaps = np.diff(values)
    gaps = gaps[gaps > 0]
    wanted = 4 * (values[-1] - values[0]) / gaps.min() if gaps.size else 0
    if wanted > 4 * LARGEST_TABLE:
        i = int(np.flatnonzero(np.diff(values) == gaps.min())[0])
        warnings.warn(
            f"transfer function: points at {values[i]:g} and {values[i + 1]:g} are too close for "
            f"the span {values[0]:g}…{values[-1]:g} and may be missed; leave out the outer points",
            VolspecWarning,
            stacklevel=3,
        )
    return int(np.clip(2 ** np.ceil(np.log2(max(wanted, 1))), SMALLEST_TABLE, LARGEST_TABLE))
