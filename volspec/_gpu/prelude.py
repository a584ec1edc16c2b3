"""Turn Python numbers into ``#define`` lines that OpenCL C and GLSL both read.

A constant is typed once, in Python; kernels and shaders receive it by name. Scalars become
float or int literals, vectors and matrices become constructor calls of the language.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

Language = Literal["opencl", "glsl"]

# OpenCL C's names of the types that volumes are kept in, by NumPy's.
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
    """``#define`` lines for the constants, in the order given.

    >>> print(prelude({"CHANNELS": 7, "Y_B": 20.0}, "glsl"), end="")
    #define CHANNELS 7
    #define Y_B (2.000000000e+01)
    """
    return "".join(_define(name, value, language) + "\n" for name, value in constants.items())
