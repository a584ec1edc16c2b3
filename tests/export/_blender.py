"""Subset of ``bpy`` that the shipped script uses, evaluated as Blender does."""

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


# Operations of Math nodes.
MATH: dict[str, Callable[..., Any]] = {
    "ADD": lambda a, b, _: a + b,
    "SUBTRACT": lambda a, b, _: a - b,
    "MULTIPLY": lambda a, b, _: a * b,
    "DIVIDE": lambda a, b, _: a / b,
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, _: np.power(a, b),
    "EXPONENT": lambda a, *_: np.exp(a),
    "MAXIMUM": lambda a, b, _: np.maximum(a, b),
    "MINIMUM": lambda a, b, _: np.minimum(a, b),
    "SQRT": lambda a, b, _: np.sqrt(a),
}


class Node:
    """Node of a kind, with its sockets; its value is computed once in a frame."""

    def __init__(self, kind: str, pixels: dict[str, NDArray[Any]], frame: dict[int, Any]) -> None:
        self.frame = frame
        self.kind, self.layer, self.operation, self.label = kind, "", "", ""
        inputs = {"Math": 3, "CombineColor": 4}.get(kind, 1)
        self.inputs: Any = [Socket() for _ in range(inputs)]
        if kind == "CombineColor":
            names = ("Red", "Green", "Blue", "Alpha")
            self.inputs = Named(zip(names, self.inputs, strict=True))
        value = Socket(None if kind == "Value" else self.value)
        passes = {
            key: Socket(lambda k=key: pixels[f"{self.layer}.{k}.V"])
            for key in {name.split(".")[-2] for name in pixels if name.endswith(".V")}
        }
        self.outputs = Named({0: value, "Alpha": Socket(lambda: pixels["A"]), **passes})

    def value(self) -> Any:
        if id(self) not in self.frame:
            given = [socket.value() for socket in self.inputs]
            known = self.kind == "CombineColor"
            self.frame[id(self)] = np.dstack(given) if known else MATH[self.operation](*given)
        return self.frame[id(self)]


class Named(dict):
    """Sockets by name or place, iterated in order."""

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(key) if key in self else list(self.values())[key]

    def __iter__(self) -> Any:
        return iter(self.values())


def blender(pixels: dict[str, NDArray[Any]]) -> tuple[Any, list[Node]]:
    """A ``bpy`` with a compositor that knows no more than these nodes, and where they will be.

    Values of nodes are in ``bpy.frame``, which is to be emptied when a value has changed.
    """
    nodes: list[Node] = []
    frame: dict[int, Any] = {}

    class Nodes(list[Node]):
        def new(self, name: str) -> Node:
            nodes.append(Node(name.removeprefix("CompositorNode"), pixels, frame))
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
        frame=frame,
    )
    return bpy, nodes
