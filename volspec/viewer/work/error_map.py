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

# So many pixels are looked at: a fraction of a second, and finer than an eye asks of a map.
PIXELS = 60_000
# Of what is laid over the picture.
_ALPHA = 230


class ErrorMapTexture:
    """The error map of what is shown; made anew where image or light are others.

    Parameters
    ----------
    context : moderngl.Context
    wake : callable
        Called when a map is there.
    """

    def __init__(self, context: Any, wake: Callable[[], object]) -> None:
        self._context, self._tasks = context, Tasks(wake)
        self._of: tuple[Any, ...] | None = None
        self._texture: Any = None
        self.map: ErrorMap | None = None
        self.image: CoefficientImage | None = None  # that `map` is of
        self.problem = ""

    @property
    def busy(self) -> bool:
        """Whether a map is being made."""
        return self._tasks.busy

    def want(self, image: CoefficientImage, lights: Rows, spec: RelightSpec) -> None:
        """Begin the map of a picture, unless it is there or under way."""
        key, rig = (image, lights, spec.mode, spec.backdrop), rig_of(lights)
        if key == self._of:
            return
        self._of = key
        every = max(1, round((image.alpha.size / PIXELS) ** 0.5))

        def made() -> tuple[ErrorMap, CoefficientImage]:
            if rig is None:
                raise RelightError("No light is on: no colour is off")
            return error_map(image, rig, spec.mode, spec.backdrop, every), image

        self._tasks.start("map", made)

    def take(self) -> bool:
        """Whether a map has come since the last call."""
        outcomes = self._tasks.take()
        for outcome in outcomes:
            self.problem = outcome.error
            self.map, self.image = outcome.result or (None, None)
            self._upload()
        return bool(outcomes)

    @property
    def texture(self) -> int:
        """GL's name of the map; 0 where there is none."""
        return 0 if self._texture is None else int(self._texture.glo)

    def _upload(self) -> None:
        self._release()
        if self.map is None:
            return
        colours = self.map.heat()
        alpha = np.where(self.map.alpha > 0, _ALPHA, 0).astype(np.uint8)
        rgba = np.dstack([colours, alpha])
        size = rgba.shape[1], rgba.shape[0]
        self._texture = self._context.texture(size, 4, rgba.tobytes())

    def _release(self) -> None:
        if self._texture is not None:
            self._texture.release()
            self._texture = None

    def close(self) -> None:
        """Release the texture."""
        self._release()
