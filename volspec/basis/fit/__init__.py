"""Fitting bases: one file a method, the training set, what is minimised."""

from volspec.basis.fit.method import METHODS, fit_basis

__all__ = ["METHODS", "fit_basis"]
