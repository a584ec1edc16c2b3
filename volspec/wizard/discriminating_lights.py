"""Lights under which materials look different: lamps of the library, and white from three LEDs.

    Scene -> [telling] -> TellingLight

Nothing is redesigned, so the new light is one multiplication per pixel away. The mixtures of LEDs
are exactly as white as daylight: what changes is how materials look, not the light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import delta_E_2000
from volspec.errors import SceneError, VolspecError
from volspec.relight import LightRig
from volspec.scene import NamedLight, Scene
from volspec.spectra import SpectralGrid, colour_matching_functions, light, light_names
from volspec.wizard.result import displayed_Lab
from volspec.wizard.scene_palette import ScenePalette

Array = NDArray[np.float64]

DAYLIGHT = "D65"
# Peaks of the blue, the green and the red LED.
_PEAKS_NM = (range(430, 491, 20), range(490, 571, 20), range(570, 671, 20))
_MIN_APART_NM, _MIN_SHARE = 30, 0.005
# A lamp that one can name is preferred to LEDs that show this much more.
_PREFERRED = 1.1


@dataclass(frozen=True, slots=True)
class DiscriminatingLight:
    """A light and what it shows, in CIEDE2000 of the displayed colours."""

    text: str  # in `volspec.light`'s notation
    delta_e: float
    before: float  # the same under the light that it is compared with

    @property
    def is_mixture(self) -> bool:
        """True if it is made of LEDs and not a lamp of the library."""
        return "led:" in self.text


def show_difference(scene: Scene, one: str, two: str, *, under: str) -> DiscriminatingLight:
    """Return the light under which two materials look most different.

    Parameters
    ----------
    scene : Scene
    one, two : str
        Materials.
    under : str
        The light of the scene to compare with.

    Raises
    ------
    SceneError
        If a material or the light is unknown, or both materials are the same.

    Examples
    --------
    >>> import volspec as vs
    >>> from volspec.wizard import show_difference
    >>> scene = vs.Scene.load("data/scenes/engine.toml")
    >>> found = show_difference(scene, "block", "inserts", under="D65")
    >>> found.before < 1 < 10 < found.delta_e
    True
    """
    palette, names = ScenePalette(scene), list(scene.materials)
    rows = [names.index(palette.require_material(name)) for name in (one, two)]
    if one == two:
        problem = f"{one!r} cannot differ from itself"
        raise SceneError(problem, "name two materials", code="conflict", field="two", given=two)

    def distance(Lab: Array) -> float:
        return float(delta_E_2000(Lab[rows[0]], Lab[rows[1]]))

    before = distance(displayed_Lab(scene, palette.light(under)))
    distances = {
        text: distance(Lab)
        for text in (*light_names(), *white_from_leds(palette.grid))
        if (Lab := _look(scene, text)) is not None
    }
    lamp = max((text for text in distances if ":" not in text), key=distances.__getitem__)
    best = max(distances, key=distances.__getitem__)
    text = lamp if distances[best] < _PREFERRED * distances[lamp] else best
    return DiscriminatingLight(text, distances[text], before)


def _look(scene: Scene, text: str) -> Array | None:
    """Return the materials' displayed CIELAB under a light; None if it does not cover the grid."""
    try:
        spectrum = light(text, scene.basis.grid)
        return displayed_Lab(scene, NamedLight(text, "", spectrum, LightRig((spectrum,))))
    except VolspecError:
        return None


@lru_cache(maxsize=4)
def white_from_leds(grid: SpectralGrid) -> tuple[str, ...]:
    """Return mixtures of a blue, a green and a red LED with daylight's chromaticity.

    >>> from volspec.spectra import DEFAULT_GRID
    >>> white_from_leds(DEFAULT_GRID)[0]
    'led:430*0.00966+led:490*0.0645+led:570*0.926'
    """
    return tuple(_mixtures(grid))


def _mixtures(grid: SpectralGrid) -> Iterator[str]:
    Q = colour_matching_functions(grid)
    white = Q @ light(DAYLIGHT, grid).values
    leds = {nm: light(f"led:{nm}", grid).values for peaks in _PEAKS_NM for nm in peaks}
    for peaks in product(*_PEAKS_NM):
        if min(high - low for low, high in pairwise(peaks)) < _MIN_APART_NM:
            continue
        # All have the same Y, so amounts are shares of illuminance.
        amounts = np.linalg.solve(Q @ np.stack([leds[nm] for nm in peaks], axis=1), white)
        parts = amounts / amounts.sum()
        if parts.min() >= _MIN_SHARE:
            yield "+".join(f"led:{nm}*{part:.3g}" for nm, part in zip(peaks, parts, strict=True))
