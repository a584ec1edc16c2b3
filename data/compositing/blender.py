"""Relight a volspec image in Blender's compositor (3.3 or newer).

The image's header says which light makes which colours of its channels. This script builds the
sums as nodes of the scene's compositor, with a Value node for the weight of every light (of every
light group where there are several). Run it in Blender's Text Editor, or

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


def times_plus(tree, x, y, factors, plus=None):
    """The output of a·b, or of a·b + c; each is a number or another output."""
    node = new(tree, "Math", x, y)
    node.hide = True
    node.operation = "MULTIPLY" if plus is None else "MULTIPLY_ADD"
    for socket, given in zip(node.inputs, (*factors, plus), strict=False):
        if isinstance(given, (int, float)):
            socket.default_value = given
        elif given is not None:
            tree.links.new(given, socket)
    return node.outputs[0]


def relit(tree, recipe, layers):
    """Red, green and blue: each light's matrix times channels times weight, added."""
    several, y = len(recipe["channels"]) > 1, 0
    colours = [None, None, None]
    for number, (light, row) in enumerate(recipe["lights"].items()):
        for group, matrix in row["matrices"].items():
            name = f"{light}: {group}" if several else light
            weight = new(tree, "Value", 400, y, name)
            weight.name = name
            weight.outputs[0].default_value = 0.0 if number else 1.0
            passes = [channel.split(".")[1] for channel in recipe["channels"][group]]
            for k, numbers in enumerate(matrix):
                total = None
                for i, (each, factor) in enumerate(zip(passes, numbers, strict=True)):
                    channel = layers[group].outputs[each]
                    total = times_plus(tree, 650 + 170 * i, y - 40 * k, (channel, factor), total)
                at = 700 + 170 * len(passes), y - 40 * k
                colours[k] = times_plus(tree, *at, (total, weight.outputs[0]), colours[k])
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
    layers = {}
    for group, channels in recipe["channels"].items():
        layers[group] = node = new(tree, "Image", 0, -450 * len(layers), group)
        node.image = image
        node.layer = channels[0].split(".")[0]
    far = 1100 + 170 * max(map(len, recipe["channels"].values()))
    joined = new(tree, "CombineColor", far, 0)
    for colour, socket in zip(relit(tree, recipe, layers), joined.inputs, strict=False):
        tree.links.new(colour, socket)
    tree.links.new(cover.outputs["Alpha"], joined.inputs["Alpha"])
    old = hasattr(bpy.types, "CompositorNodeComposite")
    for kind, y in (("Composite" if old else "GroupOutput", 0), ("Viewer", -200)):
        tree.links.new(joined.outputs[0], new(tree, kind, far + 250, y).inputs[0])
    # A multilayer image says its size only once it is drawn; the file says it at once.
    x0, y0, x1, y1 = header["dataWindow"]
    scene.render.resolution_x, scene.render.resolution_y = x1 - x0 + 1, y1 - y0 + 1
    scene.render.resolution_percentage = 100


given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
build(str(Path(given[0] if given else IMAGE).resolve()))
