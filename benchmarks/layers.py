"""Errors of layers of opacity against new casts: ``python -m benchmarks.layers``.

Three materials by value (skin, brass and blue sky, of ColorChecker where there are such), an
ambient and a headlight. The truth is the float64 march of the reference, steps of half a voxel that
do not end early, with every sample's optical depths scaled; the layers are the NumPy stream's, as
a file holds them, in half precision. All 215 combinations of 0, 1/4, 1/2, 1, 2 and 4 that show
something, on covered pixels of 96² rays; errors are of sRGB codes, 1 for white, and CIEDE2000 of
the frame under D65 in front of black, without an eye model.

Shadows: a directional lamp with shadows, in a light group of its own and in one with ambient and
headlight, and ambient occlusion. The truth reads the light volume of the scaled opacities, one for
each combination; "frozen" layers have the cast's shadows. Other functions: two and four materials
(of four, every sixth combination), labels, and the noisy CT of a chest.

The kernel is compared with the stream on the same pixels and combinations: the difference of
coefficients that 99 % of the pixels stay below, and the pixels above 1e-4, in which a layer ends a
sample earlier or later, as a mass is close to the limit. Its time is that of all cores by that of
the same cast without layers, whose rays do not end early either, or do.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from benchmarks.layer_cases import (
    CASES,
    LAYERS_PAGE,
    OTHERS,
    RIGS,
    SPEC,
    Case,
    Errors,
    display,
    transfer_of,
)
from benchmarks.measure import Figure, in_turn, replaced
from benchmarks.scaled_casts import Frozen, ScaledLights, Truth
from volspec._gpu.sources import asset
from volspec.basis import MaterialBasis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.layers import OpacityLayers, Slot
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.layer_stream import LayerStream, empty_rows, shadow_slots
from volspec.relight import relight
from volspec.scene import Scene
from volspec.spectra import light
from volspec.transfer import TransferFunction, TransferTable

Array = NDArray[np.float64]
SCALES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
MAX_COMBINATIONS = 215  # of three materials, all
COUNTS = (4, 8, 12, 16)
LAYERS = 8
SIDE, PIXELS, LIT_PIXELS = 96, 1000, 300
TIMED = 512, 512


@dataclass(frozen=True, slots=True)
class Row:
    """Figures of a volume: errors by number of layers and by light, twins, and times."""

    name: str
    pixels: int
    errors: dict[int, Errors]
    lit: dict[str, dict[str, Errors]]
    apart: float
    moved: float
    ratio: float
    ratio_early: float


class Setup:
    """A volume to be cast under a rig: what all figures of it share."""

    def __init__(self, case: Case, rig: str, most: int = PIXELS) -> None:
        read, points, orbit = case
        self.volume = read()
        self.transfer, self.camera = transfer_of(points), Camera.orbit(self.volume, **orbit)
        step_mm = 0.5 * self.volume.finest_mm
        self.spec = replace(SPEC, step_mm=step_mm, layers=LAYERS, groups=RIGS[rig])
        self.caster = Raycaster(self.volume)
        table = self.caster.bake(self.transfer)
        assert isinstance(table, TransferTable)
        self.table, self.slots = table, shadow_slots(self.spec)
        self.columns: list[int] = table.channels.argmax(axis=1).tolist()
        every = [s for s in itertools.product(SCALES, repeat=len(self.columns)) if any(s)]
        if len(every) > MAX_COMBINATIONS:
            every = every[:: len(every) // MAX_COMBINATIONS]
            every.append((1.0,) * len(self.columns))
        self.scales = np.array(every)
        plain = replace(self.spec, layers=0)
        alpha = self.caster.cast(table, self.camera, (SIDE, SIDE), plain).alpha.ravel()
        seen = np.flatnonzero(alpha > 0.01)
        # Evenly spread.
        self.pixels = seen[np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(int)]

    def errors(self, streams: Mapping[str, LayerStream]) -> dict[str, Errors]:
        """Return the errors of some streams' layers against new casts."""
        by_row = self.scales[:, self.columns]
        lights = None
        if self.slots:
            lights = ScaledLights(self.volume, self.table, self.camera, self.spec, by_row)
        truth = Truth(SIDE * SIDE, by_row, len(self.spec.groups), lights)
        span_mm = np.zeros((SIDE * SIDE, 2), np.float32)
        span_mm[self.pixels, 1] = np.inf
        reference.cast_layers(
            *(self.volume, self.table, self.camera, (SIDE, SIDE), self.spec),
            span_mm.reshape(SIDE, SIDE, 2),
            streams=(truth, *streams.values()),
            lights=None if lights is None else lights.transmittances(self.table),
        )
        order = [*np.argsort(self.columns), len(self.columns)]
        channels, through = truth.channels[self.pixels][..., order], truth.through[self.pixels]
        wanted = self.codes(channels.swapaxes(0, 1), through.T)
        found = {}
        for name, stream in streams.items():
            slots = () if isinstance(stream, Frozen) else self.slots
            layers = self.layers_of(stream.rows()[self.pixels, None], slots).as_stored()
            image = self.stored_image(layers, channels, through)
            shown = [image.recompose(self.by_name(scales)) for scales in self.scales]
            each = np.stack([one.coefficients[:, 0] for one in shown]).astype(np.float64)
            through_all = np.stack([1.0 - one.alpha[:, 0].astype(np.float64) for one in shown])
            found[name] = Errors.of(self.codes(each, through_all), wanted)
        return found

    def by_name(self, scales: Array) -> dict[str, float]:
        """Return {material: scale}."""
        return dict(zip(self.transfer.materials, scales.tolist(), strict=True))

    def layers_of(self, rows: Array, slots: Sequence[Slot]) -> OpacityLayers:
        """Return the layers of a cast's rows."""
        counts = len(self.columns), len(self.spec.groups)
        return OpacityLayers.of_rows(rows.astype(np.float32), self.columns, *counts, slots)

    def codes(self, channels: Array, through: Array) -> Array:
        """Return sRGB codes of (…, R, G, K + 1) channels and (…, R) transmittance, under D65."""
        return display(self.transfer.basis, self.spec.shares())(channels, through)

    def stored_image(
        self, layers: OpacityLayers, channels: Array, through: Array
    ) -> CoefficientImage:
        """Return the image of the true cast at scale 1, a column, with layers."""
        unscaled = int(np.flatnonzero((self.scales == 1).all(axis=1))[0])
        alpha = (1 - through[:, unscaled, None]).astype(np.float32)
        flat = channels[:, unscaled].reshape(len(alpha), 1, -1).astype(np.float32)
        shares = self.spec.shares()
        return CoefficientImage(
            *(flat, alpha, np.ones_like(alpha), self.transfer.basis),
            groups=shares,
            opacity_layers=layers,
        )

    def twins_apart(self, stream: LayerStream) -> NDArray[np.float32]:
        """Return each pixel's greatest difference of kernel and stream, over all combinations."""
        ours = empty_rows(self.table, (SIDE, SIDE), self.spec)
        self.caster.cast(self.table, self.camera, (SIDE, SIDE), self.spec, layers=ours)
        kernel = ours.reshape(SIDE * SIDE, *ours.shape[2:])
        sides = [
            self.layers_of(each[self.pixels, None], self.slots) for each in (kernel, stream.rows())
        ]
        worst = np.zeros(len(self.pixels), np.float32)
        for scales in self.scales:
            one, other = (side.recompose(scales.tolist()).channels for side in sides)
            worst = np.maximum(worst, np.abs(one - other).max(axis=(1, 2, 3)))
        return worst


def measured(name: str, case: Case) -> Row:
    """Measure a volume."""
    setup = Setup(case, "")
    rays, materials = SIDE * SIDE, len(setup.columns)
    streams = {str(n): LayerStream(rays, n, 1, materials) for n in COUNTS}
    errors = {int(n): each for n, each in setup.errors(streams).items()}
    apart = setup.twins_apart(streams[str(LAYERS)])
    lit = {rig: lit_errors(case, rig) for rig in RIGS if rig}
    caster, spec = setup.caster, replace(setup.spec, step_mm=None)
    ratio, ratio_early = times(caster, setup.table, setup.camera, spec)
    most, moved = float(np.percentile(apart, 99)), float(np.mean(apart > 1e-4))
    return Row(name, len(setup.pixels), errors, lit, most, moved, ratio, ratio_early)


def lit_errors(case: Case, rig: str) -> dict[str, Errors]:
    """Return the errors of layers under a rig, and of layers whose shadows stay."""
    setup = Setup(case, rig, LIT_PIXELS)
    given = SIDE * SIDE, LAYERS, len(setup.spec.groups), len(setup.columns)
    streams = {"split": LayerStream(*given, setup.slots)}
    if setup.slots:
        streams["frozen"] = Frozen(*given)
    return setup.errors(streams)


def times(
    caster: Raycaster, table: TransferTable, camera: Camera, spec: RaycastSpec
) -> tuple[float, float]:
    """Return a cast's time with layers by those without: of whole rays, and of rays that end."""
    spec = caster.with_step(table, camera, TIMED, spec)
    rows = empty_rows(table, TIMED, spec)

    def layered() -> None:
        caster.cast(table, camera, TIMED, spec, layers=rows)

    ratios = []
    for stop in (1.0, None):
        plain = replace(spec, alpha_stop=stop)
        both = in_turn(partial(caster.cast, table, camera, TIMED, plain), layered, runs=5)
        ratios.append(float(np.median(both.cpu[:, 1] / both.cpu[:, 0])))
    return ratios[0], ratios[1]


def rows() -> Iterator[Row | tuple[str, str]]:
    """Yield the figures of each volume, or its name and the reason if it is missing."""
    for name, case in CASES.items():
        try:
            yield measured(name, case)
        except FileNotFoundError as error:
            yield name, str(error)


def other_rows() -> Iterator[tuple[str, dict[str, Errors] | str]]:
    """Yield the errors of other functions by rig, or the reason if the volume is missing."""
    for name, case in OTHERS.items():
        try:
            yield name, {rig: lit_errors(case, rig)["split"] for rig in ("", "one group")}
        except FileNotFoundError as error:
            yield name, str(error)


def figures_of(row: Row) -> list[Figure]:
    """Return a volume's figures with their targets."""
    eight, sixteen = row.errors[LAYERS], row.errors[16]
    asked = (
        ("RMS", eight.rms, 0.004, ""),
        ("mean", eight.mean, 0.25, "ΔE"),
        ("worst", eight.worst, 0.6, "ΔE"),
        ("99 %", eight.most_of, 1.5, "ΔE"),
        ("max", eight.most, 6.0, "ΔE"),
        ("16: mean", sixteen.mean, 0.08, "ΔE"),
        ("kernel, 99 %", row.apart, 1e-4, ""),
        ("time", row.ratio, 1.8, "x"),
        *(
            figure
            for rig, each in row.lit.items()
            for figure in (
                (f"{rig}, mean", each["split"].mean, LIT_MEAN, "ΔE"),
                (f"{rig}, 99 %", each["split"].most_of, LIT_MAX, "ΔE"),
            )
        ),
    )
    return [Figure(f"{row.name}: {n}", v, a, True, unit) for n, v, a, unit in asked]


LIT_MEAN, LIT_MAX = 0.35, 2.0
HEADINGS = ("RMS", "mean", "worst", "99%", "max", "L16:mean", "kernel", "moved,%", "time", "early")
TARGETS = ("0.004", "0.25", "0.6", "1.5", "6", "0.08", "0.0001", "-", "1.8", "-")


def table(found: list[Row | tuple[str, str]]) -> str:
    """Return the errors of 8 layers, volume by volume, ``!`` after those beyond the target.

    ``L16:mean`` is of 16 layers; ``kernel`` and ``moved`` compare the kernel with its twin;
    ``time`` and ``early`` are times by those of casts without layers whose rays do not end early,
    or do.
    """
    lines = [
        "8 layers".ljust(12) + "".join(f"{each:>11s}" for each in HEADINGS),
        "asked, ≤".ljust(12) + "".join(f"{each:>10s} " for each in TARGETS),
    ]
    for row in found:
        if not isinstance(row, Row):
            lines.append(f"{row[0]:12s}left out: {row[1]}")
            continue
        cells = [
            f"{figure.reached:.2g}" + (" " if figure.met else "!")
            for figure in figures_of(row)[: len(HEADINGS) - 2]
        ]
        cells.append(f"{row.ratio_early:.2g} ")
        cells.insert(7, f"{100 * row.moved:.2g} ")
        lines.append(f"{row.name:12s}" + "".join(f"{cell:>11s}" for cell in cells))
    return "\n".join(lines)


def by_count(found: list[Row | tuple[str, str]]) -> str:
    """Return RMS / mean / 99 % / max by the number of layers."""
    lines = ["layers".ljust(12) + "".join(f"{n:>24d}" for n in COUNTS)]
    for row in found:
        if isinstance(row, Row):
            cells = (row.errors[n] for n in COUNTS)
            texts = [f"{e.rms:.4f} {e.mean:.3f} {e.most_of:.2f} {e.most:.1f}" for e in cells]
            lines.append(f"{row.name:12s}" + "".join(f"{text:>24s}" for text in texts))
    return "\n".join(lines)


def by_light(found: list[Row | tuple[str, str]]) -> str:
    """Return mean and 99 % of layers whose shadows stay, and mean / worst / 99 % / max of split."""
    lines = ["shadows".ljust(12) + "".join(f"{rig:>36s}" for rig in RIGS if rig)]
    for row in found:
        if isinstance(row, Row):
            cells = []
            for each in row.lit.values():
                stays, split = each["frozen"], each["split"]
                texts = (
                    f"{stays.mean:.2f} {stays.most_of:.1f} | {_marked(split.mean, LIT_MEAN)}",
                    f"{split.worst:.2f} {_marked(split.most_of, LIT_MAX)} {split.most:.1f}",
                )
                cells.append(" ".join(texts))
            lines.append(f"{row.name:12s}" + "".join(f"{cell:>36s}" for cell in cells))
    return "\n".join(lines)


def by_function(found: list[tuple[str, dict[str, Errors] | str]]) -> str:
    """Return RMS / mean / 99 % / max of other functions, without and with shadows."""
    lines = ["others".ljust(14) + f"{'no shadow':>28s}{'one group':>28s}"]
    for name, errors in found:
        if isinstance(errors, str):
            lines.append(f"{name:14s}left out: {errors}")
            continue
        texts = (
            f"{e.rms:.4f} {_marked(e.mean, LIT_MEAN)} {e.most_of:.2f} {e.most:.1f}"
            for e in errors.values()
        )
        lines.append(f"{name:14s}" + "".join(f"{text:>28s}" for text in texts))
    return "\n".join(lines)


def _marked(reached: float, asked: float) -> str:
    return f"{reached:.2f}" + ("" if reached <= asked else "!")


STATES: tuple[dict[str, float], ...] = (
    {},
    {"block": 0.3},
    {"block": 0.0},
    {"block": 4.0, "inserts": 0.0},
)


def four_states() -> NDArray[np.uint8]:
    """Return frames of one cast of the shipped engine, next to one another."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume, transfer = scene.volume(), scene.transfer
    assert isinstance(transfer, TransferFunction)
    materials = replace(transfer, basis=MaterialBasis(transfer.materials))
    spec = replace(scene.raycast, layers=LAYERS)
    image = raycast(volume, materials, scene.camera(volume), (360, 360), spec)
    each = [relight(image.recompose(state), light("A"), scene.relight) for state in STATES]
    return np.hstack(each).astype(np.uint8)


def figures() -> Iterator[Figure]:
    """Yield the figures of all volumes, for `benchmarks.__main__`."""
    for row in rows():
        if isinstance(row, Row):
            yield from figures_of(row)
        else:
            yield Figure(f"{row[0]}: layers", None, note=row[1])
    for name, errors in other_rows():
        if isinstance(errors, str):
            yield Figure(f"{name}: layers", None, note=errors)
            continue
        for rig, each in errors.items():
            title = f"{name}: {rig or 'no shadow'}, mean"
            yield Figure(title, each.mean, LIT_MEAN, True, "ΔE")


def main() -> None:
    """Print all tables; with ``--keep``, write them to docs/layers.md, and its picture."""
    found = []
    for row in rows():
        found.append(row)
        print(row if not isinstance(row, Row) else f"{row.name}: {row.pixels} pixels", flush=True)
    text = "\n\n".join([table(found), by_count(found), by_light(found)])
    text += f"\n\n{by_function(list(other_rows()))}"
    print(text)
    if "--keep" in sys.argv[1:]:
        page = Path(LAYERS_PAGE)
        iio.imwrite(page.parent / "images" / "layers.jpg", four_states(), quality=92)
        content = f"\n```text\n{text}\n```\n"
        page.write_text(
            replaced(page.read_text(encoding="utf-8"), "errors", content), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
