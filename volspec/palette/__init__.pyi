# What other packages use of this one; lazy_loader and type checkers read it.
from .advice import VISIBLE as VISIBLE, suggestions as suggestions
from .figure import FIGURE_SUFFIXES as FIGURE_SUFFIXES, save_palette_figure as save_palette_figure
from .file import load_palette as load_palette, palette_file as palette_file
from .measures import (
    ALIKE as ALIKE,
    ApartReport as ApartReport,
    CellReport as CellReport,
    apart_reports as apart_reports,
    report_cells as report_cells,
)
from .model import (
    Apart as Apart,
    Cell as Cell,
    Criteria as Criteria,
    Palette as Palette,
    Place as Place,
    Triple as Triple,
    hexadecimal as hexadecimal,
    parse_colour as parse_colour,
)
from .optimisation import Design as Design, design as design, fitted_exposure as fitted_exposure
from .quadratic_program import EquationBlock as EquationBlock, Term as Term, solve as solve
from .report import DesignReport as DesignReport
from .state import DesignState as DesignState
from .storage import save_palette as save_palette
from .text import apart_text as apart_text, render as render
from .variables import PaletteSpectrum as PaletteSpectrum, mixture_text as mixture_text
