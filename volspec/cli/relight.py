"""``volspec relight``: relight a stored image in a moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from volspec import __version__
from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import read_image_setting, read_opacities, require_image
from volspec.cli.shell import app, as_written, note, note_everyday, say
from volspec.cli.viewing import (
    DepthOptions,
    HdrOptions,
    PictureOptions,
    StereoOptions,
    errors_of_file,
    in_options,
)
from volspec.errors import ImageError, InputError, VolspecError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from volspec.appearance.display import Hdr
    from volspec.image import CoefficientImage
    from volspec.relight import Against, LightRig, Look, RelightSpec
    from volspec.spectra import SpectralGrid, Spectrum

_VIEWING, _HDR, _STEREO = PictureOptions(), HdrOptions(), StereoOptions()
_DEPTH = DepthOptions()


@app.command
def relight(
    image: Path,
    /,
    *,
    light: Annotated[
        list[str],
        Parameter(
            name=["--light", "-l"],
            negative="",
            help=r"D65, planck:3200, D65\*0.7+A\*0.3, FILE.csv, FILE.spdx, FILE.exr, "
            r"PALETTE.toml#name; or a light for each group, 'key=D65; fill=A\*0.3'; repeatable.",
        ),
    ],
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    model: str | None = None,
    viewing: PictureOptions = _VIEWING,
    mode: str | None = None,
    backdrop: Annotated[float | None, Parameter(converter=as_written)] = None,
    errors: Annotated[bool, Parameter(negative="")] = False,
    reflectance: Annotated[list[str] | None, Parameter(negative="")] = None,
    opacity: Annotated[list[str] | None, Parameter(negative="")] = None,
    basis: str | None = None,
    taken_under: str | None = None,
    spectral: Annotated[bool, Parameter(negative="")] = False,
    hdr: HdrOptions = _HDR,
    stereo: StereoOptions = _STEREO,
    depth: DepthOptions = _DEPTH,
) -> None:
    """Relight a stored coefficient image, or a measured spectral picture.

    Viewing and picture options default to the scene's values. `--L_A`, `--Y_b` and `--surround`
    describe the scene; `--preset` describes the display's room. White is equally bright under
    each light.

    Example: `volspec relight engine.exr --light A --light FL2 -o engine.png`

    Example: `volspec relight engine.exr --light "key=A; sky=D65*0.3" -o engine.png`

    Example: `volspec relight engine.exr --light A --space "Display P3" --gamut reduce -o p3.png`

    Example: `volspec relight engine.exr --light A --lux 500 --hdr PQ -o engine.avif`

    Example: `volspec relight painting.exr --basis general-9 --light A -o painting.png`

    Example: `volspec relight engine.exr --opacity block=0.3 --light A -o inside.png`

    Example: `volspec relight engine.exr --focus 500 --aperture 30 --light A -o focused.png`

    Example: `volspec relight engine.exr --stereo anaglyph --light A -o anaglyph.png`

    Example: `volspec relight engine.exr --light FL2 --spectral -o spectra.exr`

    Parameters
    ----------
    image
        A coefficient image that `volspec render` or `volspec demo` wrote; or, with `--basis`, an
        OpenEXR picture with a spectrum in every pixel (`T.550,000000nm`, …).
    output
        The PNG file, with `--hdr` also AVIF (needs `volspec[video]`), with `--spectral` OpenEXR;
        with several lights, their names are appended:
        `engine-A.png`.
    errors
        Write a map of the colours' errors next to each frame: `engine-errors.png`. With
        `--opacity`, of the estimated difference from a new cast.
    reflectance
        MATERIAL=REFLECTANCE: show a material with another reflectance, such as
        `inserts=copper`; the image must be cast with `method = "materials"`. Repeatable.
    opacity
        MATERIAL=SCALE: show a material with more or less opacity, such as `block=0.3`, or 0 to
        hide it; the image must be cast with `--layers`. Repeatable.
    basis
        The basis to analyse a spectral picture with: a shipped name or a JSON file.
    taken_under
        The light of a spectral picture of radiances (`S0.550,000000nm`, …).
    model
        Appearance or adaptation model: CIECAM02, CAM16, RLAB, Hunt, CAT02, none, … Default: the
        scene's.
    mode
        fitted (a matrix for each light), componentwise, exact (the light matrix) or linear-model.
        Default: the scene's; exact with `--spectral`.
    backdrop
        Reflectance of the diffuser behind, 0 to 1. Default: the scene's.
    spectral
        Write the light that reaches the eye as a spectrum in every pixel: 81 half-float channels
        `S0.380,000000nm`, …, or the bands of its basis, and red, green, blue as a preview. No
        appearance model is applied, so of the viewing options only `--exposure` and `--lux` count.
    """
    from volspec.relight import Look
    from volspec.spectra.library import sent_names

    require_image(
        image,
        "relight it: volspec export {file} -o FOLDER; or cast it first: volspec render "
        "{file} -o IMAGE.exr",
    )
    display, eyes = hdr.display(), stereo.spec()
    asked = {"spectral": spectral or None, "errors": errors or None, "hdr": display, "model": model}
    _check_options(output, asked, viewing, depth, eyes is not None)
    paths = _paths(image, output, names := sent_names(light), errors)
    stored, scales = _picture(image, basis, taken_under), read_opacities(opacity or ())
    scene = _scene_look(image, stored, errors, eyes is not None)
    effects = depth.effects(scene.depth)
    lamps = [read_image_setting(image, text, stored) for text in light]
    if display is not None:
        lamps = _with_lux(lamps, viewing.illuminance_lux, stored)
    own_mode = mode or ("exact" if spectral else None)
    spec = viewing.onto(scene.relight, model=model, mode=own_mode, backdrop=backdrop)
    spec = spec.for_lights(lamps)
    if changes := _reflectances(reflectance or (), stored.basis.grid):
        with in_options():
            stored = stored.with_reflectances(changes)
    look = Look(spec, opacities=scales, depth=effects, stereo=eyes, hdr=display)
    views = _views(image, stored, look, depth.surface)
    frames = [*map(_Frame, light, names, lamps, paths)]
    if spectral:
        _write_spectra(views[0], frames, spec)
    else:
        _write_frames(views, look, frames, stored if errors else None)
    _tell_of_lux(image, scene.relight, viewing, spec)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Frame to write: its light as it was given, by name and as a spectrum or rig; its file."""

    text: str
    name: str
    light: Spectrum | LightRig
    path: Path


def _check_options(
    output: Path,
    asked: Mapping[str, Any],
    viewing: PictureOptions,
    depth: DepthOptions,
    stereo: bool,
) -> None:
    """Refuse an output of the wrong kind, and options that exclude each other.

    ``asked`` are others by name, None if left out.
    """
    if stereo:
        conflicts = [f"--{name}" for name in ("spectral", "errors", "hdr") if asked[name]]
        lens = ("aperture_mm", "focus_mm", "surface")
        conflicts += [depth.names[name] for name in lens if name in depth.given_values]
        if conflicts:
            raise InputError(f"{conflicts[0]} with --stereo: leave one out", code="conflict")
    if asked["errors"] and depth.given_values:
        raise InputError(
            f"--errors is of opacities and lights, not of depth; leave out it, or "
            f"{depth.names[min(depth.given_values)]}",
            code="conflict",
        )
    if asked["spectral"]:
        require_suffix(output, "spectral pictures", ".exr")
        options = [f"--{name}" for name in ("errors", "hdr", "model") if asked[name] is not None]
        for option in options + viewing.given_names("exposure", "illuminance_lux"):
            raise InputError(
                f"{option} with --spectral: does not affect spectra; leave it out",
                code="conflict",
            )
        return
    suffix = output.suffix.lower()
    if suffix == ".exr":
        raise ImageError(
            f"{output}: frames are PNG files; name it .png, or add --spectral for a spectrum "
            "in every pixel"
        )
    if asked["hdr"] is None and suffix == ".avif":
        raise ImageError(f"{output}: AVIF is for high dynamic range; add --hdr PQ, or name it .png")
    require_suffix(output, "frames", ".png", *([".avif"] if asked["hdr"] else []))
    if asked["hdr"] is not None and viewing.space is not None:
        raise InputError(
            f"--space {viewing.space} with --hdr, whose space is Rec. 2100; leave one out",
            code="conflict",
        )


def _paths(image: Path, output: Path, names: Sequence[str], errors: bool) -> list[Path]:
    """Return the file of each light; refuse those that cannot be written."""
    from volspec.export import file_stem

    stems = [f"-{file_stem(name)}" if len(names) > 1 else "" for name in names]
    paths = [output.with_name(f"{output.stem}{stem}{output.suffix}") for stem in stems]
    if len({str(path).lower() for path in paths}) < len(paths):
        raise ImageError(f"{output}: two lights would be written to one file; give one at a time")
    for path in [*paths, *(map(_errors_path, paths) if errors else ())]:
        require_writable(path)
        if path.resolve() == image.resolve():
            raise ImageError(f"{path}: is the input image; name another file")
    return paths


def _errors_path(path: Path) -> Path:
    return path.with_name(f"{path.stem}-errors.png")


def _scene_look(image: Path, stored: CoefficientImage, errors: bool, stereo: bool) -> Look:
    """Return the look of an image's scene.

    Errors are of opacities and lights alone, and eyes have no lens.
    """
    from volspec.image import DepthEffects
    from volspec.scene import stored_look

    with errors_of_file(image):
        look = stored_look(stored)
    if errors and look.depth.changes:
        note("--errors: frame and map are without the [depth] of the image's scene")
        return replace(look, depth=DepthEffects())
    if stereo and look.depth.focus_mm is not None:
        note("--stereo: the focus of the image's scene is left out")
        return replace(look, depth=replace(look.depth, focus_mm=None, aperture_mm=None))
    return look


def _views(
    image: Path, stored: CoefficientImage, look: Look, surface: Path | None
) -> Sequence[CoefficientImage]:
    """Return a stored image in a look: one view, or one for each eye."""
    import numpy as np

    from volspec.image import CoefficientImage

    # Unsupported without layers.
    with errors_of_file(image, only="unsupported"), in_options(DepthOptions.names):
        other = None if surface is None else CoefficientImage.load(surface)
        views = look.views(stored, other)
    if look.depth.cuts and not np.isfinite(views[0].depth_mm).any():
        assert stored.opacity_layers is not None
        near, far = stored.opacity_layers.range_mm
        note(f"nothing is left: the layers are {near:.4g} to {far:.4g} mm from the camera")
    return views


def _write_frames(
    views: Sequence[CoefficientImage],
    look: Look,
    frames: Sequence[_Frame],
    errors: CoefficientImage | None,
) -> None:
    """Write each frame, and a map of errors if they are asked for, of the image as it is stored."""
    from volspec.export import BlankFrames, write_frame
    from volspec.pipeline import Relighter
    from volspec.relight import error_map

    blanks, spec = BlankFrames("--exposure"), look.relight
    first, colours = views[0], look.hdr or spec.viewing.display.space
    against: Against | None = "cast" if look.opacities else None
    with ExitStack() as stack:
        relighters = [stack.enter_context(Relighter(view)) for view in views]
        for frame in frames:
            with in_options():
                pictures = [relighter.frame(frame.light, look.of_view) for relighter in relighters]
                pixels = look.combine(pictures)
            notes = {"light": frame.name, "Software": f"volspec {__version__}"}
            if look.stereo:
                notes["stereo"] = look.stereo.layout
            write_frame(frame.path, pixels, notes, colours)
            blanks.add(str(frame.path), frame.text, pictures[0], first.alpha)
            say(f"{frame.path}: {_luminances(pixels, look.hdr)}" if look.hdr else frame.path)
            note_everyday(frame.text)
            if errors is not None:
                how = spec.mode, spec.backdrop, 1, against
                diff_map = error_map(errors, frame.light, *how, opacities=look.opacities or None)
                path = _errors_path(frame.path)
                write_frame(path, diff_map.image(), {"light": frame.name, "shows": str(diff_map)})
                say(f"{path}: {diff_map}")
    blanks.warn()


def _with_lux(
    lamps: Sequence[Spectrum | LightRig], lux: float | None, image: CoefficientImage
) -> list[Spectrum | LightRig]:
    """Return lights with their lux, for HDR; InputError if one has none and --lux is left out."""
    from volspec.relight import LightRig, with_lux

    if lux is not None:
        return [with_lux(lamp, lux, image.basis.grid) for lamp in lamps]
    if any(LightRig.of(lamp).illuminance_lux is None for lamp in lamps):
        raise InputError(
            "--hdr shows luminances, but --light has no lux; add --lux 500, say", code="missing"
        )
    return list(lamps)


def _luminances(frame: NDArray[np.uint16], hdr: Hdr) -> str:
    """Describe the luminances of an HDR frame."""
    import numpy as np

    from volspec.appearance.display import SPACES

    Y = hdr.luminances(frame / 65535.0) @ (SPACES["Rec. 2020"].XYZ_from_RGB[1] / 100.0)
    above = float(np.mean(1.001 * hdr.white_cd_m2 < Y))
    return (
        f"{hdr.transfer}, white {hdr.white_cd_m2:g} cd/m², brightest {Y.max():.0f}, "
        f"{above:.1%} above white"
    )


def _tell_of_lux(image: Path, scene: RelightSpec, asked: PictureOptions, spec: RelightSpec) -> None:
    """Note if the scene's lights have a lux that affects the picture, as --light has none."""
    if asked.illuminance_lux is not None:
        return
    eye = scene.viewing
    if spec.level != scene.level:
        note(
            f'{image}: its scene has level = "absolute", but --light has no lux: white is '
            "equally bright under each light; for an absolute picture at 500 lx add --lux 500 "
            f"--exposure {eye.exposure * 500 / eye.illuminance_lux:g}, or volspec export "
            "SCENE.toml --light NAME -o FOLDER"
        )
    elif spec.viewing.L_A is None and (lux := _lux_of(image)):
        named = ", ".join(f"{name} {value:g}" for name, value in lux.items())
        note(
            f"{image}: its scene's lights have their own lux ({named}), but --light has none and "
            f"counts as {spec.viewing.illuminance_lux:g} lx; add --lux"
        )


def _lux_of(image: Path) -> dict[str, float]:
    """Return the lux of the scene's lights, by name; empty if the image has none."""
    from volspec.export import Recipe

    try:
        lights = Recipe.load(image).lights
    except ImageError:
        return {}
    return {
        name: light.illuminance_lux
        for name, light in lights.items()
        if light.illuminance_lux is not None
    }


def _write_spectra(image: CoefficientImage, frames: Sequence[_Frame], spec: RelightSpec) -> None:
    """Write a spectral frame for each light."""
    from volspec.export import write_spectral_frame

    for frame in frames:
        notes = {"light": frame.name, "mode": spec.mode, "Software": f"volspec {__version__}"}
        write_spectral_frame(frame.path, image, frame.light, spec, notes)
        say(frame.path)


def _picture(path: Path, basis: str | None, taken_under: str | None) -> CoefficientImage:
    """Return a coefficient image, or a spectral picture projected onto a basis."""
    from volspec.basis import SpectralBasis
    from volspec.image import CoefficientImage
    from volspec.spectra import SpectralImage, light

    if basis is None:
        if taken_under is not None:
            raise ImageError(f"{path}: --taken-under is for spectral pictures; add --basis")
        return CoefficientImage.load(path)
    model = SpectralBasis.load(basis)
    lamp = None if taken_under is None else light(taken_under, model.grid)
    picture = SpectralImage.load(path, None if lamp is None else "emissive")
    if picture.kind == "emissive" and lamp is None:
        raise ImageError(f"{path}: holds radiances; give their light: --taken-under A, say")
    try:
        return CoefficientImage.from_spectral_image(picture, model, lamp)
    except VolspecError as error:
        raise ImageError(f"{path}: {error}") from error


def _reflectances(words: Sequence[str], grid: SpectralGrid) -> dict[str, Spectrum]:
    """Return the spectra of MATERIAL=REFLECTANCE arguments."""
    from volspec.spectra import reflectance

    changes = {}
    for word in words:
        material, equals, text = word.partition("=")
        if not (material.strip() and equals and text.strip()):
            raise InputError(f"--reflectance {word!r}: write MATERIAL=REFLECTANCE, as rotor=copper")
        if material.strip() in changes:
            raise InputError(
                f"--reflectance: {material.strip()!r} is given twice; give it once",
                code="duplicate",
            )
        changes[material.strip()] = reflectance(text.strip(), grid)
    return changes
