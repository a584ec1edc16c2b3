"""``volspec reflectance``: a plausible reflectance for a colour, or for a photograph's pixels."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.text import Text

from volspec._confine import require_inside
from volspec._files import require_suffix, require_writable
from volspec.cli.arguments import Observer
from volspec.cli.shell import Json, Terminal, app, as_written, bar, print_json, say, show_names
from volspec.errors import ImageError, InputError, VolspecWarning, one_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from volspec.spectra import MadeReflectances, Spectrum

_FIGURES = (".png", ".pdf", ".svg")
# Smaller shares print as 0.0 %.
_SHOWN = 5e-4


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """Light, method and observer for the given colours."""

    light: str
    method: str
    observer: Observer


@app.command
def reflectance(
    colour: Annotated[list[str] | None, Parameter(negative="", allow_leading_hyphen=True)] = None,
    /,
    *,
    listed: Annotated[bool, Parameter(name="--list", negative="")] = False,
    light: str = "D65",
    method: str = "delaunay",
    under: Annotated[list[str] | None, Parameter(negative="", help="Repeatable.")] = None,
    observer: Annotated[Observer, Parameter(converter=as_written)] = 2,
    image: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    figure: Path | None = None,
    json: Json = False,
) -> None:
    """Construct a plausible reflectance for a colour, from a mixture of measured spectra.

    Example: `volspec reflectance "#c08040" -o paint.csv`, and in a scene
    `[[material]] reflectance = "paint.csv"`

    Example: `volspec reflectance 41 35 12 --light A --figure paint.png`

    Example: `volspec reflectance --image photo.png -o photo.exr`, then
    `volspec relight photo.exr --basis general-9 --light A -o photo-A.png`

    Example: `volspec reflectance --list copper`

    JSON: `mix` has the base spectra with their shares; `lights` has a row for each light with
    `X Y Z`, `L a b` (the light as white) and `delta_e`, CIEDE2000 from the given colour.

    Parameters
    ----------
    colour
        `#rrggbb`, a name of CSS Color 3, or X Y Z with Y = 100 for white; with `--list`, text to
        search for.
    listed
        Print the names of measured reflectances instead: those that contain the text, or all.
    light
        The light under which the surface has the colour.
    method
        delaunay, tetrahedron (Wang, Xu & Sun 2004), smoothest; otsu-2018, jakob-2019,
        meng-2015, mallett-2019, smits-1999.
    under
        Other lights to compute the colour under; default: D65 and A.
    observer
        Colour-matching functions: 2 (CIE 1931), 10 (CIE 1964), "CIE 2015 2" or "CIE 2015 10".
    image
        An sRGB picture instead of a colour; each pixel counts as an evenly lit surface.
    output
        A .csv or .spd for the spectrum; with `--image`, an .exr with a spectrum in every pixel.
    figure
        Figure of the spectrum to write: .png, .pdf or .svg.
    """
    if listed:
        from volspec.spectra import reflectance_names

        show_names(reflectance_names(), " ".join(colour or ()), "reflectance", json)
        return
    asked = _Asked(light, method, observer)
    if image is not None:
        if colour or figure is not None or under or json:
            raise InputError(f"{image}: --image takes --light, --method, --observer and -o only")
        _convert(image, output, asked)
        return
    if not colour:
        raise InputError("no colour; give #rrggbb, a CSS name or X Y Z, or --image FILE")
    from volspec.spectra.files import TABLE_SUFFIXES

    for path, noun, kinds in ((output, "spectra", TABLE_SUFFIXES), (figure, "figures", _FIGURES)):
        if path is not None:
            require_suffix(path, noun, *kinds)
            require_writable(path)
    _construct(" ".join(colour), asked, under or ["D65", "A"], output, figure, json)


def _construct(
    word: str,
    asked: _Asked,
    under: list[str],
    output: Path | None,
    figure: Path | None,
    as_json: bool,
) -> None:
    from volspec.basis import save_reflectance_figure
    from volspec.spectra import light as named_light
    from volspec.spectra import reflectances_from_colours, white_XYZ, write_spectrum
    from volspec.spectra.construct import colour_XYZ, constructed_spectrum

    by_name: dict[str, Spectrum] = {}
    for lamp in map(named_light, (asked.light, *under)):
        by_name.setdefault(lamp.name, lamp)
    lamps = list(by_name.values())
    XYZ = colour_XYZ(word, white_XYZ(lamps[0], asked.observer))
    solution = reflectances_from_colours(XYZ, asked.method, lamps[0], observer_deg=asked.observer)
    paint = constructed_spectrum(solution, word, XYZ, lamps[0], asked.method, asked.observer)
    rows = _under(paint, lamps, XYZ, asked.observer)
    if output is not None:
        write_spectrum(paint, output)
    if figure is not None:
        values = dict(zip(solution.base.names, solution.base.values, strict=True))
        parts = {name: (fraction, values[name]) for name, fraction in solution.mix().items()}
        save_reflectance_figure(paint, parts, lamps, figure, asked.observer)
    if as_json:
        print_json(
            {
                "colour": word,
                **dict(zip("XYZ", XYZ.tolist(), strict=True)),
                "light": asked.light,
                "method": asked.method,
                "constructed": paint.notes["constructed"],
                "mix": [{"name": n, "share": fraction} for n, fraction in solution.mix().items()],
                "lights": rows,
                "wavelengths_nm": paint.wavelengths_nm.tolist(),
                "reflectance": paint.values.tolist(),
            }
        )
        return
    _print(paint, solution, rows)
    for path in (output, figure):
        if path is not None:
            say(path)


def _under(
    paint: Spectrum, lamps: list[Spectrum], XYZ: NDArray[np.float64], observer: Observer
) -> list[dict[str, Any]]:
    """Return the reflectance's colour under each light, and its ΔE from the wanted colour."""
    from volspec.appearance.models import cielab, delta_E_2000
    from volspec.spectra import XYZ_from_spectra, white_XYZ

    target = cielab(XYZ, white_XYZ(lamps[0], observer))
    rows = []
    for lamp in lamps:
        lit_XYZ = XYZ_from_spectra(lamp, paint, observer)
        Lab = cielab(lit_XYZ, white_XYZ(lamp, observer))
        numbers = dict(zip("XYZLab", [*lit_XYZ.tolist(), *Lab.tolist()], strict=True))
        rows.append({"light": lamp.name, **numbers, "delta_e": float(delta_E_2000(target, Lab))})
    return rows


def _print(paint: Spectrum, solution: MadeReflectances, rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    console = Terminal(highlight=False)
    console.print(Text.assemble((paint.name, "bold"), f": {paint.notes['colour']}"))
    ways = {
        "tetrahedron": "mixed from the paper's tetrahedron",
        "delaunay": "mixed from the Delaunay tetrahedron",
        "extended": "smoothest extension of the mixture at the edge of the measured reflectances",
        "smoothest": "the smoothest reflectance of this colour",
        "nearest": "reflectance of the nearest possible colour",
    }
    construction = paint.notes["constructed"]
    console.print(Text(ways.get(construction, f"recovered by {construction}")))
    for name, fraction in solution.mix().items():
        if fraction >= _SHOWN:
            console.print(Text(f"  {100 * fraction:5.1f} %  {name}"), soft_wrap=True)
    table = Table(box=None, pad_edge=False, show_edge=False)
    table.add_column("under")
    for name in ("X", "Y", "Z", "L*", "a*", "b*", "ΔE00 from the colour given"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        cells = [f"{row[key]:.2f}" for key in "XYZLab"]
        table.add_row(Text(row["light"]), *cells, f"{row['delta_e']:.3f}")
    console.print()
    console.print(table)


def _convert(image: Path, output: Path | None, asked: _Asked) -> None:
    """Convert a photograph to a spectral picture of reflectances."""
    import numpy as np

    from volspec.spectra import DEFAULT_GRID, SpectralImage, reflectances_from_colours, white_XYZ
    from volspec.spectra import light as named_light
    from volspec.spectra.construct import XYZ_from_sRGB

    if output is None or output.suffix.lower() != ".exr":
        raise ImageError(f"{image}: --image writes a spectral picture; give -o FILE.exr")
    require_writable(output)
    pixels = _pixels(image)
    lamp = named_light(asked.light)
    codes = pixels.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    unique, place = np.unique(codes, return_inverse=True)
    triples = np.stack([unique >> 16, unique >> 8 & 255, unique & 255], axis=-1)
    XYZ = XYZ_from_sRGB(triples / 255.0, white_XYZ(lamp, asked.observer))
    with bar() as tell:
        tell("reflectances", 0)
        solution = reflectances_from_colours(
            XYZ,
            asked.method,
            lamp,
            observer_deg=asked.observer,
            progress=lambda fraction: tell("reflectances", fraction),
        )
        tell("reflectances", 1)
    notes = {
        "spectral quantity": "reflectance",
        "constructed": f"{asked.method}, from {image.name} under {lamp.name}",
    }
    values = solution.values.astype(np.float32)[place.reshape(codes.shape)]
    SpectralImage(values, DEFAULT_GRID.wavelengths_nm, "reflective", notes).save(output)
    height, width = codes.shape
    counts = ", ".join(f"{number} {name}" for name, number in solution.counts().items())
    text = f"{output}: {width}×{height}, {values.shape[-1]} bands; {len(unique)} colours: {counts}"
    say(text)


def _pixels(path: Path) -> NDArray[np.uint8]:
    """Return the (H, W, 3) codes of an sRGB picture, upright."""
    import numpy as np
    from PIL import Image, ImageOps, UnidentifiedImageError

    require_inside(path, ImageError)
    try:
        with Image.open(path) as stored:
            upright = ImageOps.exif_transpose(stored)
            if upright.has_transparency_data:
                _warn(f"{path}: its transparency is ignored")
            if "icc_profile" in stored.info:
                _warn(f"{path}: its colour profile is ignored; it is read as sRGB")
            return np.asarray(upright.convert("RGB"))
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file; check the path", code="not-found") from None
    except UnidentifiedImageError:
        raise ImageError(f"{path}: not a readable picture; give PNG, JPEG or TIFF") from None
    # For a damaged file Pillow raises SyntaxError, struct.error, MemoryError and others.
    except Exception as error:
        raise ImageError(
            f"{path}: cannot be read ({one_line(error)}); export it again", code="damaged"
        ) from None


def _warn(message: str) -> None:
    warnings.warn(message, VolspecWarning, stacklevel=3)
