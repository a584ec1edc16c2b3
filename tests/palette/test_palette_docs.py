"""docs/palettes.md: every key with its default, the example a palette that works."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import volspec as vs

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/palettes.md").read_text(encoding="utf-8")


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
