"""State of a design: the spectra of all rows and columns, and the colours they make.

model, appearance -> [state] -> linearisation, optimisation, report

Colours are linear RGB of the display, 1 for its white: wanted colours are given in it, and the
least squares are solved in it or in CIELAB relative to the display's white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import CLOSED, ClosedTransform, LinearTransform, Viewing, view_transform
from volspec.appearance.display import ColourSpace, Simulation, simulation
from volspec.appearance.models import XYZ_from_cielab, cielab, cielab_chord
from volspec.palette.model import Palette
from volspec.palette.variables import fault, initial_light, initial_reflectance, values_on
from volspec.spectra import SpectralGrid, colour_matching_functions, light, reflectance

Array = NDArray[np.float64]

# Half the step of a difference quotient, in units of Y = 100 for white.
_STEP = 0.01
# A light with less luminance than this fraction of equal energy has no chromaticity to adapt to.
_MIN_Y = 1e-9
# Least tristimulus value of a white to adapt to, as a fraction of its largest.
_MIN_WHITE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ColourModel:
    """Appearance under one light: scene XYZ to linear RGB of the display, and its derivatives."""

    transform: ClosedTransform  # scene XYZ to display XYZ
    exposure: float
    space: ColourSpace  # the display's

    @classmethod
    def of(cls, viewing: Viewing, white_XYZ: ArrayLike) -> ColourModel:
        """Return a viewing's model, adapted to a white; refuse a model without an inverse."""
        transform = view_transform(viewing, white_XYZ)
        if not isinstance(transform, ClosedTransform):
            problem = f"{viewing.model!r} has no inverse in closed form to design with"
            remedy = f"use {', '.join(CLOSED)}, an adaptation such as CAT02, or none"
            raise fault("viewing.model", f"{problem}; {remedy}", "unsupported", viewing.model)
        return cls(transform, viewing.exposure, viewing.display.colours)

    def RGB_from_XYZ(self, XYZ: ArrayLike) -> Array:
        """Return (..., 3) linear RGB of scene XYZ, Y = 100 for a perfect diffuser; not clipped."""
        scene = self.exposure * np.asarray(XYZ, dtype=np.float64)
        return self.transform.apply(scene) @ _RGB_from_XYZ(self.space).T

    def XYZ_from_RGB(self, RGB: ArrayLike) -> Array:
        """Return the scene XYZ of linear RGB: the inverse of `RGB_from_XYZ`."""
        display = np.asarray(RGB) @ _XYZ_from_RGB(self.space).T
        undone: Array = self.transform.undo(display)
        return undone / self.exposure

    def RGB_jacobian(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3, 3) derivatives of linear RGB with respect to scene XYZ."""
        scene = np.asarray(XYZ, dtype=np.float64)
        if isinstance(self.transform, LinearTransform):
            slope = self.exposure * _RGB_from_XYZ(self.space) @ self.transform.matrix
            return np.broadcast_to(slope, (*scene.shape, 3))
        around = scene[..., None, None, :] + _STEP * np.stack([np.eye(3), -np.eye(3)])
        RGB = self.RGB_from_XYZ(around)
        return np.swapaxes((RGB[..., 0, :, :] - RGB[..., 1, :, :]) / (2.0 * _STEP), -1, -2)

    def Lab_from_RGB(self, RGB: ArrayLike) -> Array:
        """Return (..., 3) CIELAB relative to the display's white."""
        XYZ = np.asarray(RGB) @ _XYZ_from_RGB(self.space).T
        return cielab(XYZ, self.space.white_XYZ)

    def RGB_from_Lab(self, Lab: ArrayLike) -> Array:
        """Return (..., 3) linear RGB: the inverse of `Lab_from_RGB`."""
        return XYZ_from_cielab(Lab, self.space.white_XYZ) @ _RGB_from_XYZ(self.space).T

    def simulated_Lab(
        self, RGB: ArrayLike, deficiency: str = "none", severity: float = 1.0
    ) -> Array:
        """Return (..., 3) CIELAB of colours on the display as a deficient observer sees them."""
        clipped: Array = np.clip(RGB, 0.0, 1.0)
        simulated = _simulation(deficiency, severity, self.space)
        if simulated is not None:
            clipped = np.clip(simulated.apply(clipped), 0.0, 1.0)
        return self.Lab_from_RGB(clipped)

    def simulated_tangent(
        self, RGB: Array, deficiency: str, severity: float
    ) -> tuple[Array, Array]:
        """Return slopes of `simulated_Lab` by linear RGB, and the value of its tangent at 0."""
        clipped, matrix = np.clip(RGB, 0.0, 1.0), np.eye(3)
        simulated = _simulation(deficiency, severity, self.space)
        if simulated is not None:
            matrix = simulated.matrix(clipped)
        perceived = matrix @ clipped
        slopes = self.Lab_chord(perceived, perceived) @ matrix
        return slopes, self.Lab_from_RGB(perceived) - slopes @ clipped

    def Lab_chord(self, one: ArrayLike, other: ArrayLike) -> Array:
        """Return the (..., 3, 3) chord W of two RGBs: Lab(one) - Lab(other) = W (one - other)."""
        ratio_from_RGB = _XYZ_from_RGB(self.space) / self.space.white_XYZ[:, None]
        one, other = np.asarray(one) @ ratio_from_RGB.T, np.asarray(other) @ ratio_from_RGB.T
        return cielab_chord(one, other) @ ratio_from_RGB


@lru_cache(maxsize=16)
def _XYZ_from_RGB(space: ColourSpace) -> Array:
    return space.XYZ_from_RGB


@lru_cache(maxsize=16)
def _RGB_from_XYZ(space: ColourSpace) -> Array:
    return space.RGB_from_XYZ


@lru_cache(maxsize=64)
def _simulation(deficiency: str, severity: float, space: ColourSpace) -> Simulation | None:
    return simulation(deficiency, severity, space)


@dataclass(frozen=True, slots=True, eq=False)
class DesignState:
    """Spectra of a palette at one point of its design."""

    palette: Palette
    S: Array  # (R, N) reflectances
    E: Array  # (L, N) lights: XYZ = Q (E ∗ S), with Y = 100 for white under a given light

    @classmethod
    def start(cls, palette: Palette) -> DesignState:
        """Return the given spectra and the initial values of free ones."""
        grid = palette.grid
        S = [initial_reflectance(row, grid) for row in palette.reflectances]
        E = [initial_light(column, grid, number) for number, column in enumerate(palette.lights)]
        return cls(palette, np.stack(S), np.stack(E))

    @property
    def Q(self) -> Array:
        """(3, N) colour-matching functions."""
        return colour_matching_functions(self.palette.grid)

    @property
    def XYZ(self) -> Array:
        """(R, L, 3) colours in the scene."""
        colours: Array = np.einsum("cn,ln,rn->rlc", self.Q, self.E, self.S)
        return colours

    def colour_models(self) -> list[ColourModel]:
        """Return a colour model for each light, adapted to its chromaticity at Y = 100."""
        even = self.Q.sum(axis=1)
        whites = self.E @ self.Q.T
        # If the design has turned a light off, the eye adapts to equal energy.
        whites = np.where(whites[:, 1:2] > _MIN_Y * 100.0, whites, even)
        whites = np.maximum(whites, _MIN_WHITE * np.abs(whites).max(axis=1, keepdims=True))
        viewing = self.palette.viewing
        return [ColourModel.of(viewing, 100.0 * white / white[1]) for white in whites]

    def RGB(self, models: list[ColourModel] | None = None) -> Array:
        """Return (R, L, 3) linear RGB of the display, not clipped; default: `colour_models`."""
        models, XYZ = models or self.colour_models(), self.XYZ
        return np.stack([model.RGB_from_XYZ(XYZ[:, j]) for j, model in enumerate(models)], axis=1)

    def at_1_nm(self) -> DesignState:
        """Return the state on bands of 1 nm; every light keeps its luminance.

        Spectra and lamps that are given by name are looked up, designed ones are interpolated.
        """
        palette, grid = self.palette, self.palette.grid
        last = grid.start_nm + math.floor(grid.stop_nm - grid.start_nm)
        fine = SpectralGrid(grid.start_nm, last, 1.0)
        S = [
            values_on(row, values, reflectance, (grid, fine))
            for row, values in zip(palette.reflectances, self.S, strict=True)
        ]
        E = np.stack(
            [
                values_on(column, values, light, (grid, fine))
                for column, values in zip(palette.lights, self.E, strict=True)
            ]
        )
        E *= ((self.E @ self.Q[1]) / (E @ colour_matching_functions(fine)[1]))[:, None]
        criteria = replace(palette.criteria, subspace=0.0)  # which has a basis on the palette's
        return DesignState(replace(palette, grid=fine, criteria=criteria), np.stack(S), E)

    def with_spectra(self, lights: bool, spectra: dict[int, Array]) -> DesignState:
        """Return the state with some lights (columns) or reflectances (rows) replaced."""
        values = (self.E if lights else self.S).copy()
        for number, spectrum in spectra.items():
            values[number] = spectrum
        return replace(self, E=values) if lights else replace(self, S=values)
