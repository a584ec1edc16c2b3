"""The orientation cube: where its faces are seen, and which one is under a place of the window.

Projection -> [cube] -> mouse, panels
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import Camera
from volspec.viewer.model.view.projection import Place, Projection

# Half an edge, and the middle's distance from the picture's corner; pixels at 96 dpi.
HALF, CORNER = 21.0, 48.0


def faces(camera: Camera) -> list[tuple[int, NDArray[np.float64], float]]:
    """Those seen of a cube with edges of 2: number, (4, 2) corners right and down, how they face.

    Face 2 · axis looks against an axis of the world, the next one along it.
    """
    right, up, forward = camera.frame()
    seen = []
    for face in range(6):
        axis, far = divmod(face, 2)
        normal = np.zeros(3)
        normal[axis] = 1.0 if far else -1.0
        towards = float(-normal @ forward)
        if towards < 1e-3:
            continue
        first, second = (np.eye(3)[other] for other in range(3) if other != axis)
        ring = [normal + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = np.array(ring)
        seen.append((face, np.stack([corners @ right, -(corners @ up)], axis=1), towards))
    return seen


def middle(seen: Projection, scale: float) -> Place:
    """Of the cube in the window."""
    x, y, width, _ = seen.area
    return x + width - CORNER * scale, y + CORNER * scale


def face_at(seen: Projection, place: Place, scale: float) -> int | None:
    """The face at a place of the window; None where there is none."""
    centre = middle(seen, scale)
    at = np.subtract(place, centre) / (HALF * scale)
    if np.abs(at).max() > 2:
        return None
    for face, corners, _ in faces(seen.camera):
        edges = np.roll(corners, -1, axis=0) - corners
        to = at - corners
        side = edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0]
        if (side >= 0).all() or (side <= 0).all():
            return face
    return None
