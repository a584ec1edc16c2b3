"""docs/scenes.md and the scenes that ship: every key with its default, every example a scene."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic_core import PydanticUndefined

from volspec import _tables as shared
from volspec.pipeline import Relighter
from volspec.relight import RelightSpec
from volspec.scene import Scene, SceneFile, export, spectra, tables, transfer
from volspec.scene import lights as light_tables
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    TransferFunction,
    TransferFunction2D,
)

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
SECTIONS: dict[str, type[shared.Table]] = {
    "Top of the file": SceneFile,
    "`[volume]`": tables.VolumeTable,
    "`[[material]]`": tables.MaterialTable,
    "numbers": spectra.SpectrumTable,
    "`[transfer]`": transfer.TransferTable,
    "points": transfer.PointTable,
    "regions": transfer.RegionTable,
    "labels": transfer.LabelTable,
    "`[basis]`": tables.BasisTable,
    "`[camera]`": tables.CameraTable,
    "`[raycast]`": tables.RaycastTable,
    "clip_planes": tables.PlaneTable,
    "`[[group]]`": light_tables.GroupTable,
    "ambient": light_tables.AmbientTable,
    "headlight": light_tables.HeadlightTable,
    "directional": light_tables.DirectionalTable,
    "point": light_tables.PointLightTable,
    "`[[light]]`": light_tables.LightTable,
    "`[viewing]`": tables.ViewingTable,
    "`[viewing.display]`": shared.DisplayTable,
    "space": shared.SpaceTable,
    "transfer of a space": shared.CurveTable,
    "`[output]`": tables.OutputTable,
    "`[export]`": export.ExportTable,
    "turntable": export.TurntableTable,
    "sweep": export.SweepTable,
    "`[[keyframe]]`": export.KeyframeTable,
    "camera of a keyframe": export.KeyCameraTable,
    "transfer of a keyframe": export.KeyTransferTable,
    "viewing of a keyframe": export.KeyViewingTable,
}


def section(title: str) -> str:
    found = re.search(rf"^##+ {re.escape(title)}\n(.*?)(?=^##|\Z)", TEXT, re.DOTALL | re.MULTILINE)
    assert found, title
    return found[1]


def all_tables(kind: Any) -> set[type[shared.Table]]:
    """A scene's table and all that can stand in it."""
    found = {kind} if isinstance(kind, type) and issubclass(kind, shared.Table) else set()
    fields = kind.model_fields.values() if found else ()
    inner = [*get_args(kind), *(field.annotation for field in fields)]
    return found.union(*(all_tables(each) for each in inner))


def test_every_table_has_its_section() -> None:
    assert set(SECTIONS.values()) == all_tables(SceneFile)


@pytest.mark.parametrize("title", SECTIONS)
def test_every_key_is_told_with_its_default(title: str) -> None:
    told = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", section(title), re.MULTILINE))
    fields = SECTIONS[title].model_fields
    assert set(told) == set(fields)
    for key, field in fields.items():
        if field.is_required():
            assert told[key] == "needed", key
        elif isinstance(field.default, str | int | float | tuple):
            # As TOML has it: words instead of code stand for what is worked out.
            value = tomllib.loads(f"x = {told[key].strip('`')}")["x"]
            assert (tuple(value) if isinstance(value, list) else value) == field.default, key
        else:
            assert told[key] and "`" not in told[key], key
            assert field.default in (None, PydanticUndefined) or title == "Top of the file", key


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the examples stand: beside data/, and the segmentation that the text makes."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "data").symlink_to(ROOT / "data")
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(code, {})
    return folder


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_every_example_casts_into_a_picture(folder: Path, number: int) -> None:
    path = folder / "example.toml"
    path.write_text(EXAMPLES[number], encoding="utf-8")
    scene = Scene.load(path)
    image = scene.render(size=(48, 48))
    assert image.alpha.max() > 0.5
    with Relighter(image) as relighter:
        frame = relighter.frame(scene.lights[0].rig, scene.relight.viewing)
    assert frame.std() > 5


def test_there_is_an_example_of_each_kind_of_transfer_function(folder: Path) -> None:
    kinds = set()
    for text in EXAMPLES:
        (folder / "kind.toml").write_text(text, encoding="utf-8")
        kinds.add(type(Scene.load(folder / "kind.toml").transfer))
    assert kinds == {TransferFunction, TransferFunction2D, LabelFunction, Isosurfaces}


# Of the figure-… scenes some lights hide what is there: tests/palette/test_figure_scenes.py.
@pytest.mark.parametrize("path", sorted((ROOT / "data" / "scenes").glob("engine*.toml")), ids=str)
def test_scenes_that_ship_are_neither_dark_nor_washed_out(path: Path) -> None:
    scene = Scene.load(path)
    image = scene.render(size=(128, 128))
    viewing, relit = scene.relight.viewing, scene.relight
    with Relighter(image) as relighter:
        for light in scene.lights:
            frame = relighter.frame(light.rig, RelightSpec(viewing, relit.mode, relit.backdrop))
            shown = frame[image.alpha > 0.5]
            assert 60 < shown.mean() < 190, light.name
            assert np.mean(shown == 255) < 0.02, light.name
            assert shown.std() > 12, light.name
