"""Slices as textures: voxels looked up if a slice moves, colours if the light changes.

state -> [slice_pictures] -> texture -> panel
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError
from volspec.pipeline import Relighter
from volspec.transfer import LabelFunction
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.slice_table import Entries, greys, table_entries, table_image
from volspec.viewer.model.slices import Layout, grey_window, slice_values, voxel_number
from volspec.viewer.model.state import ViewState

_OPAQUE = np.uint32(0xFF000000)


@dataclass(slots=True)
class _Shown:
    """A slice's texture and codes, with cache keys of the inputs to its codes and colours."""

    of_codes: tuple[Any, ...] = ()
    of_colours: tuple[Any, ...] = ()
    codes: NDArray[np.uint32] | None = None
    texture: Any = None

    def release(self) -> None:
        """Release the texture."""
        if self.texture is not None:
            self.texture.release()


class SlicePictures:
    """The slices' textures, in the window's context."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._slices: dict[str, _Shown] = {}
        self._of_colours: tuple[Any, ...] = ()
        self._colours = np.zeros(1, np.uint32)

    def texture(self, state: ViewState, name: str, layout: Layout, width_px: float) -> int:
        """Return GL's name of a plane's picture, drawn at most ``width_px`` wide."""
        volume = state.document.volume
        shown = self._slices.setdefault(name, _Shown())
        number = voxel_number(volume, layout.normal, state.interface.slices.at[layout.normal])
        entries = table_entries(volume, isinstance(state.transfer, LabelFunction))
        step = max(1, int(volume.shape_xyz[layout.across] / max(width_px, 32.0)))
        of_codes = volume, layout, number, step, entries
        if of_codes != shown.of_codes:
            values = slice_values(volume, layout, number, step)
            shown.codes, shown.of_codes = entries.codes(values), of_codes
            shown.of_colours = ()
        self._relight(state, entries)
        if shown.of_colours != self._of_colours:
            assert shown.codes is not None
            pixels = self._colours[shown.codes]
            if shown.texture is None or shown.texture.size != pixels.shape[::-1]:
                shown.release()
                shown.texture = self._context.texture(pixels.shape[::-1], 4)
            shown.texture.write(np.ascontiguousarray(pixels))
            shown.of_colours = self._of_colours
        return int(shown.texture.glo)

    def _relight(self, state: ViewState, entries: Entries) -> None:
        """Compute the colours of all values under the state's lights, if anything has changed."""
        slices = state.interface.slices
        window = grey_window(slices, state.document.data[""].histogram)
        of: tuple[Any, ...] = state.document, entries, window
        if slices.lit:
            of = (*of, state.transfer, state.shading.groups, state.lights, shown_spec(state))
        if of == self._of_colours:
            return
        self._of_colours = of
        colours = _relight_table(state, window) if slices.lit else None
        if colours is None:
            shades = greys(entries, state.document.volume.range, window)
            colours = np.rint(255 * shades)[:, None].repeat(3, axis=1)
        red, green, blue = colours.astype(np.uint32).T
        self._colours = red | green << 8 | blue << 16 | _OPAQUE

    def close(self) -> None:
        """Release everything."""
        for shown in self._slices.values():
            shown.release()
        self._slices.clear()


def _relight_table(state: ViewState, window: tuple[float, float]) -> NDArray[np.uint8] | None:
    """Return the codes of all values under the state's lights, (count, 3); None if that fails."""
    rig, spec = light_rig(state.lights, state.room), shown_spec(state)
    if rig is None:
        return None
    # A table of values is not a picture in which to measure adaptation.
    given = replace(spec, viewing=spec.viewing.unmeasured())
    try:
        image = table_image(state.document.volume, state.transfer, state.shading, window)
        # On the host, as it has few pixels and the GPU draws the picture meanwhile.
        with Relighter(image, backend="numpy") as relighter:
            return relighter.frame(rig, given)[0]
    except VolspecError:  # reported with the volume's picture
        return None
