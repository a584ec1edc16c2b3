"""The error map, computed in the background, as a texture.

CoefficientImage, light -> [error_map] -> ErrorMap -> texture
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from volspec.errors import RelightError
from volspec.raycast import CoefficientImage
from volspec.relight import RelightSpec
from volspec.relight.error_map import ErrorMap, error_map
from volspec.viewer.model.light_rows import Rows, rig_of
from volspec.viewer.work.background import Tasks

# About so many pixels are compared: in a fraction of a second, and fine enough for a map.
_PIXELS = 60_000
# The map's opacity over the picture, of 255.
_ALPHA = 230


class ErrorMapTexture:
    """The error map of the picture; computed again when image or light change."""

    def __init__(self, context: Any, wake: Callable[[], object]) -> None:
        self._context, self._tasks = context, Tasks(wake)
        self._of: tuple[Any, ...] | None = None
        self._texture: Any = None
        self.map: ErrorMap | None = None
        self.image: CoefficientImage | None = None  # the one that the map is of
        self.problem = ""  # why there is no map

    @property
    def busy(self) -> bool:
        """True while a map is in progress."""
        return self._tasks.busy

    def want(self, image: CoefficientImage, lights: Rows, spec: RelightSpec) -> None:
        """Begin the map of a picture, unless that was begun last."""
        key, rig = (image, lights, spec.mode, spec.backdrop), rig_of(lights)
        if key == self._of:
            return
        self._of = key
        every = max(1, round((image.alpha.size / _PIXELS) ** 0.5))

        def made() -> tuple[ErrorMap, CoefficientImage]:
            if rig is None:
                raise RelightError("No light is on: no colour is off")
            return error_map(image, rig, spec.mode, spec.backdrop, every), image

        self._tasks.start("map", made)

    def take(self) -> bool:
        """Take new maps; return True if there are any."""
        outcomes = self._tasks.take()
        for outcome in outcomes:
            self.problem = outcome.error
            self.map, self.image = outcome.result or (None, None)
            self.close()
            if self.map is not None:
                alpha = np.where(self.map.alpha > 0, _ALPHA, 0).astype(np.uint8)
                rgba = np.dstack([self.map.heat(), alpha])
                size = rgba.shape[1], rgba.shape[0]
                self._texture = self._context.texture(size, 4, rgba.tobytes())
        return bool(outcomes)

    @property
    def texture(self) -> int:
        """GL's name of the map; 0 if there is none."""
        return 0 if self._texture is None else int(self._texture.glo)

    def close(self) -> None:
        """Release the texture."""
        if self._texture is not None:
            self._texture.release()
            self._texture = None
