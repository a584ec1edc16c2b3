"""The present mix of lights as one light more.

rows -> [mixes] -> rows
"""

from __future__ import annotations

from volspec.errors import VolspecError
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.lights import light_terms
from volspec.viewer.model.lights.lighting import LightRow, Rows, rig_of, shining, with_row

_DIGITS = 4


def mix_text(rows: Rows, group: str = "", folder: str = ".") -> str | None:
    """What shines from a group, as a mix in `volspec.light`'s notation.

    Its weights are shares of the lux where all lights have some. None where nothing shines, or a
    spectrum was drawn.
    """
    rig = rig_of(rows)
    shares: dict[str, float] = {}
    for row, weight in zip(rows, shining(rows), strict=True):
        for j, text in enumerate(row.texts):
            amount = weight * row.rig.weights[j]
            if row.rig.groups[j] != group or amount <= 0:
                continue
            if text is None:
                return None
            if rig and rig.total_lux and row.rig.illuminance_lux:
                amount *= row.rig.illuminance_lux[j] / rig.total_lux
            terms = light_terms(text, folder)
            # Of lux, a mix has its parts' shares: its weights need not sum to 1.
            whole = sum(part for _, part in terms) if rig and rig.total_lux else 1.0
            for name, part in terms:
                shares[name] = shares.get(name, 0.0) + amount * part / whole
    terms_kept = [(name, f"{share:.{_DIGITS}g}") for name, share in shares.items() if share > 0]
    return "+".join(n if s == "1" else f"{n}*{s}" for n, s in terms_kept) or None


def with_mix(rows: Rows, grid: SpectralGrid, folder: str = ".") -> Rows:
    """A row more that alone gives the present mix; all as they are where nothing shines.

    Raises
    ------
    SpectrumError
        If there is no room.
    """
    rig = rig_of(rows)
    if rig is None:
        return rows
    spectra: list[Spectrum] = []
    texts: list[str | None] = []
    lux: list[float] = []
    groups: list[str] = []
    for group in dict.fromkeys(rig.groups):
        part = _from_group(rig, group)
        if part is None:
            continue
        text = mix_text(rows, group, folder)
        try:
            spectrum = light(text, grid, folder=folder) if text else part.mixed(grid)
        except VolspecError:  # a name that does not stand in a mix
            text, spectrum = None, part.mixed(grid)
        spectra.append(spectrum)
        texts.append(text)
        lux.append(part.total_lux or 0.0)
        groups.append(group)
    whole = LightRig(tuple(spectra), (), tuple(lux) if rig.illuminance_lux else None, tuple(groups))
    label = texts[0] if len(texts) == 1 and texts[0] else "a mix that was kept"
    return with_row(rows, LightRow("Mix", label, whole, texts=tuple(texts)))


def _from_group(rig: LightRig, group: str) -> LightRig | None:
    """What is said to shine from a group and from no other; None where that is dark."""
    lux = rig.illuminance_lux
    own = [
        j
        for j, name in enumerate(rig.groups)
        if name == group and rig.weights[j] > 0 and (lux is None or lux[j] > 0)
    ]
    if not own:
        return None
    return LightRig(
        tuple(rig.lights[j] for j in own),
        tuple(rig.weights[j] for j in own),
        tuple(lux[j] for j in own) if lux else None,
    )
