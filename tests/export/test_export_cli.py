"""``volspec export``: exit codes, one line for what is wrong, figures for machines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.export.conftest import Make
from volspec.cli import main
from volspec.export.compositing import Recipe, save_for_compositors


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["export", *map(str, words)])
    return int(caught.value.code or 0)


def test_the_command_makes_frames_and_tells_of_them(
    scene: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = scene().path, tmp_path / "out"
    words = (path, "-o", out, "--size", "16x12", "--turntable", 2, "--light", "day", "--json")
    assert run(*words) == 0
    made = json.loads(capsys.readouterr().out)
    assert (made["frames"], made["made"], made["casts"]) == (2, 2, 2)
    assert all((out / name).is_file() for name in made["files"])
    assert run(*words[:-1]) == 0
    assert capsys.readouterr().out.strip().endswith("2 frames, 0 made from 0 casts; 2 were there")


def test_a_light_of_the_scene_is_told_to_be_relit_from_the_scene(
    scene: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, image = scene(), tmp_path / "ball.exr"
    lights = {light.name: light.rig for light in made.lights}
    recipe = Recipe.of(made.basis, made.raycast.shares(), lights)
    save_for_compositors(made.render(size=(8, 6)), image, recipe)
    with pytest.raises(SystemExit, match="1"):
        main(["relight", str(image), "--light", "lamp", "-o", str(tmp_path / "lamp.png")])
    (line,) = capsys.readouterr().err.splitlines()
    assert "ball.exr names its scene's lights (day, lamp, tube), but does not hold" in line
    assert "volspec export SCENE.toml --light lamp -o FOLDER" in line
    # The library has a name near to the second, LPS, as well.
    for text, name in (("daay", "day"), ("lmap", "lamp")):
        with pytest.raises(SystemExit, match="1"):
            main(["relight", str(image), "--light", text, "-o", str(tmp_path / "lamp.png")])
        (line,) = capsys.readouterr().err.splitlines()
        assert f"light {text!r}: did you mean {name!r}?" in line
        assert "--light NAME -o FOLDER" in line


def test_a_page_of_lights_without_the_lux_they_need_is_refused_before_the_cast(
    scene: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene('[viewing]\nlevel = "absolute"\n').path
    words = ["page", str(path), "-o", str(tmp_path / "ball.html")]
    with pytest.raises(SystemExit, match="1"):
        main(words)
    said = capsys.readouterr().err
    assert "[[light]] day: has no illuminance_lux" in said and "cast" not in said
    lit = path.read_text(encoding="utf-8").replace("spectrum", "illuminance_lux = 90\nspectrum")
    path.write_text(lit, encoding="utf-8")
    with pytest.raises(SystemExit, match="1"):
        main([*words, "--light", "FL11"])
    said = capsys.readouterr().err
    assert "--light FL11: has no lux" in said and "cast" not in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--light", "dya"], 1, "no [[light]] is named 'dya'; did you mean 'day'"),
        (["--turntable", "0"], 1, "--turntable is 0; "),
        (["--turntable", "1.5"], 1, "1.5"),
        (["--fps", "nan"], 1, "--fps is nan; "),
        (["--size", "16"], 1, "no WIDTHxHEIGHT"),
        (["--size", "-5x5"], 1, "'-5x5' is no WIDTHxHEIGHT"),
        (["--light"], 2, "export: --light has no value; give one"),
        (["--size", "99999x16"], 1, "give 1x1 to 65536 a side"),
        (["--bits", "12"], 1, "--bits is 12; "),
    ],
)
def test_bad_input_is_one_line(
    scene: Make,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    code: int,
    said: str,
) -> None:
    assert run(scene().path, "-o", tmp_path / "out", *words) == code
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("volspec:")]
    assert len(lines) == 1 and said in lines[0]
    assert not (tmp_path / "out").exists()
