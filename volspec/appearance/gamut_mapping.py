"""Display XYZ to codes: gamut mapping, simulated colour vision, hatching and encoding.

    view transform -> [screen] -> frame | shaders/include/gamut.glsl, display.glsl

Every form of view transform ends here, so all models share one gamut mapping: clipping, or lower
chroma at constant lightness and hue. Those correlates are CIECAM02's, or CAM16's if the model is
CAM16, under the display's conditions. In both a colour is three opponent signals of its compressed
responses,

    x = p2 - 0.305,    J = 100 (x / w)^cz          lightness: a function of x alone
    (a, b),            h = atan2(b, a)             hue: unchanged by (a, b) -> s (a, b), s > 0
    t = p1 r / (x + 0.305 - q r),                  chroma: C ~ t^0.9 √J, r = √(a² + b²),
                                                   q = (11 cos h + 108 sin h) / 23

so scaling (a, b) by s at constant x preserves J and h exactly, and C falls with s, because
dt/ds = p1 r p2 / (p2 - q s r)² > 0. No inverse model is needed: a few bisections of s, each two
matrix products and a power, find the point on the surface of the display's cube.

An eye not fully adapted to the display (D < 1) sees its white with some chroma (3.2 under sRGB's
conditions), and above J = 98 no colour without chroma can be shown. There, colours move towards the
display's white: grey is (x, max(x - x0, 0) (a_w, b_w) / (x_w - x0)), without chroma up to the knee
x0 and ending at the white. Up to x0 both J and h are constant; above x0, only J.

References
----------
[1] CIE 159:2004; CIE 156:2004, "Guidelines for the evaluation of gamut mapping algorithms".
[2] Morovič (2008), "Color Gamut Mapping", Wiley, chapter 10 (lightness- and hue-preserving).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import constants as k
from volspec.appearance.display.deficiency import Simulation, simulation
from volspec.appearance.display.monitors import Display
from volspec.appearance.display.spaces import ColourSpace
from volspec.appearance.models.cam import HELLWIG_2022, CamConditions, compress, expand
from volspec.appearance.spec import Viewing
from volspec.appearance.transforms import triples
from volspec.errors import ViewingError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Linear RGB this far outside of 0 to 1 counts as inside: rounding of the white, far below a 16-bit
# step (1.5e-5).
_ROUNDING = 1e-7
# The same tolerance in frames, which are then clipped: under D65 Nayatani and Guth miss the white
# by up to 2.3e-4, and software GL's powers are off by 5e-5.
GAMUT_SLACK = 2.5e-4
# Bisections: to 1e-4 of the chroma for eight bits; in `reduce_chroma`, to 2e-10.
SHADER_STEPS = 12
_STEPS = 32
# Period and width of a band, in pixels along rows and columns.
HATCH_PERIOD, HATCH_WIDTH = 8, 3
# Magenta: not a grey, and as far from saturated green as from skin.
HATCH_CODE = (0.85, 0.10, 0.60)

SHADER_CONSTANTS: Mapping[str, ArrayLike] = MappingProxyType(
    {
        "GAMUT_SLACK": GAMUT_SLACK,
        "HATCH_PERIOD": HATCH_PERIOD,
        "HATCH_WIDTH": HATCH_WIDTH,
        "HATCH_CODE": HATCH_CODE,
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class DisplayGamut:
    """A display's cube in opponent signals: the uniforms of ``gamut.glsl``."""

    conditions: CamConditions  # the display's viewing conditions
    RGB_from_XYZ: Array  # (3, 3): XYZ with Y = 100 for white -> linear RGB
    linear_from_response: Array  # (3, 3): responses as `expand` returns them -> linear RGB
    top: float  # x_w, the white's x: no lighter colour is shown
    knee: float  # x0: grey has no chroma up to here
    knee_slope: tuple[float, float]  # (a_w, b_w) / (x_w - x0)

    @classmethod
    def of(cls, conditions: CamConditions, space: ColourSpace) -> DisplayGamut:
        """Compute the grey axis of a display, under conditions with Y = 100 for its white.

        Raises ViewingError if a colour without chroma cannot be shown at any lightness.
        """
        scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
        RGB_from_XYZ = space.RGB_from_XYZ
        linear = RGB_from_XYZ @ np.linalg.inv(conditions.response_from_XYZ()) * scale
        grey = linear.sum(axis=1)
        if not grey.min() > 0.0:
            raise ViewingError(
                f"under these conditions {space.name} cannot show a colour without chroma",
                "use a white nearer the display's or D nearer 1",
                code="impossible",
                field="gamut",
            )
        white = opponent_signals(space.white_XYZ, conditions)
        # Equal responses give linear RGB proportional to `grey`; the largest channel clips first.
        compressed = k.RESPONSE_POLE / (1.0 + grey.max() ** k.RESPONSE_POWER)
        highest = min(float(k.ACHROMATIC.sum() * compressed), float(white[0]))
        low, high = 0.0, highest
        for _ in range(40):
            knee = 0.5 * (low + high)
            inside = _segment_is_inside(knee, white, linear)
            low, high = (knee, high) if inside else (low, knee)
        # Half the steepest slope possible, so that the hue of the lightest colours does not jump.
        knee = min(max(2.0 * low - float(white[0]), 0.0), (1.0 - 1e-6) * float(white[0]))
        slope = white[1:] / (white[0] - knee)
        return cls(
            conditions=conditions,
            RGB_from_XYZ=RGB_from_XYZ,
            linear_from_response=linear,
            top=float(white[0]),
            knee=knee,
            knee_slope=(float(slope[0]), float(slope[1])),
        )


def opponent_signals(XYZ: ArrayLike, conditions: CamConditions) -> Array:
    """Return the opponent signals (x, a, b) of (..., 3) XYZ, x not below 0."""
    responses = compress(triples("gamut.XYZ", XYZ) @ conditions.response_from_XYZ().T)
    x = np.maximum(responses @ k.ACHROMATIC, 0.0)
    return np.stack([x, responses @ k.OPPONENT_A, responses @ k.OPPONENT_B], axis=-1)


def _linear(signals: Array, linear_from_response: Array) -> Array:
    return expand(signals @ k.RESPONSE_FROM_OPPONENT.T) @ linear_from_response.T


def _is_inside(linear: Array, slack: float) -> Mask:
    return np.asarray(np.all((linear >= -slack) & (linear <= 1.0 + slack), axis=-1))


def _segment_is_inside(knee: float, white: Array, linear_from_response: Array) -> bool:
    t = np.linspace(0.0, 1.0, 65)[:, None]
    signals = (1.0 - t) * np.array([knee, 0.0, 0.0]) + t * white
    return bool(_is_inside(_linear(signals, linear_from_response), _ROUNDING).all())


def reduce_chroma(
    XYZ: ArrayLike, conditions: CamConditions, space: ColourSpace
) -> tuple[Array, Mask]:
    """Lower chroma at constant lightness and hue until the display can show the colour.

    J is first clamped to the white's; above the knee, J = 96.6 under sRGB's conditions, colours
    move towards the display's white (see the module). Returns XYZ, unchanged inside of the gamut,
    and a mask of the colours mapped; Y = 100 for the display's white. Errors as `DisplayGamut.of`.
    """
    colours = triples("gamut.XYZ", XYZ)
    gamut = DisplayGamut.of(conditions, space)
    mapped = ~_is_inside(colours @ gamut.RGB_from_XYZ.T, _ROUNDING)
    reduced = colours.copy()
    if mapped.any():
        x, a, b = np.moveaxis(opponent_signals(colours[mapped], conditions), -1, 0)
        linear, _ = reduce_chroma_opponent(x, a, b, gamut, steps=_STEPS)
        reduced[mapped] = linear @ space.XYZ_from_RGB.T
    return reduced, mapped


def reduce_chroma_opponent(
    achromatic: ArrayLike,
    a: ArrayLike,
    b: ArrayLike,
    gamut: DisplayGamut,
    *,
    steps: int = SHADER_STEPS,
    slack: float = _ROUNDING,
) -> tuple[Array, Mask]:
    """Lower the chroma of opponent signals (x', a', b'): the twin of ``gamut.glsl``.

        x  = clamp(x', 0, top),  (a_g, b_g) = max(x - knee, 0) knee_slope
        R0 = response_from_opponent (x, a_g, b_g)
        R1 = response_from_opponent (0, a' - a_g, b' - b_g)
        s  : the largest k / 2^steps, by bisection, for which linear(R0 + s R1) lies within 0…1
        linear(R) = linear_from_response · sign(R) (|R| / (400 - |R|))^(1/0.42)

    Colours ``slack`` outside of 0…1 count as inside; frames use `GAMUT_SLACK`. Returns linear RGB
    (..., 3) within -slack to 1 + slack, and a mask of the colours that were mapped.
    """
    inputs = np.stack(np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (achromatic, a, b))))
    signals = np.where(inputs[0] > 0.0, inputs, 0.0)
    matrix = gamut.linear_from_response
    linear = _linear(np.moveaxis(signals, 0, -1), matrix)
    mapped = ~_is_inside(linear, slack)
    x = np.minimum(signals[0], gamut.top)
    over = np.maximum(x - gamut.knee, 0.0)
    grey = np.stack([x, over * gamut.knee_slope[0], over * gamut.knee_slope[1]], axis=-1)
    ray = np.stack([x, signals[1], signals[2]], axis=-1) - grey
    R0, R1 = grey @ k.RESPONSE_FROM_OPPONENT.T, ray @ k.RESPONSE_FROM_OPPONENT.T
    s, step = np.zeros(x.shape), 0.5
    for _ in range(steps):
        tried = expand(R0 + (s + step)[..., None] * R1) @ matrix.T
        s = np.where(_is_inside(tried, slack), s + step, s)
        step *= 0.5
    reduced = expand(R0 + s[..., None] * R1) @ matrix.T
    return np.where(mapped[..., None], reduced, linear), mapped


@dataclass(frozen=True, slots=True, eq=False)
class DisplayOutput:
    """The last stage of a frame: gamut mapping, simulation, encoding and hatching."""

    space: ColourSpace
    RGB_from_XYZ: Array
    gamut: DisplayGamut | None  # reduces chroma; None clips
    mark: bool  # hatch the pixels with colours outside of the gamut
    simulation: Simulation | None = None  # of a colour-vision deficiency

    @classmethod
    def of(
        cls,
        display: Display,
        model: str = "CIECAM02",
        deficiency: str = "none",
        severity: float = 1.0,
    ) -> DisplayOutput:
        """Make the screen of a display, with the lightness and hue of `gamut_model`.

        Errors as `DisplayGamut.of`, if the display reduces chroma.
        """
        space = display.colours
        gamut = None
        if display.gamut == "reduce":
            eye = CamConditions.of_viewing(display.conditions, gamut_model(model))
            gamut = DisplayGamut.of(eye, space)
        simulated = simulation(deficiency, severity, space)
        return cls(space, space.RGB_from_XYZ, gamut, display.mark, simulated)

    def linear(self, XYZ: ArrayLike) -> tuple[Array, Mask]:
        """Return linear RGB, not clipped, and a mask of the colours out of gamut.

        Y = 100 for the display's white; chroma is reduced if the screen has a gamut.
        """
        colours = triples("screen.XYZ", XYZ)
        linear = colours @ self.RGB_from_XYZ.T
        outside = np.any((linear < -GAMUT_SLACK) | (linear > 1.0 + GAMUT_SLACK), axis=-1)
        if self.gamut is not None and outside.any():
            x, a, b = opponent_signals(colours[outside], self.gamut.conditions).T
            linear[outside], _ = reduce_chroma_opponent(x, a, b, self.gamut, slack=GAMUT_SLACK)
        return linear, np.asarray(outside)

    def codes(self, XYZ: ArrayLike, first_row: int = 0) -> Array:
        """Return the codes, 0 to 1, of rows of a picture (H, W, 3).

        ``first_row`` is the first row's index in the picture; the hatch depends on it.
        """
        linear, outside = self.linear(XYZ)
        linear = np.clip(linear, 0.0, 1.0)
        if self.simulation is not None:
            linear = np.clip(self.simulation.apply(linear), 0.0, 1.0)
        codes = self.space.encode(linear)
        return hatch(codes, outside, first_row) if self.mark else codes


def hatch(codes: Array, outside: ArrayLike, first_row: int = 0) -> Array:
    """Hatch the pixels of a mask (H, W): diagonal bands on each pixel's grey level."""
    height, width = codes.shape[:2]
    diagonal = (np.arange(height) + first_row)[:, None] + np.arange(width)
    band = diagonal % HATCH_PERIOD < HATCH_WIDTH
    grey = codes.mean(axis=-1, keepdims=True)
    hatched = np.where(band[..., None], HATCH_CODE, grey)
    return np.where(np.asarray(outside)[..., None], hatched, codes)


def gamut_model(model: str) -> str:
    """Return CAM16 for a model with its lightness and hue, else CIECAM02."""
    return "CAM16" if model in ("CAM16", HELLWIG_2022) else "CIECAM02"


@lru_cache(maxsize=16)
def _cached_screen(display: Display, model: str, deficiency: str, severity: float) -> DisplayOutput:
    return DisplayOutput.of(display, model, deficiency, severity)


def screen_for_viewing(viewing: Viewing) -> DisplayOutput:
    """Return the screen of a viewing's display; the latest 16 are cached. Errors as `Screen.of`."""
    model = gamut_model(viewing.model)
    return _cached_screen(viewing.display, model, viewing.deficiency, viewing.severity)
