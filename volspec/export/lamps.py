"""Relighters at hand: uploaded once for all lights, kept while pictures have the same shape.

panes, shot -> [lamps] -> pixels
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volspec.export.pixels import Array, Pane
from volspec.export.plan import Shot
from volspec.relight import Relighter


class Lamps:
    """Relighters of the images at hand, kept as long as the images' shape stays."""

    def __init__(self) -> None:
        self._held: list[tuple[Pane, Relighter]] = []

    def row(self, panes: Sequence[Pane], shot: Shot) -> Array:
        """Pixels of images side by side under a shot's light."""
        if [pane for pane, _ in self._held] != list(panes):
            self._take(panes)
        return np.hstack([pane.pixels(lamp, shot) for pane, lamp in self._held])

    def _take(self, panes: Sequence[Pane]) -> None:
        def shapes(of: Sequence[Pane]) -> list[Any]:
            return [pane.image.coefficients.shape for pane in of]

        held = [pane for pane, _ in self._held]
        if shapes(held) == shapes(panes):
            lamps = [lamp for _, lamp in self._held]
            for pane, lamp in zip(panes, lamps, strict=True):
                lamp.update(pane.image)
            self._held = list(zip(panes, lamps, strict=True))
            return
        self.close()
        for pane in panes:
            # Exact: whether a table serves would follow from the frames before.
            self._held.append((pane, Relighter(pane.image, table=False)))

    def close(self) -> None:
        """Release what they hold."""
        for _, lamp in self._held:
            lamp.close()
        self._held = []

    def __enter__(self) -> Lamps:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
