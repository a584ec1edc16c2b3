"""Surfaces of triangles: files, materials, and their coefficient images."""

from volspec.mesh.caster import MeshCaster, cast_meshes
from volspec.mesh.model import Mesh

__all__ = ["Mesh", "MeshCaster", "cast_meshes"]
