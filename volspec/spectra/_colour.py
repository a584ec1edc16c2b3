"""One door to colour-science: imported late (it takes over a second) and quietly."""

from __future__ import annotations

import warnings
from functools import cache
from types import ModuleType

import numpy as np


@cache
def colour_science() -> ModuleType:
    """The ``colour`` module, without its side effects.

    On import it warns of optional packages that are absent and switches NumPy's printing to
    a legacy style; neither is the caller's business.
    """
    with warnings.catch_warnings(), np.printoptions():
        warnings.simplefilter("ignore")
        import colour
    return colour
