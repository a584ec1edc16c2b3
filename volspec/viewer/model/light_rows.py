"""The list of lights: rows with weights, solo and mute; added, heated, removed.

rows -> [lights] -> LightRig -> relight
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from volspec.errors import SpectrumError, ViewingError
from volspec.relight import LightRig, RelightSpec
from volspec.relight.spec import mixed_rig
from volspec.scene.lights import LightTable, NamedLight
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.files import split_address

KELVIN = (1000.0, 20000.0)
MOST_ROWS = 99


@dataclass(frozen=True, slots=True)
class LightRow:
    """One light of the list.

    Parameters
    ----------
    name : str
    label : str
        What it is, in words.
    rig : LightRig
        What it shines with at weight 1.
    weight : float
        0 to 1.
    solo, muted : bool
    kelvin : float, optional
        Of a Planck radiator, whose temperature can be changed.
    texts : tuple of (str or None), optional
        What each light of the rig was made from, in `volspec.light`'s notation; None where it was
        drawn. Relative files start from the document's folder.
    before : LightRow, optional
        What it was until its spectrum was drawn.
    named : bool
        Whether its name was given by hand: it stays when the spectrum becomes another.

    Raises
    ------
    ViewingError
        If there is not one text for each light of the rig.
    """

    name: str
    label: str
    rig: LightRig
    weight: float = 0.0
    solo: bool = False
    muted: bool = False
    kelvin: float | None = None
    texts: tuple[str | None, ...] = ()
    before: LightRow | None = None
    named: bool = False

    def __post_init__(self) -> None:
        count = len(self.rig.lights)
        texts = tuple(self.texts) or (None,) * count
        if len(texts) != count:
            raise ViewingError(f"light {self.name!r} has {len(texts)} texts for {count} spectra")
        object.__setattr__(self, "texts", texts)

    @property
    def text(self) -> str | None:
        """What it was made from; None where it was drawn, or has several spectra."""
        return self.texts[0] if len(self.texts) == 1 else None


Rows = tuple[LightRow, ...]


@dataclass(frozen=True, slots=True)
class LightState:
    """Lights as they were when they were saved.

    Parameters
    ----------
    name : str
    lights : tuple of LightRow
    relight : RelightSpec
        Viewing, mode, backdrop and level.
    """

    name: str
    lights: Rows
    relight: RelightSpec


@dataclass(frozen=True, slots=True, eq=False)
class Fade:
    """The way to the state's lights from those that were before.

    Parameters
    ----------
    lights : tuple of LightRow
    relight : RelightSpec
        Where it starts.
    seconds : float
        How long it takes.
    """

    lights: Rows
    relight: RelightSpec
    seconds: float


def rows_of(
    lights: Sequence[NamedLight],
    tables: Mapping[str, Sequence[LightTable]] = MappingProxyType({}),
) -> Rows:
    """A scene's lights, of which the first is on.

    Parameters
    ----------
    lights : sequence of NamedLight
    tables : {name: rows}, optional
        What the file has of each (`volspec.scene.lights.rows_by_name`): the notation.
    """
    rows = []
    for i, named in enumerate(lights):
        given = [table.spectrum for table in tables.get(named.name, ())]
        texts = tuple(each if isinstance(each, str) else None for each in given)
        kelvin = kelvin_of(texts[0]) if len(texts) == 1 else None
        weight = 1.0 if i == 0 else 0.0
        rows.append(
            LightRow(named.name, named.label, named.rig, weight, kelvin=kelvin, texts=texts)
        )
    return tuple(rows)


def kelvin_of(text: str | None) -> float | None:
    """The temperature that ``planck:KELVIN`` names; None for any other light.

    >>> kelvin_of("planck:3200"), kelvin_of("D65")
    (3200.0, None)
    """
    prefix, _, number = (text or "").partition(":")
    try:
        return float(number) if prefix.strip().casefold() == "planck" else None
    except ValueError:
        return None


def effective_weights(rows: Rows) -> tuple[float, ...]:
    """The weights that count, after solo and mute."""
    solo = any(row.solo for row in rows)
    return tuple(0.0 if row.muted or (solo and not row.solo) else row.weight for row in rows)


def rig_of(rows: Rows) -> LightRig | None:
    """What lights the picture; None where every light is off.

    The lights' lux count where all that shine carry them.
    """
    weights = effective_weights(rows)
    return mixed_rig([row.rig for row in rows], weights) if any(weights) else None


def with_changes(rows: Rows, index: int, **changes: Any) -> Rows:
    """One row with other settings; all as they are where there is no such row."""
    if not 0 <= index < len(rows):
        return rows
    row = replace(rows[index], **changes)
    return (*rows[:index], row, *rows[index + 1 :])


def with_weight(rows: Rows, index: int, weight: float) -> Rows:
    """One row with another weight, within 0 to 1."""
    return with_changes(rows, index, weight=min(max(weight, 0.0), 1.0))


def only_row(rows: Rows, index: int) -> Rows:
    """One light on, all others off."""
    return tuple(
        replace(row, weight=1.0 if i == index else 0.0, solo=False, muted=False)
        for i, row in enumerate(rows)
    )


def brightest_row(rows: Rows) -> int:
    """The row that shines most; the first where none does."""
    weights = effective_weights(rows)
    return weights.index(max(weights)) if weights else 0


def with_kelvin(rows: Rows, index: int, kelvin: float) -> Rows:
    """A Planck radiator at another temperature."""
    if not (0 <= index < len(rows)) or rows[index].kelvin is None:
        return rows
    kelvin = min(max(round(kelvin), KELVIN[0]), KELVIN[1])
    row, text = rows[index], f"planck:{kelvin:g}"
    rig = replace(row.rig, lights=(light(text, row.rig.lights[0].grid),))
    name = row.name
    if not row.named:
        name = unused_name(f"{kelvin:g} K", (*rows[:index], *rows[index + 1 :]))
    return with_changes(rows, index, rig=rig, kelvin=kelvin, name=name, texts=(text,))


def with_name(rows: Rows, index: int, name: str) -> Rows:
    """A row under another name, numbered where that is taken; without one all stay as they are."""
    name = " ".join(name.split())
    if not 0 <= index < len(rows) or name in ("", rows[index].name):
        return rows
    others = (*rows[:index], *rows[index + 1 :])
    return with_changes(rows, index, name=unused_name(name, others), named=True)


def unused_name(name: str, rows: Rows) -> str:
    """A name that no row has: with a number behind it where it is taken.

    Rows of one name would be one setting of a scene file.
    """
    taken = {row.name for row in rows}
    names = (name, *(f"{name} ({number})" for number in range(2, len(rows) + 3)))
    return next(each for each in names if each not in taken)


def spectrum_of(text: str, grid: SpectralGrid, folder: str = ".") -> tuple[Spectrum, str]:
    """A light in `volspec.light`'s notation, and that notation as it is kept.

    A file's relative name starts from the document's folder, or from where the program runs if
    it is only there; then it is kept whole.

    Raises
    ------
    SpectrumError
        If there is no such light.
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


def with_new_light(rows: Rows, text: str, grid: SpectralGrid, folder: str = ".") -> Rows:
    """A light of the library, in `volspec.light`'s notation, alone and at the end of the list.

    It gets as many lux as shine now, where all the others have some.

    Raises
    ------
    SpectrumError
        If there is no such light, or no room.
    """
    spectrum, kept = spectrum_of(text, grid, folder)
    kelvin = kelvin_of(kept)
    name, label = (kept if split_address(kept) is None else spectrum.name or kept), kept
    if kelvin is not None:
        name, label = f"{kelvin:g} K", "Planck radiator"
    rig = LightRig((spectrum,), illuminance_lux=_present_lux(rows))
    return with_row(rows, LightRow(name, label, rig, kelvin=kelvin, texts=(kept,)))


def with_row(rows: Rows, row: LightRow) -> Rows:
    """One more row at the end, alone, under a name of its own.

    Raises
    ------
    SpectrumError
        If there is no room.
    """
    if len(rows) >= MOST_ROWS:
        raise SpectrumError(f"{MOST_ROWS} lights are the most; remove one first")
    return only_row((*rows, replace(row, name=unused_name(row.name, rows))), len(rows))


def _present_lux(rows: Rows) -> tuple[float] | None:
    if any(row.rig.illuminance_lux is None for row in rows):
        return None
    rig = rig_of(rows) or rows[0].rig
    lux = rig.illuminance_lux
    # Of one group's light a surface gets that group's share.
    named = any(rig.groups)
    total = max(lux or (0.0,)) if named else rig.total_lux
    return (total,) if total else None


def without_row(rows: Rows, index: int) -> Rows:
    """Without one row; the last one stays."""
    if len(rows) < 2 or not 0 <= index < len(rows):
        return rows
    rest = (*rows[:index], *rows[index + 1 :])
    return rest if any(effective_weights(rest)) else only_row(rest, min(index, len(rest) - 1))
