"""Turn Python numbers into ``#define`` lines for both OpenCL C and GLSL, and into structs.

A constant is written once, in Python; kernels and shaders receive it by name. Scalars become float
or int literals, vectors and matrices constructor calls in the language. A struct that the host
fills is also described once, for the NumPy dtype and the declaration in C.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

Language = Literal["opencl", "glsl"]

# OpenCL C's names of voxel types, by NumPy's names.
C_TYPES = {"uint8": "uchar", "uint16": "ushort", "int16": "short", "float32": "float"}


def _literal(value: float) -> str:
    if not np.isfinite(value):
        raise ValueError(f"prelude: {value} has no literal in OpenCL C or GLSL")
    return f"{float(value):.9e}"


def _define(name: str, value: ArrayLike, language: Language) -> str:
    if isinstance(value, str):
        return f"#define {name} {value}"
    if isinstance(value, bool | np.bool_):
        return f"#define {name} {int(value)}"
    if isinstance(value, int | np.integer):
        return f"#define {name} {int(value)}"
    suffix = "f" if language == "opencl" else ""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return f"#define {name} ({_literal(float(array))}{suffix})"
    if array.ndim == 1 and 2 <= array.size <= 4:
        inner = ", ".join(_literal(v) + suffix for v in array)
        kind = f"(float{array.size})" if language == "opencl" else f"vec{array.size}"
        return f"#define {name} {kind}({inner})"
    if array.shape == (3, 3) and language == "glsl":
        # GLSL fills matrices column by column.
        inner = ", ".join(_literal(v) for v in array.T.ravel())
        return f"#define {name} mat3({inner})"
    raise ValueError(f"prelude: {name} of shape {array.shape} has no {language} form")


def prelude(constants: Mapping[str, ArrayLike], language: Language) -> str:
    """Return ``#define`` lines for the constants, in their order.

    >>> print(prelude({"CHANNELS": 7, "Y_B": 20.0}, "glsl"), end="")
    #define CHANNELS 7
    #define Y_B (2.000000000e+01)
    """
    return "".join(_define(name, value, language) + "\n" for name, value in constants.items())


_MEMBER = re.compile(r"(\w+)(?:\[(\d+)\])?")
_NUMPY_TYPES = {"float": ("f4", 1), "int": ("i4", 1), "float4": ("f4", 4), "int4": ("i4", 4)}


@dataclass(frozen=True, slots=True)
class Struct:
    """A struct of OpenCL C that the host fills.

    >>> pair = Struct("Pair", (("float4", "a, b[2]", "two places"), ("int", "n", "")))
    >>> pair.dtype.itemsize, pair.dtype["b"].shape
    (64, (2, 4))
    >>> print(pair.declaration, end="")
    typedef struct {
        float4 a, b[2];  // two places
        int n;
    } Pair;
    """

    name: str
    # Type (float, int, float4 or int4), names and meaning. Names are separated by commas; an
    # array's length follows its name in brackets. Vectors come first, where they are aligned.
    members: tuple[tuple[str, str, str], ...]
    dtype: np.dtype[np.void] = field(init=False)

    def __post_init__(self) -> None:
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        offset, alignment = 0, 4
        for kind, names, _ in self.members:
            code, width = _NUMPY_TYPES[kind]
            for name, length in _MEMBER.findall(names):
                if offset % (4 * width):
                    raise ValueError(f"{self.name}.{name}: vectors come before single numbers")
                shape = (*((int(length),) if length else ()), *((width,) if width > 1 else ()))
                fields.append((name, code, shape))
                offset += 4 * int(np.prod(shape, dtype=int))
                alignment = max(alignment, 4 * width)
        if offset % alignment:  # C pads a struct to the alignment of its members
            fields.append(("unused", "i4", ((-offset % alignment) // 4,)))
        object.__setattr__(self, "dtype", np.dtype(fields))

    @property
    def declaration(self) -> str:
        """The struct in OpenCL C."""
        lines = [
            f"    {kind} {names};{f'  // {meaning}' if meaning else ''}\n"
            for kind, names, meaning in self.members
        ]
        return f"typedef struct {{\n{''.join(lines)}}} {self.name};\n"
