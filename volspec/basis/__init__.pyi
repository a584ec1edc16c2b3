# What other packages use of this one; lazy_loader and type checkers read it.
from .base import require_reflective as require_reflective
from .display import (
    DEFAULT_MODE as DEFAULT_MODE,
    MODES as MODES,
    Mode as Mode,
    display_matrix as display_matrix,
    visible_white as visible_white,
)
from .figure import save_figure as save_figure
from .fit_cache import fit_cached as fit_cached
from .light_figure import save_light_figure as save_light_figure
from .make import fit_library as fit_library
from .materials import (
    Basis as Basis,
    MaterialBasis as MaterialBasis,
    basis_from_dict as basis_from_dict,
    load_basis as load_basis,
)
from .model import SpectralBasis as SpectralBasis
from .reflectance_figure import save_reflectance_figure as save_reflectance_figure
from .report import basis_report as basis_report
from .report_table import (
    CLASSES as CLASSES,
    error_table as error_table,
    terminal_table as terminal_table,
    verdict as verdict,
    worst_line as worst_line,
)
from .samples import sample_errors as sample_errors, through_samples as through_samples
from .storage import GRID_ENDINGS as GRID_ENDINGS, shipped_names as shipped_names
