"""High dynamic range: the PQ and HLG curves of BT.2100, and a display's luminances above white.

    display XYZ, cd/m² -> [hdr] -> code values -> PNG with cICP | AVIF

A picture's white is a surface; BT.2408 puts it at 203 cd/m². What is brighter, as a highlight or a
lamp, keeps its luminance up to the display's peak.

References
----------
[1] Recommendation ITU-R BT.2100-2 (2018): tables 4 (PQ, the curve of SMPTE ST 2084) and 5 (HLG).
[2] Report ITU-R BT.2408-7 (2023): HDR reference white, 203 cd/m², 58 % PQ, 75 % HLG.
[3] CTA-861.3-A (2015): MaxCLL and MaxFALL.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from volspec.appearance.display.monitors import Display
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.transforms import triples
from volspec.errors import ViewingError
from volspec.settings import Unit, settings

Array = NDArray[np.float64]

HdrTransfer = Literal["PQ", "HLG"]
HDR_TRANSFERS: tuple[HdrTransfer, ...] = get_args(HdrTransfer)
PQ_PEAK = 10_000.0
"""Luminance of PQ's code value 1, cd/m²."""
# Peaks for which BT.2100 gives HLG's system gamma [1, note 5f].
_HLG_PEAKS = (400.0, 2000.0)

# PQ: E' = ((c1 + c2 Y^m1) / (1 + c3 Y^m1))^m2.
_M1, PQ_POWER = 2610.0 / 16384.0, 2523.0 / 4096.0 * 128.0
_C1, _C2, _C3 = 3424.0 / 4096.0, 2413.0 / 4096.0 * 32.0, 2392.0 / 4096.0 * 32.0
# HLG: E' = √(3 E) up to 1/12, then a ln(12 E − b) + c.
_A = 0.17883277
_B, _C = 1.0 - 4.0 * _A, 0.5 - _A * np.log(4.0 * _A)
_LUMA = SPACES["Rec. 2020"].XYZ_from_RGB[1] / 100.0


def pq_encode(linear: ArrayLike, power: float = PQ_POWER) -> Array:
    """Return PQ's code values of luminances relative to `PQ_PEAK`, 0 at 0; odd about 0.

    The published curve leaves 7e-7 at 0, which is subtracted here. ``power`` is m2; ZCAM has
    another.

    >>> pq_encode(np.array([203.0, 1000.0]) / PQ_PEAK).round(4).tolist()
    [0.5807, 0.7518]
    """
    x = np.asarray(linear, dtype=np.float64)
    y = np.abs(x) ** _M1
    code = _C1**power * np.expm1(power * (np.log1p(_C2 / _C1 * y) - np.log1p(_C3 * y)))
    return np.asarray(np.copysign(code, x))


def pq_decode(code: ArrayLike, power: float = PQ_POWER) -> Array:
    """Return luminances relative to `PQ_PEAK`: the inverse of `pq_encode`; NaN past its pole."""
    x = np.asarray(code, dtype=np.float64)
    rise = np.expm1(np.log1p(np.abs(x) / _C1**power) / power)
    under = _C2 / _C1 - _C3 * (1.0 + rise)
    y = rise / np.where(under > 0.0, under, np.nan)
    return np.asarray(np.copysign(y ** (1.0 / _M1), x))


def hlg_encode(scene: ArrayLike) -> Array:
    """Return HLG's code values of scene light, 0 to 1 [1, OETF].

    >>> hlg_encode([0.0, 1 / 12, 1.0]).round(4).tolist()
    [0.0, 0.5, 1.0]
    """
    E = np.asarray(scene, dtype=np.float64)
    above = _A * np.log(np.maximum(12.0 * E - _B, 1e-9)) + _C
    return np.where(E <= 1.0 / 12.0, np.sqrt(3.0 * np.maximum(E, 0.0)), above)


def hlg_decode(code: ArrayLike) -> Array:
    """Return scene light of HLG's code values: the inverse of `hlg_encode`."""
    x = np.asarray(code, dtype=np.float64)
    return np.where(x <= 0.5, x**2 / 3.0, (np.exp((x - _C) / _A) + _B) / 12.0)


class ContentLight:
    """Luminances of a picture [3]: its greatest, and the mean of its pixels' greatest, cd/m²."""

    def __init__(self, hdr: Hdr) -> None:
        self._hdr = hdr
        self.most_cd_m2 = self._sum = 0.0
        self._pixels = 0

    def add(self, codes: NDArray[Any]) -> None:
        """Add pixels (..., 3) of 16 bits."""
        greatest = self._hdr.luminances(codes / 65535.0).max(axis=-1)
        self.most_cd_m2 = max(self.most_cd_m2, float(greatest.max(initial=0.0)))
        self._sum += float(greatest.sum())
        self._pixels += greatest.size

    @property
    def mean_cd_m2(self) -> float:
        """The mean; 0 without any pixel."""
        return self._sum / max(self._pixels, 1)


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class Hdr:
    """A display of high dynamic range and the curve of its signal, in Rec. 2100's primaries.

    Examples
    --------
    White and a highlight of ten times its luminance, which the peak cuts:

    >>> white = SPACES["Rec. 2020"].white_XYZ
    >>> Hdr("PQ").codes(np.stack([white, 10 * white]))[:, 1].round(4).tolist()
    [0.5807, 0.7518]
    """

    transfer: HdrTransfer = "PQ"
    """PQ: codes are luminances; HLG: codes are relative to the display's peak."""
    white_cd_m2: Annotated[float, Field(gt=0, le=PQ_PEAK), Unit("cd/m²")] = 203.0
    """Luminance at which the picture's white is shown; BT.2408 recommends 203."""
    peak_cd_m2: Annotated[float, Field(gt=0, le=PQ_PEAK), Unit("cd/m²")] = 1000.0
    """Largest luminance of a red, green and blue together; what is brighter is dimmed to it."""

    def __post_init__(self) -> None:
        if self.peak_cd_m2 < self.white_cd_m2:
            raise ViewingError.refused(
                "peak_cd_m2",
                self.peak_cd_m2,
                f"give at least the white's {self.white_cd_m2:g}",
                "range",
            )
        low, high = _HLG_PEAKS
        if self.transfer == "HLG" and not low <= self.peak_cd_m2 <= high:
            raise ViewingError.refused(
                "peak_cd_m2", self.peak_cd_m2, f"HLG is for {low:g} to {high:g}; use PQ", "range"
            )

    @property
    def headroom(self) -> float:
        """Peak over white."""
        return self.peak_cd_m2 / self.white_cd_m2

    def display(self, display: Display) -> Display:
        """Return a display in the same room with these primaries and this white."""
        return replace(display, space="Rec. 2020", white_cd_m2=self.white_cd_m2)

    def codes(self, XYZ: ArrayLike) -> Array:
        """Return the code values, 0 to 1, of (..., 3) display XYZ, Y = 100 for white."""
        linear = triples("hdr.XYZ", XYZ) @ SPACES["Rec. 2020"].RGB_from_XYZ.T
        linear = np.maximum(np.nan_to_num(linear, nan=0.0), 0.0)
        # At constant chromaticity, so that a bright red does not become yellow.
        maximum = linear.max(axis=-1, keepdims=True)
        linear *= self.headroom / np.maximum(maximum, self.headroom)
        if self.transfer == "PQ":
            return pq_encode(linear * (self.white_cd_m2 / PQ_PEAK))
        relative = linear / self.headroom
        Y = relative @ _LUMA
        gain = np.where(Y > 0.0, Y, 1.0) ** ((1.0 - self._system_gamma) / self._system_gamma)
        scene = relative * gain[..., None]
        # The signal's end dims what is both saturated and bright.
        return hlg_encode(scene / np.maximum(scene.max(axis=-1, keepdims=True), 1.0))

    def luminances(self, codes: ArrayLike) -> Array:
        """Return (..., 3) luminances of red, green and blue, cd/m²: the inverse of `codes`."""
        signal = triples("hdr.codes", codes)
        if self.transfer == "PQ":
            return pq_decode(signal) * PQ_PEAK
        scene = hlg_decode(signal)
        Y = scene @ _LUMA
        return scene * (self.peak_cd_m2 * Y[..., None] ** (self._system_gamma - 1.0))

    def mastering_display(self) -> tuple[NDArray[np.int_], int]:
        """Return (4, 2) x, y of its red, green, blue and white, and its peak.

        In the units of files: 0.00002 and 0.0001 cd/m².
        """
        space = SPACES["Rec. 2020"]
        xy = np.rint(np.array([*space.primaries_xy, space.white_xy]) * 50_000.0)
        return xy.astype(int), round(self.peak_cd_m2 * 10_000.0)

    @property
    def _system_gamma(self) -> float:
        """γ of HLG's OOTF [1, note 5f]."""
        return 1.2 + 0.42 * float(np.log10(self.peak_cd_m2 / 1000.0))
