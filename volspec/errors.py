"""Every exception volspec raises: one hierarchy, so that one ``except`` can catch it.

``VolspecError`` splits in two: what the user gave (`InputError`, exit code 1 of the
command line, one line on stderr) and what the machine lacks (`DeviceError`). A message
says what it is about, what it got, what it expected, and the likely remedy; an error carries
the same as fields, so that programs need not parse English.
"""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable
from typing import Literal, Self, get_args

from volspec._deprecated import renamed

Code = Literal[
    "conflict",  # two things that were given contradict each other
    "damaged",  # a file's contents cannot be what they claim to be
    "duplicate",  # a name that is taken
    "impossible",  # no result exists, or none can be computed
    "missing",  # something needed was left out, or a list is empty
    "not-found",  # no such file or folder
    "range",  # a number out of range, or not finite
    "shape",  # an array's shape, or how many there are
    "size",  # more than memory, a format or a device holds
    "state",  # closed already, or changed meanwhile
    "syntax",  # a text that cannot be parsed
    "type",  # a value of another kind
    "unknown",  # a name of nothing
    "unsupported",  # valid, and not implemented or not installed
    "unwritable",  # an output that cannot be made
    "invalid",  # none of these
]
CODES: tuple[Code, ...] = get_args(Code)


class VolspecError(Exception):
    """Base of every exception raised on purpose by this package.

    Its text is one line, ``field: problem; remedy``. Left without a problem, it is what was
    given: ``field is given; remedy``.

    Parameters
    ----------
    problem : str
        The problem, and after its last ``"; "`` the remedy if that is not given apart.
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

    @classmethod
    def refused(cls, field: str, given: object, remedy: str, code: Code | None = None) -> Self:
        """Return the error of a value that cannot be used: ``field is given; remedy``."""
        return cls("", remedy, code=code, field=field, given=given)

    def __str__(self) -> str:
        if not self.problem and not self.field:
            return self.remedy
        if not self.problem:
            text = f"{self.field} is {quoted(self.given, 60)}"
        else:
            text = f"{self.field}: {self.problem}" if self.field else self.problem
        return f"{text}; {self.remedy}" if self.remedy else text

    def at(self, field: str) -> Self:
        """Return the same error about another field: the name that the user knows it by."""
        return type(self)(self.problem, self.remedy, code=self.code, field=field, given=self.given)

    def within(self, place: str, kind: type[VolspecError] | None = None) -> VolspecError:
        """Return the same error with a place before its field, of this or another class.

        >>> str(InputError.refused("D", 3.0, "give 0 to 1", "range").within("a.toml", SceneError))
        'a.toml: D is 3.0; give 0 to 1'
        """
        field = ": ".join(part for part in (place, self.field) if part)
        kind = kind or type(self)
        return kind(self.problem, self.remedy, code=self.code, field=field, given=self.given)


class VolspecWarning(UserWarning):
    """Base category of every warning issued by this package."""


class InputError(VolspecError, ValueError):
    """Something the user gave cannot be used; the message names it and the remedy."""


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
    """A palette is empty, contradicts itself, or asks for what no spectrum can do."""


class CameraError(InputError):
    """A camera is degenerate."""


class RaycastError(InputError):
    """A raycast setting is out of range."""


class ImageError(InputError):
    """A coefficient image's file is missing, damaged or of another version."""


class ViewingError(InputError):
    """A viewing condition, appearance model or light rig is out of range."""


class RelightError(InputError):
    """A relighter cannot do what is asked: it is closed, or the kind of frame is unknown."""


class SceneError(InputError):
    """A scene file is missing or wrong; the message names the field and its value."""


class CastCancelled(VolspecError):
    """A cast was ended by the one who asked for it; what was there before stays."""

    code = "state"


class LutCancelled(VolspecError):
    """A table of appearance was given up by the one who asked for it."""

    code = "state"


class DeviceError(VolspecError, RuntimeError):
    """The machine lacks something, or a driver refused."""


class OpenCLError(DeviceError):
    """No OpenCL device, or a kernel did not build; see ``volspec doctor``."""


class OpenGLError(DeviceError):
    """No GL context could be made; see ``volspec doctor``."""


# What a terminal obeys instead of showing it; and of that what joins letters of some scripts.
_UNSEEN, _JOINERS = ("Cc", "Cf", "Cs", "Zl", "Zp"), "\u200c\u200d"


def visible(text: str) -> str:
    """Text with its control characters and marks of direction escaped.

    >>> visible("a\\x1b[31m\\u202eb\\nc"), visible("größer 骨")
    ('a\\\\x1b[31m\\\\u202eb\\\\nc', 'größer 骨')
    """
    return "".join(
        c.encode("unicode_escape").decode()
        if unicodedata.category(c) in _UNSEEN and c not in _JOINERS
        else c
        for c in text
    )


def one_line(said: object) -> str:
    """A message that is one line, as `visible`; of an error that says nothing its class's name.

    >>> one_line(InputError("no such\\n  file")), one_line(MemoryError())
    ('no such file', 'MemoryError')
    """
    text = visible(" ".join(str(said).split()))
    return text or (type(said).__name__ if isinstance(said, BaseException) else "")


def quoted(given: object, most: int = 40) -> str:
    """Return the ``repr`` of a value for a message: in one line, shortened if it is long.

    >>> quoted("8"), quoted(["a\\n", 1.0]), quoted("x" * 99, 9)
    ("'8'", "['a\\\\n', 1.0]", "'xxxxxxx…")
    """
    if getattr(given, "shape", None) == ():  # a number of NumPy's
        given = given.item()  # type: ignore[attr-defined]
    text = " ".join(line.strip() for line in repr(given).splitlines())
    return text if len(text) <= most else f"{text[: most - 1]}…"


# Letters from which on a name may be the beginning of another; and the most that are compared,
# as time grows with their square.
_LEAST_BEGINNING, _LONGEST_NAME = 3, 200


def nearest(name: str, known: Iterable[str], count: int = 3) -> str:
    """Guess a misspelt name, in words that a message continues; ``""`` if no known name is near.

    Names that begin with the given one come first; one with a ``/`` is found by its last part, too.

    >>> nearest("d56", ["D50", "D65", "FL2"], count=2)
    "did you mean 'D65' or 'D50'? "
    >>> nearest("banana", ["PMC/Banana", "PMC/Carrot"])
    "did you mean 'PMC/Banana'? "
    >>> nearest("chart/white", ["chart/white 9.5 (.05 D)", "chart/black 2"], count=1)
    "did you mean 'chart/white 9.5 (.05 D)'? "
    >>> nearest("sunshine", ["D50", "D65", "FL2"])
    ''
    """
    words = tuple(known)
    folded = {word.rpartition("/")[2].casefold(): word for word in reversed(words)}
    folded |= {word.casefold(): word for word in reversed(words)}
    # Twice as many: a word may be hit whole and by its last part.
    given = str(name).casefold()[:_LONGEST_NAME]
    hits = difflib.get_close_matches(given, folded, n=2 * count, cutoff=0.5)
    if len(given) >= _LEAST_BEGINNING:
        hits = [*(word for word in folded if word.startswith(given)), *hits]
    guesses = tuple(repr(word) for word in dict.fromkeys(folded[hit] for hit in hits))[:count]
    if not guesses:
        return ""
    rest = ", ".join(guesses[:-1])
    return f"did you mean {rest} or {guesses[-1]}? " if rest else f"did you mean {guesses[-1]}? "


__getattr__ = renamed(__name__, {"TableCancelled": "LutCancelled"})
