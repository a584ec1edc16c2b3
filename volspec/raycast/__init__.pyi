# What other packages use of this one; lazy_loader and type checkers read it.
from . import framing as framing
from .gpu import VolumeCaster as VolumeCaster
from .lights import (
    Ambient as Ambient,
    Directional as Directional,
    HEADLIT as HEADLIT,
    Headlight as Headlight,
    LightGroup as LightGroup,
    MAX_GROUPS as MAX_GROUPS,
    MAX_NAME as MAX_NAME,
    Point as Point,
    Source as Source,
    Spot as Spot,
    lamp_points as lamp_points,
)
from .progressive import Pace as Pace, Pass as Pass, WHOLE as WHOLE
from .step_search import Quality as Quality, TARGETS as TARGETS
from .spec import (
    ClipPlane as ClipPlane,
    MAX_PLANES as MAX_PLANES,
    MAX_STEPS as MAX_STEPS,
    MODES as MODES,
    RaycastSpec as RaycastSpec,
    diagonal_mm as diagonal_mm,
)
from .surfaces import (
    SurfaceCaster as SurfaceCaster,
    SurfaceImage as SurfaceImage,
    OpacityCaster as OpacityCaster,
    POINTS as POINTS,
    Surfaces as Surfaces,
    edge_sample_points as edge_sample_points,
    mean_of_points as mean_of_points,
    neighbour_pixels as neighbour_pixels,
    empty_result as empty_result,
    composite_under as composite_under,
)
from .vtk_interop import plotter_camera as plotter_camera, require_open as require_open
