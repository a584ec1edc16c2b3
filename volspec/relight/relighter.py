"""The public face of relighting: one coefficient image, a frame for every light.

    coefficient image + light -> [relighter] -> frame

OpenGL where a context can be made, NumPy with a warning where not.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sized
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from volspec._gpu.opengl import ContextLost
from volspec._gpu.sharing import Sharing
from volspec.appearance.field import PassageField
from volspec.appearance.spec import Viewing
from volspec.basis import MaterialBasis
from volspec.basis.display import Mode
from volspec.errors import OpenCLError, OpenGLError, RelightError, VolspecWarning, nearest
from volspec.relight.adapted import Adapting
from volspec.relight.checks import Shape, arrays_of, pixel_type, require_fit, shape_of
from volspec.relight.error_map import ErrorMap, error_map
from volspec.relight.gpu import GLEngine
from volspec.relight.host import HostEngine
from volspec.relight.illumination import Illumination
from volspec.relight.packed import PackedLayers
from volspec.relight.shared import SharedLayers
from volspec.relight.spec import LightRig, Pixels, RelightSpec
from volspec.relight.tables import HostTables, TableKey, is_tabled
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

BACKENDS = ("gl", "numpy")


class Relighter:
    """Turns lights into frames of one coefficient image; a context manager.

    Parameters
    ----------
    image : CoefficientImage
        Cast once; its coefficients are uploaded here.
    backend : {"gl", "numpy"}, optional
        None takes GL and falls back to NumPy with a `VolspecWarning`.
    context : moderngl.Context, optional
        A current context to draw in, as a viewer's; None makes a headless one.
    table : bool, optional
        Whether GL looks appearance up in a table (`volspec.appearance.table`), where that holds all
        of a picture's colours; CIEDE2000 .03 from the closed forms under tungsten. None: where a
        model has no closed form, and for 8-bit frames of 1024² pixels and more on software GL,
        where it is quicker.
    tables : HostTables, optional
        Where tables are kept that the host works out, for several Relighters or threads to share;
        None makes one.
    packed : PackedLayers, optional
        The image's channels, packed beforehand on another thread.

    Raises
    ------
    OpenGLError
        If ``backend="gl"`` and no context can be made.
    RelightError
        If the backend is unknown, or ``table`` or ``tables`` is something else.
    ShapeError
        If the image's arrays do not fit together.

    Examples
    --------
    Grey under tungsten, to an eye that adapts and as bare XYZ:

    >>> from volspec.basis import SpectralBasis
    >>> from volspec.raycast.image import CoefficientImage
    >>> from volspec.spectra import light
    >>> grey, opaque = np.full((1, 1, 7), 0.5, np.float32), np.ones((1, 1), np.float32)
    >>> image = CoefficientImage(grey, opaque, opaque, SpectralBasis.load("general-7"))
    >>> with Relighter(image, backend="numpy") as relighter:
    ...     for model in ("CIECAM02", "none"):
    ...         relighter.frame(light("A"), Viewing(model=model, D=1.0))[0, 0].tolist()
    [191, 187, 186]
    [246, 172, 96]
    """

    def __init__(
        self,
        image: CoefficientImage,
        backend: str | None = None,
        context: Any = None,
        table: bool | None = None,
        tables: HostTables | None = None,
        packed: PackedLayers | None = None,
    ) -> None:
        if backend is not None and backend not in BACKENDS:
            raise RelightError.refused(
                "Relighter: backend",
                backend,
                f"{nearest(str(backend), BACKENDS)}expected {' or '.join(BACKENDS)}, or None",
                "unknown",
            )
        coefficients, alpha = arrays_of(image)
        if packed is not None:
            packed.require(*coefficients.shape)
        self._image = image
        self._edits: dict[str, Spectrum] = {}
        self._adapting = Adapting()
        if table not in (None, True, False):
            raise RelightError.refused(
                "Relighter: table", table, "expected True, False or None", "type"
            )
        if not isinstance(tables, HostTables | None):
            raise RelightError.refused("Relighter: tables", tables, "expected HostTables or None")
        self._closed = False
        self._table = table
        self._tables = HostTables() if tables is None else tables
        self._lent = context is not None
        self._engine: GLEngine | HostEngine
        if backend == "numpy":
            self._engine = HostEngine(coefficients, alpha)
            return
        try:
            self._engine = GLEngine(*(coefficients, alpha, context, table, self._tables, packed))
        except OpenGLError as error:
            if backend == "gl":
                raise
            warnings.warn(f"relighting with NumPy, slowly: {error}", VolspecWarning, stacklevel=2)
            self._engine = HostEngine(coefficients, alpha)

    @property
    def backend(self) -> str:
        """What draws: the GL device's name, or ``"numpy"``."""
        return self._engine.name

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture."""
        height, width = self._image.alpha.shape
        return width, height

    def place(self, shape: Shape, groups: Sized, sharing: Sharing | None) -> SharedLayers | None:
        """Where a cast that is about to begin may put its picture, for `update` to take.

        Parameters
        ----------
        shape : (H, W, L·M)
            The picture's, to be refused now rather than after the cast.
        groups : sized
            Its light groups.
        sharing : Sharing or None
            `Raycaster.sharing`; without one there is no such place.

        Raises
        ------
        OpenCLError
            If the caster shares another OpenGL context than this draws in.
        RelightError, ShapeError
            As `update`.
        """
        self._require_open()
        require_fit(shape, groups, self._image)
        if sharing is None:
            return None
        if isinstance(self._engine, HostEngine):
            raise OpenCLError(
                f"raycast: the Raycaster shares {sharing.name}, the Relighter draws with NumPy; "
                "give the Relighter the Raycaster's context, or the Raycaster none"
            )
        return self._engine.place(sharing)

    def update(
        self, image: CoefficientImage, place: SharedLayers | PackedLayers | None = None
    ) -> None:
        """Take another cast of the same size, basis size and number of light groups.

        The groups may have other names and shares. Reflectances that were edited stay so, where
        the new image has such materials.

        Parameters
        ----------
        image : CoefficientImage
        place : SharedLayers or PackedLayers, optional
            From `place`, where the image's cast has put it: nothing is then uploaded. Or the image
            packed beforehand: nothing else is then done here.

        Raises
        ------
        RelightError
            If it is closed.
        ShapeError
            If size, channel count or number of groups differ.
        """
        self._require_open()
        shape = shape_of(image)
        require_fit(shape, image.groups, self._image)
        if isinstance(place, PackedLayers):
            place.require(*shape)
        if isinstance(image.basis, MaterialBasis):
            kept = {k: v for k, v in self._edits.items() if k in image.basis.materials}
            image = replace(image, basis=image.basis.with_reflectances(kept))
        self._image = image

        def put(engine: GLEngine | HostEngine) -> None:
            if place is not None and isinstance(engine, GLEngine):
                engine.take(place)
            else:
                engine.upload(*arrays_of(image))

        self._on_engine(put)

    def frame(
        self,
        light: Spectrum | LightRig,
        spec: RelightSpec | Viewing | None = None,
        dtype: Any = np.uint8,
    ) -> Pixels:
        """The picture under a light.

        Parameters
        ----------
        light : Spectrum or LightRig
            What lights the scene.
        spec : RelightSpec or Viewing, optional
            Viewing, mode, backdrop and level; a `Viewing` leaves the others at their defaults, and
            CIECAM02 to an sRGB display is the viewing's. What its ``adapting`` asks to be measured
            is measured in this picture.
        dtype : numpy.uint8 or numpy.float32
            8-bit codes, or codes 0 to 1 before rounding.

        Returns
        -------
        (H, W, 3) uint8 or float32
            Codes of the viewing's display, sRGB by default; row 0 at the top.

        Raises
        ------
        RelightError
            If it is closed or the dtype is another.
        ViewingError
            If an argument is out of range, a light shines from a group the image lacks, or the
            field of view to measure with is not known.
        SpectrumError
            If a light is black, has negative power or does not cover the grid.
        """
        self._require_open()
        kind = pixel_type(dtype)
        lit, viewing, field = self._lit(light, RelightSpec.of(spec))
        return self._on_engine(lambda engine: engine.render(lit, viewing, kind, field))

    def draw(
        self,
        light: Spectrum | LightRig,
        spec: RelightSpec | Viewing | None = None,
        within: tuple[int, int, int, int] | None = None,
    ) -> Any:
        """The picture of `frame` left on the device, for whoever lent the context.

        Parameters
        ----------
        light, spec
            As `frame`.
        within : (x, y, width, height), optional
            The pixels to draw, y from the picture's first row; the others stay as they were.

        Returns
        -------
        moderngl.Framebuffer
            8-bit codes, the picture's first row first; good until the next call.

        Raises
        ------
        RelightError
            If it is closed or draws with NumPy.
        ViewingError, SpectrumError
            As `frame`.
        """
        self._require_open()
        if isinstance(self._engine, HostEngine):
            raise RelightError("relight: NumPy has no device to leave a picture on; take frame()")
        lit, viewing, field = self._lit(light, RelightSpec.of(spec))
        return self._engine.draw(lit, viewing, np.uint8, field, within)

    def missing_table(
        self,
        light: Spectrum | LightRig,
        spec: RelightSpec | Viewing | None = None,
    ) -> TableKey | None:
        """What the next frame would wait for: a table that the host has to work out first.

        Hunt and Nayatani 95 have such tables, for each light and viewing their own.

        Parameters
        ----------
        light, spec
            As `frame`.

        Returns
        -------
        TableKey or None
            For `HostTables.texels` of the ``tables`` given to the Relighter, on any thread.

        Raises
        ------
        RelightError
            If it is closed.
        ViewingError, SpectrumError
            As `frame`.
        """
        self._require_open()
        settings = RelightSpec.of(spec)
        if isinstance(self._engine, HostEngine) or not is_tabled(settings.viewing.model):
            return None
        lit, viewing, _ = self._lit(light, settings)
        return self._engine.missing_table(lit, viewing)

    def error_map(
        self,
        light: Spectrum | LightRig,
        mode: Mode = "componentwise",
        backdrop: float | Spectrum = 0.2,
        every: int = 1,
    ) -> ErrorMap:
        """How far the picture's colours are from the exact light matrix', pixel by pixel.

        Parameters
        ----------
        light : Spectrum or LightRig
        mode, backdrop
            As `RelightSpec`.
        every : int
            Look at every n-th row and column only: quick, where the map itself is not wanted.

        Returns
        -------
        ErrorMap
            CIEDE2000 of every pixel; ``.image()`` draws it with a scale.

        Raises
        ------
        RelightError
            If it is closed.
        ViewingError, SpectrumError
            As `frame`.
        """
        self._require_open()
        return error_map(self._image, light, mode, backdrop, every)

    def set_reflectances(self, reflectances: Mapping[str, Spectrum]) -> None:
        """Give materials other reflectances, with no new cast; the next frame shows them.

        Parameters
        ----------
        reflectances : {name: Spectrum}
            Those that change.

        Raises
        ------
        RelightError
            If it is closed.
        ImageError, BasisError
            As `CoefficientImage.with_reflectances`.
        """
        self._require_open()
        self._image = self._image.with_reflectances(reflectances)
        self._edits |= reflectances

    def _lit(
        self, light: Spectrum | LightRig, spec: RelightSpec
    ) -> tuple[Illumination, Viewing, PassageField | None]:
        """What a light makes of the image, the viewing that is measured in it, and its field."""
        lit = Illumination.of(self._image.basis, light, spec, self._image.groups)
        return lit, *self._adapting.measured(self._image, lit)

    def _on_engine(self, call: Callable[[GLEngine | HostEngine], Any]) -> Any:
        """Call the engine; make it anew once where another library ended its context."""
        try:
            return call(self._engine)
        except ContextLost:
            if self._lent:  # what a viewer lends is the viewer's to mend
                raise
            self._engine.close()
            self._engine = GLEngine(*arrays_of(self._image), None, self._table, self._tables)
            return call(self._engine)

    def close(self) -> None:
        """Release the GPU's memory; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._engine.close()

    def _require_open(self) -> None:
        if self._closed:
            raise RelightError("Relighter: already closed; make another", code="state")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def relight(
    image: CoefficientImage,
    light: Spectrum | LightRig,
    spec: RelightSpec | Viewing | None = None,
    dtype: Any = np.uint8,
    backend: str | None = None,
) -> Pixels:
    """One picture of a coefficient image; for several, a `Relighter` uploads only once.

    Parameters and errors are `Relighter`'s and `Relighter.frame`'s.

    Returns
    -------
    (H, W, 3) uint8 or float32
        Codes of the viewing's display, sRGB by default; row 0 at the top.
    """
    with Relighter(image, backend) as relighter:
        return relighter.frame(light, spec, dtype)
