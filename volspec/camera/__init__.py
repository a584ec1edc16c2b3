"""Cameras: rays of pixels, orbits around a volume, and where points are seen."""

from volspec.camera.camera import Camera

__all__ = ["Camera"]
