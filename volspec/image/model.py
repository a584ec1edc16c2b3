"""The coefficient image: the result of a cast.

    volume -> transfer -> [raycast] -> relight -> appearance

Its OpenEXR file: `volspec.image.file`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis import MaterialBasis, SpectralBasis
from volspec.errors import DeviceError, ImageError, ShapeError, nearest, quote
from volspec.image.depth import DepthEffects, recompose_in_depth
from volspec.image.fields import ImageFields
from volspec.image.file import read_image, write_image
from volspec.image.layers import checked_scales, residual_share, warn_of_absent
from volspec.spectra import SpectralGrid, SpectralImage, Spectrum, light_power

NO_SCALES: Mapping[str, float] = MappingProxyType({})
# Accepted reflectances in a spectral picture: camera noise falls below 0, highlights exceed 1.
_NOISE, _MAX_REFLECTANCE = 0.1, 10.0


class CoefficientImage(ImageFields):
    """Reflection under flat white light, channel by channel, for each light group.

    Parameters
    ----------
    coefficients : (H, W, L·M) float32 or float16
        The M channels of the first light group, then those of the next; premultiplied by opacity;
        unitless.
    alpha : (H, W) float32
        Opacity, 0…1.
    depth_mm : (H, W) float32
        Expected distance from the camera; inf in empty pixels.
    basis : SpectralBasis or MaterialBasis
        With M channels.
    notes : {str: str}
        Free text for the file's header (scene, camera, software).
    groups : {str: float}
        The L light groups in the order of their channels, with each group's fraction of the light
        on a surface that faces every source (`RaycastSpec.shares`): 0 or more, together 1.
    first_mm : (H, W) float32, optional
        Distance at which the opacity passes a threshold, the first hit; inf in empty pixels.
    fov_deg : float, optional
        The vertical field of view, `Camera.fov_deg`; None if it was cast without
        perspective or the angle is unknown.
    camera : Camera, optional
        The camera of the cast; None if it is unknown.
    opacity_layers : OpacityLayers, optional
        Layers of the materials' opacities, by which `recompose` scales them; only with a
        MaterialBasis. None if it was cast without `RaycastSpec.layers`.

    Raises
    ------
    ShapeError
        If the arrays do not belong together.
    ImageError
        If the coefficients are of another type, the groups have no names or wrong fractions, or the
        field of view is not above 0 and below 180 degrees.

    Examples
    --------
    >>> one, basis = np.ones((1, 1), np.float32), SpectralBasis.load("general-7")
    >>> layers = np.concatenate([np.full((1, 1, 7), v, np.float16) for v in (0.6, 0.1)], axis=-1)
    >>> image = CoefficientImage(layers, one, one, basis, groups={"key": 0.75, "fill": 0.25})
    >>> image
    CoefficientImage(1x1, 7 channels in each of key, fill)
    >>> image.layer("key")[0, 0].tolist() == layers[0, 0, :7].tolist()
    True
    """

    __slots__ = ()

    def __repr__(self) -> str:
        width, height = self.size
        per_group = f" in each of {', '.join(self.groups)}" if len(self.groups) > 1 else ""
        layers = self.opacity_layers
        deep = "" if layers is None else f", {layers.count} layers of opacity"
        return f"CoefficientImage({width}x{height}, {self.basis.size} channels{per_group}{deep})"

    def layer(self, group: str) -> NDArray[Any]:
        """Return (H, W, M) the channels of one light group: a view.

        Raises ImageError if the image has no such group.
        """
        if group not in self.groups:
            raise ImageError(
                f"coefficient image: no light group {group!r}; {nearest(str(group), self.groups)}"
                f"it has {', '.join(self.groups)}",
                code="unknown",
            )
        size = self.basis.size
        first = list(self.groups).index(group) * size
        return self.coefficients[..., first : first + size]

    def with_reflectances(self, reflectances: Mapping[str, Spectrum]) -> CoefficientImage:
        """Return the same cast with other reflectances of some of its materials, {name: Spectrum}.

        Raises
        ------
        ImageError, BasisError
            If the image was not cast with a `MaterialBasis`; if a name is unknown or a value is not
            a reflectance.
        """
        if not isinstance(self.basis, MaterialBasis):
            raise ImageError(
                f"coefficient image: reflectances cannot be edited in basis {self.basis.name!r}, "
                f"whose channels are {self.basis.method}",
                'cast with [basis] method = "materials", a MaterialBasis',
                code="unsupported",
            )
        return replace(self, basis=self.basis.with_reflectances(reflectances))

    def opacity_scales(self, scales: Mapping[str, float]) -> list[float]:
        """Return the scale of each material in the basis' order; errors as `recompose`."""
        if self.opacity_layers is None or not isinstance(self.basis, MaterialBasis):
            raise ImageError(
                "the image was cast without layers, by which opacity and depth change",
                "cast with [raycast] layers = 8, RaycastSpec(layers=8)",
                code="unsupported",
            )
        return checked_scales(scales, self.basis)

    def recompose(
        self,
        scales: Mapping[str, float] = NO_SCALES,
        depth: DepthEffects | None = None,
        surface: CoefficientImage | None = None,
    ) -> CoefficientImage:
        """Return the picture with other opacities of some of its materials, without a cast.

        Scales act on a material's optical depth: 0 hides it, 2 is twice as much of it. If all
        are 1, the result is this picture, bit for bit; the difference between the picture and its
        layers is added, and fades as materials do. Shadows and occlusion are those of
        the scaled opacities. The result has no first hit and no layers.

        Parameters
        ----------
        scales : {material: scale}
            0 or more; 1 for those that are left out.
        depth : DepthEffects, optional
            Focus, fog and cuts.
        surface : CoefficientImage, optional
            Opaque surfaces between the layers, at their depth: a mesh's picture
            (`MeshCaster.alone`) by the same camera, in the same basis and light groups. Neither
            shades the other.

        Raises
        ------
        ImageError
            If the image was cast without layers, a name is unknown, or a scale is negative or not
            finite; if the camera has no focus, or the surface is of another camera, basis or light
            groups.
        ShapeError
            If the surface has another size.

        Warns
        -----
        VolspecWarning
            If a material that is to be scaled has no opacity in the picture.
        """
        factors = self.opacity_scales(scales)
        layers = self.opacity_layers
        assert layers is not None
        assert isinstance(self.basis, MaterialBasis)
        unscaled = all(scale == 1 for scale in factors)
        fades = [] if unscaled else layers.fades
        if not unscaled:
            warn_of_absent(self.basis, layers, factors, fades)
        fade = 0.0
        if surface is not None or (depth is not None and depth.changes):
            effects = depth or DepthEffects()
            channels, alpha, weighted_mm = recompose_in_depth(self, factors, effects, surface)
        elif unscaled:
            return replace(self, opacity_layers=None, first_mm=None)
        else:
            channels, alpha, weighted_mm = layers.recompose(factors)
            fade = residual_share(factors, fades)
        if fade > 0:
            as_cast = layers.recompose([1.0] * len(factors))
            coefficients = self.coefficients.reshape(channels.shape).astype(np.float32)
            own_mm = np.where(self.alpha > 0, self.depth_mm, 0) * self.alpha
            channels += np.float32(fade) * (coefficients - as_cast.channels)
            alpha += np.float32(fade) * (self.alpha - as_cast.alpha)
            weighted_mm += np.float32(fade) * (own_mm - as_cast.depth_mm)
        channels = np.maximum(channels, 0).reshape(self.coefficients.shape)
        alpha = alpha.clip(0, 1)
        visible = alpha > 0
        return replace(
            self,
            coefficients=channels.astype(self.coefficients.dtype),
            alpha=alpha,
            depth_mm=np.where(visible, weighted_mm / np.where(visible, alpha, 1), np.inf),
            first_mm=None,
            opacity_layers=None,
        )

    def _ipython_display_(self) -> None:
        """Display with `volspec.notebook` in a notebook cell, or as text if it is missing."""
        from IPython.display import display

        import volspec

        try:
            display(volspec.notebook(self))
        except DeviceError:
            raise NotImplementedError from None  # lets IPython display the text

    def _display_(self) -> Any:
        """Return what marimo displays: `volspec.notebook`, or text if it is missing."""
        import volspec

        try:
            return volspec.notebook(self)
        except DeviceError:
            return repr(self)

    @classmethod
    def from_spectral_image(
        cls, image: SpectralImage, basis: SpectralBasis, taken_under: Spectrum | None = None
    ) -> CoefficientImage:
        """Make a coefficient image of a measured or rendered spectral picture, to be relit.

        Parameters
        ----------
        image : SpectralImage
            Reflectances; or radiances, which are divided by the light they were taken under.
        basis : SpectralBasis
        taken_under : Spectrum, optional
            The light that radiances were taken under. Their scale is unknown: the 99.9th percentile
            of the pixels' mean reflectances counts as white.

        Raises
        ------
        ImageError, SpectrumError
            If radiances come without their light, or reflectances with one, or the light leaves a
            band dark; if the picture does not cover the basis' grid.
        """
        if not (isinstance(image, SpectralImage) and isinstance(basis, SpectralBasis)):
            raise ImageError(
                f"from_spectral_image: got {quote(image)} and {quote(basis)}",
                "expected a SpectralImage and a SpectralBasis",
                code="type",
            )
        grid = basis.grid
        spectra = image.on(grid).values.astype(np.float64)
        if (image.kind == "emissive") != (taken_under is not None):
            raise ImageError(
                "the spectral picture holds radiances: give the light that it was taken under"
                if taken_under is None
                else "the spectral picture holds reflectances: leave out its light",
                code="conflict",
            )
        if taken_under is None:
            _check_range(spectra, grid)
        else:
            E = light_power(taken_under, grid)
            if E.min() < 1e-3 * E.max():
                raise ImageError(
                    f"light {taken_under.name!r} has almost no power at "
                    f"{grid.wavelengths_nm[int(E.argmin())]:g} nm: reflectances there are unknown",
                    code="impossible",
                )
            spectra /= E
            spectra /= max(float(np.percentile(spectra.mean(axis=-1), 99.9)), 1e-12)
        coefficients = basis.analyse(spectra).astype(np.float32)
        alpha = np.ones(coefficients.shape[:2], np.float32)
        return cls(coefficients, alpha, np.full_like(alpha, np.inf), basis, dict(image.notes))

    def save(
        self,
        path: str | os.PathLike[str],
        preview: ArrayLike | None = None,
        texts: Mapping[str, str] | None = None,
    ) -> None:
        """Write an OpenEXR file, whole or not at all.

        Parameters
        ----------
        path : path
            Ends in ``.exr``.
        preview : (H, W, 3) array, optional
            Picture for image viewers: linear Rec. 709, premultiplied by `alpha`. Not read back.
        texts : {str: str}, optional
            Attributes of the header for other programs, ``volspec:name``. Not read back.

        Raises
        ------
        ImageError, ShapeError
            If the name does not end in ``.exr``, a text has a reserved name, or the file cannot be
            written; if the preview has another size.
        """
        write_image(path, self, preview, texts or {})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> CoefficientImage:
        """Read a file that `save` wrote.

        Raises
        ------
        ImageError
            If the file is missing, damaged or not a coefficient image, has a format or basis
            version that this volspec cannot read, or contains values that no cast produces.
        """
        fields = read_image(path)
        try:
            return cls(**fields)
        except (ImageError, ShapeError, ValueError, TypeError) as error:
            raise ImageError(str(error), code="damaged", field=os.fspath(path)) from error


def _check_range(spectra: NDArray[np.float64], grid: SpectralGrid) -> None:
    """Refuse values that cannot be reflectances: a wrong unit, or another quantity."""
    for index, wrong in (
        (spectra.argmin(), spectra.min() < -_NOISE),
        (spectra.argmax(), spectra.max() > _MAX_REFLECTANCE),
    ):
        if wrong:
            y, x, k = np.unravel_index(int(index), spectra.shape)
            raise ImageError(
                f"spectral picture: pixel ({x}, {y}) reflects {spectra[y, x, k]:g} at "
                f"{grid.wavelengths_nm[k]:g} nm, expected 0…1",
                "if these are per cent, divide by 100",
                code="range",
            )
