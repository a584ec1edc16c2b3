# What other packages use of this one; lazy_loader and type checkers read it.
from . import constants as constants, spaces as spaces
from .constants import (
    D65_CONES_FROM_XYZ as D65_CONES_FROM_XYZ,
    shader_constants as shader_constants,
)
from .deficiency import (
    DEFICIENCIES as DEFICIENCIES,
    DeficiencyName as DeficiencyName,
    Simulation as Simulation,
    VISION as VISION,
    severity_steps as severity_steps,
    simulation as simulation,
)
from .hdr import ContentLight as ContentLight, Hdr as Hdr
from .monitors import (
    Display as Display,
    GAMUTS as GAMUTS,
    Gamut as Gamut,
    PRESETS as PRESETS,
    ROOM as ROOM,
    colour_space as colour_space,
    preset as preset,
)
from .profile import (
    D50_XYZ as D50_XYZ,
    D50_from_white as D50_from_white,
    is_profile as is_profile,
    space_from_profile as space_from_profile,
)
from .spaces import (
    ColourSpace as ColourSpace,
    SPACES as SPACES,
    Transfer as Transfer,
    decode_sRGB as decode_sRGB,
    encode_sRGB as encode_sRGB,
    linear_sRGB_from_XYZ as linear_sRGB_from_XYZ,
    sRGB_CURVE as sRGB_CURVE,
    sRGB_WHITE_XYZ as sRGB_WHITE_XYZ,
    spectrum_colours as spectrum_colours,
    to_uint16 as to_uint16,
    to_uint8 as to_uint8,
)
