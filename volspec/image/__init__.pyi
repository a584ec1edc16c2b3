# What other packages use of this one; lazy_loader and type checkers read it.
from .depth import (
    DepthEffects as DepthEffects,
    F_NUMBER as F_NUMBER,
    axis_cosine as axis_cosine,
    extents as extents,
    fog_behind as fog_behind,
    layers_in_depth as layers_in_depth,
)
from .fields import APPROXIMATED as APPROXIMATED, ONE_GROUP as ONE_GROUP
from .file import (
    CASTS as CASTS,
    SOLID_VERSION as SOLID_VERSION,
    channel_names as channel_names,
    layer_names as layer_names,
    plain_names as plain_names,
    stored_slots as stored_slots,
)
from .layers import (
    BEND as BEND,
    MIN_TAU as MIN_TAU,
    MAX_LAYERS as MAX_LAYERS,
    MAX_MATERIALS as MAX_MATERIALS,
    MAX_EXPONENT as MAX_EXPONENT,
    MAX_LAYER_TAU as MAX_LAYER_TAU,
    MAX_TAU as MAX_TAU,
    OCCLUSION_GAIN as OCCLUSION_GAIN,
    OpacityLayers as OpacityLayers,
    Slot as Slot,
    Solid as Solid,
    nearest_known as nearest_known,
    ratio as ratio,
    residual_share as residual_share,
    sample_tau as sample_tau,
)
from .model import CoefficientImage as CoefficientImage
from .reproject import Reprojector as Reprojector
