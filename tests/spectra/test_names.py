"""Old names of spectra and bases answer for one version, with a warning."""

from __future__ import annotations

import pytest

import volspec
import volspec.spectra as spectra
from volspec.basis import MaterialBasis, SpectralBasis


@pytest.mark.parametrize(
    ("home", "old", "new"),
    [
        (volspec, "reflectance_of", "reflectance_from_colour"),
        (volspec, "reflectances_of", "reflectances_from_colours"),
        (spectra, "XYZ_of", "XYZ_from_spectra"),
        (spectra, "color_matching_functions", "colour_matching_functions"),
        (SpectralBasis, "analyze", "analyse"),
        (SpectralBasis, "color_matrix", "colour_matrix"),
        (MaterialBasis, "synthesize", "synthesise"),
        (MaterialBasis, "channels_of", "channels_for_materials"),
    ],
)
def test_old_names_answer_with_a_warning(home: object, old: str, new: str) -> None:
    with pytest.warns(DeprecationWarning) as caught:
        assert getattr(home, old) == getattr(home, new)
    assert new in str(caught[0].message)
