"""The widget's traits and what they refuse, without a browser."""

import base64
import io
import sys
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import volspec as vs
from tests.support.errors import raises
from tests.support.images import named_lights, some_rows
from tests.twins.test_recompose import layered
from volspec.appearance import Display, Viewing
from volspec.errors import DeviceError, InputError, VolspecWarning
from volspec.image import CoefficientImage
from volspec.pipeline import relight
from volspec.relight import LightRig, RelightSpec

pytest.importorskip("anywidget")

LIGHTS = ["D65", "A", "FL2"]
P3 = Display(space="Display P3")
# As the page sends it: every field of a Viewing.
LOOK: dict[str, Any] = {
    "model": "CAM16",
    "lux": 300,
    "L_A": 12.5,
    "Y_b": 35,
    "Y_A": 18.0,
    "surround": 0.1,
    "D": None,
    "discount": False,
    "exposure": 2,
    "gamut": "reduce",
    "mark": True,
    "deficiency": "protan",
    "severity": 0.5,
}


@pytest.fixture
def widget(colours: CoefficientImage) -> Any:
    return vs.notebook(colours, LIGHTS)


def noted(image: CoefficientImage, viewing: str) -> CoefficientImage:
    return replace(image, notes={"viewing": viewing, "scene": "Patches"})


def test_the_first_light_shines(widget, colours):
    assert dict(widget.weights) == {"D65": 1.0, "A": 0.0, "FL2": 0.0}
    assert dict(widget.opacities) == {}
    widget.opacities = {}  # of no layers
    np.testing.assert_array_equal(widget.frame(), relight(colours, vs.light("D65")))
    assert repr(widget) == "RelightWidget(64x64, D65, A, FL2)"


def test_a_frame_follows_every_setting(widget, colours):
    viewing = Viewing(model="CIELAB", exposure=0.5)
    widget.weights = {"A": 0.5, "FL2": 0.25}
    widget.viewing, widget.mode, widget.backdrop = viewing, "exact", 0.4
    rig = LightRig((vs.light("A"), vs.light("FL2")), (0.5, 0.25))
    wanted = relight(colours, rig, RelightSpec(viewing, "exact", 0.4))
    np.testing.assert_array_equal(widget.frame(), wanted)
    widget.weights = {}
    assert widget.rig is None and not widget.frame().any()


def test_what_the_page_tells_becomes_traits_unanswered(widget, monkeypatch):
    sent: list[dict[str, Any]] = []
    monkeypatch.setattr(widget, "_send", lambda message, buffers=None: sent.append(message))
    state = {"weights": [0, 0.5, 1], "viewing": LOOK, "mode": "exact", "backdrop": 0.5}
    widget.set_state({**state, "level": "relative", "probe": [5, 6]})
    assert dict(widget.weights) == {"D65": 0.0, "A": 0.5, "FL2": 1.0}
    display = Display(gamut="reduce", mark=True)
    seen = Viewing("CAM16", 300, 12.5, 35, "dim", exposure=2, display=display)
    assert widget.viewing == replace(seen, Y_A=18.0, deficiency="protan", severity=0.5)
    assert (widget.mode, widget.backdrop, widget.probe) == ("exact", 0.5, (5, 6))
    # Other views get what came (echo_update); an update would move back a slider in hand.
    assert [message["method"] for message in sent] == ["echo_update"]


@pytest.mark.parametrize(("ratio", "surround"), [(0.0, "dark"), (0.2, "average"), (0.15, 0.15)])
def test_a_surround_with_a_name_has_it(widget, ratio, surround):
    widget.set_state({"viewing": {**LOOK, "surround": ratio}})
    assert widget.viewing.surround == surround
    assert widget.get_state("viewing")["viewing"]["surround"] == ratio


def test_a_displays_room_reaches_the_page(widget):
    widget.viewing = Viewing(display=Display(L_A=40.0, surround="dark"))
    room = widget.get_state("_room")["_room"]["display"]
    assert room["L_A"] == 40.0 and room["surround"] == 0.0
    widget.set_state({"viewing": LOOK})
    assert widget.viewing.display == Display(L_A=40.0, surround="dark", gamut="reduce", mark=True)


def test_a_pixel_is_read_again_at_every_change(widget, colours):
    probed: list[Any] = []
    widget.observe(lambda change: probed.append(change["new"]), "probed")
    widget.probe = (40, 3)
    assert widget.probed.opacity == 1.0
    wanted = colours.basis.xyz(colours.coefficients[3, 40], vs.light("D65"))
    # Both are the matrix fitted to the light: rounding of sums alone.
    np.testing.assert_allclose(widget.probed.XYZ, wanted, rtol=1e-9)
    widget.weights = {"A": 1.0}
    widget.weights = {}
    assert [each is None for each in probed] == [False, False, True]
    assert probed[0].XYZ[2] > 2 * probed[1].XYZ[2], "tungsten has little blue"


def test_another_image_keeps_the_settings(widget, colours):
    widget.weights, widget.probe = {"A": 1.0}, (60, 60)
    before = widget.get_state("_page")["_page"]
    widget.image = some_rows(colours, slice(16))
    assert widget.get_state("_page")["_page"] != before
    assert dict(widget.weights)["A"] == 1.0 and widget.probe is None
    assert widget.frame().shape == (16, 64, 3)


def test_a_cell_run_again_closes_the_widgets_of_its_last_run(colours, monkeypatch):
    from volspec.export.notebook import widget as module

    def ran(cell: str, run: str) -> Any:
        parent = {"metadata": {"cellId": cell}, "header": {"msg_id": run}}
        kernel = SimpleNamespace(get_parent=lambda: parent)
        monkeypatch.setattr(module, "get_ipython", lambda: SimpleNamespace(kernel=kernel))
        return vs.notebook(colours, ["D65"])

    first, of_same_run, of_another = ran("a", "1"), ran("a", "1"), ran("b", "2")
    assert all(each.model_id for each in (first, of_same_run, of_another))
    again = ran("a", "3")
    assert again.model_id and of_another.model_id
    assert first.comm is None and of_same_run.comm is None
    assert first.frame().shape == again.frame().shape


def test_opacities_are_the_picture_s_the_probe_s_and_the_page_s():
    image = layered(3, 1)
    widget = vs.notebook(image, LIGHTS)
    assert dict(widget.opacities) == {"copper": 1.0, "gold": 1.0, "brass": 1.0}
    widget.probe = (5, 3)
    before = widget.probed.opacity
    widget.opacities = {"gold": 0.2}
    made = image.recompose({"gold": 0.2})
    np.testing.assert_array_equal(widget.frame(), relight(made, vs.light("D65")))
    assert widget.probed.opacity == made.alpha[3, 5] != before
    assert widget.get_state("opacities")["opacities"] == {"copper": 1, "gold": 0.2, "brass": 1}
    widget.set_state({"opacities": {"copper": 0, "gold": 1, "brass": 4, "skin": 2}})
    assert dict(widget.opacities) == {"copper": 0, "gold": 1, "brass": 4}
    # Another image keeps what fits it.
    widget.image = layered(2, 1, seed=1)
    assert dict(widget.opacities) == {"copper": 0, "gold": 1}


@pytest.mark.parametrize(
    ("name", "value", "code", "field"),
    [
        ("weights", {"D56": 1}, "unknown", "notebook.weights"),
        ("weights", {"A": -0.5}, "range", "notebook.weights['A']"),
        ("weights", [1, 0, 0], "type", "notebook.weights"),
        ("viewing", "CAM16", "type", "notebook.viewing"),
        ("viewing", Viewing(model="Hunt"), "unsupported", "notebook.viewing.model"),
        ("viewing", Viewing(adapting="pixel"), "unsupported", "notebook.viewing.adapting"),
        ("viewing", Viewing(display=P3), "unsupported", "notebook.viewing.display.space"),
        ("mode", "exakt", "unknown", None),
        ("backdrop", 2, "range", None),
        ("backdrop", vs.light("D65"), "unsupported", "notebook.backdrop"),
        ("level", "absolute", "missing", "notebook.level"),
        ("probe", (64, 0), "range", "notebook.probe"),
        ("probe", 7, "range", "notebook.probe"),
        ("image", "engine.exr", "type", "notebook.image"),
        ("opacities", {"skin": 0.5}, "unsupported", None),
        ("layered opacities", {"skin": 1}, "unknown", None),
        ("layered opacities", {"gold": -1}, "range", None),
        ("layered opacities", 0.5, "type", None),
    ],
)
def test_what_cannot_be_is_refused_and_leaves_the_widget_as_it_was(
    widget, name, value, code, field
):
    if name.startswith("layered "):
        widget, name = vs.notebook(layered(3, 1), LIGHTS), name.removeprefix("layered ")
    before = getattr(widget, name)
    with raises(InputError, code, field):
        setattr(widget, name, value)
    assert getattr(widget, name) is before


def test_an_absolute_scene_is_relative_under_lights_without_lux(colours):
    image = noted(colours, '{"level": "absolute", "illuminance_lux": 500}')
    assert vs.notebook(image).level == "relative"
    assert vs.notebook(image, {"lamp": LightRig((vs.light("A"),), (), (50,))}).level == "absolute"


def test_lights_with_lux_add_up(colours):
    lux = {"A": 50, "D65": 900}
    lamps = {name: LightRig((vs.light(name),), (), (lux[name],)) for name in lux}
    widget = vs.notebook(colours, lamps, Viewing(illuminance_lux=900))
    widget.level = "absolute"
    assert widget.rig.total_lux == 50
    dim = widget.frame().mean()
    widget.weights = {"A": 1.0, "D65": 1.0}
    assert widget.rig.total_lux == 950 and widget.frame().mean() > 2 * dim


def of_groups(image: CoefficientImage) -> Any:
    """Return a widget whose light is of a group that the image itself has not."""
    rig = LightRig((vs.light("A"),), groups=("key",))
    return vs.notebook(replace(image, groups={"key": 1.0}), {"lamp": rig})


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda image: vs.notebook(image, "D65"), "type"),
        (lambda image: vs.notebook(image, []), "missing"),
        (lambda image: vs.notebook(image, ["A", "A"]), "duplicate"),
        (lambda image: vs.notebook(image, ["D56"]), "unknown"),
        (lambda image: vs.notebook(image, [LightRig((vs.light("A"),))]), "missing"),
        (lambda image: vs.notebook(image, [3]), "type"),
        (lambda image: vs.notebook(image, {"red": vs.Spectrum([600, 700], [1, 1])}), None),
        (lambda image: vs.notebook(image, LIGHTS, Viewing(model="Hunt")), "unsupported"),
        (lambda image: vs.notebook(image, LIGHTS).frame(int), None),
        (lambda image: setattr(of_groups(image), "image", image), "unknown"),
    ],
)
def test_lights_and_frames_that_are_none_are_refused(colours, make, code):
    with raises(InputError, code):
        make(colours)


def test_a_scenes_lights_and_viewing_are_taken(colours):
    (lamp,) = named_lights(["lamp"], "A")
    image = noted(colours, '{"model": "CAM16", "surround": "dark", "backdrop": 0.05}')
    widget = vs.notebook(image, [lamp])
    assert widget.lights == (lamp,)
    assert widget.viewing == Viewing("CAM16", surround="dark") and widget.backdrop == 0.05
    assert "<title>Patches</title>" in widget.get_state("_page")["_page"]
    # What no page draws is replaced in what the scene says.
    with pytest.warns(VolspecWarning):
        assert vs.notebook(noted(colours, '{"model": "Hunt"}')).viewing.model == "CIECAM02"


def test_an_image_in_a_cell_shows_the_widget(colours, bundles):
    (bundle,) = bundles(colours)
    assert "application/vnd.jupyter.widget-view+json" in bundle
    # Readers that run no widgets get a still picture, as a saved notebook's.
    still = Image.open(io.BytesIO(base64.b64decode(bundle["image/jpeg"])))
    assert np.abs(np.asarray(still).astype(float) - relight(colours, vs.light("D65"))).mean() < 6


def test_without_the_extra_an_image_shows_its_text(colours, bundles, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "volspec.export.notebook.widget", raising=False)
    with raises(DeviceError, "unsupported"):
        vs.notebook(colours)
    assert bundles(colours) == [{"text/plain": "CoefficientImage(64x64, 7 channels)"}]


@pytest.fixture
def bundles() -> Callable[[object], list[dict[str, Any]]]:
    """Output of IPython for an object in a cell's last line."""
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output

    shell = InteractiveShell.instance()

    def shown(value: object) -> list[dict[str, Any]]:
        with capture_output(stdout=False, stderr=False) as captured:
            data, _ = shell.display_formatter.format(value)
        return [output.data for output in captured.outputs] + ([data] if data else [])

    return shown
