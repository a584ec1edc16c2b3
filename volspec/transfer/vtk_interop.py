"""Convert a VTK volume property into a transfer function.

    VTK volume property -> [vtk_interop] -> TransferFunction

Opacity has the same meaning in both: 1 − (1 − opacity)^(step / unit distance). A colour becomes a
plausible reflectance that has this colour under D65. VTK mixes sRGB codes between points and along
the ray, but volspec mixes light: pictures agree in geometry and in the colour of opaque parts, and
differ in translucent layers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import sRGB_CURVE
from volspec.basis import Basis, SpectralBasis
from volspec.errors import TransferError
from volspec.spectra import reflectance_from_colour
from volspec.transfer.model import TransferFunction

Array = NDArray[np.float64]

# Samples over the span: VTK's curves may bend between points (sharpness, HSV, Lab).
_SAMPLES = 256
# Values nearer than this fraction of the span are merged.
_SAME = 1e-9
# Interpolation error allowed for a colour's codes, 0 to 1, and for an opacity.
_COLOUR_ERROR, _OPACITY_ERROR = 2 / 255, 1e-6


def transfer_from_vtk(
    settings: Any, unit_scale: float = 1.0, basis: Basis | None = None, name: str = "volume"
) -> TransferFunction:
    """Convert the scalar opacity and colours of a VTK volume property.

    Raises TransferError if it has a 2-D transfer function, or no opacity unit distance above 0.

    Parameters
    ----------
    settings : vtkVolumeProperty
        Property; the curves of its first component are read.
    unit_scale : float
        Millimetres per unit of the property's opacity unit distance.
    basis : SpectralBasis, optional
        ``general-7`` by default. A `MaterialBasis` cannot be used, as it needs the materials.
    name : str
        Used in messages.

    Returns
    -------
    TransferFunction
        Materials are named after their colours, ``"#rrggbb"``, and can be replaced. Warns of
        colours that no reflectance can have.
    """
    if settings.GetTransferFunctionMode() != 0:
        raise TransferError(
            f"{name}: is a 2-D transfer function; give curves over values", code="unsupported"
        )
    thickness = settings.GetScalarOpacityUnitDistance(0)
    if not 0 < thickness < math.inf:
        raise TransferError.refused(
            f"{name}.opacity_unit_distance", thickness, "give a length above 0", "range"
        )
    curve = settings.GetScalarOpacity(0)
    values = _sample_values(curve, _colours(settings))
    opacities = np.array([curve.GetValue(value) for value in values]).clip(0, 1)
    codes = _codes(_colours(settings), values)
    keys = _knots(values, sRGB_CURVE.decode(codes), sRGB_CURVE.encode, _COLOUR_ERROR)
    turns = _knots(values, opacities[:, None], np.asarray, _OPACITY_ERROR)
    names = ["#" + "".join(f"{round(255 * c):02x}" for c in codes[key]) for key in keys]
    points = [
        (float(values[i]), float(opacities[i]), _mix_at(values[i], values[keys], names))
        for i in sorted({*keys, *turns})
    ]
    return TransferFunction(
        points,
        {name: reflectance_from_colour(name) for name in dict.fromkeys(names)},
        basis or SpectralBasis.load("general-7"),
        thickness * unit_scale,
    )


def _colours(settings: Any) -> Any:
    """Return the colours or greys by value: vtkColorTransferFunction or vtkPiecewiseFunction."""
    grey = settings.GetColorChannels(0) == 1
    return settings.GetGrayTransferFunction(0) if grey else settings.GetRGBTransferFunction(0)


def _codes(colours: Any, values: Array) -> Array:
    """Return (V, 3) sRGB codes, 0 to 1."""
    if hasattr(colours, "GetColor"):
        return np.array([colours.GetColor(value) for value in values]).clip(0, 1)
    return np.array([[colours.GetValue(value)] * 3 for value in values]).clip(0, 1)


def _sample_values(*curves: Any) -> Array:
    """Return the values of the curves' points, and uniform samples between the outermost."""
    nodes = []
    for curve in curves:
        node = [0.0] * (6 if hasattr(curve, "GetColor") else 4)
        for i in range(curve.GetSize()):
            curve.GetNodeValue(i, node)
            nodes.append(node[0])
    low, high = min(nodes), max(nodes)
    values = np.unique([*nodes, *np.linspace(low, high, _SAMPLES)])
    return values[np.diff(values, prepend=-np.inf) > _SAME * (high - low)]


def _knots(values: Array, rows: Array, encode: Callable[[Array], Array], error: float) -> list[int]:
    """Return rising indices of the (V,) values between which (V, C) rows are linear.

    The worst value is added until every encoded row is interpolated to within ``error``.
    """
    knots = sorted({0, len(values) - 1})
    exact = encode(rows)
    while True:
        linear = [np.interp(values, values[knots], column[knots]) for column in rows.T]
        off = np.abs(encode(np.stack(linear, axis=1)) - exact).max(axis=1)
        worst = int(off.argmax())
        if off[worst] <= error:
            return knots
        knots = sorted({*knots, worst})


def _mix_at(value: float, keys: Array, names: Sequence[str]) -> dict[str, float]:
    """Return the weights of the two colours around a value."""
    right = int(np.searchsorted(keys, value).clip(0, len(keys) - 1))
    left = max(right - 1, 0)
    weight = float(np.interp(value, keys[[left, right]], [0.0, 1.0])) if right else 1.0
    mix = {names[left]: 1.0 - weight}
    mix[names[right]] = mix.get(names[right], 0.0) + weight
    return {name: part for name, part in mix.items() if part > 0}
