"""Lights of the library: names, everyday names, descriptions in plain words, and a search.

    datasets, lamps -> [library] -> lights, command line, viewer

References
----------
[1] CIE 015:2018, "Colorimetry", section 4 and tables 5 to 12 (kinds and temperatures).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache
from types import MappingProxyType

from volspec.errors import nearest
from volspec.spectra.datasets import Table, illuminants, light_sources
from volspec.spectra.files.tables import fold_name
from volspec.spectra.library.lamps import LAMP, LAMPS

# Its table ends at its peak, 560 nm, and cannot be extrapolated to a grid over the visible.
_UNUSABLE = {"ISO 7589 Sensitometric Printer"}

_CIE = {
    "A": "tungsten lamp, incandescent bulb, 2856 K",
    "B": "direct sunlight, 4874 K",
    "C": "average daylight of 1931, 6774 K",
    "D50": "daylight of graphic arts and print, 5003 K",
    "D55": "sunlight with skylight, 5503 K",
    "D60": "daylight of film and cinema, 6000 K",
    "D65": "average daylight, overcast sky, 6504 K",
    "D75": "north-sky daylight, 7504 K",
    "E": "equal energy, flat white",
    "ID50": "indoor daylight behind glass, 5097 K",
    "ID65": "indoor daylight behind glass, 6601 K",
    "FL1": "fluorescent, daylight, 6430 K",
    "FL2": "fluorescent, cool white of offices, 4230 K",
    "FL3": "fluorescent, white, 3450 K",
    "FL4": "fluorescent, warm white, 2940 K",
    "FL5": "fluorescent, daylight, 6350 K",
    "FL6": "fluorescent, light white, 4150 K",
    "FL7": "fluorescent, broad-band daylight, 6500 K",
    "FL8": "fluorescent, broad-band, 5000 K",
    "FL9": "fluorescent, broad-band cool white, 4150 K",
    "FL10": "fluorescent, three-band, 5000 K",
    "FL11": "fluorescent, three-band of shops, 4000 K",
    "FL12": "fluorescent, three-band warm white, 3000 K",
    "FL3.1": "fluorescent, standard, 2932 K",
    "FL3.2": "fluorescent, standard, 3965 K",
    "FL3.3": "fluorescent, standard, 6280 K",
    "FL3.4": "fluorescent, deluxe, 2904 K",
    "FL3.5": "fluorescent, deluxe, 4086 K",
    "FL3.6": "fluorescent, deluxe, 4894 K",
    "FL3.7": "fluorescent, three-band, 2979 K",
    "FL3.8": "fluorescent, three-band, 4006 K",
    "FL3.9": "fluorescent, three-band, 4853 K",
    "FL3.10": "fluorescent, three-band, 5000 K",
    "FL3.11": "fluorescent, three-band, 5854 K",
    "FL3.12": "fluorescent, multi-band, 2984 K",
    "FL3.13": "fluorescent, multi-band, 3896 K",
    "FL3.14": "fluorescent, multi-band, 5045 K",
    "FL3.15": "fluorescent, daylight simulator, 6509 K",
    "HP1": "sodium lamp, street light, 1959 K",
    "HP2": "sodium lamp, colour-enhanced, 2506 K",
    "HP3": "metal halide lamp, 3144 K",
    "HP4": "metal halide lamp, 4002 K",
    "HP5": "metal halide lamp, 4039 K",
    "LED-B1": "white LED, blue with phosphor, 2733 K",
    "LED-B2": "white LED, blue with phosphor, 2998 K",
    "LED-B3": "white LED, blue with phosphor, 4103 K",
    "LED-B4": "white LED, blue with phosphor, 5109 K",
    "LED-B5": "white LED, blue with phosphor, 6598 K",
    "LED-BH1": "white LED, blue with phosphor and red, 2851 K",
    "LED-RGB1": "white LED of red, green and blue, 2840 K",
    "LED-V1": "white LED, violet with phosphor, 2724 K",
    "LED-V2": "white LED, violet with phosphor, 4070 K",
}
# Measured lamps by a part of their name; the first match counts.
_MEASURED = (
    ("ISO 7589 Photographic Daylight", "daylight of photography"),
    ("ISO 7589 Sensitometric Daylight", "daylight of photography, through a lens"),
    ("ISO 7589 Studio Tungsten", "studio tungsten lamp, 3050 K"),
    ("ISO 7589 Sensitometric Studio", "studio tungsten lamp, through a lens"),
    ("ISO 7589 Photoflood", "photoflood tungsten lamp, 3400 K"),
    ("ISO 7589", "photoflood tungsten lamp, through a lens"),
    ("HPS", "sodium lamp, high pressure, street light"),
    ("LPS", "sodium lamp, low pressure, street light"),
    ("Mercury", "mercury lamp"),
    ("Metal Halide", "metal halide lamp"),
    ("MHC", "metal halide lamp"),
    ("Neodimium", "tungsten bulb with neodymium glass"),
    ("Incandescent", "tungsten bulb"),
    ("60 A/W", "tungsten bulb, 60 W, soft white"),
    ("Kinoton", "xenon lamp of a cinema projector"),
    ("SA", "tungsten lamp, measured"),
    ("SC", "average daylight, measured"),
    ("LED Yellow", "LED lamp with yellow"),
    ("LED", "LED lamp"),
    ("Luxeon", "white LED lamp, warm"),
    ("PHOS", "white LED lamp with phosphor"),
    ("Thorn", "fluorescent tube"),
    ("Triphosphor", "fluorescent tube, three-band"),
    ("TL-84", "fluorescent tube of shops, three-band"),
    ("T8", "fluorescent tube, three-band"),
    ("F", "fluorescent tube"),
    ("Natural", "fluorescent tube, natural white"),
)
# Names of everyday speech, as lights of the library; the library's own names come before them.
EVERYDAY: Mapping[str, str] = MappingProxyType(
    {
        "daylight": "D65",
        "overcast": "D65",
        "sunlight": "D55",
        "sun": "D55",
        "sky": "D75",
        "blue sky": "D75",
        "north sky": "D75",
        "print": "D50",
        "indoor daylight": "ID65",
        "window": "ID65",
        "white": "E",
        "flat": "E",
        "equal energy": "E",
        "tungsten": "A",
        "tungsten lamp": "A",
        "bulb": "A",
        "light bulb": "A",
        "studio": "ISO 7589 Studio Tungsten",
        "photoflood": "ISO 7589 Photoflood",
        "halogen": f"{LAMP}:halogen-3000",
        "sunset": f"{LAMP}:sunset-2000",
        "candle": f"{LAMP}:candle-1900",
        "flash": f"{LAMP}:xenon-6500",
        "xenon": "Kinoton 75P",
        "projector": "Kinoton 75P",
        "fluorescent": "FL2",
        "neon tube": "FL2",
        "office": "FL2",
        "cool white": "FL2",
        "warm white": "FL4",
        "shop": "FL11",
        "supermarket": "FL11",
        "sodium": "HP1",
        "sodium lamp": "HP1",
        "street": "HP1",
        "street light": "HP1",
        "street lamp": "HP1",
        "low-pressure sodium": "LPS",
        "high-pressure sodium": "HP1",
        "led": "LED-B3",
        "warm led": "LED-B1",
        "cool led": "LED-B5",
        "rgb led": "LED-RGB1",
    }
)


@cache
def light_tables() -> Mapping[str, Table]:
    """Return tables of light by name, with those that no grid over the visible can use."""
    tables = dict(illuminants())
    for name, table in light_sources().items():
        tables.setdefault(name, table)
    return tables


def light_names() -> tuple[str, ...]:
    """Return the names of tabulated lights: CIE and ISO illuminants, then measured lamps."""
    return tuple(name for name in light_tables() if name not in _UNUSABLE)


@cache
def library_names() -> tuple[str, ...]:
    """Return the names of tabulated lights, then of lamps by their temperature."""
    return (*light_names(), *(f"{LAMP}:{name}" for name in LAMPS))


@cache
def _by_folded_name() -> dict[str, str]:
    return {**EVERYDAY, **{fold_name(name): name for name in light_tables()}}


def canonical_light(name: str) -> str | None:
    """Return the library's name of a light, also of an everyday name; None if it has none.

    >>> canonical_light("fl2"), canonical_light("Street light"), canonical_light("A+B")
    ('FL2', 'HP1', None)
    """
    return _by_folded_name().get(fold_name(name))


def nearest_light(name: str) -> str:
    """Return "did you mean …? " for a misspelt light, or one whose description has its words."""
    if similar := nearest(name, (*light_names(), *EVERYDAY)):
        return similar
    names = search_lights(name)[:3]
    return f"did you mean {' or '.join(map(repr, names))}? " if names else ""


@lru_cache(maxsize=512)
def describe_light(name: str) -> str:
    """Return what a light of the library is, in plain words.

    >>> describe_light("HP1"), describe_light("lamp:candle-1900")
    ('sodium lamp, street light, 1959 K', 'candle flame, 1900 K')
    """
    prefix, _, lamp = name.partition(":")
    if prefix == LAMP and lamp in LAMPS:
        return f"{LAMPS[lamp].what}, {LAMPS[lamp].kelvin:.0f} K"
    if name in _CIE:
        return _CIE[name]
    return next((text for part, text in _MEASURED if part in name), "measured lamp")


# Shorter words are searched in names only.
_MIN_WORD = 3


@lru_cache(maxsize=64)
def search_lights(text: str) -> tuple[str, ...]:
    """Return the library's lights whose name or description has every word of a text; all if empty.

    The light that an everyday name means comes first, then names that begin with the text.

    >>> search_lights("sodium")[:3], search_lights("street light")[0], search_lights("hp1")
    (('HP1', 'HP2', 'HPS'), 'HP1', ('HP1',))
    """
    start = fold_name(text)
    if not start:
        return library_names()

    def rank(name: str) -> tuple[bool, bool, bool]:
        everyday = any(alias.startswith(start) for alias in _everyday_names(name))
        return name != EVERYDAY.get(start), not fold_name(name).startswith(start), not everyday

    return tuple(
        sorted((name for name in library_names() if _matches(name, start.split())), key=rank)
    )


def _matches(name: str, words: list[str]) -> bool:
    described = f" {' '.join((describe_light(name), *_everyday_names(name)))}".casefold()
    return all(
        word in fold_name(name) or (len(word) >= _MIN_WORD and f" {word}" in described)
        for word in words
    )


@lru_cache(maxsize=512)
def _everyday_names(name: str) -> tuple[str, ...]:
    return tuple(alias for alias, meant in EVERYDAY.items() if meant == name)
