"""Rooms with painted walls: the light that they exchange, and paints that look as wanted."""

from volspec.room.brick import Brick
from volspec.room.cube import cube_irradiance, cube_radiosity
from volspec.room.quantities import irradiance_from_lux, lux_from_irradiance, with_paint
from volspec.room.wall_paint import (
    WallPaint,
    appearance_distance,
    atlas_appearance,
    cube_paint_for_radiosity,
    paint_for_appearance,
    wall_appearance,
)

__all__ = [
    "Brick",
    "WallPaint",
    "appearance_distance",
    "atlas_appearance",
    "cube_irradiance",
    "cube_paint_for_radiosity",
    "cube_radiosity",
    "irradiance_from_lux",
    "lux_from_irradiance",
    "paint_for_appearance",
    "wall_appearance",
    "with_paint",
]
