"""Slices as textures: voxels looked up if a slice moves, colours if the light changes.

state -> [slice_pictures] -> texture -> panel
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import ViewingError, VolspecError
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.transfer import LabelFunction
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.slice_table import (
    FieldSlices,
    ValueEntries,
    greys,
    table_entries,
    table_image,
)
from volspec.viewer.model.slices import (
    SliceLayout,
    grey_window,
    slice_index,
    slice_values,
    voxel_number,
)
from volspec.viewer.model.state import ViewState
from volspec.volume import Volume

_OPAQUE = np.uint32(0xFF000000)


@dataclass(slots=True)
class _PlaneTexture:
    """A slice's texture and codes, with cache keys of the inputs to its codes and colours."""

    of_codes: tuple[Any, ...] = ()
    of_colours: tuple[Any, ...] = ()
    codes: NDArray[np.uint32] | None = None
    image: CoefficientImage | None = None  # of several fields, instead of codes
    texture: Any = None

    def write(self, context: Any, pixels: NDArray[np.uint32]) -> int:
        """Write packed colours into the texture; return GL's name of it."""
        if self.texture is None or self.texture.size != pixels.shape[::-1]:
            self.release()
            self.texture = context.texture(pixels.shape[::-1], 4)
        self.texture.write(np.ascontiguousarray(pixels))
        return int(self.texture.glo)

    def release(self) -> None:
        """Release the texture."""
        if self.texture is not None:
            self.texture.release()


class SlicePictures:
    """The slices' textures, in the window's context."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._slices: dict[str, _PlaneTexture] = {}
        self._of_colours: tuple[Any, ...] = ()
        self._colours = np.zeros(1, np.uint32)
        self._fields: tuple[tuple[Any, ...], FieldSlices] | None = None

    def texture(self, state: ViewState, name: str, layout: SliceLayout, width_px: float) -> int:
        """Return GL's name of a plane's picture, drawn at most ``width_px`` wide."""
        volume = state.document.volume
        plane = self._slices.setdefault(name, _PlaneTexture())
        if state.fields and state.interface.slices.lit:
            with suppress(VolspecError):  # reported with the volume's picture
                return self._texture_of_fields(state, plane, layout, width_px)
        number = voxel_number(volume, layout.normal, state.interface.slices.at[layout.normal])
        entries = table_entries(volume, isinstance(state.transfer, LabelFunction))
        stride = _stride(volume, layout, width_px)
        of_codes = volume, layout, number, stride, entries
        if of_codes != plane.of_codes:
            values = slice_values(volume, layout, number, stride)
            plane.codes, plane.of_codes = entries.codes(values), of_codes
            plane.of_colours = ()
        self._relight(state, entries)
        if plane.of_colours != self._of_colours:
            assert plane.codes is not None
            plane.write(self._context, self._colours[plane.codes])
            plane.of_colours = self._of_colours
        return int(plane.texture.glo)

    def _texture_of_fields(
        self, state: ViewState, plane: _PlaneTexture, layout: SliceLayout, width_px: float
    ) -> int:
        """Return GL's name of a plane's picture of all fields, which is relit pixel by pixel."""
        volume, rig = state.document.volume, light_rig(state.lights, state.room)
        if rig is None:
            raise ViewingError("no light is on", code="missing")
        of_fields = volume, state.transfer, state.fields
        if self._fields is None or self._fields[0] != of_fields:
            before = self._fields[1] if self._fields else None
            self._fields = of_fields, FieldSlices.of(volume, shown_transfer(state), before)
        number = voxel_number(volume, layout.normal, state.interface.slices.at[layout.normal])
        stride = _stride(volume, layout, width_px)
        window = grey_window(state.interface.slices, state.document.data[""].histogram)
        of_image = (*of_fields, layout, number, stride, window, state.shading.groups)
        if of_image != plane.of_codes:
            index = slice_index(volume, layout, number, stride)
            plane.image = self._fields[1].image(index, window, state.shading)
            plane.of_codes, plane.of_colours = of_image, ()
        spec = shown_spec(state)
        of_colours = state.lights, spec
        if plane.of_colours != of_colours:
            assert plane.image is not None
            unmeasured = replace(spec, viewing=spec.viewing.unmeasured())
            with Relighter(plane.image, backend="numpy") as relighter:
                plane.write(self._context, _pack_pixels(relighter.frame(rig, unmeasured)))
            plane.of_colours = of_colours
        return int(plane.texture.glo)

    def _relight(self, state: ViewState, entries: ValueEntries) -> None:
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
            shades = greys(entries, state.document.volume.typical_range, window)
            colours = np.rint(255 * shades)[:, None].repeat(3, axis=1)
        self._colours = _pack_pixels(colours)

    def close(self) -> None:
        """Release everything."""
        for plane in self._slices.values():
            plane.release()
        self._slices.clear()


def _stride(volume: Volume, layout: SliceLayout, width_px: float) -> int:
    """Return the distance in voxels of neighbouring pixels."""
    return max(1, int(volume.shape_xyz[layout.across] / max(width_px, 32.0)))


def _pack_pixels(codes: NDArray[Any]) -> NDArray[np.uint32]:
    """Return (…, 3) codes as opaque pixels (…,)."""
    red, green, blue = np.moveaxis(codes.astype(np.uint32), -1, 0)
    return np.asarray(red | green << 8 | blue << 16 | _OPAQUE)


def _relight_table(state: ViewState, window: tuple[float, float]) -> NDArray[np.uint8] | None:
    """Return the codes of all values under the state's lights, (count, 3); None if that fails."""
    rig, spec = light_rig(state.lights, state.room), shown_spec(state)
    if rig is None:
        return None
    # A table of values is not a picture in which to measure adaptation.
    unmeasured = replace(spec, viewing=spec.viewing.unmeasured())
    try:
        image = table_image(state.document.volume, state.transfer, state.shading, window)
        # On the host, as it has few pixels and the GPU draws the picture meanwhile.
        with Relighter(image, backend="numpy") as relighter:
            return relighter.frame(rig, unmeasured)[0]
    except VolspecError:  # reported with the volume's picture
        return None
