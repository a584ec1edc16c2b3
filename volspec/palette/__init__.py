"""Palettes: lights and reflectances designed for the colours of their products."""

from volspec.palette.advice import suggestions
from volspec.palette.file import load_palette
from volspec.palette.measures import (
    ApartReport,
    CellReport,
    MetamerReport,
    ObserverReport,
    SpectrumReport,
)
from volspec.palette.model import Apart, Cell, Criteria, Palette
from volspec.palette.optimisation import Design, design, fitted_exposure
from volspec.palette.report import DesignReport
from volspec.palette.storage import save_palette
from volspec.palette.variables import PaletteSpectrum

__all__ = [
    "Apart",
    "ApartReport",
    "Cell",
    "CellReport",
    "Criteria",
    "Design",
    "DesignReport",
    "MetamerReport",
    "ObserverReport",
    "Palette",
    "PaletteSpectrum",
    "SpectrumReport",
    "design",
    "fitted_exposure",
    "load_palette",
    "save_palette",
    "suggestions",
]
