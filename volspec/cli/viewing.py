"""Options of viewing, pictures and depth that commands share, derived from their settings.

    options -> [viewing] -> ViewingConditions | RelightSpec -> models, frames

`SceneOptions` are for triples; `PictureOptions` add the display that a picture is made for. A
command takes either as a whole: its fields become options. None means that the option is not given.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from volspec.appearance import Viewing, ViewingConditions
from volspec.appearance.display import ROOM, Display, Hdr, preset
from volspec.appearance.models import HuntSettings, NayataniSettings
from volspec.cli.arguments import parse_triple
from volspec.cli.options import Options, require_with
from volspec.errors import InputError, SpectrumError
from volspec.image import DepthEffects
from volspec.relight import Stereo
from volspec.settings import hints, plain_fields

if TYPE_CHECKING:
    from volspec.relight import RelightSpec

_EYE, _PICTURE = Group("Viewing", sort_key=2), Group("Picture", sort_key=3)


class SceneOptions(
    Options,
    group=_EYE,
    of={Viewing: ("illuminance_lux", "L_A", "Y_b", "surround", "D", "discount")},
    names={"illuminance_lux": "--lux", "preset": "--preset"},
):
    """Viewing conditions of the scene, for colours."""

    preset: Annotated[
        str | None,
        Parameter(
            group=_EYE,
            help="A room by name, such as cinema: for colours, it sets L_A, Y_b and surround if "
            "not given; for a picture, it is the display's room.",
        ),
    ] = None

    def conditions(self, white: str) -> ViewingConditions:
        """Return the viewing conditions under a light, or under a white given as ``X,Y,Z``.

        Raises InputError if two options conflict, a name is unknown or a number is out of range.
        """
        self.require_one_degree()
        self.require_one_level()
        options, default = self.given(Viewing), Viewing()
        room = None if self.preset is None else preset(self.preset)
        arguments: dict[str, Any] = {
            "Y_b": (room or default).Y_b,
            "surround": (room or default).surround,
        }
        arguments |= options
        lux, L_A = arguments.pop("illuminance_lux", None), arguments.pop("L_A", None)
        if room and L_A is None and lux is None:
            L_A = room.L_A
            arguments["white_cd_m2"] = room.white_luminance
        if L_A is not None:
            return ViewingConditions(_white_of(white), L_A, **arguments)
        lux = default.illuminance_lux if lux is None else lux
        return ViewingConditions.of_lux(_white_of(white), lux, **arguments)

    @property
    def description(self) -> str:
        """Light and room, as words for a title."""
        lux = self.illuminance_lux
        if lux is None and self.L_A is None and self.preset is None:
            lux = Viewing().illuminance_lux
        words = [self.preset, None if lux is None else f"{lux:g} lx"]
        return ", ".join(word for word in words if word)

    def require_one_degree(self) -> None:
        """Refuse a degree of adaptation that is given twice."""
        if self.D is not None and self.discount:
            raise InputError(f"--D {self.D:g} with --discount, which is D = 1; give one of them")

    def require_one_level(self) -> None:
        """Refuse an adapting luminance that is given twice."""
        lux = self.illuminance_lux
        if lux is not None and self.L_A is not None:
            raise InputError(
                f"--lux {lux:g} with --L_A {self.L_A:g}: both set the adapting luminance; "
                "give one of them"
            )


class PictureOptions(
    SceneOptions,
    group=_PICTURE,
    of={
        Viewing: plain_fields(Viewing, "model", *SceneOptions.owners),
        Display: ("space", "gamut", "mark"),
    },
):
    """Viewing conditions of the scene, for a picture, and the picture's display."""

    def onto(self, spec: RelightSpec, model: str | None = None, **others: Any) -> RelightSpec:
        """Return a scene's ``[viewing]`` with the options instead of its own settings.

        An option also replaces equivalent settings of the scene: ``--lux`` its L_A, ``--D`` its
        ``discount`` and vice versa, ``--preset`` its display's room. The model and ``others``,
        mode and backdrop, are options of the command; None is not given. Raises InputError if two
        options conflict, or one has no effect or is out of range.
        """
        self.require_one_degree()
        if spec.level == "relative":  # at "absolute" lights are also compared with the lux
            self.require_one_level()
        eye, look = self.given(Viewing), self.given(Display)
        if model is not None:
            eye["model"] = model
        if self.illuminance_lux is not None:
            eye = {"L_A": None} | eye
        if self.D is not None:
            eye = {"discount": False} | eye
        if self.discount:
            eye["D"] = None
        with in_options():
            if self.preset is not None:
                room = preset(self.preset).display()
                look = {name: getattr(room, name) for name in ROOM} | look
            viewing = replace(spec.viewing, **eye, display=replace(spec.viewing.display, **look))
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
            settings = {name: value for name, value in others.items() if value is not None}
            return replace(spec, viewing=viewing, **settings)

    def require_no_picture(self) -> None:
        """Refuse options that apply only to pictures."""
        if names := self.given_names(*SceneOptions.names):
            raise InputError(f"{names[0]}: only for pictures; add --image, or leave it out")


class HdrOptions(
    Options,
    group=Group("High dynamic range", sort_key=3),
    of={Hdr: ("transfer", "white_cd_m2", "peak_cd_m2")},
    names={"transfer": "--hdr", "white_cd_m2": "--hdr-white", "peak_cd_m2": "--hdr-peak"},
):
    """Display of high dynamic range, for pictures whose highlights are brighter than white."""

    def table(self, scene: Hdr | None = None) -> dict[str, Any]:
        """Return the settings that were given, by their names in the scene's ``hdr``, if any."""
        if self.transfer is None and scene is None:
            require_with(self.given_names(), "--hdr", "--hdr PQ")
        return self.given()

    def display(self) -> Hdr | None:
        """Return the display; None without ``--hdr``."""
        with in_options(self.names):
            table = self.table()
            return Hdr(**table) if table else None


_DEPTH_NAMES = {
    name: f"--{name.removesuffix('_mm').replace('_', '-')}" for name in hints(DepthEffects)
}
_NEEDED = {"aperture_mm": "focus_mm", "fog_from_mm": "fog_mm", "fog_white": "fog_mm"}


class DepthOptions(
    Options,
    group=Group("Depth, of an image with layers", sort_key=5),
    of={DepthEffects: _DEPTH_NAMES},
    names=_DEPTH_NAMES | {"surface": "--surface"},
    off=("focus_mm", "fog_mm", "far_mm"),
):
    """Focus, fog and cuts, and a mesh at its depth; millimetres from the camera."""

    surface: Annotated[
        Path | None,
        Parameter(
            help="An image of opaque meshes, cast alone by the same camera, to put at its depth."
        ),
    ] = None

    @property
    def given_values(self) -> dict[str, Any]:
        """Options that were given and are not off, by field."""
        return {name: value for name, value in self.given().items() if value is not None}

    def effects(self, scene: DepthEffects) -> DepthEffects:
        """Return focus, fog and cuts: a scene's own, changed by the options."""
        settings = self.given(DepthEffects)
        for name, needed in _NEEDED.items():
            if name in settings and settings.get(needed, getattr(scene, needed)) is None:
                require_with([self.names[name]], self.names[needed])
        with in_options(self.names):
            return replace(scene, **settings)


class StereoOptions(
    Options,
    group=Group("Stereo", sort_key=4),
    of={Stereo: ("layout", "eyes_mm", "eyes_deg", "convergence_mm")},
    names={"layout": "--stereo"},
):
    """Both eyes' pictures, from the layers of an image that was cast with `--layers`."""

    def spec(self) -> Stereo | None:
        """Return the settings; None without ``--stereo``."""
        if self.layout is None:
            require_with(self.given_names()[:1], "--stereo", "--stereo anaglyph")
            return None
        with in_options(self.names):
            return Stereo(**self.given())


_HUNT = {name: f"--hunt-{name}" for name in hints(HuntSettings)} | {
    "CCT_kelvin": "--hunt-CCT",
    "proximal_XYZ": "--hunt-proximal",
    "background_XYZ": "--hunt-background",
    "helson_judd": "--hunt-helson-judd",
}
_NAYATANI = {name: f"--nayatani-{name}" for name in hints(NayataniSettings)}


class ModelOptions(
    Options,
    group=Group("Inputs of Hunt's and Nayatani's models", sort_key=4),
    of={HuntSettings: _HUNT, NayataniSettings: _NAYATANI},
    names=_HUNT | _NAYATANI | {"S": "--hunt-S"},
    negative="",
):
    """Inputs that only Hunt's and Nayatani's models have."""

    S: Annotated[
        list[float] | None,
        Parameter(
            "--hunt-S",
            negative="",
            help="Scotopic response to a colour over that to white; repeatable, one for each.",
        ),
    ] = None

    def require_models(self, models: Sequence[str]) -> None:
        """Refuse inputs of a model that is not asked for."""
        for model, inputs in (("Hunt", _NAYATANI), ("Nayatani95", {**_HUNT, "S": ""})):
            if model not in models:
                require_with(self.given_names(*inputs), f"--model {model}")

    def onto(self, viewing: Viewing) -> Viewing:
        """Return a viewing with the options instead of its own settings of the two models."""
        with in_options(self.names):
            return replace(
                viewing,
                hunt=replace(viewing.hunt, **self.given(HuntSettings)),
                nayatani=replace(viewing.nayatani, **self.given(NayataniSettings)),
            )


_OPTIONS = {
    **{name: f"--{name}" for name in ("preset", "model", "mode", "backdrop")},
    **ModelOptions.names,
    **PictureOptions.names,
    "white_XYZ": "the white",
}


@contextmanager
def in_options(names: Mapping[str, str] = _OPTIONS) -> Iterator[None]:
    """Name options in errors instead of the settings that they change, {setting: option}."""
    try:
        yield
    except InputError as error:
        path = reversed(re.split(r"\W+", error.field))
        option = next((names[name] for name in path if name in names), None)
        if option is None:
            raise
        raise InputError(
            error.problem, error.remedy, code=error.code, field=option, given=error.given
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


def _white_of(white: str) -> tuple[float, float, float]:
    from volspec.spectra import light, white_XYZ

    if (XYZ := parse_triple(white)) is not None:
        return XYZ
    try:
        X, Y, Z = white_XYZ(light(white)).tolist()
    except SpectrumError as error:
        if "," not in white:
            raise
        raise InputError(
            f"{white!r} is not a white; give X,Y,Z, as 95.05,100,108.88, or a light, as D65"
        ) from error
    return X, Y, Z
