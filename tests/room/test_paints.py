"""Sets of paints and their mixtures."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises, warns
from volspec.errors import InputError
from volspec.room import mix_paints, paint_set
from volspec.room.paints import absorption_from_reflectance, reflectance_from_absorption
from volspec.spectra import DEFAULT_GRID, reflectance, reflectance_set
from volspec.spectra.library.reflectances import reflectance_set_names


def test_a_set_has_the_library_s_names_and_values():
    found = paint_set(["test"])
    assert tuple(each.name for each in found) == reflectance_set_names("test")
    assert np.array([each.values for each in found]) == pytest.approx(reflectance_set("test"))


def test_parts_of_the_library_and_single_paints_are_joined_without_repetitions():
    found = paint_set(["ColorChecker", "colorchecker/blue", "grey:0.5", "white*0.5+black*0.5"])
    names = [each.name for each in found]
    assert len(names) == 26 and names[-2:] == ["grey:0.5", "white*0.5+black*0.5"]
    assert names.count("ColorChecker/blue") == 1


def test_an_atlas_has_a_paint_in_each_column(tmp_path):
    rows = "".join(f"{nm},{0.2 + nm / 1e4},0.6\n" for nm in range(375, 786, 5))
    (tmp_path / "atlas.csv").write_text("nm,warm,2\n" + rows)
    found = paint_set(["atlas.csv"], folder=tmp_path)
    assert [each.name for each in found] == ["atlas#warm", "atlas#2"]
    assert found[0].values == pytest.approx(0.2 + DEFAULT_GRID.wavelengths_nm / 1e4)
    (one,) = paint_set(["atlas.csv#2"], folder=tmp_path)
    assert one.values == pytest.approx(0.6)


def test_an_atlas_that_ends_early_warns_once(tmp_path):
    rows = "".join(f"{nm},0.3,0.4,0.5\n" for nm in range(400, 691, 10))
    (tmp_path / "atlas.csv").write_text("nm,a,b,c\n" + rows)
    with warns():
        paint_set([str(tmp_path / "atlas.csv")])


def test_kubelka_munk_s_layer_has_its_published_values():
    """R = 0.5 has K/S = 0.25; R = 0.1 has 4.05; the inverse returns them."""
    assert absorption_from_reflectance([0.5, 0.1]) == pytest.approx([0.25, 4.05])
    assert reflectance_from_absorption([0.25, 4.05, 0.0]) == pytest.approx([0.5, 0.1, 1.0])


def test_mixtures_have_all_shares_of_a_step():
    paints = [reflectance(name) for name in ("grey:0.8", "ColorChecker/blue", "ColorChecker/red")]
    found = mix_paints(paints, 0.25)
    assert len(found) == 15 and len({each.name for each in found}) == 15
    by_name = {each.name: each.values for each in found}
    for paint in paints:
        assert np.array_equal(by_name[paint.name], paint.values)
    values = by_name["25 % grey:0.8 + 75 % ColorChecker/blue"]
    own = absorption_from_reflectance([paint.values for paint in paints[:2]])
    assert absorption_from_reflectance(values) == pytest.approx(0.25 * own[0] + 0.75 * own[1])


def test_additive_mixtures_are_means_and_brighter_than_stirred_ones():
    paints = [reflectance("grey:0.8"), reflectance("ColorChecker/blue")]
    dots, stirred = (mix_paints(paints, 0.5, law)[1] for law in ("additive", "km"))
    assert dots.values == pytest.approx((paints[0].values + paints[1].values) / 2)
    assert (stirred.values < dots.values).all()


def test_mixtures_of_a_black_without_any_reflection_are_finite():
    found = mix_paints([reflectance("black"), reflectance("grey:0.9")], 1 / 3)
    assert np.isfinite([each.values for each in found]).all()
    assert not found[0].values.any() and 0 < found[1].values[0] < found[2].values[0] < 0.01


def read(folder: Path, text: str) -> object:
    (folder / "atlas.csv").write_text(text)
    return paint_set(["atlas.csv"], folder=folder)


def mix(*given: Any, count: int = 24) -> object:
    return mix_paints(paint_set(["ColorChecker"])[:count], *given)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda _: paint_set(["natral"]), "unknown paint_set"),
        (lambda folder: paint_set(["nothere.csv"], folder=folder), "not-found"),
        (lambda folder: read(folder, ""), "missing"),
        (lambda folder: read(folder, "nm,a,a\n400,0.1,0.2\n700,0.1,0.2\n"), "duplicate"),
        (lambda folder: read(folder, "nm,a\n400,10\n700,20\n"), "range"),
        (lambda _: mix(0.5, count=1), "missing"),
        *((lambda _, s=s: mix(s), "range step") for s in (0.0, 0.3, 1.0, -0.5, float("nan"))),
        (lambda _: mix(0.1), "size step"),
        (lambda _: mix(0.5, "oil"), "unknown law"),
    ],
)
def test_wrong_sets_and_impossible_mixtures_are_refused(tmp_path, call, expected):
    with raises(InputError, *expected.split()):
        call(tmp_path)
