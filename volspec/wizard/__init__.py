"""Wizards: hide, reveal, merge or keep a scene's materials, or show it in another light."""

from volspec.wizard.operations import hide, keep, merge, reveal
from volspec.wizard.result import LightEvaluation, Redesigned, require_output
from volspec.wizard.telling import TellingLight, show_difference

__all__ = [
    "LightEvaluation",
    "Redesigned",
    "TellingLight",
    "hide",
    "keep",
    "merge",
    "require_output",
    "reveal",
    "show_difference",
]
