"""Notebook widget: traits synchronised with a page in both directions.

    image, lights, RelightSpec -> [widget] <-> host.js <-> page's web/widget.js

Traits set in Python are shown at once; changes in the page arrive about ten times a second, when
the kernel is idle. Only `notebook` imports this module, because it needs anywidget.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar
from weakref import WeakSet

import anywidget
import ipywidgets
import numpy as np
import traitlets
from IPython import get_ipython

from volspec.appearance import Viewing
from volspec.basis import MaterialBasis
from volspec.errors import ImageError, ViewingError, nearest
from volspec.export.notebook.settings import (
    checked_viewing,
    look_from_viewing,
    read_pixel,
    require_lit,
    viewing_from_look,
    weighted_rig,
)
from volspec.export.page import PageSpec, PageView, page_html, payload
from volspec.image import CoefficientImage
from volspec.pipeline import relight
from volspec.relight import LightRig, Pixels, RelightSpec, pixel_type
from volspec.scene.tables import NamedLight
from volspec.spectra import Spectrum

_HEIGHT = "600px"
_SETTINGS = ("image", "weights", "viewing", "mode", "backdrop", "level", "probe", "opacities")


class _Checked(traitlets.TraitType):
    """Trait whose values a method of the widget checks at once, with volspec's own errors."""

    def validate(self, widget: RelightWidget, value: object) -> Any:
        return getattr(widget, f"_checked_{self.name}")(value)


def _running_cell() -> tuple[str, str]:
    """Return the identities of the cell that runs and of this run; empty outside of JupyterLab."""
    parent: Any = getattr(getattr(get_ipython(), "kernel", None), "get_parent", dict)()
    cell = parent.get("metadata", {}).get("cellId", "")
    return cell, parent.get("header", {}).get("msg_id", "")


class RelightWidget(anywidget.AnyWidget):
    """Coefficient image in a cell; made by `volspec.notebook`.

    Every attribute but the lights can be set, and observed with ``observe`` like any trait. An
    invalid value is refused and changes nothing. While the page compares two settings, the
    attributes are the settings of side A.

    Parameters
    ----------
    image : CoefficientImage
        Image; a later one may differ in size, basis and groups.
    lights : sequence of NamedLight
        Lights; the first is switched on.
    relight_spec : RelightSpec
        Initial settings, also restored by the page's Reset.

    Attributes
    ----------
    weights : {name: float}
        Weight of each light, 0 to 1; lights omitted in an assignment are off.
    viewing : Viewing
    mode, level : str
        As in `RelightSpec`.
    backdrop : float
        Reflectance, 0 to 1.
    probe : (x, y) or None
        Pixel that is read; row 0 is the top.
    opacities : {material: float}
        Scales of the materials' optical depths, as of `CoefficientImage.recompose`; 1 for those
        that an assignment leaves out. Empty if the image was cast without layers of opacity.
    probed : volspec.export.notebook.settings.PixelReading or None
        Colour of the pixel; None if no pixel is read or every light is off. Read-only.

    Raises
    ------
    ImageError, ViewingError
        If an image, probe, light's name or weight is invalid, or the page does not support a
        viewing.
    """

    _run = ""  # of the cell that made it
    # Widgets by the cell that made them.
    _of_cells: ClassVar[dict[str, WeakSet[RelightWidget]]] = {}
    _esm = Path(__file__).parent / "host.js"
    _page = traitlets.Unicode().tag(sync=True)
    _room = traitlets.Dict().tag(sync=True)

    image = _Checked()
    weights = _Checked().tag(
        sync=True,
        to_json=lambda weights, _: list(weights.values()),
        from_json=lambda values, widget: dict(zip(widget._names, values, strict=True)),
    )
    viewing = _Checked().tag(
        sync=True,
        to_json=lambda viewing, widget: look_from_viewing(viewing, widget.lights),
        from_json=lambda look, widget: viewing_from_look(look, widget.viewing.display),
    )
    mode = _Checked().tag(sync=True)
    backdrop = _Checked().tag(sync=True)
    level = _Checked().tag(sync=True)
    probe = _Checked(default_value=None).tag(sync=True)
    opacities = _Checked(default_value=MappingProxyType({})).tag(
        sync=True,
        to_json=lambda opacities, _: dict(opacities),
        # A page may still be of the image before.
        from_json=lambda values, widget: {
            name: scale for name, scale in values.items() if name in widget.opacities
        },
    )
    probed = traitlets.Any(read_only=True, default_value=None)

    def __init__(
        self, image: CoefficientImage, lights: Sequence[NamedLight], relight_spec: RelightSpec
    ) -> None:
        self._lights = tuple(lights)
        self._initial = relight_spec
        # The last recomposed image, with what it is of.
        self._scaled: tuple[CoefficientImage, Mapping[str, float], CoefficientImage] | None = None
        super().__init__(
            image=image,
            weights={self._names[0]: 1.0},
            viewing=relight_spec.viewing,
            mode=relight_spec.mode,
            backdrop=relight_spec.backdrop,
            level=relight_spec.level,
            layout=ipywidgets.Layout(height=_HEIGHT),
        )
        cell, run = _running_cell()
        # Else each run would leave a page in the kernel, and in a notebook that is saved with them.
        for other in [w for w in RelightWidget._of_cells.get(cell, ()) if w._run != run]:
            other.close()
        self._run = run
        if cell:
            RelightWidget._of_cells.setdefault(cell, WeakSet()).add(self)

    @property
    def lights(self) -> tuple[NamedLight, ...]:
        """Lights that can be switched on."""
        return self._lights

    @property
    def rig(self) -> LightRig | None:
        """Mix of the lights; None if every light is off."""
        return weighted_rig(self._lights, tuple(self.weights.values()))

    @property
    def relight_spec(self) -> RelightSpec:
        """Settings of the picture besides its light."""
        return RelightSpec(self.viewing, self.mode, self.backdrop, self.level)

    def frame(self, dtype: Any = np.uint8) -> Pixels:
        """Relight on the desktop with the same settings; black if every light is off.

        Parameters
        ----------
        dtype : numpy.uint8 or numpy.float32
            8-bit codes, or codes 0 to 1 before rounding; any other type is a `RelightError`.

        Returns
        -------
        (H, W, 3) uint8 or float32
            sRGB; row 0 at the top.
        """
        rig, (width, height) = self.rig, self.image.size
        if rig is None:
            return np.zeros((height, width, 3), pixel_type(dtype))
        return relight(self._scaled_image(), rig, self.relight_spec, dtype)

    def __repr__(self) -> str:
        width, height = self.image.size
        return f"RelightWidget({width}x{height}, {', '.join(self._names)})"

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """Add a still picture for viewers without widgets, such as of saved notebooks."""
        from PIL import Image

        bundle = super()._repr_mimebundle_(**kwargs)
        buffer = io.BytesIO()
        Image.fromarray(self.frame()).save(buffer, "JPEG", quality=88)
        bundle[0]["image/jpeg"] = base64.b64encode(buffer.getvalue()).decode("ascii")
        return bundle

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(lamp.name for lamp in self._lights)

    @traitlets.observe("image")
    def _update_page(self, _: object) -> None:
        """Build a page for a new picture; settings are kept, if they fit it."""
        materials = _materials(self.image)
        kept = {name: scale for name, scale in self.opacities.items() if name in materials}
        try:
            self.opacities = kept
        except ImageError:  # a material has no opacity in this cast
            self.opacities = {}
        title = self.image.notes.get("scene") or PageSpec().title
        self._page = page_html([PageView(self.image)], self._lights, self._initial, PageSpec(title))

    @traitlets.observe("viewing")
    def _update_room(self, _: object) -> None:
        """Send the display's conditions, which only Python changes."""
        self._room = payload.page_viewing(self.viewing)

    @traitlets.observe(*_SETTINGS)
    def _update_probed(self, _: object) -> None:
        if self.probe is not None and not _inside(self.probe, self.image):
            self.probe = None  # calls this again
            return
        rig, reading = self.rig, None
        if self.probe is not None and rig is not None:
            reading = read_pixel(self._scaled_image(), rig, self.relight_spec, self.probe)
        self.set_trait("probed", reading)

    def _scaled_image(self) -> CoefficientImage:
        """Return the image with the present opacities."""
        image, opacities = self.image, self.opacities
        if all(scale == 1 for scale in opacities.values()):
            return image
        last = self._scaled
        if last is None or last[0] is not image or last[1] != opacities:
            last = self._scaled = image, opacities, image.recompose(opacities)
        return last[2]

    def _checked_image(self, image: object) -> CoefficientImage:
        if not isinstance(image, CoefficientImage):
            raise ImageError.refused("notebook.image", image, "expected a CoefficientImage", "type")
        require_lit(self._lights, image)
        return image

    def _checked_weights(self, weights: object) -> Mapping[str, float]:
        if not isinstance(weights, Mapping):
            remedy = f"give them by name, such as {{{self._names[0]!r}: 1.0}}"
            raise ViewingError.refused("notebook.weights", weights, remedy, "type")
        for name, weight in weights.items():
            if name not in self._names:
                raise ViewingError(
                    f"no light {name!r}",
                    f"{nearest(str(name), self._names)}known: {', '.join(self._names)}",
                    code="unknown",
                    field="notebook.weights",
                    given=name,
                )
            if not (isinstance(weight, int | float | np.floating) and 0.0 <= weight <= 1.0):
                raise ViewingError.refused(
                    f"notebook.weights[{name!r}]", weight, "expected 0 to 1", "range"
                )
        return MappingProxyType({name: float(weights.get(name, 0.0)) for name in self._names})

    def _checked_viewing(self, viewing: object) -> Viewing:
        return checked_viewing(viewing)

    def _checked_opacities(self, opacities: Any) -> Mapping[str, float]:
        names = _materials(self.image)
        if names or opacities:
            scales = self.image.opacity_scales(opacities)
            opacities = dict(zip(names, scales, strict=True))
        return MappingProxyType(dict(opacities))

    def _checked_mode(self, mode: Any) -> str:
        return RelightSpec(mode=mode).mode

    def _checked_backdrop(self, backdrop: Any) -> float:
        if isinstance(backdrop, Spectrum):
            raise ViewingError.refused(
                "notebook.backdrop", backdrop, "give a reflectance 0 to 1", "unsupported"
            )
        RelightSpec(backdrop=backdrop)
        return float(backdrop)

    def _checked_level(self, level: Any) -> str:
        RelightSpec(level=level)
        dark = [lamp.name for lamp in self._lights if lamp.rig.illuminance_lux is None]
        if level == "absolute" and dark:
            raise ViewingError(
                f"'absolute' needs the lux of every light, but {dark[0]!r} has none",
                "give it as LightRig(..., illuminance_lux=...)",
                code="missing",
                field="notebook.level",
                given=level,
            )
        return level

    def _checked_probe(self, probe: object) -> tuple[int, int] | None:
        if probe is None:
            return None
        if not (isinstance(probe, Sequence) and len(probe) == 2 and _inside(probe, self.image)):
            width, height = self.image.size
            raise ImageError.refused(
                "notebook.probe", probe, f"give (x, y) within {width}x{height}, or None", "range"
            )
        return int(probe[0]), int(probe[1])


def _materials(image: CoefficientImage) -> tuple[str, ...]:
    """Return the materials whose opacity an image can scale."""
    if image.opacity_layers is None or not isinstance(image.basis, MaterialBasis):
        return ()
    return tuple(image.basis.materials)


def _inside(pixel: Sequence[Any], image: CoefficientImage) -> bool:
    return all(
        isinstance(coordinate, int | np.integer) and 0 <= coordinate < size
        for coordinate, size in zip(pixel, image.size, strict=True)
    )
