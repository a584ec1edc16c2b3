"""Render a design's report for a terminal: a matrix of colours, metamers, bounds, suggestions.

measures -> [text] -> report, rich
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from volspec.appearance.comparison import SYMBOLS
from volspec.appearance.display import VISION
from volspec.palette.measures import ApartReport, CellReport, DesignMeasures, MetamerReport
from volspec.palette.model import hexadecimal
from volspec.palette.variables import mixture_text

# With more lights than this there is no room for codes and differences.
_MAX_WITH_CODES = 6
# For more other lights than this, metamers' differences are summarised.
_MAX_NAMED = 4
_WIDTH = 100


def plain_text(report: DesignMeasures) -> str:
    """Return the report as text, without colours."""
    sink = io.StringIO()
    Console(file=sink, width=_WIDTH, color_system=None, highlight=False).print(
        render(report, colours=False)
    )
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines())


def render(report: DesignMeasures, *, colours: bool) -> Group:
    """Return the report as rich renderables, with swatches if ``colours``."""
    blocks: list[RenderableType] = [_matrix(report, colours), Text("")]
    if report.apart:
        blocks += [_pair_table(report.apart), Text("")]
    blocks += _lines(report)
    if report.suggestions:
        blocks += [Text(""), Text("what would help", style="dim")]
        bullets = Table.grid(padding=(0, 1))
        for sentence in report.suggestions:
            bullets.add_row("•", Text(sentence))
        blocks.append(bullets)
    return Group(*blocks)


def _matrix(report: DesignMeasures, colours: bool) -> Table:
    """Reflectances as rows, lights as columns: the obtained colour and its difference."""
    columns = list(dict.fromkeys(cell.light for cell in report.cells))
    codes = len(columns) <= _MAX_WITH_CODES
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="dim")
    symbol = SYMBOLS[report.difference]
    table.add_column(f"colour, {symbol}" if codes else symbol, style="bold", no_wrap=True)
    for column in columns:
        table.add_column(Text(column), justify="left" if codes else "right", no_wrap=codes)
    for row in dict.fromkeys(cell.reflectance for cell in report.cells):
        cells = (cell for cell in report.cells if cell.reflectance == row)
        table.add_row(Text(row), *(_cell(cell, codes, colours) for cell in cells))
    return table


def _cell(cell: CellReport, codes: bool, colours: bool) -> Text:
    text = Text()
    code = hexadecimal(cell.obtained)
    if colours:
        text.append("  ", style=f"on {code}")
        text.append(" ")
    if codes:
        text.append(code + ("" if cell.in_gamut else "!") + " ")
    if cell.error is not None:
        digits = 1 if codes or cell.error < 9.95 else 0
        text.append(f"{cell.error:.{digits}f}", style="bold" if cell.error > 1.0 else "")
    elif cell.delta_E is not None:
        text.append(f"≠ {cell.delta_E:.0f}")
    else:
        text.append("–", style="dim")
    return text


def _lines(report: DesignMeasures) -> Iterator[Text]:
    yield Text.assemble(
        (f"{SYMBOLS[report.difference]} ", "dim"),
        f"mean {report.mean:.2f}, largest {report.max:.2f}; exposure {report.exposure:g}",
    )
    outside = [cell for cell in report.cells if not cell.in_gamut]
    if outside:
        # The matrix marks these if it shows codes.
        yield Text.assemble(
            ("outside the display (!) ", "dim"), f"{len(outside)} colour{'s' * (len(outside) > 1)}"
        )
    for light in dict.fromkeys(pair.light for pair in report.metamers):
        yield _metamers(light, [pair for pair in report.metamers if pair.light == light])
    for kind in ("reflectance", "light"):
        bound = [s for s in report.spectra if s.kind == kind]
        if bound:
            low, high = sum(s.at_lower for s in bound), sum(s.at_upper for s in bound)
            bands = sum(s.bands for s in bound)
            yield Text.assemble(
                (f"{kind}s ", "dim"),
                f"{low} of {bands} bands at their lower bound, {high} at their upper one",
            )
    for spectrum in report.spectra:
        if spectrum.lamps:
            mixture = f"{spectrum.name} = {mixture_text(spectrum.lamps)}, shares of the illuminance"
            yield Text.assemble(("mixture ", "dim"), mixture)
    cost = ", ".join(f"{name} {value:.2g}" for name, value in report.cost.items() if value)
    yield Text.assemble(("cost ", "dim"), cost or "0")


def _metamers(light: str, pairs: list[MetamerReport]) -> Text:
    """Largest ΔE of metamers under their light, the range under others, and who sees them alike."""
    many = f"{len(pairs)} pairs" if len(pairs) > 1 else " and ".join(pairs[0].reflectances)
    other_lights = list(pairs[0].apart)
    elsewhere = [f"{_range([p.apart[n] for p in pairs])} under {n}" for n in other_lights]
    if len(other_lights) > _MAX_NAMED:
        elsewhere = [f"{_range([d for p in pairs for d in p.apart.values()])} elsewhere"]
    largest = f"{max(pair.delta_E for pair in pairs):.2f}"
    fine = f"{max(pair.delta_E_1nm for pair in pairs):.2f}"
    largest += f" ({fine} at 1 nm)" if fine != largest else ""
    maximum = f"at most ΔE {largest}" if len(pairs) > 1 else f"ΔE {largest}"
    spread = f", apart {', '.join(elsewhere)}" if elsewhere else ""
    percentage = _range([100.0 * pair.observers.alike for pair in pairs])
    people = f"; alike to {percentage} % of {pairs[0].observers.count} observers"
    return Text.assemble(("alike under ", "dim"), f"{light}: {many}, {maximum}{spread}{people}")


def _pair_table(pairs: Sequence[ApartReport]) -> Table:
    """Pairs as rows, kinds of colour vision as columns: least ΔE00 under the lights asked for."""
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="dim")
    table.add_column("apart, least ΔE00", style="bold")
    table.add_column("under")
    for name in VISION.values():
        table.add_column(name, justify="right")
    for pair in pairs:
        severity = "" if pair.severity == 1.0 else f", severity {pair.severity:g}"
        title = f"{' and '.join(pair.reflectances)}{severity}"
        figures = (
            Text(f"{value:.0f}", style="bold" if name in pair.deficiencies else "")
            for name, value in pair.smallest.items()
        )
        table.add_row(Text(title), Text(", ".join(pair.lights)), *figures)
        other_lights = [light for light in pair.delta_E if light not in pair.lights]
        for light in other_lights if len(other_lights) <= _MAX_NAMED else ():
            numbers = (Text(f"{value:.0f}", style="dim") for value in pair.delta_E[light].values())
            table.add_row("", Text(light, style="dim"), *numbers)
    return table


def apart_text(pair: ApartReport) -> str:
    """Return a pair's lights, reflectances, and smallest CIEDE2000 by colour vision."""
    severity = "" if pair.severity == 1.0 else f" (severity {pair.severity:g})"
    figures = ", ".join(f"{VISION[name]} {value:.0f}" for name, value in pair.smallest.items())
    return f"{', '.join(pair.lights)}: {' – '.join(pair.reflectances)} ΔE {figures}{severity}"


def _range(values: list[float]) -> str:
    low, high = (f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"
