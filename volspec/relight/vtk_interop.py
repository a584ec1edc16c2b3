"""A relit frame in pyvista: a texture, and a rectangle that fills a plotter's view.

frame -> [adapt] -> pyvista's plotter
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volspec._extras import require_extra
from volspec.errors import RaycastError, RelightError
from volspec.raycast import plotter_camera, require_open
from volspec.relight.spec import Pixels

if TYPE_CHECKING:
    import pyvista


def to_texture(frame: Pixels) -> pyvista.Texture:
    """Make a pyvista texture of a relit frame, its first row at the top.

    The texture contains the display's codes: draw it with ``lighting=False``, and leave ``srgb``
    off, which would decode the codes.

    Parameters
    ----------
    frame : (H, W, 3) uint8 or float32
        As `Relighter.frame` returns it; floating-point codes are rounded to 8 bits.

    Raises
    ------
    RelightError
        If ``frame`` has another shape or type, or NaN.
    """
    require_extra("vtk", "pyvista's picture")
    import pyvista

    codes = np.asarray(frame)
    is_frame = codes.ndim == 3 and codes.shape[2] == 3 and codes.size > 0
    if not is_frame or codes.dtype not in (np.uint8, np.float32):
        raise RelightError(
            f"to_texture: got {codes.dtype} of shape {codes.shape}; give a frame, (H, W, 3) uint8 "
            "or float32"
        )
    if codes.dtype == np.float32:
        if np.isnan(codes).any():
            raise RelightError("to_texture: the frame has NaN; give codes from 0 to 1")
        codes = np.rint(codes.clip(0, 1) * 255).astype(np.uint8)
    return pyvista.Texture(codes)


def picture_plane(plotter: pyvista.Plotter, distance: float | None = None) -> pyvista.PolyData:
    """Make the rectangle that fills a plotter's picture, with texture coordinates.

    ``plotter.add_mesh(plane, texture=to_texture(frame), lighting=False)`` puts a frame of the
    plotter's size over the picture, pixel for pixel; closer objects remain in front.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active subplot's current camera is used.
    distance : float, optional
        Distance from the camera, in the plotter's units; by default the focal point's.

    Raises
    ------
    RaycastError
        If ``plotter`` is not a plotter or is closed, or the distance is not above 0.
    CameraError
        If the camera shears or shifts its picture.
    """
    require_extra("vtk", "pyvista's picture")
    import pyvista

    require_open(plotter)
    camera = plotter_camera(plotter)
    if distance is None:
        distance = camera.distance_mm
    if not 0 < distance < np.inf:
        remedy = "give a number above 0"
        raise RaycastError.refused("picture_plane: distance", distance, remedy, "range")
    width, height = plotter.renderer.GetSize()
    rays = camera.ray_field(width, height)
    grows = distance / rays.distance if rays.perspective else 1.0
    across, up = rays.across * (width / 2 * grows), rays.down * (-height / 2 * grows)
    middle = np.asarray(camera.position_mm) + distance * rays.forward
    corners = [middle + a * across + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    # The plotter scales everything that is added to it.
    plane = pyvista.PolyData(np.array(corners) / plotter.renderer.scale, faces=[4, 0, 1, 2, 3])
    plane.active_texture_coordinates = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    return plane
