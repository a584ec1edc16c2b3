"""What Python objects complain of, in the words of a scene's file: keys in place of fields.

message -> [wording] -> SceneError
"""

from __future__ import annotations

import re
from collections.abc import Sequence

# Of a name that stands for itself, and is no value in quotes nor a part of a path.
_ALONE = r"(?<![\w'\"./\\])"
# A field, and not the rest of a file's name, as messages begin with: "Display.icc: no such file".
_FIELD = r"(?=\w+\b(?!:|/|\\|\.\w))"


def before_field(*owners: str) -> str:
    """A pattern of a class and the dot between it and one of its fields."""
    return rf"{_ALONE}(?:{'|'.join(owners)})\.{_FIELD}"


_KEYS = (
    (before_field("Viewing"), ""),
    (before_field("Display"), "display."),
    (before_field("Transfer"), "display.space.transfer."),
    (rf"{_ALONE}Transfer(?=:)", "display.space.transfer"),
    (r"^(?:LightRig|relight): ", ""),
    (r"\bor None for\b", "or leave it out for"),
    (r"\bNone takes it\b", "left out, it is taken"),
    (r"adapting='picture'", 'adapting = "picture"'),
    (r"model='none'", 'model = "none"'),
    (r"\bas a ColourSpace\b", "as a table of its numbers"),
    (r"\bcast with MaterialBasis\(materials\)", 'cast it with [basis] method = "materials"'),
    (
        r"those of a MaterialBasis are materials; take a SpectralBasis",
        'those of [basis] method = "materials" are materials; take another method',
    ),
)


def in_keys(said: str) -> str:
    """A message of a spec with the keys that a scene's file has.

    >>> in_keys("Viewing.D is 3.0; expected 0 to 1, or None for the model's own")
    "D is 3.0; expected 0 to 1, or leave it out for the model's own"
    >>> in_keys("Display.icc: no such file; check the path")
    'Display.icc: no such file; check the path'
    """
    return reworded(said, _KEYS)


def reworded(said: str, words: Sequence[tuple[str, str]]) -> str:
    """A message with other words.

    Parameters
    ----------
    said : str
    words : sequence of (pattern, str)
        Regular expressions and what stands in their place, tried in turn.
    """
    for pattern, word in words:
        said = re.sub(pattern, word, said)
    return said
