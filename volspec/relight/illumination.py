"""The effect of a light on a pixel: one 3 × L·M matrix and the backdrop's colour.

    light, basis, light groups -> [illumination] -> reference | cpu | gpu

    XYZ = Σ_g M_g C_g          + (1 - alpha) XYZ_backdrop        fitted, M_g = Σ_j w_j M_E_j
    XYZ = Σ_g D_g (e_g ∘ C_g)  + (1 - alpha) XYZ_backdrop        componentwise, e_g = A E_g
    XYZ = Σ_g P_E_g C_g        + (1 - alpha) XYZ_backdrop        exact
    XYZ = Σ_g D_g R(e_g) C_g   + (1 - alpha) XYZ_backdrop        linear-model

All are one matrix product: the basis makes M_E, D diag(e), P_E or D R(e) for each of L light
groups, and they are concatenated. All engines use this matrix; they differ only in the arithmetic
on XYZ.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 2.
[2] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 3.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import Viewing
from volspec.basis import Basis
from volspec.errors import ShapeError, ViewingError
from volspec.image import ONE_GROUP
from volspec.relight.spec import LightRig, RelightSpec
from volspec.spectra import (
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light_level,
    luminous_mean,
    white_XYZ,
)

Array = NDArray[np.float64]

# Times a coefficient of 1e9 and hundreds of channels, this stays well within float32.
_MAX = 1e20


@dataclass(frozen=True, slots=True, eq=False)
class GroupWhites:
    """The light of each of L groups on a picture, to find the white of what it shows.

    Under flat white light a group's channels have the luminance of the light that it casts on a
    surface, times the surface's reflectance: the whiter a surface, the more it counts [2].
    """

    flat_Y: Array  # (L, L·M): channels to Y under flat white light, of each group alone
    backdrop_Y: Array  # (L,): the same of the backdrop
    white_XYZ: Array  # (L, 3): of a white, lit by a group alone as much as flat light of Y = 100

    @classmethod
    def of(
        cls,
        basis: Basis,
        rig: LightRig,
        groups: Mapping[str, float],
        mixed: Spectrum,
        backdrop: float | Spectrum,
    ) -> GroupWhites:
        """Compute them for the lights of a rig; ``mixed`` is a surface's that faces all."""
        E, grid = np.ones(basis.grid.size), basis.grid
        flat = Spectrum(grid.wavelengths_nm, E)
        row = basis.colour_matrix(flat, "exact")[1]
        V = colour_matching_functions(grid, basis.observer_deg)[1]
        whites = np.zeros((len(groups), 3))
        for number, group in enumerate(groups):
            if (part := rig.shining_from(group)) is not None:
                light = part.mixed(grid)
                brightness = float(V @ light.values) / float(V @ mixed.values)
                whites[number] = brightness * white_XYZ(light, basis.observer_deg)
        if isinstance(backdrop, Spectrum):
            Y = float(XYZ_from_spectra(flat, backdrop, basis.observer_deg)[1])
        else:
            Y = 100.0 * backdrop
        return cls(np.kron(np.eye(len(groups)), row), Y * np.array([*groups.values()]), whites)

    def luminance_factors(self, coefficients: ArrayLike, alpha: ArrayLike) -> Array:
        """Return (..., L): Y of each pixel, backdrop included, under each group's flat light."""
        bare = (1.0 - np.asarray(alpha, dtype=np.float64))[..., None] * self.backdrop_Y
        return np.asarray(np.asarray(coefficients, dtype=np.float64) @ self.flat_Y.T + bare)

    def white(self, Y: Array) -> Array | None:
        """Return the (3,) white, Y = 100, in light of (L,) luminances; None if there is none."""
        white = np.maximum(Y, 0.0) @ self.white_XYZ
        return np.asarray(100.0 * white / white[1]) if white[1] > 0.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class Illumination:
    """The effect of one light on coefficients; XYZ with Y = 100 for a perfect diffuser.

    Raises
    ------
    ShapeError, ViewingError
        If the arrays are not (3, L·M), (3,) and (3,), or a number is not finite or exceeds 1e20.
    """

    XYZ_from_channels: Array
    """(3, L·M): D diag(e) or P_E group by group, times the level's and exposure's gain."""
    white_XYZ: Array
    """(3,): the adopted white, which faces every source; Y = 100 at any gain."""
    backdrop_XYZ: Array
    """(3,): the lit backdrop, including the gain."""
    illuminance_lux: float | None = None
    """E_v on a surface that faces every source, lux; None if the light has no illuminance."""
    viewing: Viewing = field(default_factory=Viewing)
    """The spec's viewing under this light: the light's E_v, if it has one, replaces the viewing's,
    so that L_A = E_v/π · Y_b/100 unless `Viewing.L_A` is given."""
    gain: float = 1.0
    """Factor on matrix and backdrop due to level and exposure."""
    groups: GroupWhites | None = None
    """The light of each group, if the white is to be that of the scene."""

    def __post_init__(self) -> None:
        for name in ("XYZ_from_channels", "white_XYZ", "backdrop_XYZ"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
            if array.shape[:1] != (3,) or array.ndim != (2 if name == "XYZ_from_channels" else 1):
                raise ShapeError(
                    f"has shape {array.shape}", "expected 3 rows", field=f"illumination.{name}"
                )
            if not np.all(np.abs(array) <= _MAX):
                raise ViewingError(
                    f"is not finite or exceeds {_MAX:g}",
                    "check the light's values, its lux and the exposure",
                    code="range",
                    field=f"illumination.{name}",
                )

    @classmethod
    def of(
        cls,
        basis: Basis,
        light: Spectrum | LightRig,
        spec: RelightSpec,
        groups: Mapping[str, float] = ONE_GROUP,
    ) -> Illumination:
        """Compute the effect of a light on the coefficients of a basis.

        Parameters
        ----------
        basis : SpectralBasis or MaterialBasis
            The basis of the coefficient image.
        light : Spectrum or LightRig
        spec : RelightSpec
        groups : {str: float}
            The image's light groups, in the order of their channels, with their fractions.

        Raises
        ------
        ViewingError
            If ``light`` is of another type, shines from an unknown group or only from groups
            without light in the cast, or has no lux although ``level="absolute"`` needs it.
        SpectrumError
            If a light does not cover the basis' grid, has negative power or is black.
        """
        rig = LightRig.of(light)
        facing = rig.facing(groups)
        gain = spec.viewing.exposure
        if spec.level == "absolute":
            if facing.total_lux is None:
                raise ViewingError(
                    "level='absolute' needs the lights' lux",
                    "give LightRig(..., illuminance_lux=...) or use level='relative'",
                    code="missing",
                    field="LightRig.illuminance_lux",
                )
            gain *= facing.total_lux / spec.viewing.illuminance_lux
        mixed = facing.mixed(basis.grid)
        if spec.level == "relative":
            power = mixed.values, basis.grid, basis.observer_deg
            gain *= luminous_mean(*power) / light_level(*power)
        white = white_XYZ(mixed, basis.observer_deg)
        seen_through = spec.seen_through(basis.grid)
        matrix = _groups_matrix(basis, rig, spec.mode, groups, mixed, seen_through)
        if isinstance(spec.backdrop, Spectrum) or seen_through:
            passed = seen_through.values if seen_through else 1.0
            grey = spec.backdrop
            grey_reflectance = grey.on(basis.grid).values if isinstance(grey, Spectrum) else grey
            backdrop = XYZ_from_spectra(mixed, grey_reflectance * passed, basis.observer_deg)
        else:
            backdrop = spec.backdrop * white
        lux = facing.total_lux
        viewing = spec.viewing.lit_by(lux)
        whites = None
        if viewing.adopted_white == "scene":
            whites = GroupWhites.of(basis, rig, groups, mixed, spec.backdrop)
        return cls(gain * matrix, white, gain * backdrop, lux, viewing, gain, whites)

    def scene_XYZ(self, coefficients: ArrayLike, alpha: ArrayLike) -> Array:
        """Return XYZ (..., 3) of each pixel in the scene; 100 for a perfect diffuser at gain 1.

        Parameters
        ----------
        coefficients : (..., L·M) array_like
            Premultiplied by alpha.
        alpha : (...) array_like
            Opacity, 0 to 1.

        Raises
        ------
        ShapeError
            If the channel count differs from the matrix's or the pixels do not match.
        """
        C = np.asarray(coefficients, dtype=np.float64)
        opacity = np.asarray(alpha, dtype=np.float64)
        if C.shape != opacity.shape + (self.XYZ_from_channels.shape[1],):
            raise ShapeError(
                f"coefficients have shape {C.shape}, alpha {opacity.shape}, and the light has "
                f"{self.XYZ_from_channels.shape[1]} channels",
                "expected (..., L·M), (...) and L·M. Were they made with the same basis and light "
                "groups?",
                field="relight",
            )
        return C @ self.XYZ_from_channels.T + (1.0 - opacity)[..., None] * self.backdrop_XYZ

    def luminance_factors(self, coefficients: ArrayLike, alpha: ArrayLike) -> Array:
        """Return Y of each pixel in the scene, 100 for a perfect diffuser at any gain."""
        covered = np.asarray(coefficients, dtype=np.float64) @ self.XYZ_from_channels[1]
        bare = (1.0 - np.asarray(alpha, dtype=np.float64)) * self.backdrop_XYZ[1]
        return np.asarray((covered + bare) / self.gain)


def _groups_matrix(
    basis: Basis,
    rig: LightRig,
    mode: str,
    groups: Mapping[str, float],
    mixed: Spectrum,
    seen_through: Spectrum | None,
) -> Array:
    """Return (3, L·M): each group's colour matrix, scaled by the group's part of ``mixed``."""
    V = colour_matching_functions(basis.grid, basis.observer_deg)[1]
    columns = []
    for group in groups:
        part = rig.shining_from(group)
        if part is None:
            columns.append(np.zeros((3, basis.size)))
            continue
        # A light's fitted matrix stays the same in every mixture, and adds up.
        lights = part.weighted(basis.grid) if mode == "fitted" else [(part.mixed(basis.grid), 1.0)]
        total = np.zeros((3, basis.size))
        for E, weight in lights:
            # The basis scales Y to 100 for the light alone; the white is that of all together.
            brightness = weight * float(V @ E.values) / float(V @ mixed.values)
            total += basis.colour_matrix(E, mode, seen_through) * brightness
        columns.append(total)
    return np.hstack(columns)
