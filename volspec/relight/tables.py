"""Appearance tables that the host works out: for models of which no shader draws the passage.

viewing, white -> [tables] -> lookups -> shaders/include/table.glsl

A table takes the host some tenths of a second to seconds, and a frame cannot be drawn before it.
Whoever must not wait asks `Relighter.missing_table` and has it worked out on another thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.display import Display
from volspec.appearance.live import CLOSED, passage_of
from volspec.appearance.spec import Viewing
from volspec.appearance.table import TablePassage, TableSpace
from volspec.relight.illumination import Illumination

# Kept, of 1.1 MB each: a handful of lights that somebody goes to and fro between.
MOST_TABLES = 12


def plain(viewing: Viewing) -> Display:
    """A viewing's display without what becomes of colours at it: passages do not ask for that."""
    return replace(viewing.display, gamut="clip", mark=False)


def is_tabled(model: str) -> bool:
    """Whether a model's passage is looked up in a table that only the host can work out.

    >>> is_tabled("Hunt"), is_tabled("CIECAM02")
    (True, False)
    """
    return model not in CLOSED and model not in ADAPTATIONS


@dataclass(frozen=True, slots=True)
class TableKey:
    """What a table follows from.

    Parameters
    ----------
    viewing : Viewing
        Under the light, of a `plain` display.
    white_XYZ : tuple of float
        The adopted white.
    """

    viewing: Viewing
    white_XYZ: tuple[float, ...]

    @classmethod
    def of(cls, light: Illumination, viewing: Viewing) -> TableKey:
        """Of a viewing under a light, with nothing in it to be measured."""
        white = tuple(float(value) for value in light.white_XYZ)
        return cls(replace(viewing, display=plain(viewing)), white)


class HostTables:
    """Tables as they were worked out, the latest `MOST_TABLES`; threads and Relighters share them.

    Examples
    --------
    >>> tables = HostTables()
    >>> key = TableKey(Viewing(model="Nayatani95"), (95.05, 100.0, 108.88))
    >>> key in tables, tables.texels(key).shape, key in tables
    (False, (41, 41, 41, 4), True)
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # The latest last; a viewing's parts need not be hashable.
        self._made: list[tuple[TableKey, NDArray[np.float32]]] = []

    def __contains__(self, key: TableKey) -> bool:
        with self._lock:
            return any(own == key for own, _ in self._made)

    def texels(
        self, key: TableKey, cancel: Callable[[], bool] | None = None
    ) -> NDArray[np.float32]:
        """(NODES, NODES, NODES, 4) a table's codes, and 1; worked out where it is not there yet.

        Parameters
        ----------
        key : TableKey
        cancel : callable, optional
            Asked before each eighth of the work; where it says so, nothing is kept.

        Raises
        ------
        ViewingError
            If the white is none, or the model gives no colour at some node.
        TableCancelled
            If ``cancel`` says so.
        """
        with self._lock:
            found = next((texels for own, texels in self._made if own == key), None)
        if found is None:
            found = _texels(key, cancel)
        with self._lock:
            rest = [pair for pair in self._made if pair[0] != key]
            self._made = [*rest, (key, found)][-MOST_TABLES:]
        return found


def _texels(key: TableKey, cancel: Callable[[], bool] | None) -> NDArray[np.float32]:
    space = TableSpace.between(key.white_XYZ, key.viewing.display.colours)
    made = TablePassage.of(passage_of(key.viewing, key.white_XYZ), space, cancel)
    return np.ascontiguousarray(np.concatenate([made.codes, made.trusted[..., None]], axis=-1))
