"""Write relighting recipes for compositors: a script for Blender, a group of nodes for Nuke.

EXR header -> [recipes] -> FILE.py | FILE.nk
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from volspec._exr import read_exr
from volspec._files import write_whole
from volspec._gpu.sources import asset
from volspec.errors import ImageError, visible
from volspec.export.compositing import Recipe

SUFFIXES = (".py", ".nk")


def write_recipe(path: Path, image: Path) -> None:
    """Write a recipe that relights an image in Blender (``.py``) or Nuke (``.nk``).

    The image is a coefficient image with lights in its header.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ImageError(
            f"{path}: is not the recipe of a known compositor",
            "name it .py for Blender or .nk for Nuke",
            code="unknown",
        )
    recipe, place = Recipe.load(image), image.resolve()
    read_exr(image, ImageError, again="render the scene again")  # the header alone may be intact
    is_nuke = path.suffix.lower() == ".nk"
    text = nuke_group(recipe, place) if is_nuke else blender_script(place)
    with write_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def blender_script(image: Path) -> str:
    """Return the shipped script with an image's path filled in."""
    text = asset("data/compositing/blender.py").read_text(encoding="utf-8")
    return text.replace('IMAGE = "IMAGE.exr"', f"IMAGE = {python_text(str(image))}")


def python_text(text: str) -> str:
    """Return text as a Python literal, which is also JSON if all characters are printable.

    >>> print(python_text('a "b" \\n [é]'), python_text("\u202e"))
    "a \\"b\\" \\n [é]" "\\u202e"
    """
    literal = json.dumps(text, ensure_ascii=False)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in literal)


def nuke_group(recipe: Recipe, image: Path) -> str:
    """Return nodes to paste: the image, and a group with one knob per light weight.

    The format is that of Nuke's scripts; an Expression node sums the lights.
    """
    weights = list(_weights(recipe))
    knobs = [
        line
        for number, (light, group) in enumerate(weights, start=1)
        for line in (
            f" addUserKnob {{7 weight{number} l {tcl_word(_label(recipe, light, group))} R 0 4}}",
            f" weight{number} {float(light == weights[0][0]):g}",
        )
    ]
    sums = {light: recipe.sums(light) for light in recipe.lights}
    expressions = [
        "+".join(
            f"parent.weight{number}*{sums[light][row][group]}"
            for number, (light, group) in enumerate(weights, start=1)
        )
        for row in range(3)
    ]
    return "\n".join(
        (
            "Read {",
            " inputs 0",
            " file_type exr",
            f" file {tcl_word(_nuke_path(image))}",
            " name volspec_image",
            "}",
            "Group {",
            " name volspec_relight",
            " addUserKnob {20 lights}",
            *knobs,
            "}",
            " Input {",
            "  inputs 0",
            "  name Input1",
            " }",
            " Expression {",
            *(f"  expr{row} {tcl_word(text)}" for row, text in enumerate(expressions)),
            "  name sums",
            " }",
            " Output {",
            "  name Output1",
            " }",
            "end_group",
            "",
        )
    )


def _weights(recipe: Recipe) -> Iterator[tuple[str, str]]:
    """Yield the (light, group) of every weight."""
    for name, light in recipe.lights.items():
        for group in light.matrices:
            yield name, group


def _label(recipe: Recipe, light: str, group: str) -> str:
    """Return a knob's label without brackets, which Nuke evaluates even in quotes."""
    text = f"{light}: {group}" if len(recipe.channels) > 1 else light
    # Braces count even inside quotes.
    return visible(" ".join(text.split())).translate(str.maketrans("{}[]\\", "()()/"))


def _nuke_path(image: Path) -> str:
    text = image.as_posix()
    if set(text) & set("[]") or visible(text) != text:
        raise ImageError(
            f"{image}: Nuke would evaluate brackets in a path, and accepts neither control "
            "characters nor bytes that are not UTF-8",
            "rename the file or its folder",
            code="unsupported",
        )
    return text


def tcl_word(text: str) -> str:
    """Return text as a single Tcl word, also inside braces: braces in the text do not count.

    >>> print(tcl_word('a "b" {$c} [d]'))
    "a \\"b\\" \\{\\$c\\} \\[d\\]"
    """
    return '"' + re.sub(r'([\\"\[\]{}$])', r"\\\1", text) + '"'
