"""Slices at positions in the world: their order, and the lattice they make.

    readers -> [lattice] -> world_from_index

Slices shifted within their plane, as a tilted gantry takes them, make a sheared lattice: the
affine map says so, nothing is resampled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolumeError
from volspec.volume.files.query import Query

# Of the usual distance: a wider gap or a narrower one is no jitter, slices lack or are of another
# stack.
_WIDE, _NARROW = 1.5, 0.5
# Of a slice's distance: headers round positions to a tenth of a millimetre or finer.
_JITTER = 0.1
# Of the mean distance of neighbours.
_SAME_PLACE = 0.01


def affine(columns: ArrayLike, origin: ArrayLike) -> NDArray[np.float64]:
    """(4, 4) map from voxel index to millimetres.

    >>> affine(np.diag([1, 1, 2]), (5, 6, 7))[2].tolist()
    [0.0, 0.0, 2.0, 7.0]
    """
    world = np.eye(4)
    world[:3, :3] = columns
    world[:3, 3] = origin
    return world


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where slices of one orientation lie.

    Parameters
    ----------
    at_mm : (N, 3) float64
        Centre of each slice's first voxel.
    normal : (3,) float64
        Of all of them; unit length.
    """

    at_mm: NDArray[np.float64]
    normal: NDArray[np.float64]

    @property
    def along_mm(self) -> NDArray[np.float64]:
        """(N,) how far along the normal."""
        return self.at_mm @ self.normal

    def stacks(self) -> list[list[int]]:
        """Slices by place, along the normal: lists of the indices of those that share one.

        Slices of one place keep their order.

        >>> at = np.array([[0, 0, 2.5], [0, 0, 0], [0, 0, 2.5], [0, 0, 0]])
        >>> Places(at, np.array([0, 0, 1.0])).stacks()
        [[1, 3], [0, 2]]
        """
        along = self.along_mm
        order = np.argsort(along, kind="stable")
        apart = np.diff(along[order], prepend=along[order[0]])
        least = _SAME_PLACE * float(np.ptp(along)) / max(len(order) - 1, 1)
        found: list[list[int]] = []
        for index, gap in zip(order.tolist(), apart, strict=True):
            if found and gap <= least:
                found[-1].append(index)
            else:
                found.append([index])
        return [sorted(stack) for stack in found]


def step_mm(at_mm: NDArray[np.float64], names: list[str], query: Query) -> NDArray[np.float64]:
    """From each slice to the next.

    Parameters
    ----------
    at_mm : (N, 3) float64
        Positions in the order of the slices.
    names : list of str
        Their files; used in messages.
    query : Query
        A spacing that it gives takes uneven slices for even.

    Returns
    -------
    (3,) float64
        Of an even lattice through the first slice and the last.

    Raises
    ------
    VolumeError
        If slices are missing, or belong to another stack.
    """
    step: NDArray[np.float64] = (at_mm[-1] - at_mm[0]) / (len(at_mm) - 1)
    if query.spacing_mm is not None:
        return step
    apart = np.linalg.norm(np.diff(at_mm, axis=0), axis=1)
    usual = float(np.median(apart))
    odd = int(np.argmax(np.maximum(apart / usual, usual / apart)))
    if not _NARROW * usual <= apart[odd] <= _WIDE * usual:
        what = "slices are missing" if apart[odd] > usual else "they are no even stack"
        raise VolumeError(
            f"{query.path}: {names[odd]} and {names[odd + 1]} lie {apart[odd]:.4g} mm apart, "
            f"others {usual:.4g} mm: {what}; complete the folder, or take the slices for even with "
            f"{query.name}?spacing=x,y,z"
        )
    return step


def unevenness(at_mm: NDArray[np.float64]) -> str:
    """What to say of slices that lie off their even places; nothing where it cannot be seen."""
    even = np.linspace(at_mm[0], at_mm[-1], len(at_mm))
    off = float(np.linalg.norm(at_mm - even, axis=1).max())
    step = float(np.linalg.norm(even[1] - even[0]))
    if off <= _JITTER * step:
        return ""
    return f"slices lie up to {off:.3g} mm off even places {step:.4g} mm apart, and are shown there"
