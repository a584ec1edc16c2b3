"""napari: coefficient images and scenes open as pictures whose lights are weighed in a dock.

    IMAGE.exr or SCENE.toml -> [napari] -> an RGB layer, relit at every move of a slider

``volspec/napari.yaml`` tells napari of the two functions here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from volspec.export.notebook.lights import DEFAULT_LIGHTS
from volspec.pipeline import Relighter, relight
from volspec.raycast import CoefficientImage
from volspec.relight import LightRig
from volspec.relight.spec import Pixels, mixed_rig
from volspec.scene import Scene, viewing_of
from volspec.spectra import light


@dataclass(frozen=True, slots=True, eq=False)
class Relit:
    """A picture's coefficients and its lights by name; what a layer keeps as ``metadata``."""

    image: CoefficientImage
    lights: Mapping[str, LightRig]

    def __deepcopy__(self, memo: dict[int, Any]) -> Relit:
        """Itself, as nothing in it changes: napari copies what it keeps of layers."""
        return self

    def frame(self, weights: Mapping[str, float], relighter: Relighter | None = None) -> Pixels:
        """(H, W, 3) uint8 under the weighed lights, seen as the image's scene says."""
        mix = mixed_rig(tuple(self.lights.values()), [weights[name] for name in self.lights])
        seen = viewing_of(self.image).spec().for_lights(self.lights.values())
        return relighter.frame(mix, seen) if relighter else relight(self.image, mix, seen)


def reader(path: str | list[str]) -> Callable[[str], list[Any]] | None:
    """What reads a file, where it is one image or scene."""
    one = isinstance(path, str) and Path(path).suffix.lower() in (".exr", ".toml")
    return read_layers if one else None


def read_layers(path: str) -> list[Any]:
    """The picture under its first light, as napari's (data, settings, kind); a scene is cast."""
    if path.lower().endswith(".toml"):
        scene = Scene.load(path)
        lit = Relit(scene.render(), {named.name: named.rig for named in scene.lights})
    else:
        lights = {name: LightRig((light(name),)) for name in DEFAULT_LIGHTS}
        lit = Relit(CoefficientImage.load(path), lights)
    weights = {name: float(k == 0) for k, name in enumerate(lit.lights)}
    kept = {"volspec": lit, "weights": weights}
    settings = {"name": Path(path).stem, "rgb": True, "metadata": kept}
    return [(lit.frame(weights), settings, "image")]


def light_weights() -> Any:
    """A dock with a slider for each light of the active layer."""
    # By name, since volspec needs neither: napari is there where this is called.
    widgets: Any = import_module("magicgui.widgets")
    layers = import_module("napari").current_viewer().layers
    dock = widgets.Container()

    relighter: Relighter | None = None

    def show() -> None:
        nonlocal relighter
        if relighter is not None:
            relighter.close()
        relighter = None
        dock.clear()
        layer = layers.selection.active
        if layer is None or "volspec" not in layer.metadata:
            dock.append(widgets.Label(value="Select a picture that volspec opened."))
            return
        lit = layer.metadata["volspec"]
        relighter = Relighter(lit.image)
        sliders = {
            name: widgets.FloatSlider(label=name, value=weight, min=0.0, max=1.0)
            for name, weight in layer.metadata["weights"].items()
        }

        def weigh() -> None:
            weights = {name: slider.value for name, slider in sliders.items()}
            if any(weights.values()):  # all off: the last picture stays
                layer.data = lit.frame(weights, relighter)
                layer.metadata["weights"] = weights

        for slider in sliders.values():
            slider.changed.connect(weigh)
            dock.append(slider)

    layers.selection.events.active.connect(show)
    show()
    return dock
