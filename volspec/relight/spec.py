"""Lights for a coefficient image and settings of its picture: frozen data.

    raycast -> [relight] -> appearance -> frame

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 2 (post-illumination).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field
from pydantic.json_schema import SkipJsonSchema

from volspec.appearance import Viewing
from volspec.basis import DEFAULT_MODE, Mode
from volspec.errors import SpectrumError, ViewingError, nearest
from volspec.settings import FLAT, Fraction, Hint, NotNegative, settings
from volspec.spectra import (
    LUMINOUS_EFFICACY,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light_power,
)
from volspec.spectra.library import reflectance

Pixels = NDArray[Any]
"""(H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding; row 0 is the top."""
Level = Literal["relative", "absolute"]
LEVELS: tuple[Level, ...] = get_args(Level)


@settings(ViewingError)
@dataclass(frozen=True, slots=True, eq=False)
class LightRig:
    """Lights that add up, in each of an image's light groups: e_g = Σ_j w_j A E_j.

    The sum for group g runs over the lights that shine from this group or from all groups. A
    surface that faces every source gets Σ_g share_g e_g, where share_g is the group's share of the
    light in the cast (`CoefficientImage.groups`). A perfect diffuser there is the adopted white.

    Raises
    ------
    ViewingError
        If there is no light, the sequences differ in length, a number is negative, a group is not
        a name, or every light is off.

    Examples
    --------
    >>> flat = Spectrum([390, 710], [1, 1], name="flat")
    >>> ramp = Spectrum([390, 710], [0, 3.2], name="ramp")
    >>> rig = LightRig((flat, ramp), weights=(0.5, 1.0))
    >>> rig.mixed(SpectralGrid(400, 700, 150)).values.round(3).tolist()
    [0.925, 2.1, 3.275]
    """

    lights: Annotated[tuple[Spectrum, ...], Field(strict=False, min_length=1)]
    """Relative or absolute spectral power E_j."""
    weights: Annotated[tuple[NotNegative, ...], Field(strict=False)] = ()
    """w_j; all 1 if empty."""
    illuminance_lux: Annotated[tuple[NotNegative, ...], Field(strict=False)] | None = None
    """Illuminance, in lux, of each light at weight 1 on a surface that faces every source, if it
    shines from all groups; from one group, that group's fraction of it. The spectra then give only
    their shape. The sum is the E_v from which L_A of the scene follows (if `Viewing.L_A` is None),
    so dim light looks dim even at ``level="relative"``. Needed for ``level="absolute"``."""
    groups: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Light group from which each light shines; ``""`` means all groups, as does an empty tuple."""

    def __post_init__(self) -> None:
        count = len(self.lights)
        object.__setattr__(self, "weights", self.weights or (1.0,) * count)
        object.__setattr__(self, "groups", self.groups or ("",) * count)
        for name in ("weights", "illuminance_lux", "groups"):
            values = getattr(self, name)
            if values is not None and len(values) != count:
                remedy = f"give one value for each of the {count} lights"
                raise ViewingError.refused(name, values, remedy, "shape")
        if not any(self.weights):
            raise _no_light("weights", self.weights)
        lux = self.illuminance_lux
        if lux is not None and not any(w * v for w, v in zip(self.weights, lux, strict=True)):
            raise _no_light("illuminance_lux", lux)

    @classmethod
    def of(cls, light: Spectrum | LightRig) -> LightRig:
        """Return a light as a rig; a rig, or one of a scene's lights, which has one, unchanged."""
        rig = getattr(light, "rig", light)
        if isinstance(rig, LightRig):
            return rig
        if isinstance(light, Spectrum):
            return cls((light,))
        raise ViewingError.refused(
            "relight.light",
            light,
            "expected a Spectrum, such as volspec.light('D65'), a LightRig or one of scene.lights",
            "type",
        )

    def facing(self, fractions: Mapping[str, float]) -> LightRig:
        """Weight each light by its group's fraction, for a surface that faces every source.

        Parameters
        ----------
        fractions : {str: float}
            An image's light groups, as in `CoefficientImage.groups`.

        Returns
        -------
        LightRig
            A rig without groups; `mixed` is its spectrum and `total_lux` its E_v.

        Raises
        ------
        ViewingError
            If the image does not have a light's group, or none of the lights' groups lit the cast.
        """
        for j, group in enumerate(self.groups):
            if group and group not in fractions:
                raise ViewingError(
                    f"LightRig: light {j + 1} shines from group {group!r}; "
                    f"{nearest(group, fractions)}the image has {', '.join(fractions)}",
                    code="unknown",
                )
        weights = tuple(
            weight * (fractions[group] if group else 1.0)
            for weight, group in zip(self.weights, self.groups, strict=True)
        )
        if not any(weights):
            used = (f"{g!r}" for w, g in zip(self.weights, self.groups, strict=True) if w)
            raise ViewingError(
                f"LightRig: no light, because group {', '.join(dict.fromkeys(used))} had none in "
                "the cast; use another group"
            )
        return replace(self, weights=weights, groups=())

    def shining_from(self, group: str) -> LightRig | None:
        """Return the lights of a group as a rig without groups; None if the group is dark."""
        kept = [j for j, name in enumerate(self.groups) if name in ("", group)]
        lux = None if self.illuminance_lux is None else tuple(self.illuminance_lux[j] for j in kept)
        weights = tuple(self.weights[j] for j in kept)
        if not any(w * v for w, v in zip(weights, lux or (1.0,) * len(kept), strict=True)):
            return None
        return LightRig(tuple(self.lights[j] for j in kept), weights, lux)

    def mixed(self, grid: SpectralGrid) -> Spectrum:
        """Return the sum of the lights as one Spectrum on a grid, regardless of groups.

        The scale is the lights' own, or W / (m² nm) if the rig has `illuminance_lux`.

        Raises
        ------
        SpectrumError
            If a light does not cover the grid, has negative power or has no luminous energy.
        """
        total = sum(weight * light.values for light, weight in self.weighted(grid))
        name = "+".join(light.name for light in self.lights if light.name)
        return Spectrum(grid.wavelengths_nm, np.asarray(total), name)

    def weighted(self, grid: SpectralGrid) -> list[tuple[Spectrum, float]]:
        """Return each light on a grid and its weight in `mixed`; errors are those of `mixed`."""
        lumens = LUMINOUS_EFFICACY * grid.step_nm * colour_matching_functions(grid)[1]
        pairs = []
        for j, (light, weight) in enumerate(zip(self.lights, self.weights, strict=True)):
            power = light_power(light, grid)
            if self.illuminance_lux is not None:
                weight = weight * self.illuminance_lux[j] / float(lumens @ power)
            pairs.append((Spectrum(grid.wavelengths_nm, power, light.name), weight))
        return pairs

    @property
    def total_lux(self) -> float | None:
        """Illuminance of the sum, regardless of groups, lux; None if the lights have no lux."""
        if self.illuminance_lux is None:
            return None
        return sum(w * v for w, v in zip(self.weights, self.illuminance_lux, strict=True))


def _no_light(field: str, value: object) -> ViewingError:
    problem = "all lights are off"
    return ViewingError(problem, "raise one", code="impossible", field=field, given=value)


def mixed_rig(rigs: Sequence[LightRig], weights: Sequence[float]) -> LightRig:
    """Mix several rigs into one, each times its weight; lux is kept if all that shine have it.

    >>> from volspec.spectra import light
    >>> day, lamp = LightRig((light("D65"),)), LightRig((light("A"),), (0.5,))
    >>> mixed_rig([day, lamp, day], [0.25, 1.0, 0.0]).weights
    (0.25, 0.5)
    """
    active = [(rig, float(w)) for rig, w in zip(rigs, weights, strict=True) if w > 0.0]
    lux = [rig.illuminance_lux for rig, _ in active if rig.illuminance_lux is not None]
    return LightRig(
        tuple(spectrum for rig, _ in active for spectrum in rig.lights),
        tuple(weight * factor for rig, weight in active for factor in rig.weights),
        tuple(v for rig_lux in lux for v in rig_lux) if len(lux) == len(active) else None,
        tuple(group for rig, _ in active for group in rig.groups),
    )


def _reflects(backdrop: Spectrum) -> Spectrum:
    low, high = float(backdrop.values.min()), float(backdrop.values.max())
    if not (low >= 0.0 and high <= 1.0):
        raise ViewingError(
            f"reflects {low:g} to {high:g}", "give 0 (black) to 1", code="range", given=backdrop
        )
    return backdrop


@settings(ViewingError)
@dataclass(frozen=True, slots=True, eq=False)
class RelightSpec:
    """Settings for making a picture from coefficients and a light."""

    viewing: Annotated[Viewing, FLAT] = field(default_factory=Viewing)
    """Conditions of the eye and the display."""
    mode: Mode = DEFAULT_MODE
    """Product of a light group's light with the coefficients: fitted, M_E C, each light's matrix
    with the best colours of the basis' samples; componentwise, D (e ∘ C), the papers' factor model;
    exact, P_E C, the light matrix; linear-model, D R(e) C, the papers' linear model."""
    backdrop: Annotated[
        Fraction | Annotated[SkipJsonSchema[Spectrum], AfterValidator(_reflects)],
        Hint("a reflectance from 0 to 1", whole=True),
    ] = 0.2
    """Reflectance of the diffuser behind the volume, 0 (black) to 1; it faces every source. The
    default is the grey that appearance models assume for the surround."""
    level: Level = "relative"
    """relative: the light's white, on a surface that faces every source, has Y = 100, so that
    swapping lights or switching a group off never darkens the picture; a nearly invisible light,
    such as an ultraviolet lamp, gives what flat light of its power would. absolute: Y = 100 is the
    viewing's ``illuminance_lux``, and lights add. At both levels the eye adapts to the light's lux
    if it has any, else to the viewing's."""
    filter: str | None = None
    """Filter in the eye's path, such as ``longpass:500``, ``bandpass:525/50`` or FILE.csv, a
    transmittance in the notation of materials; the eye adapts to the light without it."""

    @classmethod
    def of(cls, spec: RelightSpec | Viewing | None) -> RelightSpec:
        """Return settings as a spec; a `Viewing` leaves the others at their defaults."""
        if spec is None:
            return cls()
        return spec if isinstance(spec, RelightSpec) else cls(spec)

    def seen_through(self, grid: SpectralGrid) -> Spectrum | None:
        """Return the filter's transmittance on a grid; None without a filter.

        Raises SpectrumError if `volspec.reflectance` does not take its text.
        """
        return None if self.filter is None else _transmittance(self.filter, grid)

    def for_lights(self, lights: Iterable[Spectrum | LightRig]) -> RelightSpec:
        """Return the settings for lights shown in turn: relative if one of them has no lux."""
        if all(LightRig.of(light).illuminance_lux is not None for light in lights):
            return self
        return replace(self, level="relative")


@lru_cache(maxsize=16)
def _transmittance(text: str, grid: SpectralGrid) -> Spectrum:
    forms = "longpass:500, shortpass:500, bandpass:525/50 or FILE.csv"
    try:
        spectrum = reflectance(text, grid)
    except SpectrumError as error:
        code: str = error.code
        if code == "unknown":
            problem = f"filter {text!r} is unknown; give {forms}"
            raise SpectrumError(problem, code="unknown", field="viewing.filter") from None
        raise error.within("viewing.filter") from None
    if not spectrum.values.max() > 0:
        raise SpectrumError(
            f"filter {text!r} passes nothing from {grid.start_nm:g} to {grid.stop_nm:g} nm; "
            f"give another, as {forms}",
            code="impossible",
            field="viewing.filter",
        )
    return spectrum
