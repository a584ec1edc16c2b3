"""Palettes: lights and reflectances designed so that wanted colours meet."""

from volspec.palette.members import PaletteSpectrum
from volspec.palette.model import Cell, Criteria, Palette
from volspec.palette.solve import Design, design

__all__ = ["Cell", "Criteria", "Design", "Palette", "PaletteSpectrum", "design"]
