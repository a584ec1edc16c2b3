"""Relight on the GPU: one full-screen triangle per light change (shaders/relight.frag).

    illumination -> [gpu] -> frame

The coefficients are uploaded once. A light change sends three numbers per channel and draws.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import (
    Allocation,
    Sharing,
    abandoned_queue,
    context_name,
    current,
    describe,
    egl_handle,
    lend_context,
    made_current,
    release_abandoned,
)
from volspec.appearance import (
    DisplayOutput,
    LinearTransform,
    LutCache,
    LutKey,
    LutSpace,
    Viewing,
    ViewTransform,
    ViewTransformGrid,
    is_narrow,
    screen_for_viewing,
    view_transform,
)
from volspec.appearance.models import CamTransform
from volspec.errors import OpenCLError, OpenGLError, ShapeError
from volspec.relight.illumination import Illumination
from volspec.relight.programs import (
    FORMS,
    UNITS,
    Closed,
    DrawnTransform,
    LookupTextures,
    LutTransform,
    Programs,
    Uniforms,
    light_uniforms,
    screen_uniforms,
    shader_form,
    transform_uniforms,
)
from volspec.relight.recompose import PackedOpacity, Recomposer
from volspec.relight.spec import Pixels
from volspec.relight.texture_planes import SharedLayers, TexturePlanes, layer_count, pack_layers

if TYPE_CHECKING:
    import moderngl

# x, y, width and height in pixels, from the picture's first row.
Box = tuple[int, int, int, int]
# Component types of textures.
_COMPONENTS: dict[type, str] = {np.uint8: "f1", np.float32: "f4"}
_ENDED = object()
# Renderers that draw on the CPU.
SOFTWARE = ("llvmpipe", "softpipe", "SwiftShader")
# Pixels from which a LUT pays on them, including its baking: frames that are read back gain 5 to
# 10 % at 1024², a quarter at 2048²; a third if the light's white is unchanged.
LUT_PIXELS = 2**20
# Uniform components: a layer's mat4x3 uses four vectors of four; all others together, this many.
_COMPONENTS_PER_LAYER, _OTHER_COMPONENTS = 16, 64


class GLEngine:
    """OpenGL engine that draws frames of one coefficient image.

    ``coefficients`` (H, W, L·M) are the channels of L light groups, premultiplied by ``alpha`` (H,
    W). For the other arguments see `Relighter`. Raises OpenGLError if no context can be made, the
    image or its channels do not fit the device, or the driver refuses the shader.
    """

    def __init__(
        self,
        coefficients: NDArray[np.float32],
        alpha: NDArray[np.float32],
        context: moderngl.Context | None = None,
        lut3d: bool | None = None,
        lut_cache: LutCache | None = None,
        packed: TexturePlanes | None = None,
    ) -> None:
        lent = context is not None
        release_abandoned(context)
        if context is None:
            self._context, self._handle = lend_context()
        else:
            self._context = context
            with context:
                self._handle = egl_handle()
        self._allocation = Allocation(self._context, self._handle, lent)
        # If it is not closed. At the end of the process the driver ends, too.
        self._unclosed = weakref.finalize(self, abandoned_queue().append, self._allocation)
        self._unclosed.atexit = False
        # The latest viewing and white, their transform, and its LUT once baked.
        self._latest: tuple[LutKey, ViewTransform, LutTransform | None] | None = None
        self._by_lut = lut3d
        self._lut_cache = LutCache() if lut_cache is None else lut_cache
        # The viewing under which the picture has colours in invalid cells of its LUT.
        self._lut_rejected: Viewing | None = None
        self._targets: dict[str, Any] = {}
        self._shared: Any = None
        self._recomposer: Recomposer | None = None
        # True if the picture's layers are on the device; if it is drawn as recomposed from them.
        self.has_opacity = self._is_recomposed = False
        self._height, self._width, self._channels = coefficients.shape
        try:
            with self._current():
                self._prepare()
            if packed is None:
                self.upload(coefficients, alpha)
            else:
                self.take(packed)
        except OpenGLError:
            self.close()
            raise

    def _prepare(self) -> None:
        """Create the resources that every frame needs, so that driver errors occur here."""
        import moderngl

        device = describe(self._context)
        self.name = str(device["device"])
        self._software = any(word in self.name for word in SOFTWARE)
        size = (self._width, self._height, layer_count(self._channels))
        if max(size) > device["max_size"]:
            raise OpenGLError(
                f"the image is {self._width} x {self._height}, but {self.name} has textures of at "
                f"most {device['max_size']}",
                "cast a smaller image",
                code="size",
                field="OpenGL",
            )
        room = self._context.info["GL_MAX_FRAGMENT_UNIFORM_COMPONENTS"] - _OTHER_COMPONENTS
        layers = min(device["max_layers"], room // _COMPONENTS_PER_LAYER)
        if size[2] > layers:
            raise OpenGLError(
                f"the image has {self._channels} channels in all light groups, but {self.name} "
                f"supports {4 * layers - 1}",
                "cast fewer groups or use a smaller basis",
                code="size",
                field="OpenGL",
            )
        try:
            self._texture = self._track(self._context.texture_array(size, 4, dtype="f4"))
            self._target("f1")
        except moderngl.Error as error:
            raise OpenGLError(
                f"{self.name} has no memory for {size[0]} x {size[1]} pixels of {self._channels} "
                f"channels ({error})",
                "cast a smaller image",
                code="size",
                field="OpenGL",
            ) from error
        form = {
            "FORM": FORMS[CamTransform],
            "SAME_SURROUND": 1,
            "OUTER": 0,
            "PROPORTIONAL": 0,
            "FIELD": 0,
            "CHECKED": 0,
        }
        # Only canvases use the height: at 0, all sizes share one source and the driver's cache.
        constants = {
            "LAYERS": layer_count(self._channels),
            "IMAGE_HEIGHT": 0,
            "EVERY": 1,
            "EXACT_SAMPLER": int(self._software),
        }
        self._programs = Programs(self._context, constants, self._track)
        self._lookups = LookupTextures(self._context, self._track)
        self._sample_query = self._context.query(samples=True)
        self._programs.program("relight", form, screen_for_viewing(Viewing()))

    def _track(self, resource: Any) -> Any:
        self._allocation.resources.append(resource)
        return resource

    def _current(self) -> AbstractContextManager[None]:
        return made_current(self._context, self._handle)

    def upload(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Upload another image of the same shape; (H, W, L·M) and (H, W)."""
        self.take(TexturePlanes(pack_layers(coefficients, alpha)))

    def place(self, sharing: Sharing) -> SharedLayers:
        """Return a buffer into which OpenCL packs a picture; frames do not change until `take`.

        Raises OpenCLError if OpenCL shares another context than this engine's.
        """
        with self._current():
            here = current()
            if here is None or here.handle != sharing.handle:
                raise OpenCLError(
                    f"the Raycaster shares {sharing.name}, but the Relighter draws in "
                    f"{context_name(self._context, here)}",
                    "give both the same context",
                    code="conflict",
                    field="raycast",
                )
            if self._shared is None:
                size = 16 * layer_count(self._channels) * self._height * self._width
                self._shared = self._track(self._context.buffer(reserve=size, dynamic=True))
        return SharedLayers(sharing, self._shared, (self._height, self._width, self._channels))

    def take(self, layers: SharedLayers | TexturePlanes) -> None:
        """Draw the picture that a finished cast packed from now on."""
        with self._current():
            if isinstance(layers, SharedLayers):
                self._texture.write(layers.buffer)
            else:
                size = self._width, self._height, len(layers.layers)
                self._texture.write(layers.layers, viewport=(0, 0, layers.first, *size))
        self._lut_rejected = None
        self.has_opacity = self._is_recomposed = False

    def load_opacity(self, packed: PackedOpacity) -> Iterator[None]:
        """Upload the layers of opacity of the picture that is drawn, step by step.

        Raises OpenGLError if the device has no room for them, or its driver refuses the shader.
        """
        import moderngl

        with self._current():
            if self._recomposer is None or not self._recomposer.fits(packed):
                if self._recomposer is not None:
                    self._allocation.resources.remove(self._recomposer)
                    self._recomposer.release()
                    self._recomposer = None
                recomposer = Recomposer(self._context, packed, (self._width, self._height))
                try:
                    recomposer.allocate()
                except moderngl.Error as error:
                    recomposer.release()
                    raise OpenGLError(
                        f"{self.name} has no memory for {packed.count} layers of opacity of "
                        f"{self._width} x {self._height} pixels ({error})",
                        "cast a smaller image, or with fewer layers",
                        code="size",
                        field="OpenGL",
                    ) from error
                self._recomposer = self._track(recomposer)
        yield
        steps = self._recomposer.load(packed, self._texture)
        going_on = True
        while going_on:
            with self._current():
                going_on = next(steps, _ENDED) is not _ENDED
            yield
        self.has_opacity = True

    @property
    def has_extents(self) -> bool:
        """True if the layers on the device have extents, which effects of depth need."""
        return self.has_opacity and self._recomposer is not None and self._recomposer.has_extents

    def recompose(self, scales: Sequence[float], depth: Mapping[str, Any] | None = None) -> None:
        """Draw the picture with its materials' optical depths scaled from now on.

        The layers are those of the last `load_opacity`; scales of 1 draw the picture as cast,
        unless it has effects of depth, `depth_uniforms`.
        """
        self._is_recomposed = depth is not None or any(scale != 1 for scale in scales)
        self._lut_rejected = None
        if self._is_recomposed:
            assert self._recomposer is not None
            with self._current():
                self._recomposer.draw(scales, depth)

    def _draw(
        self, name: str, form: Mapping[str, int], values: Uniforms, screen: DisplayOutput
    ) -> None:
        program, triangle = self._programs.program(name, form, screen)
        for uniform, value in values.items():
            program[uniform].write(value.tobytes())
        # A lent context may have blending or a depth test enabled.
        self._context.enable_only(self._context.NOTHING)
        triangle.render(self._context.TRIANGLES, vertices=3)

    def _target(self, dtype: str) -> moderngl.Framebuffer:
        if dtype not in self._targets:
            size = (self._width, self._height)
            colour = self._track(self._context.texture(size, 4, dtype=dtype))
            self._targets[dtype] = self._track(self._context.framebuffer([colour]))
        return self._targets[dtype]

    def render(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        grid: ViewTransformGrid | None = None,
    ) -> Pixels:
        """Return (H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding.

        A ``grid`` of view transforms over the picture replaces the viewing's. Errors as `draw`.
        """
        with self._current():
            target = self._draw_frame(light, viewing, dtype, grid)
            # The driver drops alpha while copying, five times faster than NumPy.
            pixels = np.empty((self._height, self._width, 3), dtype=dtype)
            target.read_into(pixels, components=3, dtype=_COMPONENTS[dtype])
        return pixels

    def draw(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        grid: ViewTransformGrid | None = None,
        within: Box | None = None,
    ) -> moderngl.Framebuffer:
        """Draw a frame and leave it on the device, in the engine's context.

        Pixels outside of ``within`` do not change. Raises ShapeError if the light is for another
        number of channels, ContextLost if another library ended the context.
        """
        with self._current():
            return self._draw_frame(light, viewing, dtype, grid, within)

    def _draw_frame(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        grid: ViewTransformGrid | None,
        within: Box | None = None,
    ) -> moderngl.Framebuffer:
        channels = light.XYZ_from_channels.shape[1]
        if channels != self._channels:
            raise ShapeError(
                f"the light has {channels} channels, the image {self._channels}",
                "were both made with the same basis and light groups?",
                field="relight",
            )
        screen = screen_for_viewing(viewing)
        drawn: DrawnTransform
        if grid is None:
            drawn = self._drawn_transform(viewing, light, dtype)
        else:
            drawn = grid
            self._lookups.load_grid(grid)
        # In moderngl's stubs a scissor cannot be reset.
        target: Any = self._target(_COMPONENTS[dtype])
        target.scissor = within
        target.use()
        texture = self._texture
        if self._is_recomposed and self._recomposer is not None:
            texture = self._recomposer.texture
        texture.use(UNITS["coefficients"])
        width, height = within[2:] if within else target.size
        if isinstance(drawn, LutTransform) and drawn.closed is not None:
            with self._sample_query:
                self._relight(light, drawn, screen)
            if self._sample_query.samples != width * height:
                # Some pixel's colour is in an invalid cell: draw this picture in closed form.
                self._lut_rejected = LutKey.of(viewing, light.white_XYZ).viewing
                self._relight(light, self._closed, screen)
        else:
            self._relight(light, drawn, screen)
        target.scissor = None
        return cast("moderngl.Framebuffer", target)

    @property
    def _closed(self) -> Closed:
        """The closed form from which the LUT was baked."""
        assert self._latest is not None and isinstance(self._latest[1], Closed)
        return self._latest[1]

    def _relight(self, light: Illumination, drawn: DrawnTransform, screen: DisplayOutput) -> None:
        values = light_uniforms(light, drawn) | transform_uniforms(drawn, screen)
        self._draw("relight", shader_form(drawn), values | screen_uniforms(screen), screen)

    def _drawn_transform(
        self, viewing: Viewing, light: Illumination, dtype: type[np.uint8] | type[np.float32]
    ) -> DrawnTransform:
        """Choose how to draw: the closed-form view transform, or its baked 3-D LUT.

        Transforms without a closed form need a LUT. On software GL it is also faster if a picture
        has many more pixels than the LUT has nodes; float frames, which are measured, frames under
        narrow lights, and pictures with colours in invalid cells stay exact.
        """
        key = LutKey.of(viewing, light.white_XYZ)
        colours = key.viewing.display.colours
        if self._latest is None or self._latest[0] != key:
            self._latest = key, view_transform(key.viewing, light.white_XYZ), None
        transform, lut = self._latest[1:]
        if isinstance(transform, LinearTransform):
            return transform
        if isinstance(transform, Closed):
            many = self._height * self._width >= LUT_PIXELS and dtype is np.uint8
            faster = self._software and many and self._lut_rejected != key.viewing
            faster = faster and not is_narrow(light.white_XYZ, colours)
            if not (faster if self._by_lut is None else self._by_lut):
                return transform
        if lut is None:
            lut = LutTransform.of(transform, LutSpace.between(light.white_XYZ, colours))
            if lut.closed is None:
                self._lookups.load_lut(self._lut_cache.texels(key))
            else:
                self._lookups.bake_lut(lut.closed, screen_for_viewing(viewing), self._draw)
            self._latest = key, transform, lut
        self._lookups.bind_lut()
        return lut

    def missing_lut(self, light: Illumination, viewing: Viewing) -> LutKey | None:
        """Return the key of a LUT to bake on the host before drawing, or None if it is cached."""
        key = LutKey.of(viewing, light.white_XYZ)
        return None if key in self._lut_cache else key

    def close(self) -> None:
        """Release all resources; a second call does nothing."""
        if self._unclosed.detach():
            self._allocation.release()
