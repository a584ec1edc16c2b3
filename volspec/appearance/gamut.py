"""What becomes of colours that a display cannot show: clipped, or paled at equal lightness.

    appearance -> [gamut] -> encode

In CIECAM02 and CAM16 a colour is three opponent signals of its compressed responses,

    x = p2 - 0.305,    J = 100 (x / w)^cz          lightness: a function of x alone
    (a, b),            h = atan2(b, a)             hue: unchanged by (a, b) -> s (a, b), s > 0
    t = p1 r / (x + 0.305 - q r),                  chroma: C ~ t^0.9 √J, r = √(a² + b²),
                                                   q = (11 cos h + 108 sin h) / 23

so that scaling (a, b) by s at constant x keeps J and h exactly, and C falls with s, as
dt/ds = p1 r p2 / (p2 - q s r)² > 0. No inverse model is needed: a few halvings of s, each a product
of two matrices and a power, find where the colour enters the display's cube.

Where the eye is not wholly adapted to the display (D < 1), its white has some chroma (3.2 at sRGB's
conditions), and above J = 98 no colour without chroma can be shown. There, colours pale towards the
display's own white: the grey they move to is (x, max(x - x0, 0) (a_w, b_w) / (x_w - x0)), free of
chroma up to the knee x0 and ending in the white. Up to x0 both J and h are kept, above it J.

References
----------
[1] CIE 159:2004; CIE 156:2004, "Guidelines for the evaluation of gamut mapping algorithms".
[2] Morovič (2008), "Color Gamut Mapping", Wiley, chapter 10 (lightness- and hue-preserving).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance.models.conditions import Conditions, compress, expand
from volspec.appearance.passages import triples
from volspec.appearance.spaces import ColourSpace
from volspec.errors import ViewingError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# So far outside of 0 to 1 is inside: the white's own rounding, far below a 16-bit step (1.5e-5).
SLACK = 1e-7
# Halvings that leave 1e-4 of the chroma, for eight bits; the host leaves 2e-10.
SHADER_STEPS = 12
_STEPS = 32


@dataclass(frozen=True, slots=True, eq=False)
class DisplayGamut:
    """A display's cube as opponent signals see it: the uniforms of a shader.

    Examples
    --------
    >>> from volspec.appearance import Display
    >>> from volspec.appearance.spaces import SPACES
    >>> seen = Conditions.of_viewing(Display().conditions)
    >>> round(DisplayGamut.of(seen, SPACES["sRGB"]).knee_J, 1)
    96.6
    """

    conditions: Conditions
    """How the display is seen."""
    RGB_from_XYZ: Array
    """(3, 3): XYZ with Y = 100 for white -> linear RGB."""
    linear_from_response: Array
    """(3, 3): responses as `expand` gives them -> linear RGB."""
    top: float
    """x_w, the white's x: no lighter colour is shown."""
    knee: float
    """x0: up to here grey has no chroma."""
    knee_slope: tuple[float, float]
    """(a_w, b_w) / (x_w - x0)."""

    @classmethod
    def of(cls, conditions: Conditions, space: ColourSpace) -> DisplayGamut:
        """Work out the grey axis of a display.

        Parameters
        ----------
        conditions : Conditions
            CIECAM02's or CAM16's; Y = 100 for the display's white.
        space : ColourSpace

        Raises
        ------
        ViewingError
            If a colour without chroma cannot be shown at any lightness.
        """
        scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
        RGB_from_XYZ = space.RGB_from_XYZ
        linear = RGB_from_XYZ @ np.linalg.inv(conditions.response_from_XYZ()) * scale
        grey = linear.sum(axis=1)
        if not grey.min() > 0.0:
            raise ViewingError(
                f"gamut: under these conditions {space.name} cannot show a colour without chroma; "
                "use a white nearer the display's or D nearer 1"
            )
        white = opponents(space.white_XYZ, conditions)
        # Equal responses of size r give linear RGB in proportion to `grey`: the first to reach 1.
        compressed = k.RESPONSE_POLE / (1.0 + grey.max() ** k.RESPONSE_POWER)
        highest = min(float(k.ACHROMATIC.sum() * compressed), float(white[0]))
        low, high = 0.0, highest
        for _ in range(40):
            knee = 0.5 * (low + high)
            inside = _segment_is_inside(knee, white, linear)
            low, high = (knee, high) if inside else (low, knee)
        # Half as steep as can be, so that what is lightest does not change its hue at once.
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

    @property
    def knee_J(self) -> float:
        """The lightness up to which hue is kept."""
        seen = self.conditions
        return float(100.0 * (self.knee / seen.white_achromatic) ** seen.lightness_power)


def opponents(XYZ: ArrayLike, conditions: Conditions) -> Array:
    """(..., 3) XYZ to the opponent signals (x, a, b), x not below 0."""
    responses = compress(triples("gamut: XYZ", XYZ) @ conditions.response_from_XYZ().T)
    x = np.maximum(responses @ k.ACHROMATIC, 0.0)
    return np.stack([x, responses @ k.OPPONENT_A, responses @ k.OPPONENT_B], axis=-1)


def _linear(signals: Array, linear_from_response: Array) -> Array:
    return expand(signals @ k.RESPONSE_FROM_OPPONENT.T) @ linear_from_response.T


def _inside(linear: Array, slack: float) -> Mask:
    return np.asarray(np.all((linear >= -slack) & (linear <= 1.0 + slack), axis=-1))


def _segment_is_inside(knee: float, white: Array, linear_from_response: Array) -> bool:
    share = np.linspace(0.0, 1.0, 65)[:, None]
    signals = (1.0 - share) * np.array([knee, 0.0, 0.0]) + share * white
    return bool(_inside(_linear(signals, linear_from_response), SLACK).all())


def clip(XYZ: ArrayLike, space: ColourSpace) -> tuple[Array, Mask]:
    """Cut linear RGB to 0…1 channel by channel, as `reduce_chroma` gives it; keeps nothing else."""
    given = triples("gamut: XYZ", XYZ)
    linear = given @ space.RGB_from_XYZ.T
    mapped = ~_inside(linear, SLACK)
    shown = np.clip(linear, 0.0, 1.0) @ space.XYZ_from_RGB.T
    return np.where(mapped[..., None], shown, given), mapped


def reduce_chroma(XYZ: ArrayLike, conditions: Conditions, space: ColourSpace) -> tuple[Array, Mask]:
    """Lower chroma at constant lightness and hue until the display can show the colour.

    J is cut to the white's first; above the knee, J = 96.6 at sRGB's conditions, hue gives way to
    the display's white (see the module).

    Parameters
    ----------
    XYZ : (..., 3) array_like
        Y = 100 for the display's white.
    conditions : Conditions
        How the display is seen.
    space : ColourSpace

    Returns
    -------
    XYZ : (..., 3) float64
        What was inside as it was.
    mapped : (...) bool

    Raises
    ------
    ShapeError
        If the last axis is not 3.
    ViewingError
        As `DisplayGamut.of`.
    """
    given = triples("gamut: XYZ", XYZ)
    gamut = DisplayGamut.of(conditions, space)
    mapped = ~_inside(given @ gamut.RGB_from_XYZ.T, SLACK)
    shown = given.copy()
    if mapped.any():
        x, a, b = np.moveaxis(opponents(given[mapped], conditions), -1, 0)
        linear, _ = reduce_chroma_opponent(x, a, b, gamut, steps=_STEPS)
        shown[mapped] = linear @ space.XYZ_from_RGB.T
    return shown, mapped


def reduce_chroma_opponent(
    achromatic: ArrayLike,
    a: ArrayLike,
    b: ArrayLike,
    gamut: DisplayGamut,
    *,
    steps: int = SHADER_STEPS,
    slack: float = SLACK,
) -> tuple[Array, Mask]:
    """`reduce_chroma` on a passage's own variables (x', a', b'): the twin of a shader.

        x  = clamp(x', 0, top),  (a_g, b_g) = max(x - knee, 0) knee_slope
        R0 = response_from_opponent (x, a_g, b_g)
        R1 = response_from_opponent (0, a' - a_g, b' - b_g)
        s  : the largest k / 2^steps, by halving, for which linear(R0 + s R1) lies within 0…1
        linear(R) = linear_from_response · sign(R) (|R| / (400 - |R|))^(1/0.42)

    Parameters
    ----------
    achromatic, a, b : (...) array_like
        x', a', b' as `volspec.appearance.models.conditions.CamPassage` has them.
    gamut : DisplayGamut
    steps : int
        Halvings; the chroma left out is 2^-steps of the way at most.
    slack : float
        So far outside of 0…1 counts as inside; frames take `volspec.appearance.screen.SLACK`.

    Returns
    -------
    linear : (..., 3) float64
        Linear RGB, within -slack to 1 + slack.
    mapped : (...) bool
    """
    given = np.stack(np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (achromatic, a, b))))
    signals = np.where(given[0] > 0.0, given, 0.0)
    matrix = gamut.linear_from_response
    linear = _linear(np.moveaxis(signals, 0, -1), matrix)
    mapped = ~_inside(linear, slack)
    x = np.minimum(signals[0], gamut.top)
    over = np.maximum(x - gamut.knee, 0.0)
    grey = np.stack([x, over * gamut.knee_slope[0], over * gamut.knee_slope[1]], axis=-1)
    way = np.stack([x, signals[1], signals[2]], axis=-1) - grey
    R0, R1 = grey @ k.RESPONSE_FROM_OPPONENT.T, way @ k.RESPONSE_FROM_OPPONENT.T
    share, step = np.zeros(x.shape), 0.5
    for _ in range(steps):
        tried = expand(R0 + (share + step)[..., None] * R1) @ matrix.T
        share = np.where(_inside(tried, slack), share + step, share)
        step *= 0.5
    paled = expand(R0 + share[..., None] * R1) @ matrix.T
    return np.where(mapped[..., None], paled, linear), mapped
