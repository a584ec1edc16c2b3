"""``volspec relight``: relight a stored image in a moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from volspec import __version__
from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import read_image_setting, read_opacities, require_image
from volspec.cli.shell import app, as_written, note, note_everyday, say
from volspec.cli.viewing import (
    DEPTH_OPTIONS,
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

    from volspec.appearance.hdr import Hdr
    from volspec.image import CoefficientImage
    from volspec.relight import ErrorMap, LightRig, RelightSpec
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
    from volspec.appearance.spaces import to_uint16
    from volspec.export.frames import BlankFrames, file_stem, write_frame
    from volspec.image import DepthEffects
    from volspec.pipeline import Relighter
    from volspec.relight.hdr import hdr_frame
    from volspec.scene import stored_depth, stored_relight_spec
    from volspec.spectra.lights import sent_names

    require_image(
        image,
        "relight it: volspec export {file} -o FOLDER; or cast it first: volspec render "
        "{file} -o IMAGE.exr",
    )
    shown, eyes = hdr.display(), stereo.spec()
    if eyes and (spectral or errors or shown):
        option = "spectral" if spectral else "errors" if errors else "hdr"
        raise InputError(f"--{option} with --stereo: leave one out", code="conflict")
    if eyes and (given := {"focus_mm", "aperture_mm", "surface"} & {*depth.given_values}):
        option = DEPTH_OPTIONS[min(given)]
        raise InputError(f"{option} with --stereo: leave one out", code="conflict")
    _check_kind(output, spectral, viewing, model, errors, shown)
    names = sent_names(light)
    stems = [f"-{file_stem(name)}" if len(light) > 1 else "" for name in names]
    paths = [output.with_name(f"{output.stem}{stem}{output.suffix}") for stem in stems]
    if len({str(path).lower() for path in paths}) < len(paths):
        raise ImageError(f"{output}: two lights would be written to one file; give one at a time")
    maps = [path.with_name(f"{path.stem}-errors.png") for path in paths]
    for path in [*paths, *(maps if errors else [])]:
        require_writable(path)
        if path.resolve() == image.resolve():
            raise ImageError(f"{path}: is the input image; name another file")
    stored = _picture(image, basis, taken_under)
    layered, scales = stored, read_opacities(opacity or ())
    # Errors are of opacities and lights alone, and eyes have no lens.
    own = DepthEffects()
    if stored.opacity_layers is not None:
        with errors_of_file(image):
            own = stored_depth(stored)
    if errors and own.changes:
        note("--errors: frame and map are without the [depth] of the image's scene")
        own = DepthEffects()
    if eyes and own.focus_mm is not None:
        note("--stereo: the focus of the image's scene is left out")
        own = replace(own, focus_mm=None, aperture_mm=None)
    with in_options(), errors_of_file(image, only="unsupported"):  # without layers
        views = (
            [*eyes.views(stored, scales, depth.effects(own))]
            if eyes
            else [depth.onto(stored, scales, own)]
        )
    stored = views[0]
    if errors and (asked := depth.given_values):
        raise InputError(
            f"--errors is of opacities and lights, not of depth; leave out it, or "
            f"{DEPTH_OPTIONS[min(asked)]}",
            code="conflict",
        )
    with errors_of_file(image):
        scene = stored_relight_spec(stored)
    lamps = [read_image_setting(image, text, stored) for text in light]
    if shown is not None:
        lamps = _lit(lamps, viewing.lux, stored)
    own_mode = mode or ("exact" if spectral else None)
    spec = viewing.onto(scene, model=model, mode=own_mode, backdrop=backdrop).for_lights(lamps)
    changes = _reflectances(reflectance or (), stored.basis.grid)
    if spectral:
        with in_options():
            stored = stored.with_reflectances(changes) if changes else stored
        named = dict(zip(names, lamps, strict=True))
        _write_spectra(stored, named, spec, paths)
        _tell_of_lux(image, scene, viewing, spec)
        return
    blanks = BlankFrames("--exposure")
    edited = stored
    with ExitStack() as stack:
        relighters = [stack.enter_context(Relighter(view)) for view in views]
        relighter = relighters[0]
        if changes:
            with in_options():
                for each in relighters:
                    each.set_reflectances(changes)
                edited = stored.with_reflectances(changes)
        each_light = zip(light, names, lamps, paths, maps, strict=True)
        for text, name, lamp, path, error_path in each_light:
            with in_options():
                if eyes:
                    left, right = (each.frame(lamp, spec) for each in relighters)
                    frame = eyes.combine(left, right, spec.viewing.display.space)
                elif shown is None:
                    frame = relighter.frame(lamp, spec)
                else:
                    frame = to_uint16(hdr_frame(edited, lamp, spec, shown))
            notes = {"light": name, "Software": f"volspec {__version__}"}
            if eyes:
                notes["stereo"] = eyes.layout
            write_frame(path, frame, notes, shown or spec.viewing.display.space)
            blanks.add(str(path), text, frame[:, : stored.size[0]], stored.alpha)
            say(path if shown is None else f"{path}: {_luminances(frame, shown)}")
            note_everyday(text)
            if errors:
                off = _error_map(layered, changes, scales, lamp, spec)
                write_frame(error_path, off.image(), {"light": name, "shows": str(off)})
                say(f"{error_path}: {off}")
    blanks.warn()
    _tell_of_lux(image, scene, viewing, spec)


def _lit(
    lamps: Sequence[Spectrum | LightRig], lux: float | None, image: CoefficientImage
) -> list[Spectrum | LightRig]:
    """Return lights with their lux, for HDR; InputError if one has none and --lux is left out."""
    from volspec.relight import LightRig
    from volspec.relight.hdr import with_lux

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

    from volspec.appearance.spaces import SPACES

    Y = hdr.luminances(frame / 65535.0) @ (SPACES["Rec. 2020"].XYZ_from_RGB[1] / 100.0)
    above = float(np.mean(1.001 * hdr.white_cd_m2 < Y))
    return (
        f"{hdr.transfer}, white {hdr.white_cd_m2:g} cd/m², brightest {Y.max():.0f}, "
        f"{above:.1%} above white"
    )


def _tell_of_lux(image: Path, scene: RelightSpec, given: PictureOptions, spec: RelightSpec) -> None:
    """Note if the scene's lights have a lux that affects the picture, as --light has none."""
    if given.lux is not None:
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
    from volspec.export.compositing import Recipe

    try:
        lights = Recipe.load(image).lights
    except ImageError:
        return {}
    return {
        name: light.illuminance_lux
        for name, light in lights.items()
        if light.illuminance_lux is not None
    }


def _write_spectra(
    image: CoefficientImage,
    lights: Mapping[str, Spectrum | LightRig],
    spec: RelightSpec,
    paths: Sequence[Path],
) -> None:
    """Write a spectral frame for each light."""
    from volspec.export.spectral import write_spectral_frame

    for (name, lamp), path in zip(lights.items(), paths, strict=True):
        notes = {"light": name, "mode": spec.mode, "Software": f"volspec {__version__}"}
        write_spectral_frame(path, image, lamp, spec, notes)
        say(path)


def _check_kind(
    output: Path,
    spectral: bool,
    viewing: PictureOptions,
    model: str | None,
    errors: bool,
    hdr: Hdr | None,
) -> None:
    """Refuse an output of the wrong kind, and options that do not apply to it."""
    suffix = output.suffix.lower()
    if not spectral:
        if suffix == ".exr":
            raise ImageError(
                f"{output}: frames are PNG files; name it .png, or add --spectral for a spectrum "
                "in every pixel"
            )
        if hdr is None and suffix == ".avif":
            raise ImageError(
                f"{output}: AVIF is for high dynamic range; add --hdr PQ, or name it .png"
            )
        require_suffix(output, "frames", ".png", *([".avif"] if hdr else []))
        if hdr is not None and viewing.space is not None:
            raise InputError(
                f"--space {viewing.space} with --hdr, whose space is Rec. 2100; leave one out",
                code="conflict",
            )
        return
    require_suffix(output, "spectral pictures", ".exr")
    given = {"model": model, "errors": errors or None, "hdr": hdr, **asdict(viewing)}
    for name, value in given.items():
        if value is not None and name not in ("exposure", "lux"):
            option = name if name[0].isupper() else name.replace("_", "-")
            raise InputError(
                f"--{option} with --spectral: does not affect spectra; leave it out",
                code="conflict",
            )


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


def _error_map(
    image: CoefficientImage,
    changes: Mapping[str, Spectrum],
    opacities: Mapping[str, float],
    lamp: Spectrum | LightRig,
    spec: RelightSpec,
) -> ErrorMap:
    """Return the map of an image's errors: of opacities against a cast, otherwise of colours."""
    from volspec.relight import error_map

    edited = image.with_reflectances(changes) if changes else image
    if opacities:
        how = spec.mode, spec.backdrop
        return error_map(edited, lamp, *how, against="cast", opacities=opacities)
    return error_map(edited, lamp, spec.mode, spec.backdrop)


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
