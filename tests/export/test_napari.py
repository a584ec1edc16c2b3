"""napari's reader and dock, without napari: what they return, and what a slider does.

Fakes offer what is used of napari 0.9 and magicgui 0.10, with which both were tested.
"""

import copy
import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export.conftest import Make
from tests.support.errors import raises
from tests.support.fixtures import Patch
from tests.support.images import image
from volspec.basis import MaterialBasis
from volspec.errors import ImageError, SceneError, VolumeError
from volspec.export import napari
from volspec.pipeline import relight
from volspec.relight import LightRig
from volspec.spectra import light, reflectance
from volspec.volume import Volume


class Signal:
    """Something that can be connected to."""

    def __init__(self) -> None:
        self.called: list[Callable[[], None]] = []

    def connect(self, call: Callable[[], None]) -> None:
        self.called.append(call)

    def emit(self) -> None:
        for call in self.called:
            call()


class Slider:
    def __init__(self, label: str, value: float, min: float, max: float) -> None:
        self.label, self._value, self.range = label, value, (min, max)
        self.changed = Signal()

    @property
    def value(self) -> float:
        return self._value

    @value.setter
    def value(self, value: float) -> None:
        self._value = value
        self.changed.emit()


@pytest.fixture
def layers(monkeypatch: Patch) -> Any:
    """The layers of a viewer; ``emit`` reports what is put into ``selection.active``."""
    selection = SimpleNamespace(active=None, events=SimpleNamespace(active=Signal()))
    viewer = SimpleNamespace(layers=SimpleNamespace(selection=selection))
    widgets = SimpleNamespace(Container=list, FloatSlider=Slider, Label=SimpleNamespace)
    monkeypatch.setitem(sys.modules, "magicgui.widgets", widgets)
    monkeypatch.setitem(sys.modules, "napari", SimpleNamespace(current_viewer=lambda: viewer))
    return viewer.layers


@pytest.fixture
def layer(scene: Make) -> Any:
    """A scene as napari has it once it is open."""
    ((data, settings, kind),) = napari.read_layers(str(scene().path))
    assert kind == "image" and settings["rgb"] and settings["name"] == "ball"
    return SimpleNamespace(data=data, metadata=settings["metadata"])


def test_a_scene_opens_under_its_first_light(layer, scene):
    image, seen = scene().render(), scene().relight
    wanted = relight(image, light("D65"), seen)
    # The GL picture of one cast and of another of the same scene.
    assert np.abs(layer.data.astype(int) - wanted).max() <= 1
    assert layer.metadata["weights"] == {"day": 1.0, "lamp": 0.0, "tube": 0.0}


def test_an_image_opens_with_lights_to_weigh(tmp_path, scene):
    scene().render().save(tmp_path / "ball.exr")
    ((data, settings, _),) = napari.read_layers(str(tmp_path / "ball.exr"))
    assert data.shape == (24, 32, 3) and settings["name"] == "ball"
    assert list(settings["metadata"]["weights"].values()) == [1.0, 0.0, 0.0, 0.0]
    # The fakes have no lux to be compared by.
    scene('[viewing]\nlevel = "absolute"\n').render().save(tmp_path / "lux.exr")
    assert np.array_equal(napari.read_layers(str(tmp_path / "lux.exr"))[0][0], data)


@pytest.mark.parametrize("path", ["scan.nrrd", "exr", "a.toml.bak", ["a.exr", "b.exr"]])
def test_other_files_are_left_to_other_readers(path):
    assert napari.reader(path) is None


@pytest.mark.parametrize(("name", "error"), [("no.exr", ImageError), ("no.toml", SceneError)])
def test_files_that_cannot_be_read_are_errors(name, error):
    read = napari.reader(name)
    assert read is not None
    with raises(error, "not-found"):
        read(name)


def test_sliders_weigh_the_lights_of_the_active_layer(layers, layer):
    dock = napari.light_weights()
    assert [part.value[:16] for part in dock] == ["Select a picture"]
    layers.selection.active = layer
    layers.selection.events.active.emit()
    day, lamp, _ = dock
    assert [(part.label, part.value) for part in dock] == [("day", 1), ("lamp", 0), ("tube", 0)]
    by_day = layer.data
    lamp.value = 1.0
    assert not np.array_equal(layer.data, by_day)
    day.value = 0.0
    by_lamp = layer.data
    lit = layer.metadata["volspec"]
    assert np.array_equal(by_lamp, lit.frame({"day": 0, "lamp": 0.5, "tube": 0}))
    lamp.value = 0.0  # all are off
    assert layer.data is by_lamp
    assert layer.metadata["weights"] == {"day": 0.0, "lamp": 1.0, "tube": 0.0}
    layers.selection.active = SimpleNamespace(metadata={})
    layers.selection.events.active.emit()
    assert len(dock) == 1
    layers.selection.active = layer
    layers.selection.events.active.emit()
    assert [part.value for part in dock] == [0, 1, 0]


def test_mixes_keep_groups_and_lux():
    basis = MaterialBasis({"gold": reflectance("gold")})
    grouped = image(np.ones((1, 1, 4)), basis, groups={"key": 0.5, "fill": 0.5})
    rigs = {
        "key": LightRig((light("A"),), illuminance_lux=(900,), groups=("key",)),
        "fill": LightRig((light("D65"),), illuminance_lux=(100,), groups=("fill",)),
    }
    lit = napari.RelitLayer(grouped, rigs)
    both = LightRig((light("A"), light("D65")), (1, 0.5), (900, 100), ("key", "fill"))
    assert np.array_equal(lit.frame({"key": 1, "fill": 0.5}), relight(grouped, both))
    # Which a basis of materials could not be, as napari asks for where a layer is doubled.
    assert copy.deepcopy({"volspec": lit})["volspec"] is lit


def test_the_manifest_names_functions_that_are_there():
    text = (Path(napari.__file__).parent.parent / "napari.yaml").read_text(encoding="utf-8")
    for module, name in re.findall(r"python_name: (\S+):(\S+)", text):
        assert callable(getattr(import_module(module), name))
    ids = re.findall(r"id: (\S+)", text)
    assert ids == re.findall(r"command: (\S+)", text) == ["volspec.read", "volspec.lights"]


def test_a_layer_is_a_volume_where_napari_has_it():
    """napari maps (z, y, x) indices to its world, here turned by 90 degrees in the plane."""
    world = np.array([[2.0, 0, 0], [0, 0, -0.5], [0, 1, 0]])

    def layer(values: NDArray[Any], **more: Any) -> SimpleNamespace:
        given = {"data": values, "ndim": values.ndim, "name": "cells", "units": ("um",) * 3}
        place = {"data_to_world": lambda index: world @ np.asarray(index) + (10, 20, 30)}
        return SimpleNamespace(**given, **place, **more)

    values = np.arange(24.0, dtype=np.float32).reshape(2, 3, 4)
    volume = Volume.of(layer(values))
    np.testing.assert_array_equal(volume.values, values)
    for x, y, z in ((0, 0, 0), (3, 1, 1)):
        mm = 1e-3 * (world @ (z, y, x) + (10, 20, 30))[::-1]
        np.testing.assert_allclose((volume.world_from_index @ (x, y, z, 1))[:3], mm)
    finest = layer(values, multiscale=True)
    finest.data = [values, values[:, ::2, ::2]]
    assert Volume.from_layer(finest).shape_xyz == (4, 3, 2)
    for other in (layer(values, rgb=True), layer(values[0]), layer(values[None])):
        with raises(VolumeError, "type"):
            Volume.of(other)
