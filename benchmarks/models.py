"""Cost of the appearance model per frame, against a shader that only sums channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import Figure, compare
from volspec._gpu.opengl import compile_program, headless_context
from volspec._gpu.prelude import prelude
from volspec._gpu.sources import Source, assemble, asset
from volspec.appearance.transforms import LinearTransform
from volspec.image import CoefficientImage
from volspec.relight.gpu import GLEngine
from volspec.relight.illumination import Illumination
from volspec.relight.programs import light_uniforms
from volspec.relight.spec import RelightSpec
from volspec.relight.texture_planes import layer_count, pack_layers
from volspec.scene import Scene
from volspec.spectra import light

BARE = Path(__file__).with_name("bare.frag")
ASKED = {"table": 1.8, "closed": 4.5}


def bare(image: CoefficientImage, lit: Illumination, context: Any) -> Callable[[], None]:
    """Draw ``bare.frag`` into an 8-bit texture."""
    height, width, channels = image.coefficients.shape
    lines = prelude({"LAYERS": layer_count(channels), "FIRST_ROW_AT_BOTTOM": 1}, "glsl")
    vertex = assemble("shaders/fullscreen.vert", lines, glsl_version="330 core")
    fragment = Source(f"#version 330 core\n{lines}{BARE.read_text()}", ("", BARE.name))
    program = compile_program(context, vertex, fragment)
    values = light_uniforms(lit, LinearTransform(np.eye(3)))
    program["XYZ_from_layer"].write(values["XYZ_from_layer"].tobytes())
    texture = context.texture_array((width, height, layer_count(channels)), 4, dtype="f4")
    texture.write(pack_layers(image.coefficients, image.alpha))
    target = context.framebuffer([context.texture((width, height), 4)])
    triangle = context.vertex_array(program, [])

    def draw() -> None:
        with context:
            target.use()
            texture.use(0)
            triangle.render(context.TRIANGLES, vertices=3)
            context.finish()

    return draw


def figures() -> Iterator[Figure]:
    """The demo's engine under tungsten, 512², seven channels, CIECAM02; waits for each frame."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    image = scene.render()
    context = headless_context()
    lit = Illumination.of(image.basis, light("A"), RelightSpec(), image.groups)
    with context:
        least = bare(image, lit, context)
    viewing = scene.relight.viewing
    for name, table in (("table", True), ("closed", False)):
        engine = GLEngine(image.coefficients, image.alpha, context, table)

        def draw(engine: GLEngine = engine) -> None:
            with context:
                engine.draw(lit, viewing, np.uint8)
                context.finish()

        row = compare(f"relight/{name}", "bare", engine.name, draw, least, runs=51)
        yield Figure(f"{row.name}: CIECAM02", 1 / row.ratio, ASKED[name], at_most=True, row=row)
        engine.close()
    context.release()
