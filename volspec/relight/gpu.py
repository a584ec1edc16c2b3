"""Relight on the GPU: one full-screen triangle per light change (shaders/relight.frag).

    illumination -> [gpu] -> frame

The coefficients are uploaded once. A light change sends three numbers a channel and draws.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._gpu.opengl import (
    ContextLost,
    compile_program,
    describe,
    egl_handle,
    headless_context,
    made_current,
)
from volspec._gpu.prelude import prelude
from volspec._gpu.sharing import Sharing, current, named
from volspec._gpu.sources import assemble
from volspec.appearance.constants import shader_constants, sRGB_FROM_XYZ
from volspec.appearance.live import passage_of
from volspec.appearance.models.conditions import CamPassage
from volspec.appearance.passages import CurvePassage, LinearPassage, Passage
from volspec.appearance.spec import Viewing
from volspec.errors import OpenCLError, OpenGLError, ShapeError
from volspec.relight.illumination import Illumination
from volspec.relight.packed import layer_count, pack_layers
from volspec.relight.shared import SharedLayers
from volspec.relight.spec import Pixels

if TYPE_CHECKING:
    import moderngl

_GLSL = "330 core"
# Components of uniforms: a mat4x3 takes four vectors of four, and this much is for all the others.
_COMPONENTS_PER_LAYER, _OTHER_COMPONENTS = 16, 64


# The forms of a passage, by the numbers that the shader knows them by.
_FORMS: dict[type, int] = {LinearPassage: 0, CurvePassage: 1, CamPassage: 2}


def form_of(passage: Passage) -> dict[str, int]:
    """What ``shaders/relight.frag`` is compiled with to draw a passage."""
    same = isinstance(passage, CamPassage) and np.allclose(
        (passage.lightness_power, passage.chroma_gain), 1, rtol=0, atol=1e-7
    )
    outer = isinstance(passage, CurvePassage) and bool(np.any(passage.outer != 1))
    return {"FORM": _FORMS[type(passage)], "SAME_SURROUND": int(same), "OUTER": int(outer)}


def uniforms(light: Illumination, passage: Passage) -> dict[str, NDArray[np.float32]]:
    """What a light change sends to ``shaders/relight.frag``, by GLSL name.

    Parameters
    ----------
    light : Illumination
        The light, for L·M channels.
    passage : Passage
        From the scene to the display.

    Returns
    -------
    dict
        Flat float32 arrays; matrices column by column. Of ``passage.*`` what `form_of` asks for.
    """
    channels = light.XYZ_from_channels.shape[1]
    columns = np.zeros((layer_count(channels) * 4, 3))
    columns[:channels] = light.XYZ_from_channels.T
    # Opacity takes away what the backdrop gives: (1 - alpha) XYZ_backdrop without a branch.
    columns[channels] = -light.backdrop_XYZ
    backdrop = light.backdrop_XYZ
    values: dict[str, ArrayLike] = {}
    if isinstance(passage, LinearPassage):  # costs a pixel nothing
        columns, backdrop = columns @ passage.matrix.T, passage.matrix @ backdrop
    elif isinstance(passage, CurvePassage):
        values = {
            "passage.response_from_XYZ": passage.response_from_XYZ.T,
            "passage.linear_from_response": (sRGB_FROM_XYZ @ passage.XYZ_from_response).T,
            "passage.gain": passage.gain,
            "passage.power": passage.power,
            "passage.shift": passage.shift,
            "passage.offset": passage.offset,
        }
        if form_of(passage)["OUTER"]:
            values["passage.outer"] = passage.outer
    elif isinstance(passage, CamPassage):
        values = {
            "passage.response_from_XYZ": passage.response_from_XYZ.T,
            "passage.linear_from_response": (sRGB_FROM_XYZ @ passage.XYZ_from_response).T,
            "passage.scene_achromatic": passage.scene_achromatic,
            "passage.display_achromatic": passage.display_achromatic,
        }
        if not form_of(passage)["SAME_SURROUND"]:
            values |= {
                "passage.lightness_power": passage.lightness_power,
                "passage.chroma_gain": passage.chroma_gain,
            }
    values |= {"XYZ_from_layer": columns, "backdrop_XYZ": backdrop}
    return {name: np.asarray(v, dtype=np.float32).ravel() for name, v in values.items()}


class GLEngine:
    """Draws frames of one coefficient image with OpenGL.

    Parameters
    ----------
    coefficients : (H, W, L·M) float32
        The channels of L light groups, premultiplied by alpha.
    alpha : (H, W) float32
        Opacity.
    context : moderngl.Context, optional
        A context that is current and stays its owner's; None makes a headless one.

    Raises
    ------
    OpenGLError
        If no context can be made, the image or its channels do not fit the device, or the driver
        refuses the shader.
    """

    def __init__(
        self,
        coefficients: NDArray[np.float32],
        alpha: NDArray[np.float32],
        context: moderngl.Context | None = None,
    ) -> None:
        self._owned = context is None
        self._context = headless_context() if context is None else context
        self._resources: list[Any] = []
        self._programs: dict[tuple[int, ...], tuple[Any, Any]] = {}
        self._targets: dict[str, Any] = {}
        self._shared: Any = None
        self._height, self._width, self._channels = coefficients.shape
        with self._context:
            self._handle = egl_handle()
        try:
            with self._current():
                self._prepare()
            self.upload(coefficients, alpha)
        except OpenGLError:
            self.close()
            raise

    def _prepare(self) -> None:
        """Make what every frame needs, so that a driver's refusal shows here."""
        import moderngl

        device = describe(self._context)
        self.name = str(device["device"])
        size = (self._width, self._height, layer_count(self._channels))
        if max(size) > device["max_size"]:
            raise OpenGLError(
                f"OpenGL: the image is {self._width} x {self._height}, the largest texture of "
                f"{self.name} {device['max_size']}; cast a smaller image"
            )
        room = self._context.info["GL_MAX_FRAGMENT_UNIFORM_COMPONENTS"] - _OTHER_COMPONENTS
        layers = min(device["max_layers"], room // _COMPONENTS_PER_LAYER)
        if size[2] > layers:
            raise OpenGLError(
                f"OpenGL: the image has {self._channels} channels in all light groups, "
                f"{self.name} takes {4 * layers - 1}; cast fewer groups or with a smaller basis"
            )
        try:
            self._texture = self._keep(self._context.texture_array(size, 4, dtype="f4"))
            self._target("f1")
        except moderngl.Error as error:
            raise OpenGLError(
                f"OpenGL: {self.name} has no room for {size[0]} x {size[1]} pixels of "
                f"{self._channels} channels ({error}); cast a smaller image"
            ) from error
        self._program({"FORM": _FORMS[CamPassage], "SAME_SURROUND": 1, "OUTER": 0})

    def _keep(self, resource: Any) -> Any:
        self._resources.append(resource)
        return resource

    def _current(self) -> AbstractContextManager[None]:
        return made_current(self._context, self._handle)

    def upload(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Take another image of the first one's shape; (H, W, L·M) and (H, W)."""
        with self._current():
            self._texture.write(pack_layers(coefficients, alpha))

    def place(self, sharing: Sharing) -> SharedLayers:
        """A buffer for OpenCL to pack a picture into; what is drawn stays until `take`.

        Raises
        ------
        OpenCLError
            If OpenCL shares another context.
        """
        with self._current():
            here = current()
            if here is None or here.handle != sharing.handle:
                raise OpenCLError(
                    f"raycast: the Raycaster shares {sharing.name}, the Relighter draws in "
                    f"{named(self._context, here)}; give both the same context"
                )
            if self._shared is None:
                size = 16 * layer_count(self._channels) * self._height * self._width
                self._shared = self._keep(self._context.buffer(reserve=size, dynamic=True))
        return SharedLayers(sharing, self._shared, (self._height, self._width, self._channels))

    def take(self, place: SharedLayers) -> None:
        """Draw what a finished cast has put there."""
        with self._current():
            self._texture.write(place.buffer)

    def _program(self, form: dict[str, int]) -> tuple[Any, Any]:
        key = tuple(form.values())
        if key not in self._programs:
            constants = {
                "LAYERS": layer_count(self._channels),
                **form,
                **{kind.__name__.removesuffix("Passage").upper(): n for kind, n in _FORMS.items()},
                "FIRST_ROW_AT_BOTTOM": 1,
                "IMAGE_HEIGHT": self._height,
                **shader_constants(),
            }
            lines = prelude(constants, "glsl")
            vertex = assemble("shaders/fullscreen.vert", lines, glsl_version=_GLSL)
            fragment = assemble("shaders/relight.frag", lines, glsl_version=_GLSL)
            program = self._keep(compile_program(self._context, vertex, fragment))
            self._programs[key] = program, self._keep(self._context.vertex_array(program, []))
        return self._programs[key]

    def _target(self, dtype: str) -> Any:
        if dtype not in self._targets:
            size = (self._width, self._height)
            color = self._keep(self._context.texture(size, 4, dtype=dtype))
            self._targets[dtype] = self._keep(self._context.framebuffer([color]))
        return self._targets[dtype]

    def render(
        self, light: Illumination, viewing: Viewing, dtype: type[np.uint8] | type[np.float32]
    ) -> Pixels:
        """(H, W, 3) sRGB codes: uint8, or float32 0 to 1 before rounding.

        Raises
        ------
        ShapeError
            If the light is for another number of channels.
        ContextLost
            If another library ended the context.
        """
        channels = light.XYZ_from_channels.shape[1]
        if channels != self._channels:
            raise ShapeError(
                f"relight: the light has {channels} channels, the image {self._channels}; "
                "were both made with the same basis and light groups?"
            )
        with self._current():
            passage = passage_of(light.viewed(viewing), light.white_XYZ)
            values = uniforms(light, passage)
            program, triangle = self._program(form_of(passage))
            for name, value in values.items():
                program[name].write(value.tobytes())
            kind = "f1" if dtype is np.uint8 else "f4"
            target = self._target(kind)
            # An owner's context may come with blending or a depth test switched on.
            self._context.enable_only(self._context.NOTHING)
            target.use()
            self._texture.use(0)
            triangle.render(self._context.TRIANGLES, vertices=3)
            # The driver drops alpha while copying, five times faster than NumPy would.
            pixels = np.empty((self._height, self._width, 3), dtype=dtype)
            target.read_into(pixels, components=3, dtype=kind)
        return pixels

    def close(self) -> None:
        """Release everything made here."""
        try:
            with self._current():
                for resource in reversed(self._resources):
                    resource.release()
        except ContextLost:
            pass  # gone with the context; the names now mean another library's objects
        else:
            if self._owned:
                self._context.release()
        self._resources.clear()
