"""Rows of figures as commands print them: a table, JSON, and a note of colours out of reach."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from volspec.cli.shell import Terminal, note, print_json, print_table

Row = dict[str, Any]


def show_rows(title: str, rows: list[Row], as_json: bool) -> None:
    """Print rows as JSON or as a table; what is the same in all of them goes to the title."""
    from rich.table import Table

    if as_json:
        print_json([{k: _finite(v) for k, v in row.items()} for row in rows])
        return
    names = list(dict.fromkeys(name for row in rows for name in row))
    if "L_A" in names:
        title += f", L_A {rows[0]['L_A']:.4g} cd/m², Y_b {rows[0]['Y_b']:g}"
    plain = all(row["defined"] for row in rows if "defined" in row)
    hidden = {"L_A", "Y_b", *(["defined"] if plain else [])}
    alike = [name for name in names[:4] if "model" in names and len({r[name] for r in rows}) == 1]
    for name in alike:
        title += f", {name} {rows[0][name]}"
        hidden.add(name)
    table = Table(box=None, pad_edge=False)
    shown = [name for name in names if name not in hidden]
    for name in shown:
        table.add_column(name, justify="left" if name == "model" else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(_cell(row.get(name, "")) for name in shown))
    # A narrow screen wraps lines; digits are never cut.
    print_table(title, table, Terminal(width=max(Terminal().width, 110)))


def tell_undefined(rows: Mapping[str, list[Row]]) -> None:
    """Say how many colours are not ``defined``, by the name of what does not define them."""
    missed = {name: sum(not row["defined"] for row in each) for name, each in rows.items()}
    missed = {name: count for name, count in missed.items() if count}
    if not missed:
        return
    (first, count), *others = missed.items()
    total = len(rows[first])
    said = f"{count} of {total} colour{'s' * (total > 1)} lie{'s' * (count == 1)} outside "
    said += f"the domain of {first}"
    said += "".join(f", {more} outside that of {name}" for name, more in others)
    note(f"{said}; marked defined = false")


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _finite(value: Any) -> Any:
    """JSON has no word for what is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
