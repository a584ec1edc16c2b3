"""Estimated errors of layers of opacity against true ones: ``python -m benchmarks.layer_estimate``.

The volumes, combinations of scales and casts of `benchmarks.layers`, but every covered pixel of 64²
rays, as estimates look at their neighbours. True is CIEDE2000 between the recomposed picture and
the float64 cast of the scaled function under D65 in front of black; estimated is `error_map` with
``against="cast"``, which has no cast. Rows with a lamp with shadows and with ambient occlusion are
of every fifth combination. With ``--keep`` the table goes to docs/layers.md.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.layer_cases import CASES, LAYERS_PAGE
from benchmarks.layers import Setup
from benchmarks.measure import replaced
from benchmarks.scaled_casts import ScaledLights, Truth
from volspec._gpu.sources import asset
from volspec.basis import MaterialBasis
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.export.deep import save_deep
from volspec.image import CoefficientImage
from volspec.pipeline import raycast
from volspec.raycast import reference
from volspec.raycast.launch.layer_stream import LayerStream
from volspec.relight import difference_map, error_map, opacity_error
from volspec.scene import Scene
from volspec.spectra import light
from volspec.transfer import TransferFunction

Array = NDArray[np.float64]
SIDE = 64
COUNTS = (8, 16)
# Of `benchmarks.layers`, and every which combination.
RIGS = {"": 1, "one group": 5, "occlusion": 5}
_VISIBLE = 0.25  # CIEDE2000 from which a true error counts as such


@dataclass(frozen=True, slots=True)
class Estimates:
    """Estimated by true CIEDE2000 of a volume, over combinations of scales.

    Means over all; the ratio of a combination's means, from the tenth to the ninetieth percentile;
    correlations of combinations' means and of pixels; the fractions of all pixels and of those
    with a visible error, 0.25, whose error is within twice the estimate.
    """

    name: str
    layers: int
    true: float
    estimated: float
    low: float
    high: float
    means: float
    pixels: float
    within: float
    within_visible: float

    @classmethod
    def of(cls, name: str, layers: int, true: Array, estimated: Array) -> Estimates:
        """Compare (combinations, pixels) errors."""
        ratio = estimated.mean(axis=1) / true.mean(axis=1)
        covered = true <= 2 * estimated
        low, high = np.percentile(ratio, (10, 90)).tolist()
        return cls(
            *(name, layers, float(true.mean()), float(estimated.mean()), low, high),
            float(np.corrcoef(true.mean(axis=1), estimated.mean(axis=1))[0, 1]),
            float(np.corrcoef(true.ravel(), estimated.ravel())[0, 1]),
            float(covered.mean()),
            float(covered[true > _VISIBLE].mean()),
        )


def measured(name: str, rig: str) -> Iterator[Estimates]:
    """Yield the figures of a volume for each number of layers."""
    setup, rays = Setup(CASES[name], rig), SIDE * SIDE
    unscaled = int(np.flatnonzero((setup.scales == 1).all(axis=1))[0])
    chosen = sorted({unscaled, *range(0, len(setup.scales), RIGS[rig])})
    setup.scales, unscaled = setup.scales[chosen], chosen.index(unscaled)
    by_row = setup.scales[:, setup.columns]
    shares = setup.spec.shares()
    lights = None
    if setup.slots:
        given = setup.volume, setup.table, setup.camera, setup.spec
        lights = ScaledLights(*given, by_row)
    truth = Truth(rays, by_row, len(shares), lights)
    counts = len(shares), len(setup.columns)
    streams = [LayerStream(rays, count, *counts, setup.slots) for count in COUNTS]
    plain = replace(setup.spec, layers=0)
    seen = setup.caster.cast(setup.table, setup.camera, (SIDE, SIDE), plain).alpha > 0.01
    span_mm = np.zeros((SIDE, SIDE, 2), np.float32)
    span_mm[seen, 1] = np.inf
    reference.cast_layers(
        *(setup.volume, setup.table, setup.camera, (SIDE, SIDE), setup.spec, span_mm),
        streams=(truth, *streams),
        lights=None if lights is None else lights.transmittances(setup.table),
    )
    order = [*np.argsort(setup.columns), len(setup.columns)]
    shape = SIDE, SIDE, len(setup.scales)
    channels = truth.channels[..., order].reshape(*shape, -1).astype(np.float32)
    alpha = (1 - truth.through).reshape(shape).astype(np.float32)
    casts = [
        CoefficientImage(
            *(channels[:, :, n], alpha[:, :, n], np.ones((SIDE, SIDE), np.float32)),
            setup.transfer.basis,
            groups=shares,
        )
        for n in range(len(setup.scales))
    ]
    for count, stream in zip(COUNTS, streams, strict=True):
        rows = stream.rows().reshape(SIDE, SIDE, count, -1)
        layers = setup.layers_of(rows, setup.slots).as_stored()
        image = replace(casts[unscaled], opacity_layers=layers)
        pairs = [
            _errors(image, cast, setup.by_name(scales), seen)
            for n, (cast, scales) in enumerate(zip(casts, setup.scales, strict=True))
            if n != unscaled
        ]
        title = name if not rig else f"{name}, {'lamp' if rig == 'one group' else rig}"
        yield Estimates.of(title, count, *(np.stack(each) for each in zip(*pairs, strict=True)))


def _errors(
    image: CoefficientImage,
    cast: CoefficientImage,
    opacities: dict[str, float],
    seen: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Return the true and estimated errors of covered pixels."""
    D65 = light("D65")
    off = difference_map(image.recompose(opacities), cast, D65, "exact", 0.0)
    guess = error_map(image, D65, "exact", 0.0, against="cast", opacities=opacities)
    return off.delta_e[seen].astype(np.float64), guess.delta_e[seen].astype(np.float64)


HEADINGS = ("true", "estimated", "ratio, 10…90 %", "corr. means", "pixels", "within 2x", "visible")


def table(found: list[Estimates]) -> str:
    """Return the figures as a table."""
    lines = ["".ljust(24) + "".join(f"{each:>15s}" for each in HEADINGS)]
    for row in found:
        cells = (
            *(f"{row.true:.3f}", f"{row.estimated:.3f}", f"{row.low:.2f} … {row.high:.2f}"),
            *(f"{row.means:.2f}", f"{row.pixels:.2f}"),
            *(f"{100 * row.within:.0f} %", f"{100 * row.within_visible:.0f} %"),
        )
        name = f"{row.name}, {row.layers}".ljust(24)
        lines.append(name + "".join(f"{cell:>15s}" for cell in cells))
    return "\n".join(lines)


def files() -> str:
    """Return the sizes of the shipped engine's files, and the time of an estimate."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume, transfer = scene.volume(), scene.transfer
    assert isinstance(transfer, TransferFunction)
    materials = replace(transfer, basis=MaterialBasis(transfer.materials))
    spec = replace(scene.raycast, layers=8)
    image = raycast(volume, materials, scene.camera(volume), (512, 512), spec)
    lights = {name: light(name) for name in ("D65", "A")}
    recipe = Recipe.of(image.basis, image.groups, lights)
    mebibytes = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "engine.exr"
        for each in (replace(image, opacity_layers=None), image):
            save_for_compositors(each, path, recipe)
            mebibytes.append(path.stat().st_size / 2**20)
        counts = save_deep(image, path, recipe).counts
        mebibytes.append(path.stat().st_size / 2**20)
    spent = []
    for _ in range(15):
        start = time.thread_time()
        opacity_error(image, {"block": 0.3}, lights["A"])
        spent.append(1e3 * (time.thread_time() - start))
    flat, layered, deep = mebibytes
    return (
        f"engine, 512², 2 materials: EXR {flat:.2f} MiB, with 8 layers {layered:.2f} MiB\n"
        f"deep {deep:.2f} MiB, {counts.sum()} samples in {(counts > 0).sum()} pixels\n"
        f"opacity_error of a sixteenth of the pixels: {np.median(spent):.0f} ms of a core"
    )


def main() -> None:
    """Print the table and the sizes; with ``--keep``, write them to docs/layers.md."""
    found: list[Estimates] = []
    for rig, name in itertools.product(RIGS, CASES):
        try:
            found.extend(measured(name, rig))
        except FileNotFoundError as error:
            print(f"{name}: left out: {error}", flush=True)
    text = f"{table(found)}\n\n{files()}"
    print(text)
    if "--keep" in sys.argv[1:]:
        page = Path(LAYERS_PAGE)
        content = f"\n```text\n{text}\n```\n"
        page.write_text(
            replaced(page.read_text(encoding="utf-8"), "estimates", content), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
