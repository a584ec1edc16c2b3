"""Light groups of a picture: their shares of white, and their channels' names in a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from urllib.parse import quote

import numpy as np

from volspec.errors import ImageError, quoted

ONE_GROUP: Mapping[str, float] = MappingProxyType({"light": 1.0})
"""The light groups and shares of an image whose lights are not steered apart."""
_SUM_ERROR = 1e-6  # of the shares
_LONGEST_NAME = 200  # of a layer; OpenEXR cuts a channel's name off at 255


def checked_groups(groups: Mapping[str, float]) -> dict[str, float]:
    """Light groups as a dictionary of their own, each named and with its share."""
    if not (isinstance(groups, Mapping) and groups):
        raise ImageError(
            f"coefficient image: groups is {quoted(groups, 60)}; give {{name: share}}, at least one"
        )
    shares = {}
    for name, share in groups.items():
        if not (isinstance(name, str) and name.strip()):
            raise ImageError(f"coefficient image: a light group is named {name!r}; give a word")
        if (length := len(_layer_name(name))) > _LONGEST_NAME:
            raise ImageError(
                f"coefficient image: light group {name[:20] + '…'!r} has a name of {length} "
                f"characters in a file, at most {_LONGEST_NAME} fit; shorten it"
            )
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
    """Names in the file, in the order of the channels; one group needs no layer name."""
    layers = [f"{_layer_name(group)}." for group in groups] if len(groups) > 1 else [""]
    return [f"{layer}coefficients.{k:02d}" for layer in layers for k in range(size)]


def _layer_name(group: str) -> str:
    """Percent-encoded but for letters, digits, _ and -: a dot would part the layer in two."""
    return quote(group, safe="", errors="surrogatepass").replace(".", "%2E").replace("~", "%7E")
