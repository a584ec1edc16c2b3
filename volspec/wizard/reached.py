"""What a wizard reached: colours as the frames show them, before and after.

Scene -> [reached] -> figures
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.live import passage_of
from volspec.appearance.models.cielab import cielab, delta_E_2000
from volspec.relight import Illumination
from volspec.scene import NamedLight, Scene
from volspec.wizard.drawing import Drawing

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reached:
    """Figures of one light, CIEDE2000 of what the display shows.

    Parameters
    ----------
    light : str
    apart : {(material, material): ΔE}
        How far materials are from each other.
    changed : {material: ΔE}
        How far each that was designed is from what it was; under a new light, how far the others
        are from what they are under the one that it is like.
    like : str
        That one's name; empty for a light that was there.
    """

    light: str
    apart: dict[tuple[str, str], float]
    changed: dict[str, float]
    like: str = ""


def reached(
    before: Scene, after: Scene, materials: Sequence[str], like: NamedLight | None = None
) -> tuple[Reached, ...]:
    """Figures of every light.

    Parameters
    ----------
    before, after : Scene
    materials : sequence of str
        Those that were designed: compared with each other, and with all others.
    like : NamedLight, optional
        Of a new light: the one it resembles.
    """
    old = {light.name: light for light in before.lights}
    names = list(after.materials)
    found = []
    for light in after.lights:
        shown = dict(zip(names, shown_Lab(after, light), strict=True))
        pairs = [
            (one, two)
            for one in materials
            for two in names
            if one != two and not (two in materials and materials.index(two) < materials.index(one))
        ]
        apart = {(a, b): float(delta_E_2000(shown[a], shown[b])) for a, b in pairs}
        known = old.get(light.name, like)
        changed: dict[str, float] = {}
        if known is not None:
            was = dict(zip(names, shown_Lab(before, known), strict=True))
            own = light.name in old
            changed = {
                name: float(delta_E_2000(was[name], shown[name]))
                for name in names
                if (name in materials) == own
            }
        new = known is not None and known.name != light.name
        found.append(Reached(light.name, apart, changed, known.name if known and new else ""))
    return tuple(found)


def off(one: Scene, other: Scene) -> float:
    """Largest CIEDE2000 between the same materials and lights in two scenes' frames."""
    return max(
        float(np.max(delta_E_2000(shown_Lab(one, a), shown_Lab(other, b))))
        for a, b in zip(one.lights, other.lights, strict=True)
    )


def shown_Lab(scene: Scene, light: NamedLight) -> Array:
    """(K, 3) CIELAB of a scene's materials in its frames, where they face every source.

    Through the scene's own basis, mode, level and viewing, clipped to the display.
    """
    groups = scene.raycast.shares()
    spec = replace(scene.relight, viewing=Drawing(scene).viewing)
    lit = Illumination.of(scene.basis, light.rig, spec, groups)
    channels = scene.basis.channels_for_materials(scene.materials)
    layers = np.hstack([share * channels for share in groups.values()])
    XYZ = lit.scene_XYZ(layers, np.ones(len(layers)))
    seen = passage_of(lit.viewing, lit.white_XYZ).apply(XYZ)
    space = spec.viewing.display.colours
    linear = np.clip(seen @ space.RGB_from_XYZ.T, 0.0, 1.0)
    return cielab(np.linalg.solve(space.RGB_from_XYZ, linear.T).T, space.white_XYZ)
