"""What a basis is fitted to: lights and reflectances on one grid, and how much each counts.

lights, reflectances, weights -> [training] -> sensors, pca, reduced_rank
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import BasisError, SpectrumError
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import (
    check_observer,
    color_matching_functions,
    light_power,
    stack,
)
from volspec.spectra.spectrum import Spectrum

Array = NDArray[np.float64]

# The perfect diffuser's share of the training set where it must lie in the subspace: channels
# are scaled by white.
_WHITE_SHARE = 0.08
# Directions weaker than this share of the strongest are rounding, also of squares.
_RANK = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Training:
    """J lights and K reflectances of N bands; made by `training_set`."""

    E: Array  # (J, N), each with Y = 100 for a perfect diffuser
    S: Array  # (K, N)
    light_weights: Array  # (J,), mean 1
    reflectance_weights: Array  # (K,), mean 1
    grid: SpectralGrid
    observer_deg: int

    @property
    def Q(self) -> Array:
        """(3, N) colour-matching functions."""
        return color_matching_functions(self.grid, self.observer_deg)

    @property
    def pairs(self) -> int:
        """How many lights on reflectances there are."""
        return len(self.E) * len(self.S)

    @property
    def label(self) -> str:
        """In words."""
        return f"{len(self.E)} lights x {len(self.S)} reflectances"

    @property
    def covariance(self) -> Array:
        """(N, N) weighted mean of S S^T."""
        return (self.S * self.reflectance_weights[:, None]).T @ self.S / len(self.S)

    def with_white(self) -> Training:
        """The perfect diffuser added, at a twelfth of the reflectances' weight together."""
        weights = np.append(self.reflectance_weights, _WHITE_SHARE * len(self.S))
        S = np.concatenate([self.S, np.ones((1, self.grid.size))])
        return Training(
            self.E,
            S,
            self.light_weights,
            weights / weights.mean(),
            self.grid,
            self.observer_deg,
        )


def training_set(
    lights: Sequence[Spectrum] | ArrayLike,
    reflectances: Sequence[Spectrum] | ArrayLike,
    grid: SpectralGrid,
    *,
    observer_deg: int,
    light_weights: ArrayLike | None,
    reflectance_weights: ArrayLike | None,
) -> Training:
    """Put the data on the grid and check it.

    Raises
    ------
    BasisError
        If a list is empty, a spectrum does not cover the grid, a light is none, all
        reflectances are black, weights do not fit, or the observer is unknown.
    """
    try:
        check_observer(observer_deg)
    except SpectrumError as error:
        raise BasisError(str(error)) from None
    E, S = _rows(lights, grid, "lights"), _rows(reflectances, grid, "reflectances")
    if not np.any(S > 0):
        raise BasisError("reflectances are all black: there is nothing to fit")
    for k, row in enumerate(E):
        label = f"light {k + 1}"
        if isinstance(lights, list | tuple) and isinstance(lights[k], Spectrum):
            label += f" ({lights[k].name})"
        try:
            E[k] = light_power(row, grid, label)
        except SpectrumError as error:
            raise BasisError(str(error)) from None
    E *= (100.0 / (E @ color_matching_functions(grid, observer_deg)[1]))[:, None]
    return Training(
        E,
        S,
        _weights(light_weights, len(E), "light_weights"),
        _weights(reflectance_weights, len(S), "reflectance_weights"),
        grid,
        observer_deg,
    )


def check_rank(strength: Array, size: int, what: str) -> None:
    """Refuse a basis of more channels than the training set determines.

    Parameters
    ----------
    strength : (n,) float64
        Singular values, the largest first.
    size : int
        Channels m.
    what : str
        What spans the space, for the message.

    Raises
    ------
    BasisError
        If fewer than m are above rounding.
    """
    rank = int((strength > strength[0] * _RANK).sum())
    if size > rank:
        raise BasisError(
            f"basis size {size} exceeds the {rank} dimensions that {what} span; "
            f"use a size of {rank} or less, or more spectra"
        )


def _rows(spectra: Sequence[Spectrum] | ArrayLike, grid: SpectralGrid, what: str) -> Array:
    if np.size(np.asarray(spectra, dtype=object)) == 0:
        raise BasisError(f"{what}: the list is empty; give at least one spectrum")
    try:
        array = stack(spectra, grid)
    except SpectrumError as error:
        raise BasisError(f"{what}: {error}") from None
    return np.array(array.reshape(-1, grid.size))


def _weights(values: ArrayLike | None, count: int, what: str) -> Array:
    if values is None:
        return np.ones(count)
    try:
        weights = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BasisError(f"{what} are not a list of numbers: {error}") from None
    if weights.shape != (count,):
        raise BasisError(
            f"{what} have shape {weights.shape}; expected ({count},), one for each spectrum"
        )
    if not (np.isfinite(weights) & (weights > 0)).all():
        worst = int(np.argmin(np.where(np.isfinite(weights), weights, -np.inf)))
        raise BasisError(
            f"{what}: number {worst + 1} is {weights[worst]:g}; weights are above 0, "
            "leave out what shall not count"
        )
    return weights / weights.mean()
