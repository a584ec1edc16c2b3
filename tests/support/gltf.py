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
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
