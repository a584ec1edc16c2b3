"""docs/palettes.md: every key with its default, the example a palette that works."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import volspec as vs
from volspec.palette import tables

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/palettes.md").read_text(encoding="utf-8")
SECTIONS: dict[str, set[type[tables.Table]]] = {
    "Top of the file": {tables.PaletteTable},
    "`[[light]]` and `[[reflectance]]`": {tables.LightTable, tables.ReflectanceTable},
    "`[[cell]]`": {tables.CellTable},
    "`[viewing]`": {tables.ViewingTable},
    "`[criteria]`": {tables.CriteriaTable},
}


@pytest.mark.parametrize("title", SECTIONS)
def test_every_key_is_explained_and_no_other(title: str) -> None:
    _, _, rest = TEXT.partition(f"## {title}\n")
    section = rest.partition("\n## ")[0]
    firsts = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    explained = {key for first in firsts for key in re.findall(r"`(\w+)`", first)}
    assert explained == {key for table in SECTIONS[title] for key in table.model_fields}


def test_the_defaults_are_those_of_the_tables() -> None:
    shown = dict(re.findall(r"^\| `(\w+)` \| `([^`]+)` \|", TEXT, re.MULTILINE))
    del shown["grid_nm"], shown["distance"]  # DEFAULT_GRID and Cell have them
    for key, default in shown.items():
        (owner, *_) = (t for found in SECTIONS.values() for t in found if key in t.model_fields)
        value = owner.model_fields[key].get_default(call_default_factory=True)
        of_cells = {"weight": 1.0, "low": (0.0, 0.0, 0.0), "high": (1.0, 1.0, 1.0)}
        assert json.loads(default) == of_cells.get(key, value), key


def test_the_example_is_a_palette_that_is_met(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    (tmp_path / "example.toml").write_text(example, encoding="utf-8")
    made = vs.design(vs.load_palette(tmp_path / "example.toml"))
    assert vs.DesignReport.of(made).mean < 1


def test_the_code_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, vs.Spectrum] = {}
    exec(code, scope)
    assert scope["split"].designed
