"""Named viewing conditions: numbers of their sources, and that models take them."""

import math

import pytest

from tests.support.errors import raises
from volspec.appearance import Display
from volspec.appearance.models.cam import CamConditions
from volspec.appearance.presets import PRESETS, preset
from volspec.appearance.spaces import SPACES
from volspec.errors import ViewingError


def test_srgb_is_the_default_display():
    assert preset("sRGB").display() == Display()


def test_numbers_are_those_of_the_sources():
    # SMPTE ST 431-1; Moroney et al. 2002, table 1; ISO 3664 P1, as the errata of Neumann have it.
    assert preset("cinema").white_luminance == 48.0
    assert preset("dim room").L_A == 20.0
    assert pytest.approx(0.2 * preset("projector").white_luminance) == preset("projector").L_A
    assert preset("light booth").white_luminance == pytest.approx(636.62, abs=5e-3)
    assert pytest.approx(40.0 / math.pi) == preset("sRGB office").L_A


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_says_where_each_number_comes_from_and_can_be_used(name):
    given = PRESETS[name]
    assert given.name == name
    assert all(given.sources)
    assert hash(given) == hash(PRESETS[name])
    assert given.space in ("", *SPACES)
    assert given.white_luminance > given.L_A
    CamConditions.of_viewing(given.display().conditions)
    seen = CamConditions.of_viewing(given.conditions((96.42, 100.0, 82.49)))
    assert seen.L_A == given.L_A


def test_surrounds_darken_from_office_to_cinema():
    c = [preset(name).display().conditions.factors.c for name in ("sRGB", "dim room", "cinema")]
    assert c == sorted(c, reverse=True)


@pytest.mark.parametrize(("name", "guess"), [("cinma", "'cinema'"), ("x", "sRGB"), ("", "sRGB")])
def test_an_unknown_name_gives_the_nearest(name, guess):
    with raises(ViewingError, "unknown") as caught:
        preset(name)
    assert guess in caught.value.remedy
