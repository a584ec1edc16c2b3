"""The light volume: how much of each source's light arrives, on a coarse grid of nodes.

    volume -> transfer -> [light volume] -> raycast -> relight

Absorption is flat (grey), so that what arrives needs no spectrum and pictures stay relightable.
"""

from volspec.raycast.light_volume.spec import LightGrid, LightLayer, light_layers

__all__ = ["LightGrid", "LightLayer", "light_layers"]
