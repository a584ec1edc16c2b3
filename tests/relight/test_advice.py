"""Warnings of lights that a mode does not hold: once per light, with the mode that does."""

import warnings

import numpy as np
import pytest

from volspec.basis import MaterialBasis, SpectralBasis
from volspec.errors import VolspecWarning
from volspec.image import CoefficientImage
from volspec.pipeline import Relighter
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import light, reflectance

PLAIN = RelightSpec(mode="componentwise")


def image(basis: SpectralBasis | MaterialBasis) -> CoefficientImage:
    """Return a white pixel."""
    white, one = basis.white[None, None].astype(np.float32), np.ones((1, 1), np.float32)
    return CoefficientImage(white, one, one, basis)


def test_a_frame_warns_once_per_light_and_names_the_mode_that_is_better():
    with Relighter(image(SpectralBasis.load("general-7")), "numpy") as relighter:
        with pytest.warns(VolspecWarning, match=r"led:630: componentwise .* use the mode fitted"):
            relighter.frame(light("led:630"), PLAIN)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            relighter.frame(light("led:630"), PLAIN)
            relighter.frame(light("led:630"))
            relighter.frame(light("D65"), PLAIN)
            # A light that is off does not count.
            relighter.frame(LightRig((light("D65"), light("led:450")), (1.0, 0.0)), PLAIN)
        with pytest.warns(VolspecWarning, match="led:450"):
            relighter.frame(LightRig((light("D65"), light("led:450")), (1.0, 0.1)), PLAIN)


def test_materials_hold_every_light():
    basis = MaterialBasis({"gold": reflectance("gold")})
    with Relighter(image(basis), "numpy") as relighter, warnings.catch_warnings():
        warnings.simplefilter("error")
        relighter.frame(light("laser:532"), PLAIN)
