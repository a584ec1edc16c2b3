"""What a wizard asks for, in the making: which spectra are open, and what must not change.

    drawing -> [wish] -> asks -> design

A wizard opens the reflectances that it is about, and a light where it is asked for a new one;
everything else of the scene is given. What must not change is compared with the material as it was
before, a row of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from volspec.errors import SceneError
from volspec.palette import Cell, Criteria, Design, Palette, PaletteSpectrum, design
from volspec.palette.model import Place
from volspec.palette.report import DesignReport
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra import light as find_light
from volspec.wizard.drawing import Drawing, was
from volspec.wizard.result import NewLight

Cells = dict[Place, Cell]

# Given spectra settle in few rounds; a light that is designed along takes more.
_ROUNDS, _ROUNDS_LIGHT = 6, 12
# Of a light that is designed: what the eye sees well, and times an even light's power.
_BAND_nm, _MOST = (420.0, 680.0), 8.0
# Periods of the waves that its design begins with.
_WAVES_NM = (60.0, 45.0, 110.0)
# ΔE at which no other beginning is looked at.
_GOOD = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class WishedLight:
    """The light that a wish is about: of the scene, or one to be designed.

    Parameters
    ----------
    columns : tuple of str
        What the palette calls it.
    like : tuple of str
        Of a new light: the columns that it shall resemble; else empty.
    new : NewLight, optional
    """

    columns: tuple[str, ...]
    like: tuple[str, ...] = ()
    new: NewLight | None = None

    @classmethod
    def of(cls, drawing: Drawing, name: str, like: str | None, lamps: Sequence[str]) -> WishedLight:
        """A light of the scene by its name, or a new one of that name.

        Raises
        ------
        SceneError
            If there is no such light, or already one, or lamps are given for one of the scene.
        SpectrumError
            If a lamp is unknown.
        """
        if like is None:
            if lamps:
                raise SceneError(
                    f"{drawing.scene.path}: lamps {', '.join(lamps)} are for a new light; say "
                    "which light of the scene it is like"
                )
            hint = "; for a new light say which of these it is like"
            return cls(tuple(drawing.columns(drawing.light(name, hint))))
        drawing.new_light(name)
        mixture = tuple(find_light(lamp, drawing.scene.basis.grid) for lamp in lamps)
        # At the ends of the spectrum, which the eye hardly sees, power would grow without bounds.
        band, most = (None, None) if mixture else (_BAND_nm, _MOST)
        member = PaletteSpectrum(name, open=True, upper=most, band_nm=band, mixture=mixture)
        shown = drawing.light(like)
        return cls((name,), tuple(drawing.columns(shown)), NewLight(member, shown))


@dataclass(frozen=True, slots=True, eq=False)
class Wish:
    """A scene's materials that are open, and the light they are open for.

    Parameters
    ----------
    drawing : Drawing
    opened : tuple of str
    about : WishedLight
    """

    drawing: Drawing
    opened: tuple[str, ...]
    about: WishedLight

    def keep(self, weight: float) -> Cells:
        """Every open material as it was under all lights that the wish is not about."""
        lights = self.drawing.lights()
        return {
            (name, column.name): Cell("same", other=(was(name), column.name), weight=weight)
            for name in self.opened
            for column in lights
            if column.name not in self.about.columns
        }

    def resemble(self) -> Cells:
        """Every other material under a new light as under the one that it is like."""
        return {
            (name, self.about.columns[0]): Cell("same", other=(name, self.about.like[0]))
            for name in self.drawing.scene.materials
            if self.about.new and name not in self.opened
        }

    def design(self, cells: Cells) -> Design:
        """The palette of these cells, designed: of several beginnings the best."""
        best, least = None, math.inf
        for made in self.designs(cells):
            report = DesignReport.of(made)
            if best is None or report.cost["colours"] < least:
                best, least = made, report.cost["colours"]
            if report.max < _GOOD:
                break
        assert best is not None  # there is always a beginning
        return best

    def designs(self, cells: Cells) -> Iterator[Design]:
        """Designs from several beginnings.

        A light and a reflectance that are designed in turn end where they began to lead.
        """
        about, drawing = self.about, self.drawing
        befores = {was(name) for name in self.opened}
        compared = any(cell.other and cell.other[0] in befores for cell in cells.values())
        rows, columns = drawing.rows(self.opened, before=compared), drawing.lights()
        grid, viewing = drawing.scene.basis.grid, drawing.viewing
        if about.new is None:
            criteria = Criteria(rounds=_ROUNDS)
            yield design(Palette(rows, columns, cells, viewing, grid, criteria))
            return
        criteria = Criteria(rounds=_ROUNDS_LIGHT)
        for member in _beginnings(about.new.member, grid):
            yield design(Palette(rows, (*columns, member), cells, viewing, grid, criteria))


def _beginnings(member: PaletteSpectrum, grid: SpectralGrid) -> Iterator[PaletteSpectrum]:
    """A new light beginning at waves of several lengths; a sum of lamps at these alike."""
    if member.mixture:
        yield member
        return
    wavelengths = grid.wavelengths_nm
    for period, phase in product(_WAVES_NM, (0.5, 0.0)):
        wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * ((wavelengths - grid.start_nm) / period + phase))
        inside = (wavelengths >= _BAND_nm[0]) & (wavelengths <= _BAND_nm[1])
        yield replace(member, spectrum=Spectrum(wavelengths, wave * inside, member.name))
