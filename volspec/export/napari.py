"""napari plugin: coefficient images and scenes as pictures, with light weights in a dock.

    IMAGE.exr or SCENE.toml -> [napari] -> an RGB layer, relit as sliders move

``volspec/napari.yaml`` declares `reader` and `light_weights`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from volspec.export.notebook.settings import DEFAULT_LIGHTS
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter, relight
from volspec.relight import LightRig, Pixels, mixed_rig
from volspec.scene import Scene, stored_relight_spec
from volspec.spectra import light


@dataclass(frozen=True, slots=True, eq=False)
class RelitLayer:
    """Coefficient image and lights by name; ``metadata`` of a layer."""

    image: CoefficientImage
    lights: Mapping[str, LightRig]

    def __deepcopy__(self, memo: dict[int, Any]) -> RelitLayer:
        """Return the object itself: it is immutable, and napari deep-copies metadata."""
        return self

    def frame(self, weights: Mapping[str, float], relighter: Relighter | None = None) -> Pixels:
        """Relight to (H, W, 3) uint8 with weighted lights and the image's stored viewing."""
        mix = mixed_rig(tuple(self.lights.values()), [weights[name] for name in self.lights])
        spec = stored_relight_spec(self.image).for_lights(self.lights.values())
        return relighter.frame(mix, spec) if relighter else relight(self.image, mix, spec)


def reader(path: str | list[str]) -> Callable[[str], list[Any]] | None:
    """Return the function that reads a path if this is a single image or scene, else None."""
    is_ours = isinstance(path, str) and Path(path).suffix.lower() in (".exr", ".toml")
    return read_layers if is_ours else None


def read_layers(path: str) -> list[Any]:
    """Return the picture under the first light, as napari's (data, settings, kind)."""
    if path.lower().endswith(".toml"):
        scene = Scene.load(path)
        relit = RelitLayer(scene.render(), {named.name: named.rig for named in scene.lights})
    else:
        lights = {name: LightRig((light(name),)) for name in DEFAULT_LIGHTS}
        relit = RelitLayer(CoefficientImage.load(path), lights)
    weights = {name: float(k == 0) for k, name in enumerate(relit.lights)}
    metadata = {"volspec": relit, "weights": weights}
    settings = {"name": Path(path).stem, "rgb": True, "metadata": metadata}
    return [(relit.frame(weights), settings, "image")]


def light_weights() -> Any:
    """Return a dock with one slider per light of the active layer."""
    # Imported by name: volspec depends on neither, and napari is the caller.
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
        relit = layer.metadata["volspec"]
        relighter = Relighter(relit.image)
        sliders = {
            name: widgets.FloatSlider(label=name, value=weight, min=0.0, max=1.0)
            for name, weight in layer.metadata["weights"].items()
        }

        def update() -> None:
            weights = {name: slider.value for name, slider in sliders.items()}
            if any(weights.values()):  # all off: keep the last picture
                layer.data = relit.frame(weights, relighter)
                layer.metadata["weights"] = weights

        for slider in sliders.values():
            slider.changed.connect(update)
            dock.append(slider)

    layers.selection.events.active.connect(show)
    show()
    return dock
