"""Cast once, relight many times: the two stages on which everything else is built.

    image = raycast(volume, transfer, camera)        slow: when one of these changes
    frame = relighter.frame(light, spec)             fast: on every light change

The demo, the command line, the exporters and the viewer all use these functions.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._checks import MAX_SIDE, checked_size, whole
from volspec.basis import SpectralBasis
from volspec.camera import Camera, Projection
from volspec.errors import RaycastError, VolspecWarning
from volspec.image import APPROXIMATED, CoefficientImage, OpacityLayers
from volspec.large import Raycaster
from volspec.raycast import OpacityCaster, RaycastSpec, SurfaceCaster, Surfaces
from volspec.raycast.launch import (
    Cancel,
    Progress,
    Result,
    check_layers,
    empty_rows,
    materials_without_opacity,
    refuse_layers,
    shadow_slots,
)
from volspec.relight import ErrorMap, LightRig, Relighter, difference_map, relight
from volspec.spectra import Spectrum
from volspec.transfer import (
    MAX_CHANNELS,
    FieldTables,
    SurfaceTable,
    Tables,
    TransferFunction,
    Transfers,
)
from volspec.volume import Volume

MIN_SIDE = 8
GAPS = "gaps"
"""Note of an image in which parts of the volume are missing."""


__all__ = ["Raycaster", "Relighter", "absorption_error", "raycast", "refine", "relight"]


def raycast(
    volume: Volume | Any,
    transfer: Transfers,
    camera: Camera,
    size: tuple[int, int] = (512, 512),
    spec: RaycastSpec | None = None,
    *,
    device: str | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
    caster: Raycaster | None = None,
    into: Relighter | None = None,
    notes: Mapping[str, str] | None = None,
    behind: Sequence[SurfaceCaster] = (),
) -> CoefficientImage:
    """Cast a volume once, for every light to come.

    Parameters
    ----------
    volume : Volume, pyvista ImageData or array (Z, Y, X)
        NumPy and Zarr arrays have 1 mm voxels, and so have xarray's without coordinates.
    transfer : TransferFunction, TransferFunction2D, LabelFunction, Isosurfaces or FieldFunctions
        The last are of several fields.
    camera : Camera
    size : (width, height)
        Pixels.
    spec : RaycastSpec, optional
        Step, shading, lights, cuts.
    device : str, optional
        Part of an OpenCL device's name.
    progress : callable, optional
        Called with the completed fraction, 0…1.
    cancel : callable, optional
        Called every few milliseconds; True ends the cast.
    caster : Raycaster, optional
        A Raycaster of the volume, for several casts; its device replaces ``device``.
    into : Relighter, optional
        Updated with the picture, as by its ``update``; unchanged if the cast fails. A caster
        made with the Relighter's ``context`` updates it on the device.
    notes : {str: str}, optional
        Added to the image's notes.
    behind : sequence of SurfaceCaster, optional
        Surfaces behind the volume and between its parts: meshes, then a room.

    Returns
    -------
    CoefficientImage
        (H, W, L·M) channels premultiplied by opacity, by light group; alpha and depths.

    Raises
    ------
    OpenCLError
        If there is no device or the volume does not fit on it, or the caster shares a different
        OpenGL context than ``into``.
    ShapeError
        If the picture's size or channels differ from those of ``into``.
    VolumeError, RaycastError
        If the volume or the picture's size cannot be cast, or the caster holds another volume.
    CastCancelled
        If ``cancel`` returned True.

    Examples
    --------
    >>> import volspec as vs
    >>> basis = vs.SpectralBasis.load("general-7")
    >>> transfer = vs.TransferFunction(
    ...     points=[(0.2, 0.0, "copper"), (0.6, 0.5, "copper")],
    ...     materials={"copper": vs.reflectance("copper")}, basis=basis)
    >>> ball = vs.phantom.ball(32)
    >>> image = vs.raycast(ball, transfer, vs.Camera.orbit(ball), size=(64, 48))
    >>> image.coefficients.shape, bool(image.alpha.max() > 0.9)
    ((48, 64, 7), True)
    """
    volume = Volume.of(volume)
    spec = RaycastSpec() if spec is None else spec
    _check_arguments(volume, transfer, camera, caster, behind)
    caster = caster or Raycaster(volume, device=device)
    behind = [part for surface in behind if (part := surface.within(volume, spec)) is not None]
    table = caster.bake(transfer, spec.opacities)
    _check_added(spec, table, behind)
    size = checked_size(size)
    level = caster.at(camera, size, spec)
    _check_layers(spec, table, transfer, level, behind)
    spec = level.with_step(table, camera, size, spec, cancel)
    # What is behind, and the light of further fields, is added on the host.
    sharing = None if behind or spec.add_fields else level.sharing
    shape = *size[::-1], len(spec.groups) * table.size
    slot = None if into is None else into.place(shape, spec.groups, sharing)
    opacity = OpacityCaster(level, table, spec)
    surfaces = Surfaces.of(behind, camera, size, opacity)
    cast_part, layers = level.cast, None
    if spec.layers:
        assert isinstance(level, Raycaster)  # the last layer is of surfaces
        layers = empty_rows(table, size, spec, spec.layers - bool(behind))
        cast_part = partial(level.cast, layers=layers)
    casts = [
        cast_part(table, camera, size, spec, part, cancel, slot, span_mm, surfaces.clear)
        for part, span_mm in surfaces.spans(progress)
    ]
    _warn_if_empty(casts, volume, table, Projection(camera, (0, 0, *size)), spec, behind)
    cast = surfaces.composite(
        casts,
        lambda span_mm: level.cast(
            table, camera, size, spec, None, cancel, None, span_mm, surfaces.clear
        ),
    )
    image = CoefficientImage(
        cast.coefficients,
        cast.alpha,
        cast.depth_mm,
        transfer.basis,
        _cast_notes(volume, camera, spec, caster, behind) | dict(notes or {}),
        groups=spec.shares(),
        first_mm=cast.first_mm,
        fov_deg=None if camera.height_mm is not None else camera.fov_deg,
        camera=camera,
        opacity_layers=_opacity_layers(layers, table, spec, surfaces, cancel),
    )
    if into is not None:
        into.update(image, slot)
    return image


def refine(
    volume: Volume | Any,
    transfer: Transfers,
    camera: Camera,
    size: tuple[int, int] = (512, 512),
    spec: RaycastSpec | None = None,
    *,
    coarsest: int = 4,
    device: str | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
    caster: Raycaster | None = None,
    into: Relighter | None = None,
    notes: Mapping[str, str] | None = None,
) -> Iterator[CoefficientImage]:
    """Cast progressively: yield pictures at 1/4, 1/2 and full size, each when it is done.

    A viewer shows each picture, enlarged, while the next is cast; ``cancel`` ends the current cast.

    Parameters
    ----------
    volume, transfer, camera, size, spec
        See `raycast`.
    coarsest : int
        Divisor of the first picture's sides, then halved until 1. Pictures narrower than 8 pixels
        are skipped.
    device, progress, cancel, caster, notes
        See `raycast`.
    into : Relighter, optional
        Updated with the last picture; must have its size.

    Yields
    ------
    CoefficientImage
        The last has the full size.

    Raises
    ------
    RaycastError
        If ``size`` or ``coarsest`` is out of range; also raises as `raycast`.
    """
    whole("refine: coarsest", coarsest, 1, MAX_SIDE)
    full_size = checked_size(size, "refine")
    volume = Volume.of(volume)
    if caster is None:
        caster = Raycaster(volume, device=device)

    def cast(size: tuple[int, int], into: Relighter | None = None) -> CoefficientImage:
        return raycast(
            volume,
            transfer,
            camera,
            size,
            spec,
            progress=progress,
            cancel=cancel,
            caster=caster,
            into=into,
            notes=notes,
        )

    divisor = coarsest
    while divisor > 1:
        width, height = (-(-side // divisor) for side in full_size)
        if min(width, height) >= MIN_SIDE:
            yield cast((width, height))
        divisor = -(-divisor // 2)
    yield cast(full_size, into)


def absorption_error(
    volume: Volume | Any,
    transfer: TransferFunction,
    camera: Camera,
    light: Spectrum | LightRig,
    spec: RaycastSpec | None = None,
    *,
    size: tuple[int, int] = (96, 96),
    caster: Raycaster | None = None,
) -> ErrorMap:
    """Measure the error of a basis under spectral absorption, against full spectra.

    Light through filters is multiplied repeatedly, and each product has the basis's error: a small
    picture is cast with the basis, and again with a channel per band.

    Parameters
    ----------
    volume, transfer, camera, spec, caster
        See `raycast`.
    light : Spectrum or LightRig
        Light of both pictures.
    size : (width, height)
        Pixels of the two pictures.

    Returns
    -------
    ErrorMap
        CIEDE2000; its ``str`` gives mean, 95th percentile and maximum.

    Raises
    ------
    RaycastError
        If the basis has more bands than channels can be cast.
    """
    caster = caster or Raycaster(Volume.of(volume))
    bands = SpectralBasis.bands(transfer.basis.grid)
    if bands.size > MAX_CHANNELS:
        raise RaycastError(
            f"absorption error: the basis has {bands.size} bands, {MAX_CHANNELS} channels can be "
            "cast",
            "take one on the default grid",
            code="size",
        )
    table = caster.bake(transfer)
    spec = caster.with_step(table, camera, checked_size(size), spec or RaycastSpec())
    images = [
        raycast(caster.volume, function, camera, size, spec, caster=caster)
        for function in (transfer, replace(transfer, basis=bands))
    ]
    return difference_map(images[0], images[1], light, backdrop=0.0)


def _check_arguments(
    volume: Volume,
    transfer: Transfers,
    camera: Camera,
    caster: Raycaster | None,
    surfaces: Sequence[SurfaceCaster],
) -> None:
    """Raise RaycastError for an argument of another kind, of another volume, or basis."""
    for name, value, kinds, form in (
        ("transfer", transfer, Transfers, "a TransferFunction"),
        ("camera", camera, Camera, "a Camera, such as Camera.orbit(volume)"),
    ):
        if not isinstance(value, kinds):
            raise RaycastError.refused(f"raycast: {name}", value, f"give {form}", "type")
    if caster is not None and caster.volume is not volume:
        raise RaycastError(
            f"raycast: the caster holds {caster.volume!r}, the volume is {volume!r}",
            "give the caster's volume",
            code="conflict",
        )
    for surface in surfaces:
        if surface.basis is not None and surface.basis.fingerprint != transfer.basis.fingerprint:
            problem = (
                f"basis is {surface.basis.name!r}, the transfer function's {transfer.basis.name!r}"
            )
            remedy = "make the meshes in the transfer function's basis"
            raise RaycastError(problem, remedy, code="conflict", field="raycast: behind")


def _check_added(spec: RaycastSpec, table: Tables, surfaces: Sequence[SurfaceCaster]) -> None:
    """Raise RaycastError for a translucent mesh between fields that do not hide each other."""
    see_through = next(filter(None, (surface.translucent for surface in surfaces)), "")
    if spec.add_fields and isinstance(table, FieldTables) and see_through:
        raise RaycastError(
            f"add_fields: {see_through} is between the parts of fields that do not hide each other",
            "give it opacity 1, or set add_fields = false",
            code="conflict",
        )


def _cast_notes(
    volume: Volume,
    camera: Camera,
    spec: RaycastSpec,
    caster: Raycaster,
    surfaces: Sequence[SurfaceCaster],
) -> dict[str, str]:
    """Return the notes of a cast."""
    notes = {
        "volume": volume.file_name,
        "camera": repr(camera),
        "raycast": repr(spec),
        "device": caster.device,
    }
    if volume.pyramid is not None and (gaps := volume.pyramid.describe_gaps()):
        notes[GAPS] = gaps
    if approximated := ", ".join(filter(None, (surface.approximated for surface in surfaces))):
        notes[APPROXIMATED] = approximated
    return notes


def _warn_if_empty(
    casts: Sequence[Result],
    volume: Volume,
    table: Tables,
    view: Projection,
    spec: RaycastSpec,
    surfaces: Sequence[SurfaceCaster],
) -> None:
    """Warn of a picture in which nothing of the volume is seen."""
    if volume.is_empty and not surfaces:
        why = "the picture is empty: no mesh is shown, or cuts leave nothing of them"
    elif (
        any(cast.alpha.any() for cast in casts)
        or volume.is_empty
        or (surfaces and 0 in spec.opacities.values())  # hidden, with a mesh to be seen
    ):
        return
    elif view.shows(volume.corners_mm):
        problem = "nothing of it is seen" if surfaces else "the picture is empty"
        why = f"{volume.name}: {problem}{_why_nothing_is_seen(volume, table)}"
        if surfaces:
            why += "; or furniture of the room or a mesh hides it"
    else:
        why = _looks_past_warning(volume)
    warnings.warn(why, VolspecWarning, stacklevel=3)


def _check_layers(
    spec: RaycastSpec,
    table: Tables,
    transfer: Transfers,
    level: Any,
    surfaces: Sequence[SurfaceCaster],
) -> None:
    """Refuse what cannot be cast in layers of opacity, and warn of materials that lack it."""
    if not spec.layers:
        return
    translucent = [surface.translucent for surface in surfaces]
    checked_table = check_layers(spec, table, transfer.basis, translucent)
    if not isinstance(level, Raycaster):
        refuse_layers(
            spec,
            "a level of detail that is cast in parts",
            "take a coarser [raycast] level, or leave layers out",
        )
    of_meshes = {name for surface in surfaces for name in surface.materials}
    absent = [
        name
        for name in materials_without_opacity(checked_table, transfer.basis)
        if spec.opacities.get(name, 1.0) > 0 and name not in of_meshes
    ]
    if absent:
        warnings.warn(
            f"layers: no opacity of {', '.join(absent)}, which no scale can show; give a little, "
            "such as 0.02, and hide it with scale 0",
            VolspecWarning,
            stacklevel=3,
        )


def _opacity_layers(
    rows: NDArray[np.float32] | None,
    table: Tables,
    spec: RaycastSpec,
    surfaces: Surfaces,
    cancel: Cancel | None,
) -> OpacityLayers | None:
    """Return the layers of rows whose materials are a table's, and of surfaces; None without."""
    if rows is None:
        return None
    columns, slots = table.channels.argmax(axis=1).tolist(), shadow_slots(spec)
    solid = surfaces.solid(slots, cancel) if surfaces.behind else None
    return OpacityLayers.of_rows(rows, columns, table.size - 1, len(spec.groups), slots, solid)


def _why_nothing_is_seen(volume: Volume, table: Tables) -> str:
    """Return the likely causes of an empty picture, with the mark before them."""
    if isinstance(table, FieldTables):
        if not any(one.opacity.any() for one in table.every):
            return ": every field's opacities are 0; raise one"
        return (
            f". Shown are {', '.join(table.tables)}, but none "
            "has values that its transfer function shows, or the camera looks past them"
        )
    if isinstance(table, SurfaceTable):
        levels = ", ".join(f"{value:g}" for value in table.values)
        content = f"The isosurfaces lie at {levels}"
    elif not table.opacity.any():
        return ": every opacity is 0; raise one"
    else:
        content = (
            f"The transfer function runs from {table.domain[0]:g} to {table.domain[1]:g} with "
            f"opacity up to {table.opacity.max():g}"
        )
    return (
        f". {content}, but the volume's values from "
        f"{volume.range[0]:g} to {volume.range[1]:g}; or the camera looks past it, or crop and "
        "clip planes leave nothing of it"
    )


def _looks_past_warning(volume: Volume) -> str:
    """Return the warning about a camera that does not see the volume."""
    middle = ", ".join(f"{x:.4g}" for x in volume.corners_mm.mean(axis=0))
    return (
        f"{volume.name}: the picture is empty: the camera looks past the volume, whose middle is "
        f"at ({middle}) mm; aim there, or leave out target_mm and position_mm in a scene"
    )
