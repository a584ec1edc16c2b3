"""Wizards: hide, reveal, merge or keep a scene's materials by a palette made from it."""

from volspec.wizard.operations import hide, keep, merge, reveal
from volspec.wizard.result import LightEvaluation, Redesigned, require_output

__all__ = ["LightEvaluation", "Redesigned", "hide", "keep", "merge", "require_output", "reveal"]
