"""Draw figures 3 and 4 of [1] and their numbers: ``python -m tools.palette_figures``.

Writes ``docs/images/palette-3.png`` and ``palette-4.png``, and the tables between the markers of
``docs/gallery/palette-evaluation.md``.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 4.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from benchmarks.measure import replaced
from benchmarks.palette import MODELS, SEEDS, Array, Model, colours, drawn, error
from volspec._figures import FAINT, HAIR, INK, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parent.parent / "docs"
SIZES = tuple(range(1, 13))
# Draws of palettes that are not square.
OTHER_SEEDS = 3
# Square palettes: figure 3's numbers for every way to draw colours and compare them.
SQUARES = (3, 5, 7, 10, 12)
WAYS = (("linear", "RGB"), ("linear", "Lab"), ("codes", "RGB"), ("codes", "Lab"))
# METHOD's reference, from another program, with unknown distributions of colours and lights.
REFERENCE = {
    "positive, 31": {5: 7.0, 7: 14.4, 10: 23.0},
    "positive, 100": {7: 2.1, 10: 9.5},
    "free, 31": {10: 0.01, 12: 10.7},
}
ACCEPTABLE = 10.0
"""ΔE*ab that [1] calls acceptable."""
# As in figure 4.
ORDER = (MODELS[2], MODELS[0], MODELS[1])
DPI = 150


def draw() -> None:
    """Measure, draw and write; takes a quarter of an hour."""
    surfaces = {model.name: surface(model) for model in MODELS}
    write(surface_figure(surfaces), "palette-3.png")
    pairs = {model.name: distances(model) for model in ORDER}
    write(distance_figure(pairs), "palette-4.png")
    page = DOCS / "gallery" / "palette-evaluation.md"
    text = page.read_text(encoding="utf-8")
    for name, table in (
        ("surfaces", surface_table(surfaces)),
        ("squares", square_table()),
        ("distances", distance_table(pairs)),
    ):
        text = replaced(text, name, f"\n{table}\n")
    page.write_text(text, encoding="utf-8")


def surface(model: Model) -> Array:
    """Return the mean ΔE*ab of palettes of every size, (reflectances, lights), on all cores."""
    sizes = list(product(SIZES, SIZES))
    with ProcessPoolExecutor() as pool:
        means = list(pool.map(partial(mean_error, model), *zip(*sizes, strict=True)))
    print(f"{model.name}: {len(sizes)} sizes", flush=True)
    return np.reshape(means, (len(SIZES), len(SIZES)))


def mean_error(model: Model, rows: int, columns: int) -> float:
    """Return the mean ΔE*ab of palettes of a size."""
    seeds = SEEDS if rows == columns else OTHER_SEEDS
    return float(error(model, rows, columns, seeds=seeds).mean())


def distances(model: Model, size: int = 10, seed: int = 0) -> Array:
    """Return (2, P) ΔE*ab of all pairs of a palette's colours: targets, and results."""
    Lab = np.reshape(colours(drawn(model, size, size, seed)), (2, -1, 3))
    one, other = np.triu_indices(Lab.shape[1], 1)
    return np.asarray(np.linalg.norm(Lab[:, one] - Lab[:, other], axis=-1))


def surface_table(surfaces: Mapping[str, Array]) -> str:
    """Return the square palettes of figure 3 with the reference."""
    heads = " | ".join(f"{n} × {n}" for n in SIZES)
    lines = [f"| mean ΔE*ab | {heads} |", "|---" * (len(SIZES) + 1) + "|"]
    for model in MODELS:
        cells = [two_digits(mean) for mean in np.diag(surfaces[model.name])]
        lines.append(f"| {model.name} bands | {' | '.join(cells)} |")
    return "\n".join(lines)


def square_table() -> str:
    """Return mean and deviation over the seeds for all ways to draw and compare colours."""
    heads = " | ".join(f"{n} × {n}" for n in SQUARES)
    lines = [f"| bands | colours | metric | {heads} |", "|---" * (len(SQUARES) + 3) + "|"]
    for model in MODELS:
        for way, metric in WAYS:
            cells = []
            for n in SQUARES:
                each = error(model, n, n, metric, way)
                cells.append(f"{two_digits(each.mean())} ± {two_digits(each.std(ddof=1))}")
            lines.append(f"| {model.name} | {way} | {metric} | {' | '.join(cells)} |")
        known = REFERENCE[model.name]
        cells = [f"{known[n]:g}" if n in known else "" for n in SQUARES]
        lines.append(f"| {model.name} | *reference* | | {' | '.join(cells)} |")
    return "\n".join(lines)


def distance_table(pairs: Mapping[str, Array]) -> str:
    """Return the numbers of figure 4."""
    lines = ["| bands | correlation | mean change | greatest |", "|---|---|---|---|"]
    for name, (wanted, obtained) in pairs.items():
        change = np.abs(obtained - wanted)
        correlation = np.corrcoef(wanted, obtained)[0, 1]
        lines.append(
            f"| {name} | {correlation:.4f} | {two_digits(change.mean())} | {change.max():.3g} |"
        )
    return "\n".join(lines)


def surface_figure(surfaces: Mapping[str, Array]) -> Figure:
    """Draw three surfaces on one scale, with square palettes marked."""
    from matplotlib.patheffects import withStroke

    figure = blank(10.0, 4.0)
    top = max(float(means.max()) for means in surfaces.values())
    top = 5.0 * np.ceil(top / 5.0)
    halo = [withStroke(linewidth=2.2, foreground=PAPER)]
    for number, model in enumerate(MODELS):
        means = surfaces[model.name]
        x, y = np.meshgrid(SIZES, SIZES)
        axes: Any = figure.add_axes((0.005 + 0.33 * number, 0.02, 0.325, 0.93), projection="3d")
        axes.set_box_aspect((1, 1, 0.82), zoom=1.0)
        axes.view_init(elev=22, azim=-122)
        axes.plot_surface(
            x, y, means, cmap="viridis", vmin=0, vmax=top, edgecolor=PAPER, linewidth=0.35,
            rstride=1, cstride=1, antialiased=True, shade=False,
        )  # fmt: skip
        for n in (5, 7, 10, 12):
            height = means[SIZES.index(n), SIZES.index(n)]
            axes.plot([n], [n], [height], "o", color=INK, markersize=3, zorder=20)
            axes.text(
                n, n, height + 0.045 * top, tenths(height), color=INK, fontsize=8, ha="center",
                va="bottom", zorder=21, fontweight="bold", path_effects=halo,
            )  # fmt: skip
        axes.set(xlim=(1, 12), ylim=(1, 12), zlim=(0, top))
        axes.set_xticks((1, 4, 8, 12))
        axes.set_yticks((1, 4, 8, 12))
        axes.set_xlabel("lights", fontsize=8, color=FAINT, labelpad=-6)
        axes.set_ylabel("reflectances", fontsize=8, color=FAINT, labelpad=-6)
        axes.tick_params(labelsize=7.5, labelcolor=FAINT, pad=-2)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_pane_color((1, 1, 1, 0))
            axis.line.set_color(HAIR)
            axis._axinfo["grid"].update(color=HAIR, linewidth=0.5)
        titled(figure, 0.02 + 0.33 * number, number, f"{model.name} bands")
    words = (
        f"Mean ΔE*ab of the whole palette, by its size; the mean of {SEEDS} draws of square "
        f"palettes, of {OTHER_SEEDS} of others."
    )
    figure.text(0.02, 0.025, words, fontsize=8, color=FAINT)
    return figure


def distance_figure(pairs: Mapping[str, Array]) -> Figure:
    """Draw three scatter plots of obtained against wanted distance, darker for more points."""
    from matplotlib.colors import LogNorm

    figure = blank(10.0, 3.95)
    top = 10.0 * np.ceil(max(float(each.max()) for each in pairs.values()) / 10.0)
    for number, (name, (wanted, obtained)) in enumerate(pairs.items()):
        axes: Axes = figure.add_axes((0.055 + 0.325 * number, 0.135, 0.28, 0.71))
        axes.set(xlim=(0, top), ylim=(0, top), aspect="equal")
        counts, edges, _ = np.histogram2d(wanted, obtained, bins=40, range=((0, top), (0, top)))
        bins = np.clip(np.digitize((wanted, obtained), edges) - 1, 0, 39)
        dense = counts[bins[0], bins[1]]
        order = np.argsort(dense, kind="stable")
        axes.plot((0, top), (0, top), color=INK, linewidth=0.7, zorder=1)
        axes.scatter(
            wanted[order], obtained[order], c=dense[order], cmap="viridis_r", s=2.2, linewidths=0,
            norm=LogNorm(1, 60), zorder=2,
        )  # fmt: skip
        correlation = np.corrcoef(wanted, obtained)[0, 1]
        change = np.abs(obtained - wanted).mean()
        text = f"correlation {correlation:.4f}\nmean change {tenths(change)}"
        axes.text(0.04 * top, 0.96 * top, text, va="top", fontsize=8, color=INK, linespacing=1.5)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        for side in ("bottom", "left"):
            axes.spines[side].set(color=FAINT, linewidth=0.6)
        axes.tick_params(length=2, labelsize=7.5, labelcolor=FAINT, color=FAINT)
        axes.set_xlabel("ΔE*ab wanted", fontsize=8, color=FAINT)
        if number == 0:
            axes.set_ylabel("ΔE*ab obtained", fontsize=8, color=FAINT)
        titled(figure, 0.055 + 0.325 * number, number, f"{name} bands")
    return figure


def two_digits(dE: float) -> str:
    """Format a number for a table: two digits, and at most three decimal places.

    >>> two_digits(7.386), two_digits(0.00002)
    ('7.4', '<0.001')
    """
    return f"{dE:.2g}" if dE >= 0.001 else "<0.001"


def tenths(dE: float) -> str:
    """Format a number to its certain digits: tenths, or a bound.

    >>> tenths(7.386), tenths(0.004)
    ('7.4', '<0.1')
    """
    return f"{dE:.1f}" if dE >= 0.05 else "<0.1"


def titled(figure: Figure, left: float, number: int, words: str) -> None:
    """Add a panel's letter and name."""
    figure.text(left, 0.915, "abc"[number], fontsize=11, color=INK, fontweight="bold")
    figure.text(left + 0.02, 0.915, words, fontsize=11, color=INK)


def blank(width_in: float, height_in: float) -> Figure:
    """Return a figure on a canvas of its own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def write(figure: Figure, name: str) -> None:
    """Write the figure as a PNG with 256 colours, to keep it small."""
    figure.canvas.draw()
    pixels: Any = figure.canvas
    image = Image.fromarray(np.asarray(pixels.buffer_rgba())[..., :3])
    image.quantize(256, dither=Image.Dither.NONE).save(DOCS / "images" / name, optimize=True)
    print(f"written to docs/images/{name}")


if __name__ == "__main__":
    draw()
