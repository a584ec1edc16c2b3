"""Arguments and constants of the casting kernels: arrays of plain numbers, no device needed.

    volume, table, camera, spec -> [packed] -> gpu

Layouts and padding are documented in the headers of ``kernels/``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import Struct
from volspec.camera import Camera
from volspec.errors import CameraError, InputError, RaycastError
from volspec.raycast.launch.masks import MIXED, MaskLattice
from volspec.raycast.lights import NEAR_LAMP, Ambient, Directional, Headlight, Point, Source, Spot
from volspec.raycast.spec import MAX_PLANES, RaycastSpec, diagonal_mm
from volspec.transfer import (
    NEAREST_POSITIONS,
    FieldTables,
    SurfaceTable,
    Table,
    Tables,
    TransferTable,
    integral_rows,
)
from volspec.volume import Volume

# Settings of a cast. Lengths are in units of the volume's smallest spacing, so that no choice of
# units overflows or underflows float32. Rays start in the plane through the target, as in RayField.
CAST = Struct(
    "Cast",
    (
        ("float4", "target", "in index space"),
        ("float4", "forward, across, down", "in the world; across and down one pixel long"),
        ("float4", "index_x, index_y, index_z", "rows of index_from_world"),
        ("float4", "low, high", "crop box in index space"),
        ("float4", "last", "largest index along x, y, z"),
        ("float4", "first", "the smallest that is stored, with PARTS; multiples of BRICK"),
        ("float4", "part_low, part_high", "of steps, with PARTS; in index space"),
        ("float4", "shade", "ambient, diffuse, specular, unused"),
        ("float4", f"planes[{MAX_PLANES}]", "in index space: visible if normal . index >= w"),
        ("float4", "light_scale", "from index to node of the light volume, along x, y, z"),
        ("float", "middle_x, middle_y", "pixel that looks at the target"),
        ("float", "distance", "from the camera to the target"),
        ("float", "perspective", "1, or 0 for parallel rays"),
        ("float", "light_lift", "distance in front of surfaces at which light is read"),
        ("float", "unit", "smallest spacing, mm"),
        ("float", "phase", "from the target to step 0; steps are whole ones from the camera"),
        ("float", "start", "position of the camera counted from step 0"),
        ("float", "step", "length of a step"),
        ("float", "jitter", "fraction of a step by which rays are shifted"),
        ("float", "domain_low, domain_rest", "value of table entry 0, as the sum of two; or 0"),
        ("float", "domain_scale", "table entries per value"),
        ("float", "last_entry", "of the table"),
        ("float", "row_scale, last_row", "table rows per gradient; the last row"),
        ("float", "min_transmittance", "at which a ray ends"),
        ("float", "power", "step by the reference step of opacities"),
        ("float", "first_opacity", "at which a ray counts as having hit something"),
        ("float", "gradient_scale", "central difference -> fraction of the volume's range"),
        ("float", "least", "voxels below are missing, with MISSING; of floats less domain_low"),
        ("float", "gradient_floor_squared", "in those fractions; shading fades below it"),
        ("int", "width, height, channels", "of the picture"),
        ("int", "row, slice", "elements from one voxel row, one slice to the next"),
        ("int", "bricks_x, bricks_y", "number of bricks"),
        ("int", "light_x, light_y, light_z", "nodes of the light volume"),
        ("int", "plane_count", ""),
        ("int", "corner_x, corner_y", "pixel of the whole picture, with PARTS"),
        ("int", "shininess", "Blinn-Phong exponent"),
        ("int", "seed", "of the jitter"),
    ),
)
# A table among those of several: of a field, or of a row of its mask.
CURVE: Struct = Struct(
    "Curve",
    (
        ("float", "domain_rest", "value of entry 0, less what samples lack"),
        ("float", "domain_scale, last_entry, power", "as in Cast"),
        ("int", "opacity, material_weights", "first element of its tables"),
    ),
)
# A field's mask: codes of rows, on a lattice of their own.
MASK: Struct = Struct(
    "Mask",
    (
        ("float4", "index_x, index_y, index_z", "rows: from the field's index to the lattice's"),
        ("float4", "last", "largest index there; 0 without a mask"),
        ("int", "row, slice", "elements from one row, one slice to the next"),
        ("int", "first", "element in the codes, unsigned"),
        ("int", "curves", "number of the curve of row 0, the field's own"),
    ),
)
# Kinds of sources; shade.clh has these names in capitals.
KINDS = {Ambient: 0, Headlight: 1, Directional: 2, Point: 3, Spot: 3}
# Log of an opaque step's transmittance; finite, so that a step of no length is transparent.
LOG_OPAQUE = -1e30
# Error of opacities of a step between entries up to which these are taken as linear.
MAX_BENT = 1e-5
# Iterations of false position that place an isosurface within its cell.
ITERATIONS = 6
# Transmittance of a step below which extinctions mix as if it were this.
MIX_OPAQUE = 1e-4
# Weight of the voxels that there are in a sample, above which it has no part of missing ones.
PRESENT = 1 - 1e-5
# In smallest spacings: voxels and eyes closer than this to a cut count as inside, and projections
# leave out rays that are shorter, in float32 and float64.
CUT_TOLERANCE = 1e-3
# Nodes of the light volume around the volume: light is read two or three cells in front of a
# surface, which may be two in front of a face.
LIGHT_MARGIN = 4


def cast_struct(
    volume: Volume,
    table: Table,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    frame: Volume | None = None,
) -> NDArray[np.void]:
    """Return the struct `CAST` without its members for buffers (rows, bricks, light volume).

    Steps and units are those of ``frame``, by default of the volume.
    """
    frame = frame or volume
    step = spec.step_of(frame)
    unit = min(frame.spacing_mm)
    matrix = volume.index_from_world
    field = camera.ray_field(*size)
    cast = np.zeros((), CAST.dtype)
    cast["target"][:3] = matrix[:3, :3] @ field.target + matrix[:3, 3]
    cast["forward"][:3] = field.forward
    cast["across"][:3], cast["down"][:3] = field.across / unit, field.down / unit
    for axis, name in enumerate(("index_x", "index_y", "index_z")):
        cast[name][:3] = matrix[axis, :3] * unit
    cast["middle_x"], cast["middle_y"] = field.middle
    cast["distance"], cast["perspective"] = field.distance / unit, field.perspective
    # Steps are counted from the camera but numbered from the one next to the target.
    nearest = round(field.distance / step)
    cast["unit"] = unit
    cast["start"] = -nearest * step / unit
    cast["phase"] = (nearest * step - field.distance) / unit
    cast["low"][:3], cast["high"][:3] = spec.kept(volume)
    cast["last"][:3] = np.array(volume.shape_xyz) - 1
    cast["shade"] = spec.ambient, spec.diffuse, spec.specular, 0
    planes = spec.index_planes(volume)
    cast["planes"][: len(planes)], cast["plane_count"] = planes, len(planes)
    cast["shininess"], cast["seed"] = spec.shininess, np.uint32(spec.seed).view(np.int32)
    cast["step"], cast["min_transmittance"] = step / unit, spec.least_transmittance
    cast["jitter"], cast["first_opacity"] = spec.jitter, spec.first_opacity
    cast["gradient_floor_squared"] = spec.gradient_floor_squared
    cast["width"], cast["height"] = size
    cast["channels"] = table.channels.shape[1]
    _set_table(cast, table, volume, spec, step)
    # Of smallest spacings of the volume, in units.
    cast["gradient_scale"] *= min(volume.spacing_mm) / unit
    # Finite: what is beyond the volume is −∞, and below it.
    lowest = float(np.finfo(np.float32).min)
    low = float(cast["domain_low"]) if volume.values.dtype.kind == "f" else 0.0
    cast["least"] = max(volume.least_present - low, lowest)
    return cast


def _set_table(
    cast: NDArray[np.void],
    table: Table,
    volume: Volume,
    spec: RaycastSpec,
    step: float,
) -> None:
    cast["gradient_scale"] = 0.5 * gradient_scale(table, volume, spec)
    if isinstance(table, SurfaceTable):
        cast["last_entry"] = len(table.values) - 1
        return
    cast["last_entry"] = table.opacity.shape[-1] - 1
    if table.labels:
        return
    cast["power"] = step / table.reference_step_mm
    cast["domain_low"], cast["domain_scale"] = table.domain[0], table.entries_per_value
    cast["domain_rest"] = table.domain[0] - float(cast["domain_low"])
    if table.gradient_top is not None:
        rows = len(table.opacity) - 1
        cast["last_row"] = rows
        # Gradients in the kernel are fractions of the range per smallest spacing.
        per_mm = spec.gradient_scale(volume) * min(volume.spacing_mm)
        cast["row_scale"] = rows / (table.gradient_top * per_mm) if per_mm else 0.0


def gradient_scale(table: Table, volume: Volume, spec: RaycastSpec) -> float:
    """Return the factor from values (labels: opacities of a step) to fractions of the range."""
    if isinstance(table, TransferTable) and table.labels:
        max_opacity = table.step_opacity(spec.step_of(volume)).max()
        return 1 / float(max_opacity) if max_opacity > 0 else 0.0
    return spec.gradient_scale(volume)


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """The kernel for a transfer table, with its compile-time constants and its tables."""

    name: str  # the kernel's, and its file's in kernels/
    constants: Mapping[str, float]
    # Opacity, material weights, channels and, for the kernel ``raycast``, filters: in the order of
    # the kernel's arguments, in the layouts that its header describes.
    tables: tuple[NDArray[np.float32], ...]

    @classmethod
    def of(
        cls, table: Tables, spec: RaycastSpec, step_mm: float, *, powers: bool | None = None
    ) -> Program:
        """Return the program for a table and settings, or raise RaycastError if they conflict.

        ``powers`` is whether opacities of a step are powers, by default as `needs_powers`.
        """
        if isinstance(table, FieldTables):
            return cls._of_fields(table, spec, step_mm)
        _check_compatible(table, spec)
        count, channels = table.channels.shape
        extra: dict[str, float] = {}
        name, rows = "raycast", 1
        mixed = np.vstack([table.channels, table.white])
        filters: NDArray[np.float64] | None = None
        if isinstance(table, SurfaceTable):
            name, extra = "surfaces", {"SURFACES": len(table.values), "ITERATIONS": ITERATIONS}
            opacity = np.stack([table.values, table.opacity], axis=1).astype(np.float32)
            weights = _pad_rows(table.material_weights)
        elif spec.preintegrated:
            name, count, extra = "preintegrated", count + 1, {"NEAREST": NEAREST_POSITIONS}
            # (τ, τ s …) -> (τ s …, τ): the weights first, as everywhere; τ mixes nothing.
            quantities = [np.roll(q, -1, axis=1) for q in integral_rows(table, step_mm)]
            weights = np.stack([_pad_rows(q) for q in quantities])
            opacity = np.zeros((1, 2), np.float32)
            mixed = np.insert(mixed, len(mixed) - 1, 0.0, axis=0)
        else:
            sides = table, table.left_limits
            if spec.mode == "composite":
                powers = needs_powers(table) if powers is None else powers
                extra = {"POWERS": int(powers), "LOG_OPAQUE": LOG_OPAQUE}
                steps = _with_rises(
                    *(t.opacity if powers else t.step_opacity(step_mm) for t in sides)
                )
                entries = np.stack([steps, _log_transmittances(table, step_mm)])
            else:
                name, extra = "projection", {"MAXIMUM": int(spec.mode == "maximum")}
                entries = _with_rises(*(t.opacity for t in sides))
            rows = 1 if table.gradient_top is None else len(table.opacity)
            opacity = entries.astype(np.float32)
            weights = _pad_rows(with_rises(*(t.material_weights for t in sides)))
            if name == "raycast":
                filters = np.zeros((1, 8))
            if table.filters is not None:
                # Every channel has a transmittance: weights must be the channels themselves.
                count = channels
                mixed = np.vstack([np.eye(channels), table.white])
                weights = _pad_rows(with_rises(*(t.coefficients for t in sides)))
                filters = with_rises(*(t.step_transmittance(step_mm) for t in sides))
                filters[-1, 0] = table.white
        width = vector_width(count)
        constants = {
            "WEIGHTS": count,
            "VECTOR": width,
            "VECTORS": -(-count // width),
            "LABELS": int(table.labels),
            "TABLE_ROWS": rows,
            "FILTERED": int(table.filters is not None),
            "STEP_ENDS": int(name in ("surfaces", "preintegrated")),
            **extra,
        }
        tables: tuple[NDArray[np.float32], ...] = opacity, weights, mixed.astype(np.float32)
        if filters is not None:
            tables = *tables, _pad_rows(filters)
        return cls(name, constants, tables)

    @classmethod
    def _of_fields(cls, table: FieldTables, spec: RaycastSpec, step_mm: float) -> Program:
        """Return the program for several fields, whose tables follow one another."""
        spec.check_fields()
        field_tables = table.every
        powers = any(needs_powers(one) for one in field_tables)
        programs = [cls.of(one, spec, step_mm, powers=powers) for one in field_tables]
        opacity, weights, channels = zip(*(one.tables[:3] for one in programs), strict=True)
        constants = {
            **programs[0].constants,
            "FIELDS": len(table.tables),
            "MASKED": int(bool(table.masks)),
            "MIXED": MIXED,
            "MIX_OPAQUE": MIX_OPAQUE,
        }
        tables = (
            np.concatenate([rows.reshape(-1, 2) for rows in opacity]),
            np.concatenate(weights),
            channels[0],
        )
        return cls("fields", constants, tables)


def curve_structs(
    table: FieldTables, casts: Mapping[str, NDArray[np.void]], step_mm: float
) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """Return the structs `CURVE` of all tables, row by row, and the number of each field's first.

    ``casts`` are the fields' structs `CAST`.
    """
    rows = [(name, row) for name in table.tables for row in table.rows(name)]
    curves, place = np.zeros(len(rows), CURVE.dtype), 0
    width = table.channels.shape[0]
    vectors = -(-width // vector_width(width))
    for curve, (name, row) in zip(curves, rows, strict=True):
        curve["domain_rest"] = row.domain[0] - float(casts[name]["domain_low"])
        curve["domain_scale"] = row.entries_per_value
        curve["last_entry"] = len(row.opacity) - 1
        curve["power"] = step_mm / row.reference_step_mm
        curve["opacity"], curve["material_weights"] = place, place * vectors
        place += 2 * (len(row.opacity) + 1)
    sizes = [len(table.rows(name)) for name in table.tables]
    return curves, np.cumsum([0, *sizes[:-1]])


def mask_struct(lattice: MaskLattice, first: int) -> NDArray[np.void]:
    """Return the struct `MASK` of a lattice whose codes begin at element ``first``; no curves."""
    mask = np.zeros((), MASK.dtype)
    for row, name in zip(lattice.from_index, ("index_x", "index_y", "index_z"), strict=True):
        mask[name] = row
    mask["last"][:3] = lattice.last
    _, rows, columns = lattice.rows.shape
    mask["row"], mask["slice"] = columns, rows * columns
    mask["first"] = np.uint32(first).view(np.int32)
    return mask


def _check_compatible(table: Table, spec: RaycastSpec) -> None:
    if isinstance(table, SurfaceTable):
        kind = "isosurfaces"
    elif table.labels:
        kind = "labels"
    elif table.gradient_top is not None:
        kind = "a transfer function of gradients"
    elif table.filters is not None:
        kind = "spectral absorption"
    else:
        return
    if spec.mode != "composite":
        raise RaycastError(
            f"raycast: mode {spec.mode!r} has no meaning with {kind}", code="conflict"
        )
    if spec.preintegrated:
        raise RaycastError(
            f"raycast: preintegrated does not work with {kind}", "leave it out", code="conflict"
        )
    if spec.adaptive > 0 and kind in ("isosurfaces", "spectral absorption"):
        raise RaycastError(
            f"raycast: adaptive steps do not work with {kind}", "give adaptive=0", code="conflict"
        )


def needs_powers(table: TransferTable) -> bool:
    """Return True if opacities of a step, linear between entries, would be too far from right.

    Opacities per reference step are linear there; kernels with POWERS interpolate these. Half a
    reference step decides, so that all steps share a program.
    """
    if table.labels or table.gradient_top is not None or table.filters is not None:
        return False
    starts, ends = table.opacity[:-1], table.left_limits.opacity[1:]
    opacity = np.stack([starts, ends, 0.5 * (starts + ends)])
    start, end, middle = np.sqrt(1 - opacity)
    return bool(np.abs(middle - 0.5 * (start + end)).max() > MAX_BENT)


def with_rises(entries: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (…, N, K) entries with differences to the next's limits, then zeros.

    The result is (…, N + 1, 2, K).
    """
    *leading, count, width = entries.shape
    rows = np.zeros((*leading, count + 1, 2, width))
    rows[..., :-1, 0, :] = entries
    rows[..., :-2, 1, :] = limits[..., 1:, :] - entries[..., :-1, :]
    return rows


def _with_rises(entries: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (…, N) entries with differences, as `with_rises`: (…, N + 1, 2)."""
    return with_rises(entries[..., None], limits[..., None])[..., 0]


def _log_transmittances(table: TransferTable, step_mm: float) -> NDArray[np.float64]:
    """Return logs of a step's transmittance at an entry and at the next's limit; then zeros.

    The result is (…, N + 1, 2).
    """
    opacity = np.stack([table.opacity, table.left_limits.opacity])
    with np.errstate(divide="ignore"):
        logs = np.log1p(-opacity) * (step_mm / table.reference_step_mm)
    here, limits = np.maximum(logs, LOG_OPAQUE)
    rows = np.zeros((*here.shape[:-1], here.shape[-1] + 1, 2))
    rows[..., :-1, 0], rows[..., :-2, 1] = here, limits[..., 1:]
    return rows


def vector_width(count: int) -> int:
    """Return the floats per vector of weights, 4 or 8: PoCL 3.0 fails at float16 on AVX-512."""
    return 4 if count <= 4 else 8


def _pad_rows(rows: NDArray[Any]) -> NDArray[np.float32]:
    """Return rows padded with zeros to whole vectors."""
    count = rows.shape[-1]
    width = vector_width(count)
    result = np.zeros((*rows.shape[:-1], -(-count // width) * width), np.float32)
    result[..., :count] = rows
    return result


def numbered_sources(spec: RaycastSpec) -> list[tuple[int, Source]]:
    """Return (group number, source) in the kernel's order."""
    return [(i, source) for i, group in enumerate(spec.groups) for source in group.sources]


def source_rows(
    volume: Volume, camera: Camera, spec: RaycastSpec, layers: Sequence[int], split: int = 0
) -> NDArray[np.float32]:
    """Return (R, 4): world rows, groups and sources (shade.clh).

    ``layers`` are the sources' in the light volume, -1 for none; ``split`` for each follow.
    """
    unit = min(volume.spacing_mm)
    # Positions are relative to the camera's target, to keep them small.
    world = volume.world_from_index[:3].copy()
    world[:, 3] -= camera.target_mm
    groups, rows = np.zeros((len(spec.groups), 4)), []
    for (group, source), layer in zip(numbered_sources(spec), layers, strict=True):
        falloff = source.falloff_mm if isinstance(source, Point) else None
        alike = isinstance(source, Ambient) or not is_shaded(spec)
        placed = falloff is not None or isinstance(source, Spot)
        if alike and layer < 0 and not (placed and spec.mode == "composite"):
            weight = spec.ambient if isinstance(source, Ambient) else spec.diffuse
            groups[group, 0] += weight * source.intensity
            continue
        row = np.zeros((3, 4))
        row[0, 3] = source.intensity
        row[1, :3] = ((falloff or 0.0) / unit) ** 2, KINDS[type(source)], layer
        row[1, 3] = max(layers) + 1 + layer * split
        row[2] = source.beam(camera) if isinstance(source, Spot) else (0.0, 0.0, 0.0, 1.0)
        if isinstance(source, Directional):
            row[0, :3] = camera.to_world(source.towards, source.frame)
        elif isinstance(source, Point):
            place_mm = camera.place_mm(source.position_mm, source.frame)
            row[0, :3] = (place_mm - camera.target_mm) / unit
        rows.append(row)
        groups[group:, 1] = len(rows)
    return np.concatenate([world / unit, groups, *rows]).astype(np.float32)


def is_shaded(spec: RaycastSpec) -> bool:
    """Return True if gradients count: not in projections."""
    return spec.shaded and spec.mode == "composite"


def light_constants(spec: RaycastSpec, is_lit: bool) -> dict[str, Any]:
    """Return the constants for lights and cuts; ``is_lit`` if the light volume has layers."""
    shaded = is_shaded(spec)
    return {
        "GROUPS": len(spec.groups),
        "SHADED": int(shaded),
        "SHARP": int(shaded and spec.specular > 0 and spec.shininess > 63),
        "LIT": int(is_lit),
        "LIGHT_MARGIN": float(LIGHT_MARGIN),
        "CUT_TOLERANCE": CUT_TOLERANCE,
        "NORMALS": int(shaded or is_lit),
        "MAX_PLANES": MAX_PLANES,
        "NEAR_LAMP": NEAR_LAMP,
        **{kind.__name__.upper(): number for kind, number in KINDS.items()},
    }


# In diagonals of the volume: the squares of much longer distances overflow float32.
MAX_REACH = 1e9


def check_reach(volume: Volume, camera: Camera, spec: RaycastSpec) -> None:
    """Refuse a camera or lights farther than `MAX_REACH` diagonals from the volume.

    Raises CameraError or RaycastError, the latter also if a falloff is as much too short.
    """
    middle = volume.corners_mm.mean(axis=0)
    check = partial(_check_length, volume)
    from_target = math.dist(camera.target_mm, middle)
    check("camera: position_mm to target_mm", camera.distance_mm, "move nearer", CameraError)
    check("camera: target_mm to the volume", from_target, "look at the volume", CameraError)
    check("camera: height_mm", camera.height_mm or 0.0, "give a smaller one", CameraError)
    for group in spec.groups:
        for source in group.sources:
            if not isinstance(source, Point):
                continue
            origin = middle if source.frame == "world" else (0.0, 0.0, 0.0)
            light, falloff = f"point light of {group.name!r}", source.falloff_mm
            distance = math.dist(source.position_mm, origin)
            check(f"{light}: its distance", distance, "use Directional")
            if falloff is None:
                continue
            check(f"{light}: falloff_mm", falloff, "leave it out")
            if falloff < diagonal_mm(volume) / MAX_REACH:
                raise RaycastError(
                    f"{falloff:g} is too short, {volume.name} is {diagonal_mm(volume):g} mm across",
                    f"give {diagonal_mm(volume) / MAX_REACH:.2g} or more",
                    code="range",
                    field=f"{light}: falloff_mm",
                    given=falloff,
                )


def _check_length(
    volume: Volume, field: str, mm: float, remedy: str, error: type[InputError] = RaycastError
) -> None:
    across = diagonal_mm(volume)
    if mm > MAX_REACH * across:
        raise error(
            f"{mm:g} mm is more than {MAX_REACH:g} times the size of {volume.name}, {across:g} mm",
            remedy,
            code="range",
            field=field,
            given=mm,
        )
