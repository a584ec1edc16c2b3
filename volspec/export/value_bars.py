"""Colours of materials under a light, and bars of those of a field's values, with numbers.

transfer functions, light -> [value_bars] -> annotate
transfer functions, basis -> [value_bars] -> page
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import screen_for_viewing, view_transform
from volspec.basis import Basis
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.spectra import Spectrum, XYZ_from_spectra
from volspec.transfer import FieldFunctions, TransferFunction, used_materials, weight_matrix
from volspec.volume import Volume

_COLOURS = 64
# From (N, K) weights of materials, and these.
_ColoursOf = Callable[[NDArray[np.float64], Mapping[str, Spectrum]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class ValueBar:
    """Colours of the values from ``low`` to ``high``, between which a field is seen."""

    title: str  # the field, of several, and the unit
    low: float
    high: float
    # (N, 3) display codes 0 to 1 or (N, m) channels of a basis; of transparent values, NaN
    colours: NDArray[np.float64]
    is_log: bool = False  # its values are decimal logarithms of the numbers to be shown

    def number(self, value: float) -> str:
        """Return a value as people read it."""
        return f"{10.0**value if self.is_log else value:.6g}"

    def ticks(self, count: int = 5) -> list[float]:
        """Return up to ``count`` round values within the bar.

        >>> ValueBar("", -1000, 3000, np.zeros((2, 3))).ticks()
        [-1000.0, 0.0, 1000.0, 2000.0, 3000.0]
        """
        span = self.high - self.low
        power = 10.0 ** math.floor(math.log10(span / count))
        step = next(s * power for s in (1, 2, 5, 10, 20) if span / (s * power) <= count - 1 + 1e-9)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [round(n * step, 12 - math.floor(math.log10(step))) for n in range(first, last + 1)]


def material_colours(
    materials: Mapping[str, Spectrum],
    basis: Basis,
    rig: LightRig,
    spec: RelightSpec,
    fractions: Mapping[str, float],
) -> dict[str, NDArray[np.float64]]:
    """Return the display codes, 0 to 1, of flat materials that face every source of a light."""
    if not materials:
        return {}
    light = Illumination.of(basis, rig, spec, fractions)
    mixed = rig.facing(fractions).mixed(basis.grid)
    # Single colours have no picture in which adaptation could be measured.
    viewing = replace(light.viewing, adapting="given", fov_deg=None)
    XYZ = [XYZ_from_spectra(mixed, material, basis.observer_deg) for material in materials.values()]
    adapted = view_transform(viewing, light.white_XYZ).apply(light.gain * np.array(XYZ)[None])
    codes = np.clip(screen_for_viewing(viewing).codes(adapted, 0)[0], 0.0, 1.0)
    return dict(zip(materials, codes, strict=True))


def value_bars(
    transfer: Any,
    volume: Volume,
    basis: Basis,
    rig: LightRig,
    spec: RelightSpec,
    fractions: Mapping[str, float],
) -> Sequence[ValueBar]:
    """Return a bar for each field that has a curve over its values; labels and levels have none.

    Parameters
    ----------
    transfer : Transfers
    volume : Volume
        Its fields' ranges and units are those of the bars.
    basis, rig, spec, fractions
        As `material_colours`.
    """

    def colours_of(
        weights: NDArray[np.float64], materials: Mapping[str, Spectrum]
    ) -> NDArray[np.float64]:
        grid = basis.grid
        mixed = weights @ np.stack([material.on(grid).values for material in materials.values()])
        named = {str(i): Spectrum(grid.wavelengths_nm, row) for i, row in enumerate(mixed)}
        return np.stack([*material_colours(named, basis, rig, spec, fractions).values()])

    return _bars(transfer, volume, basis, colours_of)


def channel_bars(transfer: Any, volume: Volume, basis: Basis) -> Sequence[ValueBar]:
    """Return the bars of `value_bars` with channels of a basis as colours, for any light."""
    return _bars(transfer, volume, basis, lambda w, m: w @ basis.channels_for_materials(m))


def _bars(
    transfer: Any, volume: Volume, basis: Basis, colours_of: _ColoursOf
) -> Sequence[ValueBar]:
    functions: Mapping[str, Any] = {"": transfer}
    if isinstance(transfer, FieldFunctions):
        functions = {name: transfer.functions[name] for name in transfer.shown}
    bars = []
    for name, function in functions.items():
        if not isinstance(function, TransferFunction):
            continue
        field = volume.by_name[name or volume.name]
        table = function.bake(volume.smallest_mm)
        knots = np.linspace(*table.domain, table.opacity.shape[-1])
        range_low, range_high = field.range
        opaque = np.max(np.atleast_2d(table.opacity), axis=0) > 0
        visible = np.flatnonzero(opaque & (knots >= range_low) & (knots <= range_high))
        if len(visible) < 2:
            continue
        # From the last entry that is transparent.
        low, high = knots[max(visible[0] - 1, 0)], knots[min(visible[-1] + 1, len(knots) - 1)]
        low, high = max(float(low), range_low), min(float(high), range_high)
        values = np.linspace(low, high, _COLOURS)
        points, _, mixes = zip(*function.points, strict=True)
        names = used_materials(mixes)
        weights = table.material_weights.reshape(-1, len(knots), table.channels.shape[0])[-1]
        if len(names) > basis.size:  # the table's are channels
            points_at, weights = np.array(points), weight_matrix(mixes, names)
        else:
            points_at = knots
        mixed = np.stack([np.interp(values, points_at, column) for column in weights.T], axis=1)
        colours = colours_of(mixed, {n: function.materials[n] for n in names})
        colours[np.interp(values, knots, opaque.astype(float)) <= 0] = np.nan
        title = field.channel.name or field.name if len(functions) > 1 else ""
        label = " · ".join(filter(None, (title, field.metadata.unit)))
        bars.append(ValueBar(label, low, high, colours, field.metadata.is_log))
    return bars
