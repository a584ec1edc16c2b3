"""Figure of a basis: its sensors, its errors light by light, its worst colours.

    basis, error table -> [figure] -> PNG, PDF, SVG

Lines differ in shape, and in colours that colour-blind people can distinguish.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._figures import (
    DPI,
    FAINT,
    HAIR,
    INK,
    inch_axes,
    new_figure,
    shorten,
    spread_apart,
    style_axes,
    write,
    write_figure,
)
from volspec.appearance.display import (
    decode_sRGB,
    encode_sRGB,
    linear_sRGB_from_XYZ,
    spaces,
    spectrum_colours,
)
from volspec.appearance.models import XYZ_from_cielab, cielab
from volspec.basis.display import DEFAULT_MODE
from volspec.basis.materials import Basis, MaterialBasis
from volspec.basis.report import NOTHING, RGB_PRODUCT, WAYS, BasisReport, WorstPair, round_delta
from volspec.basis.report_table import class_heading, format_delta_e
from volspec.spectra import DEFAULT_GRID, SpectralGrid, colour_matching_functions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from volspec.basis.report import ErrorSummary
    from volspec.basis.report_table import ErrorTable

Array = NDArray[np.float64]

WIDTH_IN = 10.0
_MARGIN = 0.42
_CAPTION_LINE = 0.165


def basis_figure(errors: ErrorTable) -> Figure:
    """Draw a basis and its errors; 1600 pixels wide."""
    caption = _CAPTION_LINE * (len(errors.classes) + 1) + 0.2
    strip = caption + 0.13
    plots = strip + (STRIP_IN if _has_colours(errors) else 0.0) + 0.84
    height = plots + 2.5 + 1.06
    figure, basis = new_figure(WIDTH_IN, height), errors.basis
    _draw_title(figure, errors)
    draw_spectra(inch_axes(figure, 0.62, plots, 3.98 - name_width(basis), 2.5), basis)
    draw_errors(inch_axes(figure, 5.32, plots, WIDTH_IN - 5.32 - _MARGIN, 2.5), errors)
    if _has_colours(errors):
        draw_swatches(inch_axes(figure, _MARGIN, strip, WIDTH_IN - 2 * _MARGIN, STRIP_IN), errors)
    _draw_caption(figure, errors, caption)
    return figure


def save_figure(errors: ErrorTable, path: str | os.PathLike[str]) -> None:
    """Write `basis_figure` in the format of the file's suffix; whole or not at all."""
    write_figure(basis_figure(errors), path)


def _has_colours(errors: ErrorTable) -> bool:
    """Return True if any colour has an error, so that there are worst ones to show."""
    return errors.worst.delta_e > NOTHING


def _draw_title(figure: Figure, errors: ErrorTable) -> None:
    basis, height = errors.basis, figure.get_figheight()
    left, first, second = _MARGIN / WIDTH_IN, 1 - 0.36 / height, 1 - 0.56 / height
    title = write(figure, left, first, basis.name, fontsize=15, weight="bold", color=INK)
    shorten(title, 4.5)
    edge = title.get_window_extent().x1 / DPI + 0.14
    facts = f"{basis.method}, {basis.size} channels, {basis.observer_deg}° observer"
    grid = basis.grid
    if grid != DEFAULT_GRID:
        facts += f", {grid.start_nm:g}\N{EN DASH}{grid.stop_nm:g} nm every {grid.step_nm:g} nm"
    write(figure, edge / WIDTH_IN, first, facts, fontsize=9.5, color=FAINT)
    origin = (
        "each channel the share of one material: exact by construction"
        if isinstance(basis, MaterialBasis)
        else f"trained on {basis.trained_on}"
    )
    text = f"{origin}; measured on {errors.measured_on}"
    line = write(figure, left, second, text, fontsize=7.5, color=FAINT)
    shorten(line, WIDTH_IN - 2 * _MARGIN)


def _draw_caption(figure: Figure, errors: ErrorTable, top: float) -> None:
    """Draw a small table: one line per class, one column per mode."""
    chained = all(report.products for report in errors.classes.values())
    modes = ("fitted", "componentwise", RGB_PRODUCT)
    columns = [WAYS[mode] for mode in modes]
    columns += ["two surfaces", "three surfaces"] if chained else []
    left = _MARGIN + 1.86
    pitch = min((WIDTH_IN - _MARGIN - left) / (len(columns) - 0.12), 1.7)
    height = figure.get_figheight()

    def cell(x: float, line: int, text: str, **style: Any) -> None:
        y = (top - 0.1 - _CAPTION_LINE * line) / height
        write(figure, x / WIDTH_IN, y, text, fontsize=7.2, va="center", **style)

    cell(_MARGIN, 0, "ΔE00 mean / median / 95 % / max", color=FAINT)
    for i, column in enumerate(columns):
        cell(left + pitch * i, 0, column, color=FAINT)
    for line, (name, report) in enumerate(errors.classes.items(), start=1):
        cell(_MARGIN, line, class_heading(name, len(report.pairs.lights)), color=INK)
        summaries = [report.errors[mode] for mode in modes]
        summaries += [p.fitted for p in report.products.values()]
        for i, summary in enumerate(summaries):
            bold = {"weight": "bold"} if columns[i] == WAYS[DEFAULT_MODE] else {}
            cell(left + pitch * i, line, _four(summary), color=INK, **bold)


def _four(summary: ErrorSummary) -> str:
    values = (summary.mean, summary.median, summary.p95, summary.max)
    texts = (f"{v:.3f}" if v < 0.001 else format_delta_e(v) for v in values)
    return " / ".join(text.removeprefix("0") for text in texts)


# Okabe and Ito's blue, vermilion and green, which colour-blind people can distinguish.
_BLUE, _VERMILION, _GREEN = "#0072b2", "#d55e00", "#009e73"
_FLOORS = (1e-4, 1e-2)
_MAX_NAMED = 9
_STYLES: dict[str, dict[str, Any]] = {
    RGB_PRODUCT: {"marker": "^", "markersize": 3.4, "color": _VERMILION, "zorder": 3,
                  "markeredgewidth": 0},
    "componentwise": {"marker": "o", "markersize": 3.6, "color": _GREEN, "zorder": 4,
                      "markerfacecolor": "none", "markeredgewidth": 0.9},
    "fitted": {"marker": "o", "markersize": 3.2, "color": _BLUE, "zorder": 5,
               "markeredgewidth": 0},
}  # fmt: skip


def draw_errors(axes: Axes, errors: ErrorTable) -> None:
    """Draw every light's mean error, sorted within its class, with a hairline up to its largest."""
    modes = (RGB_PRODUCT, "componentwise", "fitted")
    means = {
        name: {mode: report.pairs.delta_e[mode].mean(axis=1) for mode in modes}
        for name, report in errors.classes.items()
    }
    all_means = np.concatenate([m for modes in means.values() for m in modes.values()])
    visible = all_means[all_means > _FLOORS[0]]
    lowest = float(visible.min()) if visible.size else 1.0
    floor = float(np.clip(10.0 ** np.floor(np.log10(lowest)), *_FLOORS))
    own_max = {n: r.pairs.delta_e[DEFAULT_MODE].max(axis=1) for n, r in errors.classes.items()}
    top = max(float(all_means.max()), *(float(tips.max()) for tips in own_max.values()), 3.0)
    axes.set(xlim=(0, 1), yscale="log", ylim=(floor / 1.5, 2.2 * top))
    style_axes(axes)
    below = "≤ " if all_means.min() < floor else ""
    axes.yaxis.set_major_formatter(lambda v, _: f"{below if v < 1.01 * floor else ''}{v:g}")
    axes.minorticks_off()
    axes.grid(axis="y", color=HAIR, linewidth=0.6)
    axes.axhline(1.0, color=FAINT, linewidth=0.8, zorder=1.5)
    axes.set_xticks([])
    axes.set_ylabel("mean ΔE00, hairs to the largest", fontsize=8, color=FAINT, labelpad=1)
    widths = np.sqrt([len(r.pairs.lights) + 3.0 for r in errors.classes.values()])
    ends = np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])
    above = axes.get_xaxis_transform()
    named: list[tuple[float, str]] = []
    scene_count = min(len(errors.classes["scene"].pairs.lights), 5) if "scene" in means else 0
    per_class = max((_MAX_NAMED - scene_count) // max(len(means) - bool(scene_count), 1), 1)
    for (name, report), left, right in zip(errors.classes.items(), ends, ends[1:], strict=False):
        order = _argsort_delta_e(own_max[name])
        x = left + (right - left) * (np.arange(len(order)) + 1.0) / (len(order) + 1.0)
        if left:
            axes.axvline(left, color=HAIR, linewidth=0.8)
        for mode in modes:
            y = np.maximum(means[name][mode][order], floor)
            if mode == DEFAULT_MODE:
                tips, ink = np.maximum(own_max[name][order], floor), _STYLES[mode]["color"]
                axes.vlines(x, y, tips, color=ink, linewidth=0.7, alpha=0.55, zorder=2)
            axes.plot(x, y, linestyle="none", **_STYLES[mode])
        middle = (left + right) / 2
        write(axes, middle, 1.015, f"{name} ({len(order)})", transform=above, ha="center",
                  va="bottom", fontsize=7.5, color=FAINT)  # fmt: skip
        last = scene_count if name == "scene" else per_class if own_max[name].max() > NOTHING else 0
        named += [(x[i], report.pairs.lights[order[i]]) for i in range(len(x))[len(x) - last :]]
    _name_lights(axes, named)
    _draw_legend(axes, modes)


def _name_lights(axes: Axes, named: list[tuple[float, str]]) -> None:
    """Write slanted names under the axis, with hairlines up to their lights."""
    positions = np.array([x for x, _ in named])
    places = spread_apart(positions, 0.062, 0.03, 0.99)
    below = axes.get_xaxis_transform()
    for x, place, (_, name) in zip(positions, places, named, strict=True):
        axes.plot([x, x, place], [0, -0.012, -0.05], transform=below, color=FAINT, linewidth=0.5,
                  clip_on=False, zorder=1)  # fmt: skip
        short = name if len(name) <= 18 else name[:17].rstrip(" (") + "…"
        write(axes, place + 0.008, -0.06, short, transform=below, rotation=32, ha="right",
              va="top", rotation_mode="anchor", fontsize=6.8, color=INK)  # fmt: skip


def _draw_legend(axes: Axes, ways: Sequence[str]) -> None:
    handles = [axes.plot([], [], linestyle="none", label=WAYS[w], **_STYLES[w])[0] for w in ways]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(-0.02, 1.105), ncols=3,
                frameon=False, fontsize=8, labelcolor=INK, handletextpad=0.1, columnspacing=1.2,
                borderaxespad=0, borderpad=0)  # fmt: skip


# L* = 50: colours are judged on a neutral grey.
_GREY, _ON_GREY, _QUIET = "#777777", "white", "#e4e4e4"
_MAX = 9
_GAP = 0.14
STRIP_IN = 1.92
"""Height of the strip of swatches."""


def draw_swatches(axes: Axes, errors: ErrorTable) -> None:
    """Draw the worst reflectance under each of the worst lights, by class, on neutral grey.

    The upper left half is the full spectra's colour, the lower right half the channels' colour.
    Axes are in inches.
    """
    figure = axes.get_figure()
    assert figure is not None
    box = axes.get_window_extent()
    box_w, box_h = box.width / figure.dpi, box.height / figure.dpi
    axes.set(xlim=(0, box_w), ylim=(0, box_h))
    axes.set_axis_off()
    axes.fill((0, 0, box_w, box_w), (0, box_h, box_h, 0), color=_GREY, linewidth=0)
    counts = share_out(_MAX, [len(r.pairs.lights) for r in errors.classes.values()])
    groups = {
        name: worst_pairs(report, count)
        for (name, report), count in zip(errors.classes.items(), counts, strict=True)
    }
    count = sum(map(len, groups.values()))
    between = 0.16 * (len(groups) - 1)
    width = (box_w - 0.3 - between - _GAP * (count - 1)) / count
    size = min(width, 0.86)
    pitch = min(width + _GAP, 1.4)
    x = 0.15
    top = box_h - 0.56
    ours = f"{errors.basis.size} channels, {WAYS[DEFAULT_MODE]}"
    key = f"worst colours: upper left, the full spectra; lower right, {ours}"
    write(axes, 0.15, box_h - 0.18, key, fontsize=8.5, color=_ON_GREY, va="center")
    for name, pairs in groups.items():
        heading = class_heading(name, len(errors.classes[name].pairs.lights)).removeprefix("the ")
        write(axes, x, box_h - 0.42, heading, fontsize=7.5, color=_QUIET, va="center")
        for pair in pairs:
            left, low = x, top - size
            xs, ys = (left, left, left + size, left + size), (low, top, top, low)
            axes.fill(xs, ys, color=pair.sRGB_shown, linewidth=0)
            axes.fill(xs[:3], ys[:3], color=pair.sRGB, linewidth=0)
            lines = (
                pair.reflectance,
                f"under {pair.light}",
                f"ΔE00 {format_delta_e(pair.delta_e)}",
            )
            for row, line in enumerate(lines):
                weight = "bold" if row == 2 else "normal"
                text = write(axes, left, low - 0.1 - 0.128 * row, line, fontsize=6.4, va="center",
                             color=_ON_GREY if row != 1 else _QUIET, weight=weight)  # fmt: skip
                shorten(text, pitch - 0.06)
            x += pitch
        x += 0.16


def _argsort_delta_e(delta_e: Array) -> NDArray[np.intp]:
    """Return the order of colour differences; those that `round_delta` alike keep theirs."""
    return np.argsort(round_delta(delta_e), kind="stable")


def share_out(places: int, sizes: list[int]) -> list[int]:
    """Distribute places evenly: no class gets two more than another that still wants one."""
    counts = [0] * len(sizes)
    while sum(counts) < places and counts != sizes:
        minimum = min(g for g, w in zip(counts, sizes, strict=True) if g < w)
        hungry = [i for i, w in enumerate(sizes) if counts[i] == minimum < w]
        if len(hungry) > places - sum(counts):
            break
        for i in hungry:
            counts[i] += 1
    return counts


def worst_pairs(report: BasisReport, count: int) -> list[WorstPair]:
    """Return the worst pairs, with different lights and, if possible, different reflectances."""
    delta_e = report.pairs.delta_e[DEFAULT_MODE]
    pairs: list[tuple[int, int]] = []
    for once in (True, False):
        for flat in _argsort_delta_e(-delta_e.ravel()):
            j, i = divmod(int(flat), delta_e.shape[1])
            if len(pairs) == count:
                break
            if all(j != light and not (once and i == sample) for light, sample in pairs):
                pairs.append((j, i))
    pairs = [pairs[k] for k in _argsort_delta_e(np.array([-delta_e[pair] for pair in pairs]))]
    return [WorstPair.at(report.pairs, j, i) for j, i in pairs]


_LINE_LIGHTNESS = (30.0, 58.0)
_WIDEST_NAME = 1.1
# More curves than this are drawn as ridges, one line each; this many get names.
_MAX_CURVES = 10
_MAX_RIDGE_NAMES = 30
# Number of labels that fit across and along the plot.
_ACROSS, _ALONG = 28.0, 16.0
# Colours closer than this in CIELAB get different strokes.
_ALIKE = 14.0
_STROKES = ("-", (0, (4.0, 1.2)), (0, (1.2, 1.0)), (0, (6.0, 1.2, 1.2, 1.2)))


def draw_spectra(axes: Axes, basis: Basis) -> None:
    """Draw sensors, basis vectors or reflectances over the grid, in their colours."""
    from matplotlib.ticker import MultipleLocator

    grid = basis.grid
    style_axes(axes)
    axes.set_xlim(grid.start_nm, grid.stop_nm)
    if isinstance(basis, MaterialBasis):
        title = "reflectances of the materials"
        curves = np.array([spectrum.values for spectrum in basis.materials.values()])
        draw = _draw_ridges if len(curves) > _MAX_CURVES else _draw_reflectances
        draw(axes, curves, list(basis.materials), grid)
    elif basis.method.startswith("pca"):
        title = "basis vectors (columns of B)"
        _draw_sensors(axes, basis.synthesis.T, grid)
    else:
        title = "sensors (rows of A)"
        _draw_sensors(axes, basis.analysis, grid)
    axes.text(0, 1.105, title, transform=axes.transAxes, fontsize=9.5, color=INK, va="center")
    axes.tick_params(axis="x", pad=11)
    axes.xaxis.set_major_locator(MultipleLocator(50 if grid.stop_nm - grid.start_nm < 400 else 100))
    axes.set_xlabel("wavelength, nm", fontsize=8, color=FAINT, labelpad=3)
    _draw_spectrum(axes, grid)


def name_width(basis: Basis) -> float:
    """Return the width, in inches, of the materials' names next to their curves."""
    if not isinstance(basis, MaterialBasis):
        return 0.0
    return min(0.062 * max(map(len, basis.materials)) + 0.05, _WIDEST_NAME)


def line_colour(curve: Array, grid: SpectralGrid) -> tuple[float, float, float]:
    """Return sRGB of flat light filtered by a curve, made light or dark enough for a line."""
    Q = colour_matching_functions(grid)
    XYZ = Q @ np.maximum(curve, 0.0)
    white = Q.sum(1)
    if not XYZ[1] > 0:
        return (0.4, 0.4, 0.4)
    L, a, b = cielab(XYZ * (0.3 * white[1] / XYZ[1]), white)
    strong = min(1.0, 70.0 / max(float(np.hypot(a, b)), 1e-9))
    Lab = np.array([np.clip(L, *_LINE_LIGHTNESS), a * strong, b * strong])
    linear = linear_sRGB_from_XYZ(XYZ_from_cielab(Lab, spaces.sRGB_WHITE_XYZ))
    r, g, blue = encode_sRGB(linear)
    return float(r), float(g), float(blue)


def _draw_sensors(axes: Axes, curves: Array, grid: SpectralGrid) -> None:
    """Draw curves from below zero to their peaks, numbered."""
    low, high = min(float(curves.min()), 0.0), float(curves.max())
    room = 0.1 * (high - low)
    axes.set(ylim=(low - (room if low < 0 else 0), high + room), yticks=[0])
    colours = _draw_curves(axes, curves, grid)
    labels = [str(i + 1) for i in range(len(curves))]
    _number_peaks(axes, grid.wavelengths_nm, curves, labels, colours)


def _draw_reflectances(axes: Axes, curves: Array, labels: list[str], grid: SpectralGrid) -> None:
    """Draw curves from zero to one, named at their ends."""
    axes.set_ylim(0, max(1.0, 1.05 * float(curves.max())))
    _name_ends(axes, curves[:, -1], labels, _draw_curves(axes, curves, grid))


def _draw_ridges(axes: Axes, curves: Array, labels: list[str], grid: SpectralGrid) -> None:
    """Draw each curve on its own line, filled and named."""
    K = len(curves)
    axes.set(ylim=(K + 0.15, 0), yticks=[])
    stride = -(-K // _MAX_RIDGE_NAMES)
    size = float(np.clip(150.0 / K, 5.0, 7.0))
    for i, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        base, colour = i + 1.0, line_colour(curve, grid)
        w, top = grid.wavelengths_nm, base - 0.95 * np.minimum(curve, 1.0)
        axes.fill_between(w, base, top, color=colour, linewidth=0.4)
        if i % stride == 0:
            text = write(axes, 1.012, base - 0.4, label, transform=axes.get_yaxis_transform(),
                         fontsize=size, color=colour, va="center")  # fmt: skip
            shorten(text, _WIDEST_NAME)


def _draw_curves(axes: Axes, curves: Array, grid: SpectralGrid) -> list[Any]:
    """Draw curves in their colours, and return the colours."""
    colours = [line_colour(curve, grid) for curve in curves]
    axes.axhline(0, color=FAINT, linewidth=0.6, zorder=1)
    for curve, colour, stroke in zip(curves, colours, _strokes(colours), strict=True):
        axes.plot(grid.wavelengths_nm, curve, color=colour, linewidth=1.7, linestyle=stroke,
                  zorder=3)  # fmt: skip
    return colours


def _strokes(colours: list[tuple[float, float, float]]) -> list[Any]:
    """Return a stroke per colour: solid, or another one if a previous colour is similar."""
    linear = decode_sRGB(np.array(colours))
    Lab = cielab(linear @ spaces.XYZ_FROM_sRGB.T, spaces.sRGB_WHITE_XYZ)
    kinds: list[int] = []
    for i in range(len(Lab)):
        taken = [kinds[j] for j in range(i) if np.linalg.norm(Lab[i] - Lab[j]) < _ALIKE]
        free = [kind for kind in range(len(_STROKES)) if kind not in taken]
        kinds.append(free[0] if free else i % len(_STROKES))
    return [_STROKES[kind] for kind in kinds]


def _number_peaks(
    axes: Axes, w: Array, curves: Array, labels: list[str], colours: list[Any]
) -> None:
    """Write each curve's number near its peak, clear of other curves and numbers."""
    bottom, top = axes.get_ylim()
    scale = np.array([(w[-1] - w[0]) / _ACROSS, (top - bottom) / _ALONG])
    placed: list[Array] = []
    for curve, label, colour in zip(curves, labels, colours, strict=True):
        peak = int(np.abs(curve).argmax())
        up = 1 if curve[peak] > 0 else -1
        places = []
        for i in np.flatnonzero(up * curve > 0.75 * abs(curve[peak])):
            spot = np.array([w[i], curve[i] + up * 0.8 * scale[1]])
            lines = np.abs(curves[:, i] - spot[1]) / scale[1]
            distances = [np.abs((spot - p) / scale).max() for p in placed]
            clear = min(1.0, *(lines / 0.6), *distances)
            places.append((clear - 0.8 * (1 - abs(curve[i] / curve[peak])), int(i), spot))
        _, best, spot = max(places, key=lambda place: place[:2])
        placed.append(spot)
        x = float(np.clip(w[best], w[0] + 4, w[-1] - 4))
        axes.text(x, spot[1], label, ha="center", va="center", fontsize=7.5, color=colour,
                  weight="bold", zorder=6)  # fmt: skip


def _name_ends(axes: Axes, ends: Array, labels: list[str], colours: list[Any]) -> None:
    """Write names at the curves' right ends, spread apart, with hairlines."""
    bottom, top = axes.get_ylim()
    level = (ends - bottom) / (top - bottom)
    frame = axes.transAxes
    for y0, y, label, colour in zip(level, spread_apart(level, 0.056, 0.02, 0.98), labels, colours,
                                    strict=True):  # fmt: skip
        axes.plot([1.0, 1.02], [y0, y], transform=frame, color=colour, linewidth=0.6,
                  clip_on=False)  # fmt: skip
        text = write(axes, 1.028, y, label, transform=frame, fontsize=7, color=colour, va="center")
        shorten(text, _WIDEST_NAME)


def _draw_spectrum(axes: Axes, grid: SpectralGrid) -> None:
    """Draw the colours of the wavelengths as a strip under the axis."""
    strip = axes.inset_axes((0.0, -0.048, 1.0, 0.035))
    nm = np.linspace(grid.start_nm, grid.stop_nm, 600)
    strip.imshow(spectrum_colours(nm)[None], aspect="auto")
    strip.set_axis_off()
