# What other packages use of this one; lazy_loader and type checkers read it.
from .app import ViewerOptions as ViewerOptions, view as view
