"""What the raycaster reads of a transfer function: tables, free of spectra and materials.

    volume -> [transfer] -> raycast -> relight -> appearance

Every entry mixes K rows of channels by shares. The raycaster gathers the K shares and turns
them into M channels once per pixel, so that a cast costs the same for any M.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import TransferError

# What the kernel's tables and a file's header can hold at ease.
MAX_CHANNELS = 32
MAX_SURFACES = 8
MAX_LABEL = 65535


def entries(wanted: float, limits: tuple[int, int]) -> int:
    """How many entries a table gets: a power of two of at least ``wanted``, within limits.

    Examples
    --------
    >>> entries(3000, (1024, 65536)), entries(3000, (64, 256))
    (4096, 256)
    """
    low, high = limits
    return int(np.clip(2.0 ** np.ceil(np.log2(np.clip(wanted, low, high))), low, high))


@dataclass(frozen=True, slots=True, eq=False)
class TransferTable:
    """A transfer function over values, or over values and gradients.

    Parameters
    ----------
    domain : (float, float)
        Values of the first and the last entry; other values take the nearest end.
    opacity : (N,) or (G, N)
        Opacity per reference step, 0…1.
    shares : (N, K) or (G, N, K)
        How much of each of the K rows of ``channels`` is reflected; not premultiplied.
    reference_step_mm : float
        Length over which ``opacity`` holds.
    white : (M,), optional
        Channels of the perfect diffuser, to which a highlight adds; ones when left out.
    channels : (K, M), optional
        Channels of what is mixed; the identity when left out, shares then are channels.
    gradient_top : float, optional
        Gradient magnitude, value per millimetre, of the last of G rows; the first is for 0.
    filters : (N, M), optional
        Spectral absorption: channels of what passes an entry of opacity 1, so that a reference
        step lets 1 − opacity (1 − filter) through. 0, grey, when left out.
    labels : bool
        Entry i is for label i; nothing lies between two entries.

    Raises
    ------
    TransferError
        If the arrays do not belong together or a number is out of range.
    """

    domain: tuple[float, float]
    opacity: NDArray[np.float64]
    shares: NDArray[np.float64]
    reference_step_mm: float
    # None is only how the caller leaves them out: both are always set after __post_init__.
    white: NDArray[np.float64] = None  # type: ignore[assignment]
    channels: NDArray[np.float64] = None  # type: ignore[assignment]
    gradient_top: float | None = None
    filters: NDArray[np.float64] | None = None
    labels: bool = False

    def __post_init__(self) -> None:
        low, high = self.domain
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise TransferError.refused(
                "transfer table: the domain", self.domain, "give two that rise"
            )
        opacity, shares = _taken(self, "opacity"), _taken(self, "shares")
        two = self.gradient_top is not None
        if opacity.ndim != 1 + two or min(opacity.shape) < 2:
            raise TransferError(
                f"transfer table: opacity has shape {opacity.shape}; expected (N,), or (G, N) "
                "with gradient_top, of 2 or more"
            )
        _check_range("transfer table: opacity", opacity)
        if shares.ndim != opacity.ndim + 1 or shares.shape[:-1] != opacity.shape:
            raise TransferError(
                f"transfer table: shares have shape {shares.shape}, opacity {opacity.shape}; "
                f"expected {(*opacity.shape, 'K')}"
            )
        if not (math.isfinite(self.reference_step_mm) and self.reference_step_mm > 0):
            raise TransferError(f"transfer table: reference step {self.reference_step_mm} mm")
        if self.gradient_top is not None and not (
            math.isfinite(self.gradient_top) and self.gradient_top > 0
        ):
            raise TransferError.refused(
                "transfer table: gradient_top", self.gradient_top, "give > 0"
            )
        M = _take_channels(self)
        if self.labels and (two or (low, high) != (0, len(opacity) - 1)):
            raise TransferError(
                f"transfer table: labels have domain {self.domain} and opacity of shape "
                f"{opacity.shape}; expected (0, N - 1) and (N,)"
            )
        if self.filters is not None:
            filters = _taken(self, "filters")
            if filters.shape != (opacity.shape[-1], M) or two or self.labels:
                raise TransferError(
                    f"transfer table: filters have shape {filters.shape}; expected "
                    f"{(opacity.shape[-1], M)}, over values alone"
                )
            _check_range("transfer table: filters", filters)

    @property
    def size(self) -> int:
        """M, the channels of the picture."""
        return self.channels.shape[1]

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """(…, M) the reflectance's channels at every entry, not premultiplied."""
        return self.shares @ self.channels

    @property
    def entries_per_value(self) -> float:
        """Table entries per unit of value.

        Raises
        ------
        TransferError
            If the domain is too short for float32.
        """
        low, high = self.domain
        scale = (self.opacity.shape[-1] - 1) / (high - low)
        if scale > np.finfo(np.float32).max:
            raise TransferError(
                f"transfer function: spans {high - low:g}, too little for float32; multiply the "
                "volume's values"
            )
        return scale

    def step_opacity(self, step_mm: float) -> NDArray[np.float64]:
        """Opacity of one step: 1 − (1 − opacity)^(step / reference step), METHOD §3."""
        return 1 - (1 - self.opacity) ** (step_mm / self.reference_step_mm)

    def step_transmittance(self, step_mm: float) -> NDArray[np.float64]:
        """(N, M) what one step lets through, channel by channel, with ``filters``."""
        filters = 0.0 if self.filters is None else self.filters
        passed = 1 - self.opacity[:, None] * (1 - filters)
        return passed ** (step_mm / self.reference_step_mm)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTable:
    """Isosurfaces: what a ray meets where the value passes one of S levels.

    Parameters
    ----------
    values : (S,)
        Levels, rising.
    opacity : (S,)
        Of a surface itself, 0…1; 1 ends the ray.
    shares : (S, K)
    channels : (K, M), optional
    white : (M,), optional
        As `TransferTable`.
    """

    values: NDArray[np.float64]
    opacity: NDArray[np.float64]
    shares: NDArray[np.float64]
    # As in TransferTable: both are always set after __post_init__.
    channels: NDArray[np.float64] = None  # type: ignore[assignment]
    white: NDArray[np.float64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        values, opacity = _taken(self, "values"), _taken(self, "opacity")
        shares = _taken(self, "shares")
        if values.ndim != 1 or not 1 <= len(values) <= MAX_SURFACES or (np.diff(values) <= 0).any():
            raise TransferError(
                f"surface table: values are {values.tolist()!r:.60}; give 1 to {MAX_SURFACES} "
                "that rise"
            )
        count = len(values)
        if opacity.shape != (count,) or shares.ndim != 2 or len(shares) != count:
            raise TransferError(
                f"surface table: opacity has shape {opacity.shape}, shares {shares.shape}; "
                f"expected ({count},) and ({count}, K)"
            )
        _check_range("surface table: opacity", opacity)
        _take_channels(self)

    @property
    def size(self) -> int:
        """M, the channels of the picture."""
        return self.channels.shape[1]


def _taken(table: TransferTable | SurfaceTable, name: str) -> NDArray[np.float64]:
    """A field as float64, kept as such."""
    array = np.asarray(getattr(table, name), dtype=np.float64)
    if not np.isfinite(array).all():
        raise TransferError(f"{_who(table)}: {name} holds NaN or infinite numbers")
    object.__setattr__(table, name, array)
    return array


def _take_channels(table: TransferTable | SurfaceTable) -> int:
    """Fill in and check ``channels`` and ``white``; M."""
    K = table.shares.shape[-1]
    if table.channels is None:
        object.__setattr__(table, "channels", np.eye(K))
    channels = _taken(table, "channels")
    if channels.ndim != 2 or len(channels) != K:
        raise TransferError(
            f"{_who(table)}: channels have shape {channels.shape}; expected ({K}, M), a row a share"
        )
    M = channels.shape[1]
    if table.white is None:
        object.__setattr__(table, "white", np.ones(M))
    if _taken(table, "white").shape != (M,):
        raise TransferError(f"{_who(table)}: white has shape {table.white.shape}; expected ({M},)")
    return M


def _check_range(what: str, array: NDArray[np.float64]) -> None:
    if not ((array >= 0) & (array <= 1)).all():
        raise TransferError(f"{what} must be 0…1")


def _who(table: TransferTable | SurfaceTable) -> str:
    return "transfer table" if isinstance(table, TransferTable) else "surface table"
