# What other packages use of this one; lazy_loader and type checkers read it.
from .app import Options as Options, view as view
