"""Palettes: lights and reflectances designed so that wanted colours meet."""

from volspec.palette.cells import CellReport
from volspec.palette.exposure import fitted_exposure
from volspec.palette.file import load_palette
from volspec.palette.members import PaletteSpectrum
from volspec.palette.metamers import MetamerReport
from volspec.palette.model import Cell, Criteria, Palette
from volspec.palette.report import DesignReport, SpectrumReport
from volspec.palette.solve import Design, design
from volspec.palette.storage import save_palette

__all__ = [
    "Cell",
    "CellReport",
    "Criteria",
    "Design",
    "DesignReport",
    "MetamerReport",
    "Palette",
    "PaletteSpectrum",
    "SpectrumReport",
    "design",
    "fitted_exposure",
    "load_palette",
    "save_palette",
]
