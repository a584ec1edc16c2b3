"""``[transfer]`` and materials' filters: one kind of function, and what it makes of the file."""

import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises
from tests.support.scenes import SMALL, scene_text
from volspec.basis import SpectralBasis
from volspec.errors import SceneError
from volspec.pipeline import raycast
from volspec.scene import Scene
from volspec.scene.basis import use_of
from volspec.scene.tables.transfer import TransferSpec
from volspec.settings import read_table
from volspec.spectra import reflectance
from volspec.transfer import Region, Transfer
from volspec.volume import phantom

HEAD = f"{scene_text({'shell': 'gold', 'core': 'copper'})}{SMALL}[transfer]\n"
POINTS = """points = [
    { value = 0.1, opacity = 0.0, material = "shell" },
    { value = 0.6, opacity = 0.4, material = { shell = 0.5, core = 0.5 } },
]
"""
REGIONS = """regions = [
    { values = [0.1, 0.6], gradients = [0.02, inf], opacity = 0.3, material = "shell" },
    { values = [0.5, 0.9], gradients = [0, inf], opacity = 0.8, material = "core", softness = 0.5 },
]
"""
LABELS = """labels = [
    { label = 1, opacity = 0.3, material = "shell" },
    { label = 2, opacity = 0.8, material = { core = 0.9 } },
]
"""
SURFACES = """surfaces = [
    { value = 0.6, opacity = 1.0, material = "core" },
    { value = 0.2, opacity = 0.3, material = "shell" },
]
"""
GENERAL = SpectralBasis.load("general-7")
GOLD, COPPER = reflectance("gold"), reflectance("copper")
PAINTS = {"shell": GOLD, "core": COPPER}
CURVE = [(0.1, 0.0, "shell"), (0.6, 0.4, {"shell": 0.5, "core": 0.5})]
STEP = "reference_step_mm = 2"
KINDS: dict[str, tuple[str, Transfer]] = {
    "points": (POINTS, vs.TransferFunction(CURVE, PAINTS, GENERAL)),
    "points of a step": (POINTS + STEP, vs.TransferFunction(CURVE, PAINTS, GENERAL, 2.0)),
    "points by gradient": (
        POINTS + "gradient_opacity = [[0, 0.1], [0.2, 1]]",
        vs.TransferFunction(CURVE, PAINTS, GENERAL, None, [(0, 0.1), (0.2, 1)]),
    ),
    "points with a filter": (
        POINTS,
        vs.TransferFunction(CURVE, PAINTS, GENERAL, filters={"core": GOLD}),
    ),
    "regions": (
        REGIONS + STEP,
        vs.TransferFunction2D(
            [
                Region((0.1, 0.6), (0.02, math.inf), 0.3, "shell"),
                Region((0.5, 0.9), (0, math.inf), 0.8, "core", 0.5),
            ],
            *(PAINTS, GENERAL, 2.0),
        ),
    ),
    "labels": (
        LABELS + STEP,
        vs.LabelFunction({1: (0.3, "shell"), 2: (0.8, {"core": 0.9})}, PAINTS, GENERAL, 2.0),
    ),
    "surfaces": (
        SURFACES,
        vs.Isosurfaces([(0.6, 1.0, "core"), (0.2, 0.3, "shell")], PAINTS, GENERAL),
    ),
}


def load(folder: Path, transfer: str, filter: str = "", more: str = "") -> Scene:
    values = phantom.ball(12).values
    np.save(folder / "ball.npy", values)
    np.save(folder / "parts.npy", np.digitize(values, [0.1, 0.5]).astype(np.uint8))
    text = HEAD + transfer + more
    if filter:
        text = text.replace('"copper"', f'"copper"\nfilter = "{filter}"')
    if "labels =" in transfer:
        text = text.replace("ball.npy", "parts.npy")
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return Scene.load(path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_s_table_is_that_of_its_transfer_function(tmp_path, kind):
    text, function = KINDS[kind]
    scene = load(tmp_path, text, "gold" if "filter" in kind else "")
    assert type(scene.transfer) is type(function) and scene.basis.name == "general-7"
    assert same(scene.transfer.bake(1.5), function.bake(1.5))


def same(one: Any, other: Any) -> bool:
    """Return True if two tables have equal arrays."""
    if is_dataclass(one):
        names = [field.name for field in fields(one)]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    return bool(np.array_equal(one, other)) if isinstance(one, np.ndarray) else one == other


@pytest.mark.not_quick
def test_a_scene_casts_into_the_picture_of_its_transfer_function(tmp_path):
    text, function = KINDS["points"]
    scene = load(tmp_path, text)
    image, volume = scene.render(), scene.volume()
    twin = raycast(volume, function, scene.camera(volume), (24, 16))
    assert image.alpha.max() > 0.3
    assert np.array_equal(image.coefficients, twin.coefficients)
    assert np.array_equal(image.alpha, twin.alpha)


def test_use_sees_the_materials_of_every_kind():
    """Computed by hand: opacity times values covered; for labels and surfaces opacity."""

    def use(**rows: object) -> dict[str, float]:
        return use_of(read_table(TransferSpec, rows, SceneError))

    look = {"opacity": 0.5, "material": "a"}
    other = {"opacity": 0.4, "material": {"a": 0.25, "b": 0.5}}
    regions = [
        {"values": (0, 4), "gradients": (0, 1), **look},
        {"values": (0, 10), "gradients": (0, 1), **other},
    ]
    assert use(regions=regions) == pytest.approx({"a": 1.0, "b": 2.0 / 3.0})
    alike = pytest.approx({"a": 1.0, "b": 0.2 / 0.6})
    assert use(labels=[{"label": 1, **look}, {"label": 2, **other}]) == alike
    assert use(surfaces=[{"value": 1, **look}, {"value": 2, **other}]) == alike


@pytest.mark.usefixtures("fits")
def test_a_designed_material_or_filter_is_trained_for_in_every_kind(tmp_path):
    (tmp_path / "made.csv").write_text("# designed: yes\n380,0.2\n500,0.4\n780,0.3\n")
    for text in (POINTS, REGIONS, LABELS, SURFACES):
        plain = load(tmp_path, text, more='\n[viewing]\nmode = "componentwise"\n')
        assert plain.basis.name == "general-7"
        path = tmp_path / "scene.toml"
        path.write_text(path.read_text().replace('"copper"', '"made.csv"'))
        assert Scene.load(path).basis_reason.startswith("made ")
    assert load(tmp_path, POINTS, "made.csv").basis_reason.startswith("made ")


def test_labels_are_down_sampled_by_their_most_frequent(tmp_path):
    scene = load(tmp_path, LABELS)
    path = tmp_path / "scene.toml"
    path.write_text(path.read_text().replace("[volume]", "[volume]\ndownsample = 2"))
    np.save(tmp_path / "parts.npy", np.random.default_rng(1).integers(0, 3, (8, 8, 8), np.uint8))
    half = Scene.load(path).volume()
    assert np.array_equal(half.values, scene.volume().downsampled(2, labels=True).values)
    assert not np.array_equal(half.values, scene.volume().downsampled(2).values)


LOOK = 'opacity = 1, material = "core"'
NINE = ", ".join(f"{{ value = {v}, {LOOK} }}" for v in range(9))
# The table, the message, the second material's filter, and further tables.
WRONG: list[tuple[str, ...]] = [
    ("reference_step_mm = 1", "missing transfer"),
    (POINTS + LABELS, "conflict transfer"),
    ("labels = []", "missing transfer.labels"),
    (f"{REGIONS}gradient_opacity = [[0, 0], [1, 1]]", "conflict transfer.gradient_opacity"),
    (f"{POINTS}gradient_opacity = [[3, 0], [1, 1]]", "range transfer.gradient_opacity[1].gradient"),
    (f"{SURFACES}reference_step_mm = 1", "conflict transfer.reference_step_mm"),
    (LABELS.replace("label = 2", "label = 1"), "duplicate transfer.labels[1].label"),
    (f"labels = [{{ label = -1, {LOOK} }}]", "range transfer.labels"),
    (f"regions = [{{ values = [9, 1], gradients = [0, 1], {LOOK} }}]", "range transfer.values"),
    (
        f"regions = [{{ values = [9], gradients = [0, 1], {LOOK} }}]",
        "shape transfer.regions[0].values",
    ),
    (f"surfaces = [{NINE}]", "size transfer.surfaces"),
    (
        'surfaces = [{ value = 1, opacty = 1, material = "core" }]',
        "unknown transfer.surfaces[0].opacty",
    ),
    (
        f"surfaces = [{{ value = 1, softness = 1, {LOOK} }}]",
        "unknown transfer.surfaces[0].softness",
    ),
    *(
        (f"labels = [{{ label = 1, opacity = 1, material = {material} }}]", message)
        for material, message in (
            ('"cor"', "unknown transfer.labels[1].material"),
            ("5", "type transfer.labels[0].material"),
            ('{ core = "x" }', "type transfer.labels[0].material.core"),
        )
    ),
    (POINTS, "unknown material[1].filter", "glod"),
    (SURFACES, "conflict material[1].filter", "gold"),
    (POINTS, "conflict transfer.filters", "gold", '[basis]\nmethod = "materials"'),
    (LABELS, "conflict raycast", "", "[raycast]\npreintegrated = true"),
    (SURFACES, "conflict raycast", "", '[raycast]\nmode = "maximum"'),
]


@pytest.mark.not_quick
@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: wrong[1])
def test_mistakes_are_named_in_one_line(tmp_path, wrong):
    text, message, *more = wrong
    with raises(SceneError, *message.split(" ")) as caught:
        load(tmp_path, text, *more).render()
    assert "scene.toml: " in str(caught.value)
