"""Wizards: a scene's materials hidden, revealed, merged or kept, by a palette made from it."""

from volspec.wizard.asks import hide, keep, merge, reveal
from volspec.wizard.reached import Reached
from volspec.wizard.result import Redesigned
from volspec.wizard.writing import require_place

__all__ = ["Reached", "Redesigned", "hide", "keep", "merge", "require_place", "reveal"]
