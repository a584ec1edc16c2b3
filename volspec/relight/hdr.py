"""Relight for a display of high dynamic range: code values whose white is not their end.

    coefficient image + light with lux -> [hdr] -> PQ or HLG codes

In NumPy and float64 for every model: shaders clip at the display's white, and 3-D LUTs end at 1.3
times of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import ViewTransform, view_transform
from volspec.appearance.display import Hdr
from volspec.errors import ViewingError
from volspec.image import CoefficientImage
from volspec.relight.advice import warn_of_lights
from volspec.relight.illumination import Illumination
from volspec.relight.measured_viewing import ViewingMeter
from volspec.relight.spec import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, Spectrum, illuminance_lux, light_power

# Rows at a time, so that a large picture needs no more memory than its codes.
_ROWS = 64


def hdr_frame(
    image: CoefficientImage, light: Spectrum | LightRig, spec: RelightSpec, hdr: Hdr
) -> NDArray[np.float32]:
    """Return the (H, W, 3) code values, 0 to 1, of a picture under a light.

    The eye in the scene is adapted to the light's lux, the eye before the display to the room of
    ``spec.viewing.display``, whose white is ``hdr``'s. Raises ViewingError as `check_hdr`, and
    warns as `Relighter.frame`.
    """
    spec = check_hdr(light, spec, hdr)
    illumination = Illumination.of(image.basis, light, spec, image.groups)
    warn_of_lights(image.basis, LightRig.of(light), spec.mode, set(), stacklevel=3)
    viewing, grid = ViewingMeter().measure_viewing(image, illumination)
    if grid is None:
        transform: ViewTransform = view_transform(viewing, illumination.white_XYZ)
    codes = np.empty((*image.alpha.shape, 3), np.float32)
    for row in range(0, len(codes), _ROWS):
        rows = slice(row, row + _ROWS)
        if grid is not None:
            transform = grid.interpolate(image.alpha.shape, rows)
        XYZ = illumination.scene_XYZ(image.coefficients[rows], image.alpha[rows])
        codes[rows] = hdr.codes(transform.apply(XYZ))
    return codes


def check_hdr(light: Spectrum | LightRig, spec: RelightSpec, hdr: Hdr) -> RelightSpec:
    """Return the settings with the display of ``hdr``.

    Raises ViewingError if the light has no lux, without which no luminance is known, or the display
    maps or marks colours, or a colour-vision deficiency is simulated, as these are for a gamut that
    ends at the white.
    """
    if LightRig.of(light).illuminance_lux is None:
        raise ViewingError(
            "an HDR picture shows luminances, but the light has no lux",
            "give its illuminance_lux",
            code="missing",
            field="illuminance_lux",
        )
    display = spec.viewing.display
    if spec.viewing.deficiency != "none":
        raise ViewingError(
            f"{spec.viewing.deficiency!r} is simulated on displays that end at the white",
            "leave it out",
            code="conflict",
            field="deficiency",
            given=spec.viewing.deficiency,
        )
    for name, required in (("gamut", "clip"), ("mark", False)):
        if (value := getattr(display, name)) != required:
            raise ViewingError(
                f"{value!r} is for a gamut that ends at the white, which HDR's does not",
                "leave it out",
                code="conflict",
                field=name,
                given=value,
            )
    return replace(spec, viewing=replace(spec.viewing, display=hdr.display(display)))


def with_lux(light: Spectrum | LightRig, lux: float, grid: SpectralGrid) -> LightRig:
    """Return a rig of ``lux`` on a surface that faces every light, of any group.

    >>> from volspec.spectra import DEFAULT_GRID, light
    >>> day, lamp = light("D65"), light("A")
    >>> rig = with_lux(LightRig((day, lamp), (1.0, 0.5)), 500.0, DEFAULT_GRID)
    >>> round(rig.total_lux, 6)
    500.0
    """
    rig = LightRig.of(light)
    unscaled = [
        illuminance_lux(Spectrum(grid.wavelengths_nm, light_power(lamp, grid)))
        for lamp in rig.lights
    ]
    total = sum(weight * value for weight, value in zip(rig.weights, unscaled, strict=True))
    return replace(rig, illuminance_lux=tuple(lux * value / total for value in unscaled))
