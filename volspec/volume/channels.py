"""Channels of a microscope's file: what it says of them, such as colours and wavelengths.

    OME-XML, omero, ImageJ -> [channels] -> Volume.channel

References
----------
[1] OME-XML 2016-06, Channel: Color is a signed 32-bit number of red, green, blue and alpha;
    wavelengths are nanometres unless a unit is given.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

MAX_FIELDS = 8
"""Most fields, and so channels, that a cast takes."""
Limits = tuple[float, float]
ALL = "all"
"""Value of ``channel=`` for all channels, as fields of one volume."""
_NM = {"nm": 1.0, "µm": 1e3, "um": 1e3, "mm": 1e6, "m": 1e9, "Å": 0.1, "pm": 1e-3}


@dataclass(frozen=True, slots=True)
class Channel:
    """Statements of a file on a channel; any may be unknown."""

    name: str = ""
    colour: tuple[float, float, float] | None = None  # sRGB codes, 0 to 1
    excitation_nm: float | None = None
    emission_nm: float | None = None
    limits: Limits | None = None  # values that are shown black and full

    def on_log_scale(self) -> Channel:
        """Return the channel with the logarithms of its limits, if they have some."""
        if self.limits is None or self.limits[0] <= 0:
            return replace(self, limits=None)
        low, high = self.limits
        return replace(self, limits=(math.log10(low), math.log10(high)))

    @classmethod
    def of_ome(cls, attributes: Mapping[str, str]) -> Channel:
        """Return that of an OME-XML ``Channel``.

        >>> gfp = Channel.of_ome({"Name": "GFP", "Color": "16711935", "EmissionWavelength": "509"})
        >>> gfp.name, gfp.colour, gfp.emission_nm
        ('GFP', (0.0, 1.0, 0.0), 509.0)
        """
        colour = None
        if (number := _number(attributes.get("Color"))) is not None:
            rgba = int(number) & 0xFFFFFFFF
            colour = (rgba >> 24) / 255, (rgba >> 16 & 255) / 255, (rgba >> 8 & 255) / 255
        excitation_nm, emission_nm = (
            _nanometres(
                attributes.get(f"{kind}Wavelength"), attributes.get(f"{kind}WavelengthUnit", "nm")
            )
            for kind in ("Excitation", "Emission")
        )
        return cls(attributes.get("Name", ""), colour, excitation_nm, emission_nm)

    @classmethod
    def of_omero(cls, channel: Mapping[str, Any]) -> Channel:
        """Return that of an ``omero`` channel of OME-Zarr.

        >>> window = {"start": 5, "end": 9}
        >>> dapi = Channel.of_omero({"label": "DAPI", "color": "0000FF", "window": window})
        >>> dapi.name, dapi.colour, dapi.limits
        ('DAPI', (0.0, 0.0, 1.0), (5.0, 9.0))
        """
        colour, limits = None, None
        if digits := re.fullmatch(r"#?([0-9a-fA-F]{6})", str(channel.get("color", ""))):
            r, g, b = bytes.fromhex(digits[1])
            colour = r / 255, g / 255, b / 255
        window = channel.get("window")
        if isinstance(window, Mapping):
            limits = _limits(window.get("start"), window.get("end"))
        return cls(str(channel.get("label", "")), colour, limits=limits)


def channels_of_imagej(metadata: Mapping[str, Any], count: int) -> list[Channel]:
    """Return the channels of ImageJ's metadata: ``LUTs``, ``Ranges`` and the first ``Labels``."""
    luts, ranges = metadata.get("LUTs") or [], metadata.get("Ranges") or []
    channels = []
    for k in range(count):
        colour, limits = None, None
        if k < len(luts) and len(luts[k]) == 3:
            r, g, b = (float(lut[-1]) / 255 for lut in luts[k])
            colour = r, g, b
        if 2 * k + 1 < len(ranges):
            limits = _limits(ranges[2 * k], ranges[2 * k + 1])
        channels.append(Channel("", colour, limits=limits))
    return channels


def unique_titles(names: Sequence[str]) -> list[str]:
    """Return names that differ, by numbers after those that repeat.

    >>> unique_titles(["DAPI", "GFP", "GFP"])
    ['DAPI', 'GFP', 'GFP 2']
    """
    titles: list[str] = []
    for name in names:
        number, other = 1, name
        while other in titles:
            number += 1
            other = f"{name} {number}"
        titles.append(other)
    return titles


def _nanometres(text: str | None, unit: str) -> float | None:
    """Return a wavelength if it can be one of light."""
    length, per_unit = _number(text), _NM.get(unit)
    if length is None or per_unit is None or not 100 <= length * per_unit <= 2000:
        return None
    return length * per_unit


def _number(text: object) -> float | None:
    try:
        return float(str(text))
    except ValueError:
        return None


def _limits(low: object, high: object) -> Limits | None:
    ends = _number(low), _number(high)
    if ends[0] is None or ends[1] is None or not ends[0] < ends[1]:
        return None
    return ends[0], ends[1]
