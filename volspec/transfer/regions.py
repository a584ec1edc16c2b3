"""Transfer functions over value and gradient, which separate boundaries from interiors.

    volume -> [regions] -> raycast -> relight -> appearance

A region is a rectangle of values and gradient magnitudes with soft sides. Boundaries of equal value
but different steepness, which a curve over values cannot separate, get a region each.

References
----------
[1] Kniss, Kindlmann, Hansen (2002), "Multidimensional Transfer Functions for Interactive Volume
    Rendering", IEEE TVCG 8(3), 270-285. doi:10.1109/TVCG.2002.1021579
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis
from volspec.errors import TransferError, VolspecWarning
from volspec.spectra import Spectrum
from volspec.transfer import mixtures
from volspec.transfer.mixtures import Mix
from volspec.transfer.table import TransferTable, power_of_two

_WHO = "TransferFunction2D"
# Entries over values and rows over gradients.
_SIZES, _ROWS = (256, 2048), (64, 256)
# Least gradient above 0 that is not 0 in the kernel's float32.
_MIN_GRADIENT = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A soft rectangle of values and gradients.

    Parameters
    ----------
    values : (low, high)
    gradients : (low, high)
        Gradient magnitudes, value per millimetre, from 0; high may be ``inf``.
    opacity : float
        Opacity per reference step, 0…1, in the middle.
    material : str or {name: weight}
        Weights are ≥ 0 and sum to at most 1 (the rest is black).
    softness : float
        Fraction, 0…1, of each half-width over which opacity falls smoothly to 0; it does not fall
        at sides of gradient 0 or ``inf``. A region open to ``inf`` is taken to reach twice its
        lower gradient.

    Raises
    ------
    TransferError
        If bounds do not rise or a number is out of range.
    """

    values: tuple[float, float]
    gradients: tuple[float, float]
    opacity: float
    material: Mix
    softness: float = 0.25

    def __post_init__(self) -> None:
        low, high = _checked_bounds("values", self.values)
        if max(abs(low), abs(high)) > mixtures.MAX_VALUE:
            raise TransferError.refused(
                "Region.values", self.values, "give numbers of float32", "range"
            )
        bottom, top = _checked_bounds("gradients", self.gradients)
        if bottom < 0 or any(0 < bound < _MIN_GRADIENT for bound in (bottom, top)):
            raise TransferError.refused(
                "Region.gradients", self.gradients, "give 0 or more, in numbers of float32", "range"
            )
        object.__setattr__(self, "values", (low, high))
        object.__setattr__(self, "gradients", (bottom, top))
        mix = mixtures.checked_mix("Region.material", self.material, None)
        object.__setattr__(self, "material", mix)
        for name in ("opacity", "softness"):
            fraction = mixtures.checked_fraction(f"Region.{name}", getattr(self, name))
            object.__setattr__(self, name, fraction)

    @property
    def reach(self) -> float:
        """Greatest gradient at which the region's opacity changes; 0 if it never does."""
        bottom, top = self.gradients
        return top if math.isfinite(top) else 2 * bottom


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction2D:
    """Regions of value and gradient magnitude.

    Overlapping regions combine as layers: opacity is 1 − Π (1 − α), reflectances mix by α.

    Parameters
    ----------
    regions : sequence of Region
    materials, basis, reference_step_mm
        As in `TransferFunction`.

    Raises
    ------
    TransferError
        If there is no region or a material is unknown (the nearest names are given).

    Examples
    --------
    >>> from volspec.basis import SpectralBasis
    >>> from volspec.spectra import reflectance
    >>> skin = Region(values=(80, 140), gradients=(20, float("inf")), opacity=0.6, material="gold")
    >>> function = TransferFunction2D(
    ...     [skin], {"gold": reflectance("gold")}, SpectralBasis.load("general-7"))
    >>> table = function.bake(smallest_spacing_mm=1)
    >>> table.opacity.shape, table.domain, table.gradient_top
    ((64, 256), (80.0, 140.0), 40.0)
    """

    regions: Sequence[Region]
    materials: Mapping[str, Spectrum]
    basis: Basis
    reference_step_mm: float | None = None

    def __post_init__(self) -> None:
        regions = mixtures.checked_list(f"{_WHO}.regions", self.regions, "Region")
        mixtures.check_materials(_WHO, self.materials, self.basis)
        for i, region in enumerate(regions):
            field = f"{_WHO}.regions[{i}].material"
            mixtures.checked_mix(field, region.material, self.materials)
        object.__setattr__(self, "regions", regions)
        step = mixtures.checked_step(_WHO, self.reference_step_mm)
        object.__setattr__(self, "reference_step_mm", step)

    def __repr__(self) -> str:
        return f"TransferFunction2D({len(self.regions)} regions, {', '.join(self.materials)})"

    def bake(
        self, smallest_spacing_mm: float, size: tuple[int, int] | None = None
    ) -> TransferTable:
        """Sample the regions into a table over the span of their values.

        Parameters
        ----------
        smallest_spacing_mm : float
            As for `TransferFunction.bake`.
        size : (values, gradients), optional
            Entries and rows; (256, 64) by default, or up to (2048, 256) for narrow regions. Warns
            if a region is too narrow even for that.

        Returns
        -------
        TransferTable
            Transparent at both ends, and so for values outside. Gradients above the top, the
            steepest that any region reaches, take the last row, in which only regions to ``inf``
            are not transparent.
        """
        # Transparent regions must not colour the rims of visible ones.
        regions = [region for region in self.regions if region.opacity > 0] or self.regions[:1]
        low = min(region.values[0] for region in self.regions)
        high = max(region.values[1] for region in self.regions)
        # Regions that do not change with the gradient need two rows, at any gradients.
        top = max(region.reach for region in self.regions) or 1.0
        if size is None:
            width = min(region.values[1] - region.values[0] for region in regions)
            heights = [region.reach - region.gradients[0] for region in regions]
            height = min((height for height in heights if height > 0), default=top)
            size = (
                power_of_two(4 * (high - low) / width, _SIZES),
                power_of_two(4 * top / height, _ROWS),
            )
        values, grads = np.linspace(low, high, size[0]), np.linspace(0, top, size[1])
        alphas = np.stack([_opacity(region, values, grads) for region in regions])
        for region, alpha in zip(regions, alphas, strict=True):
            if alpha.max() < region.opacity / 2:
                warnings.warn(
                    f"{_WHO}: the region of values {region.values} and gradients "
                    f"{region.gradients} is too narrow for a table of {size[0]} x {size[1]}; "
                    "widen it, or leave out the outer regions",
                    VolspecWarning,
                    stacklevel=2,
                )
        weights, channels = mixtures.weights_and_channels(
            [region.material for region in regions], self.materials, self.basis
        )
        by_region = np.where(alphas.any(axis=0), alphas, _nearest_region(regions, values, grads))
        mixed = np.tensordot(by_region, weights, axes=(0, 0))
        return TransferTable(
            domain=(low, high),
            opacity=(1 - (1 - alphas).prod(axis=0)).clip(0, 1),
            material_weights=mixed / by_region.sum(axis=0)[..., None],
            channels=channels,
            reference_step_mm=self.reference_step_mm or smallest_spacing_mm,
            white=self.basis.white,
            gradient_top=top,
        )


def _checked_bounds(name: str, bounds: Any) -> tuple[float, float]:
    field = f"Region.{name}"
    low, high = (
        mixtures.checked_number(f"{field}[{i}]", bound)
        for i, bound in enumerate(mixtures.checked_parts(field, bounds, "(low, high)"))
    )
    if not low < high:
        raise TransferError.refused(field, bounds, "make the second greater", "range")
    return low, high


def _opacity(
    region: Region, values: NDArray[np.float64], gradients: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (G, N) opacity of a region; 0 on its rim, so that tables end transparent."""
    (low, high), (bottom, top) = region.values, region.gradients
    soft = region.softness * (high - low) / 2
    over_values = _smoothstep(values - low, soft) * _smoothstep(high - values, soft)
    soft = region.softness * (region.reach - bottom) / 2
    over_gradients = np.ones_like(gradients)
    if bottom > 0:
        over_gradients *= _smoothstep(gradients - bottom, soft)
    if math.isfinite(top):
        over_gradients *= _smoothstep(top - gradients, soft)
    return region.opacity * over_gradients[:, None] * over_values


def _smoothstep(inside: NDArray[np.float64], soft: float) -> NDArray[np.float64]:
    """Rise smoothly from 0 at a side to 1 at ``soft`` inside it."""
    if soft == 0:
        return (inside > 0).astype(np.float64)
    t = inside.clip(0, soft) / soft
    return t * t * (3 - 2 * t)


def _nearest_region(
    regions: Sequence[Region], values: NDArray[np.float64], gradients: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (R, G, N) one-hot choices of the region nearest to each entry, measured in entries.

    Entries next to a region are transparent yet take part in interpolation; with weights of 0,
    regions would have dark rims.
    """
    distances = []
    for region in regions:
        (low, high), (bottom, top) = region.values, region.gradients
        across = np.maximum(np.maximum(low - values, values - high), 0) / (values[1] - values[0])
        above = np.maximum(np.maximum(bottom - gradients, gradients - top), 0) / gradients[1]
        distances.append(np.hypot(above[:, None], across))
    nearest = np.argmin(distances, axis=0)
    return (nearest == np.arange(len(regions))[:, None, None]).astype(np.float64)
