"""The programs of casts, for a device, a packet of rays and settings.

Program, RaycastSpec -> [programs] -> kernel
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volspec._gpu import C_TYPES, Compute, assemble, prelude
from volspec.image import MAX_LAYER_TAU, MAX_TAU, MIN_TAU, Slot
from volspec.raycast.launch import kernel_arguments
from volspec.raycast.launch.bricks import BRICK, STRIDES
from volspec.raycast.launch.layer_stream import LIGHT_MASS, LIT_COST, MADE_COST, least_mass
from volspec.raycast.launch.packets import TILES, Packet
from volspec.raycast.spec import RaycastSpec

# Work-items per group: a packet is a group by itself, as a loop over several takes two fifths
# longer to compile and runs no faster.
GROUPS = {1: (8, 8), 4: (1, 1), 8: (1, 1), 16: (1, 1)}


def cast_kernel(
    compute: Compute,
    packet: Packet,
    program: kernel_arguments.Program,
    spec: RaycastSpec,
    dtype: np.dtype[Any],
    *,
    missing: bool,
    is_lit: bool,
    spans: bool,
    aligned: bool = True,
    parts: bool = False,
    layers: int = 0,
    slots: Sequence[Slot] = (),
    split: int = 0,
    blocked: bool = False,
) -> Any:
    """Return the kernel that casts voxels of a type.

    Parameters
    ----------
    compute : Compute
    packet : Packet
    program : Program
    spec : RaycastSpec
    dtype : numpy.dtype
        Of the voxels.
    missing : bool
        Some voxels are.
    is_lit : bool
        Some source has shadows or occlusion.
    spans : bool
        Rays begin and end at distances of their own.
    aligned : bool
        All fields share a lattice and its cuts.
    parts : bool
        Only a part of the volume is stored.
    layers : int
        Layers of opacity, which are written, too.
    slots : sequence of (group, occluded)
        Shadows of the layers.
    split : int
        Numbers of a node in the light volume, of materials by themselves.
    blocked : bool
        What surfaces let pass is one of them.
    """
    tile_width, tile_height = TILES[packet.lanes]
    constants = {
        "LANES": packet.lanes,
        "TILE_WIDTH": tile_width,
        "TILE_HEIGHT": tile_height,
        "SINGLE_LOADS": int(packet.single_loads),
        "BRICK": BRICK,
        "STRIDES": STRIDES,
        "ADAPTIVE": int(spec.adaptive > 0),
        "MISSING": int(missing and not program.constants["LABELS"]),
        "PRESENT": kernel_arguments.PRESENT,
        "SPANS": int(spans),
        "ALIGNED": int(aligned),
        "PARTS": int(parts),
        "LAYERED": layers,
        "SLOTS": sum(1 << (2 * group + occluded) for group, occluded in slots),
        "VOXEL": C_TYPES[dtype.name],
        "VOXEL_BYTES": dtype.itemsize,
        "VOXEL_SIGNED": int(dtype.kind == "i"),
        **program.constants,
        **kernel_arguments.light_constants(spec, is_lit),
        "PHYSICAL": int(is_lit and spec.physical_light and program.name != "surfaces"),
    }
    if layers:
        constants |= {
            "LAYER_SLOTS": 2 * layers,
            "MIN_MASS": least_mass(int(program.constants["WEIGHTS"]), layers),
            "MAX_TAU": MAX_TAU,
            "MAX_LAYER_TAU": MAX_LAYER_TAU,
            "MIN_TAU": MIN_TAU,
            "SLOT_COUNT": len(slots),
            "SPLIT": split,
            "BLOCKED": int(blocked),
            "LIGHT_MASS": LIGHT_MASS,
            "MADE_COST": MADE_COST,
            "LIT_COST": LIT_COST,
        }
    constants["NEIGHBOURS"] = int(constants["NORMALS"] or program.constants["TABLE_ROWS"] > 1)
    steps = 2 if constants["NEIGHBOURS"] else 4
    if constants["NEIGHBOURS"] and program.name == "fields":
        steps = 1  # lanes of a field wait for its longest: 1.0, 1.1 and 1.1 times for 1, 2, 4
    # Adaptive steps depend on it, and are to be the same in every packet.
    constants["STEPS"] = steps if packet.lanes > 1 or spec.adaptive > 0 else 1
    text = prelude(constants, "opencl") + kernel_arguments.CAST.declaration
    if constants.get("MASKED"):
        text += kernel_arguments.CURVE.declaration + kernel_arguments.MASK.declaration
    return compute.kernel(assemble(f"kernels/{program.name}.cl", text), program.name)
