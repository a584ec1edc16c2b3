"""Fitting bases: one file a method, the training set, what is minimised."""

from volspec.basis.fit.method import METHODS, fit_basis
from volspec.basis.fit.training import training_set

__all__ = ["METHODS", "fit_basis", "training_set"]
