# What other packages use of this one; lazy_loader and type checkers read it.
from . import gamut_mapping as gamut_mapping, lut3d as lut3d
from .adaptation import linear as linear, nonlinear as nonlinear
from .adaptation_grid import (
    AdaptationGrid as AdaptationGrid,
    ViewTransformGrid as ViewTransformGrid,
    pixels_from_nodes as pixels_from_nodes,
    subdivide as subdivide,
)
from .gamut_mapping import (
    DisplayGamut as DisplayGamut,
    SHADER_STEPS as SHADER_STEPS,
    DisplayOutput as DisplayOutput,
    screen_for_viewing as screen_for_viewing,
)
from .hue import composition as composition
from .lut3d import (
    LutCache as LutCache,
    LutKey as LutKey,
    LutSpace as LutSpace,
    NODES as NODES,
    is_narrow as is_narrow,
    needs_host_lut as needs_host_lut,
)
from .scene_to_display import (
    CLOSED as CLOSED,
    forward_for as forward_for,
    view_transform as view_transform,
)
from .spec import (
    ADAPTING as ADAPTING,
    AdoptedWhite as AdoptedWhite,
    Display as Display,
    MODELS as MODELS,
    PER_PIXEL as PER_PIXEL,
    SURROUNDS as SURROUNDS,
    SURROUND_RATIOS as SURROUND_RATIOS,
    Viewing as Viewing,
)
from .surround import MAX_BACKGROUND as MAX_BACKGROUND, ViewingConditions as ViewingConditions
from .transforms import (
    ClosedTransform as ClosedTransform,
    CurveTransform as CurveTransform,
    LinearTransform as LinearTransform,
    ViewTransform as ViewTransform,
)
