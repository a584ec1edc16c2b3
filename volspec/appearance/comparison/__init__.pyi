# What other packages use of this one; lazy_loader and type checkers read it.
from .difference import (
    Difference as Difference,
    SYMBOLS as SYMBOLS,
    distance as distance,
    uniform as uniform,
)
from .rendition import (
    FARTHEST as FARTHEST,
    HUE_BINS as HUE_BINS,
    LightFigures as LightFigures,
    Metamerism as Metamerism,
    RENDITION_GRID as RENDITION_GRID,
    Rendition as Rendition,
    hue_colours as hue_colours,
    light_figures as light_figures,
    metamerism as metamerism,
    rendition_reference as rendition_reference,
)
