"""Training set of a basis: lights and reflectances on one grid, and their weights.

lights, reflectances, weights -> [training] -> sensors, linear
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis.base import basis_errors
from volspec.errors import BasisError
from volspec.spectra import (
    Observer,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light_power,
    real_array,
    reflectance_values,
    stack,
)

Array = NDArray[np.float64]

# Weight of the perfect diffuser in the training set if it must lie in the subspace, as channels are
# scaled by white.
_WHITE_SHARE = 0.08
# Directions weaker than this fraction of the strongest are rounding errors, even of squares.
_RANK = 1e-7
# Reflectances below this value are black.
_BLACK = 1e-6
MIN_SIZE = 3
"""Least number of channels: a colour has three."""


@dataclass(frozen=True, slots=True, eq=False)
class Training:
    """J lights and K reflectances in N bands; made by `training_set`."""

    E: Array  # (J, N), each with Y = 100 for a perfect diffuser
    S: Array  # (K, N)
    light_weights: Array  # (J,), mean 1
    reflectance_weights: Array  # (K,), mean 1
    grid: SpectralGrid
    observer_deg: Observer

    @property
    def Q(self) -> Array:
        """(3, N) colour-matching functions."""
        return colour_matching_functions(self.grid, self.observer_deg)

    @property
    def pairs(self) -> int:
        """Number of pairs of a light and a reflectance."""
        return len(self.E) * len(self.S)

    @property
    def label(self) -> str:
        """Description such as ``115 lights x 128 reflectances``."""
        return f"{count_noun(len(self.E), 'light')} x {count_noun(len(self.S), 'reflectance')}"

    @property
    def covariance(self) -> Array:
        """(N, N) weighted mean of S S^T."""
        return (self.S * self.reflectance_weights[:, None]).T @ self.S / len(self.S)

    def with_white(self) -> Training:
        """Add the perfect diffuser, with a twelfth of the reflectances' total weight."""
        weights = np.append(self.reflectance_weights, _WHITE_SHARE * len(self.S))
        S = np.concatenate([self.S, np.ones((1, self.grid.size))])
        return Training(
            self.E, S, self.light_weights, weights / weights.mean(), self.grid, self.observer_deg
        )


def training_set(
    lights: Sequence[Spectrum] | ArrayLike,
    reflectances: Sequence[Spectrum] | ArrayLike,
    grid: SpectralGrid,
    *,
    observer_deg: Observer,
    light_weights: ArrayLike | None,
    reflectance_weights: ArrayLike | None,
) -> Training:
    """Resample the data to the grid and check it."""
    _require_some(lights, "lights")
    _require_some(reflectances, "reflectances")
    with basis_errors("lights"):
        E = stack(lights, grid).reshape(-1, grid.size).copy()
    if isinstance(reflectances, Spectrum):
        reflectances = [reflectances]
    with basis_errors():
        S = reflectance_values(reflectances, grid, "reflectances").reshape(-1, grid.size)
    if S.max() < _BLACK:
        raise BasisError(
            f"reflectances are all black (at most {S.max():g}): there is nothing to fit",
            code="impossible",
        )
    for k, row in enumerate(E):
        label = f"light {k + 1}"
        if isinstance(lights, list | tuple) and isinstance(lights[k], Spectrum):
            label += f" ({lights[k].name})"
        with basis_errors():
            E[k] = light_power(row, grid, label)
    E *= (100.0 / (E @ colour_matching_functions(grid, observer_deg)[1]))[:, None]
    return Training(
        E,
        S,
        _weights(light_weights, len(E), "light_weights"),
        _weights(reflectance_weights, len(S), "reflectance_weights"),
        grid,
        observer_deg,
    )


def check_rank(strength: Array, size: int, label: str) -> None:
    """Raise BasisError if fewer than ``size`` singular values, largest first, exceed rounding.

    ``label`` names the spanning set.
    """
    rank = int((strength > strength[0] * _RANK).sum())
    if size > rank:
        raise BasisError(
            f"basis size {size} exceeds the {count_noun(rank, 'dimension')} that {label} span; "
            f"{smaller_size(rank)}",
            code="impossible",
        )


def smaller_size(maximum: int) -> str:
    """Return the error's remedy when the spectra determine at most ``maximum`` channels."""
    if maximum < MIN_SIZE:
        return f"{MIN_SIZE} is the least size: give more spectra"
    less = "" if maximum == MIN_SIZE else " or less"
    return f"use a size of {maximum}{less}, or more spectra"


def count_noun(count: int, noun: str) -> str:
    """Return ``"1 light"``, ``"2 lights"``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _require_some(spectra: Sequence[Spectrum] | ArrayLike, label: str) -> None:
    if isinstance(spectra, Spectrum):
        return
    count = len(spectra) if isinstance(spectra, Sequence) else np.size(spectra)
    if count == 0:
        raise BasisError(f"{label}: the list is empty; give at least one spectrum", code="missing")


def _weights(values: ArrayLike | None, count: int, label: str) -> Array:
    if values is None:
        return np.ones(count)
    with basis_errors():
        weights = real_array(values, label)
    if weights.shape != (count,):
        raise BasisError(
            f"{label} have shape {weights.shape}; expected ({count},), one for each spectrum",
            code="shape",
        )
    if not (np.isfinite(weights) & (weights > 0)).all():
        worst = int(np.argmin(np.where(np.isfinite(weights), weights, -np.inf)))
        raise BasisError.refused(
            f"{label}: number {worst + 1}",
            weights[worst],
            "weights must be above 0, leave out spectra of no weight",
            "range",
        )
    return weights / weights.mean()
