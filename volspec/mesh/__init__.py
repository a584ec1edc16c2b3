"""Surfaces of triangles: files, materials, textures, gratings, and their coefficient images."""

from volspec.mesh.caster import MeshCaster, cast_meshes
from volspec.mesh.grating import Grating
from volspec.mesh.model import Mesh
from volspec.mesh.shapes import shape_mesh
from volspec.mesh.texture import Texture

__all__ = ["Grating", "Mesh", "MeshCaster", "Texture", "cast_meshes", "shape_mesh"]
