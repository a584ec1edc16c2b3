"""``volspec scene``: files checked without being cast; the schema."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from volspec import cli
from volspec.volume import phantom

TEXT = """
[volume]
file = "ball.npy"
[[material]]
name = "shell"
reflectance = "white"
[[material]]
name = "core"
reflectance = "copper"
[transfer]
points = [
    { value = 0.1, opacity = 0.0, material = "shell" },
    { value = 0.6, opacity = 0.4, material = "core" },
]
[[light]]
name = "day"
spectrum = "D65"
"""


@pytest.fixture
def good(tmp_path: Path) -> Path:
    np.save(tmp_path / "ball.npy", phantom.ball(12).values[:, :11, :10])
    return written(tmp_path / "good.toml", TEXT)


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def call(*words: object) -> int:
    with pytest.raises(SystemExit) as caught:
        cli.main(["scene", *map(str, words)])
    return int(caught.value.code or 0)


def test_a_scene_that_is_well_is_one_line(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("check", good) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(
        f"{good}: ok: 2 materials, 1 light, volume 10 × 11 × 12, basis general-7 (general-7 is off"
    )


def test_every_error_is_a_line_that_names_the_file(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = TEXT.replace('"white"', '"whit"').replace('"D65"', '"D56"').replace("ball", "bell")
    lost = written(good.with_name("lost.toml"), text)
    text = TEXT.replace("spectrum", "spectrm").replace("opacity = 0.4", 'opacity = "much"')
    wrong = written(good.with_name("wrong.toml"), text.replace("[volume]", "[camera]"))
    apart = written(good.with_name("apart.toml"), TEXT.replace("0.6", "0.05"))
    none = good.with_name("none.toml")
    unseen = written(good.with_name("unseen.toml"), TEXT + '[viewing]\nsurround = "dimm"\n')
    assert call("check", lost, unseen, wrong, apart, none, good) == 1
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert not said.err
    for line, (path, part) in zip(
        lines,
        [
            (lost, "[[material]] shell: reflectance: reflectance 'whit' is unknown; did you mean"),
            (lost, "[[light]] day: light 'D56' is unknown; did you mean"),
            (lost, f"volume: {good.with_name('bell.npy')}: no such file; check the path"),
            (unseen, "viewing.surround is 'dimm'; did you mean 'dim'"),
            (wrong, "camera.file: unknown key; "),
            (wrong, "[[light]] day: spectrm: unknown key; did you mean 'spectrum'"),
            (wrong, "volume: missing; add [volume]"),
            (wrong, "transfer.points[1].opacity is 'much'; give a number"),
            (apart, "transfer.points[1].value is "),
            (none, "no such file; check the path"),
            (good, "ok: "),
        ],
        strict=True,
    ):
        assert line.startswith(f"{path}: {part}"), line


def test_a_light_without_the_lux_that_the_level_needs_is_an_error(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(good, f'{TEXT}\n[viewing]\nlevel = "absolute"\n')
    assert call("check", good) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"{good}: [[light]] day: has no illuminance_lux, which [viewing] level")


def test_all_that_keyframes_cannot_be_is_told_with_its_time(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = "[[keyframe]]\ntime_s = {}\n{}\n".format
    shaded = '{ value = 0.1, opacity = 5.0, material = "core" }'
    written(
        good,
        TEXT
        + key(0, "")
        + key(1, "camera = { zoom = 1e-300 }")
        + key(2.5, "viewing = { exposure = 1e9, D = 1 }")
        + key(4, "viewing = { exposure = 1, Y_b = 1e9 }")
        + key(6, f"transfer = {{ points = [{shaded}, {shaded}] }}"),
    )
    assert call("check", good) == 1
    lines = capsys.readouterr().out.splitlines()
    for line, part in zip(
        lines,
        [
            "camera: at 1 s: position_mm to target_mm: ",
            "viewing: at 2.5 s: exposure is 1000000000.0; give a number from ",
            "viewing: at 4 s: Y_b is 1000000000.0; give a number from 0 to 2000",
            "transfer: at 6 s: points[0].opacity is 5.0; give 0…1",
        ],
        strict=True,
    ):
        assert line.startswith(f"{good}: [[keyframe]] {part}"), line


def test_what_lies_between_keyframes_is_checked_too(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = "[[keyframe]]\ntime_s = {}\nlights = {{ {} }}\n".format
    lit = '[[light]]\nname = "lit"\nspectrum = "A"\nilluminance_lux = 9\n'
    written(good, TEXT + lit + key(0, "day = 1") + key(1, "lit = 1") + "[export]\nfps = 2\n")
    assert call("check", good) == 1
    absolute = TEXT.replace('"D65"', '"D65"\nilluminance_lux = 9') + lit
    absolute += '[viewing]\nlevel = "absolute"\n'
    written(good, absolute + key(0, "day = 1") + key(1, "lit = 1e300"))
    assert call("check", good) == 1
    mixed, bright = capsys.readouterr().out.splitlines()
    assert mixed.startswith(f"{good}: [[keyframe]] lights: at 0.5 s: day 0.5, lit 0.5: some of")
    assert bright.startswith(f"{good}: [[light]] lit 1e+300 at 1 s: ")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            "illuminance_lux = -5.0\n",
            "[[light]] day: illuminance_lux is -5.0; give a number",
        ),
        (
            "illuminance_lux = 0.0\n",
            "[[light]] day: illuminance_lux: the lights give no light",
        ),
        ("weight = nan\n", "[[light]] day: weight is nan; give a finite number of 0 or more"),
        ("[viewing]\nD = 3.0\n", "viewing.D is 3.0; give a number from 0 to 1, or leave it out"),
        ("[viewing]\nL_A = -1.0\n", "viewing.L_A is -1.0; give a number of 0 or more (cd/m²)"),
        (
            '[viewing]\nmode = "x"\n',
            "viewing.mode is 'x'; give componentwise, exact or",
        ),
        ('[viewing.display]\ngamut = "x"\n', "viewing.display.gamut is 'x'; give clip or reduce"),
        ("[camera]\nzoom = 1e-300\n", "camera: position_mm to target_mm: "),
        ("[export]\nsweep = {}\n", "export.sweep: there is one light; a sweep needs two"),
    ],
)
def test_errors_name_keys_and_no_class_of_python(
    more: str, said: str, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(good, TEXT + more)
    assert call("check", good) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"{good}: {said}") and "None" not in line


def test_names_are_shown_and_never_obeyed(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "a\x1b[31m\u202e\nb größer 骨"
    group = f'[[group]]\nname = {json.dumps(name)}\nsources = [{{ kind = "headlight" }}]\n'
    wrong = written(good.with_name("wrong\x1b[1m.toml"), TEXT + group)
    assert call("check", wrong, good.rename(good.with_name("good\u202e.toml"))) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert "wrong\\x1b[1m.toml: [[group]] a\\x1b[31m\\u202e b größer 骨: " in first
    assert "leave out =, ;, control characters, marks of direction and blanks around it" in first
    assert "good\\u202e.toml: ok: " in second


def test_figures_are_json(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = written(good.with_name("bad.toml"), "volume = 3\n")
    assert call("check", "--json", good, bad) == 1
    first, second = json.loads(capsys.readouterr().out)
    assert first == {
        "path": str(good),
        "ok": True,
        "errors": [],
        "materials": 2,
        "lights": 1,
        "volume": [10, 11, 12],
        "basis": "general-7",
        "reason": first["reason"],
    }
    assert not second["ok"] and len(second["errors"]) == 4
    assert f"{bad}: volume is 3; give a table, {{ key = value, … }}" in second["errors"]


def test_the_schema_is_the_one_that_ships(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("schema") == 0
    shipped = Path(__file__).resolve().parents[2] / "data" / "scenes" / "scene.schema.json"
    assert capsys.readouterr().out == shipped.read_text(encoding="utf-8")
