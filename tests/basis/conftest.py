"""Bases that several files test."""

import pytest

from volspec.basis import SpectralBasis


@pytest.fixture(scope="session")
def general() -> SpectralBasis:
    """The default basis."""
    return SpectralBasis.load("general-7")
