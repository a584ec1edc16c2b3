"""Wizards work in the frames: hidden is alike, revealed is distinct, kept is constant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises, refuses
from tests.support.wizards import SCENE, frame_Lab, painted
from volspec.appearance.models.lab import delta_E_2000
from volspec.basis import MaterialBasis
from volspec.errors import PaletteError
from volspec.wizard import show_difference
from volspec.wizard.scene_palette import ScenePalette


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> vs.Scene:
    """Three materials within each other under three lights, with a basis fitted to them."""
    folder = tmp_path_factory.mktemp("wizards")
    np.save(folder / "ball.npy", vs.phantom.ball(24).values)
    (folder / "ball.toml").write_text(SCENE, encoding="utf-8")
    return vs.Scene.load(folder / "ball.toml")


@pytest.fixture(scope="module")
def scene(trained: vs.Scene) -> vs.Scene:
    """The same with its materials as channels, which takes no time to make."""
    return vs.Scene.load(trained.path, {"method": "materials"})


def test_a_hidden_material_cannot_be_told_from_its_host_in_the_frames(trained):
    made = vs.hide(trained, "core", under="lamp", within="shell")
    assert not isinstance(made.scene.basis, MaterialBasis)
    plain = painted(made.scene, "core", "shell")
    assert delta_E_2000(frame_Lab(made.scene, "lamp"), frame_Lab(plain, "lamp")).max() < 1.0
    assert made.delta_e("lamp", "core", "shell") < 1.0 < made.delta_e("day", "core", "shell")
    # Under a light that is unlike the lamp it is more like itself than its host is.
    before, after, host = (frame_Lab(each, "tube") for each in (trained, made.scene, plain))
    assert 2 * delta_E_2000(before, after).mean() < delta_E_2000(before, host).mean()


def test_the_host_is_the_neighbour_that_is_most_seen(scene):
    hosts = map(ScenePalette(scene).surrounding_material, scene.materials)
    assert [*hosts] == ["core", "stone", "core"]


@pytest.mark.slow
def test_a_metameric_black_keeps_its_colours_where_a_light_is_made_for_it(scene):
    made = vs.hide(scene, "core", under="dark", black=True, like="day")
    assert max(row.changed["core"] for row in made.evaluations if not row.like) < 1.5
    i, j = made.design.palette.index(("core", "dark"))
    assert made.design.state.RGB()[i, j].max() < 1e-3
    assert made.scene.lights[-1].name == "dark"
    new = made.evaluations[-1]
    assert new.like == "day" and max(new.changed.values()) < 1.5
    assert new.changed.keys() == {"shell", "stone"}


def test_a_revealed_material_is_as_far_from_all_others_as_asked(scene):
    made = vs.hide(scene, "core", under="day", within="shell").scene
    seen = vs.reveal(made, "core", under="day", distance=12)
    assert min(seen.delta_e("day", "core", other) for other in ("shell", "stone")) >= 12


def test_a_material_is_revealed_to_deuteranopes_as_well(scene):
    made = vs.reveal(scene, "core", under="day", distance=12, deficiency=["deutan"])
    pairs = {frozenset(pair.reflectances) for pair in made.apart}
    assert pairs == {frozenset(("core", "shell")), frozenset(("core", "stone"))}
    assert all(min(p.smallest["none"], p.smallest["deutan"]) >= 12 for p in made.apart)
    plain = vs.reveal(scene, "core", under="day", distance=12)
    assert all(p.deficiencies == ("none",) for p in plain.apart)


def test_merged_materials_part_under_a_light_of_real_lamps(scene):
    lamps = ("LED-B1", "LED-RGB1", "FL11", "HP1")
    made = vs.merge(scene, ["shell", "core"], under="day", split="apart", lamps=lamps)
    assert made.delta_e("day", "shell", "core") < 1.0
    assert made.delta_e("apart", "shell", "core") > 20.0
    palette = made.design.palette
    mixed = palette.member("light", "apart").synthesis(palette.grid)
    shares = np.linalg.lstsq(mixed, made.design.state.E[-1], rcond=None)
    assert shares[0].min() > -1e-9


@pytest.mark.slow
def test_given_colours_are_what_the_split_light_shows(scene):
    colours = [(0.8, 0.2, 0.2), (0.9, 0.9, 0.9), (0.2, 0.4, 0.8)]
    names = ["shell", "core", "stone"]
    made = vs.merge(scene, names, under="day", split="apart", colours=colours, average=True)
    models = made.design.state.colour_models()
    seen = models[-1].space.encode(np.clip(made.design.state.RGB(models), 0, 1))
    rows = [made.design.palette.index((name, "apart"))[0] for name in names]
    assert np.abs(seen[rows, -1] - colours).max() < 0.05
    assert max(row.apart["shell", "core"] for row in made.evaluations if row.light == "day") < 1.0


def test_a_kept_material_has_one_colour_under_all_lights(scene):
    made = vs.keep(scene, "shell")
    models, state = made.design.state.colour_models(), made.design.state
    i = made.design.palette.index(("shell", "day"))[0]
    Lab = [model.Lab_from_RGB(state.RGB(models)[i, j]) for j, model in enumerate(models)]
    assert max(delta_E_2000(Lab[0], other) for other in Lab[1:]) < 1.0
    day = next(row for row in made.evaluations if row.light == "day")
    assert day.changed["shell"] < 5.0


def test_under_two_groups_of_lights_it_is_hidden_from_each():
    groups = vs.Scene.load(Path(__file__).resolve().parents[2] / "data/scenes/engine-groups.toml")
    name = next(light.name for light in groups.lights if len(light.rig.lights) > 1)
    made = vs.hide(groups, "inserts", under=name)
    palette = made.design.palette
    own = [j for j, column in enumerate(palette.names[1]) if column.startswith(name)]
    assert len(own) == 2
    rows = [palette.index((material, palette.names[1][0]))[0] for material in ("inserts", "block")]
    inserts, block = made.design.state.RGB()[rows][:, own]
    assert np.abs(inserts - block).max() < 1e-3


def test_a_basis_too_coarse_for_the_design_gives_way_to_the_materials(trained):
    made = vs.hide(vs.Scene.load(trained.path, {"size": 3}), "core", under="lamp", within="shell")
    assert made.changes.exact and made.scene.file.basis.method == "materials"
    assert made.delta_e("lamp", "core", "shell") < 1.0


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda s: vs.hide(alone(s), "shell", under="day"), "missing material"),
        (lambda s: vs.keep(coloured(s), "core"), "impossible material"),
        (lambda s: show_difference(s, "core", "core", under="day"), "conflict two"),
        (lambda s: show_difference(s, "core", "piston", under="day"), "unknown material"),
        (lambda s: vs.hide(s, "cor", under="day"), "unknown material"),
        (lambda s: vs.hide(s, "core", under="dya"), "unknown under"),
        (lambda s: vs.hide(s, "core", under="day", within="core"), "conflict within"),
        (lambda s: vs.hide(s, "core", under="day", within="x", black=True), "conflict within"),
        (lambda s: vs.hide(s, "core", under="day", like="lamp"), "duplicate light"),
        (lambda s: vs.hide(s, "core", under=" ", like="lamp"), "missing light"),
        (lambda s: vs.hide(s, "core", under="new", like="lmap"), "unknown like"),
        (lambda s: vs.hide(s, "core", under="day", lamps=("A",)), "conflict lamps"),
        (lambda s: vs.merge(s, ["core"], under="day"), "missing materials"),
        (
            lambda s: vs.merge(s, ["core", "shell"], under="day", colours=[(1, 0, 0)]),
            "missing colours",
        ),
        (lambda s: vs.reveal(s, "core", under="day", distance=-1), "range distance"),
        (lambda s: vs.reveal(s, "core", under="day", deficiency=["green"]), "type deficiency"),
    ],
)
def test_what_cannot_be_is_refused(scene, call, expected):
    refuses(lambda: call(scene), expected)


def alone(scene: vs.Scene) -> vs.Scene:
    """The scene with one material, which has nothing to hide in."""
    rows = scene.file.material[:1]
    points = [replace(p, material="shell") for p in scene.file.transfer.points or ()]
    transfer = replace(scene.file.transfer, points=points)
    return vs.Scene(replace(scene.file, material=rows, transfer=transfer), scene.path)


def coloured(scene: vs.Scene) -> vs.Scene:
    """The scene under coloured lights, to which no eye adapts: no colour can be constant."""
    lamps = zip(scene.file.light, ("D65", "LED-B1", "HP1"), strict=True)
    rows = [replace(row, spectrum=text) for row, text in lamps]
    viewing = replace(scene.file.viewing, viewing=replace(scene.file.viewing.viewing, model="none"))
    return vs.Scene(replace(scene.file, light=rows, viewing=viewing), scene.path)


@pytest.mark.slow
def test_a_distance_out_of_reach_is_refused_with_the_largest(scene):
    with raises(PaletteError, "impossible", "distance") as caught:
        vs.reveal(scene, "core", under="day", distance=100)
    largest = float(str(caught.value).partition("than ΔE ")[2].partition(" ")[0])
    assert 20 < largest < 100
