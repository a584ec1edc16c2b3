"""Error against time, with VTK's fixed-point mapper: ``python -m benchmarks.equal_error``.

An error is the RMS of one grey that rises with the value, 256², parallel rays, against a converged
cast (steps of 1/16 voxel, rays not ended early), which `tests/analytic` and the twins compare with
float64. VTK's picture is compared as its caster leaves it: its window shows that stretched by
N / (N − 1), bilinearly, and so is the converged cast here. Times are of all cores, 512², with the
scene's camera, seven channels against three, as in `benchmarks.cast`.

Each side takes the longest step that its error allows. VTK's error has a floor that no step lowers
(colours of 8 bits, opacities of 15, coded normals), so VTK takes the longest step with at most 5 %
more than half a voxel leaves. Ours is the longest step with no more error than that.

Run as a program, it measures on every OpenCL device that works, draws the curves and writes a table
to ``docs/benchmarks.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import cycle
from statistics import geometric_mean

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from benchmarks.cast import SIZE, light_figures, peer_of, recoloured
from benchmarks.measure import PAGE, Figure, in_turn, replaced, report
from benchmarks.picture import parallel
from benchmarks.scenes import SPECS, BenchScene, bench_scenes
from benchmarks.vtk_peer import ALPHA_STOP, fixed_point
from volspec._gpu import device_list as devices
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.transfer import TransferTable

SIDE = 256
CONVERGED = 1 / 16
# In smallest spacings, falling.
STEPS = (2.0, 1.5, 1.25, 1.0, 0.75, 0.5, 0.375, 0.25)
HALF = 0.5
# Greys of the lowest and the highest point.
GREYS = (0.35, 0.95)
OUR_STOP = 0.998
ASKED = {"flat": 5.0, "shaded": 4.0}
ASKED_FLOOR = 0.5
ASKED_BALANCED = 0.6
PLOT = PAGE.parent / "images" / "equal-error.png"

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Errors and times of both sides at `STEPS`, (steps,) each; times in ms of all cores.

    ``quality`` has the error and time of ``quality="balanced"``, by those of half a voxel.
    """

    name: str
    kind: str
    our_error: Array
    our_ms: Array
    peer_error: Array
    peer_ms: Array
    quality: tuple[float, float]

    @property
    def peers_step(self) -> int:
        """Index of VTK's longest step that leaves no more than 5 % more error than half a voxel."""
        return _longest(self.peer_error, 1.05 * self.peer_error[STEPS.index(HALF)])

    @property
    def our_step(self) -> int:
        """Index of our longest step that leaves no more error than VTK's."""
        return _longest(self.our_error, self.peer_error[self.peers_step])

    @property
    def ratio(self) -> float:
        """VTK's time by ours at equal error."""
        return float(self.peer_ms[self.peers_step] / self.our_ms[self.our_step])

    @property
    def floor(self) -> float:
        """Our least error at these steps by VTK's."""
        return float(self.our_error.min() / self.peer_error.min())


def _longest(errors: Array, most: float) -> int:
    """Return the first of falling steps with an error within a limit, or else the last."""
    within = np.flatnonzero(errors <= most)
    return int(within[0]) if within.size else len(errors) - 1


def curves(scene: BenchScene, kind: str, caster: Raycaster, runs: int = 5) -> Curves:
    """Measure a scene with both sides."""
    spec = replace(SPECS[kind], specular=0.0, flat_gradient=0.0)
    unit = min(scene.volume.spacing_mm)
    table, points = _greys(scene)
    camera = parallel(scene.camera)

    def grey(spec: RaycastSpec) -> Array:
        spec = caster.with_step(table, camera, (SIDE, SIDE), spec)
        picture = caster.cast(table, camera, (SIDE, SIDE), spec).coefficients[..., 0]
        return picture.astype(np.float64)

    converged = grey(replace(spec, step_mm=CONVERGED * unit, alpha_stop=1.0))
    stretched = _stretched(converged)

    def peers(spec: RaycastSpec) -> Array:
        peer = fixed_point(
            scene.volume, points, table.reference_step_mm, camera, (SIDE, SIDE), spec
        )
        peer.draw()
        return peer.picture()[..., 1] / 255

    ours = [replace(spec, step_mm=s * unit, alpha_stop=OUR_STOP) for s in STEPS]
    theirs = [replace(each, alpha_stop=ALPHA_STOP) for each in ours]
    times = []
    for our, their in zip(ours, theirs, strict=True):
        peer = peer_of(scene, replace(SPECS[kind], step_mm=their.step_mm), fixed_point)
        ours_of = _recasts(scene, replace(our, specular=SPECS[kind].specular), caster)
        times.append(np.median(in_turn(ours_of, peer.redraw, runs=runs).cpu, axis=0))
    our_ms, peer_ms = np.array(times).T
    half = replace(SPECS[kind], step_mm=HALF * unit, alpha_stop=1.0)
    turns = in_turn(_recasts(scene, SPECS[kind], caster), _recasts(scene, half, caster), runs=runs)
    balanced_error = _rms(grey(spec) - converged)
    half_error = _rms(grey(replace(spec, step_mm=HALF * unit, alpha_stop=1.0)) - converged)
    return Curves(
        scene.name,
        kind,
        np.array([_rms(grey(each) - converged) for each in ours]),
        our_ms,
        np.array([_rms(peers(each) - stretched) for each in theirs]),
        peer_ms,
        (balanced_error / half_error, float(np.median(turns.cpu[:, 0] / turns.cpu[:, 1]))),
    )


def _greys(scene: BenchScene) -> tuple[TransferTable, list]:
    """Return the scene's opacities in greys that rise with the value, for both sides."""
    baked = scene.transfer.bake(min(scene.volume.spacing_mm))
    known = [value for value, _, _ in scene.transfer.points]

    def grey(values):
        return np.interp(values, (known[0], known[-1]), GREYS)

    greys = grey(np.linspace(*baked.domain, len(baked.opacity)))
    table = TransferTable(baked.domain, baked.opacity, greys[:, None], baked.reference_step_mm)
    return table, [(v, o, (float(grey(v)),) * 3) for v, o, _ in scene.transfer.points]


def _recasts(scene: BenchScene, spec: RaycastSpec, caster: Raycaster) -> Callable[[], object]:
    """Return casts in turn with other colours, as `VtkPeer.redraw` has them."""
    colours = cycle([scene.transfer, recoloured(scene.transfer)])
    return lambda: raycast(scene.volume, next(colours), scene.camera, SIZE, spec, caster=caster)


def _stretched(picture: Array) -> Array:
    """Return the picture as VTK's window shows its caster's."""
    at = (np.arange(SIDE) + 0.5) * (SIDE - 1) / SIDE
    return map_coordinates(picture, np.meshgrid(at, at, indexing="ij"), order=1)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


def measured(device: str | None = None) -> Iterator[Curves]:
    """Measure all scenes that are there, flat and shaded."""
    for scene in bench_scenes():
        if isinstance(scene, BenchScene):
            caster = Raycaster(scene.volume, device=device)
            for kind in SPECS:
                found = curves(scene, kind, caster)
                print(line(found), flush=True)
                yield found


def line(found: Curves) -> str:
    """Return a row of the table."""
    p, o = found.peers_step, found.our_step
    error, time = found.quality
    return (
        f"| {found.name}, {found.kind} | {STEPS[p]:g}, {1e4 * found.peer_error[p]:.0f}, "
        f"{found.peer_ms[p]:.0f} | {STEPS[o]:g}, {1e4 * found.our_error[o]:.0f}, "
        f"{found.our_ms[o]:.0f} | {found.ratio:.2f} | {found.floor:.2f} | {error:.1f}, {time:.2f} |"
    )


def summary(found: list[Curves]) -> Iterator[Figure]:
    """Yield the figures of a device's curves."""
    for kind, asked in ASKED.items():
        ratios = [each.ratio for each in found if each.kind == kind]
        yield Figure(f"equal error/geometric mean/{kind}", geometric_mean(ratios), asked)
    flat = sum(each.floor <= ASKED_FLOOR for each in found if each.kind == "flat")
    yield Figure("equal error/volumes with half of VTK's least", flat, 4.0, unit="of 5")
    times = geometric_mean(each.quality[1] for each in found)
    name = "quality/balanced, by half a voxel"
    yield Figure(f"{name}: time", times, ASKED_BALANCED, at_most=True)
    yield Figure(f"{name}: error", geometric_mean(each.quality[0] for each in found))


def figures() -> Iterator[Figure]:
    """Yield the figures of the device in use, and those of a light's swap at equal error."""
    found = list(measured())
    yield from summary(found)
    yield from light_figures(
        {each.kind: STEPS[each.peers_step] for each in found if each.name == "engine"}
    )


def _table(info: devices.DeviceInfo, found: list[Curves]) -> str:
    """Return a device's table and figures."""
    head = (
        "| CPU ms | VTK: step, error · 1e4, time | ours | ratio | least error by VTK's | "
        "balanced by half a voxel: error, time |\n" + "|---" * 6 + "|\n"
    )
    rows = "\n".join(line(each) for each in found)
    return f"{_named(info)}:\n\n{head}{rows}\n\n```text\n{report(summary(found))}\n```\n"


def _named(info: devices.DeviceInfo) -> str:
    return f"{info.name}, {info.platform}, driver {info.driver}"


def plot(found: list[Curves], device: str) -> None:
    """Draw errors against times, a panel for each scene, with VTK's."""
    flat = [each for each in found if each.kind == "flat"]
    figure, axes = plt.subplots(
        2, len(flat), figsize=(2.5 * len(flat), 5.2), squeeze=False, layout="constrained"
    )
    for each in found:
        row = list(SPECS).index(each.kind)
        panel = axes[row, [f.name for f in flat].index(each.name)]
        for errors, ms, label, colour in (
            (each.our_error, each.our_ms, "volspec", "tab:blue"),
            (each.peer_error, each.peer_ms, "VTK fixed point", "tab:orange"),
        ):
            panel.loglog(ms, errors, "o-", color=colour, markersize=3, linewidth=1.2, label=label)
            half = STEPS.index(HALF)
            panel.plot(ms[half], errors[half], "o", color=colour, markersize=7, fillstyle="none")
        panel.set_title(f"{each.name}, {each.kind}", fontsize=9)
        panel.tick_params(labelsize=7)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_locator(NullLocator())
        panel.grid(True, linewidth=0.3, alpha=0.6)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="upper left", ncols=2, frameon=False)
    figure.supxlabel("ms of all cores, 512²", fontsize=9)
    figure.supylabel("RMS error of a grey", fontsize=9)
    figure.suptitle(f"Steps of 2 to ¼ voxels (ring: ½), {device}", fontsize=9, x=0.99, ha="right")
    figure.savefig(PLOT, dpi=110)
    plt.close(figure)


def main() -> None:
    """Measure on all devices, write tables and plot."""
    infos = devices.devices()
    parts = []
    for index, info in enumerate(infos):
        if devices.fault(index, infos):
            continue
        print(_named(info), flush=True)
        found = list(measured(str(index)))
        if not parts:
            plot(found, _named(info))
        parts.append(_table(info, found))
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(text, "equal error", "\n" + "\n".join(parts)), encoding="utf-8")


if __name__ == "__main__":
    main()
