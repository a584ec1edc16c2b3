"""Values of one pixel of the picture: place, value, spectrum, colour, error.

CoefficientImage, light -> [probe] -> Reading
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import forward_for
from volspec.appearance.models import APPEARANCE_MODELS
from volspec.camera import Camera, place_text, place_unit
from volspec.errors import VolspecError
from volspec.image import CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec, error_map
from volspec.spectra import SpectralGrid, Spectrum
from volspec.transfer import Transfer
from volspec.viewer.work.pictures import crop
from volspec.volume import Volume, value_text

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PixelProbe:
    """Values of a pixel; its spectra are (bands,)."""

    rows: tuple[tuple[str, str], ...]  # name and value
    grid: SpectralGrid
    light: Array  # on a surface that faces every source; 1 at its peak
    reflected: Array  # from the pixel to the eye, on the same scale

    def __str__(self) -> str:
        return "\n".join(f"{name}\t{value}" for name, value in self.rows)


def read(
    image: CoefficientImage,
    camera: Camera,
    volume: Volume | None,
    rig: LightRig,
    spec: RelightSpec,
    pixel: tuple[int, int],
    code: tuple[int, int, int],
    patient: bool | None = None,
    estimated: bool = False,
) -> PixelProbe:
    """Read the values of a pixel (x, y), displayed with an 8-bit ``code`` (R, G, B).

    Without a volume there are no voxel and place; for ``patient`` see `is_patient`. An
    ``estimated`` picture, of layers with other opacities than they were cast with, says so.

    Raises ViewingError or SpectrumError if the light has no power.
    """
    x, y = pixel
    illumination = Illumination.of(image.basis, rig, spec, image.groups)
    XYZ = illumination.scene_XYZ(image.coefficients[y, x], image.alpha[y, x])
    rows = [
        *((("Picture", "estimated from layers"),) if estimated else ()),
        *(() if volume is None else _hit_rows(image, camera, volume, pixel, patient)),
        ("RGB", "  ".join(map(str, code))),
        ("XYZ", _format(XYZ)),
        *_appearance_rows(XYZ, illumination),
        *_error_row(image, rig, spec, pixel),
    ]
    light, reflected = spectra(image, rig, spec, pixel)
    return PixelProbe(tuple(rows), image.basis.grid, light, reflected)


def _appearance_rows(XYZ: Array, illumination: Illumination) -> Iterator[tuple[str, str]]:
    """Yield a colour's attributes in the viewing's model, or in CIECAM02 if that only adapts."""
    viewing = illumination.viewing.unmeasured()
    name = viewing.model if viewing.model in APPEARANCE_MODELS else "CIECAM02"
    look = forward_for(viewing)(XYZ, viewing.conditions(illumination.white_XYZ))
    if not bool(look.defined):
        yield name, "not defined for this colour"
        return
    yield "J  C  h", f"{look.J:.1f}  {look.C:.1f}  {look.h:.0f}°"
    if look.Q is not None and look.M is not None and look.s is not None:
        yield "Q  M  s", f"{look.Q:.1f}  {look.M:.1f}  {look.s:.1f}"
    if look.H is not None:
        yield "H", f"{look.H:.0f}"


def spectra(
    image: CoefficientImage, rig: LightRig, spec: RelightSpec, pixel: tuple[int, int]
) -> tuple[Array, Array]:
    """Return a `PixelProbe`'s spectra, (bands,) each: the light, and the pixel with the backdrop.

    Channels become spectra as far as the basis represents them.
    """
    x, y = pixel
    basis, grid = image.basis, image.basis.grid
    E = rig.facing(image.groups).mixed(grid).values
    back = spec.backdrop
    backdrop = back.on(grid).values if isinstance(back, Spectrum) else np.full(len(E), float(back))
    leaving = (1.0 - float(image.alpha[y, x])) * backdrop * E
    layers = image.coefficients[y, x].reshape(len(image.groups), basis.size)
    for group, channels in zip(image.groups, layers, strict=True):
        if (light := rig.shining_from(group)) is not None:
            leaving = leaving + basis.leaving(channels, light.mixed(grid).values)
    if (seen_through := spec.seen_through(grid)) is not None:
        leaving = leaving * seen_through.values
    top = max(float(E.max()), 1e-12)
    return np.asarray(E / top), np.asarray(np.maximum(leaving, 0.0) / top)


def place_mm(image: CoefficientImage, camera: Camera, pixel: tuple[int, int]) -> Array | None:
    """Return a pixel's first hit in the world, (3,); None if there is none."""
    x, y = pixel
    depths = image.depth_mm if image.first_mm is None else image.first_mm
    depth = float(depths[y, x])
    if not np.isfinite(depth):
        return None
    rays = camera.ray_field(*image.size)
    offset = (x - rays.middle[0]) * rays.across + (y - rays.middle[1]) * rays.down
    if not rays.perspective:
        return np.asarray(camera.position_mm + offset + depth * rays.forward)
    direction = rays.forward * rays.distance + offset
    return np.asarray(camera.position_mm + depth * direction / np.linalg.norm(direction))


# A pixel with less opacity than this shows no material.
_MIN_ALPHA = 0.02


def material_at(image: CoefficientImage, transfer: Transfer, pixel: tuple[int, int]) -> str:
    """Return the material that contributes most to a pixel; empty if it is nearly transparent.

    Channels are fitted by sums of the materials' and white's, which highlights are made of.
    """
    from scipy.optimize import nnls

    x, y = pixel
    if image.alpha[y, x] < _MIN_ALPHA:
        return ""
    basis, names = image.basis, list(transfer.materials)
    channels = image.coefficients[y, x].reshape(len(image.groups), basis.size).sum(axis=0)
    try:
        columns = [*basis.channels_for_materials(transfer.materials), basis.white]
        weights, _ = nnls(np.stack(columns, axis=1), channels.astype(np.float64))
    except (VolspecError, RuntimeError):  # cast with other materials; no convergence
        return ""
    return names[int(weights[:-1].argmax())] if weights[:-1].any() else ""


def value_at(volume: Volume, place: Array) -> float | None:
    """Return the nearest voxel's value; None outside of the volume."""
    index = volume.index_from_world @ np.append(place, 1.0)
    i, j, k = np.rint(index[:3]).astype(int)
    nx, ny, nz = volume.shape_xyz
    if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
        return None
    return float(volume.nan_if_missing(volume.values[k, j, i]))


def _hit_rows(
    image: CoefficientImage,
    camera: Camera,
    volume: Volume,
    pixel: tuple[int, int],
    patient: bool | None,
) -> Iterator[tuple[str, str]]:
    if (place := place_mm(image, camera, pixel)) is None:
        return
    for field in (volume, *volume.fields):
        if field.labels:
            yield field.title if volume.fields else "Label", _label_at(field, camera, place)
        elif (value := value_at(field, place)) is not None:
            text = value_text(field, value, 6)
            yield field.title if volume.fields else "Value", text
    yield place_unit(volume, patient), place_text(volume, place)


def _label_at(volume: Volume, camera: Camera, place: Array) -> str:
    """Return number and name of the label behind a first hit, which lies on its boundary."""
    forward = camera.frame()[2]
    direction = place - camera.position_mm if camera.height_mm is None else forward
    step = min(volume.spacing_mm) / 2 * direction / np.linalg.norm(direction)
    values = (value_at(volume, place + i * step) for i in range(4))
    number = next((int(volume.stated(value)) for value in values if value and value == value), 0)
    label = volume.labels.get(number)
    return f"{number}  {label.name}".rstrip() if label else f"{number}"


def _error_row(
    image: CoefficientImage, rig: LightRig, spec: RelightSpec, pixel: tuple[int, int]
) -> Iterator[tuple[str, str]]:
    x, y = pixel
    alone = crop(image, slice(y, y + 1), slice(x, x + 1))
    try:
        errors = error_map(alone, rig, spec.mode, spec.backdrop)
    except VolspecError:
        return
    yield "Colour error", f"ΔE00 {float(errors.delta_e[0, 0]):.2f}"


def _format(values: Array) -> str:
    return "  ".join(f"{value:.1f}" for value in values)
