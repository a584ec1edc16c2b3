"""Wizards do what they say in the frames: hidden is alike, revealed is apart, kept is constant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from volspec.appearance.models.cielab import cielab, delta_E_2000
from volspec.appearance.spaces import space_of
from volspec.errors import PaletteError, SceneError
from volspec.wizard import Redesigned
from volspec.wizard.drawing import Drawing

SCENE = """# Kept where it stands.
[volume]
file = "ball.npy"

[[material]]
name = "shell"
reflectance = "ColorChecker/blue sky"

[[material]]
name = "core"  # what it is about
reflectance = "ColorChecker/orange"

[[material]]
name = "stone"
reflectance = "ColorChecker/foliage"

[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "shell" },
    { value = 0.4, opacity = 0.2, material = "shell" },
    { value = 0.6, opacity = 0.8, material = "core" },
    { value = 1.0, opacity = 0.9, material = "stone" },
]

[[light]]
name = "day"
spectrum = "D65"

[[light]]
name = "lamp"
spectrum = "A"

[[light]]
name = "tube"
spectrum = "FL11"

[viewing]
exposure = 1.5
backdrop = 0.0

[output]
width = 48
height = 48
"""


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


def frame_Lab(scene: vs.Scene, light: str, size: tuple[int, int] | None = None) -> np.ndarray:
    """(H, W, 3) CIELAB of a scene's frame, cast with its own basis."""
    found = next(each for each in scene.lights if each.name == light)
    shown = vs.relight(scene.render(size=size), found.rig, scene.relight, np.float32)
    space = space_of("sRGB")
    linear = space.decode(shown.astype(np.float64))
    return cielab(np.linalg.solve(space.RGB_from_XYZ, linear[..., None])[..., 0], space.white_XYZ)


def painted(scene: vs.Scene, material: str, like: str) -> vs.Scene:
    """The scene with a material of the very reflectance of another: what hiding is measured by."""
    spectra = {f"{name}!": spectrum for name, spectrum in scene.materials.items()}
    rows = [
        row.model_copy(update={"reflectance": f"{like if row.name == material else row.name}!"})
        for row in scene.file.material
    ]
    spectra |= {f"{light.name}!": light.spectrum for light in scene.lights}
    lights = [row.model_copy(update={"spectrum": f"{row.name}!"}) for row in scene.file.light]
    file = scene.file.model_copy(update={"material": rows, "light": lights})
    return vs.Scene(file, scene.path, spectra)


def figures(made: Redesigned, light: str) -> dict[str, float]:
    return next(row.changed for row in made.reached if row.light == light)


def test_a_hidden_material_cannot_be_told_from_its_host_in_the_frames(trained: vs.Scene) -> None:
    made = vs.hide(trained, "core", under="lamp", within="shell")
    assert made.scene.basis.method == "virtual-sensors"
    plain = painted(made.scene, "core", "shell")
    assert delta_E_2000(frame_Lab(made.scene, "lamp"), frame_Lab(plain, "lamp")).max() < 1.0
    assert made.delta_e("lamp", "core", "shell") < 1.0 < made.delta_e("day", "core", "shell")
    # Under a light that is unlike the lamp it is more like itself than its host is.
    before, after, host = (frame_Lab(each, "tube") for each in (trained, made.scene, plain))
    assert 2 * delta_E_2000(before, after).mean() < delta_E_2000(before, host).mean()


def test_the_host_is_the_neighbour_that_is_most_seen(scene: vs.Scene) -> None:
    drawing = Drawing(scene)
    assert [drawing.host(name) for name in scene.materials] == ["core", "stone", "core"]


def test_a_metameric_black_keeps_its_colours_where_a_light_is_made_for_it(scene: vs.Scene) -> None:
    made = vs.hide(scene, "core", under="dark", black=True, like="day")
    assert max(row.changed["core"] for row in made.reached if not row.like) < 1.5
    shown = made.design.state
    i, j = made.design.palette.index(("core", "dark"))
    assert shown.linear(shown.eyes())[i, j].max() < 1e-3
    assert made.scene.lights[-1].name == "dark"
    new = made.reached[-1]
    assert new.like == "day" and max(new.changed.values()) < 1.5
    assert new.changed.keys() == {"shell", "stone"}


def test_a_revealed_material_is_as_far_from_all_others_as_asked(scene: vs.Scene) -> None:
    made = vs.hide(scene, "core", under="day", within="shell").scene
    seen = vs.reveal(made, "core", under="day", distance=12)
    for other in ("shell", "stone"):
        assert seen.delta_e("day", "core", other) >= 12


def test_merged_materials_part_under_a_light_of_real_lamps(scene: vs.Scene) -> None:
    lamps = ("LED-B1", "LED-RGB1", "FL11", "HP1")
    made = vs.merge(scene, ["shell", "core"], under="day", split="apart", lamps=lamps)
    assert made.delta_e("day", "shell", "core") < 1.0
    assert made.delta_e("apart", "shell", "core") > 20.0
    member = made.design.palette.member("light", "apart")
    shares = np.linalg.lstsq(
        member.synthesis(made.design.palette.grid), made.design.state.E[-1], rcond=None
    )
    assert shares[0].min() > -1e-9


def test_given_colours_are_what_the_split_light_shows(scene: vs.Scene) -> None:
    colours = [(0.8, 0.2, 0.2), (0.9, 0.9, 0.9), (0.2, 0.4, 0.8)]
    names = ["shell", "core", "stone"]
    made = vs.merge(scene, names, under="day", split="apart", colours=colours, average=True)
    eyes = made.design.state.eyes()
    seen = eyes[-1].space.encode(np.clip(made.design.state.linear(eyes), 0, 1))
    rows = [made.design.palette.index((name, "apart"))[0] for name in names]
    assert np.abs(seen[rows, -1] - colours).max() < 0.05
    assert max(row.apart["shell", "core"] for row in made.reached if row.light == "day") < 1.0


def test_a_kept_material_has_one_colour_under_all_lights(scene: vs.Scene) -> None:
    made = vs.keep(scene, "shell")
    eyes, state = made.design.state.eyes(), made.design.state
    i = made.design.palette.index(("shell", "day"))[0]
    Lab = [eye.Lab(state.linear(eyes)[i, j]) for j, eye in enumerate(eyes)]
    assert max(delta_E_2000(Lab[0], other) for other in Lab[1:]) < 1.0
    assert figures(made, "day")["shell"] < 5.0


def test_under_two_groups_of_lights_it_is_hidden_from_each() -> None:
    groups = vs.Scene.load(Path(__file__).resolve().parents[2] / "data/scenes/engine-groups.toml")
    name = next(light.name for light in groups.lights if len(light.rig.lights) > 1)
    made = vs.hide(groups, "inserts", under=name)
    state = made.design.state
    rows = [
        made.design.palette.index((m, made.design.palette.names[1][0]))[0]
        for m in ("inserts", "block")
    ]
    own = [j for j, column in enumerate(made.design.palette.names[1]) if column.startswith(name)]
    assert len(own) == 2
    inserts, block = (state.linear(state.eyes())[i, own] for i in rows)
    assert np.abs(inserts - block).max() < 1e-3


def test_a_basis_too_coarse_for_the_design_gives_way_to_the_materials(trained: vs.Scene) -> None:
    coarse = vs.Scene.load(trained.path, {"size": 3})
    made = vs.hide(coarse, "core", under="lamp", within="shell")
    assert made.changes.exact and made.scene.file.basis.method == "materials"
    assert made.delta_e("lamp", "core", "shell") < 1.0


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (
            lambda s: vs.hide(s, "cor", under="day"),
            r"no material is named 'cor'; did you mean 'core'",
        ),
        (
            lambda s: vs.hide(s, "core", under="dya"),
            r"no light of the scene is named 'dya'; did you",
        ),
        (lambda s: vs.hide(s, "core", under="day", within="core"), r"cannot hide in itself"),
        (lambda s: vs.hide(s, "core", under="day", like="lamp"), r"named 'day' already"),
        (lambda s: vs.hide(s, "core", under="day", lamps=("A",)), r"lamps A are for a new light"),
        (lambda s: vs.merge(s, ["core"], under="day"), r"core alone cannot be merged"),
        (lambda s: vs.merge(s, ["core", "shell"], under="day", colours=[(1, 0, 0)]), r"1 colours"),
        (lambda s: vs.reveal(s, "core", under="day", distance=-1), r"distance is -1"),
    ],
)
def test_bad_wishes_are_told_in_a_line(scene: vs.Scene, ask: object, said: str) -> None:
    with pytest.raises(SceneError, match=said) as caught:
        ask(scene)
    assert "\n" not in str(caught.value)


def test_one_material_alone_has_nothing_to_hide_in(scene: vs.Scene) -> None:
    rows = scene.file.material[:1]
    points = [p.model_copy(update={"material": "shell"}) for p in scene.file.transfer.points or ()]
    transfer = scene.file.transfer.model_copy(update={"points": points})
    alone = vs.Scene(
        scene.file.model_copy(update={"material": rows, "transfer": transfer}), scene.path
    )
    with pytest.raises(SceneError, match="'shell' is the only material"):
        vs.hide(alone, "shell", under="day")


def test_a_constant_colour_that_cannot_be_is_refused(scene: vs.Scene) -> None:
    rows = [
        row.model_copy(update={"spectrum": text})
        for row, text in zip(scene.file.light, ("D65", "LED-B1", "HP1"), strict=True)
    ]
    viewing = scene.file.viewing.model_copy(update={"model": "none"})
    coloured = vs.Scene(
        scene.file.model_copy(update={"light": rows, "viewing": viewing}), scene.path
    )
    with pytest.raises(PaletteError, match="no colour near that of 'core' is the same under"):
        vs.keep(coloured, "core")


def test_more_than_can_be_reached_is_told_with_what_can(scene: vs.Scene) -> None:
    with pytest.raises(
        PaletteError, match=r"'core' comes no further than ΔE [\d.]+ .*100 is asked"
    ):
        vs.reveal(scene, "core", under="day", distance=100)
