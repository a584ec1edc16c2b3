"""The list of lights: rows with weights, solo and mute; their mix, their lux and the pen.

scene, notation -> [light_rows] -> rows -> LightRig -> relight
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec.errors import ViewingError, VolspecError
from volspec.relight import LightRig, RelightSpec, mixed_rig
from volspec.scene.tables import ROOM_LIGHT, LightSpec, NamedLight
from volspec.spectra import SpectralGrid, Spectrum, illuminance_lux, light
from volspec.spectra.files import split_address
from volspec.viewer.model.view import clamp

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

KELVIN = (1000.0, 20000.0)
MAX_ROWS = 99
LUX = (0.01, 200_000.0)
# The greatest weight of one spectrum of a row.
MAX_WEIGHT = 2.0
# The greatest power of a band, for a V-weighted mean of 1: laser lines reach some hundreds.
MAX_POWER = 1e4
Place = tuple[float, float]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LightRow:
    """One light of the list; in a room, a setting of the room's lamps, which are its groups.

    Raises ViewingError unless there is one text per light of the rig.
    """

    name: str
    label: str  # description
    rig: LightRig  # the light at weight 1
    weight: float = 0.0  # 0 to 1
    solo: bool = False
    muted: bool = False
    kelvin: float | None = None  # of a Planck radiator
    # Each spectrum of the rig in `volspec.light`'s notation; None if it was drawn. Relative names
    # of files start from the document's folder.
    texts: tuple[str | None, ...] = ()
    before: LightRow | None = None  # this row before its spectrum was drawn
    named: bool = False  # by the user: the name is kept if the spectrum changes

    def __post_init__(self) -> None:
        count = len(self.rig.lights)
        texts = tuple(self.texts) or (None,) * count
        if len(texts) != count:
            problem = f"light {self.name!r} has {len(texts)} texts for {count} spectra"
            raise ViewingError(problem, code="shape", field="LightRow.texts", given=texts)
        object.__setattr__(self, "texts", texts)


Rows = tuple[LightRow, ...]


@dataclass(frozen=True, slots=True)
class LightState:
    """Lights and viewing that were saved under a name."""

    name: str
    lights: Rows
    relight: RelightSpec


@dataclass(frozen=True, slots=True, eq=False)
class Fade:
    """Start of a fade to the state's lights and viewing, and how long it takes in seconds."""

    lights: Rows
    relight: RelightSpec
    seconds: float


def rows_from_scene(
    lights: Sequence[NamedLight],
    tables: Mapping[str, Sequence[LightSpec]],
    room: SceneRoom | None = None,
    in_memory: Mapping[str, Spectrum] = MappingProxyType({}),
) -> Rows:
    """Return a scene's lights, with the file's `rows_by_name`, as rows; the first is on.

    ``in_memory`` holds spectra that are not on disk yet.
    """
    rows = []
    for i, named in enumerate(lights):
        specs_of_light, rig = tables.get(named.name, ()), named.rig
        specs = [table.spectrum for table in specs_of_light]
        if room is not None:
            rig = room.lamp_rig(specs_of_light, in_memory)
            counts = [len(room.row_spectra(table, in_memory)) for table in specs_of_light]
            specs = [spec for spec, n in zip(specs, counts, strict=True) for _ in range(n)]
        texts = tuple(notation if isinstance(notation, str) else None for notation in specs)
        kelvin = kelvin_from_text(texts[0]) if len(texts) == 1 else None
        weight = 1.0 if i == 0 else 0.0
        rows.append(LightRow(named.name, named.label, rig, weight, kelvin=kelvin, texts=texts))
    return tuple(rows)


def kelvin_from_text(text: str | None) -> float | None:
    """Return the temperature that ``planck:KELVIN`` names; None for any other light.

    >>> kelvin_from_text("planck:3200"), kelvin_from_text("D65")
    (3200.0, None)
    """
    prefix, _, number = (text or "").partition(":")
    try:
        return float(number) if prefix.strip().casefold() == "planck" else None
    except ValueError:
        return None


def at_kelvin(row: LightRow, kelvin: float) -> LightRow:
    """Return a Planck radiator's row at another temperature, in whole kelvins."""
    kelvin = clamp(round(kelvin), *KELVIN)
    text = f"planck:{kelvin:g}"
    rig = replace(row.rig, lights=(light(text, row.rig.lights[0].grid),))
    return replace(row, rig=rig, kelvin=kelvin, texts=(text,))


def effective_weights(rows: Rows) -> tuple[float, ...]:
    """Return the weights after solo and mute."""
    solo = any(row.solo for row in rows)
    return tuple(0.0 if row.muted or (solo and not row.solo) else row.weight for row in rows)


def light_rig(rows: Rows, room: SceneRoom | None = None) -> LightRig | None:
    """Return the mix that lights the picture; None if every light is off.

    The mix has lux if every light that shines has lux. In a room it is what the room makes of its
    lamps' light.
    """
    if room is not None:
        return _rigs_in_room(rows, room)[0]
    weights = effective_weights(rows)
    return mixed_rig([row.rig for row in rows], weights) if any(weights) else None


def facing_light(rows: Rows, room: SceneRoom | None = None) -> LightRig | None:
    """Return the mix on paper in the picture, for colours of the panels.

    In a room it faces all groups. Always the same object, as caches compare rigs by identity.
    """
    return _mixed_rows(rows) if room is None else _rigs_in_room(rows, room)[1]


@lru_cache(maxsize=64)
def _mixed_rows(rows: Rows) -> LightRig | None:
    return light_rig(rows)


# Few, as each keeps a room.
@lru_cache(maxsize=8)
def _rigs_in_room(rows: Rows, room: SceneRoom) -> tuple[LightRig | None, LightRig | None]:
    """Return the rigs of the picture and of a surface that faces every group."""
    lamps = light_rig(rows)
    if lamps is None:
        return None, None
    try:
        spectrum, rig = room.rig(room.spectra(lamps))
    except VolspecError:  # none of the lamps that are on reaches the volume
        return None, None
    return rig, LightRig((spectrum,), (), (float(illuminance_lux(spectrum)),))


def own_light(room: SceneRoom) -> LightRow:
    """Return the row of the spectra that a room's lights have in its file."""
    spectra = room.own_spectra()
    rig = LightRig(tuple(spectra.values()), groups=tuple(spectra))
    return LightRow(ROOM_LIGHT, "the room's own light", rig, texts=(ROOM_LIGHT,) * len(spectra))


def lit_names(rows: Rows) -> str:
    """Return the names of the lights that are on."""
    weights = effective_weights(rows)
    names = [row.name for row, weight in zip(rows, weights, strict=True) if weight > 0]
    return " + ".join(names[:3]) + (" + …" if len(names) > 3 else "") or "dark"


def parts_by_group(rig: LightRig) -> dict[str, LightRig]:
    """Split a rig into one rig for each light group that shines, without groups."""
    lux = rig.illuminance_lux
    parts = {}
    for group in dict.fromkeys(rig.groups):
        indices = [
            j
            for j, name in enumerate(rig.groups)
            if name == group and rig.weights[j] > 0 and (lux is None or lux[j] > 0)
        ]
        if indices:
            parts[group] = LightRig(
                tuple(rig.lights[j] for j in indices),
                tuple(rig.weights[j] for j in indices),
                tuple(lux[j] for j in indices) if lux else None,
            )
    return parts


def parts_of(row: LightRow) -> list[tuple[int, str, float]]:
    """Return the index, light group and weight of each of a light's spectra."""
    rig = row.rig
    return list(zip(range(len(rig.lights)), rig.groups, rig.weights, strict=True))


def with_parts(row: LightRow, parts: Sequence[tuple[int, str, float]]) -> LightRow:
    """Rebuild a light from some of its spectra: the index, light group and weight of each."""
    lux = row.rig.illuminance_lux
    rig = LightRig(
        tuple(row.rig.lights[j] for j, _, _ in parts),
        tuple(weight for _, _, weight in parts),
        tuple(lux[j] for j, _, _ in parts) if lux else None,
        tuple(group for _, group, _ in parts),
    )
    texts = tuple(row.texts[j] for j, _, _ in parts)
    kelvin = kelvin_from_text(texts[0]) if len(texts) == 1 else None
    return replace(row, rig=rig, texts=texts, kelvin=kelvin, before=None)


def rename_row_groups(row: LightRow, names: Mapping[str, str], new_group: str = "") -> LightRow:
    """Rename the light groups of a row; spectra of those renamed to nothing are removed.

    If nothing would shine, the first spectrum shines from all groups. Group ``new_group`` gets the
    first spectrum, unless one shines from all.
    """
    parts = [
        (j, names.get(group, group), weight)
        for j, group, weight in parts_of(row)
        if not group or names.get(group, group)
    ]
    lux = row.rig.illuminance_lux
    if not any(weight and (lux is None or lux[j]) for j, _, weight in parts):
        shining = (j for j, _, w in parts_of(row) if w and (lux is None or lux[j]))
        first = next(shining, 0)
        parts = [(first, "", row.rig.weights[first] or 1.0)]
    if new_group and all(group for _, group, _ in parts):
        first, _, weight = parts[0]
        parts = [*parts, (first, new_group, weight or 1.0)]
    return row if parts == parts_of(row) else with_parts(row, parts)


def row_at(rows: Rows, index: int, part: int = 0) -> LightRow | None:
    """Return a row; None if the list has no such row, or the row no such part."""
    if not 0 <= index < len(rows) or not 0 <= part < len(rows[index].rig.lights):
        return None
    return rows[index]


def merge_groups(rig: LightRig, grid: SpectralGrid) -> LightRig:
    """Merge the lights of each group into one."""
    parts = parts_by_group(rig)
    spectra = tuple(part.mixed(grid) for part in parts.values())
    lux = tuple(part.total_lux or 0.0 for part in parts.values()) if rig.illuminance_lux else None
    return LightRig(spectra, (), lux, tuple(parts))


def with_item(items: tuple[T, ...], index: int, item: T) -> tuple[T, ...]:
    """Return a tuple with one item replaced."""
    return (*items[:index], item, *items[index + 1 :])


def without_item(items: tuple[T, ...], index: int) -> tuple[T, ...]:
    """Return a tuple without one of its items; the same tuple if there is no such item."""
    return (*items[:index], *items[index + 1 :]) if 0 <= index < len(items) else items


def with_changes(rows: tuple[T, ...], index: int, **changes: Any) -> tuple[T, ...]:
    """Change fields of a row; do nothing if there is no such row."""
    if not 0 <= index < len(rows):
        return rows
    return with_item(rows, index, replace(rows[index], **changes))  # type: ignore[type-var]  # a dataclass


def only_row(rows: Rows, index: int) -> Rows:
    """Turn one light on and all others off."""
    return tuple(
        replace(row, weight=1.0 if i == index else 0.0, solo=False, muted=False)
        for i, row in enumerate(rows)
    )


def brightest_row(rows: Rows) -> int:
    """Return the index of the brightest row; the first on a tie, or if none shines."""
    weights = effective_weights(rows)
    return weights.index(max(weights)) if weights else 0


def unused_name(name: str, taken: Collection[str]) -> str:
    """Return a name that is not taken, by appending a number if necessary.

    Rows with the same name would become one setting of a scene file.
    """
    numbered = (f"{name} ({number})" for number in itertools.count(2))
    return next(attempt for attempt in itertools.chain((name,), numbered) if attempt not in taken)


def light_from_text(text: str, grid: SpectralGrid, folder: str = ".") -> tuple[Spectrum, str]:
    """Return a light from `volspec.light`'s notation, and the notation to save.

    A file's relative name starts from the document's folder. If the file is only in the working
    directory, the notation gets its absolute name.

    Raises SpectrumError if there is no such light.
    """
    text = text.strip()
    address = split_address(text) if text else None
    if address is None:
        spectrum = light(text, grid, folder=folder)
        return spectrum, spectrum.name
    file, selector = address
    if not Path(folder, file).exists() and Path(file).exists():
        text = f"{Path(file).absolute()}{'#' if selector else ''}{selector}"
    return light(text, grid, folder=folder), text


def facing_lux(rig: LightRig, group_shares: Mapping[str, float]) -> float | None:
    """Return the illuminance of a surface that faces every source, lux.

    None if the rig has no lux, or shines only from groups without a share.
    """
    try:
        return rig.facing(group_shares).total_lux
    except VolspecError:
        return None


def lux_note(rows: Rows, group_shares: Mapping[str, float], spec: RelightSpec) -> str:
    """Return a sentence that explains the source of the scene's illuminance."""
    viewing_lux = spec.viewing.illuminance_lux
    shining = [row for row, weight in zip(rows, effective_weights(rows), strict=True) if weight > 0]
    without = [row.name for row in shining if row.rig.illuminance_lux is None]
    if shining and not without:
        rig = light_rig(rows)
        total = facing_lux(rig, group_shares) if rig else None
        return f"Total {total or 0.0:.4g} lx, to which the eye adapts"
    if without and spec.level == "absolute":
        return f"Level “absolute” needs lux, and {without[0]} has none"
    if len(without) < len(shining):
        names = without[0] + (" …" if len(without) > 1 else "")
        return f"{names} has no brightness in lux; all lights use Viewing's {viewing_lux:.4g} lx"
    return f"No brightness set; using {viewing_lux:.4g} lx (Viewing panel)"


def draw_stroke(values: NDArray[np.float64], start: Place, end: Place) -> NDArray[np.float64]:
    """Draw a straight stroke of the pen over a spectrum's (N,) bands, whose power stays >= 0.

    Its ends are (x, power), with x from 0 at the first band's middle to 1 at the last one's.

    >>> draw_stroke(np.zeros(5), (0.25, 1.0), (0.75, 2.0)).tolist()
    [0.0, 1.0, 1.5, 2.0, 0.0]
    """
    last = len(values) - 1
    (x0, y0), (x1, y1) = sorted([(start[0] * last, start[1]), (end[0] * last, end[1])])
    bands = np.arange(len(values), dtype=np.float64)
    under = (bands + 0.5 >= x0) & (bands - 0.5 <= x1)
    if x1 - x0 < 1e-9:
        powers = np.full(len(values), end[1])
    else:
        powers = np.interp(bands, [x0, x1], [y0, y1])
    return np.where(under, np.clip(powers, 0.0, MAX_POWER), values)
