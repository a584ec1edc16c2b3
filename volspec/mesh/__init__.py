"""Surfaces of triangles: files, materials, textures, gratings, and their coefficient images."""
