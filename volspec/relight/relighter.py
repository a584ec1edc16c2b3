"""The public API of relighting: one coefficient image, a frame for every light.

    coefficient image + light -> [relighter] -> frame

Uses OpenGL if a context can be made, else NumPy with a warning.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sized
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import wraps
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

import numpy as np

from volspec._child import require_own_process
from volspec._gpu import ContextLost, Sharing
from volspec.appearance import LutCache, LutKey, Viewing, ViewTransformGrid, needs_host_lut
from volspec.appearance.display import to_uint16
from volspec.basis import DEFAULT_MODE, Mode
from volspec.errors import OpenCLError, OpenGLError, RelightError, VolspecWarning, nearest
from volspec.image import CoefficientImage
from volspec.relight.advice import warn_of_lights
from volspec.relight.difference_maps import Against, ErrorMap, error_map
from volspec.relight.gpu import GLEngine
from volspec.relight.hdr import hdr_frame
from volspec.relight.illumination import Illumination
from volspec.relight.look import Look
from volspec.relight.measured_viewing import ViewingMeter
from volspec.relight.recompose import PackedOpacity, depth_uniforms
from volspec.relight.reference import CpuEngine
from volspec.relight.spec import LightRig, Pixels, RelightSpec
from volspec.relight.texture_planes import (
    Shape,
    SharedLayers,
    TexturePlanes,
    coefficient_shape,
    float32_arrays,
    require_fit,
)
from volspec.spectra import Spectrum

P = ParamSpec("P")
R = TypeVar("R")
BACKENDS = ("gl", "numpy")


def pixel_type(dtype: Any) -> type:
    """Return numpy.uint8 or numpy.float32, the types of frames; raise RelightError for others."""
    kind = np.dtype(dtype).type
    if kind not in (np.uint8, np.float32):
        raise RelightError.refused(
            "relight.dtype", dtype, "expected numpy.uint8 or numpy.float32", "type"
        )
    return kind


def _in_turn(
    method: Callable[Concatenate[Relighter, P], R],
) -> Callable[Concatenate[Relighter, P], R]:
    """Let one thread at a time call a method of an open Relighter."""

    @wraps(method)
    def call(self: Relighter, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._turn():
            return method(self, *args, **kwargs)

    return call


class Relighter:
    """Relighting of one coefficient image: frames for any lights; a context manager.

    Threads may share it and draw in turn. Its memory is released by `close`, or after it was
    garbage collected when the next one is made.

    Parameters
    ----------
    image : CoefficientImage
        Cast once; its coefficients are uploaded here.
    backend : {"gl", "numpy"}, optional
        None uses GL, or NumPy with a `VolspecWarning` if there is no GL.
    context : moderngl.Context, optional
        A current context to draw in, such as a viewer's; None makes a headless one.
    lut3d : bool, optional
        Draw appearance with a 3-D LUT (`volspec.appearance.lut3d`) on GL, if all of a picture's
        colours are in its valid cells; CIEDE2000 .03 from the closed forms under tungsten. None
        uses it for models without a closed form, and for 8-bit frames of 1024² pixels and more on
        software GL, where it is faster.
    lut_cache : LutCache, optional
        Cache of LUTs baked on the host, for several Relighters or threads to share.
    packed : PackedLayers, optional
        The image's channels, packed beforehand on another thread.

    Raises
    ------
    OpenGLError
        If ``backend="gl"`` and no context can be made.
    RelightError, ShapeError
        If the backend is unknown, or the image's arrays do not fit together.

    Examples
    --------
    Grey under tungsten, for an eye that adapts and as plain XYZ:

    >>> from volspec.basis import SpectralBasis
    >>> from volspec.image.model import CoefficientImage
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
        lut3d: bool | None = None,
        lut_cache: LutCache | None = None,
        packed: TexturePlanes | None = None,
    ) -> None:
        if backend is not None and backend not in BACKENDS:
            raise RelightError.refused(
                "Relighter.backend",
                backend,
                f"{nearest(str(backend), BACKENDS)}expected {' or '.join(BACKENDS)}, or None",
                "unknown",
            )
        coefficients, alpha = float32_arrays(image)
        if packed is not None:
            packed.require(*coefficients.shape)
        self._cast = self._image = image  # as it was cast, and in the look's reflectances
        self._look = Look()
        # The engine has the recomposed image instead of the image.
        self._is_uploaded = False
        # The engine lacks the present opacities and depth, or has drawn them of other layers.
        self._is_stale = False
        # The image with the look's opacities and depth, and what it is of.
        self._recomposed: tuple[tuple[object, ...], CoefficientImage] | None = None
        self._advised: set[str] = set()
        self._meter = ViewingMeter()
        self._closed = False
        self._lock = threading.RLock()
        self._lut3d = lut3d
        self._lut_cache = LutCache() if lut_cache is None else lut_cache
        self._lent = context is not None
        self._engine: GLEngine | CpuEngine
        if backend == "numpy":
            self._engine = CpuEngine(coefficients, alpha)
            return
        try:
            self._engine = GLEngine(coefficients, alpha, context, lut3d, self._lut_cache, packed)
        except OpenGLError as error:
            if backend == "gl":
                raise
            warnings.warn(f"relighting with NumPy, slowly: {error}", VolspecWarning, stacklevel=3)
            self._engine = CpuEngine(coefficients, alpha)

    @property
    def backend(self) -> str:
        """The GL device's name, or ``"numpy"``."""
        return self._engine.name

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture."""
        height, width = self._image.alpha.shape
        return width, height

    @_in_turn
    def place(self, shape: Shape, groups: Sized, sharing: Sharing | None) -> SharedLayers | None:
        """Return the buffer for a cast that is about to begin, to be given to `update` afterwards.

        A ``shape`` (H, W, L·M) or number of light groups that `update` would refuse is refused now.
        None without `Raycaster.sharing`. Raises OpenCLError if the Raycaster shares another OpenGL
        context than the Relighter's.
        """
        require_fit(shape, groups, self._image)
        if sharing is None:
            return None
        if isinstance(self._engine, CpuEngine):
            raise OpenCLError(
                f"the Raycaster shares {sharing.name}, but the Relighter draws with NumPy",
                "give both the same context, or the Raycaster none",
                code="conflict",
                field="raycast",
            )
        return self._engine.place(sharing)

    @_in_turn
    def update(
        self,
        image: CoefficientImage,
        place: SharedLayers | TexturePlanes | None = None,
    ) -> None:
        """Replace the image with a cast of the same size, basis size and number of light groups.

        The groups may have other names and shares. Edited reflectances are kept if the new image
        has their materials; opacities too, if it also has layers.

        Parameters
        ----------
        image : CoefficientImage
        place : SharedLayers or PackedLayers, optional
            From `place`, filled by the image's cast, so that nothing is uploaded here; or the image
            packed beforehand, so that it is only uploaded.

        Raises
        ------
        RelightError, ShapeError
            If the Relighter is closed, or size, channel count or number of groups differ.
        """
        shape = coefficient_shape(image)
        require_fit(shape, image.groups, self._image)
        if isinstance(place, TexturePlanes):
            place.require(*shape)
        look = self._look.fitting(image)
        recoloured = image.with_reflectances(look.reflectances) if look.reflectances else image
        self._cast, self._image, self._look = image, recoloured, look

        def put(engine: GLEngine | CpuEngine) -> None:
            if place is not None and isinstance(engine, GLEngine):
                engine.take(place)
            else:
                engine.upload(*float32_arrays(image))
            self._is_uploaded = False

        self._on_engine(put)
        self._is_stale = self._is_changed

    @_in_turn
    def frame(
        self,
        light: Spectrum | LightRig,
        spec: Look | RelightSpec | Viewing | None = None,
        dtype: Any = np.uint8,
    ) -> Pixels:
        """Return the picture under a light.

        Parameters
        ----------
        light : Spectrum or LightRig
        spec : Look, RelightSpec or Viewing, optional
            A `Look` of one eye; or viewing, mode, backdrop and level, with the last look's rest.
            A `Viewing` leaves the others at their defaults. The default viewing is CIECAM02 to an
            sRGB display. If its ``adapting`` is not ``"given"``, conditions are measured in this
            picture.
        dtype : numpy.uint8 or numpy.float32
            8-bit codes, 16 bits of a look's ``hdr``; or codes 0 to 1 before rounding.

        Returns
        -------
        (H, W, 3) uint8, uint16 or float32
            Codes of the viewing's display, sRGB by default; row 0 at the top.

        Raises
        ------
        RelightError
            If the Relighter is closed, the dtype is not one of these, or the look has two eyes.
        ImageError, BasisError
            As `CoefficientImage.with_reflectances` and `recompose`, of a look.
        OpenGLError
            If the device has no room for a look's layers.
        ViewingError
            If an argument is out of range, a light shines from a group that the image lacks, or the
            field of view for measuring is unknown.
        SpectrumError
            If a light is black, has negative power or does not cover the grid.

        Warns
        -----
        VolspecWarning
            Once per light, if the mode does not hold its colours (`volspec.relight.advice`).
        """
        kind, look = pixel_type(dtype), self._take(spec)
        if look.hdr is not None:
            codes = hdr_frame(self._present(), light, look.relight, look.hdr)
            return codes if kind is np.float32 else to_uint16(codes)
        illumination, viewing, grid = self._illumination(light, look.relight)
        return self._on_engine(lambda engine: engine.render(illumination, viewing, kind, grid))

    @_in_turn
    def draw(
        self,
        light: Spectrum | LightRig,
        spec: Look | RelightSpec | Viewing | None = None,
        within: tuple[int, int, int, int] | None = None,
    ) -> Any:
        """Draw the picture of `frame` and leave it on the device, for the owner of the context.

        Parameters
        ----------
        light, spec
            As in `frame`.
        within : (x, y, width, height), optional
            The pixels to draw, y from the picture's first row; the others do not change.

        Returns
        -------
        moderngl.Framebuffer
            8-bit codes, the picture's first row first; valid until the next call.

        Raises
        ------
        RelightError, ViewingError, SpectrumError
            As in `frame`; also if the Relighter draws with NumPy.
        """
        if isinstance(self._engine, CpuEngine):
            raise RelightError(
                "NumPy has no device on which to leave a picture",
                "use frame()",
                code="unsupported",
                field="relight",
            )
        illumination, viewing, grid = self._illumination(light, self._take(spec).relight)
        return self._engine.draw(illumination, viewing, np.uint8, grid, within)

    @_in_turn
    def missing_lut(
        self, light: Spectrum | LightRig, spec: Look | RelightSpec | Viewing | None = None
    ) -> LutKey | None:
        """Return the key of the LUT that the host must bake before the next frame, or None.

        Hunt and Nayatani 95 have such LUTs, one for each light and viewing. Pass the key to
        `LutCache.texels` of the Relighter's ``lut_cache``, on any thread. Arguments and errors are
        as in `frame`.
        """
        settings = self._take(spec).relight
        if isinstance(self._engine, CpuEngine) or not needs_host_lut(settings.viewing.model):
            return None
        illumination, viewing, _ = self._illumination(light, settings)
        return self._engine.missing_lut(illumination, viewing)

    def error_map(
        self,
        light: Spectrum | LightRig,
        mode: Mode = DEFAULT_MODE,
        backdrop: float | Spectrum = 0.2,
        every: int = 1,
        against: Against | None = None,
    ) -> ErrorMap:
        """Return CIEDE2000 from the picture with full bands, as `error_map` does."""
        with self._turn():
            image = self._present()
        return error_map(image, light, mode, backdrop, every, against)

    @_in_turn
    def set_reflectances(self, reflectances: Mapping[str, Spectrum]) -> None:
        """Set materials' reflectances without a new cast; the next frame shows them.

        Errors as `CoefficientImage.with_reflectances`; RelightError if the Relighter is closed.
        """
        edits = {**self._look.reflectances, **reflectances}
        self._take(replace(self._look, reflectances=edits))

    def _take(self, spec: Look | RelightSpec | Viewing | None) -> Look:
        """Return settings as a look, whose reflectances, opacities and depth the next frames show.

        Other settings than a look keep those of the last one.
        """
        if not isinstance(spec, Look):
            return replace(self._look, relight=RelightSpec.of(spec), hdr=None)
        if spec.stereo is not None:
            raise RelightError(
                "has two eyes, and a Relighter draws one",
                "use relight(image, light, look), or a Relighter for each of look.views(image)",
                code="unsupported",
                field="relight: look",
            )
        image, last = self._image, self._look
        if spec.reflectances != last.reflectances:
            image = self._cast.with_reflectances(spec.reflectances)
        if (spec.opacities, spec.depth) != (last.opacities, last.depth):
            image.opacity_scales(spec.opacities)
            spec.depth.blur_px(image.size[1], image.fov_deg)
            self._is_stale = True
        self._image, self._look = image, spec
        return spec

    def load_opacities(self, packed: PackedOpacity) -> Iterator[None]:
        """Upload the image's layers before a frame needs them, in steps of few milliseconds.

        Raises OpenGLError if the device has no room for them.
        """
        if isinstance(self._engine, GLEngine):
            steps = self._engine.load_opacity(packed)
            while self._advance(steps):
                self._is_stale = self._is_changed
                yield

    @_in_turn
    def _advance(self, steps: Iterator[None]) -> bool:
        return next(steps, self) is not self

    @property
    def _is_changed(self) -> bool:
        """True if the picture is not drawn as it was cast."""
        return bool(self._look.opacities) or self._look.depth.changes

    def _put_opacities(self, engine: GLEngine | CpuEngine) -> None:
        depth, deep = self._look.depth, self._look.depth.changes
        factors = self._image.opacity_scales(self._look.opacities)
        if isinstance(engine, CpuEngine) or depth.focus_mm is not None:
            engine.upload(*float32_arrays(self._present()))
            self._is_uploaded, self._is_stale = True, False
            return
        if self._is_uploaded:
            engine.upload(*float32_arrays(self._image))
            self._is_uploaded = False
        if deep or any(scale != 1 for scale in factors) or engine.has_opacity:
            layers = self._image.opacity_layers
            assert layers is not None
            if not (engine.has_extents if deep else engine.has_opacity):
                for _ in engine.load_opacity(PackedOpacity.of(layers, deep)):
                    pass
            engine.recompose(factors, depth_uniforms(depth, self._image) if deep else None)
        self._is_stale = False

    def _present(self) -> CoefficientImage:
        """Return the image with its present opacities and depth."""
        opacities, depth = self._look.opacities, self._look.depth
        if all(scale == 1 for scale in opacities.values()) and not depth.changes:
            return self._image
        key = self._image, opacities, depth
        if self._recomposed is None or self._recomposed[0] != key:
            self._recomposed = key, self._image.recompose(opacities, depth)
        return self._recomposed[1]

    def _illumination(
        self, light: Spectrum | LightRig, spec: RelightSpec
    ) -> tuple[Illumination, Viewing, ViewTransformGrid | None]:
        """Return the illumination, the measured viewing, and the grid of view transforms."""
        if self._is_stale:
            self._on_engine(self._put_opacities)
        illumination = Illumination.of(self._image.basis, light, spec, self._image.groups)
        rig = LightRig.of(light)
        warn_of_lights(self._image.basis, rig, spec.mode, self._advised, stacklevel=5)
        image = self._present() if illumination.viewing.is_measured else self._image
        return illumination, *self._meter.measure_viewing(image, illumination)

    def _on_engine(self, call: Callable[[GLEngine | CpuEngine], Any]) -> Any:
        """Call the engine; recreate it once if another library ended its context."""
        try:
            return call(self._engine)
        except ContextLost:
            if self._lent:  # the viewer recreates a context that it lent
                raise
            self._engine.close()
            self._engine = GLEngine(
                *float32_arrays(self._image), None, self._lut3d, self._lut_cache
            )
            self._is_uploaded = False
            if self._is_changed:
                self._put_opacities(self._engine)
            return call(self._engine)

    def close(self) -> None:
        """Release the GPU's memory; a second call does nothing."""
        with suppress(RelightError, OpenGLError), self._turn():  # closed, or from before a fork
            self._closed = True
            self._engine.close()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Keep other threads out; raise RelightError if it is closed."""
        if isinstance(self._engine, GLEngine):
            require_own_process("OpenGL", OpenGLError)
        with self._lock:
            if self._closed:
                raise RelightError(
                    "already closed", "make another", code="state", field="Relighter"
                )
            yield

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
    spec: Look | RelightSpec | Viewing | None = None,
    dtype: Any = np.uint8,
    backend: str | None = None,
) -> Pixels:
    """Relight a coefficient image once; for several lights, a `Relighter` uploads only once.

    Parameters and errors are those of `Relighter` and `Relighter.frame`; a `Look` may have two
    eyes, and its errors are those of `Look.views`.

    Returns
    -------
    (H, W, 3) uint8, uint16 or float32
        Codes of the viewing's display, sRGB by default; row 0 at the top.
    """
    look, frames = Look.of(spec), []
    for view in look.views(image) if isinstance(spec, Look) else (image,):
        with Relighter(view, backend) as relighter:
            frames.append(relighter.frame(light, look.of_view, dtype))
    return look.combine(frames)
