"""Data of a page besides its channels, as JSON: lights, basis, viewing, constants, shaders.

    lights, basis, RelightSpec -> [payload] -> web/*.js

The page has spectra and computes mixtures, matrices and white like the desktop, for any weights,
model and surround. Models without a closed form are left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from volspec._gpu import assemble, prelude
from volspec.appearance import (
    CLOSED,
    SURROUND_RATIOS,
    SURROUNDS,
    Display,
    DisplayOutput,
    Viewing,
    linear,
    nonlinear,
)
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.display import (
    D65_CONES_FROM_XYZ,
    SPACES,
    Gamut,
    severity_steps,
    spectrum_colours,
)
from volspec.appearance.display import constants as k
from volspec.appearance.models import hellwig2022, rlab
from volspec.basis import MODES, Basis, MaterialBasis, Mode, SpectralBasis
from volspec.errors import ViewingError, VolspecWarning
from volspec.export.page.packing import PackedLayers, pack_view
from volspec.export.value_bars import ValueBar
from volspec.image import CoefficientImage, DepthEffects
from volspec.relight import (
    EYES,
    ErrorMap,
    LightRig,
    RelightSpec,
    Stereo,
    depth_uniforms,
    expected_depth_mm,
    layer_count,
    mode_advice,
    picture_constants,
    screen_uniforms,
)
from volspec.scene.tables import NamedLight
from volspec.settings import plain_fields
from volspec.spectra import Spectrum, colour_matching_functions, illuminance_lux, light_power

LOOK = MappingProxyType(
    {
        name: "lux" if name == "illuminance_lux" else name
        for name in plain_fields(Viewing, "adapting", "adopted_white", "fov_deg")
    }
)
"""Keys of a look in web/state.js by field of a `Viewing`, except those of an eye in the picture."""
_GLSL = "300 es"
_HEATS = 129
_BAR_BITS = 12
# Constants of volspec.appearance.display.constants used by web/*.js.
_CONSTANTS = """
    CAT02_FROM_XYZ CAT16_FROM_XYZ HPE_FROM_XYZ HPE_FROM_CAT02
    RESPONSE_POLE RESPONSE_HALF RESPONSE_POWER RESPONSE_NOISE RESPONSE_LIMIT
    ACHROMATIC ACHROMATIC_NOISE OPPONENT_A OPPONENT_B CHROMA_SUM CHROMA_POWER CHROMA_FLOOR
    ECCENTRICITY_SCALE ECCENTRICITY_OFFSET
"""


def constants() -> dict[str, Any]:
    """Return the constants of adaptations and models under their names in web/*.js."""
    numbers = {name: _lists(getattr(k, name)) for name in _CONSTANTS.split()}
    names = sorted(SURROUNDS, key=SURROUND_RATIOS.__getitem__)
    return numbers | {
        "RGB_FROM_XYZ": _lists(SPACES["sRGB"].RGB_from_XYZ),
        "CONES_FROM_XYZ": _lists(D65_CONES_FROM_XYZ),
        "HELLWIG_COSINES": _lists(hellwig2022.COSINES),
        "HELLWIG_SINES": _lists(hellwig2022.SINES),
        "RLAB_REFERENCE": _lists(rlab.REFERENCE_FROM_ADAPTED),
        "adaptation_spaces": {name: _lists(m) for name, (m, _) in linear.VON_KRIES.items()},
        "guth": {
            name: _lists(getattr(nonlinear, f"GUTH_{name}"))
            for name in ("GAIN", "NOISE", "POWER", "SIGMA", "ADAPTING")
        },
        "surrounds": [
            {"name": name, "ratio": SURROUND_RATIOS[name], **SURROUNDS[name]._asdict()}
            for name in names
        ],
    }


def basis_numbers(
    basis: Basis, seen_through: Spectrum | None = None, full: Basis | None = None
) -> dict[str, Any]:
    """Return the matrices from spectra to channels and from channels to XYZ, as rows.

    ``seen_through`` is the filter in the eye's path; ``full`` a basis of full bands
    (`full_band_basis`), with which colours are compared, instead of the exact light matrix.
    """
    Q = colour_matching_functions(basis.grid, basis.observer_deg)
    materials = isinstance(basis, MaterialBasis)
    spectra = list(basis.materials.values()) if isinstance(basis, MaterialBasis) else []
    synthesis = basis.synthesise(np.eye(basis.size)).T
    return {
        "kind": "materials" if materials else "spectral",
        "Q": _lists(Q),
        "analysis": None if isinstance(basis, MaterialBasis) else _lists(basis.analysis),
        "synthesis": _lists(synthesis),
        "full": _lists(full.synthesis) if isinstance(full, SpectralBasis) else None,
        "D": None if isinstance(basis, MaterialBasis) else _lists(basis.XYZ_from_channels),
        # [channel, power emitted by power that falls in] of fluorescent materials.
        "emission": [
            [k, _lists(s.fluorescence.matrix)] for k, s in enumerate(spectra) if s.fluorescence
        ],
        "filter": None if seen_through is None else _lists(seen_through.values),
        "wavelengths_nm": _lists(basis.grid.wavelengths_nm),
        "colours": _css(spectrum_colours(basis.grid.wavelengths_nm)),
    }


def light_numbers(
    light: NamedLight, basis: Basis, seen_through: Spectrum | None = None
) -> dict[str, Any]:
    """Return a light setting: name, label, and the spectra with their matrices.

    ``seen_through`` is the filter in the eye's path.
    """
    rig, grid = light.rig, basis.grid
    parts = []
    for j, spectrum in enumerate(rig.lights):
        power = light_power(spectrum, grid)
        lux = None if rig.illuminance_lux is None else rig.illuminance_lux[j]
        parts.append(
            {
                "power": _lists(power),
                "weight": rig.weights[j],
                "lux": lux,
                # Illuminance of the power in W / (m² nm).
                "unit_lux": illuminance_lux(Spectrum(grid.wavelengths_nm, power)),
                "group": rig.groups[j],
                # Its matrix in the mode "fitted"; materials are exact in every mode.
                "fitted": None
                if isinstance(basis, MaterialBasis)
                else _lists(basis.colour_matrix(spectrum, "fitted", seen_through)),
            }
        )
    advice = {mode: text for mode in MODES for text in [_advice(rig, basis, mode)] if text}
    return {"name": light.name, "label": light.label, "parts": parts, "advice": advice}


def _advice(rig: LightRig, basis: Basis, mode: Mode) -> str:
    """Return the advice on a setting's lights in a mode; empty if it holds them."""
    advice = (mode_advice(basis, spectrum, mode) for spectrum in rig.lights)
    return "\n".join(dict.fromkeys(filter(None, advice)))


def look_numbers(spec: RelightSpec, lights: Sequence[NamedLight]) -> dict[str, Any]:
    """Return the settings of the page when it is opened; a page has no spectral backdrop."""
    viewing = spec.viewing
    if isinstance(spec.backdrop, Spectrum):
        raise ViewingError.refused(
            "page.backdrop", spec.backdrop, "give a reflectance 0 to 1", "unsupported"
        )
    model = viewing.model
    if model not in CLOSED and model not in ADAPTATIONS:
        model = "CIECAM02"
        _warn(f"{viewing.model} has no closed form; the page opens with {model}")
    if viewing.is_measured:
        _warn("a page cannot measure conditions in its picture; it opens with given ones")
        viewing = viewing.unmeasured()
    if viewing.adopted_white != "light":
        _warn("the eye before a page adapts to its lights; adopted_white is ignored")
    if viewing.display.space != "sRGB":
        _warn("a page is always sRGB; the scene's display space is ignored")
    return {
        "weights": [1.0] + [0.0] * (len(lights) - 1),
        "solo": -1,
        **{key: getattr(viewing, name) for name, key in LOOK.items()},
        "model": model,
        "surround": _ratio(viewing.surround),
        "backdrop": float(spec.backdrop),
        "mode": spec.mode,
        "level": spec.level,
        "gamut": viewing.display.gamut,
        "mark": viewing.display.mark,
    }


def page_viewing(viewing: Viewing) -> dict[str, Any]:
    """Return the sRGB display's conditions, its gamut mapping, and simulations of deficiencies."""
    display = viewing.display
    conditions = _srgb(display).conditions
    return {
        "display": {
            "white": list(conditions.white_XYZ),
            "L_A": conditions.L_A,
            "Y_b": conditions.Y_b,
            "surround": _ratio(conditions.surround),
            "D": None,
            "discount": False,
        },
        "gamut": {model: _gamut(display, model) for model in ("CIECAM02", "CAM16")},
        "deficiencies": {
            name: {key: _lists(getattr(steps, key)) for key in ("above", "below", "plane")}
            for name, steps in severity_steps(SPACES["sRGB"]).items()
        },
    }


def opacity_numbers(
    opacity: PackedLayers | None, image: CoefficientImage, effects: DepthEffects
) -> dict[str, Any] | None:
    """Return what unpacking and recomposing of layers take; None if there are none.

    ``effects`` are those of the page as it is opened.
    """
    if opacity is None or not isinstance(image.basis, MaterialBasis):
        return None
    assert image.opacity_layers is not None
    near, far = image.opacity_layers.range_mm
    numbers = depth_uniforms(effects, image)
    return {
        "materials": list(image.basis.materials),
        **opacity.numbers(),
        "range_mm": [near, far],
        "fog_from_mm": near if effects.fog_mm is None else effects.fog_from_mm,
        "fog_light": numbers["fog_light"],
        "slope": numbers["slope"][0],
        "camera": _camera_numbers(image),
    }


def _camera_numbers(image: CoefficientImage) -> dict[str, Any] | None:
    """Return the camera of an image with layers, and where eyes meet; None if it is unknown."""
    if image.camera is None:
        return None
    field = image.camera.ray_field(*image.size)
    mixes = Stereo("anaglyph").mixes(SPACES["sRGB"])
    return {
        "distance_mm": field.distance,
        "nearness": field.nearness,
        "pitch_mm": field.pitch_mm,
        "convergence_mm": expected_depth_mm(image),
        "eyes": EYES,
        **{f"{eye}_mix": mix.tolist() for eye, mix in zip(("left", "right"), mixes, strict=True)},
    }


def depth_look(effects: DepthEffects, image: CoefficientImage) -> dict[str, float | None]:
    """Return the page's cuts, visibility, and lens if its camera has one."""
    look = {"near": effects.near_mm, "far": effects.far_mm, "fog": effects.fog_mm}
    if image.camera is None or image.fov_deg is None:
        return look
    return look | {"focus": effects.focus_mm, "aperture": effects.aperture_mm}


def shaders(channels: int, height: int, opacity: PackedLayers | None = None) -> dict[str, str]:
    """Assemble the shaders for WebGL 2, without variants, for L·M channels."""
    fixed: dict[str, ArrayLike] = {
        "LAYERS": layer_count(channels),
        "IMAGE_HEIGHT": height,
        "FIRST_ROW_AT_BOTTOM": 0,
        **picture_constants(SPACES["sRGB"]),
    }
    lines = prelude(fixed, "glsl")
    files = {"vertex": "shaders/fullscreen.vert", "fragment": "shaders/relight.frag"}
    sources = {kind: assemble(file, lines, glsl_version=_GLSL).text for kind, file in files.items()}
    if opacity:
        layer_lines = prelude(opacity.constants(), "glsl")
        for kind in ("recompose.frag", "splat.vert", "splat.frag", "splatted.frag"):
            sources[kind] = assemble(f"shaders/{kind}", layer_lines, glsl_version=_GLSL).text
        display = prelude({"SIMULATE": 0, **SPACES["sRGB"].shader_constants()}, "glsl")
        sources["stereo.frag"] = assemble("shaders/stereo.frag", display, glsl_version=_GLSL).text
    return sources


def bar_numbers(
    bars: Sequence[ValueBar], basis: Basis, groups: Mapping[str, float]
) -> dict[str, Any] | None:
    """Return numbers of value bars, and their colours as a picture of one row; None without any."""
    if not bars:
        return None
    channels = np.concatenate([bar.colours for bar in bars])[None]
    opaque = np.isfinite(channels).all(axis=-1).astype(np.float32)
    stacked = np.concatenate([part * np.nan_to_num(channels) for part in groups.values()], axis=-1)
    strip = CoefficientImage(stacked.astype(np.float32), opaque, opaque, basis, groups=groups)
    packed = pack_view(strip, _BAR_BITS)
    return {
        "text": packed.text,
        "bits": _BAR_BITS,
        **packed.numbers(),
        "bars": [
            {
                "title": bar.title,
                "ends": [bar.number(bar.low), bar.number(bar.high)],
                "ticks": [
                    [(value - bar.low) / (bar.high - bar.low), bar.number(value)]
                    for value in bar.ticks()
                ],
            }
            for bar in bars
        ],
    }


def heat_colours() -> list[list[int]]:
    """Return the error map's colours at equal steps from 0 to its maximum."""
    fractions = np.linspace(0.0, 1.0, _HEATS, dtype=np.float32)
    scale = ErrorMap(fractions[None, :] ** 2, np.ones((1, _HEATS), np.float32))
    return [list(map(int, colour)) for colour in scale.heat(1.0)[0]]


def models() -> dict[str, list[str]]:
    """Return the models, adaptations and modes of the page."""
    return {"appearance": list(CLOSED), "adaptation": list(ADAPTATIONS), "modes": list(MODES)}


def _gamut(display: Display, model: str) -> dict[str, Any] | None:
    """Return the uniforms of shaders/include/gamut.glsl; None if no grey can be shown."""
    try:
        screen = DisplayOutput.of(_srgb(display, gamut="reduce"), model)
    except ViewingError:
        return None
    return {name: values.tolist() for name, values in screen_uniforms(screen).items()}


def _srgb(display: Display, gamut: Gamut = "clip") -> Display:
    room = (display.L_A, display.Y_b, display.surround)
    return Display(*room, gamut=gamut, white_cd_m2=display.white_cd_m2)


def _ratio(surround: str | float) -> float:
    ratio = SURROUND_RATIOS[surround] if isinstance(surround, str) else float(surround)
    return min(ratio, max(SURROUND_RATIOS.values()))


def _css(colours: ArrayLike) -> list[str]:
    codes = np.clip(np.rint(np.asarray(colours) * 255), 0, 255).astype(int)
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in codes]


def _lists(values: ArrayLike) -> Any:
    """Return nested lists of numbers in full precision."""
    return np.asarray(values, dtype=np.float64).tolist()


def _warn(message: str) -> None:
    warnings.warn(f"page: {message}", VolspecWarning, stacklevel=4)
