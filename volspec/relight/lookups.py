"""What pixels look up on the device: an appearance table, and a field of passages.

passage, field -> [lookups] -> gpu -> shaders/include/table.glsl, cam.glsl
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from volspec.appearance.field import PassageField
from volspec.appearance.passages import Passage
from volspec.appearance.screen import Screen
from volspec.appearance.table import NODES, TablePassage, TableSpace
from volspec.relight.uniforms import CLOSED_FORMS, form_of, node_uniforms

TABLE_UNIT, FIELD_UNIT = 1, 2


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
        self._nodes: tuple[Any, Any] | None = None

    def load(self, field: PassageField) -> None:
        """Upload a field and bind it."""
        texels = field.texels()
        size = texels.shape[2], texels.shape[1], texels.shape[0]
        if self._field is None or self._field.size != size:
            self._field = self._keep(self._context.texture_array(size, 4, dtype="f4"))
            self._field.filter = self._context.LINEAR, self._context.LINEAR
            self._field.repeat_x = self._field.repeat_y = False
        self._field.write(texels)
        self._field.use(FIELD_UNIT)

    def use_table(self) -> None:
        """Bind the table."""
        self._table.use(TABLE_UNIT)

    def fill(
        self, passage: Passage, space: TableSpace, screen: Screen, draw: Callable[..., None]
    ) -> None:
        """Put a passage into the table: on the device where it has a closed form.

        Parameters
        ----------
        passage : Passage
        space : TableSpace
        screen : Screen
        draw : callable
            The engine's: (name of the fragment shader, form, uniforms, screen).
        """
        if self._table is None:
            self._table = self._keep(self._context.texture3d((NODES,) * 3, 4, dtype="f4"))
            self._table.filter = self._context.LINEAR, self._context.LINEAR
            self._table.repeat_x = self._table.repeat_y = self._table.repeat_z = False
        if not isinstance(passage, CLOSED_FORMS):
            texels = np.ones((NODES, NODES, NODES, 4), np.float32)
            texels[..., :3] = TablePassage.of(passage, space).codes
            self._table.write(texels)
            return
        if self._nodes is None:
            texture = self._keep(self._context.texture((NODES, NODES * NODES), 4, dtype="f4"))
            buffer = self._keep(self._context.buffer(reserve=16 * NODES**3))
            self._nodes = self._keep(self._context.framebuffer([texture])), buffer
        nodes, buffer = self._nodes
        nodes.use()
        draw("nodes", form_of(passage), node_uniforms(passage, space, screen), screen)
        nodes.read_into(buffer, components=4, dtype="f4")
        self._table.write(buffer)
