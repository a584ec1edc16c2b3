# What other packages use of this one; lazy_loader and type checkers read it.
from .caster import MeshCaster as MeshCaster
from .grating import Grating as Grating
from .model import Mesh as Mesh
from .shapes import Shape as Shape, shape_mesh as shape_mesh
from .texture import Texture as Texture, some_colours as some_colours
