"""Launch the casting kernels for a volume that stays on the device.

    volume -> transfer -> [raycast] -> relight -> appearance

The twin is ``volspec/raycast/reference.py``.
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._checks import checked_size
from volspec._gpu import Compute, Sharing
from volspec.camera import Camera
from volspec.errors import OpenCLError, RaycastError, VolspecWarning
from volspec.raycast.launch import kernel_arguments
from volspec.raycast.launch.bricks import brick_codes, brick_ranges
from volspec.raycast.launch.fields import FieldCast, add_pictures, common_dtype, frame_around
from volspec.raycast.launch.kernel_arguments import check_reach
from volspec.raycast.launch.layer_stream import shadow_slots
from volspec.raycast.launch.light_volume import (
    LightVolume,
    Transmittance,
    Visibility,
    split_width,
)
from volspec.raycast.launch.masks import MaskLattice
from volspec.raycast.launch.packets import TILES, Packet, choose_packet
from volspec.raycast.launch.programs import GROUPS, cast_kernel
from volspec.raycast.launch.row_batches import (
    Cancel,
    Progress,
    Receiver,
    Result,
    RowBatches,
    part_of,
)
from volspec.raycast.spec import MAX_STEPS, RaycastSpec, diagonal_mm
from volspec.raycast.step_search import SHORTEST, ErrorTarget, Trial, choose_step
from volspec.transfer import (
    MAX_CHANNELS,
    SurfaceTable,
    Tables,
    Transfers,
    bake_for_volume,
    scale_opacities,
)
from volspec.volume import MAX_FIELDS, Volume

# Step of isosurfaces, in smallest spacings: how far rays go before they look for empty bricks.
SURFACE_STEP = 2.0
# Binary exponents of the magnitudes that are cast as they are: squares of their differences are
# normal numbers of float32. Others are scaled to about 1 on the device.
EXPONENTS = range(-40, 51)


def device_scale(volume: Volume) -> float:
    """Return the power of two by which a field's values are multiplied on a device."""
    _, exponent = math.frexp(max(map(abs, volume.range)))
    if volume.pyramid is not None or exponent in EXPONENTS:
        return 1.0  # levels are read as they are stored
    return 2.0 ** min(-exponent, 126)


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """A field's voxels on a device, and the ranges of its bricks."""

    volume: Volume
    unpadded: Any
    voxels: Any  # as cast, in rows of four or more, once `stored`
    stored_shape: tuple[int, ...]
    low: NDArray[Any]
    high: NDArray[Any]

    @classmethod
    def of(cls, compute: Compute, volume: Volume) -> _Field:
        """Upload a field, on CPUs without a copy. Raises OpenCLError if there is no room."""
        if volume.values.size > np.iinfo(np.uint32).max:
            raise OpenCLError(
                f"{volume.name}: {volume.values.size / 2**30:.1f} Gi voxels",
                "at most 4 Gi can be cast, take volume.downsampled(2)",
                code="size",
            )
        volume = volume if (scale := device_scale(volume)) == 1.0 else volume.scaled(scale)
        values = volume.values
        if not compute.info.is_cpu:
            compute.require(values.nbytes, volume.name, "take volume.downsampled(2)")
        unpadded = compute.upload(values, share=True)
        return cls(volume, unpadded, unpadded, values.shape, *brick_ranges(values))

    def stored(self, compute: Compute, dtype: np.dtype[Any]) -> _Field:
        """Return the field with voxels of a type as they are cast."""
        values = self.volume.values
        if values.shape[2] < 4:  # the kernel loads four bytes of a row at once
            values = np.pad(values, ((0, 0), (0, 0), (0, 4 - values.shape[2])), mode="edge")
        values = values.astype(dtype, copy=False)
        if values is self.volume.values:
            return self
        voxels = compute.upload(values, share=True)
        return replace(self, voxels=voxels, stored_shape=values.shape)

    def set_buffers(self, cast: NDArray[np.void]) -> None:
        """Set the members of a `CAST` that describe the buffers."""
        _, rows, columns = self.stored_shape
        cast["row"], cast["slice"] = columns, rows * columns
        cast["bricks_x"], cast["bricks_y"] = self.low.shape[2], self.low.shape[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Masks:
    """Codes of all masks on a device, one lattice after the other."""

    key: tuple[Any, ...]  # equal for equal codes
    codes: Any
    # By the masked field: structs `MASK`, and the least and greatest rows of bricks.
    structs: Mapping[str, NDArray[np.void]]
    bricks: Mapping[str, tuple[NDArray[np.uint8], NDArray[np.uint8]]]

    @classmethod
    def of(cls, compute: Compute, volume: Volume, table: Tables, last: _Masks | None) -> _Masks:
        """Upload the masks of tables, unless they are the last. OpenCLError if there is no room."""
        key = tuple((name, *mask.key) for name, mask in table.masks.items())
        if last is not None and last.key == key:
            return last
        codes, structs, bricks, first = [np.zeros(0, np.uint16)], {}, {}, 0
        for name, mask in table.masks.items():
            lattice = MaskLattice.of(volume, name, mask)
            codes.append(lattice.codes().ravel())
            structs[name] = kernel_arguments.mask_struct(lattice, first)
            bricks[name] = lattice.brick_ranges()
            first += lattice.rows.size
        compute.require(2 * first, "the masks", "take coarser ones")
        buffer = compute.upload(np.concatenate(codes), share=True) if structs else None
        return cls(key, buffer, structs, bricks)


@dataclass(frozen=True, slots=True, eq=False)
class _FieldSet:
    """One field, or some that are cast together: in voxels of one type, in their tables' order."""

    fields: Mapping[str, _Field]
    dtype: np.dtype[Any]
    frame: Volume
    lights: LightVolume
    masks: _Masks

    @property
    def aligned(self) -> bool:
        """True if all fields have the frame's lattice."""
        return all(field.volume.has_lattice_of(self.frame) for field in self.fields.values())

    def arguments(
        self,
        compute: Compute,
        cast: FieldCast,
        view: tuple[Camera, tuple[int, int]],
        frame: NDArray[np.void],
    ) -> tuple[list[Any], list[Any]]:
        """Return a kernel's first arguments, voxels, and the last, settings.

        Of one field these are the struct `CAST`, ``frame``; of several as in ``kernels/fields.cl``.
        """
        voxels = [field.voxels for field in self.fields.values()]
        tables = cast.several
        if tables is None:
            next(iter(self.fields.values())).set_buffers(frame)
            return voxels, [frame]
        casts = {}
        for name, field in self.fields.items():
            casts[name] = kernel_arguments.cast_struct(
                field.volume, tables.tables[name], *view, cast.specs[name], self.frame
            )
            field.set_buffers(casts[name])
        step_mm = cast.spec.step_of(self.frame)
        curves, first = kernel_arguments.curve_structs(tables, casts, step_mm)
        field_curves = curves[first]
        sizes = [field.low.size for field in self.fields.values()]
        places = np.zeros((len(sizes), 4), np.int32)
        places[:, 0] = np.cumsum([0, *sizes[:-1]])
        places[:, 1], places[:, 2] = field_curves["opacity"], field_curves["material_weights"]
        places[:, 3] = cast.spec.crop_voxels is not None
        arrays: list[NDArray[Any]] = [np.stack([*casts.values(), frame]), places]
        codes = []
        if tables.masks:
            masks = np.zeros(len(first), kernel_arguments.MASK.dtype)
            for number, name in enumerate(tables.tables):
                masks[number] = self.masks.structs.get(name, masks[number])
            masks["curves"] = first
            arrays += curves, masks
            codes = [self.masks.codes]
        voxels += voxels[:1] * (MAX_FIELDS - len(voxels))
        return voxels, [*map(compute.upload, arrays), *codes]


@dataclass(slots=True, eq=False)
class _Shared:
    """Results that casters of one series share: the last table."""

    baked: tuple[Transfers, dict[str, float], Tables] | None


class VolumeCaster:
    """A volume on an OpenCL device, ready to be cast; threads may share it and cast in turn.

    Parameters
    ----------
    volume : Volume
    device : str, optional
        Part of a device's name; the first GPU, else the first CPU, if left out.
    lanes : int, optional
        Rays marched together by a work-item: 1, 4, 8 or 16.
    packet : Packet, optional
        The same, with the way of loading voxels. Default: the fastest that the device carries, by a
        trial of a few seconds when it is first used (`volspec.raycast.launch.packets`).
    context : moderngl.Context, optional
        Current on the thread that casts. The device then shares its memory, and
        ``raycast(into=…)`` passes pictures to a Relighter of the same context without the host.
    like : VolumeCaster, optional
        A caster of another volume, whose device, programs and packet this one shares; they cast in
        turn. Two steps of a series, which have one lattice and range, share tables, too. The other
        parameters are then left out.

    Raises
    ------
    RaycastError, OpenCLError
        If ``lanes`` is another number, there is no device, the volume does not fit on it, or it
        cannot share the context.
    """

    def __init__(
        self,
        volume: Volume,
        *,
        device: str | None = None,
        lanes: int | None = None,
        packet: Packet | None = None,
        context: Any = None,
        like: VolumeCaster | None = None,
    ) -> None:
        if lanes is not None:
            if lanes not in TILES:
                raise RaycastError.refused(
                    "Raycaster: lanes", lanes, f"give one of {sorted(TILES)}", "range"
                )
            packet = Packet(lanes)
        self.volume = volume
        if like is not None:
            if not (device is None and packet is None and context is None):
                raise RaycastError(
                    "Raycaster: device, packet or context is given with like",
                    "leave them out, they are those of the other caster",
                    code="conflict",
                )
            packet = like.packet
        self._compute: Compute = like._compute if like else Compute.open(device, context)
        self.packet: Packet = packet or choose_packet(self._compute.index)
        self._field = _Field.of(self._compute, volume)
        # Of fields that were cast: by name, and the last ones as cast.
        self._uploaded = {volume.name: self._field}
        self._last: _FieldSet | None = None
        self._shared_lock: threading.RLock = like._shared_lock if like else threading.RLock()
        self._casting = False
        self._integral: bool | None = None  # True if float values are labels
        self._brick_codes: tuple[tuple[Any, ...], Any] | None = None
        self._steps: dict[ErrorTarget, tuple[tuple[Any, ...], Tables, float]] = {}
        self._shared: _Shared = (
            like._shared if like and volume.is_step_of(like.volume) else _Shared(None)
        )
        self._scaled: tuple[Tables, Tables] | None = None  # the last table, and for the device

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._compute.info.name

    @property
    def device_index(self) -> str:
        """Number of the device, by which it can be opened."""
        return str(self._compute.index)

    @property
    def compute(self) -> Compute:
        """The device's context, in which kernels are built and buffers made."""
        return self._compute

    @property
    def _lock(self) -> threading.RLock:
        """Lock of casts; OpenCLError in a forked process, where it may be held for ever."""
        self._compute.require_own_process()
        return self._shared_lock

    @property
    def sharing(self) -> Sharing | None:
        """The OpenGL context that the device shares; None without one."""
        return self._compute.sharing

    def bake(self, transfer: Transfers, opacities: Mapping[str, float] | None = None) -> Tables:
        """Bake a transfer function into a table for the volume; the last one is cached.

        ``opacities`` are scales of the materials' optical depths, `RaycastSpec.opacities`. The
        light volume compares tables by identity to detect changes.
        """
        scales, baked = dict(opacities or {}), self._shared.baked
        if baked is None or baked[0] is not transfer or baked[1] != scales:
            table = bake_for_volume(transfer, self.volume)
            table = scale_opacities(table, transfer.basis, scales)
            baked = self._shared.baked = transfer, scales, table
        return baked[2]

    def with_step(
        self,
        table: Tables,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        cancel: Cancel | None = None,
    ) -> RaycastSpec:
        """Return settings with the step that their quality asks for in a picture; cached.

        Parameters and errors are those of `cast`.

        Warns
        -----
        VolspecWarning
            If no step reaches the quality's error.
        """
        spec.step_of(self.volume)  # refuses a mistaken one, and volumes that are too long for any
        if spec.step_mm is not None:
            return spec
        unit, across = self.volume.finest_mm, diagonal_mm(self.volume)
        if isinstance(table, SurfaceTable):  # no step misses a surface
            return replace(spec, step_mm=min(SURFACE_STEP * unit, across))
        groups = tuple(group.without_shadows() for group in spec.groups)
        base_spec = replace(spec, groups=groups, half=False, seed=0, layers=0)
        key = base_spec, camera, size
        known_key, known_table, step_mm = self._steps.get(spec.target, (None, None, 0.0))
        if known_key != key or known_table is not table:
            strengths = np.array(list(spec.strengths().values()))
            white = np.sqrt(np.mean(strengths**2) * np.mean(table.white**2)) or 1.0
            shortest = across / MAX_STEPS / unit
            # Edges along rows or columns, rolled, meet pixels at all places.
            right, up, _ = camera.frame()
            rolled = replace(camera, up=tuple(up + 0.1 * right))
            reference = replace(base_spec, jitter=1.0, seed=1)
            if spec.alpha_stop is None:  # what rays lose as they end counts, too
                reference = replace(reference, alpha_stop=1.0 - spec.target.error / 8)

            def trial(step: float, size: tuple[int, int], is_reference: bool) -> Trial:
                kind = reference if is_reference else base_spec
                stepped = replace(kind, step_mm=max(step, shortest) * unit)
                picture = self.cast(table, rolled, size, stepped, cancel=cancel)
                return Trial(picture.coefficients / white, picture.alpha)

            error, longest = spec.target
            target = ErrorTarget(error, min(longest, across / unit))
            choice = choose_step(trial, size, target, max(SHORTEST, shortest))
            if choice.error > error:
                warnings.warn(
                    f"{self.volume.name}: quality {spec.quality} asks for an error of {error:g}; "
                    f"the shortest step, {choice.step:.3g} of a voxel, leaves {choice.error:.1g}; "
                    "gentler slopes or a shorter step_mm leave less",
                    VolspecWarning,
                    stacklevel=3,
                )
            step_mm = choice.step * unit
            self._steps[spec.target] = key, table, step_mm
        return replace(spec, step_mm=step_mm)

    def cast(
        self,
        table: Tables,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        receiver: Receiver | None = None,
        span_mm: NDArray[np.float32] | None = None,
        clear: Visibility | None = None,
        layers: NDArray[np.float32] | None = None,
    ) -> Result:
        """Cast a picture.

        Parameters
        ----------
        table : TransferTable or SurfaceTable
            From `bake`.
        camera : Camera
        size : (width, height)
            Pixels.
        spec : RaycastSpec
        progress : callable, optional
            Called with the finished fraction, 0…1, after each band of the picture.
        cancel : callable, optional
            Called between bands, about every `RaycastSpec.tile_ms`; True ends the cast.
        receiver : Receiver, optional
            Receives each band on the device; its picture is incomplete if the cast fails.
        span_mm : (H, W, 2) float32, optional
            Distances from the camera between which rays are cast, such as to opaque surfaces; may
            be inf.
        clear : callable, optional
            What surfaces keep from the volume: the part of light that passes between two points,
            (K, 3) starts and ends in mm -> (K,).
        layers : (H, W, L, N) float32, optional
            Filled with `RaycastSpec.layers`, N as `volspec.image.layers.row_size`, of the
            table's materials. Without it they are not cast.

        Raises
        ------
        RaycastError, OpenCLError
            If the size is not positive or the crop leaves nothing; if there is not enough memory.
        CastCancelled
            If ``cancel`` returned True.
        """
        tables = table.split_fields() if spec.add_fields else [table]
        if len(tables) > 1:
            args = cancel, None, span_mm, clear, layers
            return add_pictures(
                [
                    self.cast(one, camera, size, spec, part_of(progress, n, len(tables)), *args)
                    for n, one in enumerate(tables)
                ]
            )
        with self.locked():
            width, height = checked_size(size)
            spec = spec.for_lattice(self.volume)
            table = self._on_device(table)
            self._check_labels(table)
            check_reach(self.volume, camera, spec)
            if table.size > MAX_CHANNELS:
                raise RaycastError(
                    f"raycast: {table.size} channels",
                    f"at most {MAX_CHANNELS} can be cast",
                    code="size",
                )
            channels = len(spec.groups) * table.size
            dtype = np.float16 if spec.half else np.float32
            picture = f"a picture of {width}x{height} with {channels} channels"
            remedy = "cast it smaller, with fewer light groups, or with half=True"
            # The picture, and two bands in progress.
            floats = 0 if layers is None else layers.shape[2] * layers.shape[3]
            bands_bytes = min(height, 1024) * (channels + floats) * 4
            self._compute.require(
                width
                * (height * (channels * np.dtype(dtype).itemsize + 12 + 4 * floats) + bands_bytes),
                picture,
                remedy,
            )
            program = kernel_arguments.Program.of(table, spec, spec.step_of(self.volume))
            fields, fields_cast = self._place(table, spec)
            frame, spec = fields_cast.frame, fields_cast.spec
            first = table.by_field(self.volume.name)[next(iter(fields.fields))][0]
            struct = kernel_arguments.cast_struct(frame, first, camera, size, spec.for_field(None))
            slots = [] if layers is None else shadow_slots(spec)
            split = split_width(table, clear is not None) if slots else 0
            sources, light, is_lit = fields.lights.attach(struct, table, spec, camera, clear, split)
            upload = self._compute.upload
            inputs = *map(upload, map(np.ascontiguousarray, program.tables)), sources, light
            try:
                result = Result(
                    np.empty((height, width, channels), dtype),
                    *(np.empty((height, width), np.float32) for _ in range(3)),
                )
            except MemoryError:
                raise OpenCLError(
                    f"raycast: no memory for {picture}", remedy, code="size"
                ) from None
            unit = np.float32(min(frame.spacing_mm))
            limits = np.zeros(2, np.float32) if span_mm is None else span_mm
            spans = upload(np.divide(limits, unit, dtype=np.float32, order="C"))
            view = camera, size
            voxels, settings = fields.arguments(self._compute, fields_cast, view, struct)
            arguments = *voxels, self._codes(table, spec, fields), *inputs, spans, *settings
            kernel = cast_kernel(
                self._compute,
                self.packet,
                program,
                spec,
                fields.dtype,
                missing=any(field.volume.missing is not None for field in fields.fields.values()),
                is_lit=is_lit,
                spans=span_mm is not None,
                aligned=fields.aligned and not fields_cast.cut_apart,
                layers=0 if layers is None else layers.shape[2],
                slots=slots,
                split=split,
                blocked=bool(slots) and clear is not None,
            )
            tile, group = TILES[self.packet.lanes], GROUPS[self.packet.lanes]
            with (
                receiver.receiving(self._compute, spec.half) if receiver else nullcontext() as pack
            ):
                bands = RowBatches(
                    *(self._compute, result, tile, group, spec.tile_ms, pack), layers=layers
                )
                bands.run(kernel, arguments, progress, cancel)
            result.depth_mm[...] *= unit
            result.first_mm[...] *= unit
            return result

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep the caster from other casts; raises RaycastError in the middle of one."""
        with self._lock:
            if self._casting:
                raise RaycastError(
                    "raycast: the caster is in the middle of a cast",
                    "start the next when progress and cancel have returned",
                    code="state",
                )
            self._casting = True
            try:
                yield
            finally:
                self._casting = False

    def transmittances(
        self,
        table: Tables,
        spec: RaycastSpec,
        camera: Camera,
        clear: Visibility,
    ) -> dict[int, Transmittance]:
        """Return functions of points (K, 3), mm: the part of a source's light the volume lets pass.

        Keys number the sources with shadows and occlusion; arguments as those of the last `cast`.
        """
        with self._lock:
            table = self._on_device(table)
            fields, cast = self._place(table, spec.for_lattice(self.volume))
            return fields.lights.transmittances(table, cast.spec, camera, clear)

    def split_transmittances(
        self, table: Tables, spec: RaycastSpec, camera: Camera, clear: Visibility
    ) -> list[dict[int, Transmittance]]:
        """Return `transmittances` past half of all depths, the whole, and each material's half."""
        with self._lock:
            table = self._on_device(table)
            fields, cast = self._place(table, spec.for_lattice(self.volume))
            return fields.lights.split_transmittances(table, cast.spec, camera, clear)

    def _on_device(self, table: Tables) -> Tables:
        """Return a table for values as they are on the device; the last one is cached."""
        if self._scaled is None or self._scaled[0] is not table:
            scales = {name: device_scale(field) for name, field in self.volume.by_name.items()}
            scaled = table.changed(
                lambda one, name: one.for_scaled_values(scales[name]), self.volume.name
            )
            self._scaled = table, scaled
        return self._scaled[1]

    def _place(self, table: Tables, spec: RaycastSpec) -> tuple[_FieldSet, FieldCast]:
        """Return what a table shows, on the device, and its cast."""
        fields = self._upload_fields(table)
        return fields, FieldCast.of(self._field.volume, table, spec, fields.frame)

    def _upload_fields(self, table: Tables) -> _FieldSet:
        """Return the fields of tables on the device; the last are cached."""
        names, last = list(table.by_field(self.volume.name)), self._last
        masks = _Masks.of(self._compute, self.volume, table, last.masks if last else None)
        if last is None or list(last.fields) != names or last.masks is not masks:
            volumes = [self.volume.by_name[name] for name in names]
            for volume in volumes:
                if volume.name not in self._uploaded:
                    self._uploaded[volume.name] = _Field.of(self._compute, volume)
            dtype = common_dtype(volumes)
            fields = {name: self._uploaded[name].stored(self._compute, dtype) for name in names}
            frame = self._field.volume  # of one field as it is, to the bit
            if names != [self.volume.name]:
                frame = frame_around(frame, names)
            lights = LightVolume(
                self._compute,
                frame,
                fields={name: (field.volume, field.unpadded) for name, field in fields.items()},
                masks={name: (masks.codes, struct) for name, struct in masks.structs.items()},
            )
            last = self._last = _FieldSet(fields, dtype, frame, lights, masks)
        return last

    def _check_labels(self, table: Tables) -> None:
        values = self.volume.values
        if not table.labels or values.dtype.kind != "f":
            return
        if self._integral is None:
            self._integral = all(bool((plane == np.rint(plane)).all()) for plane in values)
        if not self._integral:
            raise RaycastError(
                f"{self.volume.name}: its values are not whole numbers, as labels are",
                "give a segmentation, or a TransferFunction",
                code="type",
            )

    def _codes(self, table: Tables, spec: RaycastSpec, fields: _FieldSet) -> Any:
        """Return the bricks' codes on the device; cached until opacities change."""
        # Opacities of a step matter only to adaptive ones.
        step_mm = spec.step_of(self.volume)
        key = spec.mode, spec.adaptive, step_mm if spec.adaptive > 0 else 0.0, *table.opacity_key
        if self._brick_codes is None or self._brick_codes[0] != key:
            codes = []
            for name, tables in table.by_field(self.volume.name).items():
                field, rows = fields.fields[name], fields.masks.bricks.get(name)
                of_field = brick_codes(field.low, field.high, tables, spec, step_mm, rows)
                codes.append(of_field.ravel())
            self._brick_codes = key, self._compute.upload(np.concatenate(codes))
        return self._brick_codes[1]
