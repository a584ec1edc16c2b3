"""Light groups of a picture: their shares of white, and their channels' names in a file."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping
from types import MappingProxyType
from urllib.parse import quote

import numpy as np

from volspec.errors import ImageError, quoted

ONE_GROUP: Mapping[str, float] = MappingProxyType({"light": 1.0})
"""The light groups and shares of an image whose lights are not steered apart."""
_SUM_ERROR = 1e-6  # of the shares
# Of a layer: Blender cuts off what is longer than 63 with the channel's own name behind it.
_LONGEST_NAME = 40


def checked_groups(groups: Mapping[str, float]) -> dict[str, float]:
    """Light groups as a dictionary of their own, each named and with its share."""
    if not (isinstance(groups, Mapping) and groups):
        raise ImageError.refused(
            "coefficient image: groups", groups, "give {name: share}, at least one", "range"
        )
    shares = {}
    for name, share in groups.items():
        if not (isinstance(name, str) and name.strip()):
            raise ImageError(f"coefficient image: a light group is named {name!r}; give a word")
        if isinstance(share, bool) or not isinstance(share, int | float | np.number):
            share = math.nan
        if not 0 <= share <= 1 + _SUM_ERROR:
            raise ImageError(
                f"coefficient image: light group {name!r} has share {quoted(groups[name])}; "
                "give a number of 0…1"
            )
        shares[name] = float(share)
    if abs(sum(shares.values()) - 1) > _SUM_ERROR:
        raise ImageError(
            f"coefficient image: the shares of light groups {', '.join(shares)} sum to "
            f"{sum(shares.values()):g}; they must sum to 1, as RaycastSpec.shares() does"
        )
    return shares


def channel_names(groups: Mapping[str, float], size: int) -> list[str]:
    """Names in the file, in the order of the channels: ``key.c00.V``, ``key.c01.V``, ….

    Nuke reads them as ``key_c00.V``; to Blender ``key`` is a layer, ``c00`` a pass of it and ``V``
    says that it is one number a pixel.

    >>> channel_names({"light": 1.0}, 2), channel_names({"3 é.": 0.5, "3_e": 0.5}, 1)
    (['light.c00.V', 'light.c01.V'], ['g3_e.c00.V', 'g3_e_2.c00.V'])
    """
    layers: list[str] = []
    taken: set[str] = set()
    for group in groups:
        plain, number = _plain_name(group), 2
        layer = plain
        while layer.casefold() in taken:
            layer, number = f"{plain}_{number}", number + 1
        taken.add(layer.casefold())
        layers.append(layer)
    return [f"{layer}.c{k:02d}.V" for layer in layers for k in range(size)]


def old_channel_names(groups: Mapping[str, float], size: int) -> list[str]:
    """As `channel_names`, in files of format 1 and 2."""
    layers = [f"{_encoded_name(group)}." for group in groups] if len(groups) > 1 else [""]
    return [f"{layer}coefficients.{k:02d}" for layer in layers for k in range(size)]


def _plain_name(group: str) -> str:
    """Letters, digits and _ alone, no digit first: what every compositor leaves as it is."""
    letters = unicodedata.normalize("NFKD", group).encode("ascii", "ignore").decode()
    plain = re.sub(r"[^A-Za-z0-9]+", "_", letters).strip("_")[:_LONGEST_NAME]
    return plain if plain[:1].isalpha() else f"g{plain}"


def _encoded_name(group: str) -> str:
    """Percent-encoded but for letters, digits, _ and -: a dot would part the layer in two."""
    return quote(group, safe="", errors="surrogatepass").replace(".", "%2E").replace("~", "%7E")
