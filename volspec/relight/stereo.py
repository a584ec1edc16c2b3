"""Stereo pairs and anaglyphs of one cast: two nearby views of its layers of opacity.

    CoefficientImage with layers -> [stereo] -> two images -> relight -> two frames -> [stereo]

The eyes look in parallel, and their pictures are shifted so that they agree at the convergence
distance: the off-axis frusta of two parallel cameras, without vertical parallax. Parallel rays have
no such shift; there the cameras turn around the point of convergence.

Anaglyphs are mixed in linear light: the least-squares projection of red-cyan glasses [1], which
keeps the most of both eyes' colours; or red of the left eye's grey, and green and blue of the
right eye's colours (half-colour).

References
----------
[1] Dubois (2001), "A projection method to generate anaglyph stereo images", ICASSP, 1661-1664;
    matrices in Dubois (2009), "Conversion of a stereo pair to anaglyph with the least-squares
    projection method".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec._gpu import Compute, assemble, compile_program, egl_handle, made_current, prelude
from volspec.appearance.display import ColourSpace, colour_space
from volspec.camera import Camera, RayField
from volspec.errors import ImageError
from volspec.image import CoefficientImage, DepthEffects, Reprojector, fog_behind, layers_in_depth
from volspec.settings import Positive, Unit, settings

Layout = Literal["side-by-side", "crossed", "anaglyph", "half-colour"]
"""Ways to show both eyes' pictures in one."""
Matrix = NDArray[np.float64]
# Layouts of two pictures next to each other.
_PAIRS = "side-by-side", "crossed"
EYES = 1 / 30
"""Distance between the eyes over the way to the subject, as photographers choose it."""
# Points a deep layer: pairs are looked at for longer than a first picture of a turn.
_PARTS = 6
_LEFT_DUBOIS = np.array([[0.437, 0.449, 0.164], [-0.062, -0.062, -0.024], [-0.048, -0.050, -0.017]])
_RIGHT_DUBOIS = np.array([[-0.011, -0.032, -0.007], [0.377, 0.761, 0.009], [-0.026, -0.093, 1.234]])


@settings(ImageError)
@dataclass(frozen=True, slots=True)
class Stereo:
    """Eyes of a stereo pair."""

    layout: Layout = "side-by-side"
    """Left eye's picture left of the right one's, or right of it for crossed eyes; or an anaglyph
    for red-cyan glasses, by Dubois or half-colour."""
    eyes_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance between the eyes; a thirtieth of the convergence distance if left out."""
    eyes_deg: Annotated[float, Field(gt=0, le=30), Unit("degrees")] | None = None
    """The same as an angle between the eyes at the convergence distance."""
    convergence_mm: Annotated[Positive, Unit("mm")] | None = None
    """Distance at which both pictures agree; the expected depth if left out."""

    def __post_init__(self) -> None:
        if self.eyes_mm is not None and self.eyes_deg is not None:
            raise ImageError(
                f"{self.eyes_mm:g} mm and {self.eyes_deg:g} degrees",
                "leave one out",
                code="conflict",
                field="eyes_mm",
            )

    def cameras(self, image: CoefficientImage) -> tuple[Camera, Camera]:
        """Return the left and right eye's camera of an image that knows its own."""
        camera = image.camera
        if camera is None:
            raise ImageError(
                "stereo: the image does not know its camera", "cast it again", code="missing"
            )
        return self.eyes(camera, self.convergence_mm or expected_depth_mm(image))

    def eyes(self, camera: Camera, convergence_mm: float) -> tuple[Camera, Camera]:
        """Return the left and right eye's camera; their pictures agree at the convergence."""
        angle = 2 * math.atan(EYES / 2)
        if self.eyes_deg is not None:
            angle = math.radians(self.eyes_deg)
        if self.eyes_mm is not None:
            angle = 2 * math.atan(self.eyes_mm / 2 / convergence_mm)
        left, right = (_eye(camera, sign * angle / 2, convergence_mm) for sign in (-1, 1))
        return left, right

    def frame_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return width and height of both eyes' frames as one."""
        width, height = size
        return (2 * width, height) if self.layout in _PAIRS else size

    def eye_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return width and height of one eye's picture, if both are shown in the room of one."""
        width, height = (max(1, side // (1 + (self.layout in _PAIRS))) for side in size)
        return width, height

    def combine(
        self,
        left: NDArray[Any],
        right: NDArray[Any],
        space: str | Path | ColourSpace = "sRGB",
    ) -> NDArray[Any]:
        """Return both eyes' frames as one: display codes, 0 to 1 or 8 or 16 bits, (H, W, 3)."""
        if self.layout in _PAIRS:
            return np.hstack([left, right] if self.layout == "side-by-side" else [right, left])
        maximum = float(np.iinfo(left.dtype).max) if left.dtype.kind == "u" else 1.0
        display = colour_space(space)
        mixed = sum(
            display.decode(np.asarray(frame, np.float64) / maximum) @ mix.T
            for frame, mix in zip((left, right), self.mixes(display), strict=True)
        )
        codes = display.encode(np.clip(mixed, 0.0, 1.0))
        return (np.rint(maximum * codes) if maximum > 1 else codes).astype(left.dtype)

    def mixes(self, display: ColourSpace) -> tuple[Matrix, Matrix]:
        """Return the parts of an anaglyph that are the left and right eye's linear RGB, (3, 3)."""
        if self.layout == "anaglyph":
            return _LEFT_DUBOIS, _RIGHT_DUBOIS
        red = np.zeros((3, 3))
        red[0] = display.XYZ_from_RGB[1] / 100.0
        return red, np.diag([0.0, 1.0, 1.0])


def expected_depth_mm(image: CoefficientImage) -> float:
    """Return the mean depth of a picture along its camera's view, by opacity; without surfaces.

    These may reach far, as a floor does.
    """
    camera, layers = image.camera, image.opacity_layers
    assert camera is not None
    alpha, depth_mm = image.alpha, image.depth_mm
    if layers is not None and layers.solid:
        picture = layers.fading.recompose([1.0] * layers.materials)
        if picture.alpha.any():
            alpha = picture.alpha
            depth_mm = np.divide(picture.depth_mm, np.where(alpha > 0, alpha, 1), dtype=np.float32)
    visible = np.isfinite(depth_mm) & (alpha > 0)
    if not visible.any():
        return camera.distance_mm
    along_mm = depth_mm * camera.ray_field(*image.size).cosines(*image.size)
    return float(np.average(along_mm[visible], weights=alpha[visible]))


class StereoViews:
    """Stereo pairs of one image, whose layers stay on an OpenCL device.

    Arguments and errors as of `Reprojector`.
    """

    def __init__(self, image: CoefficientImage, compute: Compute | None = None) -> None:
        self.image, self.compute = image, compute
        self._cameras: tuple[Stereo, tuple[Camera, Camera]] | None = None
        # The layers with effects of depth, which depend on the scales; none without.
        self._latest: tuple[tuple[DepthEffects, list[float]] | None, Reprojector] | None = None

    def views(
        self,
        stereo: Stereo,
        scales: Mapping[str, float] | None = None,
        effects: DepthEffects | None = None,
        size: tuple[int, int] | None = None,
    ) -> tuple[CoefficientImage, CoefficientImage]:
        """Return the left and right eye's picture, reprojected, in another size if given."""
        reprojector = self._reprojector(scales or {}, effects or DepthEffects())
        if self._cameras is None or self._cameras[0] != stereo:
            self._cameras = stereo, stereo.cameras(self.image)
        left, right = (reprojector.view(eye, scales, size) for eye in self._cameras[1])
        if effects is not None and effects.fog_mm is not None:
            return fog_behind(left, effects), fog_behind(right, effects)
        return left, right

    def _reprojector(self, scales: Mapping[str, float], effects: DepthEffects) -> Reprojector:
        key = (effects, self.image.opacity_scales(scales)) if effects.changes else None
        if self._latest is None or self._latest[0] != key:
            image = layers_in_depth(self.image, key[1], effects) if key else self.image
            self._latest = key, Reprojector(image, parts=_PARTS, compute=self.compute)
            self.compute = self._latest[1].compute
        return self._latest[1]


class StereoPass:
    """Both eyes' frames combined in the GL context that holds them: `Stereo.combine` on the GPU.

    Raises OpenGLError if the driver refuses the shader.
    """

    def __init__(self, context: Any) -> None:
        self._context = context
        with context:
            self._handle = egl_handle()
        self._programs: dict[tuple[bool, object], tuple[Any, Any]] = {}
        self._target: Any = None

    def draw(self, stereo: Stereo, left: Any, right: Any, space: ColourSpace) -> Any:
        """Return a framebuffer with both eyes', which is valid until the next call."""
        with made_current(self._context, self._handle):
            return self._draw(stereo, left, right, space)

    def _draw(self, stereo: Stereo, left: Any, right: Any, space: ColourSpace) -> Any:
        context, pair = self._context, stereo.layout in _PAIRS
        size = stereo.frame_size(left.size)
        if self._target is None or self._target.size != size:
            self._release_target()
            self._target = context.framebuffer([context.texture(size, 4)])
        program, triangle = self._program(pair, space)
        frames = (right, left) if stereo.layout == "crossed" else (left, right)
        for unit, frame in enumerate(frames):
            frame.color_attachments[0].use(unit)
        if not pair:
            for name, mix in zip(("left_mix", "right_mix"), stereo.mixes(space), strict=True):
                program[name].write(mix.T.astype(np.float32).tobytes())
        self._target.use()
        context.enable_only(context.NOTHING)
        triangle.render(context.TRIANGLES, vertices=3)
        return self._target

    def _program(self, pair: bool, space: ColourSpace) -> tuple[Any, Any]:
        key = pair, space.transfer
        if key not in self._programs:
            constants = {"SIDE_BY_SIDE": int(pair), "SIMULATE": 0, **space.shader_constants()}
            lines = prelude(constants, "glsl")
            vertex = assemble("shaders/fullscreen.vert", lines, glsl_version="330 core")
            fragment = assemble("shaders/stereo.frag", lines, glsl_version="330 core")
            program = compile_program(self._context, vertex, fragment)
            for unit, name in enumerate(("left", "right")):
                if (uniform := cast(Any, program.get(name, None))) is not None:
                    uniform.value = unit
            self._programs[key] = program, self._context.vertex_array(program, [])
        return self._programs[key]

    def _release_target(self) -> None:
        if self._target is not None:
            self._target.color_attachments[0].release()
            self._target.release()
            self._target = None

    def close(self) -> None:
        """Release everything."""
        self._release_target()
        for program, triangle in self._programs.values():
            triangle.release()
            program.release()
        self._programs.clear()


@dataclass(frozen=True, slots=True)
class ShiftedCamera(Camera):
    """Camera whose picture is shifted across, as by a shift lens."""

    shift: float = 0.0
    """Way of the middle of the view to the right in the picture, by the picture's height."""

    def ray_field(self, width: float, height: float) -> RayField:
        """Return the rays of a picture."""
        field = Camera.ray_field(self, width, height)
        x, y = field.middle
        return replace(field, middle=(x + self.shift * height, y))


def _eye(camera: Camera, angle: float, convergence_mm: float) -> Camera:
    """Return the camera to the right of another by an angle, seen from the convergence distance."""
    right, _, forward = camera.frame()
    if camera.height_mm is not None:
        place = np.asarray(camera.position_mm) + convergence_mm * forward
        towards = math.sin(angle) * right - math.cos(angle) * forward
        position = place + convergence_mm * towards
        axis = camera.frame()[1]
        return replace(
            camera,
            position_mm=tuple(position),
            target_mm=tuple(position - camera.distance_mm * towards),
            up=tuple(axis),
        )
    aside = math.tan(angle) * convergence_mm
    window_height = 2 * math.tan(math.radians(camera.fov_deg) / 2)
    displacement = aside * right
    return ShiftedCamera(
        tuple(np.asarray(camera.position_mm) + displacement),
        tuple(np.asarray(camera.target_mm) + displacement),
        camera.up,
        camera.fov_deg,
        shift=math.tan(angle) / window_height,
    )
