# What other packages use of this one; lazy_loader and type checkers read it.
from .operations import hide as hide, keep as keep, merge as merge, reveal as reveal
from .result import (
    LightEvaluation as LightEvaluation,
    Redesigned as Redesigned,
    displayed_Lab as displayed_Lab,
    evaluate_lights as evaluate_lights,
    require_output as require_output,
)
from .discriminating_lights import (
    DiscriminatingLight as DiscriminatingLight,
    show_difference as show_difference,
)
