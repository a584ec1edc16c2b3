# What other packages use of this one; lazy_loader and type checkers read it.
from .animation import located_in as located_in
from .annotate import (
    MarkedPicture as MarkedPicture,
    Patch as Patch,
    paint as paint,
    picture_marks as picture_marks,
)
from .compositing import (
    Recipe as Recipe,
    save_for_compositors as save_for_compositors,
    scene_recipe as scene_recipe,
)
from .contact_sheet import SheetTile as SheetTile, comparison_sheet as comparison_sheet
from .deep import save_deep as save_deep
from .demo import run_demo as run_demo
from .exporter import even_size as even_size, export as export
from .ffmpeg import ffmpeg as ffmpeg
from .film import FILM_SUFFIXES as FILM_SUFFIXES
from .frames import BlankFrames as BlankFrames, file_stem as file_stem, write_frame as write_frame
from .plan import (
    CheckedExport as CheckedExport,
    Plan as Plan,
    Shot as Shot,
    check_scene as check_scene,
)
from .recipes import RECIPE_SUFFIXES as RECIPE_SUFFIXES, write_recipe as write_recipe
from .spectral import write_spectral_frame as write_spectral_frame
from .value_bars import material_colours as material_colours, value_bars as value_bars
