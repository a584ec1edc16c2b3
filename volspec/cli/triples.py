"""Triples as the command line takes them: numbers in a row, or a table of them."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from volspec._parse import read_text
from volspec.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


# Of a colour whose white is 100.
LARGEST = 1e9


def read_triples(
    values: Sequence[float], table: Path | None, names: Sequence[str]
) -> NDArray[np.float64]:
    """Triples from words or from a CSV file.

    Parameters
    ----------
    values : sequence of float
        Three a triple.
    table : Path, optional
        CSV: a column for each name, found by the first line, or the first three where that holds
        numbers; ``-`` is standard input.
    names : (3,) of str
        What the numbers are, as ``("X", "Y", "Z")``.

    Returns
    -------
    (N, 3) float64

    Raises
    ------
    InputError
        If there is none, their number is no multiple of three, or one is beyond 1e9 or no number.
    """
    import numpy as np

    kind = " ".join(names)
    if table is None:
        if not values or len(values) % 3:
            raise InputError(f"{len(values)} numbers; give {kind}, three a colour, or --table FILE")
        rows = np.array(values, dtype=np.float64).reshape(-1, 3)
        if not (fits := np.abs(rows) <= LARGEST).all():
            raise InputError(
                f"{kind}: {rows[~fits][0]} is no colour; give numbers within {LARGEST:g}"
            )
        return rows
    if values:
        raise InputError(f"{kind} both as words and in {table}; give one of them", code="conflict")
    try:
        is_piped = str(table) == "-"
        text = sys.stdin.read() if is_piped else read_text(table, InputError, f"a CSV of {kind}")
        read = csv.reader(io.StringIO(text))
        lines = [line for line in read if any(cell.strip() for cell in line)]
    except UnicodeDecodeError:  # of what was piped
        raise InputError(f"{table}: not a text file; give a CSV table of {kind}") from None
    except csv.Error as error:  # a cell of more than 131,072 letters
        raise InputError(f"{table}: not a CSV table ({error}); export it again") from None
    if not lines:
        raise InputError(f"{table}: empty; give a CSV table with columns {', '.join(names)}")
    head = [cell.strip() for cell in lines[0]]
    columns = [0, 1, 2]
    if not _is_number(head[0]):
        missing = [name for name in names if name not in head]
        if missing:
            raise InputError(f"{table}: no column {missing[0]}; its first line is {','.join(head)}")
        columns, lines = [head.index(name) for name in names], lines[1:]
        if not lines:
            raise InputError(f"{table}: no rows below its first line; give one a colour")
    return np.array([_row(table, i, line, columns) for i, line in enumerate(lines, 1)])


def _row(table: Path, number: int, line: Sequence[str], columns: Sequence[int]) -> list[float]:
    cells = [line[i].strip() if i < len(line) else "" for i in columns]
    for cell in cells:
        if not _is_number(cell):
            raise InputError(f"{table}: row {number} has {cell!r} where a number belongs")
    return [float(cell) for cell in cells]


def _is_number(cell: str) -> bool:
    try:
        return abs(float(cell)) <= LARGEST
    except ValueError:
        return False
