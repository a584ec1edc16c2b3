"""``volspec basis``: accuracy of a basis as a table, JSON and a figure; and fitting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from rich.text import Text

from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import Observer
from volspec.cli.shell import Json, Terminal, app, as_written, bar, print_json, say
from volspec.errors import BasisError, InputError, nearest

if TYPE_CHECKING:
    from volspec.basis import Basis
    from volspec.scene import NamedLight
    from volspec.spectra import SpectralGrid, Spectrum

Tell = Callable[[str, float], None]
_DEFAULT = "general-7"
_MIN_STEP_NM = 0.25
_FIGURES = (".png", ".pdf", ".svg")
_SIZES, _DEFAULT_SIZE = range(3, 17), 7
Flag = Annotated[bool, Parameter(negative="")]
Strict = Parameter(converter=as_written)
Lights = Literal["smooth", "all"] | None


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """A basis to report on and the spectra to measure with; None for the report's defaults."""

    basis: Basis
    classes: Mapping[str, Sequence[Spectrum]] | None = None
    materials: Mapping[str, Spectrum] | None = None
    reason: str = ""


@app.command
def basis(
    subject: str | None = None,
    /,
    *,
    size: Annotated[int | None, Strict] = None,
    method: str | None = None,
    positive: Flag = False,
    lights: Annotated[Lights, Strict] = None,
    observer: Annotated[Observer | None, Strict] = None,
    reflectances: str | None = None,
    step_nm: Annotated[float | None, Strict] = None,
    json: Json = False,
    figure: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> None:
    """Report the colour error of a basis against full spectra, in CIEDE2000.

    Example: `volspec basis general-7 --figure general-7.png`, or
    `volspec basis engine.toml --size 5`

    JSON: `classes` has a row for each class of lights (`scene`, `smooth`, `spiky`): `mean`,
    `median`, `p95` and `max` of the colours fitted to each light; the same four under
    `componentwise`, `exact`, `linear_model`, `rgb_product` and `products` of `2` and `3` surfaces;
    and `worst`, the worst pair. At the top level, `rgb_product` pools the RGB renderer over all
    classes, and `worst` is the worst pair of all: `light`, `reflectance`, `delta_e`, `way` (the
    mode), and its colours in `XYZ` and `sRGB`, exact and as the channels show them (`_shown`).

    Parameters
    ----------
    subject
        A scene (.toml), a coefficient image (.exr), a basis (.json) or the name of a shipped
        basis. Default: general-7, or a basis fitted with the given settings.
    size
        Channels of a basis to fit, 3 to 16: to the scene, or to the library's training set.
    method
        virtual-sensors, pca-sharpened, pca, reduced-rank; for a scene also materials.
    positive
        Keep the sensors positive (virtual-sensors).
    lights
        Lights to fit under: the 26 smooth lights, or all, which adds the 89 spiky ones (with a
        small weight for virtual-sensors). Default: smooth for pca and pca-sharpened, else all.
    observer
        Colour-matching functions: 2 (CIE 1931, the default), 10 (CIE 1964), "CIE 2015 2" or
        "CIE 2015 10".
    reflectances
        Reflectances to measure with: test, natural, patches, training, or materials (the scene's).
        Default: a scene's materials, else test.
    step_nm
        Step of the full spectra, nm, such as 1. Default: the bands of the basis.
    figure
        Figure to write: .png, .pdf or .svg.
    output
        File to write the basis to: .json.
    """
    from volspec.basis import error_table

    if figure is not None:
        require_suffix(figure, "figures", *_FIGURES)
        require_writable(figure)
    if output is not None:
        require_suffix(output, "bases", ".json", error=BasisError)
        require_writable(output)
    settings = {"size": size, "method": method, "positive": positive or None}
    asked = {key: value for key, value in settings.items() if value is not None}
    with bar(quiet=json) as tell:
        case = _case(subject, asked, lights, observer, tell)
        grid = _full_grid(case.basis.grid, step_nm)
        samples, names, measured_on = _samples(case, reflectances, grid)
        table = error_table(
            case.basis,
            case.classes,
            samples,
            names,
            measured_on=measured_on,
            grid=grid,
            progress=lambda fraction: tell("compare with full spectra", fraction),
        )
        if output is not None:
            case.basis.save(output)
        if figure is not None:
            from volspec.basis import save_figure

            tell("draw the figure", 0)
            save_figure(table, figure)
            tell("draw the figure", 1)
    if json:
        print_json(table.to_dict())
        return
    _print(table, case.reason)
    for path in (output, figure):
        if path is not None:
            say(path)


def _print(table: Any, reason: str) -> None:
    from volspec.basis import terminal_table, verdict, worst_line

    console = Terminal(highlight=False)
    basis = table.basis
    head = f": {basis.method}, {basis.size} channels"
    console.print(Text.assemble((basis.name, "bold"), head))
    facts = {
        "trained on": basis.trained_on,
        "chosen because": reason,
        "measured on": f"{table.measured_on}, {basis.observer_deg}° observer",
    }
    for label, words in facts.items():
        if words:
            console.print(Text.assemble((label, "dim"), f" {words}"))
    console.print()
    console.print(terminal_table(table))
    console.print()
    console.print(worst_line(table, console.color_system in ("256", "truecolor")))
    if sentence := verdict(table):
        console.print(sentence)


def _case(
    subject: str | None,
    asked: dict[str, Any],
    lights: Lights,
    observer: Observer | None,
    tell: Tell,
) -> _Case:
    """Return the basis for a subject and settings, with the subject's lights and materials."""
    from volspec.basis import load_basis
    from volspec.image import CoefficientImage

    suffix = "" if subject is None else Path(subject).suffix.lower()
    if "method" in asked:
        _require_method(asked["method"], scene=suffix == ".toml")
    if asked.get("size", _SIZES[0]) not in _SIZES:
        raise BasisError(f"--size {asked['size']}: choose {_SIZES[0]} to {_SIZES[-1]} channels")
    if suffix == ".toml":
        return _of_scene(Path(str(subject)), asked, lights, observer, tell)
    if subject is None and (asked or lights or observer):
        from volspec.basis import fit_library

        tell("fit the basis", 0)
        settings = {"size": _DEFAULT_SIZE} | asked
        fitted = fit_library(**settings, lights=lights, observer_deg=observer or 2)
        tell("fit the basis", 1)
        return _Case(fitted)
    if asked or lights:
        options = [f"--{name}" for name in (*asked, *(["lights"] if lights else []))]
        raise BasisError(
            f"{subject} is already fitted, and {' and '.join(options)} would fit another basis; "
            f"leave out {subject}, or give a scene (.toml)",
            code="duplicate",
        )
    name = subject or _DEFAULT
    if suffix not in ("", ".exr", ".json") and Path(name).exists():
        raise BasisError(
            f"{name}: is not a scene (.toml), an image (.exr) or a basis (.json)",
            "give one of them",
            code="type",
        )
    loaded = CoefficientImage.load(name).basis if suffix == ".exr" else load_basis(name)
    if observer not in (None, loaded.observer_deg):
        raise BasisError(
            f"{name} was made for the {loaded.observer_deg}° observer, not {observer}°; leave out "
            f"--observer, or fit a basis: volspec basis --size {loaded.size} --observer "
            f"{quote(str(observer))}"
        )
    return _Case(loaded)


def _of_scene(
    path: Path, asked: dict[str, Any], lights: str | None, observer: Observer | None, tell: Tell
) -> _Case:
    from volspec.basis import CLASSES
    from volspec.scene import Scene
    from volspec.spectra import Spectrum, light_set

    if lights:
        raise BasisError(
            f"{path}: a scene's basis is fitted to its own lights; --lights is for bases of the "
            "library's training set: leave it out",
            code="conflict",
        )
    tell("fit the basis", 0)
    changes = asked | ({} if observer is None else {"observer_deg": observer})
    scene = Scene.load(path, changes)
    tell("fit the basis", 1)
    fitted = scene.basis
    scene_lights = [
        Spectrum(spectrum.wavelengths_nm, spectrum.values, _name(light, spectrum))
        for light in scene.lights
        for spectrum in light.rig.lights
    ]
    library = {name: light_set(name, fitted.grid) for name in CLASSES}
    reason = "" if changes else scene.basis_reason
    return _Case(fitted, {"scene": scene_lights, **library}, scene.materials, reason)


def _name(light: NamedLight, spectrum: Spectrum) -> str:
    """Return a scene light's name, with its spectrum's if the setting has several lights."""
    return light.name if len(light.rig.lights) == 1 else f"{light.name}: {spectrum.name}"


def _require_method(method: str, *, scene: bool) -> None:
    from volspec.basis.fit import METHODS

    methods = (*METHODS, "materials")
    if method not in methods:
        raise BasisError(
            f"basis method {method!r} is unknown; {nearest(method, methods)}"
            f"choose {', '.join(methods)}",
            code="unknown",
        )
    if method == "materials" and not scene:
        raise BasisError(
            "method 'materials' makes a scene's materials the channels; give the scene: "
            "volspec basis SCENE.toml --method materials"
        )


def _full_grid(bands: SpectralGrid, step_nm: float | None) -> SpectralGrid:
    """Return the grid of the full spectra, over the range of the basis' bands."""
    from volspec.spectra import SpectralGrid

    if step_nm is None:
        return bands
    steps = (bands.stop_nm - bands.start_nm) / step_nm if step_nm else 0.0
    if not (_MIN_STEP_NM <= step_nm <= bands.step_nm and abs(steps - round(steps)) < 1e-6):
        raise InputError(
            f"--step-nm {step_nm:g}: give {_MIN_STEP_NM:g} to {bands.step_nm:g}, a step that "
            f"divides {bands.start_nm:g} to {bands.stop_nm:g} nm, such as 1",
            code="range",
        )
    return SpectralGrid(bands.start_nm, bands.stop_nm, step_nm)


def _samples(
    case: _Case, set_name: str | None, grid: SpectralGrid
) -> tuple[Any, list[str] | None, str]:
    """Return the reflectances to measure with, their names, and a description of the set."""
    from volspec.basis import MaterialBasis
    from volspec.spectra import reflectance_set
    from volspec.spectra.library import reflectance_set_names

    basis_materials = case.basis.materials if isinstance(case.basis, MaterialBasis) else None
    materials = basis_materials or case.materials
    if set_name == "materials" or (set_name is None and materials is not None):
        if materials is None:
            raise BasisError("--reflectances materials: only a scene has them; give a .toml file")
        noun = "material" if len(materials) == 1 else "materials"
        return list(materials.values()), list(materials), f"the scene's {len(materials)} {noun}"
    set_name = set_name or "test"
    names = list(reflectance_set_names(set_name))
    nouns = {
        "test": "held-out reflectances",
        "training": "reflectances of the training set",
        "patches": "patches",
    }
    words = f"{len(names)} {nouns.get(set_name, f'{set_name} reflectances')}"
    return reflectance_set(set_name, grid), names, words
