"""A relightable picture in a notebook's cell: the web page, tied to Python both ways.

    coefficient image, lights -> [notebook] -> cell <-> kernel

The machinery, anywidget, is an extra; nothing here needs it but `notebook` itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from volspec.appearance import Viewing
from volspec.errors import DeviceError, ImageError, quoted
from volspec.export.notebook.lights import Given, named_lights
from volspec.export.notebook.settings import opened
from volspec.raycast import CoefficientImage
from volspec.scene.lights import NamedLight

if TYPE_CHECKING:
    from volspec.export.notebook.widget import RelightWidget

__all__ = ["notebook"]


def notebook(
    image: CoefficientImage,
    lights: Mapping[str, Given] | Sequence[Given | NamedLight] | None = None,
    viewing: Viewing | None = None,
) -> RelightWidget:
    """A coefficient image as a widget whose lights and viewing can be changed from either side.

    An image that is the last line of a cell shows itself so.

    Parameters
    ----------
    image : CoefficientImage
    lights : sequence of str, Spectrum or NamedLight, or {name: str, Spectrum or LightRig}, optional
        What can be switched on; the first is. Texts are in `volspec.light`'s notation, a scene's
        are `Scene.lights`. The default is daylight, tungsten, a fluorescent tube and sodium.
    viewing : Viewing, optional
        How it is looked at first; left out, as the scene that the image was cast from says.

    Returns
    -------
    RelightWidget

    Raises
    ------
    DeviceError
        If the extra ``notebook`` is not installed.
    ImageError
        If it is no coefficient image, or there is no light.
    SpectrumError, ViewingError
        If a light is unknown or does not fit the image, or the page cannot draw the viewing.
    """
    if not isinstance(image, CoefficientImage):
        raise ImageError(
            f"notebook: got {quoted(image)}; expected a CoefficientImage, as volspec.raycast gives"
        )
    try:
        from volspec.export.notebook.widget import RelightWidget
    except ModuleNotFoundError as error:
        if error.name not in ("anywidget", "ipywidgets", "traitlets"):
            raise
        raise DeviceError(
            f"notebook: {error.name} is not here; pip install 'volspec[notebook]'",
            code="unsupported",
        ) from error
    named = named_lights(lights, image)
    return RelightWidget(image, named, opened(image, named, viewing))
