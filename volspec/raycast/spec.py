"""What a cast is asked to do: camera and settings, frozen and valid at birth.

Axes: world millimetres, right-handed. Picture rows run downwards, the first row is the top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import CameraError, RaycastError
from volspec.volume import Volume

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole or, where ``height_mm`` is given, an orthographic camera.

    Parameters
    ----------
    position_mm, target_mm : (x, y, z)
        Where it stands and what it looks at.
    up : (x, y, z)
        A direction that shall point upwards in the picture.
    fov_deg : float
        Vertical field of view of the pinhole, above 0 and below 180.
    height_mm : float, optional
        Height of the picture in the world; makes the camera orthographic.

    Raises
    ------
    CameraError
        If a number is not finite, the camera stands on its target, or looks along ``up``.
    """

    position_mm: Vector
    target_mm: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov_deg: float = 30.0
    height_mm: float | None = None

    def __post_init__(self) -> None:
        for name in ("position_mm", "target_mm", "up"):
            object.__setattr__(self, name, _three(name, getattr(self, name)))
        if not 0 < self.fov_deg < 180:
            raise CameraError(f"camera: fov_deg is {self.fov_deg}; give degrees between 0 and 180")
        if self.height_mm is not None and not (
            math.isfinite(self.height_mm) and self.height_mm > 0
        ):
            raise CameraError(f"camera: height_mm is {self.height_mm}; give millimetres above 0")
        view = np.subtract(self.target_mm, self.position_mm)
        distance = np.linalg.norm(view)
        if distance == 0:
            raise CameraError(f"camera: stands on its target {self.target_mm}; move one of them")
        if np.linalg.norm(np.cross(view / distance, self.up)) < 1e-6 * np.linalg.norm(self.up) or (
            not np.any(self.up)
        ):
            raise CameraError(f"camera: looks along its up direction {self.up}; choose another up")

    @classmethod
    def orbit(
        cls,
        volume: Volume,
        *,
        azimuth_deg: float = 30.0,
        elevation_deg: float = 20.0,
        zoom: float = 1.0,
        fov_deg: float = 30.0,
        up: Vector = (0.0, 0.0, 1.0),
        target_mm: Vector | None = None,
        orthographic: bool = False,
    ) -> Camera:
        """Look at a volume's centre, or a target, from a direction around its ``up`` axis.

        At zoom 1 the sphere around the volume just fills the picture's height. Azimuth 0
        stands at −y (z up), +90 at +x; an elevation of ±90 looks along ``up`` and takes the
        direction of azimuth as the picture's top.

        >>> import numpy as np
        >>> camera = Camera.orbit(Volume(np.zeros((3, 3, 3))), azimuth_deg=0, elevation_deg=0)
        >>> [round(x, 3) for x in camera.position_mm]
        [1.0, -5.692, 1.0]
        """
        volume = Volume.of(volume)
        for name, angle in (("azimuth_deg", azimuth_deg), ("elevation_deg", elevation_deg)):
            if not math.isfinite(angle):
                raise CameraError(f"camera: {name} is {angle}; give degrees")
        if not (math.isfinite(zoom) and zoom > 0):
            raise CameraError(f"camera: zoom is {zoom}; give a number above 0")
        if not 0 < fov_deg < 180:
            raise CameraError(f"camera: fov_deg is {fov_deg}; give degrees between 0 and 180")
        corners = volume.corners_mm
        centre = corners.mean(axis=0)
        radius = float(np.linalg.norm(corners - centre, axis=1).max()) or 1.0
        target = centre if target_mm is None else np.array(_three("target_mm", target_mm))
        axis = np.asarray(up, dtype=np.float64)
        if axis.shape != (3,) or not np.linalg.norm(axis) > 0:
            raise CameraError(f"camera: up is {up}; give a direction")
        axis = axis / np.linalg.norm(axis)
        # The front: −y, made perpendicular to up; where up is ±y, −x.
        front = np.array([0.0, -1.0, 0.0])
        front -= front.dot(axis) * axis
        if np.linalg.norm(front) < 1e-6:
            front = np.array([-1.0, 0.0, 0.0])
        front /= np.linalg.norm(front)
        side = np.cross(axis, front)
        azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
        around = math.cos(azimuth) * front + math.sin(azimuth) * side
        direction = math.cos(elevation) * around + math.sin(elevation) * axis
        top = math.cos(elevation) * axis - math.sin(elevation) * around
        distance = radius / math.sin(math.radians(fov_deg) / 2) / zoom
        return cls(
            position_mm=tuple(target + distance * direction),
            target_mm=tuple(target),
            up=tuple(top),
            fov_deg=fov_deg,
            height_mm=2 * radius / zoom if orthographic else None,
        )

    def frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors (right, up, forward) of the picture in the world."""
        forward = np.subtract(self.target_mm, self.position_mm)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def ray_field(self, width: int, height: int) -> RayField:
        """The rays of a picture of so many pixels."""
        right, up, forward = self.frame()
        distance = float(np.linalg.norm(np.subtract(self.target_mm, self.position_mm)))
        tall = self.height_mm or 2 * distance * math.tan(math.radians(self.fov_deg) / 2)
        return RayField(
            target=np.asarray(self.target_mm),
            forward=forward,
            across=right * (tall / height),
            down=-up * (tall / height),
            middle=((width - 1) / 2, (height - 1) / 2),
            distance=distance,
            perspective=self.height_mm is None,
        )


def _three(name: str, given: Vector) -> Vector:
    try:
        x, y, z = (float(v) for v in given)
    except (TypeError, ValueError):
        raise CameraError(f"camera: {name} is {given!r:.60}; give three numbers") from None
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise CameraError(f"camera: {name} is {(x, y, z)}; give three finite numbers")
    return x, y, z


@dataclass(frozen=True, slots=True, eq=False)
class RayField:
    """Rays as offsets in the plane through the camera's target, square to its view.

    Pixel (x, y) passes the plane at ``target + r``, r = (x − x₀) across + (y − y₀) down, with
    direction ``forward * distance + r`` (perspective) or ``forward``. Anchoring rays at the
    target keeps single-precision coordinates as small as the volume, however far the camera.
    """

    target: NDArray[np.float64]
    forward: NDArray[np.float64]
    across: NDArray[np.float64]
    down: NDArray[np.float64]
    middle: tuple[float, float]
    distance: float
    perspective: bool


@dataclass(frozen=True, slots=True)
class RaycastSpec:
    """How a ray is marched and shaded.

    Parameters
    ----------
    step_mm : float, optional
        Distance of samples; half the volume's smallest spacing when left out.
    ambient, diffuse, specular : float
        Weights ≥ 0 of light from everywhere, two-sided Lambert and Blinn-Phong from a
        headlight. With ``diffuse`` and ``specular`` 0 no gradient is computed;
        ``ambient=1, diffuse=0`` shows the plain reflectances.
    shininess : int
        Blinn-Phong exponent, 1 to 1024; whole, since integer powers cost a few products.
    alpha_stop : float
        A ray ends when its opacity passes this; above 0, up to 1 (never ends early).
    flat_gradient : float
        Gradients below this share of the volume's range per smallest spacing fade to
        unshaded, so that noise in flat regions leaves no speckle.
    """

    step_mm: float | None = None
    ambient: float = 0.3
    diffuse: float = 0.7
    specular: float = 0.0
    shininess: int = 32
    alpha_stop: float = 0.9995
    flat_gradient: float = 0.02

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "flat_gradient"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise RaycastError(f"raycast: {name} is {value}; give a number of 0 or more")
        if self.shininess not in range(1, 1025):
            raise RaycastError(
                f"raycast: shininess is {self.shininess}; give a whole number of 1 to 1024"
            )
        if self.step_mm is not None and not (math.isfinite(self.step_mm) and self.step_mm > 0):
            raise RaycastError(f"raycast: step_mm is {self.step_mm}; give millimetres above 0")
        if not 0 < self.alpha_stop <= 1:
            raise RaycastError(f"raycast: alpha_stop is {self.alpha_stop}; give 0…1, above 0")

    @property
    def shaded(self) -> bool:
        """Whether gradients are needed."""
        return self.diffuse > 0 or self.specular > 0

    def step_of(self, volume: Volume) -> float:
        """The step in millimetres for a volume."""
        return self.step_mm or 0.5 * min(volume.spacing_mm)

    def gradient_scale(self, volume: Volume) -> float:
        """Value per smallest spacing -> share of the volume's range; 0 for a constant one."""
        low, high = volume.range
        return 1 / (high - low) if high > low else 0.0

    @property
    def gradient_floor_squared(self) -> float:
        """`flat_gradient` squared; never 0, so that 0/0 cannot arise."""
        return max(self.flat_gradient**2, 1e-12)
