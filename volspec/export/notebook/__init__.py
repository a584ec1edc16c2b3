"""Notebook widget: the relightable web page in a cell, linked to Python both ways.

    coefficient image, lights -> [notebook] -> cell <-> kernel

anywidget is an extra; only `notebook` itself needs it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from volspec._extras import require_extra
from volspec.appearance import Viewing
from volspec.errors import ImageError, quote
from volspec.export.notebook.settings import LightLike, initial_spec, named_lights
from volspec.image import CoefficientImage
from volspec.scene.tables import NamedLight

if TYPE_CHECKING:
    from volspec.export.notebook.widget import RelightWidget

__all__ = ["notebook"]


def notebook(
    image: CoefficientImage,
    lights: Mapping[str, LightLike] | Sequence[LightLike | NamedLight] | None = None,
    viewing: Viewing | None = None,
) -> RelightWidget:
    """Show a coefficient image as a widget; page and Python can both change lights and viewing.

    An image on the last line of a cell is shown this way.

    Parameters
    ----------
    image : CoefficientImage
    lights : sequence of str, Spectrum or NamedLight, or {name: str, Spectrum or LightRig}, optional
        Lights; the first is switched on. Strings are in `volspec.light`'s notation; a scene's
        lights are `Scene.lights`. By default daylight, tungsten, a fluorescent tube and sodium.
    viewing : Viewing, optional
        Initial viewing; by default the viewing of the image's scene.

    Raises
    ------
    DeviceError
        If the extra ``notebook`` is not installed.
    ImageError, SpectrumError, ViewingError
        If ``image`` is not a coefficient image; if a light is missing, unknown or does not fit the
        image; if the page does not support the viewing.
    """
    if not isinstance(image, CoefficientImage):
        raise ImageError(
            f"got {quote(image)}",
            "expected a CoefficientImage, as from volspec.raycast",
            code="type",
            field="notebook.image",
            given=image,
        )
    require_extra("notebook", "notebook")
    from volspec.export.notebook.widget import RelightWidget

    named = named_lights(lights, image)
    return RelightWidget(image, named, initial_spec(image, named, viewing))
