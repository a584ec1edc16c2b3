"""Every exception that volspec raises: one hierarchy, so that one ``except`` catches them all.

``VolspecError`` has two branches: bad input (`InputError`, exit code 1 of the command line, one
line on stderr) and missing hardware or drivers (`DeviceError`). A message names its subject, the
given and the expected value, and the likely remedy; an error has the same as fields, so that
programs need not parse English.
"""

from __future__ import annotations

import copyreg
import difflib
import re
import unicodedata
from collections.abc import Iterable
from typing import Any, Literal, Self, get_args

Code = Literal[
    "conflict",  # two inputs contradict each other
    "damaged",  # a file's contents contradict its format
    "duplicate",  # a name is already taken
    "impossible",  # no result exists, or none can be computed
    "missing",  # something needed was left out, or a list is empty
    "not-found",  # no such file or folder
    "range",  # a number out of range, or not finite
    "shape",  # an array's shape, or the number of items
    "size",  # too large for memory, a format or a device
    "state",  # already closed, or changed meanwhile
    "syntax",  # a text that cannot be parsed
    "type",  # a value of the wrong kind
    "unknown",  # a name that does not exist
    "unsupported",  # valid, but not implemented or not installed
    "unreadable",  # an input that the user may not read
    "unwritable",  # an output that cannot be made
    "invalid",  # none of these
]
CODES: tuple[Code, ...] = get_args(Code)


class VolspecError(Exception):
    """Base of every exception raised on purpose by this package.

    The text is one line, ``field: problem; remedy``, or without a problem, ``field is given;
    remedy``.

    Parameters
    ----------
    problem : str
        The problem; if ``remedy`` is empty, the part after the last ``"; "`` is the remedy.
    remedy : str
        The action that helps.
    code : Code, optional
        The kind of problem, for programs; by default the class's.
    field : str
        The setting or parameter, as a path such as ``"viewing.D"`` or ``"lights[1].group"``.
    given : object
        The value that was refused.

    Examples
    --------
    >>> error = VolspecError.refused("viewing.D", 3.0, "give 0 to 1", "range")
    >>> str(error), error.code, error.given
    ('viewing.D is 3.0; give 0 to 1', 'range', 3.0)
    >>> VolspecError("a.nrrd: no such file; check the path").remedy
    'check the path'
    """

    code: Code = "invalid"

    def __init__(
        self,
        problem: str = "",
        remedy: str = "",
        *,
        code: Code | None = None,
        field: str = "",
        given: object = None,
    ) -> None:
        super().__init__(problem, remedy)
        if not remedy and "; " in problem:
            problem, _, remedy = problem.rpartition("; ")
        self.problem, self.remedy = problem, remedy
        self.code = self.code if code is None else code
        self.field, self.given = field, given

    def __reduce__(self) -> tuple[Any, ...]:
        # Without the constructor, whose parameters differ in subclasses.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    @classmethod
    def refused(cls, field: str, given: object, remedy: str, code: Code | None = None) -> Self:
        """Return the error for a value that cannot be used: ``field is given; remedy``."""
        return cls("", remedy, code=code, field=field, given=given)

    def __str__(self) -> str:
        if not self.problem and not self.field:
            return self.remedy
        if not self.problem:
            text = f"{self.field} is {quote(self.given, 60)}"
        else:
            text = f"{self.field}: {self.problem}" if self.field else self.problem
        return f"{text}; {self.remedy}" if self.remedy else text

    def at(self, field: str) -> Self:
        """Return the same error with another field, the name known to the user."""
        return type(self)(self.problem, self.remedy, code=self.code, field=field, given=self.given)

    def within(self, place: str, kind: type[VolspecError] | None = None) -> VolspecError:
        """Return the error with a place before its field, optionally as another class.

        >>> str(InputError.refused("D", 3.0, "give 0 to 1", "range").within("a.toml", SceneError))
        'a.toml: D is 3.0; give 0 to 1'
        >>> str(InputError.refused("raycast: step", 0, "give more", "range").within("[raycast]"))
        '[raycast]: step is 0; give more'
        """
        table = re.search(r"\[(\w+)\]$", place)
        name = self.field.removeprefix(f"{table[1]}: ") if table else self.field
        field = ": ".join(part for part in (place, name) if part)
        kind = kind or type(self)
        return kind(self.problem, self.remedy, code=self.code, field=field, given=self.given)


class VolspecWarning(UserWarning):
    """Base category of every warning issued by this package."""


class InputError(VolspecError, ValueError):
    """An input cannot be used; the message names it and the remedy."""


class ShapeError(InputError):
    """An array's shape does not fit."""

    code = "shape"


class VolumeError(InputError):
    """A volume's file, values or geometry cannot be used."""


class SpectrumError(InputError):
    """A light or a reflectance is unknown, malformed or does not cover the grid."""

    code = "range"


class BasisError(InputError):
    """A spectral basis cannot be fitted, or does not belong to the data at hand."""


class TransferError(InputError):
    """A transfer function is empty, out of range or names an unknown material."""


class PaletteError(InputError):
    """A palette is empty, contradicts itself, or has a target that no spectrum can reach."""


class CameraError(InputError):
    """A camera is degenerate."""


class RaycastError(InputError):
    """A raycast setting is out of range."""


class ImageError(InputError):
    """A coefficient image's file is missing, damaged or of another version."""


class ViewingError(InputError):
    """A viewing condition, appearance model or light rig is out of range."""


class RelightError(InputError):
    """A relighter is closed, or the kind of frame is unknown."""


class RoomError(InputError):
    """A room has an impossible size, reflectance or emission, or no paint looks as wanted in it."""

    code = "range"


class MeshError(InputError):
    """A mesh cannot be read, or has no triangle with an area, or materials that do not fit it."""

    code = "range"


class SceneError(InputError):
    """A scene file is missing or wrong; the message names the field and its value."""


class CastCancelled(VolspecError):
    """A cast was cancelled by its caller; earlier results stay."""

    code = "state"


class LutCancelled(VolspecError):
    """The computation of a colour LUT was cancelled by its caller."""

    code = "state"


class DeviceError(VolspecError, RuntimeError):
    """The machine lacks something, or a driver failed."""


class OpenCLError(DeviceError):
    """No OpenCL device, or a kernel did not build; see ``volspec doctor``."""


class OpenGLError(DeviceError):
    """No GL context could be made; see ``volspec doctor``."""


# Categories that a terminal interprets instead of showing; exempt: joiners of some scripts.
_UNSEEN, _JOINERS = ("Cc", "Cf", "Cs", "Zl", "Zp"), "\u200c\u200d"


def visible(text: str) -> str:
    """Return a text with control characters and direction marks escaped.

    >>> visible("a\\x1b[31m\\u202eb\\nc"), visible("größer 骨")
    ('a\\\\x1b[31m\\\\u202eb\\\\nc', 'größer 骨')
    """
    return "".join(
        c.encode("unicode_escape").decode()
        if unicodedata.category(c) in _UNSEEN and c not in _JOINERS
        else c
        for c in text
    )


def one_line(message: object) -> str:
    """Return a message as one `visible` line; for an error without text, its class name.

    >>> one_line(InputError("no such\\n  file")), one_line(MemoryError())
    ('no such file', 'MemoryError')
    """
    text = visible(" ".join(str(message).split()))
    return text or (type(message).__name__ if isinstance(message, BaseException) else "")


def quote(value: object, length: int = 40) -> str:
    """Return the ``repr`` of a value for a message: in one line, shortened if it is long.

    >>> quote("8"), quote(["a\\n", 1.0]), quote("x" * 99, 9)
    ("'8'", "['a\\\\n', 1.0]", "'xxxxxxx…")
    """
    if getattr(value, "shape", None) == ():  # a NumPy scalar
        value = value.item()  # type: ignore[attr-defined]  # object has none
    text = " ".join(line.strip() for line in repr(value).splitlines())
    return text if len(text) <= length else f"{text[: length - 1]}…"


# Fewest characters to match as the beginning of a name; and most characters to compare, as time
# grows with their square.
_MIN_BEGINNING, _MAX_NAME = 3, 200


def nearest(name: str, names: Iterable[str], count: int = 3) -> str:
    """Return "did you mean …? " for a misspelt name; ``""`` if no known name is similar.

    Names that begin with the given one come first; names with a ``/`` also match by the last part.

    >>> nearest("d56", ["D50", "D65", "FL2"], count=2)
    "did you mean 'D65' or 'D50'? "
    >>> nearest("banana", ["PMC/Banana", "PMC/Carrot"])
    "did you mean 'PMC/Banana'? "
    >>> nearest("chart/white", ["chart/white 9.5 (.05 D)", "chart/black 2"], count=1)
    "did you mean 'chart/white 9.5 (.05 D)'? "
    >>> nearest("sunshine", ["D50", "D65", "FL2"])
    ''
    """
    words = tuple(names)
    folded = {word.rpartition("/")[2].casefold(): word for word in reversed(words)}
    folded |= {word.casefold(): word for word in reversed(words)}
    # Twice as many: a name may match both as a whole and by its last part.
    start = str(name).casefold()[:_MAX_NAME]
    hits = difflib.get_close_matches(start, folded, n=2 * count, cutoff=0.5)
    if len(start) >= _MIN_BEGINNING:
        hits = [*(word for word in folded if word.startswith(start)), *hits]
    guesses = tuple(repr(word) for word in dict.fromkeys(folded[hit] for hit in hits))[:count]
    if not guesses:
        return ""
    head = ", ".join(guesses[:-1])
    return f"did you mean {head} or {guesses[-1]}? " if head else f"did you mean {guesses[-1]}? "
