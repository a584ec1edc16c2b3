# What other packages use of this one; lazy_loader and type checkers read it.
from . import (
    cam as cam,
    hellwig2022 as hellwig2022,
    hunt as hunt,
    lab as lab,
    nayatani95 as nayatani95,
    rlab as rlab,
)
from .base import Appearance as Appearance, Model as Model, opponents as opponents
from .cam import CamTransform as CamTransform, cam16 as cam16, ciecam02 as ciecam02
from .hunt import HuntSettings as HuntSettings
from .lab import (
    CIE94_metric as CIE94_metric,
    XYZ_from_cielab as XYZ_from_cielab,
    cielab as cielab,
    cielab_chord as cielab_chord,
    delta_E_2000 as delta_E_2000,
)
from .nayatani95 import NayataniSettings as NayataniSettings
from .registry import APPEARANCE_MODELS as APPEARANCE_MODELS, model as model
