"""Which basis a scene is cast with, and why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from volspec.basis import MaterialBasis, SpectralBasis
from volspec.errors import SceneError
from volspec.scene import Scene
from volspec.scene.basis import use_of
from volspec.scene.tables import PointTable

ROOT = Path(__file__).resolve().parent.parent
SCENE = """
[volume]
file = "none.nrrd"
[[material]]
name = "block"
reflectance = "{block}"
[[material]]
name = "part"
reflectance = "copper"
[transfer]
points = [
    {{ value = 0, opacity = 0, material = "block" }},
    {{ value = 9, opacity = 1, material = "part" }},
]
[[light]]
name = "day"
spectrum = "D65"
[[light]]
name = "lamp"
spectrum = "{lamp}"
{basis}
"""


def scene(
    tmp_path: Path, basis: str = "", block: str = "ColorChecker/cyan", lamp: str = "A"
) -> Scene:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(block=block, basis=basis, lamp=lamp))
    return Scene.load(path)


def test_plain_spectra_take_the_general_basis(tmp_path: Path) -> None:
    found = scene(tmp_path)
    assert found.basis.name == "general-7"
    assert "general-7 is off by at most" in found.basis_reason


@pytest.mark.parametrize("size", [5, 9])
def test_a_size_takes_the_general_basis_of_that_size(tmp_path: Path, size: int) -> None:
    assert scene(tmp_path, f"[basis]\nsize = {size}").basis.name == f"general-{size}"


def test_spectra_that_the_general_basis_does_not_hold_are_trained_for(tmp_path: Path) -> None:
    """The engine's metameric pair oscillates; no note says so in this copy of it."""
    text = (ROOT / "data/spectra/engine-inserts.csv").read_text()
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    (tmp_path / "wave.csv").write_text("\n".join(rows))
    found = scene(tmp_path, block="wave.csv", lamp="FL11")
    assert found.basis.name == "scene"
    assert "general-7 is off by at most ΔE00" in found.basis_reason
    assert "wave" in found.basis_reason
    worst = found.basis.report(
        [row.spectrum for row in found.lights], list(found.materials.values())
    )
    assert worst.componentwise.max < 0.5


def test_a_designed_spectrum_is_trained_for(tmp_path: Path) -> None:
    (tmp_path / "made.csv").write_text("# designed: yes\n380,0.2\n500,0.4\n780,0.3\n")
    found = scene(tmp_path, block="made.csv")
    assert found.basis.name == "scene" and found.basis_reason == "made came from a designer"


def test_a_scene_may_name_ask_or_make_its_materials_the_channels(tmp_path: Path) -> None:
    assert scene(tmp_path, '[basis]\nname = "general-5"').basis.name == "general-5"
    own = scene(tmp_path, '[basis]\ntrain = "scene"\nsize = 5')
    assert own.basis.name == "scene" and own.basis.size == 5
    fine = scene(tmp_path, "[basis]\ngrid_nm = [380, 730, 5]\nobserver_deg = 10\nsize = 5")
    assert isinstance(fine.basis, SpectralBasis)
    assert fine.basis.grid.size == 71 and fine.basis.observer_deg == 10
    materials = scene(tmp_path, '[basis]\nmethod = "materials"').basis
    assert isinstance(materials, MaterialBasis) and list(materials.materials) == ["block", "part"]


def test_other_settings_are_tried_without_writing_them(tmp_path: Path) -> None:
    path = scene(tmp_path, "[basis]\nsize = 5").path
    assert isinstance(Scene.load(path, {"method": "materials"}).basis, MaterialBasis)
    found = Scene.load(path, {"positive": True}).basis
    assert isinstance(found, SpectralBasis) and found.size == 5
    assert np.all(found.analysis >= 0)
    with pytest.raises(SceneError, match=r"scene\.toml: basis\.size"):
        Scene.load(path, {"size": 99})


@pytest.mark.parametrize(
    ("basis", "message"),
    [
        ('name = "general-7"\nsize = 5', "give name .* or size, not both"),
        ('method = "materials"\nsize = 5', "makes each material a channel"),
        ('name = "general-8"', "general-8.*general-7"),
        ('method = "magic"', "method"),
        ("observer_deg = 4", "observer_deg"),
        ("grid_nm = [400, 705, 10]", "grid 400-705/10"),
    ],
)
def test_wishes_that_do_not_fit_are_named(tmp_path: Path, basis: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(tmp_path, "[basis]\n" + basis)


def test_use_is_opacity_over_values_and_none_is_forgotten() -> None:
    """Triangle of height 1 over 10 for the one, a hundredth of it for the other."""
    points = [
        PointTable(value=0, opacity=0, material="a"),
        PointTable(value=10, opacity=1, material="a"),
        PointTable(value=10, opacity=0.01, material={"b": 1.0}),
        PointTable(value=20, opacity=0.01, material="b"),
    ]
    assert use_of(points) == {"a": 1.0, "b": 0.1}
