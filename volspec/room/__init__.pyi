# What other packages use of this one; lazy_loader and type checkers read it.
from .cube import cube_irradiance as cube_irradiance, cube_radiosity as cube_radiosity
from .eye import (
    SurfaceAppearance as SurfaceAppearance,
    cone_luminances as cone_luminances,
    default_eye as default_eye,
    look as look,
    room_picture as room_picture,
    seen_triangle as seen_triangle,
    surface_appearance as surface_appearance,
)
from .figure import save_room_figure as save_room_figure
from .file import load_room as load_room, paint_named as paint_named
from .form_factors import Rays as Rays
from .model import Eye as Eye, Room as Room
from .paint_ranking import (
    LampRanking as LampRanking,
    painted_surfaces as painted_surfaces,
    present_appearance as present_appearance,
    rank_paints as rank_paints,
    rank_paints_by_lamp as rank_paints_by_lamp,
    wanted_appearance as wanted_appearance,
)
from .paints import (
    MIXING_LAWS as MIXING_LAWS,
    MixingLaw as MixingLaw,
    mix_paints as mix_paints,
    paint_set as paint_set,
)
from .quantities import (
    irradiance_from_lux as irradiance_from_lux,
    lux_from_irradiance as lux_from_irradiance,
    require_reflectance as require_reflectance,
    with_paint as with_paint,
)
from .radiosity import (
    RoomLight as RoomLight,
    look_around as look_around,
    require_inside as require_inside,
    solve_room as solve_room,
)
from .response import (
    RoomResponse as RoomResponse,
    lamp_powers as lamp_powers,
    unknown_light as unknown_light,
)
from .specimen import SpecimenLight as SpecimenLight
from .walls import Backdrop as Backdrop, Placement as Placement, SeenRoom as SeenRoom
