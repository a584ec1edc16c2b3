"""Convert a pyvista plotter's volume and view to the arguments of a cast.

    pyvista's plotter -> [adapt] -> volume, transfer function, camera, size, spec -> raycast

Pixels of the cast match the plotter's. Its lights are not converted: ours are placed by
`LightGroup`, and get their spectra when the picture is relit.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec._extras import require_extra
from volspec.basis import Basis
from volspec.camera import Camera
from volspec.errors import CameraError, RaycastError, VolspecWarning, nearest, quote
from volspec.raycast.spec import ClipPlane, Mode, RaycastSpec
from volspec.transfer import TransferFunction, transfer_from_vtk
from volspec.volume import Volume
from volspec.volume.files import volume_fields

if TYPE_CHECKING:
    import pyvista

# pyvista's names of vtkVolumeMapper::BlendModes.
_BLENDING = ("composite", "maximum", "minimum", "average", "additive", "isosurface", "slice")
_MODES: dict[str, Mode] = {"composite": "composite", "maximum": "maximum", "average": "average"}
# Greatest relative difference of stretches along the axes that counts as uniform.
_EVEN = 0.01


class Plotted(NamedTuple):
    """A plotter's volume and view, in the order of `volspec.raycast`'s arguments."""

    volume: Volume
    transfer: TransferFunction
    camera: Camera
    size: tuple[int, int]
    spec: RaycastSpec


def from_plotter(
    plotter: pyvista.Plotter, name: str | None = None, *, basis: Basis | None = None
) -> Plotted:
    """Convert a pyvista plotter's volume, its appearance, and the view of the active subplot.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Open, or not yet shown; in the latter case it gets the view that it would open with.
    name : str, optional
        Name of the volume, if there are several: from `add_volume`, or a key of
        ``plotter.actors``. A hidden volume is found only by name.
    basis : SpectralBasis, optional
        Basis of the transfer function; ``general-7`` if left out.

    Returns
    -------
    Plotted
        The volume is placed as in the plotter, with ``set_scale`` and the actor's matrix. The
        transfer function has `add_volume`'s opacities, and materials for its colours, named
        ``"#rrggbb"``. The spec has the blending, the clip planes and the weights of the shading;
        without ``shade`` the plain reflectances show.

    Raises
    ------
    RaycastError
        If it is not a plotter or is closed, has no volume, several or none of the name, or blends
        in a way that has no counterpart.
    VolumeError
        If the volume is not an ``ImageData``, or has several components per voxel.
    CameraError
        If the camera shears or shifts its picture.
    TransferError
        If the volume has a 2-D transfer function, or no opacity unit distance above 0.

    Warns
    -----
    VolspecWarning
        If something cannot be converted: gradient opacity, a crop, an uneven stretch of opacities,
        the greys that VTK averages to, a colour that no reflectance has.

    Examples
    --------
    >>> import pyvista, volspec
    >>> plotter = pyvista.Plotter(off_screen=True, window_size=(64, 48))
    >>> actor = plotter.add_volume(volspec.phantom.ball(16).to_pyvista(), cmap="bone")
    >>> image = volspec.raycast(*from_plotter(plotter))
    >>> plotter.close()
    >>> image.size
    (64, 48)
    """
    require_extra("vtk", "a plotter of pyvista's")
    import pyvista

    require_open(plotter)
    actor, key = _find_volume(plotter, name)
    label = key.partition("(Addr=")[0]  # without a name pyvista takes an address
    settings, mapper = actor.GetProperty(), actor.GetMapper()
    mapper.Update()
    blending = _BLENDING[mapper.GetBlendMode()]
    if blending not in _MODES:
        raise RaycastError(
            f"{label}: blends {blending!r}, which has no counterpart here",
            f"add it with blending={' or '.join(map(repr, _MODES))}",
            code="unsupported",
        )
    grid = volume_fields(pyvista.wrap(mapper.GetInputDataObject(0, 0)), name=label)
    world_from_grid = _matrix(actor.GetMatrix())
    placed = Volume(**grid | {"world_from_index": world_from_grid @ grid["world_from_index"]})
    # VTK's unit distances are measured before it stretches the volume.
    stretch = abs(float(np.linalg.det(world_from_grid[:3, :3]))) ** (1 / 3)
    transfer = transfer_from_vtk(settings, stretch, basis, label)
    _warn_of_losses(label, settings, mapper, world_from_grid)
    width, height = plotter.renderer.GetSize()
    return Plotted(
        placed,
        transfer,
        plotter_camera(plotter),
        (width, height),
        _spec(settings, mapper, _MODES[blending]),
    )


def require_open(plotter: Any) -> None:
    """Raise RaycastError unless given a plotter that is not closed."""
    if not (hasattr(plotter, "renderer") and hasattr(plotter, "render_window")):
        raise RaycastError(f"plotter: got {quote(plotter)}", "give a pyvista Plotter", code="type")
    if plotter.render_window is None:
        raise RaycastError(
            "plotter: it is closed",
            "call this before show(), or after show(auto_close=False)",
            code="state",
        )


def plotter_camera(plotter: Any) -> Camera:
    """Return the camera of a plotter's active subplot.

    Raises CameraError if it shears or shifts its picture, or moves the scene.
    """
    renderer = plotter.renderer
    if not renderer.camera.is_set:
        # As pyvista does before the first picture; the view stays for the next one.
        renderer.camera_position = renderer.get_default_cam_pos()
        renderer.ResetCamera()
    camera = renderer.GetActiveCamera()
    model = _matrix(camera.GetModelTransformMatrix())
    sheared = camera.GetViewShear() != (0.0, 0.0, 1.0) or camera.GetUseOffAxisProjection()
    if sheared or camera.GetWindowCenter() != (0.0, 0.0) or (model != np.eye(4)).any():
        raise CameraError(
            "plotter: its camera shears, shifts or moves the picture (ViewShear, WindowCenter, "
            "ModelTransformMatrix)",
            "reset these, then set position and focal point",
            code="unsupported",
        )
    angle = camera.GetViewAngle()
    if camera.GetUseHorizontalViewAngle():
        width, height = renderer.GetSize()
        half = math.tan(math.radians(angle) / 2) * height / width
        angle = 2 * math.degrees(math.atan(half))
    return Camera(
        camera.GetPosition(),
        camera.GetFocalPoint(),
        camera.GetViewUp(),
        fov_deg=angle,
        height_mm=2 * camera.GetParallelScale() if camera.GetParallelProjection() else None,
    )


def _find_volume(plotter: Any, name: str | None) -> tuple[Any, str]:
    """Return a plotter's volume, and its key."""
    volumes = {k: actor for k, actor in plotter.renderer.actors.items() if actor.IsA("vtkVolume")}
    if name is not None:
        if not isinstance(name, str) or name not in volumes:
            raise RaycastError(
                f"plotter: no volume {quote(name)}; {nearest(name, volumes)}"
                f"it has {', '.join(map(repr, volumes)) or 'none'}",
                code="unknown",
            )
        return volumes[name], name
    visible = {key: actor for key, actor in volumes.items() if actor.GetVisibility()}
    if not visible:
        raise RaycastError(
            "plotter: shows no volume in the active subplot",
            "call add_volume first, or subplot()",
            code="missing",
        )
    if len(visible) > 1:
        names = [repr(key) for key in visible]
        raise RaycastError(
            f"plotter: shows {len(visible)} volumes, {', '.join(names)}",
            f"name one: from_plotter(plotter, {names[0]})",
            code="missing",
        )
    return next(iter(visible.values())), next(iter(visible))


def _spec(settings: Any, mapper: Any, mode: Mode) -> RaycastSpec:
    """Return blending, cuts and weights of the shading."""
    clipping = mapper.GetClippingPlanes()
    planes = [clipping.GetItem(i) for i in range(clipping.GetNumberOfItems())] if clipping else []
    spec = RaycastSpec(
        ambient=1.0,
        diffuse=0.0,
        mode=mode,
        clip_planes=tuple(ClipPlane(plane.GetOrigin(), plane.GetNormal()) for plane in planes),
    )
    if not settings.GetShade(0) or mode != "composite":
        return spec
    return replace(
        spec,
        ambient=settings.GetAmbient(0),
        diffuse=settings.GetDiffuse(0),
        specular=settings.GetSpecular(0),
        shininess=round(min(max(settings.GetSpecularPower(0), 1.0), 1024.0)),
    )


def _warn_of_losses(
    label: str, settings: Any, mapper: Any, world_from_grid: NDArray[np.float64]
) -> None:
    stretches = np.linalg.svd(world_from_grid[:3, :3], compute_uv=False)
    faults = {
        "its gradient opacity": settings.HasGradientOpacity(0)
        and not settings.GetDisableGradientOpacity(0),
        "its cropping region": mapper.GetCropping(),
        # VTK's is the mean of opacity times value, drawn as an opaque grey.
        "the greys of blending 'average'": _BLENDING[mapper.GetBlendMode()] == "average",
        f"its opacities under a stretch of {stretches[0] / stretches[-1]:.3g} along "
        "one axis": stretches[0] > (1 + _EVEN) * stretches[-1],
    }
    if left := [fault for fault, applies in faults.items() if applies]:
        warnings.warn(
            f"{label}: {' and '.join(left)} cannot be converted; the cast ignores this",
            VolspecWarning,
            stacklevel=3,
        )


def _matrix(matrix: Any) -> NDArray[np.float64]:
    return np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
