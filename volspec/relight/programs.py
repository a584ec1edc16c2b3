"""Shader programs of one engine, their uniforms and their lookup textures.

    illumination, view transform, screen -> [programs] -> gpu -> shaders/relight.frag

The forms of the view transform and the display are compiled in, so that pixels pay only for what
they use; programs are compiled at first use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._gpu import assemble, compile_program, prelude
from volspec.appearance import (
    NODES,
    SHADER_STEPS,
    CurveTransform,
    DisplayGamut,
    DisplayOutput,
    LinearTransform,
    LutSpace,
    ViewTransform,
    ViewTransformGrid,
    gamut_mapping,
    lut3d,
)
from volspec.appearance.display import ColourSpace, Simulation, shader_constants
from volspec.appearance.models import CamTransform
from volspec.relight.illumination import Illumination
from volspec.relight.texture_planes import layer_count

_GLSL = "330 core"
# Texture units by sampler name.
UNITS = {"coefficients": 0, "lut": 1, "field": 2, "nodes": 3, "centres": 4}
# The shader's constants for the forms of a view transform.
FORM_NUMBERS = {"LINEAR": 0, "CURVE": 1, "CAM": 2, "LUT": 3}
# Forms that the shader can evaluate per colour, and bake into a LUT.
Closed = CurveTransform | CamTransform
Uniforms = dict[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class LutTransform:
    """A view transform that is looked up in a LUT."""

    space: LutSpace
    closed: Closed | None  # the closed form, from adapted linear RGB, to bake

    @classmethod
    def of(cls, transform: ViewTransform, space: LutSpace) -> LutTransform:
        """Make the lookup of a transform from a scene's XYZ, in the LUT's ``space``."""
        if not isinstance(transform, Closed):
            return cls(space, None)
        XYZ_from_adapted = np.linalg.inv(space.adapted_from_XYZ)
        first = transform.response_from_XYZ @ XYZ_from_adapted
        return cls(space, replace(transform, response_from_XYZ=first))


DrawnTransform = LinearTransform | Closed | LutTransform | ViewTransformGrid
FORMS: dict[type, int] = dict(
    zip(
        (LinearTransform, CurveTransform, CamTransform, LutTransform),
        FORM_NUMBERS.values(),
        strict=True,
    )
)
FORMS[ViewTransformGrid] = FORMS[CamTransform]


def shader_form(transform: DrawnTransform) -> dict[str, int]:
    """Return the constants that select a view transform's form in ``shaders/relight.frag``."""
    if isinstance(transform, LutTransform):
        checked = int(transform.closed is not None)
        linear = shader_form(LinearTransform(np.eye(3)))
        return linear | {"FORM": FORMS[LutTransform], "CHECKED": checked}
    cam = transform.transform if isinstance(transform, ViewTransformGrid) else transform
    proportional = isinstance(cam, CamTransform) and cam.is_proportional
    same = isinstance(transform, CamTransform) and all(
        bool(np.all(np.abs(np.asarray(value) - 1.0) < 1e-7))
        for value in (transform.lightness_power, transform.chroma_gain)
    )
    outer = isinstance(transform, CurveTransform) and bool(np.any(transform.outer != 1))
    form = {"FORM": FORMS[type(transform)], "SAME_SURROUND": int(same), "OUTER": int(outer)}
    form["PROPORTIONAL"] = int(proportional)
    return form | {"FIELD": int(isinstance(transform, ViewTransformGrid)), "CHECKED": 0}


def light_uniforms(light: Illumination, transform: DrawnTransform) -> Uniforms:
    """Return the uniforms of a light by GLSL name: flat float32 arrays, matrices column by column.

    The transform's first matrix is multiplied in here, so it costs pixels nothing.
    """
    channels = light.XYZ_from_channels.shape[1]
    columns = np.zeros((layer_count(channels) * 4, 3))
    columns[:channels] = light.XYZ_from_channels.T
    # Alpha subtracts the backdrop: (1 - alpha) XYZ_backdrop without a branch.
    columns[channels] = -light.backdrop_XYZ
    first = np.eye(3)
    if isinstance(transform, LinearTransform):
        first = transform.matrix
    elif isinstance(transform, LutTransform):
        first = transform.space.adapted_from_XYZ
    return _flat({"XYZ_from_layer": columns @ first.T, "backdrop_XYZ": first @ light.backdrop_XYZ})


def transform_uniforms(transform: DrawnTransform, target: DisplayOutput) -> Uniforms:
    """Return the uniforms ``view_transform.*`` of a view transform, as far as its form has them."""
    if isinstance(transform, LinearTransform | LutTransform):
        return {}
    form = shader_form(transform)
    if isinstance(transform, ViewTransformGrid):  # the scene's side is in the texture
        transform = transform.transform
    values: dict[str, ArrayLike] = {
        "linear_from_response": (target.RGB_from_XYZ @ transform.XYZ_from_response).T
    }
    if not form["FIELD"]:
        values["response_from_XYZ"] = transform.response_from_XYZ.T
    if isinstance(transform, CurveTransform):
        names = ["gain", "power", "shift", "offset", *(["outer"] if form["OUTER"] else [])]
    else:
        names = ["display_achromatic"]
        if not form["FIELD"]:
            names += ["scene_achromatic"]
            names += [] if form["SAME_SURROUND"] else ["lightness_power", "chroma_gain"]
    values |= {name: getattr(transform, name) for name in names}
    return _flat({f"view_transform.{name}": value for name, value in values.items()})


def screen_form(target: DisplayOutput) -> dict[str, int]:
    """Return the constants with which ``gamut.glsl`` and ``display.glsl`` are compiled."""
    reduce, simulate = target.gamut is not None, target.simulation is not None
    return {"REDUCE": int(reduce), "MARK": int(target.mark), "SIMULATE": int(simulate)}


def screen_uniforms(target: DisplayOutput) -> Uniforms:
    """Return a display's uniforms: ``gamut.*`` and ``deficiency.*``, as far as it needs them."""
    return _gamut_uniforms(target.gamut) | _deficiency_uniforms(target.simulation)


def _deficiency_uniforms(simulation: Simulation | None) -> Uniforms:
    if simulation is None:
        return {}
    above, below = simulation.above.T, simulation.below.T
    values = {"above": above, "below": below, "plane": simulation.plane}
    return _flat({f"deficiency.{name}": value for name, value in values.items()})


def _gamut_uniforms(gamut: DisplayGamut | None) -> Uniforms:
    if gamut is None:
        return {}
    # XYZ cancel out: the shader starts from the display's linear RGB.
    response_from_linear = gamut.conditions.response_from_XYZ() @ np.linalg.inv(gamut.RGB_from_XYZ)
    return _flat(
        {
            "gamut.response_from_linear": response_from_linear.T,
            "gamut.linear_from_response": gamut.linear_from_response.T,
            "gamut.top": gamut.top,
            "gamut.knee": gamut.knee,
            "gamut.knee_slope": gamut.knee_slope,
            "gamut.last_step": 0.5**SHADER_STEPS,
        }
    )


def _flat(values: Mapping[str, ArrayLike]) -> Uniforms:
    return {name: np.asarray(v, dtype=np.float32).ravel() for name, v in values.items()}


def picture_constants(space: ColourSpace) -> dict[str, ArrayLike]:
    """Return the constants of ``shaders/relight.frag`` that all pictures in a space share."""
    return {
        **FORM_NUMBERS,
        **shader_constants(),
        **space.shader_constants(),
        **gamut_mapping.SHADER_CONSTANTS,
        **lut3d.SHADER_CONSTANTS,
    }


class Programs:
    """Programs by the constants compiled into them, each with the triangle that it draws.

    ``constants`` are common to all: LAYERS, IMAGE_HEIGHT, EVERY and EXACT_SAMPLER. ``track``
    registers a resource for the engine to release, and returns the resource.
    """

    def __init__(
        self, context: Any, constants: Mapping[str, int], track: Callable[[Any], Any]
    ) -> None:
        self._context, self._constants, self._track = context, constants, track
        self._compiled: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    def program(self, name: str, form: Mapping[str, int], target: DisplayOutput) -> tuple[Any, Any]:
        """Return a fragment shader's program and its vertex array; compile it at first use.

        ``form`` is from `shader_form`. The target's matrix, curve, gamut mapping and marking are
        compiled in. Raises OpenGLError if the driver refuses the shader.
        """
        ends = screen_form(target)
        key = (name, *form.values(), *ends.values(), target.space)
        if key not in self._compiled:
            constants: dict[str, ArrayLike] = {
                **self._constants,
                **form,
                **ends,
                "FIRST_ROW_AT_BOTTOM": 1,
                **picture_constants(target.space),
            }
            lines = prelude(constants, "glsl")
            vertex = assemble("shaders/fullscreen.vert", lines, glsl_version=_GLSL)
            fragment = assemble(f"shaders/{name}.frag", lines, glsl_version=_GLSL)
            program = self._track(compile_program(self._context, vertex, fragment))
            for sampler, unit in UNITS.items():
                if sampler in program:
                    program[sampler].value = unit
            self._compiled[key] = program, self._track(self._context.vertex_array(program, []))
        return self._compiled[key]


class LookupTextures:
    """One engine's textures for a LUT and a transform grid, made at first use; see `Programs`."""

    def __init__(self, context: Any, track: Callable[[Any], Any]) -> None:
        self._context, self._track = context, track
        self._lut: Any = None
        self._grid: Any = None
        self._framebuffers: list[Any] = []
        self._buffer: Any = None

    def load_grid(self, grid: ViewTransformGrid) -> None:
        """Upload a grid and bind it."""
        texels = grid.texels()
        size = texels.shape[2], texels.shape[1], texels.shape[0]
        if self._grid is None or self._grid.size != size:
            self._grid = self._track(self._context.texture_array(size, 4, dtype="f4"))
            self._grid.filter = self._context.LINEAR, self._context.LINEAR
            self._grid.repeat_x = self._grid.repeat_y = False
        self._grid.write(texels)
        self._grid.use(UNITS["field"])

    def bind_lut(self) -> None:
        """Bind the LUT."""
        self._lut.use(UNITS["lut"])

    def load_lut(self, texels: NDArray[np.float32]) -> None:
        """Upload a LUT that was baked on the host (`LutCache.texels`)."""
        self._lut_texture().write(texels)

    def bake_lut(self, closed: Closed, target: DisplayOutput, draw: Callable[..., None]) -> None:
        """Bake the LUT of a transform, from adapted linear RGB, on the device.

        ``draw`` is the engine's: (name of the fragment shader, form, uniforms, screen).
        """
        nodes, centres, checked = self._bake_targets()
        form = shader_form(closed)
        uniforms = transform_uniforms(closed, target)
        for framebuffer, offset in ((nodes, 0.0), (centres, 0.5)):
            framebuffer.use()
            draw("bake_lut3d", form, uniforms | _flat({"offset": offset}), target)
        checked.use()
        nodes.color_attachments[0].use(UNITS["nodes"])
        centres.color_attachments[0].use(UNITS["centres"])
        draw("check_lut3d", form, {}, target)
        checked.read_into(self._buffer, components=4, dtype="f4")
        self._lut_texture().write(self._buffer)

    def _lut_texture(self) -> Any:
        if self._lut is None:
            self._lut = self._track(self._context.texture3d((NODES,) * 3, 4, dtype="f4"))
            self._lut.filter = self._context.LINEAR, self._context.LINEAR
            self._lut.repeat_x = self._lut.repeat_y = self._lut.repeat_z = False
        return self._lut

    def _bake_targets(self) -> list[Any]:
        """Return framebuffers for the nodes, for the cells' centres, and for their comparison."""
        if not self._framebuffers:
            size = (NODES, NODES * NODES)
            textures = [self._track(self._context.texture(size, 4, dtype="f4")) for _ in range(3)]
            self._framebuffers = [self._track(self._context.framebuffer([t])) for t in textures]
            self._buffer = self._track(self._context.buffer(reserve=16 * NODES**3))
        return self._framebuffers
