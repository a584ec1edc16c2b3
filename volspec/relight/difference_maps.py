"""Colour errors of a picture: CIEDE2000 per pixel.

    coefficient image + light -> [error map] -> numbers, heat map

Compares the picture from m channels with one from full bands or from the exact light matrix. The
eye is adapted to the light, so 1 is just noticeable. Full bands need no other cast: a pixel's
channels determine its mixture of fewer materials than channels, and mixtures have mixed spectra.

Of other opacities (`CoefficientImage.recompose`) it estimates the difference from a new cast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from volspec._text import TextLine, fit_text, printable
from volspec.appearance.comparison import SYMBOLS, Difference, distance, uniform
from volspec.basis import (
    DEFAULT_MODE,
    Basis,
    MaterialBasis,
    Mode,
    SpectralBasis,
    through_samples,
    visible_white,
)
from volspec.errors import ShapeError, ViewingError
from volspec.image import APPROXIMATED, CoefficientImage
from volspec.relight.illumination import Illumination
from volspec.relight.opacity_error import opacity_deviation, with_neighbours
from volspec.relight.spec import LightRig, RelightSpec
from volspec.spectra import Spectrum

Against = Literal["bands", "exact", "cast"]
AGAINST: tuple[Against, ...] = get_args(Against)
"""References of an error map: full bands, the exact light matrix, or a cast of other opacities."""
_NAMES = {"bands": "full bands", "exact": "the exact light matrix"}
_LOOKED_AT = 10_000  # pixels that are compared with mixtures of the samples
_UNEXPLAINED = 0.01  # largest channel of a pixel that rounding leaves next to a mixture
_COVERED = 0.05  # opacity from which a pixel counts in the statistics
_ROWS, _PIXELS = 64, 2**14  # at a time: CIEDE2000 needs about forty temporaries
_BAR, _MARGIN, _TEXT = 18, 14, 62  # width of the scale's parts right of the map, pixels
_MIN, _CAPTION = (540, 148), 58  # make five numbers and two lines legible
_PAPER, _INK, _TYPE = (24, 24, 26), (236, 236, 236), 13
_TOPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """CIEDE2000 of a picture's pixels; statistics use pixels with opacity above 0.05."""

    delta_e: NDArray[np.float32]
    """(H, W), row 0 at the top."""
    alpha: NDArray[np.float32]
    """(H, W), the picture's opacity."""
    light: str = ""
    """The light's name."""
    compared: str = f"{DEFAULT_MODE} against the exact light matrix"
    """Names of the two pictures, for the caption."""
    difference: Difference = "CIEDE2000"
    """Measure of the values."""

    def __str__(self) -> str:
        return "; ".join(self._caption())

    @cached_property
    def _counted(self) -> NDArray[np.float32]:
        counted = self.delta_e[self.alpha > _COVERED]
        return counted if counted.size else np.zeros(1, np.float32)

    @property
    def mean(self) -> float:
        """Mean over the covered pixels; 0 for an empty picture."""
        return float(self._counted.mean())

    @property
    def p95(self) -> float:
        """95th percentile of the covered pixels."""
        return float(np.percentile(self._counted, 95))

    @property
    def p999(self) -> float:
        """99.9th percentile of the covered pixels: the worst of a thousand."""
        return float(np.percentile(self._counted, 99.9))

    @property
    def max(self) -> float:
        """Largest value among the covered pixels."""
        return float(self._counted.max())

    @property
    def top(self) -> float:
        """Upper end of the scale: a round number above 99.5 % of the covered pixels."""
        peak = float(np.percentile(self._counted, 99.5))
        return float(next((top for top in _TOPS if top >= peak), _TOPS[-1]))

    def heat(self, top: float | None = None) -> NDArray[np.uint8]:
        """Return only the map, (H, W, 3): black for 0 to pale yellow for ``top`` and above."""
        from matplotlib import colormaps

        top = self._checked_top(top)
        # Gamma: half of the colours go to the first quarter, where most errors are.
        fraction = np.sqrt(np.clip(self.delta_e / top, 0, 1))
        return (colormaps["inferno"](fraction)[..., :3] * 255).round().astype(np.uint8)

    def image(self, top: float | None = None) -> NDArray[np.uint8]:
        """Draw the map with its scale on the right and statistics below: (H + 58, W + 108, 3).

        ``top`` is the CIEDE2000 at the scale's upper end, by default `top`; set one to compare
        maps. The image is larger if the map is too small for its text.
        """
        from matplotlib import colormaps
        from PIL import Image, ImageDraw

        top = self._checked_top(top)
        height, width = self.delta_e.shape
        map_height = max(height, _MIN[1])
        size = (max(width + 2 * _MARGIN + _BAR + _TEXT, _MIN[0]), map_height + _CAPTION)
        sheet = Image.new("RGB", size, _PAPER)
        sheet.paste(Image.fromarray(self.heat(top)), (0, 0))
        draw = ImageDraw.Draw(sheet)
        x, low, high = width + _MARGIN, map_height - 12, 36
        for y in range(high, low + 1):
            fraction = np.sqrt((low - y) / (low - high))
            colour = tuple(round(255 * c) for c in colormaps["inferno"](fraction)[:3])
            draw.line([(x, y), (x + _BAR, y)], colour)
        TextLine.of(SYMBOLS[self.difference], _TYPE).draw(draw, x, 8, _INK)
        for fraction in (0, 0.25, 0.5, 0.75, 1):
            y = low - fraction * (low - high)
            number = TextLine.of(f"{fraction * top:.3g}", _TYPE)
            number.draw(draw, x + _BAR + 6, y - number.height / 2, _INK)
        title, figures = self._caption()
        fit_text(printable(title, 240), _TYPE, size[0] - 20).draw(draw, 10, map_height + 10, _INK)
        TextLine.of(figures, _TYPE).draw(draw, 10, map_height + 31, _INK)
        return np.asarray(sheet)

    def _caption(self) -> tuple[str, str]:
        """Return the title and the statistics."""
        title = f"{self.light or 'the light'}: {self.compared}"
        if not self.delta_e.any():
            return title, "no difference"
        figures = f"mean {self.mean:.3g}, 95 % {self.p95:.3g}, max {self.max:.3g}"
        return title, f"{SYMBOLS[self.difference]} {figures}"

    def _checked_top(self, top: float | None) -> float:
        try:
            value = self.top if top is None else float(top)
        except (TypeError, ValueError):
            value = float("nan")
        if not _TOPS[0] <= value <= 1000:
            raise ViewingError.refused(
                "error map.top", top, f"give a CIEDE2000 of {_TOPS[0]} to 1000", "range"
            )
        return value


def error_map(
    image: CoefficientImage,
    light: Spectrum | LightRig,
    mode: Mode = DEFAULT_MODE,
    backdrop: float | Spectrum = 0.2,
    every: int = 1,
    against: Against | None = None,
    difference: Difference = "CIEDE2000",
    opacities: Mapping[str, float] | None = None,
) -> ErrorMap:
    """Return CIEDE2000 between a picture and one from full bands, pixel by pixel.

    Parameters
    ----------
    image : CoefficientImage
    light : Spectrum or LightRig
    mode, backdrop
        As `RelightSpec`.
    every : int
        Use only every n-th row and column, for the statistics without the map.
    against : {"bands", "exact", "cast"}, optional
        The reference: full bands, which need an image whose basis holds its materials
        (`through_samples`) and that was cast with achromatic opacity; the exact
        light matrix, which has an error of its own, because m channels only approximate a
        reflectance; or a cast of ``opacities``, an estimate by `opacity_error`. Default: full bands
        if possible.
    difference : {"CIEDE2000", "CAM16-UCS"}
        CAM16-UCS is also for large differences.
    opacities : {material: scale}, optional
        Show the image with these, as `CoefficientImage.recompose`.

    Raises
    ------
    ViewingError, SpectrumError
        As `Relighter.frame`; if the image's channels do not determine full bands.
    ImageError
        As `CoefficientImage.recompose`.
    """
    if against not in (None, *AGAINST):
        raise ViewingError.refused(
            "error map.against", against, f"give {' or '.join(AGAINST)}", "unknown"
        )
    if every < 1:
        raise ViewingError.refused("error map.every", every, "give a whole number from 1", "range")
    spec = RelightSpec(mode=mode, backdrop=backdrop)
    if against == "cast":
        return _estimate_error(image, spec, light, every, opacities or {}, difference)
    image = image if opacities is None else image.recompose(opacities)
    if against is None and APPROXIMATED in image.notes:
        raise ViewingError(
            f"basis {image.basis.name!r} holds {image.notes[APPROXIMATED]} only approximately, so "
            "the picture's errors are unknown",
            "cast it with [basis] method = 'bands', or compare with the exact light matrix",
            code="unsupported",
            field="error map",
        )
    full = None if against == "exact" else full_band_basis(image)
    if full is None and against == "bands":
        raise ViewingError(
            f"basis {image.basis.name!r} does not determine the pixels' full spectra",
            "cast with [basis] method = 'materials', or compare with exact",
            code="unsupported",
            field="error map.against",
            given=against,
        )
    truth = image if full is None else replace(image, basis=full)
    compared = f"{mode} against {_NAMES['bands' if full else 'exact']}"
    exact = replace(spec, mode="exact")
    return _compare_images(image, spec, truth, exact, light, every, compared, difference)


def opacity_error(
    image: CoefficientImage,
    opacities: Mapping[str, float],
    light: Spectrum | LightRig,
    mode: Mode = DEFAULT_MODE,
    backdrop: float | Spectrum = 0.2,
    every: int = 4,
) -> float:
    """Return the mean CIEDE2000 between a picture of other opacities and a cast of them, estimated.

    Use it to decide if a cast is worth its time: by default of a sixteenth of the pixels. Of
    `error_map` ``against="cast"``, whose other arguments and errors these are.
    """
    return error_map(image, light, mode, backdrop, every, "cast", opacities=opacities).mean


def full_band_basis(image: CoefficientImage) -> Basis | None:
    """Return a basis whose exact mode has the colours of the image's full spectra, or None.

    Pixels must be mixtures of white and the basis' samples, as they are without chromatic opacity.
    """
    basis = image.basis
    if not isinstance(basis, SpectralBasis):
        return basis
    full, S = through_samples(basis), basis.samples
    if full is None or S is None:
        return None
    step = max(1, round((image.alpha.size / _LOOKED_AT) ** 0.5))
    pixels = np.asarray(image.coefficients[::step, ::step], np.float64).reshape(-1, basis.size)
    explained = np.vstack([basis.analyse(S), basis.white])
    residual = pixels - pixels @ np.linalg.pinv(explained) @ explained
    return full if np.abs(residual).max(initial=0.0) < _UNEXPLAINED else None


def _estimate_error(
    image: CoefficientImage,
    spec: RelightSpec,
    light: Spectrum | LightRig,
    step: int,
    opacities: Mapping[str, float],
    difference: Difference,
) -> ErrorMap:
    """Return the estimated error of an image with other opacities."""
    image.opacity_scales(opacities)  # raises the error of an image without layers
    layers, basis = image.opacity_layers, image.basis
    assert layers is not None
    assert isinstance(basis, MaterialBasis)
    compared = "layers against a cast, estimated"
    illumination = Illumination.of(basis, light, spec, image.groups)
    white = visible_white(illumination.white_XYZ)
    visible: NDArray[np.bool_] = np.any(layers.tau[::step, ::step], axis=(2, 3))
    alpha, delta_e = (np.zeros(visible.shape, np.float32) for _ in range(2))
    full = tuple(step * index for index in np.nonzero(visible))
    sampled = layers.at(*full)
    # A material of few pixels may be in none of these.
    fades = dict(zip(basis.materials, np.any(sampled.fading.tau, axis=(0, 1, 2)).flat, strict=True))
    opacities = {name: scale for name, scale in opacities.items() if fades[name]}
    picture = replace(
        image,
        coefficients=image.coefficients[full][None],
        alpha=image.alpha[full][None],
        depth_mm=image.depth_mm[full][None],
        first_mm=None,
        opacity_layers=sampled,
    ).recompose(opacities)
    alpha[visible] = picture.alpha[0]
    scales = image.opacity_scales(opacities)
    if any(scale != 1 for scale in scales):
        differences = np.empty(full[0].size, np.float32)
        for start in range(0, differences.size, _PIXELS):
            part = slice(start, start + _PIXELS)
            XYZ = illumination.scene_XYZ(picture.coefficients[0, part], picture.alpha[0, part])
            pixels = sampled.at(np.zeros(len(XYZ), int), np.arange(start, start + len(XYZ)))
            off = opacity_deviation(pixels, scales, illumination.XYZ_from_channels)
            recomposed, other = (uniform(difference, colour, white) for colour in (XYZ, XYZ + off))
            differences[part] = distance(difference, recomposed, other)
        delta_e[visible] = differences
        delta_e = with_neighbours(delta_e, alpha > 0)
    return ErrorMap(delta_e, alpha, _light_name(light), compared, difference)


def difference_map(
    image: CoefficientImage,
    truth: CoefficientImage,
    light: Spectrum | LightRig,
    mode: Mode = DEFAULT_MODE,
    backdrop: float | Spectrum = 0.2,
) -> ErrorMap:
    """Return CIEDE2000 between a picture and another cast of the scene with its light matrix.

    ``image`` and ``truth`` must have the same size, else ShapeError, and the same light groups;
    their bases may differ. The other arguments are as in `error_map`.
    """
    if image.size != truth.size:
        raise ShapeError(
            f"the pictures are {image.size} and {truth.size}",
            "cast both at one size",
            field="difference map",
        )
    spec = RelightSpec(mode=mode, backdrop=backdrop)
    compared = f"{image.basis.name} ({mode}) against {truth.basis.name}"
    return _compare_images(image, spec, truth, replace(spec, mode="exact"), light, 1, compared)


def _compare_images(
    image: CoefficientImage,
    spec: RelightSpec,
    truth: CoefficientImage,
    true_spec: RelightSpec,
    light: Spectrum | LightRig,
    step: int,
    compared: str,
    difference: Difference = "CIEDE2000",
) -> ErrorMap:
    pictures = [
        (
            Illumination.of(picture.basis, light, how, picture.groups),
            picture.coefficients[::step, ::step],
            picture.alpha[::step, ::step],
        )
        for picture, how in ((image, spec), (truth, true_spec))
    ]
    white = visible_white(pictures[1][0].white_XYZ)
    alpha = pictures[0][2]
    delta_e = np.empty(alpha.shape, np.float32)
    for row in range(0, len(delta_e), _ROWS):
        rows = slice(row, row + _ROWS)
        tested, true = (
            uniform(difference, illumination.scene_XYZ(coefficients[rows], opacity[rows]), white)
            for illumination, coefficients, opacity in pictures
        )
        delta_e[rows] = distance(difference, true, tested)
    return ErrorMap(delta_e, np.asarray(alpha), _light_name(light), compared, difference)


def _light_name(light: Spectrum | LightRig) -> str:
    lights = (light,) if isinstance(light, Spectrum) else light.lights
    return "+".join(spectrum.name for spectrum in lights if spectrum.name)
