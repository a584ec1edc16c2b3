"""Spectral bases: N bands to m channels in which light times surface is componentwise."""

from volspec.basis.model import SpectralBasis
from volspec.basis.report import BasisReport, ErrorSummary, WorstPair

__all__ = ["BasisReport", "ErrorSummary", "SpectralBasis", "WorstPair"]
