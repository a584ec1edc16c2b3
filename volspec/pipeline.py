"""The spine: cast once, relight for ever.

    image = raycast(volume, transfer, camera)        slow: when one of these changes
    frame = relighter.frame(light, viewing)          fast: at every light change

The demo, the command line, the exporters and the viewer all come through here.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from volspec.errors import RaycastError, VolspecWarning
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.raycast.gpu import Progress, Raycaster
from volspec.relight import Relighter, relight
from volspec.transfer import TransferFunction
from volspec.volume import Volume

__all__ = ["Raycaster", "Relighter", "raycast", "relight"]


def raycast(
    volume: Volume | Any,
    transfer: TransferFunction,
    camera: Camera,
    size: tuple[int, int] = (512, 512),
    spec: RaycastSpec | None = None,
    *,
    device: str | None = None,
    progress: Progress | None = None,
    caster: Raycaster | None = None,
    notes: Mapping[str, str] | None = None,
) -> CoefficientImage:
    """Cast a volume once, for every light to come.

    Parameters
    ----------
    volume : Volume, pyvista ImageData or array (Z, Y, X)
        NumPy, xarray and Zarr arrays count as 1 mm voxels.
    transfer : TransferFunction
    camera : Camera
    size : (width, height)
        Pixels.
    spec : RaycastSpec, optional
        Step, shading, early end.
    device : str, optional
        Part of an OpenCL device's name.
    progress : callable, optional
        Called with the finished share, 0…1.
    caster : Raycaster, optional
        The volume already on a device, for several casts of it; ``device`` is then the
        caster's.
    notes : {str: str}, optional
        Kept in the image beside what this function notes.

    Returns
    -------
    CoefficientImage
        (H, W, M) channels premultiplied by opacity, alpha and depth.

    Raises
    ------
    OpenCLError
        If there is no device or the volume does not fit it.
    VolumeError, RaycastError
        If the volume or the picture's size cannot be cast, or the caster holds another volume.

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
    spec = spec or RaycastSpec()
    if caster is None:
        caster = Raycaster(volume, device=device)
    elif caster.volume is not volume:
        raise RaycastError(
            f"raycast: the caster holds {caster.volume.name!r}, the volume is {volume.name!r}; "
            "give the caster's own"
        )
    table = transfer.bake(min(volume.spacing_mm))
    coefficients, alpha, depth = caster.cast(table, camera, size, spec, progress)
    if not alpha.any():
        warnings.warn(
            f"{volume.name}: the picture is empty. The transfer function runs from "
            f"{table.domain[0]:g} to {table.domain[1]:g} with opacity up to "
            f"{table.opacity.max():g}, the volume's values from {volume.range[0]:g} to "
            f"{volume.range[1]:g}; or the camera looks past it",
            VolspecWarning,
            stacklevel=2,
        )
    kept = {
        "volume": volume.name,
        "camera": repr(camera),
        "raycast": repr(spec),
        "device": caster.device,
        **(notes or {}),
    }
    return CoefficientImage(coefficients, alpha, depth, transfer.basis, kept)
