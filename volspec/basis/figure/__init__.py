"""A basis in one picture: its sensors, its errors light by light, its worst colours."""

from volspec.basis.figure.draw import basis_figure, save_figure

__all__ = ["basis_figure", "save_figure"]
