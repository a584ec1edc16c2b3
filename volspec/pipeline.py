"""The spine: cast once, relight for ever.

    image = raycast(volume, transfer, camera)        slow: when one of these changes
    frame = relighter.frame(light, viewing)          fast: at every light change

The demo, the command line, the exporters and the viewer all come through here.
"""

from __future__ import annotations

from typing import Any

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

    Returns
    -------
    CoefficientImage
        (H, W, M) channels premultiplied by opacity, alpha and depth.

    Raises
    ------
    OpenCLError
        If there is no device or the volume does not fit it.
    VolumeError, CameraError
        If the volume or the picture's size cannot be cast.

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
    caster = caster or Raycaster(volume, device=device)
    table = transfer.bake(min(volume.spacing_mm))
    coefficients, alpha, depth = caster.cast(table, camera, size, spec, progress)
    notes = {
        "volume": volume.name,
        "camera": repr(camera),
        "raycast": repr(spec),
        "device": caster.device,
    }
    return CoefficientImage(coefficients, alpha, depth, transfer.basis, notes)
