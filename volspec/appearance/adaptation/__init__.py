"""Chromatic adaptation: XYZ under one white to the XYZ of equal appearance under another.

    ViewingConditions × 2 -> [adaptation] -> Passage -> host | shaders/relight.frag

Every transform is a function of source and target conditions that returns a `Passage`: ``apply``
goes from source to target, ``undo`` comes back, and the shader draws it as it is. Equations and
measured errors: docs/adaptation.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import wraps
from types import MappingProxyType

from numpy.typing import ArrayLike

from volspec.appearance.adaptation import fairchild, guth, nayatani, none, von_kries
from volspec.appearance.adaptation.base import Adaptation, Array, outside
from volspec.appearance.passages import Passage
from volspec.appearance.spec import ViewingConditions
from volspec.appearance.surround import require_conditions
from volspec.errors import ViewingError, nearest

__all__ = ["ADAPTATIONS", "Adaptation", "adapt", "adaptation", "outside"]


def _checked(name: str, passage: Adaptation) -> Adaptation:
    """The passage, which says what it got where it got no conditions."""

    @wraps(passage, assigned=("__doc__",))
    def between(source: ViewingConditions, target: ViewingConditions) -> Passage:
        require_conditions(f"{name}: source", source)
        require_conditions(f"{name}: target", target)
        return passage(source, target)

    return between


ADAPTATIONS: Mapping[str, Adaptation] = MappingProxyType(
    {
        name: _checked(name, passage)
        for family in (none, von_kries, nayatani, guth, fairchild)
        for name, passage in family.PASSAGES.items()
    }
)


def adaptation(name: str) -> Adaptation:
    """A chromatic adaptation by name.

    Parameters
    ----------
    name : str
        One of `ADAPTATIONS`.

    Returns
    -------
    function
        Of source and target `ViewingConditions`, which it refuses to be anything else; gives a
        `Passage`.

    Raises
    ------
    ViewingError
        If the name is unknown.

    Examples
    --------
    >>> adaptation("CAT2")
    Traceback (most recent call last):
    ...
    volspec.errors.ViewingError: adaptation is 'CAT2'; did you mean 'CAT02'...
    """
    if not (isinstance(name, str) and name in ADAPTATIONS):
        raise ViewingError.refused(
            "adaptation",
            name,
            f"{nearest(str(name), ADAPTATIONS)}known: {', '.join(ADAPTATIONS)}",
            "unknown",
        )
    return ADAPTATIONS[name]


def adapt(
    XYZ: ArrayLike,
    source: ViewingConditions,
    target: ViewingConditions,
    method: str = "CAT02",
) -> Array:
    """Corresponding colours: what looks the same under the target's white.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the source white's scale.
    source, target : ViewingConditions
    method : str
        One of `ADAPTATIONS`.

    Returns
    -------
    (..., 3) float64
        XYZ on the target white's scale; `outside` tells where a transform is not defined.

    Raises
    ------
    ViewingError
        If the method is unknown, or these are no `ViewingConditions`.
    ShapeError
        If they are no numbers, or the last axis is not 3.

    Examples
    --------
    White paper under tungsten, as daylight shows it:

    >>> tungsten = ViewingConditions((109.85, 100, 35.58), D=1)
    >>> daylight = ViewingConditions((95.05, 100, 108.88), D=1)
    >>> adapt([109.85, 100, 35.58], tungsten, daylight).round(2).tolist()
    [95.05, 100.0, 108.88]
    """
    return adaptation(method)(source, target).apply(XYZ)
