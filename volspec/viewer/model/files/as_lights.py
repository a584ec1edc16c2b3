"""The lights of the viewer as rows of a scene's file.

    rows -> [as_lights] -> [[light]] -> as_scene

The light that shines goes first, as the viewer opens a scene under its first light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volspec.errors import SpectrumError
from volspec.relight import LightRig
from volspec.scene.lights import LightTable, rows_by_name
from volspec.scene.spectra import SpectrumTable
from volspec.spectra import Spectrum, light
from volspec.spectra.observer import color_matching_functions
from volspec.viewer.model.lights.lighting import LightRow, rig_of, shining
from volspec.viewer.model.state import ViewState

# Names are not to find files by chance, that lie where the program runs.
NOWHERE = "/"
# What a light that several others make together is called.
MIX = "mix"


def light_tables(state: ViewState) -> list[LightTable]:
    """The light that shines first, then the others as they would be alone."""
    rows = list(state.lights)
    weights = shining(state.lights)
    lit = [index for index, weight in enumerate(weights) if weight > 0]
    settings: list[tuple[LightRow, float]] = [(row, 1.0) for row in rows]
    if len(lit) == 1:
        settings.insert(0, (settings.pop(lit[0])[0], weights[lit[0]]))
    elif lit:
        rig = rig_of(state.lights)
        assert rig is not None
        label = " + ".join(rows[index].name for index in lit)
        settings.insert(0, (LightRow(MIX, label, _merged(rig)), 1.0))
    taken: set[str] = set()
    return [table for row, weight in settings for table in _tables(state, row, weight, taken)]


def _merged(rig: LightRig) -> LightRig:
    """One light from each group: a file has no more in a setting."""
    names = tuple(dict.fromkeys(rig.groups))
    if len(names) == len(rig.groups):
        return rig
    lights, lux = [], []
    for name in names:
        own = [index for index, group in enumerate(rig.groups) if group == name]
        given = rig.illuminance_lux and tuple(rig.illuminance_lux[index] for index in own)
        picked = tuple(rig.lights[index] for index in own)
        part = LightRig(picked, tuple(rig.weights[index] for index in own), given)
        lights.append(part.mixed(picked[0].grid))
        lux.append(part.total_lux or 0.0)
    return LightRig(tuple(lights), (), tuple(lux) if rig.illuminance_lux else None, names)


def _tables(
    state: ViewState, row: LightRow, weight: float, taken: set[str]
) -> Iterator[LightTable]:
    """One setting: its row as the open file has it, or a row for each of its lights."""
    name = next(n for n in _names(row.name) if n not in taken)
    taken.add(name)
    kept = _as_in_file(state, row)
    if kept is not None and name == row.name:
        yield from (t.model_copy(update={"weight": t.weight * weight}) for t in kept)
        return
    rig = replace(row.rig, weights=tuple(own * weight for own in row.rig.weights))
    for index, spectrum in enumerate(rig.lights):
        given = light_text(row, index) or SpectrumTable.of(spectrum)
        # A file's numbers are scaled when they are read; of lights with lux they are shapes.
        scaled = isinstance(given, SpectrumTable) and rig.illuminance_lux is None
        yield LightTable(
            name=name,
            label=row.label if row.label != name else None,
            spectrum=given,
            group=rig.groups[index] or None,
            weight=rig.weights[index] * (_power(spectrum) if scaled else 1.0),
            illuminance_lux=rig.illuminance_lux[index] if rig.illuminance_lux else None,
        )


def _names(name: str) -> Iterator[str]:
    """The name, then others that tell it from its like."""
    name = name.strip() or "light"
    yield name
    number = 2
    while True:
        yield f"{name} ({number})"
        number += 1


def _as_in_file(state: ViewState, row: LightRow) -> list[LightTable] | None:
    """What the open file says of a light that is as it was opened."""
    assert state.document.file is not None
    if all(row.rig is not other.rig for other in state.document.lights):
        return None
    return rows_by_name(state.document.file.light).get(row.name)


def light_text(row: LightRow, index: int) -> str | None:
    """What a library's light is called, by which it is found anywhere; None where by nothing."""
    text, spectrum = row.texts[index] if row.texts else None, row.rig.lights[index]
    if text is None:
        return None
    try:
        known = light(text, spectrum.grid, folder=NOWHERE)
    except (SpectrumError, OSError):
        return None
    return text if same_spectrum(known, spectrum) else None


def _power(spectrum: Spectrum) -> float:
    """The mean over the band, weighted by V: what `volspec.light` makes 1."""
    V = color_matching_functions(spectrum.grid)[1]
    return float(V @ spectrum.values / V.sum())


def same_spectrum(one: Spectrum, other: Spectrum) -> bool:
    """Whether two spectra are alike to the last bit."""
    return one is other or (
        np.array_equal(one.wavelengths_nm, other.wavelengths_nm)
        and np.array_equal(one.values, other.values)
    )
