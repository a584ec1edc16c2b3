"""Write relighting recipes for compositors: a script for Blender, a group of nodes for Nuke.

EXR header -> [recipes] -> FILE.py | FILE.nk
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple, Self

from volspec._exr import read_exr
from volspec._files import write_whole
from volspec._gpu import asset
from volspec.errors import ImageError, visible
from volspec.export.compositing import Recipe
from volspec.image import BEND, CASTS, MAX_EXPONENT, OCCLUSION_GAIN, Slot, layer_names

RECIPE_SUFFIXES = (".py", ".nk")
# Tcl's brackets, braces, quotes and variables; HTML's tags and entities; @ for icons.
_IN_LABELS = str.maketrans('{}[]<>\\"$&@', "()()()/'_+_")
_DIGITS = 9  # significant digits in expressions, as in a header


def write_recipe(path: Path, image: Path) -> None:
    """Write a recipe that relights an image in Blender (``.py``) or Nuke (``.nk``).

    The image is a coefficient image with lights in its header.
    """
    if path.suffix.lower() not in RECIPE_SUFFIXES:
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

    The format is that of Nuke's scripts; an Expression node sums the lights. If the image has
    layers of opacity, each material has a knob, and each layer a further node; with shadows, two
    nodes for each light group.
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
    knobs += [
        line
        for number, material in enumerate(recipe.materials if recipe.layers else (), start=1)
        if material in recipe.fades
        for line in (
            f" addUserKnob {{7 opacity{number} l {tcl_word(_plain_label(material))} R 0 4}}",
            f" opacity{number} 1",
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
    nodes = _expression_node("sums", expressions)
    if recipe.layers:
        nodes = list(_layer_nodes(recipe, weights, expressions))
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
            *nodes,
            " Output {",
            "  name Output1",
            " }",
            "end_group",
            "",
        )
    )


def _expression_node(
    name: str, expressions: Sequence[str], variables: Mapping[str, str] | None = None
) -> list[str]:
    """Return the lines of an Expression node within a group."""
    variables = variables or {}
    return [
        " Expression {",
        *(f"  temp_name{n} {name}" for n, name in enumerate(variables)),
        *(f"  temp_expr{n} {tcl_word(text)}" for n, text in enumerate(variables.values())),
        *(f"  expr{row} {tcl_word(text)}" for row, text in enumerate(expressions)),
        f"  name {name}",
        " }",
    ]


def _layer_nodes(
    recipe: Recipe, weights: Sequence[tuple[str, str]], expressions: Sequence[str]
) -> Iterator[str]:
    """Yield the lines of nodes that recompose the picture, as `CoefficientImage.recompose`.

    The first holds the part of the picture that is left; each further one adds the difference
    between a layer with other opacities and that part of the layer as it was cast.
    """
    groups, materials = list(recipe.channels), list(recipe.materials.values())
    knobs = [
        f"parent.opacity{number}" if material in recipe.fades else "1"
        for number, material in enumerate(recipe.materials, start=1)
    ]
    kept = f"sqrt(min(1,{','.join(knobs)}))"  # `residual_share`
    yield from _expression_node(
        "kept", [*(f"{kept}*({text})" for text in expressions), f"{kept}*a"]
    )
    mixed = _mix_factors(recipe, weights)
    in_front: tuple[list[str], list[str]] = [], []
    for layer in range(recipe.layers):
        names = [*map(_nuke_name, layer_names(layer, materials, groups, recipe.shadows))]
        K, G = len(materials), len(groups)
        tau, shade, gloss = names[:K], names[K : K + K * G], names[K + K * G :][:G]
        fades = not (recipe.solid and layer == recipe.layers - 1)
        own_knobs = knobs if fades else ["1"] * K
        scaled = [f"{knob}*{name}" for knob, name in zip(own_knobs, tau, strict=True)]
        seen = [
            _layer_text(before, depth)
            for before, depth in zip(in_front, (scaled, tau), strict=True)
        ]
        for before, depth in zip(in_front, (scaled, tau), strict=True):
            before += depth
        if recipe.shadows:
            layered = _Shaded.of(names, recipe)
            yield from layered.nodes(f"layer{layer}", "+", seen[0], scaled, knobs, mixed)
            was_seen = f"{kept}*({seen[1]})"
            as_cast = f"layer{layer}_as_cast"
            yield from layered.nodes(as_cast, "-", was_seen, tau, ["1"] * K, mixed)
            continue
        variables = {
            "seen": seen[0],
            "part": f"({seen[0]})/max({'+'.join(scaled)},1e-12)",
            "was_seen": f"{kept}*({seen[1]})",
            "was_part": f"{kept}*({seen[1]})/max({'+'.join(tau)},1e-12)",
        }
        rows = []
        for row, colour in enumerate("rgb"):
            terms = [colour]
            for k, (knob, name) in enumerate(zip(own_knobs, tau, strict=True)):
                light = "+".join(
                    f"{mixed[row][group][k]}*{shade[g * K + k]}"
                    for g, group in enumerate(groups)
                    if group in mixed[row]
                )
                terms.append(f"(part*{knob}-was_part)*{name}*({light})")
            light = "+".join(
                f"{mixed[row][group][K]}*{gloss[g]}"
                for g, group in enumerate(groups)
                if group in mixed[row]
            )
            rows.append("+".join([*terms, f"(seen-was_seen)*({light})"]))
        yield from _expression_node(f"layer{layer}", [*rows, "a+seen-was_seen"], variables)
    yield from _expression_node("recomposed", ["r", "g", "b", "min(max(a,0),1)"])


class _Shaded(NamedTuple):
    """Channels of a layer's light with shadows: of light groups, and by `Slot`."""

    shade: dict[str, list[str]]
    gloss: dict[str, str]
    shadows: dict[Slot, list[str]]

    @classmethod
    def of(cls, names: Sequence[str], recipe: Recipe) -> Self:
        """Return the channels of names in the order of `layer_names`."""
        remaining, K = iter(names), len(recipe.materials)
        _, *shades = ([*islice(remaining, K)] for _ in range(1 + len(recipe.channels)))
        shade = dict(zip(recipe.channels, shades, strict=True))
        gloss = {group: next(remaining) for group in recipe.channels}
        return cls(shade, gloss, {slot: [*islice(remaining, 3 + K)] for slot in recipe.shadows})

    def nodes(
        self,
        name: str,
        sign: str,
        seen: str,
        scaled: Sequence[str],
        scales: Sequence[str],
        mixed: Sequence[Mapping[str, Sequence[str]]],
    ) -> Iterator[str]:
        """Yield the lines of a node for each group, which adds or subtracts its light.

        ``scaled`` are the layer's own depths, ``scales`` those of depths on the way to the lights.
        """
        part = f"({seen})/max({'+'.join(scaled)},1e-12)"
        for number, (group, shade) in enumerate(self.shade.items()):
            variables, kept = {"seen": seen, "part": part}, ["1", "1"]
            for (of_group, occluded), (part_lit, part_gloss, bend, *depths) in self.shadows.items():
                if of_group == number:
                    cast = CASTS[occluded]
                    variables[cast] = _shadow(bend, depths, scales, occluded)
                    parts = zip(kept, (part_lit, part_gloss), strict=True)
                    kept = [f"{left}-{taken}*{cast}" for left, taken in parts]
            rows = []
            for colour, factors in zip("rgb", mixed, strict=True):
                if group not in factors:  # unlit
                    rows.append(colour)
                    continue
                *reflected, white = factors[group]
                terms = zip(scaled, reflected, shade, strict=True)
                reflected_light = "+".join("*".join(term) for term in terms)
                bright = f"{white}*{self.gloss[group]}"
                rows.append(
                    f"{colour}{sign}part*({reflected_light})*({kept[0]}){sign}seen*{bright}*({kept[1]})"
                )
            alpha = "a" if number else f"a{sign}seen"
            yield from _expression_node(f"{name}_group{number}", [*rows, alpha], variables)


def _shadow(bend: str, depths: Sequence[str], scales: Sequence[str], occluded: bool) -> str:
    """Return the expression of the light that shadows or occlusion take, as `transmittance`."""
    bend = f"max({bend},{BEND[0]:g})"
    terms = zip(scales, depths, strict=True)
    grown = "+".join(f"{s}*(exp(min({bend}*{E},{MAX_EXPONENT:g}))-1)" for s, E in terms)
    gain = OCCLUSION_GAIN if occluded else 1
    return f"1-min(1,{gain:g}*exp(-log(1+{grown})/{bend}))"


def _mix_factors(recipe: Recipe, weights: Sequence[tuple[str, str]]) -> list[dict[str, list[str]]]:
    """Return for R, G and B the factor of each channel of each group: lights times weights."""
    rows = []
    for row in range(3):
        factors: dict[str, list[str]] = {}
        for group, names in recipe.channels.items():
            terms = [
                (f"parent.weight{number}", recipe.lights[light].matrices[group][row])
                for number, (light, lit_group) in enumerate(weights, start=1)
                if lit_group == group
            ]
            if terms:
                factors[group] = [
                    f"({'+'.join(f'{knob}*({M[k]:.{_DIGITS}g})' for knob, M in terms)})"
                    for k in range(len(names))
                ]
        rows.append(factors)
    return rows


def _layer_text(before: Sequence[str], depths: Sequence[str]) -> str:
    """Return the expression of a layer's visibility behind others, from optical depths."""
    front = f"exp(-({'+'.join(before)}))" if before else "1"
    return f"{front}*(1-exp(-({'+'.join(depths)})))"


def _nuke_name(channel: str) -> str:
    """Return a channel's name in Nuke, which knows three parts.

    >>> _nuke_name("l3.tau.block.V"), _nuke_name("key.c00.V")
    ('l3_tau.block_V', 'key_c00.V')
    """
    layer, part, channel_rest = channel.split(".", 2)
    return f"{layer}_{part}.{channel_rest.replace('.', '_')}"


def _weights(recipe: Recipe) -> Iterator[tuple[str, str]]:
    """Yield the (light, group) of every weight."""
    for name, light in recipe.lights.items():
        for group in light.matrices:
            yield name, group


def _label(recipe: Recipe, light: str, group: str) -> str:
    """Return the label of a weight's knob."""
    return _plain_label(f"{light}: {group}" if len(recipe.channels) > 1 else light)


def _plain_label(text: str) -> str:
    """Return a knob's label without what Nuke evaluates, even in quotes, and marks of HTML."""
    return visible(" ".join(text.split())).translate(_IN_LABELS)


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
