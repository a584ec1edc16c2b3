"""Small glTF files."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np


def write_glb(path: Path, size: float, linear: Sequence[float] = ()) -> None:
    """Write a square about the origin, moved by a node as glTF's writers do, in a linear colour."""
    half = size / 2
    points = np.float32([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    triangles = np.uint32([0, 1, 2, 0, 2, 3])
    colours = np.float32([linear] * 4 if linear else [])
    data = points.tobytes() + triangles.tobytes() + colours.tobytes()
    ends = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [5.5, 5.5, 12.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", **ends},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": triangles.nbytes},
        ],
        "buffers": [{"byteLength": len(data)}],
    }
    if linear:
        tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
        tree["accessors"].append(
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC3"}
        )
        begin = points.nbytes + triangles.nbytes
        tree["bufferViews"].append({"buffer": 0, "byteOffset": begin, "byteLength": colours.nbytes})
    _write(path, tree, data)


def _write(path: Path, tree: dict[str, Any], data: bytes) -> None:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def write_squares(
    path: Path,
    materials: Sequence[dict[str, Any]],
    numbers: Sequence[int | None],
    pictures: Sequence[bytes | str] = (),
    linear: Sequence[float] = (),
) -> None:
    """Write unit squares side by side along x, a primitive each, of materials by number.

    Pictures are embedded, or named; ``linear`` is COLOR_0 of the first square.
    """
    parts, views, accessors = list[bytes](), list[dict[str, int]](), list[dict[str, Any]]()

    def view(data: bytes) -> int:
        views.append({"buffer": 0, "byteOffset": sum(map(len, parts)), "byteLength": len(data)})
        parts.append(data + b"\0" * (-len(data) % 4))
        return len(views) - 1

    def accessor(values: np.ndarray, kind: str) -> int:
        component = 5126 if values.dtype == np.float32 else 5125
        ends = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        row = {"bufferView": view(values.tobytes()), "componentType": component, "type": kind}
        accessors.append({**row, "count": len(values)} | (ends if kind != "SCALAR" else {}))
        return len(accessors) - 1

    triangles = accessor(np.uint32([0, 1, 2, 0, 2, 3]), "SCALAR")
    uv = accessor(np.float32([[0, 1], [1, 1], [1, 0], [0, 0]]), "VEC2")
    primitives = []
    for place, number in enumerate(numbers):
        corners = [[place, 0, 0], [place + 1, 0, 0], [place + 1, 1, 0], [place, 1, 0]]
        names = {"POSITION": accessor(np.float32(corners), "VEC3"), "TEXCOORD_0": uv}
        if linear and not place:
            names["COLOR_0"] = accessor(np.float32([linear] * 4), "VEC3")
        material = {} if number is None else {"material": number}
        primitives.append({"attributes": names, "indices": triangles, **material})
    images = [
        {"uri": each} if isinstance(each, str) else {"bufferView": view(each), "mimeType": kind}
        for each in pictures
        for kind in ["image/png" if each[:1] == b"\x89" else "image/jpeg"]
    ]
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, parts))}],
    }
    if images:
        textures = [{"source": k} for k in range(len(images))]
        tree |= {"images": images, "textures": textures}
    if materials:
        rows = [{"pbrMetallicRoughness": row} for row in materials]
        tree["materials"] = rows
    _write(path, tree, b"".join(parts))
