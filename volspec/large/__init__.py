"""Volumes of any size: levels of detail cast part by part, on one machine or a cluster."""

from volspec.large.raycaster import Raycaster

__all__ = ["Raycaster"]
