"""Light distributions of luminaires: IES LM-63 (``.ies``) and EULUMDAT (``.ldt``) files.

    FILE.ies, FILE.ldt -> [beam] -> PointLamp -> direct light

Type C photometry: the vertical angle gamma is 0 along the lamp's aim, 180° away from it; the
horizontal angle C turns about the aim. Between its angles a distribution is linear; outside of the
vertical angles that were measured it is dark.

References
----------
[1] ANSI/IES LM-63-19, "IES Standard File Format for the Electronic Transfer of Photometric Data".
[2] Stockmar (1990), "EULUMDAT - ein Leuchtendatenformat für den europäischen
    Beleuchtungsplaner", Licht 90.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import Code, RoomError, quote
from volspec.spectra.files import decoded_text, read_number

Array = NDArray[np.float64]
_DOWN = np.array([0.0, 0.0, -1.0])
_PHOTOMETRY = {2: "B", 3: "A"}
# Planes that a symmetry implies for one at C: (sign, degrees) gives sign C + degrees.
_MIRRORED = {
    "none": ((1, 0),),
    "one plane": ((1, 0), (-1, 0)),
    "two planes": ((1, 0), (-1, 0), (1, 180), (-1, 180)),
    "C90": ((1, 0), (-1, 180)),
}
_ROUND_DEG = 6  # decimals of angles that are compared
# EULUMDAT has so many lines before the lamps, in each set of lamps, and of ratios after them.
_LDT_HEAD, _LDT_LAMPS, _LDT_RATIOS = 26, 6, 10


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """Luminous intensity by direction, and its place in the room.

    Parameters
    ----------
    vertical_deg : (V,) array
        Increasing, within 0 to 180; 0 is the aim.
    horizontal_deg : (H,) array
        Increasing from 0 to 360, both included; 0 is +x for a lamp that aims down, 90 +y.
    candela : (H, V) array
        0 or more, not all 0; the first and last rows are equal.
    lumen : float
        Luminous flux by the file; 0 if it does not say.
    aim : (x, y, z)
        Direction of gamma 0.
    turn_deg : float
        Turn about the aim, counter-clockwise seen against it.
    """

    vertical_deg: Array
    horizontal_deg: Array
    candela: Array
    lumen: float = 0.0
    aim: tuple[float, float, float] = (0.0, 0.0, -1.0)
    turn_deg: float = 0.0

    def aimed(self, aim: Sequence[float], turn_deg: float = 0.0) -> Beam:
        """Return the beam in another direction."""
        x, y, z = np.asarray(aim, np.float64) / np.linalg.norm(aim)
        return replace(self, aim=(float(x), float(y), float(z)), turn_deg=turn_deg)

    @property
    def integral(self) -> float:
        """The integral of the intensity over the sphere, exactly: candela times steradians."""
        gamma = np.radians(self.vertical_deg)
        # Over C the mean of two planes, over gamma the integral of (a + b gamma) sin gamma.
        widths = np.radians(np.diff(self.horizontal_deg))[:, None]
        over_c = (0.5 * widths * (self.candela[1:] + self.candela[:-1])).sum(axis=0)
        if len(gamma) == 1:
            return 0.0
        slope = np.diff(over_c) / np.diff(gamma)
        parts = -np.diff(over_c * np.cos(gamma)) + slope * np.diff(np.sin(gamma))
        return float(parts.sum())

    def relative(self, directions: ArrayLike) -> Array:
        """Return the intensity (K,) along directions (K, 3) from the lamp; its mean is 1."""
        local = np.asarray(directions, np.float64) @ self._axes()
        length = np.maximum(np.linalg.norm(local, axis=1), 1e-300)
        gamma = np.degrees(np.arccos(np.clip(-local[:, 2] / length, -1.0, 1.0)))
        c = np.degrees(np.arctan2(local[:, 1], local[:, 0])) % 360.0
        intensity = np.zeros(len(gamma))
        # Rounding must not darken the aim itself.
        low, high = self.vertical_deg[0] - 1e-9, self.vertical_deg[-1] + 1e-9
        inside = np.flatnonzero((gamma >= low) & (gamma <= high))
        row, across = _between(self.horizontal_deg, c[inside])
        column, down = _between(self.vertical_deg, gamma[inside])
        for i, weight in ((row, 1.0 - across), (row + 1, across)):
            intensity[inside] += weight * (
                (1.0 - down) * self.candela[i, column] + down * self.candela[i, column + 1]
            )
        return np.asarray(intensity * (4.0 * np.pi / self.integral))

    def _axes(self) -> Array:
        """Return columns: the directions of C 0, C 90, and against the aim, in the room."""
        aim = np.asarray(self.aim)
        axis, cosine = np.cross(_DOWN, aim), float(_DOWN @ aim)
        if cosine < -1.0 + 1e-12:
            turned = np.diag([1.0, -1.0, -1.0])
        else:  # the smallest turn from down to the aim
            x, y, z = axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            turned = np.eye(3) + cross + cross @ cross / (1.0 + cosine)
        s, c = np.sin(np.radians(self.turn_deg)), np.cos(np.radians(self.turn_deg))
        return np.asarray(turned @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _between(knots: Array, values: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the interval of each value, and the place in it from 0 to 1."""
    index = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    return index, np.clip((values - knots[index]) / (knots[index + 1] - knots[index]), 0.0, 1.0)


def read_beam(path: str | os.PathLike[str]) -> Beam:
    """Read a luminaire's light distribution, ``.ies`` or ``.ldt``.

    Raises
    ------
    RoomError
        If the file is of another format, of type A or B photometry or with TILT, or is damaged;
        names the file, the thing and its value.
    SpectrumError
        If it cannot be read.
    """
    name = os.fspath(path)
    suffix = Path(name).suffix.lower()
    if suffix not in _READERS:
        raise RoomError(
            f"{name}: is no light distribution",
            f"give {' or '.join(_READERS)} (IES LM-63, EULUMDAT)",
            code="unsupported",
            field="beam",
            given=name,
        )
    with np.errstate(over="ignore", invalid="ignore"):
        beam = _READERS[suffix](_Words(name), decoded_text(name))
        total = beam.integral
    if not 0 < total < np.inf:
        raise _beam_fault(name, f"its intensity sums to {total:g}", "export it again", "damaged")
    return beam


def _beam_fault(
    name: str, problem: str, remedy: str, code: Code, given: object = None
) -> RoomError:
    return RoomError(f"{name}: {problem}", remedy, code=code, field="beam", given=given)


class _Words:
    """Numbers of a file, taken one after the other."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._words: list[str] = []
        self._next = 0

    def fill(self, words: Sequence[str]) -> None:
        """Begin with other words."""
        self._words, self._next = list(words), 0

    def take(self, quantity: str, minimum: float = 0.0) -> float:
        """Return the next number, of ``minimum`` or more."""
        return float(self.array(quantity, 1, minimum)[0])

    def integer(self, quantity: str, minimum: int = 1) -> int:
        """Return the next number, a count."""
        value = self.take(quantity, minimum)
        if value != int(value):
            raise self._bad(quantity, f"{value:g}")
        return int(value)

    def array(self, quantity: str, count: int, minimum: float = 0.0) -> Array:
        """Return the next numbers, all of ``minimum`` or more."""
        words = self._words[self._next : self._next + count]
        if len(words) < count:
            raise _beam_fault(
                self.path,
                f"has {len(words)} of {count} numbers of {quantity}",
                "it is cut off, export it again",
                "damaged",
                len(words),
            )
        self._next += count
        numbers = np.empty(count)
        for k, word in enumerate(words):
            try:
                numbers[k] = read_number(word)
            except ValueError:
                raise self._bad(quantity, word) from None
            if not minimum <= numbers[k] < np.inf:
                raise self._bad(quantity, word, "range")
        return numbers

    def _bad(self, quantity: str, word: str, code: Code = "syntax") -> RoomError:
        return _beam_fault(
            self.path, f"{quantity} is {quote(word)}", "correct it, or export it again", code, word
        )


def _beam(path: str, gamma: Array, c: Array, candela: Array, symmetry: str) -> Beam:
    """Return a beam with the planes that a symmetry implies."""
    for plane, angles in (("vertical", gamma), ("horizontal", c)):
        if not (np.diff(angles) > 0).all():
            k = int(np.argmin(np.diff(angles) > 0))
            raise _beam_fault(
                path,
                f"{plane} angles {angles[k]:g} and {angles[k + 1]:g} do not increase",
                "export it again",
                "damaged",
                float(angles[k + 1]),
            )
    if len(gamma) < 2 or gamma[-1] > 180.0:
        raise _beam_fault(
            path,
            f"its vertical angles are {gamma[0]:g} to {gamma[-1]:g}°",
            "expected two or more of 0 to 180°",
            "range",
            float(gamma[-1]),
        )
    if symmetry == "axis":
        return Beam(gamma, np.array([0.0, 360.0]), candela[[0, 0]])
    planes: dict[float, Array] = {}
    for sign, turn in _MIRRORED[symmetry]:
        for angle, row in zip(c.tolist(), candela, strict=True):
            planes.setdefault(round(sign * angle + turn, _ROUND_DEG) % 360.0, row)
    order = sorted(planes)
    if order[0] != 0.0:
        raise _beam_fault(
            path, f"its horizontal angles begin at {order[0]:g}°", "expected 0", "range", order[0]
        )
    rows = np.array([planes[angle] for angle in (*order, 0.0)])
    return Beam(gamma, np.array([*order, 360.0]), rows)


def _read_ies(words: _Words, text: str) -> Beam:
    path, lines = words.path, text.splitlines()
    tilts = [(k, line) for k, line in enumerate(lines) if re.match(r"\s*TILT\s*=", line, re.I)]
    if not tilts:
        raise _beam_fault(path, "has no line TILT=", "give an IES LM-63 file", "damaged")
    start, line = tilts[0]
    tilt = line.partition("=")[2].strip()
    if tilt.upper() != "NONE":
        raise _beam_fault(
            path, f"TILT is {quote(tilt)}", "give a file with TILT=NONE", "unsupported", tilt
        )
    words.fill(re.split(r"[\s,]+", "\n".join(lines[start + 1 :]).strip()))
    words.take("the number of lamps")
    words.take("the lumens per lamp", -1.0)
    scale = words.take("the candela multiplier")
    count, planes = (words.integer(f"the number of {axis} angles") for axis in _ANGLES)
    photometry = words.integer("the photometric type")
    if photometry != 1:
        kind = _PHOTOMETRY.get(photometry, str(photometry))
        raise _beam_fault(
            path, f"its photometry is of type {kind}", "convert it to type C", "unsupported", kind
        )
    words.array("the units and size", 4, -np.inf)
    scale *= words.take("the ballast factor")
    factor = words.take("the ballast-lamp photometric factor")
    if not re.search(r"LM-63-(2002|20[1-9]\d)", lines[0]):
        scale *= factor  # later editions use this place for other things
    words.take("the input watts")
    gamma, c = (
        words.array(f"{axis} angles", n) for axis, n in zip(_ANGLES, (count, planes), strict=True)
    )
    candela = words.array("candela", count * planes).reshape(planes, count) * scale
    last = float(c[-1])
    symmetry = {0.0: "axis", 90.0: "two planes", 180.0: "one plane"}.get(last, "none")
    if c[0] != 0.0 or (symmetry == "none" and not 180.0 < last <= 360.0):
        raise _beam_fault(
            path,
            f"its horizontal angles are {c[0]:g} to {last:g}°",
            "expected 0, or 0 to 90, 180 or 360",
            "unsupported",
            last,
        )
    beam = _beam(path, gamma, c, candela, symmetry)
    return replace(beam, lumen=beam.integral)


_ANGLES = ("vertical", "horizontal")


def _read_ldt(words: _Words, text: str) -> Beam:
    path, lines = words.path, [line.strip() for line in text.splitlines()]
    if len(lines) < _LDT_HEAD + _LDT_LAMPS + _LDT_RATIOS:
        raise _beam_fault(
            path, f"has {len(lines)} lines", "give a EULUMDAT file, in full", "damaged", len(lines)
        )
    # Programs in many countries write decimal commas.
    numbers = [line.replace(",", ".") for line in lines]
    words.fill([*numbers[2:4], numbers[5], numbers[23], numbers[25]])
    symmetry = words.integer("the symmetry (Isym)", 0)
    planes, count = (
        words.integer("the number of C-planes (Mc)"),
        words.integer("the number of angles (Ng)"),
    )
    scale = words.take("the conversion factor for intensities") or 1.0
    sets = words.integer("the number of sets of lamps")
    if symmetry not in _LDT_PLANES:
        remedy = "give a file with Isym 0 to 4"
        raise _beam_fault(path, f"the symmetry (Isym) is {symmetry}", remedy, "unknown", symmetry)
    kind, part = _LDT_PLANES[symmetry]
    after = _LDT_HEAD + sets * _LDT_LAMPS
    words.fill(numbers[_LDT_HEAD + 2 : after : _LDT_LAMPS])
    flux = words.take("the luminous flux of the lamps")
    words.fill([word for line in numbers[after + _LDT_RATIOS :] for word in line.split()])
    c, gamma = words.array("C-planes", planes), words.array("angles", count)
    columns = part(planes)
    candela = words.array("cd/klm", len(columns) * count).reshape(len(columns), count) * scale
    angles = c[np.array(columns) % planes] + 360.0 * (np.array(columns) >= planes)
    beam = _beam(path, gamma, angles, candela, kind)
    return replace(beam, lumen=beam.integral * flux / 1000.0)


_LDT_PLANES: dict[int, tuple[str, Callable[[int], range]]] = {
    0: ("none", range),
    1: ("axis", lambda planes: range(1)),
    2: ("one plane", lambda planes: range(planes // 2 + 1)),
    3: ("C90", lambda planes: range(3 * planes // 4, 3 * planes // 4 + planes // 2 + 1)),
    4: ("two planes", lambda planes: range(planes // 4 + 1)),
}
"""Symmetry, and indices of the planes in the file of so many, by Isym."""
_READERS = {".ies": _read_ies, ".ldt": _read_ldt}
