# What other packages use of this one; lazy_loader and type checkers read it.
from .conversion import convert as convert
from .raycaster import Raycaster as Raycaster
