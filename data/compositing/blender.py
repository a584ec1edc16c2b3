"""Relight a volspec image in Blender's compositor (3.3 or newer).

The image's header says which light makes which colours of its channels. This script builds the
sums as nodes of the scene's compositor, with a Value node for the weight of every light (of every
light group where there are several), and one for the opacity of every material if the image has
layers of opacity. Run it in Blender's Text Editor, or

    blender --python FILE.py

The image's path stands below; `-- IMAGE.exr` at the end of the command takes its place.
"""

import json
import struct
import sys
from pathlib import Path

import bpy

IMAGE = "IMAGE.exr"


def header_of(path):
    """Texts and boxes in the header of an OpenEXR file."""
    header = {}
    with open(path, "rb") as file:
        magic, _ = struct.unpack("<II", file.read(8))
        if magic != 20000630:
            raise SystemExit(f"{path}: no OpenEXR file; give a coefficient image of volspec")

        def word():
            letters = b""
            while (letter := file.read(1)) != b"\0":
                if not letter:
                    raise SystemExit(f"{path}: its header ends too soon; render it again")
                letters += letter
            return letters.decode()

        while name := word():
            kind, (size,) = word(), struct.unpack("<i", file.read(4))
            value = file.read(size)
            if kind == "string":
                header[name] = value.decode()
            elif kind == "box2i":
                header[name] = struct.unpack("<4i", value)
    return header


def tree_of(scene):
    """The scene's compositor, emptied."""
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        tree = bpy.data.node_groups.new("volspec", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    return tree


def new(tree, kind, x, y, name=""):
    """A node of a kind, whichever family this Blender has it in."""
    for family in ("Compositor", "Shader", ""):
        if hasattr(bpy.types, f"{family}Node{kind}"):
            node = tree.nodes.new(f"{family}Node{kind}")
            node.location, node.label = (x, y), name
            return node
    raise SystemExit(f"this Blender has no {kind} node")


def math(tree, x, y, operation, *given):
    """The output of a Math node; what is given are numbers or other outputs."""
    node = new(tree, "Math", x, y)
    node.hide = True
    node.operation = operation
    for socket, each in zip(node.inputs, given, strict=False):
        if isinstance(each, (int, float)):
            socket.default_value = each
        elif each is not None:
            tree.links.new(each, socket)
    return node.outputs[0]


def times_plus(tree, x, y, factors, plus=None):
    """The output of a·b, or of a·b + c; each is a number or another output."""
    if plus is None:
        return math(tree, x, y, "MULTIPLY", *factors)
    return math(tree, x, y, "MULTIPLY_ADD", *factors, plus)


def value(tree, y, name, at=0.0):
    """A Value node with a name, and its output."""
    node = new(tree, "Value", 400, y, name)
    node.name = name
    node.outputs[0].default_value = at
    return node.outputs[0]


def grown(tree, x, y, cast):
    """A shadow's parts of the shades and of the highlight, -1/b, and exp(b E) - 1 of each E."""
    bend = math(tree, x, y, "MAXIMUM", cast["bend"], 1e-3)
    found = []
    for depth in cast["depth"]:
        depth = math(tree, x, y - 30, "MULTIPLY", depth, bend)
        depth = math(tree, x, y - 60, "MINIMUM", depth, 80.0)
        depth = math(tree, x, y - 90, "EXPONENT", depth)
        found.append(math(tree, x, y - 120, "SUBTRACT", depth, 1.0))
    power = math(tree, x, y - 150, "DIVIDE", -1.0, bend)
    return (cast["part"], cast["gloss"]), power, found


def unshadowed(tree, x, y, casts, scales):
    """Parts of a group's shades and highlight that shadows leave, 1 - v + v p, or None."""
    kept = [None, None]
    for gain, (parts, power, depths) in casts:
        total = 1.0
        for k, depth in enumerate(depths):
            factors = (depth, scales[k]) if scales else (depth, 1.0)
            total = times_plus(tree, x, y, factors, total)
        through = math(tree, x, y - 30, "POWER", total, power)
        if gain != 1.0:
            through = math(tree, x, y - 60, "MULTIPLY", through, gain)
        through = math(tree, x, y - 90, "MINIMUM", through, 1.0)
        lost = math(tree, x, y - 120, "SUBTRACT", through, 1.0)
        for n, part in enumerate(parts):
            kept[n] = times_plus(tree, x, y - 150, (part, lost), kept[n] or 1.0)
    return kept


def composited(tree, passes, scales, solid, y):
    """Channels of each group and the opacity of layers, near to far, with scales or as cast.

    If solid, the last is of surfaces, which scales leave as they are.
    """
    left, sums = 1.0, {}
    for layer, (taus, shades, glosses, casts) in enumerate(passes):
        at = -2600 + 320 * layer
        if scales and not (solid and layer == len(passes) - 1):
            pairs = zip(taus, scales, strict=True)
            taus = [times_plus(tree, at, y - 30 * k, each) for k, each in enumerate(pairs)]
        total = taus[0]
        for tau in taus[1:]:
            total = math(tree, at, y - 150, "ADD", total, tau)
        through = math(tree, at, y - 180, "MULTIPLY", total, -1.0)
        through = math(tree, at, y - 210, "EXPONENT", through)
        behind = times_plus(tree, at, y - 240, (left, through))
        seen = math(tree, at, y - 270, "SUBTRACT", left, behind)
        part = math(tree, at, y - 300, "MAXIMUM", total, 1e-12)
        part = math(tree, at, y - 330, "DIVIDE", seen, part)
        for group, shade in shades.items():
            parts = [part, seen]
            for n, kept in enumerate(unshadowed(tree, at, y + 300, casts[group], scales)):
                if kept is not None:
                    parts[n] = times_plus(tree, at, y - 360, (parts[n], kept))
            own = [times_plus(tree, at, y - 390, (parts[0], tau)) for tau in taus]
            pairs = zip((*own, parts[1]), (*shade, glosses[group]), strict=True)
            for k, factors in enumerate(pairs):
                low = y - 480 - 30 * len(sums)
                sums[group, k] = times_plus(tree, at, low, factors, sums.get((group, k)))
        left = behind
    return sums, math(tree, 0, y - 240, "SUBTRACT", 1.0, left)


def recomposed(tree, image, recipe, about, own, alpha):
    """Channels of each group and the opacity, with a Value node for each material's opacity.

    The difference of the picture and its layers is added, and fades by the root of the least scale.
    """
    named = {group: names[0].split(".")[0] for group, names in recipe["channels"].items()}
    materials = recipe["materials"]
    scales, y = [], 700
    for material in materials:
        fades = material in about.get("fades", materials)
        scales.append(value(tree, y, f"opacity: {material}", 1.0) if fades else 1.0)
        y += 100
    passes, plain = [], list(materials.values())
    gains = {"shadow": 1.0, "occlusion": 2.0}
    for layer in range(about["count"]):
        nodes, casts = {}, {group: [] for group in named}

        def outputs(part, names, layer=layer, nodes=nodes):
            """Passes of a part of a layer."""
            if part not in nodes:
                y = 300 * len(nodes) - 1200 * layer
                nodes[part] = node = new(tree, "Image", -3000, y, part)
                node.image = image
                node.layer = f"l{layer}.{part}"
            return [nodes[part].outputs[name] for name in names]

        for kind, gain in gains.items():
            for group in about.get(kind, ()):
                name = named[group]
                cast = {n: outputs(f"{kind}.{n}", [name])[0] for n in ("part", "gloss", "bend")}
                cast["depth"] = outputs(f"{kind}.depth.{name}", plain)
                at = -2800, -1200 * layer - 200 * len(casts[group])
                casts[group].append((gain, grown(tree, *at, cast)))
        passes.append(
            (
                outputs("tau", plain),
                {group: outputs(f"shade.{name}", plain) for group, name in named.items()},
                dict(zip(named, outputs("gloss", named.values()), strict=True)),
                casts,
            )
        )
    kept = 1.0
    for scale in scales:
        kept = math(tree, 100, 1200, "MINIMUM", kept, scale)
    kept = math(tree, 100, 1050, "SQRT", kept)
    solid = about["version"] > 2
    was = composited(tree, passes, None, solid, 1500)
    shown = composited(tree, passes, scales, solid, 3000)
    found = {}
    for key, output in own.items():
        off = math(tree, 250, -1500, "SUBTRACT", output, was[0][key])
        found[key] = times_plus(tree, 250, -1530, (off, kept), shown[0][key])
        found[key] = math(tree, 250, -1560, "MAXIMUM", found[key], 0.0)
    off = math(tree, 250, -1600, "SUBTRACT", alpha, was[1])
    alpha = times_plus(tree, 250, -1630, (off, kept), shown[1])
    alpha = math(tree, 250, -1660, "MINIMUM", alpha, 1.0)
    return found, math(tree, 250, -1690, "MAXIMUM", alpha, 0.0)


def relit(tree, recipe, channels):
    """Red, green and blue: each light's matrix times channels times weight, added."""
    several, y = len(recipe["channels"]) > 1, 0
    colours = [None, None, None]
    for number, (light, row) in enumerate(recipe["lights"].items()):
        for group, matrix in row["matrices"].items():
            name = f"{light}: {group}" if several else light
            weight = value(tree, y, name, 0.0 if number else 1.0)
            for k, numbers in enumerate(matrix):
                total = None
                for i, factor in enumerate(numbers):
                    factors = channels[group, i], factor
                    total = times_plus(tree, 650 + 170 * i, y - 40 * k, factors, total)
                at = 700 + 170 * len(numbers), y - 40 * k
                colours[k] = times_plus(tree, *at, (total, weight), colours[k])
            y -= 200
    return colours


def build(path):
    """Build the nodes for an image."""
    header = header_of(path)
    recipe = json.loads(header.get("volspec:compositing", "null"))
    if recipe is None:
        raise SystemExit(f"{path}: names no lights; see volspec compositing --help")
    image, scene = bpy.data.images.load(path), bpy.context.scene
    tree = tree_of(scene)
    cover = new(tree, "Image", 0, 300, "opacity, depth")
    cover.image = image
    channels, alpha = {}, cover.outputs["Alpha"]
    for number, (group, names) in enumerate(recipe["channels"].items()):
        node = new(tree, "Image", 0, -450 * number, group)
        node.image = image
        node.layer = names[0].split(".")[0]
        for k, name in enumerate(names):
            channels[group, k] = node.outputs[name.split(".")[1]]
    layers = json.loads(header.get("volspec:layers", '{"count": 0}'))
    if layers["count"] and recipe.get("materials"):
        channels, alpha = recomposed(tree, image, recipe, layers, channels, alpha)
    far = 1100 + 170 * max(map(len, recipe["channels"].values()))
    joined = new(tree, "CombineColor", far, 0)
    for colour, socket in zip(relit(tree, recipe, channels), joined.inputs, strict=False):
        tree.links.new(colour, socket)
    tree.links.new(alpha, joined.inputs["Alpha"])
    old = hasattr(bpy.types, "CompositorNodeComposite")
    for kind, y in (("Composite" if old else "GroupOutput", 0), ("Viewer", -200)):
        tree.links.new(joined.outputs[0], new(tree, kind, far + 250, y).inputs[0])
    # A multilayer image says its size only once it is drawn; the file says it at once.
    x0, y0, x1, y1 = header["dataWindow"]
    scene.render.resolution_x, scene.render.resolution_y = x1 - x0 + 1, y1 - y0 + 1
    scene.render.resolution_percentage = 100


given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
build(str(Path(given[0] if given else IMAGE).resolve()))
