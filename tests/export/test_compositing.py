"""Files for compositors: layers, lights in the header, recipes for Blender and Nuke."""

import dataclasses
import functools
import json
import re
import sys
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export._blender import Node, blender
from tests.export._layers import LIGHTS, SHARES, SPEC, close, layered, made, opened, shown, stored
from tests.support.commands import GENERAL, METALS, call, refusal
from tests.support.errors import raises, refuses
from tests.support.fixtures import Patch
from volspec.appearance import Viewing
from volspec.appearance.display.spaces import SPACES
from volspec.basis.display import MODES
from volspec.errors import ImageError, InputError
from volspec.export.compositing import Recipe
from volspec.export.recipes import write_recipe
from volspec.export.spectral import write_spectral_frame
from volspec.image import CoefficientImage
from volspec.relight import LightRig, RelightSpec, relight
from volspec.relight.illumination import Illumination
from volspec.spectra import light


@pytest.mark.parametrize("basis", [GENERAL, METALS], ids=["spectral", "materials"])
@pytest.mark.parametrize("mode", MODES)
def test_the_header_s_matrices_relight_the_file_s_channels(basis, mode, tmp_path):
    image, spec = made(basis), dataclasses.replace(SPEC, mode=mode)
    stored(tmp_path / "i.exr", image, spec)
    header, channels = opened(tmp_path / "i.exr")
    data = json.loads(header["volspec:compositing"])
    assert list(data["lights"]) == list(LIGHTS) and data["mode"] == mode
    for name, row in data["lights"].items():
        found = np.zeros((*image.alpha.shape, 3))
        for group, M in row["matrices"].items():
            layer = np.dstack([channels[each] for each in data["channels"][group]])
            found += layer @ np.array(M).T
        assert close(found, shown(image, name, spec)), name
    # The preview has the digits of half floats.
    preview = np.dstack([channels[k] for k in "RGB"])
    assert np.allclose(np.clip(preview, 0, 1), shown(image, "day", spec), rtol=2**-11, atol=2e-6)


def test_over_the_header_s_backdrop_a_picture_is_the_opaque_frame():
    image, recipe = made(), Recipe.of(GENERAL, SHARES, LIGHTS, SPEC)
    behind = (1 - image.alpha)[..., None] * recipe.lights["evening"].backdrop
    codes = relight(image, LIGHTS["evening"], SPEC, dtype=np.float32, backend="numpy")
    frame = SPACES["sRGB"].decode(codes)
    assert close(recipe.picture(image, "evening") + behind, frame)


def test_numbers_of_a_light_are_its_channels_and_one_for_flat_white():
    lights = {"flat": light("E"), "key": LightRig((light("A"),), groups=("key",))}
    spec = dataclasses.replace(SPEC, viewing=Viewing())
    rows = Recipe.of(GENERAL, SHARES, lights, spec).lights
    assert np.allclose(rows["flat"].numbers["key"], 1.0)
    assert list(rows["key"].numbers) == list(rows["key"].matrices) == ["key"], "the sky is dark"
    e = GENERAL.analyse(light("A"))
    assert np.allclose(rows["key"].numbers["key"] / rows["key"].numbers["key"][0], e / e[0])
    # White that faces the key alone gets 0.7 of what faces both, and it is the adopted white.
    assert np.allclose(0.7 * rows["key"].matrices["key"] @ np.ones(7), 1.0)


def test_lux_count_where_all_lights_have_them():
    spec = RelightSpec(Viewing(illuminance_lux=500.0), level="absolute")
    dim = LightRig((light("A"),), illuminance_lux=(100.0,))
    for others, white in (({}, 0.2), ({"bare": light("A")}, 1.0)):
        for row in Recipe.of(GENERAL, {"light": 1.0}, {"dim": dim, **others}, spec).lights.values():
            assert np.allclose(row.matrices["light"] @ np.ones(7), white)


@pytest.mark.parametrize("name", ["LPS", "HP1", "planck:2000"])
def test_white_is_white_under_every_light(name):
    """LPS has next to no blue, which must not become noise."""
    M = Recipe.of(GENERAL, {"light": 1.0}, {"l": light(name)}).lights["l"].matrices["light"]
    assert np.allclose(M @ np.ones(7), 1.0, atol=1e-6)


def test_a_rendered_scene_opens_with_layers_preview_depth_and_its_lights(scene, tmp_path):
    assert call("render", scene().path, "-o", tmp_path / "i.exr", "--half") == 0
    header, channels = opened(tmp_path / "i.exr")
    layers = {f"light.c{k:02d}.V" for k in range(7)}
    assert set(channels) == layers | {"R", "G", "B", "A", "Z", "first.Z"}
    assert {channels[name].dtype.name for name in layers} == {"float16"}
    nothing = channels["A"] == 0
    assert nothing.any() and np.isinf(channels["Z"][nothing]).all()
    assert list(Recipe.load(tmp_path / "i.exr").lights) == ["day", "lamp", "tube"]
    image = CoefficientImage.load(tmp_path / "i.exr")
    lit = Illumination.of(image.basis, light("D65"), RelightSpec(backdrop=0.0))
    XYZ = lit.scene_XYZ(image.coefficients, image.alpha)
    # D65 needs next to no adaptation: its bands' white is (95.1, 100, 108.9) within 0.3.
    preview = np.dstack([channels[k] for k in "RGB"])
    assert np.allclose(preview, XYZ @ SPACES["sRGB"].RGB_from_XYZ.T, atol=0.005)
    assert header["volspec:relight.2"].startswith("lamp\nred: (")


def pasted(channels: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Channels by the names that Nuke's reader gives them, for an expression."""
    names: dict[str, Any] = {}
    for name, pixels in channels.items():
        *layer, last = (
            re.sub(r"[^A-Za-z0-9]", "_", part.lstrip("0123456789")) for part in name.split(".", 2)
        )
        if layer:
            names.setdefault("_".join(layer), SimpleNamespace()).__dict__[last] = pixels
    return names


def test_the_header_s_sums_can_be_pasted_into_an_expression(tmp_path):
    image = made()
    stored(tmp_path / "i.exr", image)
    header, channels = opened(tmp_path / "i.exr")
    for number, name in enumerate(LIGHTS, start=1):
        first, *rows = header[f"volspec:relight.{number}"].split("\n")
        assert first == name and [row.split(": ")[0] for row in rows] == ["red", "green", "blue"]
        found = [eval(row.split(": ")[1], pasted(channels)) for row in rows]
        assert close(np.dstack(found), shown(image, name))


def test_nuke_s_group_has_a_knob_for_each_weight(tmp_path):
    """The nodes are as Nuke's own files write them; the sums are evaluated here."""
    image = made()
    source = tmp_path / "a {$c.exr"
    stored(source, image)
    assert call("compositing", source, "-o", tmp_path / "i.nk") == 0
    text = (tmp_path / "i.nk").read_text()
    bare = re.sub(r"\\.", "", text)
    assert bare.count("{") == bare.count("}") and bare.count('"') % 2 == 0
    assert f' file "{tmp_path.as_posix()}/' + r'a \{\$c.exr"' in text
    knobs = re.findall(r'addUserKnob \{7 (weight\d) l "((?:\\.|[^"])*)"', text)
    lamps = ("day", "fluorescent ('_x')", "evening")
    assert [label for _, label in knobs] == [
        f"{lamp}: {group}" for lamp in lamps for group in SHARES
    ]
    sums = re.findall(r'expr\d "(.*)"', text)
    names = pasted(opened(source)[1])
    for name in LIGHTS:
        on = {knob: float(label.startswith(name[:5])) for knob, label in knobs}
        found = [eval(each, {**names, "parent": SimpleNamespace(**on)}) for each in sums]
        assert close(np.dstack(found), shown(image, name))
    first = dict(re.findall(r"^ (weight\d) (\d)$", text, re.MULTILINE))
    assert first == {knob: "01"[label.startswith("day")] for knob, label in knobs}


STATES: tuple[dict[str, float], ...] = (
    {},
    {"rotor": 0.5},
    {"case": 0.0},
    {"rotor": 1.5, "case": 0.8},
    {"rotor": 4.0, "case": 3.0},
)
OPACITIES = {False: 1e-5, True: 2e-4}
"""Rounding of float32, in the recipes and in `CoefficientImage.recompose`. With shadows
exp(b E) - 1 is off by 6e-8, and is divided by b, 0.001 at least."""
KINDS = pytest.mark.parametrize(
    ("shadows", "solid", "opacities"),
    [
        pytest.param(*kind, opacities, marks=[pytest.mark.slow] if (n + m) % 4 else [])
        for n, kind in enumerate(product((False, True), repeat=2))
        for m, opacities in enumerate(STATES)
    ],
)


def chained(text: str, names: dict[str, Any]) -> NDArray[Any]:
    """Evaluate the Expression nodes of a group, one after the other, as (H, W, 4)."""
    functions = {"exp": np.exp, "log": np.log, "sqrt": np.sqrt}
    functions["max"] = lambda *each: functools.reduce(np.maximum, each)
    functions["min"] = lambda *each: functools.reduce(np.minimum, each)
    pixels = dict.fromkeys("rgb", 0.0) | {"a": names.pop("A")}
    for node in re.findall(r"^ Expression \{\n(.*?)^ \}", text, re.DOTALL | re.MULTILINE):
        knobs = dict(re.findall(r'^  (\w+) "?(.*?)"?$', node, re.MULTILINE))
        known = functions | names | pixels
        for n in range(4):
            if f"temp_name{n}" in knobs:
                known[knobs[f"temp_name{n}"]] = eval(knobs[f"temp_expr{n}"], functions | known)
        pixels |= {c: eval(knobs[f"expr{n}"], known) for n, c in enumerate("rgba")}
    return np.dstack([np.broadcast_to(pixels[c], np.shape(pixels["a"])) for c in "rgba"])


@KINDS
def test_nuke_s_group_has_a_knob_for_each_opacity(tmp_path, opacities, shadows, solid):
    image = layered(shadows=shadows, solid=solid)
    stored(tmp_path / "i.exr", image)
    write_recipe(tmp_path / "i.nk", tmp_path / "i.exr")
    text = (tmp_path / "i.nk").read_text()
    knobs = re.findall(r'addUserKnob \{7 (opacity\d) l "(\w+)"', text)
    assert [label for _, label in knobs] == ["rotor", "case"]
    assert re.findall(r"^ opacity\d (.*)$", text, re.MULTILINE) == ["1", "1"]
    weights = re.findall(r'addUserKnob \{7 (weight\d) l "((?:\\.|[^"])*)"', text)
    channels = {k: v.astype(np.float32) for k, v in opened(tmp_path / "i.exr")[1].items()}
    picture = image.recompose(opacities)
    for name in LIGHTS:
        on = {knob: float(label.startswith(name[:5])) for knob, label in weights}
        on |= {knob: opacities.get(material, 1.0) for knob, material in knobs}
        names = pasted(channels) | {"A": channels["A"], "parent": SimpleNamespace(**on)}
        found = chained(text, names)
        recipe = Recipe.load(tmp_path / "i.exr")
        off = np.abs(found[..., :3] - recipe.picture(picture, name)).max(axis=2)
        # Channels that fall below 0 are 0 in the picture, but not in Nuke's sums.
        clipped = ((picture.coefficients == 0) & (image.coefficients > 0)).any(axis=2)
        clipped &= min(opacities.values(), default=1.0) > 0
        assert off[~clipped].max() < OPACITIES[shadows] and off.max() < 1e-3
        assert np.abs(found[..., 3] - picture.alpha).max() < OPACITIES[shadows]


def in_blender(path: Path, monkeypatch: Patch) -> tuple[Any, list[Node], Any]:
    """Run an image's recipe: Blender, the nodes that it has then, and what is put together."""
    script = path.with_suffix(".py")
    write_recipe(script, path)
    # Compositors compute in float32.
    bpy, nodes = blender({k: v.astype(np.float32) for k, v in opened(path)[1].items()})
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    monkeypatch.setattr(sys, "argv", ["blender"])
    exec(script.read_text(), {"__name__": "__main__"})
    return bpy, nodes, next(node for node in nodes if node.kind == "Composite").inputs[0]


def test_blender_s_nodes_are_the_frame(tmp_path, monkeypatch):
    """Seen in Blender 3.4 and 5.0 on the engine: CIEDE2000 below 1e-4 from volspec's own frames."""
    image = made()
    stored(tmp_path / "i.exr", image)
    bpy, nodes, output = in_blender(tmp_path / "i.exr", monkeypatch)
    weights = [node for node in nodes if node.kind == "Value"]
    labels = [f"{name}: {group}" for name in LIGHTS for group in SHARES]
    assert [node.label for node in weights] == labels
    for name in LIGHTS:
        if name != "day":  # which is on at first
            for node in weights:
                node.outputs[0].default_value = float(node.label.startswith(f"{name}: "))
        bpy.frame.clear()
        found = output.value()
        assert close(found[..., :3], shown(image, name))
        assert np.array_equal(found[..., 3], image.alpha)
    render = bpy.context.scene.render
    assert (render.resolution_x, render.resolution_y) == image.size


@KINDS
def test_blender_s_nodes_have_the_opacities(tmp_path, monkeypatch, opacities, shadows, solid):
    """Rendered in Blender 4.5 and 5.0 on the engine: at most 3e-7 from these pictures.

    With shadows 3e-5.
    """
    image = layered(shadows=shadows, solid=solid)
    recipe = stored(tmp_path / "i.exr", image)
    _, nodes, output = in_blender(tmp_path / "i.exr", monkeypatch)
    for node in nodes:
        if node.label.startswith("opacity: "):
            assert node.outputs[0].default_value == 1.0
            node.outputs[0].default_value = opacities.get(node.label.removeprefix("opacity: "), 1.0)
    picture, found = image.recompose(opacities), output.value()
    wanted = np.dstack([recipe.picture(picture, "day"), picture.alpha])
    assert np.abs(found - wanted).max() < OPACITIES[shadows]


def test_old_images_get_other_lights_by_being_written_once_more(tmp_path):
    image = made()
    image.save(tmp_path / "bare.exr")
    words = ("--light", "FL2", "--light", "key=A", "--mode", "exact")
    assert call("compositing", tmp_path / "bare.exr", *words, "-o", tmp_path / "i.exr") == 0
    recipe, again = Recipe.load(tmp_path / "i.exr"), CoefficientImage.load(tmp_path / "i.exr")
    assert list(recipe.lights) == ["FL2", "key=A"] and recipe.mode == "exact"
    assert np.array_equal(again.coefficients, image.coefficients)
    # White light's quarter, at the exposure of the scene that is noted in the image.
    assert np.allclose(recipe.lights["FL2"].backdrop, 0.25 * 1.25)
    own = ("compositing", tmp_path / "i.exr", "--opacity", "x=1", "-o", tmp_path / "i.exr")
    assert "input image" in str(refusal(*own))


@pytest.mark.parametrize(
    "text", ["{", "3", '{"version": 2}', '{"version": 1, "lights": {"a": 3}}', None]
)
def test_a_recipe_that_was_edited_or_cut_is_refused(text, tmp_path):
    path = tmp_path / "i.exr"
    if text is None:
        stored(path, made())
        path.write_bytes(path.read_bytes()[:-900])  # its header is intact
    else:
        made().save(path, texts={"compositing": text})
    with raises(ImageError, "damaged"):
        write_recipe(tmp_path / "i.nk", path)
    assert not (tmp_path / "i.nk").exists()


def test_a_recipe_needs_lights_with_names():
    recipe = Recipe.of(GENERAL, SHARES, LIGHTS)
    refuses(lambda: Recipe.of(GENERAL, SHARES, {}), "missing recipe", InputError)
    refuses(lambda: Recipe.of(GENERAL, SHARES, [light("A")]), "missing recipe", InputError)
    refuses(lambda: dataclasses.replace(recipe, lights={}), "missing recipe", ImageError)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"matrices": {"key": np.ones((3, 6))}}, "shape"),
        ({"matrices": {"lamp": np.ones((3, 7))}}, "unknown"),
        ({"numbers": {"key": np.ones(8)}}, "shape"),
        ({"numbers": {"key": np.full(7, np.nan)}}, "range"),
        ({"backdrop": np.ones(2)}, "shape"),
        ({"matrices": {}}, "missing"),
    ],
)
def test_a_light_that_does_not_fit_its_recipe_is_refused(change, code):
    recipe = Recipe.of(GENERAL, SHARES, LIGHTS, SPEC)
    with raises(InputError, code):
        dataclasses.replace(
            recipe, lights={"day": dataclasses.replace(recipe.lights["day"], **change)}
        )


def test_the_guide_s_python_reads_both_kinds_of_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    guide = Path(__file__).resolve().parents[2] / "docs" / "compositing.md"
    relit, seen = re.findall(r"```python\n(.*?)```", guide.read_text(encoding="utf-8"), re.DOTALL)
    image, spec = made(), dataclasses.replace(SPEC, mode="exact")
    stored(Path("engine.exr"), image)
    found: dict[str, Any] = {}
    exec(relit, found)
    assert close(found["RGB"], shown(image, "day"))
    write_spectral_frame("spectra.exr", image, light("D65"), spec, {})
    exec(seen, found)
    own = Illumination.of(GENERAL, light("D65"), spec, SHARES).scene_XYZ(
        image.coefficients, image.alpha
    )
    # The eye sampled every 10 nm is not its mean over 10 nm.
    assert np.allclose(found["XYZ"], own, rtol=0.01)
