"""Parse command-line arguments: files, sizes, triples of numbers, lights per group.

arguments -> [arguments] -> paths, (width, height), (N, 3) arrays, Spectrum | LightRig
"""

from __future__ import annotations

import csv
import io
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from volspec._parse import read_text
from volspec.errors import ImageError, InputError, SceneError, SpectrumError, ViewingError, nearest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from volspec.image import CoefficientImage
    from volspec.relight import LightRig
    from volspec.spectra import SpectralGrid, Spectrum


Lights = Annotated[list[str] | None, Parameter(name=["--light", "-l"], negative="")]
"""Parameter of lights: names or `volspec.light`'s notation; repeatable."""
# As in `volspec.spectra.datasets`, which imports NumPy.
Observer = Literal[2, 10, "CIE 2015 2", "CIE 2015 10"]
"""Standard observers by their field in degrees."""
# Files that are neither scene nor volume.
_NO_VOLUME = (".png", ".jpg", ".jpeg", ".csv", ".json", ".html", ".py", ".txt", ".mp4", ".gif")
# Remedy for a coefficient image where a scene is expected.
RELIGHT = "relight it: volspec relight {file} --light LIGHT -o FRAME.png"


def require_scene(path: Path, instead: str = RELIGHT, expected: str = "a scene") -> None:
    """Raise a SceneError if the file is a coefficient image instead of a scene or a volume.

    ``instead`` is the remedy, with ``{file}`` for the image's name.
    """
    if path.suffix.lower() == ".exr" and path.is_file():
        if path.stat().st_size == 0:
            raise SceneError(f"{path}: the file is empty; render it again", code="damaged")
        remedy = instead.format(file=shlex.quote(str(path)))
        raise SceneError(f"{path}: is a coefficient image, not {expected}; {remedy}")


def require_image(path: Path, instead: str) -> None:
    """Raise an ImageError if the file is a scene or a volume instead of a coefficient image.

    ``instead`` is the remedy, with ``{file}`` for the file's name.
    """
    if path.suffix.lower() != ".exr" and path.exists():
        kind = "a scene, not" if path.suffix.lower() == ".toml" else "not"
        remedy = instead.format(file=shlex.quote(str(path)))
        if path.suffix.lower() in _NO_VOLUME:
            remedy = "give one, as volspec render writes it"
        raise ImageError(f"{path}: is {kind} a coefficient image (.exr); {remedy}")


def sides(size: str) -> tuple[int, int]:
    """Return WIDTHxHEIGHT as numbers; ValueError if the text is malformed or a side is 0.

    >>> sides("1024x768")
    (1024, 768)
    """
    width, by, height = size.lower().partition("x")
    if not (by and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        if re.fullmatch(r"\d+x\d+", size.lower()):
            raise ValueError(f"{size!r} has a side of 0; width and height must be at least 1")
        raise ValueError(f"{size!r} is not WIDTHxHEIGHT, such as 1024x768")
    return int(width), int(height)


def _require_size(_: Any, size: str | None) -> None:
    """Validate a size, for cyclopts."""
    if size is not None:
        sides(size)


Sized = Parameter(validator=_require_size, allow_leading_hyphen=True)
"""Parameter of an option that is a size."""
Size = Annotated[str | None, Sized]
"""The same, optional."""


# Largest X, Y or Z accepted; white has Y = 100.
MAX = 1e9


def read_triples(
    values: Sequence[float], table: Path | None, names: Sequence[str]
) -> NDArray[np.float64]:
    """Return triples, (N, 3), from numbers, three per colour, or from a CSV file.

    The header names the columns of ``names``, such as ``("X", "Y", "Z")``; without a header they
    are the first three. ``-`` is standard input. Raises InputError if there is no triple, the count
    is not a multiple of three, or a value is beyond 1e9 or not a number.
    """
    import numpy as np

    kind = " ".join(names)
    if table is None:
        if not values or len(values) % 3:
            raise InputError(f"{len(values)} numbers; give {kind} of each colour, or --table FILE")
        rows = np.array(values, dtype=np.float64).reshape(-1, 3)
        if not (fits := np.abs(rows) <= MAX).all():
            raise InputError(
                f"{kind}: {rows[~fits][0]} is not a colour; give numbers within {MAX:g}"
            )
        return rows
    if values:
        raise InputError(f"{kind} as arguments and in {table}; give one of them", code="conflict")
    try:
        is_piped = str(table) == "-"
        text = sys.stdin.read() if is_piped else read_text(table, InputError, f"a CSV of {kind}")
        read = csv.reader(io.StringIO(text))
        lines = [line for line in read if any(cell.strip() for cell in line)]
    except UnicodeDecodeError:  # piped input
        raise InputError(f"{table}: not a text file; give a CSV table of {kind}") from None
    except csv.Error as error:  # a cell of more than 131,072 characters
        raise InputError(f"{table}: not a CSV table ({error}); export it again") from None
    if not lines:
        raise InputError(f"{table}: empty; give a CSV table with columns {', '.join(names)}")
    head = [cell.strip() for cell in lines[0]]
    columns = [0, 1, 2]
    if not _is_number(head[0]):
        missing = [name for name in names if name not in head]
        if missing:
            raise InputError(f"{table}: no column {missing[0]}; its first line is {','.join(head)}")
        columns, lines = [head.index(name) for name in names], lines[1:]
        if not lines:
            raise InputError(f"{table}: no rows below its first line; give one per colour")
    return np.array([_row(table, i, line, columns) for i, line in enumerate(lines, 1)])


def _row(table: Path, number: int, line: Sequence[str], columns: Sequence[int]) -> list[float]:
    cells = [line[i].strip() if i < len(line) else "" for i in columns]
    for cell in cells:
        if not _is_number(cell):
            raise InputError(f"{table}: row {number}: {cell!r} is not a number; give one")
    return [float(cell) for cell in cells]


def _is_number(cell: str) -> bool:
    try:
        return abs(float(cell)) <= MAX
    except ValueError:
        return False


def parse_triple(text: str) -> tuple[float, float, float] | None:
    """Return three numbers written as ``X,Y,Z``; None for any other text.

    >>> parse_triple("95.05,100,108.88"), parse_triple("D65")
    ((95.05, 100.0, 108.88), None)
    """
    try:
        X, Y, Z = (float(word) for word in text.split(","))
    except ValueError:  # not numbers, or not three
        return None
    return X, Y, Z


def read_setting(text: str, groups: Mapping[str, float], grid: SpectralGrid) -> Spectrum | LightRig:
    """Return the light of ``LIGHT``, or of ``GROUP=LIGHT; GROUP=LIGHT; …``.

    A light without a group shines from all of the image's ``groups``, {name: weight}. Raises
    InputError if a group is unknown, given twice or was dark in the cast, or a light is missing;
    SpectrumError if a light is unknown.

    >>> from volspec.spectra import DEFAULT_GRID
    >>> groups = {"key": 0.8, "sky": 0.2}
    >>> read_setting("D65*0.7+A*0.3", groups, DEFAULT_GRID).name
    'D65*0.7+A*0.3'
    >>> rig = read_setting("key=A; sky=D65*0.3; FL2", groups, DEFAULT_GRID)
    >>> rig.groups, [light.name for light in rig.lights]
    (('key', 'sky', ''), ['A', 'D65*0.3', 'FL2'])
    """
    from volspec.relight import LightRig

    if (single := _light(text, grid)) is not None:
        return single
    lights: dict[str, Spectrum] = {}
    for part in text.split(";"):
        group, spectrum = _part(text, part.strip(), grid)
        if group and group not in groups:
            raise InputError(
                f"--light {text!r}: no light group {group!r}; {nearest(group, groups)}the image "
                f"has {', '.join(groups)}"
            )
        if group in lights:
            twice = f"group {group!r} has" if group else "all groups have"
            raise InputError(f"--light {text!r}: {twice} two lights; mix them, as D65*0.7+A*0.3")
        lights[group] = spectrum
    rig = LightRig(tuple(lights.values()), groups=tuple(lights))
    try:
        rig.facing(groups)
    except ViewingError as error:
        raise InputError(f"--light {text!r}: {str(error).removeprefix('LightRig: ')}") from error
    return rig


def read_image_setting(image: Path, text: str, stored: CoefficientImage) -> Spectrum | LightRig:
    """Return a light of a stored image, which names its scene's lights but not their spectra.

    Raises as `read_setting`; if the text names a light of the scene, the SpectrumError says so.
    """
    from volspec.export import Recipe

    try:
        return read_setting(text, stored.groups, stored.basis.grid)
    except SpectrumError:
        try:
            names = list(Recipe.load(image).lights)
        except ImageError:
            names = []
        # Names that can be read without the scene are suggested by the library.
        unreadable = [name for name in names if not _readable(name, stored.basis.grid)]
        meant = "" if text in names else nearest(text, unreadable)
        if text not in names and not meant:
            raise
    raise SpectrumError(
        f"light {text!r}: {meant}{image} names its scene's lights ({', '.join(names)}), but has "
        "no spectra for them; relight the scene: volspec export SCENE.toml --light "
        f"{'NAME' if meant else shlex.quote(text)} -o FOLDER"
    )


def read_opacities(words: Sequence[str]) -> dict[str, float]:
    """Return the scales of MATERIAL=SCALE arguments."""
    scales: dict[str, float] = {}
    for word in words:
        material, _, text = (part.strip() for part in word.rpartition("="))
        try:
            scale = float(text)
        except ValueError:
            material = ""
        if not material:
            raise InputError(f"--opacity {word!r}: write MATERIAL=SCALE, as block=0.3")
        if "," in material and "=" in material:
            options = " ".join(f"--opacity {shlex.quote(part.strip())}" for part in word.split(","))
            raise InputError(f"--opacity {word!r}: give one material each, {options}")
        if material in scales:
            raise InputError(
                f"--opacity: {material!r} is given twice; give it once", code="duplicate"
            )
        scales[material] = scale
    return scales


def _part(text: str, part: str, grid: SpectralGrid) -> tuple[str, Spectrum]:
    """Return the group, "" for all, and the light of one part."""
    from volspec.spectra import light

    if part and (alone := _light(part, grid)) is not None:
        return "", alone
    group, equals, word = (word.strip() for word in part.partition("="))
    if not (group and equals and word):
        raise InputError(f"--light {text!r}: write GROUP=LIGHT; GROUP=LIGHT, as key=A; sky=D65")
    return group, light(word, grid)


def _light(text: str, grid: SpectralGrid) -> Spectrum | None:
    """Return the text as a LIGHT; None if it may assign lights to groups.

    Raises SpectrumError if it is not a LIGHT and has neither ``=`` nor ``;``.
    """
    from volspec.spectra import light

    try:
        return light(text, grid)
    except SpectrumError:
        if set(text) & {"=", ";"}:
            return None
        raise


def _readable(name: str, grid: SpectralGrid) -> bool:
    """Return True if a name is a LIGHT."""
    try:
        return _light(name, grid) is not None
    except SpectrumError:
        return False
