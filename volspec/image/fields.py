"""Fields of a coefficient image, checked when made, and its light groups.

[fields] -> depth, file -> CoefficientImage
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._checks import number
from volspec.basis import Basis, MaterialBasis
from volspec.camera import Camera
from volspec.errors import ImageError, ShapeError
from volspec.image.layers import OpacityLayers

ONE_GROUP: Mapping[str, float] = MappingProxyType({"light": 1.0})
"""The light groups of an image whose lights are not controlled separately."""
_SUM_ERROR = 1e-6


def checked_groups(groups: Mapping[str, float]) -> dict[str, float]:
    """Return a copy of light groups, {name: fraction of the light}, or raise ImageError."""
    if not (isinstance(groups, Mapping) and groups):
        raise ImageError.refused(
            "coefficient image: groups", groups, "give {name: fraction}, at least one", "missing"
        )
    fractions = {}
    for name, fraction in groups.items():
        if not (isinstance(name, str) and name.strip()):
            raise ImageError.refused(
                "coefficient image: name of a group", name, "give text", "type"
            )
        if isinstance(fraction, bool) or not isinstance(fraction, int | float | np.number):
            fraction = math.nan
        if not 0 <= fraction <= 1 + _SUM_ERROR:
            raise ImageError.refused(
                f"coefficient image: groups[{name!r}]",
                groups[name],
                "give a fraction of the light, 0…1",
                "range",
            )
        fractions[name] = float(fraction)
    if abs(sum(fractions.values()) - 1) > _SUM_ERROR:
        raise ImageError(
            f"light groups {', '.join(fractions)} sum to {sum(fractions.values()):g}",
            "they must sum to 1, as RaycastSpec.shares() does",
            code="range",
            field="coefficient image: groups",
            given=groups,
        )
    return fractions


APPROXIMATED = "approximated"
"""Note of what the channels store only approximately: no mixture of materials, in a small basis."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageFields:
    """Fields of a `CoefficientImage`, which has the rest."""

    coefficients: NDArray[Any]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    basis: Basis
    notes: Mapping[str, str] = field(default_factory=dict)
    groups: Mapping[str, float] = field(default_factory=lambda: dict(ONE_GROUP))
    first_mm: NDArray[np.float32] | None = None
    fov_deg: float | None = None
    camera: Camera | None = None
    opacity_layers: OpacityLayers | None = None

    def __post_init__(self) -> None:
        groups = checked_groups(self.groups)
        object.__setattr__(self, "groups", groups)
        shape, size = np.shape(self.coefficients), self.basis.size
        if len(shape) != 3 or shape[2] != len(groups) * size:
            per_group = f" for each of {len(groups)} light groups" if len(groups) > 1 else ""
            raise ShapeError(
                f"shape {shape}, the basis {self.basis.name!r} has {size} channels{per_group}",
                f"expected (H, W, {len(groups) * size})",
                field="coefficient image: coefficients",
            )
        kind = getattr(self.coefficients, "dtype", type(self.coefficients).__name__)
        if kind not in (np.float32, np.float16):
            raise ImageError(
                f"type {kind}",
                "give float32 or float16, such as coefficients.astype('float32')",
                code="type",
                field="coefficient image: coefficients",
            )
        for name in ("alpha", "depth_mm", "first_mm"):
            array = getattr(self, name)
            if np.shape(array) != shape[:2] and not (name == "first_mm" and array is None):
                raise ShapeError(
                    f"shape {np.shape(array)}",
                    f"expected {shape[:2]}",
                    field=f"coefficient image: {name}",
                )
        if self.opacity_layers is not None:
            self._check_layers(self.opacity_layers)
        if self.fov_deg is not None:
            fov_deg = number("coefficient image: fov_deg", self.fov_deg, ImageError)
            if not 0.0 < fov_deg < 180.0:
                raise ImageError.refused(
                    "coefficient image: fov_deg",
                    fov_deg,
                    "expected degrees above 0 and below 180, or None without perspective",
                    "range",
                )

    def _check_layers(self, layers: OpacityLayers) -> None:
        if not isinstance(self.basis, MaterialBasis):
            raise ImageError(
                f"coefficient image: opacity layers are of materials, basis {self.basis.name!r} "
                f"is {self.basis.method}",
                "give a MaterialBasis, or leave them out",
                code="conflict",
            )
        materials, groups = len(self.basis.materials), len(self.groups)
        expected = (*np.shape(self.coefficients)[:2], layers.count, materials)
        if layers.tau.shape != expected or layers.groups != groups:
            raise ShapeError(
                f"tau has shape {layers.tau.shape} and gloss {layers.gloss.shape}",
                f"expected {expected} and {(*expected[:3], groups)}",
                field="coefficient image: opacity_layers",
            )

    @property
    def size(self) -> tuple[int, int]:
        """Size as (width, height) in pixels."""
        height, width = self.alpha.shape
        return width, height
