"""Relight on the GPU: one full-screen triangle per light change (shaders/relight.frag).

    illumination -> [gpu] -> frame

The coefficients are uploaded once. A light change sends three numbers a channel and draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opengl import (
    ContextLost,
    describe,
    egl_handle,
    give_back_context,
    lend_context,
    made_current,
)
from volspec._gpu.sharing import Sharing, context_name, current
from volspec.appearance.field import PassageField
from volspec.appearance.live import passage_of
from volspec.appearance.models.conditions import CamPassage
from volspec.appearance.passages import LinearPassage, Passage
from volspec.appearance.screen import Screen, screen_of
from volspec.appearance.spec import Viewing
from volspec.appearance.table import TableSpace, is_narrow
from volspec.errors import OpenCLError, OpenGLError, ShapeError
from volspec.relight.illumination import Illumination
from volspec.relight.lookups import Lookups
from volspec.relight.packed import PackedLayers, layer_count, pack_layers
from volspec.relight.programs import UNITS, Programs
from volspec.relight.shared import SharedLayers
from volspec.relight.spec import Pixels
from volspec.relight.tables import HostTables, TableKey
from volspec.relight.uniforms import (
    FORMS,
    Closed,
    Drawn,
    Tabled,
    Uniforms,
    form_of,
    light_uniforms,
    passage_uniforms,
    screen_uniforms,
)

if TYPE_CHECKING:
    import moderngl

# x, y, width and height of pixels, from the picture's first row.
Box = tuple[int, int, int, int]
# Components of textures.
_COMPONENTS: dict[type, str] = {np.uint8: "f1", np.float32: "f4"}
# Renderers that draw on the CPU.
SOFTWARE = ("llvmpipe", "softpipe", "SwiftShader")
# Pixels from which a table pays there although it must be filled for the frame: 1024² gain 5 to
# 10 %, 2048² a quarter, read back; while the light stays a third.
TABLE_PIXELS = 2**20
# Components of uniforms: a mat4x3 takes four vectors of four, and this much is for all the others.
_COMPONENTS_PER_LAYER, _OTHER_COMPONENTS = 16, 64


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
    table : bool, optional
        Look passages up in a table, also those that have a closed form; None where it is quicker.
    tables : HostTables, optional
        Where those that the host works out are kept; None makes one.
    packed : PackedLayers, optional
        Coefficients and alpha, packed beforehand.

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
        table: bool | None = None,
        tables: HostTables | None = None,
        packed: PackedLayers | None = None,
    ) -> None:
        self._owned = context is None
        if context is None:
            self._context, self._handle = lend_context()
        else:
            self._context = context
            with context:
                self._handle = egl_handle()
        self._resources: list[Any] = []
        # The last viewing and white, their passage, and its table's space once that is filled.
        self._passed: tuple[TableKey, Passage, Tabled | None] | None = None
        self._by_table = table
        self._tables = HostTables() if tables is None else tables
        # The viewing under which the picture has colours that its table does not hold.
        self._doubted: Viewing | None = None
        self._targets: dict[str, Any] = {}
        self._shared: Any = None
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
        """Make what every frame needs, so that a driver's refusal shows here."""
        import moderngl

        device = describe(self._context)
        self.name = str(device["device"])
        self._software = any(word in self.name for word in SOFTWARE)
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
        form = {"FORM": FORMS[CamPassage], "SAME_SURROUND": 1, "OUTER": 0, "FIELD": 0, "CHECKED": 0}
        # The height is for canvases: without it all sizes share one source, and the driver's cache.
        constants = {"LAYERS": layer_count(self._channels), "IMAGE_HEIGHT": 0, "EVERY": 1}
        self._programs = Programs(self._context, constants, self._keep)
        self._lookups = Lookups(self._context, self._keep)
        self._counted = self._context.query(samples=True)
        self._programs.of("relight", form, screen_of(Viewing()))

    def _keep(self, resource: Any) -> Any:
        self._resources.append(resource)
        return resource

    def _current(self) -> AbstractContextManager[None]:
        return made_current(self._context, self._handle)

    def upload(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Take another image of the first one's shape; (H, W, L·M) and (H, W)."""
        self.take(PackedLayers(pack_layers(coefficients, alpha)))

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
                    f"{context_name(self._context, here)}; give both the same context"
                )
            if self._shared is None:
                size = 16 * layer_count(self._channels) * self._height * self._width
                self._shared = self._keep(self._context.buffer(reserve=size, dynamic=True))
        return SharedLayers(sharing, self._shared, (self._height, self._width, self._channels))

    def take(self, layers: SharedLayers | PackedLayers) -> None:
        """Draw what a finished cast has put there, or what was packed of one."""
        texels = layers.layers if isinstance(layers, PackedLayers) else layers.buffer
        with self._current():
            self._texture.write(texels)
        self._doubted = None

    def _draw(self, name: str, form: Mapping[str, int], values: Uniforms, screen: Screen) -> None:
        program, triangle = self._programs.of(name, form, screen)
        for uniform, value in values.items():
            program[uniform].write(value.tobytes())
        # An owner's context may come with blending or a depth test switched on.
        self._context.enable_only(self._context.NOTHING)
        triangle.render(self._context.TRIANGLES, vertices=3)

    def _target(self, dtype: str) -> moderngl.Framebuffer:
        if dtype not in self._targets:
            size = (self._width, self._height)
            colour = self._keep(self._context.texture(size, 4, dtype=dtype))
            self._targets[dtype] = self._keep(self._context.framebuffer([colour]))
        return self._targets[dtype]

    def render(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        field: PassageField | None = None,
    ) -> Pixels:
        """(H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding.

        A ``field`` of passages over the picture is drawn in place of the viewing's one.

        Raises
        ------
        ShapeError, ContextLost
            As `draw`.
        """
        with self._current():
            target = self._framed(light, viewing, dtype, field)
            # The driver drops alpha while copying, five times faster than NumPy would.
            pixels = np.empty((self._height, self._width, 3), dtype=dtype)
            target.read_into(pixels, components=3, dtype=_COMPONENTS[dtype])
        return pixels

    def draw(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        field: PassageField | None = None,
        within: Box | None = None,
    ) -> moderngl.Framebuffer:
        """Draw a frame, which stays on the device; in its context.

        Pixels that are not within a box stay as they were.

        Raises
        ------
        ShapeError
            If the light is for another number of channels.
        ContextLost
            If another library ended the context.
        """
        with self._current():
            return self._framed(light, viewing, dtype, field, within)

    def _framed(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        field: PassageField | None,
        within: Box | None = None,
    ) -> moderngl.Framebuffer:
        channels = light.XYZ_from_channels.shape[1]
        if channels != self._channels:
            raise ShapeError(
                f"relight: the light has {channels} channels, the image {self._channels}; "
                "were both made with the same basis and light groups?"
            )
        screen = screen_of(viewing)
        drawn: Drawn
        if field is None:
            drawn = self._drawn(viewing, light, dtype)
        else:
            drawn = field
            self._lookups.load(field)
        # By moderngl's stubs a scissor cannot be taken off again.
        target: Any = self._target(_COMPONENTS[dtype])
        target.scissor = within
        target.use()
        self._texture.use(UNITS["coefficients"])
        width, height = within[2:] if within else target.size
        if isinstance(drawn, Tabled) and drawn.behind is not None:
            with self._counted:
                self._relight(light, drawn, screen)
            if self._counted.samples != width * height:
                # Some pixel's colour is not in the table: this picture is not one for it.
                self._doubted = TableKey.of(light, viewing).viewing
                self._relight(light, self._closed, screen)
        else:
            self._relight(light, drawn, screen)
        target.scissor = None
        return cast("moderngl.Framebuffer", target)

    @property
    def _closed(self) -> Closed:
        """What the table was filled with."""
        assert self._passed is not None and isinstance(self._passed[1], Closed)
        return self._passed[1]

    def _relight(self, light: Illumination, drawn: Drawn, screen: Screen) -> None:
        values = light_uniforms(light, drawn) | passage_uniforms(drawn, screen)
        self._draw("relight", form_of(drawn), values | screen_uniforms(screen), screen)

    def _drawn(
        self, viewing: Viewing, light: Illumination, dtype: type[np.uint8] | type[np.float32]
    ) -> Drawn:
        """The passage itself, or the space of the table that it has been put into.

        A table is for what has no closed form. On software GL it is also the quicker way where a
        picture has many more pixels than the table nodes; frames of floats, which are measured,
        those under narrow lights, and pictures with colours that no table holds stay exact.
        """
        key = TableKey.of(light, viewing)
        colours = key.viewing.display.colours
        if self._passed is None or self._passed[0] != key:
            self._passed = key, passage_of(key.viewing, light.white_XYZ), None
        passage, tabled = self._passed[1:]
        if isinstance(passage, LinearPassage):
            return passage
        if isinstance(passage, Closed):
            many = self._height * self._width >= TABLE_PIXELS and dtype is np.uint8
            quicker = self._software and many and self._doubted != key.viewing
            quicker = quicker and not is_narrow(light.white_XYZ, colours)
            if not (quicker if self._by_table is None else self._by_table):
                return passage
        if tabled is None:
            tabled = Tabled.of(passage, TableSpace.between(light.white_XYZ, colours))
            if tabled.behind is None:
                self._lookups.write(self._tables.texels(key))
            else:
                self._lookups.fill(tabled.behind, screen_of(viewing), self._draw)
            self._passed = key, passage, tabled
        self._lookups.use_table()
        return tabled

    def missing_table(self, light: Illumination, viewing: Viewing) -> TableKey | None:
        """Of a model that `is_tabled`: the table that is not there yet, or None."""
        key = TableKey.of(light, viewing)
        return None if key in self._tables else key

    def close(self) -> None:
        """Release everything made here; a second call does nothing."""
        try:
            with self._current():
                for resource in reversed(self._resources):
                    resource.release()
        except ContextLost:
            pass  # gone with the context; the names now mean another library's objects
        else:
            if self._owned:
                give_back_context(self._context, self._handle)
        self._resources.clear()
        self._owned = False
