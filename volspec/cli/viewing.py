"""Viewing options that commands share, each written once.

    options -> [viewing] -> ViewingConditions | RelightSpec -> models, frames

`SceneOptions` are for triples; `PictureOptions` add the display that a picture is made for. A
command takes either as a whole: its fields become options. None means that the option is not given.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from volspec.cli.shell import as_written
from volspec.errors import InputError, SpectrumError

if TYPE_CHECKING:
    from volspec.appearance import Viewing, ViewingConditions
    from volspec.appearance.hdr import Hdr
    from volspec.image import DepthEffects
    from volspec.relight import RelightSpec
    from volspec.relight.stereo import Stereo

_EYE, _PICTURE = Group("Viewing", sort_key=2), Group("Picture", sort_key=3)
# Inputs of Hunt's and Nayatani's models, by the field of their settings.
_HUNT = {
    "N_c": "--hunt-N_c",
    "N_b": "--hunt-N_b",
    "L_AS": "--hunt-L_AS",
    "CCT_kelvin": "--hunt-CCT",
    "p": "--hunt-p",
    "proximal_XYZ": "--hunt-proximal",
    "background_XYZ": "--hunt-background",
    "helson_judd": "--hunt-helson-judd",
}
_NAYATANI = {"E_or": "--nayatani-E_or", "n": "--nayatani-n"}
# Option names that differ from the fields that they set.
_OPTIONS = {
    "illuminance_lux": "--lux",
    "fov_deg": "--fov-deg",
    "white_XYZ": "the white",
    "power_W": "--power-W",
    "distance_m": "--distance-m",
    "beam_deg": "--beam-deg",
    "adopted_white": "--adopted-white",
    **_HUNT,
    **_NAYATANI,
}
_EYE_FIELDS = (
    *("L_A", "Y_b", "surround", "D", "discount", "exposure", "adapting"),
    *("deficiency", "severity"),
)
_LOOK_FIELDS = ("space", "gamut", "mark", "preset", "model", "mode", "backdrop")
_OPTIONS |= {name: f"--{name}" for name in (*_EYE_FIELDS, *_LOOK_FIELDS)}


def _number(help: str, name: str | None = None, group: Group = _EYE) -> Parameter:
    return Parameter(name, converter=as_written, help=help, group=group, show_choices=False)


@Parameter(name="*", group=_EYE)
@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Viewing conditions of the scene, for colours."""

    lux: Annotated[float | None, _number("Illuminance, lx; L_A follows from it and Y_b.")] = None
    L_A: Annotated[float | None, _number("Adapting luminance, cd/m².", "--L_A")] = None
    Y_b: Annotated[float | None, _number("Background luminance, percent of white.", "--Y_b")] = None
    surround: Annotated[
        float | str | None,
        Parameter(
            help="average, dim, dark, or its ratio to white, 0 to 1; of a picture also measured."
        ),
    ] = None
    D: Annotated[float | None, _number("Degree of adaptation, 0 to 1.", "--D")] = None
    discount: Annotated[
        bool | None, Parameter(help="Discount the light's colour fully: D is 1.")
    ] = None
    preset: Annotated[
        str | None,
        Parameter(
            help="A room by name, such as cinema: for colours, it sets L_A, Y_b and surround if "
            "not given; for a picture, it is the display's room."
        ),
    ] = None

    def conditions(self, white: str) -> ViewingConditions:
        """Return the viewing conditions under a light, or under a white given as ``X,Y,Z``.

        Raises InputError if two options conflict, a name is unknown or a number is out of range.
        """
        from volspec.appearance import Viewing, ViewingConditions
        from volspec.appearance.display import preset

        default = Viewing()
        self.require_one_degree()
        self.require_one_level()
        room = None if self.preset is None else preset(self.preset)
        others: dict[str, Any] = {
            "Y_b": room.Y_b if room else default.Y_b,
            "surround": room.surround if room else default.surround,
            **_given({"Y_b": self.Y_b, "surround": self.surround}),
            "D": self.D,
            "discount": bool(self.discount),
        }
        L_A = self.L_A
        if room and L_A is None and self.lux is None:
            L_A = room.L_A
            others["white_cd_m2"] = room.white_luminance
        if L_A is not None:
            return ViewingConditions(_white_of(white), L_A, **others)
        lux = default.illuminance_lux if self.lux is None else self.lux
        return ViewingConditions.of_lux(_white_of(white), lux, **others)

    @property
    def said(self) -> str:
        """Light and room, as words for a title."""
        from volspec.appearance import Viewing

        nothing = self.lux is None and self.L_A is None and self.preset is None
        lux = Viewing().illuminance_lux if nothing else self.lux
        words = [self.preset, None if lux is None else f"{lux:g} lx"]
        return ", ".join(word for word in words if word)

    def require_one_degree(self) -> None:
        """Refuse a degree of adaptation that is given twice."""
        if self.D is not None and self.discount:
            raise InputError(f"--D {self.D:g} with --discount, which is D = 1; give one of them")

    def require_one_level(self) -> None:
        """Refuse an adapting luminance that is given twice."""
        if self.lux is not None and self.L_A is not None:
            raise InputError(
                f"--lux {self.lux:g} with --L_A {self.L_A:g}: both set the adapting luminance; "
                "give one of them"
            )


@Parameter(name="*", group=_EYE)
@dataclass(frozen=True, kw_only=True)
class PictureOptions(SceneOptions):
    """Viewing conditions of the scene, for a picture, and the picture's display."""

    exposure: Annotated[
        float | None,
        _number("Factor of the scene's light.", group=_PICTURE),
    ] = None
    space: Annotated[
        str | None,
        Parameter(
            group=_PICTURE,
            help="The display's colour space: sRGB, Display P3, DCI-P3, Rec. 709, Rec. 2020, "
            "Adobe RGB (1998), or a profile FILE.icc.",
        ),
    ] = None
    gamut: Annotated[
        str | None,
        Parameter(
            group=_PICTURE,
            help="Out-of-gamut colours: clip, or reduce (paler, at equal lightness and hue).",
        ),
    ] = None
    mark: Annotated[bool | None, Parameter(group=_PICTURE, help="Hatch out-of-gamut colours.")] = (
        None
    )
    deficiency: Annotated[
        str | None,
        Parameter(
            group=_PICTURE,
            help="Colour-vision deficiency to simulate for a viewer without one: protan, deutan, "
            "tritan or none.",
        ),
    ] = None
    severity: Annotated[
        float | None,
        _number("Severity of the deficiency, 0 to 1, a lacking cone.", group=_PICTURE),
    ] = None
    adapting: Annotated[
        str | None,
        Parameter(
            group=_PICTURE,
            help="Y_b and L_A: given, or measured around the middle of the picture or around each "
            "pixel.",
        ),
    ] = None
    adopted_white: Annotated[
        str | None,
        Parameter(
            group=_PICTURE,
            help="White to adapt to: light, that on a surface that faces all; scene, that on what "
            "the picture shows; or X,Y,Z.",
        ),
    ] = None
    fov_deg: Annotated[
        float | None, _number("The picture's height as an angle, for measuring.", group=_PICTURE)
    ] = None

    def onto(self, spec: RelightSpec, **others: Any) -> RelightSpec:
        """Return a scene's ``[viewing]`` with the options instead of its own settings.

        An option also replaces equivalent settings of the scene: ``--lux`` its L_A, ``--D`` its
        ``discount`` and vice versa, ``--preset`` its display's room. ``others`` are model, mode
        and backdrop, if the command has them; None is not given. Raises InputError if two
        options conflict, or one has no effect or is out of range.
        """
        from volspec.appearance.display import ROOM, preset

        self.require_one_degree()
        if spec.level == "relative":  # at "absolute" lights are also compared with the lux
            self.require_one_level()
        eye = {name: getattr(self, name) for name in (*_EYE_FIELDS, "fov_deg")}
        eye["illuminance_lux"] = self.lux
        if self.adopted_white is not None:
            eye["adopted_white"] = white_triple(self.adopted_white) or self.adopted_white
        eye["model"] = others.pop("model", None)
        gives_way: dict[str, Any] = {}
        if self.lux is not None:
            gives_way["L_A"] = None
        if self.D is not None:
            gives_way["discount"] = False
        if self.discount:
            gives_way["D"] = None
        with in_options():
            room = {}
            if self.preset is not None:
                named = preset(self.preset).display()
                room = {name: getattr(named, name) for name in ROOM}
            look = _given({name: getattr(self, name) for name in ("space", "gamut", "mark")})
            display = replace(spec.viewing.display, **room | look)
            viewing = replace(spec.viewing, **gives_way | _given(eye), display=display)
            if self.fov_deg is not None and not viewing.is_measured:
                raise InputError(
                    f"--fov-deg {self.fov_deg:g}: nothing is measured in the picture; add "
                    "--adapting picture or pixel, --surround measured or --adopted-white scene",
                    code="conflict",
                )
            if self.severity is not None and viewing.deficiency == "none":
                raise InputError(
                    f"--severity {self.severity:g}: no deficiency is simulated; add --deficiency "
                    "protan, deutan or tritan",
                    code="conflict",
                )
            return replace(spec, viewing=viewing, **_given(others))

    def require_no_picture(self) -> None:
        """Refuse options that apply only to pictures."""
        names = (
            *("exposure", "space", "gamut", "mark", "deficiency", "severity"),
            *("adapting", "adopted_white", "fov_deg"),
        )
        for name in names:
            if getattr(self, name) is not None:
                option = name.replace("_", "-")
                raise InputError(f"--{option}: only for pictures; add --image, or leave it out")


_HDR = Group("High dynamic range", sort_key=3)
HDR_OPTIONS = {
    "transfer": "--hdr",
    "white_cd_m2": "--hdr-white",
    "peak_cd_m2": "--hdr-peak",
    "hdr": "--hdr",
}


@Parameter(name="*", group=_HDR)
@dataclass(frozen=True, kw_only=True)
class HdrOptions:
    """Display of high dynamic range, for pictures whose highlights are brighter than white."""

    hdr: Annotated[
        Literal["PQ", "HLG"] | None,
        Parameter(
            converter=as_written,
            help="Write PQ or HLG in Rec. 2100's primaries: 16-bit PNG, or .avif.",
        ),
    ] = None
    hdr_white: Annotated[
        float | None, _number("Luminance of white, cd/m²; default 203.", group=_HDR)
    ] = None
    hdr_peak: Annotated[
        float | None, _number("Largest luminance, cd/m²; default 1000.", group=_HDR)
    ] = None

    def table(self, scene: Hdr | None = None) -> dict[str, Any]:
        """Return the settings that were given, by their names in the scene's ``hdr``, if any."""
        given = _given({"white_cd_m2": self.hdr_white, "peak_cd_m2": self.hdr_peak})
        if self.hdr is None and scene is None and given:
            options = " and ".join(HDR_OPTIONS[name] for name in given)
            raise InputError(f"{options} without --hdr: add --hdr PQ, or leave it out")
        return _given({"transfer": self.hdr}) | given

    def display(self) -> Hdr | None:
        """Return the display; None without ``--hdr``."""
        from volspec.appearance.hdr import Hdr

        with in_options(HDR_OPTIONS):
            table = self.table()
            return Hdr(**table) if table else None


_DEPTH = Group("Depth, of an image with layers", sort_key=5)
DEPTH_OPTIONS = {
    "focus_mm": "--focus",
    "aperture_mm": "--aperture",
    "fog_mm": "--fog",
    "fog_from_mm": "--fog-from",
    "fog_white": "--fog-white",
    "near_mm": "--near",
    "far_mm": "--far",
    "surface": "--surface",
}
"""Options by the field of `DepthEffects` that they set."""

_NEEDED = {"aperture_mm": "focus_mm", "fog_from_mm": "fog_mm", "fog_white": "fog_mm"}


def _depth(help: str, name: str) -> Parameter:
    return _number(help, DEPTH_OPTIONS[name], _DEPTH)


@Parameter(name="*", group=_DEPTH)
@dataclass(frozen=True, kw_only=True)
class DepthOptions:
    """Focus, fog and cuts, and a mesh at its depth; millimetres from the camera."""

    focus_mm: Annotated[
        float | Literal["off"] | None,
        _depth("Distance in focus; off: everything is sharp.", "focus_mm"),
    ] = None
    aperture_mm: Annotated[
        float | None, _depth("Diameter of the lens; default 1/20 of --focus.", "aperture_mm")
    ] = None
    fog_mm: Annotated[
        float | Literal["off"] | None,
        _depth("Visibility in fog, where 5 % of the light is left; off: no fog.", "fog_mm"),
    ] = None
    fog_from_mm: Annotated[float | None, _depth("Where the fog begins.", "fog_from_mm")] = None
    fog_white: Annotated[
        float | None, _depth("Light of the fog, 0 to 1; default 0.5.", "fog_white")
    ] = None
    near_mm: Annotated[float | None, _depth("Hide what is nearer.", "near_mm")] = None
    far_mm: Annotated[
        float | Literal["off"] | None, _depth("Hide what is farther; off: nothing.", "far_mm")
    ] = None
    surface: Annotated[
        Path | None,
        Parameter(
            "--surface",
            help="An image of opaque meshes, cast alone by the same camera, to put at its depth.",
        ),
    ] = None

    @property
    def given(self) -> dict[str, Any]:
        """Options that were given, by field; None if one is off."""
        given = _given({name: getattr(self, name) for name in DEPTH_OPTIONS})
        return {name: None if value == "off" else value for name, value in given.items()}

    @property
    def given_values(self) -> dict[str, Any]:
        """Options that were given and are not off, by field."""
        return _given(self.given)

    def effects(self, scene: DepthEffects) -> DepthEffects:
        """Return focus, fog and cuts: a scene's own, changed by the options."""
        given = self.given
        for name, needed in _NEEDED.items():
            if name in given and given.get(needed, getattr(scene, needed)) is None:
                option, missing = DEPTH_OPTIONS[name], DEPTH_OPTIONS[needed]
                raise InputError(f"{option} without {missing}: add it, or leave {option} out")
        given.pop("surface", None)
        with in_options(DEPTH_OPTIONS):
            return replace(scene, **given)


_STEREO = Group("Stereo", sort_key=4)


@Parameter(name="*", group=_STEREO)
@dataclass(frozen=True, kw_only=True)
class StereoOptions:
    """Both eyes' pictures, from the layers of an image that was cast with `--layers`."""

    stereo: Annotated[
        Literal["side-by-side", "crossed", "anaglyph", "half-colour"] | None,
        Parameter(
            converter=as_written,
            help="Both eyes' pictures side by side, for parallel or crossed eyes, or an anaglyph "
            "for red-cyan glasses: least squares (Dubois) or half-colour.",
        ),
    ] = None
    eyes_mm: Annotated[
        float | None,
        _number("Distance of the eyes, mm; default 1/30 of the convergence's.", group=_STEREO),
    ] = None
    eyes_deg: Annotated[
        float | None, _number("The same as an angle at the convergence.", group=_STEREO)
    ] = None
    convergence_mm: Annotated[
        float | None,
        _number("Distance at which both agree, mm; default: expected depth.", group=_STEREO),
    ] = None

    def spec(self) -> Stereo | None:
        """Return the settings; None without ``--stereo``."""
        from volspec.relight.stereo import Stereo

        given = _given(asdict(self))
        if self.stereo is None:
            if given:
                option = f"--{next(iter(given)).replace('_', '-')}"
                raise InputError(
                    f"{option} without --stereo: add --stereo anaglyph, or leave it out"
                )
            return None
        with in_options({name: f"--{name.replace('_', '-')}" for name in given}):
            return Stereo(given.pop("stereo"), **given)


_OWN = Group("Inputs of Hunt's and Nayatani's models", sort_key=4)


def _own(help: str, name: str) -> Parameter:
    return _number(help, name, _OWN)


@Parameter(name="*", group=_OWN)
@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """Inputs that only Hunt's and Nayatani's models have."""

    N_c: Annotated[float | None, _own("Chromatic surround induction.", "--hunt-N_c")] = None
    N_b: Annotated[float | None, _own("Brightness surround induction.", "--hunt-N_b")] = None
    L_AS: Annotated[
        float | None, _own("Scotopic adapting luminance, scotopic cd/m².", "--hunt-L_AS")
    ] = None
    CCT_kelvin: Annotated[
        float | None, _own("Colour temperature of the light, for L_AS.", "--hunt-CCT")
    ] = None
    p: Annotated[
        float | None,
        _own("Induction by the proximal field, -1 (contrast) to 1 (assimilation).", "--hunt-p"),
    ] = None
    proximal_XYZ: Annotated[
        str | None, Parameter("--hunt-proximal", help="Field around the colour, X,Y,Z.")
    ] = None
    background_XYZ: Annotated[
        str | None, Parameter("--hunt-background", help="Background around that, X,Y,Z.")
    ] = None
    helson_judd: Annotated[
        bool | None,
        Parameter("--hunt-helson-judd", negative="", help="Greys take on the light's hue."),
    ] = None
    S: Annotated[
        list[float] | None,
        Parameter(
            "--hunt-S",
            negative="",
            help="Scotopic response to a colour over that to white; repeatable, one for each.",
        ),
    ] = None
    E_or: Annotated[float | None, _own("Normalising illuminance, lx.", "--nayatani-E_or")] = None
    n: Annotated[float | None, _own("Noise, in units of Y.", "--nayatani-n")] = None

    def require_models(self, models: Sequence[str]) -> None:
        """Refuse inputs of a model that is not asked for."""
        for model, options in (("Hunt", {**_HUNT, "S": "--hunt-S"}), ("Nayatani95", _NAYATANI)):
            given = [option for name, option in options.items() if getattr(self, name) is not None]
            if given and model not in models:
                raise InputError(
                    f"{' and '.join(given)} without --model {model}; add it, or leave that out",
                    code="conflict",
                )

    def onto(self, viewing: Viewing) -> Viewing:
        """Return a viewing with the options instead of its own settings of the two models."""
        with in_options():
            hunt = {name: getattr(self, name) for name in _HUNT}
            for name in ("proximal_XYZ", "background_XYZ"):
                if (text := hunt[name]) is not None and (triple := white_triple(text)) is None:
                    raise InputError(f"{_HUNT[name]}: {text!r} is not X,Y,Z, such as 57.1,60,65.3")
                elif text is not None:
                    hunt[name] = triple
            nayatani = {name: getattr(self, name) for name in _NAYATANI}
            return replace(
                viewing,
                hunt=replace(viewing.hunt, **_given(hunt)),
                nayatani=replace(viewing.nayatani, **_given(nayatani)),
            )


@contextmanager
def in_options(options: Mapping[str, str] = _OPTIONS) -> Iterator[None]:
    """Name options in errors instead of the settings that they change, {setting: option}."""
    try:
        yield
    except InputError as error:
        path = reversed(re.split(r"\W+", error.field))
        option = next((options[name] for name in path if name in options), None)
        if option is None:
            raise
        problem, remedy = error.problem, error.remedy
        raise InputError(
            problem, remedy, code=error.code, field=option, given=error.given
        ) from error


@contextmanager
def errors_of_file(path: Path, only: str | None = None) -> Iterator[None]:
    """Name the file that an error is about, if it has the code ``only``."""
    try:
        yield
    except InputError as error:
        if only not in (None, error.code):
            raise
        raise error.within(f"{path}") from error


def white_triple(white: str) -> tuple[float, float, float] | None:
    """Return a white written as ``X,Y,Z``; None for any other text.

    >>> white_triple("95.05,100,108.88"), white_triple("D65")
    ((95.05, 100.0, 108.88), None)
    """
    words = white.split(",")
    try:
        X, Y, Z = (float(word) for word in words)
    except ValueError:  # not numbers, or not three
        return None
    return X, Y, Z


def _white_of(white: str) -> tuple[float, float, float]:
    from volspec.spectra import light
    from volspec.spectra.photometry import white_XYZ

    if (given := white_triple(white)) is not None:
        return given
    try:
        X, Y, Z = white_XYZ(light(white)).tolist()
    except SpectrumError as error:
        if "," not in white:
            raise
        raise InputError(
            f"{white!r} is not a white; give X,Y,Z, as 95.05,100,108.88, or a light, as D65"
        ) from error
    return X, Y, Z


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in options.items() if value is not None}
