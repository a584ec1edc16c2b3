# What other packages use of this one; lazy_loader and type checkers read it.
from . import opacity_error as opacity_error
from .advice import mode_advice as mode_advice
from .difference_maps import (
    Against as Against,
    ErrorMap as ErrorMap,
    difference_map as difference_map,
    error_map as error_map,
    full_band_basis as full_band_basis,
)
from .gpu import GLEngine as GLEngine
from .hdr import check_hdr as check_hdr, with_lux as with_lux
from .illumination import Illumination as Illumination
from .texture_planes import (
    TexturePlanes as TexturePlanes,
    clamp_finite as clamp_finite,
    layer_count as layer_count,
)
from .look import Look as Look
from .measured_viewing import ViewingMeter as ViewingMeter
from .programs import picture_constants as picture_constants, screen_uniforms as screen_uniforms
from .recompose import (
    PackedOpacity as PackedOpacity,
    are_filled as are_filled,
    depth_uniforms as depth_uniforms,
    layer_extents as layer_extents,
    layer_slots as layer_slots,
    shadow_constants as shadow_constants,
)
from .relighter import Relighter as Relighter, pixel_type as pixel_type, relight as relight
from .spec import (
    LightRig as LightRig,
    Pixels as Pixels,
    RelightSpec as RelightSpec,
    mixed_rig as mixed_rig,
)
from .stereo import (
    EYES as EYES,
    Layout as Layout,
    ShiftedCamera as ShiftedCamera,
    Stereo as Stereo,
    StereoPass as StereoPass,
    StereoViews as StereoViews,
    expected_depth_mm as expected_depth_mm,
)
