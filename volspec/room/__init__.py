"""Rooms with painted walls: the light that they exchange, and paints that look as wanted."""

from volspec.room.beam import Beam, read_beam
from volspec.room.brick import Brick
from volspec.room.cube import cube_irradiance, cube_radiosity
from volspec.room.eye import (
    EyeConditions,
    SurfaceAppearance,
    default_eye,
    look,
    room_picture,
    surface_appearance,
)
from volspec.room.file import load_room
from volspec.room.mesh import RoomMesh, box, panel, rectangle
from volspec.room.model import Eye, PointLamp, Room, SunBeam
from volspec.room.paint_ranking import (
    PaintRanking,
    RankedPaint,
    painted_surfaces,
    present_appearance,
    rank_paints,
    wanted_appearance,
)
from volspec.room.paints import mix_paints, paint_set
from volspec.room.quantities import irradiance_from_lux, lux_from_irradiance, with_paint
from volspec.room.radiosity import RoomLight, solve_room
from volspec.room.wall_paint import (
    WallPaint,
    appearance_distance,
    atlas_appearance,
    cube_paint_for_radiosity,
    paint_for_appearance,
    wall_appearance,
)

__all__ = [
    "Beam",
    "Brick",
    "Eye",
    "EyeConditions",
    "PaintRanking",
    "PointLamp",
    "RankedPaint",
    "Room",
    "RoomLight",
    "RoomMesh",
    "SunBeam",
    "SurfaceAppearance",
    "WallPaint",
    "appearance_distance",
    "atlas_appearance",
    "box",
    "cube_irradiance",
    "cube_paint_for_radiosity",
    "cube_radiosity",
    "default_eye",
    "irradiance_from_lux",
    "load_room",
    "look",
    "lux_from_irradiance",
    "mix_paints",
    "paint_for_appearance",
    "paint_set",
    "painted_surfaces",
    "panel",
    "present_appearance",
    "rank_paints",
    "read_beam",
    "rectangle",
    "room_picture",
    "solve_room",
    "surface_appearance",
    "wall_appearance",
    "wanted_appearance",
    "with_paint",
]
