"""Subset of ``bpy`` that the shipped script uses, evaluated as Blender does."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Socket:
    """Socket of a node: its link, or its value."""

    def __init__(self, read: Callable[[], Any] | None = None) -> None:
        self.default_value, self.read = 0.0, read
        self.link: Socket | None = None

    def value(self) -> Any:
        if self.link is not None:
            return self.link.value()
        return self.default_value if self.read is None else self.read()


class Node:
    """Node of a kind, with its sockets."""

    def __init__(self, kind: str, pixels: dict[str, NDArray[Any]]) -> None:
        self.kind, self.layer, self.operation, self.label = kind, "", "", ""
        inputs = {"Math": 3, "CombineColor": 4}.get(kind, 1)
        self.inputs: Any = [Socket() for _ in range(inputs)]
        if kind == "CombineColor":
            names = ("Red", "Green", "Blue", "Alpha")
            self.inputs = Named(zip(names, self.inputs, strict=True))
        value = Socket(None if kind == "Value" else self.value)
        passes = {
            key: Socket(lambda k=key: pixels[f"{self.layer}.{k}.V"])
            for key in {name.split(".")[1] for name in pixels if name.endswith(".V")}
        }
        self.outputs = Named({0: value, "Alpha": Socket(lambda: pixels["A"]), **passes})

    def value(self) -> Any:
        given = [socket.value() for socket in self.inputs]
        if self.kind == "CombineColor":
            return np.dstack(given)
        return given[0] * given[1] + (given[2] if self.operation == "MULTIPLY_ADD" else 0.0)


class Named(dict):
    """Sockets by name or place, iterated in order."""

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(key) if key in self else list(self.values())[key]

    def __iter__(self) -> Any:
        return iter(self.values())


def blender(pixels: dict[str, NDArray[Any]]) -> tuple[Any, list[Node]]:
    """A ``bpy`` with a compositor that knows no more than these nodes, and where they will be."""
    nodes: list[Node] = []

    class Nodes(list[Node]):
        def new(self, name: str) -> Node:
            nodes.append(Node(name.removeprefix("CompositorNode"), pixels))
            return nodes[-1]

    def link(output: Socket, to: Socket) -> None:
        to.link = output

    kinds = ("Image", "Math", "Value", "CombineColor", "Composite", "Viewer")
    tree = SimpleNamespace(nodes=Nodes(), links=SimpleNamespace(new=link))
    scene = SimpleNamespace(node_tree=tree, render=SimpleNamespace())
    bpy = SimpleNamespace(
        types=SimpleNamespace(**dict.fromkeys((f"CompositorNode{kind}" for kind in kinds), True)),
        data=SimpleNamespace(images=SimpleNamespace(load=str)),
        context=SimpleNamespace(scene=scene),
    )
    return bpy, nodes
