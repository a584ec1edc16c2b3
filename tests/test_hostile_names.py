"""Names from files in generated programs: each is text there, and none of it runs."""

import ast
import io
import re
import sys
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.table import Table

from tests.support.viewer import opened
from volspec._figures import write
from volspec._toml import key_text, toml_text
from volspec.basis import SpectralBasis
from volspec.cli.shell import Terminal
from volspec.errors import ImageError
from volspec.export.compositing import Recipe
from volspec.export.recipes import blender_script, nuke_group, python_text
from volspec.palette import load_palette, save_palette
from volspec.spectra import light
from volspec.viewer.model.scene_file import export_python

# Each leaves a mark where it is run: Tcl calls `hurt`, Python sets `hurt`, TOML gets a key `hurt`.
HOSTILE = (
    "[hurt]",
    '"; hurt; "',
    "} ; hurt ; {",
    "}\nhurt\n{",
    "\\[hurt\\]",
    "$x([hurt])",
    '"""; hurt = 1; """',
    "'; hurt = 1; '",
    "\\",
    '\\"; hurt = 1 #',
    "{hurt}",
    "a = 1\n[hurt]",
    "a\r\nhurt = 1",
    "\u202e\u2066hurt",
    "\x00\x1b]0;hurt\x07\x7f\x85\u2028",
    "[red]hurt[/red] [link=http://hurt]x[/link] :skull:",
    "$\\frac{1}{",
    '<b>hurt</b><img src="/hurt.png">&lt;a href="hurt"&gt;@hurt;',
    "größer 骨 😀",
)
SHARES = {"key": 0.7, "sky [hurt] {": 0.3}


def recipe() -> Recipe:
    lights = {name: light("D65") for name in HOSTILE}
    return Recipe.of(SpectralBasis.load("general-5"), SHARES, lights)


def test_real_tcl_reads_nuke_s_group_and_runs_no_name():
    tkinter = pytest.importorskip(
        "tkinter", reason="Tcl comes with tkinter: apt install python3-tk"
    )
    tcl = tkinter.Tcl()
    tcl.eval("set ::hurt 0; proc hurt {args} {incr ::hurt}; set ::words {}")
    tcl.eval("rename file {}; proc unknown {args} {lappend ::words $args}")
    for node in ("Read", "Input", "Expression", "Output"):
        tcl.eval(f"proc {node} {{body}} {{eval $body}}")
    tcl.eval("proc Group {body} {eval $body}")
    tcl.eval(nuke_group(recipe(), Path("/a {$c\"' ; hurt.exr")))
    words = [tcl.splitlist(each) for each in tcl.splitlist(tcl.eval("set ::words"))]
    knobs = [tcl.splitlist(each[1]) for each in words if each[0] == "addUserKnob"]
    knobs = [each[3] for each in knobs if each[0] == "7"]
    assert len(knobs) == len(HOSTILE) * len(SHARES)
    assert knobs[0] == "(hurt): key" and knobs[-1] == "größer 骨 😀: sky (hurt) ("
    assert not set("".join(knobs)) & set('[]{}<>&"\\$@')
    # Nuke evaluates labels, expressions and file names once more.
    for each in words:
        for word in each[1:]:
            tcl.call("subst", "-novariables", word)
    assert [each[1] for each in words if each[0] == "file"] == ["/a {$c\"' ; hurt.exr"]
    assert tcl.eval("set ::hurt") == "0"


def with_channel(name: Any) -> None:
    made = recipe()
    replace(made, channels={**made.channels, "key": (name,) * 5})


PATHS = ("/a[hurt].exr", "/a\nb.exr", "/a\udcff.exr")
CHANNELS = ("a[hurt].c00.V", "key.c00.V+hurt()", "", "key.c00", 3)


@pytest.mark.parametrize(
    "make",
    [
        *(partial(nuke_group, recipe(), Path(each)) for each in PATHS),
        *(partial(with_channel, each) for each in CHANNELS),
    ],
)
def test_paths_and_channels_that_would_run_are_refused(make):
    with pytest.raises(ImageError):
        make()


@pytest.mark.parametrize("name", [*HOSTILE, "\udcff\ud800"])
def test_python_reads_a_literal_as_the_name_and_can_be_printed(name):
    literal = python_text(name)
    assert ast.literal_eval(literal) == name
    assert literal.isprintable() and literal.encode()
    assert ast.literal_eval(f'"""{literal[1:-1]}."""') == f"{name}."


def test_blender_s_script_holds_its_path_as_text():
    for name in HOSTILE:
        tree = ast.parse(blender_script(Path("/", name.replace("/", "|"))))
        [given] = [
            node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "IMAGE"
        ]
        assert ast.literal_eval(given) == f"/{name.replace('/', '|')}"


def test_blender_s_script_ends_at_a_header_that_does(tmp_path, monkeypatch):
    (tmp_path / "i.exr").write_bytes(b"\x76\x2f\x31\x01\x02\0\0\0volspec")
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace())
    monkeypatch.setattr(sys, "argv", ["blender"])
    with pytest.raises(SystemExit, match=r"i\.exr: its header ends too soon"):
        exec(blender_script(tmp_path / "i.exr"), {})


def test_the_viewer_s_script_finds_its_scene_whatever_it_is_called(tmp_path):
    state = opened(tmp_path)
    for name in HOSTILE:
        document = replace(state.document, file=replace(state.document.file, title=name))
        lights = tuple(replace(row, name=name, label=name) for row in state.lights)
        transfer = state.transfer
        renamed = {f"{key}{name}": spectrum for key, spectrum in transfer.materials.items()}
        points = tuple(
            (value, opacity, {f"{key}{name}": part for key, part in mix.items()})
            for value, opacity, mix in transfer.points
        )
        changed = replace(transfer, materials=renamed, points=points)
        named = replace(state, document=document, lights=lights, transfer=changed)
        script = export_python(named, tmp_path / f"{name.translate({0: None, ord('/'): '|'})}.py")
        text = script.read_text(encoding="utf-8")
        found: dict[str, Any] = {"__file__": str(script)}
        exec(compile(text[: text.index("image = ")], str(script), "exec"), found)
        assert "hurt" not in text and found["scene"].file.title == name
        assert set(renamed) <= set(found["scene"].materials)


@pytest.mark.parametrize("name", HOSTILE)
def test_toml_gives_back_names_in_values_keys_and_tables(name):
    text = f"x = {toml_text(name)}\n{key_text(name)} = 1\ny = {toml_text([{name: name}])}\n"
    assert tomllib.loads(text) == {"x": name, name: 1, "y": [{name: name}]}


def test_a_comment_stays_one_line_of_a_palette(tmp_path):
    palette = load_palette("data/palettes/figure-1.toml")
    for name in HOSTILE:
        save_palette(palette, tmp_path / "p.toml", comment=name)
        data = tomllib.loads((tmp_path / "p.toml").read_text(encoding="utf-8"))
        assert "hurt" not in data and len(data["light"]) == len(palette.lights)


def test_a_terminal_shows_marks_in_names_and_obeys_none():
    sink = io.StringIO()
    console = Terminal(file=sink, force_terminal=True, color_system="truecolor", width=400)
    table = Table(title=HOSTILE[-3])
    for name in HOSTILE:
        table.add_column(name)
    table.add_row(*HOSTILE)
    console.print(table)
    said = sink.getvalue()
    assert "[red]hurt[/red]" in re.sub(r"\x1b\[[0-9;]*m", "", said).replace("\n", "")
    assert "\x1b]" not in said and "💀" not in said and "\x1b[31m" not in said


@pytest.mark.filterwarnings("ignore:text. no installed font")
def test_figures_draw_names_as_they_are_spelt():
    from matplotlib.figure import Figure

    figure = Figure()
    for name in HOSTILE:
        write(figure, 0.5, 0.5, name)
    figure.canvas.draw()
    assert np.isfinite(figure.texts[0].get_window_extent().width)
