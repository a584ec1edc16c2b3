"""What a few letters mean: rows whose text has them, the best first.

letters, rows -> [finding] -> command palette, library of materials
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

Row = TypeVar("Row")
# Letters of a word stand within so many times its length.
_LOOSE = 3


def found(rows: Sequence[Row], search: str, text: Callable[[Row], str]) -> list[Row]:
    """Those whose text has the letters of every word in order; the best first, else as given."""
    words = search.casefold().split()
    if not words:
        return list(rows)
    rated = [(_rating(words, text(row).casefold()), row) for row in rows]
    kept = [(rating, row) for rating, row in rated if rating is not None]
    return [row for _, row in sorted(kept, key=lambda pair: -pair[0])]


def _rating(words: Sequence[str], text: str) -> float | None:
    """How well words fit; None where one is not there."""
    total = 0.0
    for word in words:
        at = text.find(word)
        starts = at == 0 or (at > 0 and not text[at - 1].isalnum())
        if f" {word}" in f" {text}" or starts:
            total += 4.0
        elif at > 0:
            total += 2.0
        elif (spread := _spread(word, text)) and spread <= _LOOSE * len(word):
            total += len(word) / spread
        else:
            return None
    return total


def _spread(word: str, text: str) -> int | None:
    """Over how many letters a word is strewn; None where it is not in the text."""
    at, first = -1, -1
    for letter in word:
        at = text.find(letter, at + 1)
        if at < 0:
            return None
        first = at if first < 0 else first
    return at - first + 1
