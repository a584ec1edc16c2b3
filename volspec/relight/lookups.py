"""What pixels look up on the device: an appearance table, and a field of passages.

tables, passage, field -> [lookups] -> gpu -> shaders/include/table.glsl, cam.glsl
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.field import PassageField
from volspec.appearance.screen import Screen
from volspec.appearance.table import NODES
from volspec.relight.programs import UNITS
from volspec.relight.uniforms import Closed, form_of, node_uniforms


class Lookups:
    """One engine's table and field, made when they are first asked for.

    Parameters
    ----------
    context : moderngl.Context
    keep : callable
        Takes a resource that the engine shall release, and gives it back.
    """

    def __init__(self, context: Any, keep: Callable[[Any], Any]) -> None:
        self._context, self._keep = context, keep
        self._table: Any = None
        self._field: Any = None
        self._filled: list[Any] = []
        self._buffer: Any = None

    def load(self, field: PassageField) -> None:
        """Upload a field and bind it."""
        texels = field.texels()
        size = texels.shape[2], texels.shape[1], texels.shape[0]
        if self._field is None or self._field.size != size:
            self._field = self._keep(self._context.texture_array(size, 4, dtype="f4"))
            self._field.filter = self._context.LINEAR, self._context.LINEAR
            self._field.repeat_x = self._field.repeat_y = False
        self._field.write(texels)
        self._field.use(UNITS["field"])

    def use_table(self) -> None:
        """Bind the table."""
        self._table.use(UNITS["table"])

    def write(self, texels: NDArray[np.float32]) -> None:
        """Put a table into the texture that the host has worked out (`HostTables.texels`)."""
        self._texture().write(texels)

    def fill(self, behind: Closed, screen: Screen, draw: Callable[..., None]) -> None:
        """Work a passage's table out on the device.

        Parameters
        ----------
        behind : CurvePassage or CamPassage
            From adapted linear RGB on.
        screen : Screen
        draw : callable
            The engine's: (name of the fragment shader, form, uniforms, screen).
        """
        nodes, middles, trusted = self._framebuffers()
        form = form_of(behind)
        for target, offset in ((nodes, 0.0), (middles, 0.5)):
            target.use()
            draw("nodes", form, node_uniforms(behind, offset, screen), screen)
        trusted.use()
        nodes.color_attachments[0].use(UNITS["nodes"])
        middles.color_attachments[0].use(UNITS["middles"])
        draw("trust", form, {}, screen)
        trusted.read_into(self._buffer, components=4, dtype="f4")
        self._texture().write(self._buffer)

    def _texture(self) -> Any:
        if self._table is None:
            self._table = self._keep(self._context.texture3d((NODES,) * 3, 4, dtype="f4"))
            self._table.filter = self._context.LINEAR, self._context.LINEAR
            self._table.repeat_x = self._table.repeat_y = self._table.repeat_z = False
        return self._table

    def _framebuffers(self) -> list[Any]:
        """One for the nodes, one for the cells' middles, one for both judged."""
        if not self._filled:
            size = (NODES, NODES * NODES)
            textures = [self._keep(self._context.texture(size, 4, dtype="f4")) for _ in range(3)]
            self._filled = [self._keep(self._context.framebuffer([t])) for t in textures]
            self._buffer = self._keep(self._context.buffer(reserve=16 * NODES**3))
        return self._filled
