"""Spectral bases: map N bands to m channels that multiply componentwise, light by surface."""

from volspec.basis.display import MODES
from volspec.basis.materials import Basis, MaterialBasis, basis_from_dict, load_basis
from volspec.basis.model import SpectralBasis
from volspec.basis.report import BasisReport, ErrorSummary, WorstPair

__all__ = [
    "MODES",
    "Basis",
    "BasisReport",
    "ErrorSummary",
    "MaterialBasis",
    "SpectralBasis",
    "WorstPair",
    "basis_from_dict",
    "load_basis",
]
