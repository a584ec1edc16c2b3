"""What lights a coefficient image and how the picture is to be made: frozen data.

    raycast -> [relight] -> appearance -> frame

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 2 (post-illumination).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.spec import Viewing
from volspec.basis import MODES
from volspec.errors import ViewingError, nearest
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import illuminance_lux
from volspec.spectra.spectrum import Spectrum, light_power

Pixels = NDArray[Any]
"""(H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding; row 0 is the top."""
LEVELS = ("relative", "absolute")


def _numbers(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError):
        raise ViewingError.refused(name, values, "expected one number a light", "type") from None
    if len(numbers) != count:
        raise ViewingError(f"{name} has {len(numbers)} numbers for {count} lights; give one each")
    for j, value in enumerate(numbers):
        if not (math.isfinite(value) and value >= 0.0):
            raise ViewingError.refused(
                f"{name} number {j + 1}", value, "expected finite and at least 0", "range"
            )
    return numbers


def _names(groups: Sequence[str], count: int) -> tuple[str, ...]:
    one_each = not isinstance(groups, str) and isinstance(groups, Sequence)
    if not (one_each and all(isinstance(name, str) for name in groups)):
        raise ViewingError.refused(
            "LightRig.groups",
            groups,
            "expected the name of a light group for each light, '' for all groups",
        )
    names = tuple(groups) or ("",) * count
    if len(names) != count:
        raise ViewingError(
            f"LightRig.groups has {len(names)} names for {count} lights; give one each"
        )
    return names


@dataclass(frozen=True, slots=True, eq=False)
class LightRig:
    """Lights that add up, in each of an image's light groups: e_g = Σ_j w_j A E_j.

    The sum for group g runs over the lights that shine from it or from all groups. A surface
    that faces every source gets Σ_g share_g e_g, where share_g is the group's share of the light
    in the cast (`CoefficientImage.groups`). A perfect diffuser there is the adopted white.

    Parameters
    ----------
    lights : tuple of Spectrum
        Relative or absolute spectral power E_j.
    weights : sequence of float, optional
        w_j, at least 0; empty is all 1.
    illuminance_lux : sequence of float, optional
        What each light gives a surface that faces every source, at weight 1 and shining from
        all groups, lux; from one group it gives that group's share of it. The spectra are then
        only shapes. The sum is the E_v from which the scene's L_A follows (unless `Viewing.L_A`
        is given): dim light looks dim at ``level="relative"`` too. Needed for
        ``level="absolute"``.
    groups : sequence of str, optional
        The light group that each light shines from; ``""`` is all of them, and so is empty.

    Raises
    ------
    ViewingError
        If there is no light, counts differ, a number is negative, a group is no name, or
        everything is off.

    Examples
    --------
    >>> flat = Spectrum([390, 710], [1, 1], name="flat")
    >>> ramp = Spectrum([390, 710], [0, 3.2], name="ramp")
    >>> rig = LightRig((flat, ramp), weights=(0.5, 1.0))
    >>> rig.mixed(SpectralGrid(400, 700, 150)).values.round(3).tolist()
    [0.925, 2.1, 3.275]

    A flat key and a ramp that fills, with a third of the light:

    >>> rig = LightRig((flat, ramp), groups=("key", "fill"))
    >>> facing = rig.facing({"key": 2 / 3, "fill": 1 / 3})
    >>> facing.mixed(SpectralGrid(400, 700, 150)).values.round(3).tolist()
    [0.808, 1.2, 1.592]
    """

    lights: tuple[Spectrum, ...]
    weights: tuple[float, ...] = ()
    illuminance_lux: tuple[float, ...] | None = None
    groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        lights = tuple(self.lights)
        if not lights:
            raise ViewingError("LightRig: no light; give at least one Spectrum")
        for j, light in enumerate(lights):
            if not isinstance(light, Spectrum):
                raise ViewingError.refused(
                    f"LightRig: light {j + 1}",
                    light,
                    "expected a Spectrum, such as volspec.light('D65')",
                    "type",
                )
        count = len(lights)
        given = self.weights if np.size(self.weights) else (1.0,) * count
        weights = _numbers("LightRig.weights", given, count)
        if not any(weights):
            raise ViewingError("LightRig: every weight is 0, so there is no light; raise one")
        object.__setattr__(self, "lights", lights)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "groups", _names(self.groups, count))
        if self.illuminance_lux is not None:
            lux = _numbers("LightRig.illuminance_lux", self.illuminance_lux, count)
            if not any(w * v for w, v in zip(weights, lux, strict=True)):
                raise ViewingError("LightRig: the lights give 0 lux together; raise one")
            object.__setattr__(self, "illuminance_lux", lux)

    @classmethod
    def of(cls, light: Spectrum | LightRig) -> LightRig:
        """A light as a rig, whatever it is given as.

        Raises
        ------
        ViewingError
            If it is neither.
        """
        if isinstance(light, LightRig):
            return light
        if isinstance(light, Spectrum):
            return cls((light,))
        raise ViewingError.refused(
            "relight.light",
            light,
            "expected a Spectrum, such as volspec.light('D65'), or a LightRig",
            "type",
        )

    def facing(self, shares: Mapping[str, float]) -> LightRig:
        """What a surface that faces every source gets: each light by its group's share.

        Parameters
        ----------
        shares : {str: float}
            An image's light groups, as `CoefficientImage.groups`.

        Returns
        -------
        LightRig
            Without groups; `mixed` is its spectrum and `total_lux` its E_v.

        Raises
        ------
        ViewingError
            If a light shines from a group that the image does not have, or all lights from groups
            that gave it no light.
        """
        for j, group in enumerate(self.groups):
            if group and group not in shares:
                raise ViewingError(
                    f"LightRig: light {j + 1} shines from group {group!r}; "
                    f"{nearest(group, shares)}the image has {', '.join(shares)}",
                    code="unknown",
                )
        weights = tuple(
            weight * (shares[group] if group else 1.0)
            for weight, group in zip(self.weights, self.groups, strict=True)
        )
        if not any(weights):
            used = (f"{g!r}" for w, g in zip(self.weights, self.groups, strict=True) if w)
            raise ViewingError(
                f"LightRig: there is no light, as group {', '.join(dict.fromkeys(used))} gave none "
                "to the cast; light another"
            )
        return replace(self, weights=weights, groups=())

    def shining_from(self, group: str) -> LightRig | None:
        """The lights that shine from a group, as a rig without groups; None where it is dark."""
        own = [j for j, name in enumerate(self.groups) if name in ("", group)]
        lux = None if self.illuminance_lux is None else tuple(self.illuminance_lux[j] for j in own)
        weights = tuple(self.weights[j] for j in own)
        if not any(w * v for w, v in zip(weights, lux or (1.0,) * len(own), strict=True)):
            return None
        return LightRig(tuple(self.lights[j] for j in own), weights, lux)

    def mixed(self, grid: SpectralGrid) -> Spectrum:
        """The sum of the lights as one Spectrum on a grid, whatever they shine from.

        Its scale is the lights' own, or W / (m² nm) where the rig has `illuminance_lux`.

        Raises
        ------
        SpectrumError
            If a light does not cover the grid, has negative power or no luminous energy.
        """
        total = np.zeros(grid.size)
        for j, (light, weight) in enumerate(zip(self.lights, self.weights, strict=True)):
            power = light_power(light, grid)
            if self.illuminance_lux is not None:
                lux = illuminance_lux(Spectrum(grid.wavelengths_nm, power))
                weight = weight * self.illuminance_lux[j] / lux
            total += weight * power
        name = "+".join(light.name for light in self.lights if light.name)
        return Spectrum(grid.wavelengths_nm, total, name)

    @property
    def total_lux(self) -> float | None:
        """Illuminance of the sum, whatever the lights shine from, lux; None if they carry none."""
        if self.illuminance_lux is None:
            return None
        return sum(w * v for w, v in zip(self.weights, self.illuminance_lux, strict=True))


def mixed_rig(rigs: Sequence[LightRig], weights: Sequence[float]) -> LightRig:
    """Mix several rigs into one, each times its weight; lux count if all that shine have them.

    Raises
    ------
    ViewingError
        If nothing shines.

    Examples
    --------
    >>> from volspec.spectra import light
    >>> day, lamp = LightRig((light("D65"),)), LightRig((light("A"),), (0.5,))
    >>> mixed_rig([day, lamp, day], [0.25, 1.0, 0.0]).weights
    (0.25, 0.5)
    """
    lit = [(rig, float(w)) for rig, w in zip(rigs, weights, strict=True) if w > 0.0]
    lux = [rig.illuminance_lux for rig, _ in lit if rig.illuminance_lux is not None]
    return LightRig(
        tuple(spectrum for rig, _ in lit for spectrum in rig.lights),
        tuple(weight * own for rig, weight in lit for own in rig.weights),
        tuple(v for each in lux for v in each) if len(lux) == len(lit) else None,
        tuple(group for rig, _ in lit for group in rig.groups),
    )


@dataclass(frozen=True, slots=True, eq=False)
class RelightSpec:
    """How a picture is made from coefficients and a light.

    Parameters
    ----------
    viewing : Viewing
        The eye's and the display's conditions.
    mode : str
        For each light group, ``"componentwise"``: D (e ∘ C), the factor model; ``"exact"``:
        P_E C, the light matrix; ``"linear-model"``: D R(e) C, what the papers' factor model
        stands for.
    backdrop : float or Spectrum
        Reflectance of the diffuser behind the volume, 0 (black) to 1; it faces every source. The
        default, 0.2, is the grey that the appearance model takes for the surround.
    level : str
        ``"relative"``: the light's white, on a surface that faces every source, has Y = 100: a
        swap or a group switched off never darkens the picture.
        ``"absolute"``: Y = 100 is the viewing's ``illuminance_lux``; lights add. At both levels
        the eye adapts to the rig's lux where it carries them, else to the viewing's.

    Raises
    ------
    ViewingError
        If a word is unknown or a reflectance lies outside 0 to 1.
    """

    viewing: Viewing = field(default_factory=Viewing)
    mode: str = "componentwise"
    backdrop: float | Spectrum = 0.2
    level: str = "relative"

    def __post_init__(self) -> None:
        if not isinstance(self.viewing, Viewing):
            raise ViewingError.refused(
                "relight.viewing", self.viewing, "expected a Viewing", "type"
            )
        for name, value, known in (("mode", self.mode, MODES), ("level", self.level, LEVELS)):
            if value not in known:
                raise ViewingError.refused(
                    f"relight: {name}",
                    value,
                    f"{nearest(str(value), known)}known: {', '.join(known)}",
                    "unknown",
                )
        if isinstance(self.backdrop, Spectrum):
            low, high = float(self.backdrop.values.min()), float(self.backdrop.values.max())
        else:
            try:
                low = high = float(self.backdrop)
            except (TypeError, ValueError):
                raise ViewingError.refused(
                    "relight.backdrop",
                    self.backdrop,
                    "expected a reflectance 0 to 1 or a Spectrum",
                    "type",
                ) from None
        if not (low >= 0.0 and high <= 1.0):
            raise ViewingError(
                f"relight: backdrop reflects {low:g} to {high:g}; expected within 0 (black) to 1"
            )

    @classmethod
    def of(cls, spec: RelightSpec | Viewing | None) -> RelightSpec:
        """Return settings as a spec; with a `Viewing` alone the others are as by default.

        Raises
        ------
        ViewingError
            If it is neither.
        """
        if spec is None:
            return cls()
        if isinstance(spec, RelightSpec):
            return spec
        if isinstance(spec, Viewing):
            return cls(spec)
        raise ViewingError.refused(
            "relight.spec", spec, "expected a RelightSpec or a Viewing", "type"
        )

    def for_lights(self, lights: Iterable[Spectrum | LightRig]) -> RelightSpec:
        """The same for lights that are shown in turn: relative where one of them carries no lux.

        Raises
        ------
        ViewingError
            If something else is among them.

        Examples
        --------
        >>> flat = Spectrum([390, 710], [1, 1])
        >>> bright = LightRig((flat,), illuminance_lux=(500,))
        >>> spec = RelightSpec(level="absolute")
        >>> spec.for_lights([bright]).level, spec.for_lights([bright, flat]).level
        ('absolute', 'relative')
        """
        if all(LightRig.of(light).illuminance_lux is not None for light in lights):
            return self
        return replace(self, level="relative")
