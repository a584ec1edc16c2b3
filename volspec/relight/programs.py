"""The shaders of one engine, compiled as they are first asked for.

    uniforms (forms), screen -> [programs] -> gpu

What a form of passage and a display are made of is compiled in, so that a pixel pays for no more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from volspec._gpu.opengl import compile_program
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import assemble
from volspec.appearance import screen as screens
from volspec.appearance import table
from volspec.appearance.constants import shader_constants
from volspec.appearance.spaces import ColourSpace
from volspec.relight.uniforms import FORM_NUMBERS, screen_form

_GLSL = "330 core"
# Texture units by the names of samplers.
UNITS = {"coefficients": 0, "table": 1, "field": 2, "nodes": 3, "middles": 4}


def picture_constants(space: ColourSpace) -> dict[str, ArrayLike]:
    """The numbers of ``shaders/relight.frag`` that every picture for a display's space shares."""
    return {
        **FORM_NUMBERS,
        **shader_constants(),
        **space.shader_constants(),
        **screens.SHADER_CONSTANTS,
        **table.SHADER_CONSTANTS,
    }


class Programs:
    """Programs by what is compiled into them, each with the triangle that it draws.

    Parameters
    ----------
    context : moderngl.Context
    constants : {name: int}
        What is the same in all: LAYERS, IMAGE_HEIGHT and EVERY.
    keep : callable
        Takes a resource that its engine shall release, and gives it back.
    """

    def __init__(
        self, context: Any, constants: Mapping[str, int], keep: Callable[[Any], Any]
    ) -> None:
        self._context, self._constants, self._keep = context, constants, keep
        self._made: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    def of(self, name: str, form: Mapping[str, int], screen: screens.Screen) -> tuple[Any, Any]:
        """A program and its vertex array.

        Parameters
        ----------
        name : {"relight", "nodes", "trust"}
            Of the fragment shader.
        form : {name: int}
            As `volspec.relight.uniforms.form_of`.
        screen : Screen
            Its space's matrix and curve are compiled in, and whether it reduces or marks.

        Raises
        ------
        OpenGLError
            If the driver refuses the shader.
        """
        ends = screen_form(screen)
        key = (name, *form.values(), *ends.values(), screen.space)
        if key not in self._made:
            constants: dict[str, ArrayLike] = {
                **self._constants,
                **form,
                **ends,
                "FIRST_ROW_AT_BOTTOM": 1,
                **picture_constants(screen.space),
            }
            lines = prelude(constants, "glsl")
            vertex = assemble("shaders/fullscreen.vert", lines, glsl_version=_GLSL)
            fragment = assemble(f"shaders/{name}.frag", lines, glsl_version=_GLSL)
            program = self._keep(compile_program(self._context, vertex, fragment))
            for sampler, unit in UNITS.items():
                if sampler in program:
                    program[sampler].value = unit
            self._made[key] = program, self._keep(self._context.vertex_array(program, []))
        return self._made[key]
