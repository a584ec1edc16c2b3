"""Each setting of the viewer is in the window's picture as in every picture that is written."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.browser import chromium, missing
from tests.support.fixtures import slow
from tools.writers import (
    CONTEXTS,
    EDITS,
    NOT_IN_PICTURES,
    WRITERS,
    Studio,
    applied,
    chain,
    opened,
    paths_of,
    studio,
    tried,
)
from volspec.errors import VolspecError
from volspec.viewer.model import opacities
from volspec.viewer.model.state import ViewState

pytestmark = [
    pytest.mark.not_quick,
    pytest.mark.filterwarnings("default::volspec.errors.VolspecWarning"),
]
GROUPS = 7
# Models whose colour table takes seconds.
_TABLES = "relight.viewing.hunt", "relight.viewing.nayatani"


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Studio, dict[str, Path]]]:
    with studio(tmp_path_factory.mktemp("writers")) as made:
        yield made


@pytest.fixture(scope="module")
def paged(desk: tuple[Studio, dict[str, Path]]) -> Iterator[tuple[Studio, dict[str, Path]]]:
    """The same, with a browser in which pages are opened."""
    if why := missing():
        pytest.skip(why)
    made, paths = desk
    with chromium() as browser:
        yield replace(made, page=browser.new_page()), paths


def base_state(desk: tuple[Studio, dict[str, Path]]) -> ViewState:
    made, paths = desk
    return opened(made, paths["curve"])


def check(desk: tuple[Studio, dict[str, Path]], context: str, names: Sequence[str]) -> None:
    """Check settings, all at once, in a context."""
    made, paths = desk
    document, before = CONTEXTS[context]
    base = applied(before, opened(made, paths[document]))
    writers = ("S", "page") if made.page else [name for name in WRITERS if name != "page"]
    cells = tried(made, applied(chain(*(EDITS[name] for name in names)), base), writers)
    wrong = {name: cell for name, cell in cells.items() if not cell.agrees}
    assert not wrong, f"{context}: {names}"
    assert cells["S"].codes is not None, f"{context}: {names} cannot be cast"


def grouped(state: ViewState) -> list[list[str]]:
    """Return the settings in groups that a state can have at once."""
    groups: list[list[str]] = [[] for _ in range(GROUPS)]
    states = [state] * GROUPS
    for number, (name, edit) in enumerate(EDITS.items()):
        if name in _TABLES:
            continue
        for place in (*range(number % GROUPS, GROUPS), *range(number % GROUPS)):
            with suppress(VolspecError):
                states[place] = applied(edit, states[place])
                groups[place].append(name)
                break
        else:
            raise AssertionError(f"{name} goes with no group")
    return groups


def test_a_field_of_the_state_is_tried_or_not_in_pictures(state):
    named = {*EDITS, *NOT_IN_PICTURES}
    assert {path for path in paths_of(state) if path not in named} == set()


@pytest.mark.parametrize("group", range(GROUPS))
def test_many_settings_at_once_are_one_picture(desk, group):
    check(desk, "a curve", grouped(base_state(desk))[group])


def test_a_faded_material_is_cut_as_it_is_saved(desk):
    """Once nothing moves: layers that were cast without the fade are 12 codes off at the cut."""
    made, _ = desk
    base = base_state(desk)
    cut = applied(EDITS["depth.near_mm"], base)
    for scale in (0.35, 0.0, 0.5):
        cells = tried(made, opacities.set_opacity(cut, "grey", scale), ("S", "copied", "export"))
        assert all(cell.agrees for cell in cells.values()), (scale, cells)


def test_several_fields_refuse_projections_in_a_line(desk):
    made, paths = desk
    state = opened(made, paths["two fields"])
    for command in ("projection-maximum", "preintegration"):
        made.viewer.run(command)
        made.viewer.rest()
        assert made.viewer.state.shading == state.shading
        assert "several fields" in made.viewer.message


@pytest.mark.parametrize("kind", ["regions", "surfaces"])
def test_several_fields_refuse_other_kinds_in_a_line(desk, kind):
    made, paths = desk
    state = opened(made, paths["two fields"])
    made.viewer.run(f"transfer-{kind}")
    made.viewer.rest()
    assert made.viewer.state.transfer is state.transfer
    assert "cast alone; remove the other fields" in made.viewer.message


def test_a_picture_without_a_scene_s_lens_says_so_when_it_opens(desk):
    made, paths = desk
    text = paths["curve"].read_text(encoding="utf-8")
    path = paths["curve"].with_name("parallel.toml")
    text += "[raycast]\nlayers = 4\n[camera]\northographic = true\n[depth]\nfocus_mm = 20\n"
    path.write_text(text, encoding="utf-8")
    made.viewer.open(path)
    assert any("focus" in each.text for each in made.viewer.app._notice.messages)


@pytest.mark.parametrize("group", [0, *map(slow, range(1, GROUPS))])
def test_many_settings_at_once_are_in_a_page(paged, group):
    names = grouped(base_state(paged))[group]
    # A page has few digits: a colour at the gamut's border is marked or not, and exposure is 3.
    names = [name for name in names if not name.endswith((".mark", ".gamut"))]
    check(paged, "a curve", names)


@pytest.mark.slow
@pytest.mark.parametrize("context", CONTEXTS)
def test_a_setting_is_one_picture_in_each_context(desk, context):
    """All of them in all contexts: python -m tools.writers."""
    made, paths = desk
    document, before = CONTEXTS[context]
    base = applied(before, opened(made, paths[document]))
    for name in [*EDITS][[*CONTEXTS].index(context) :: len(CONTEXTS)]:
        try:
            applied(EDITS[name], base)
        except VolspecError:  # there is no such state
            continue
        check(desk, context, [name])


@pytest.mark.slow
def test_each_setting_shows(desk):
    made, paths = desk
    base = opened(made, paths["curve"])
    plain = made.viewer.pixels()
    for name, edit in EDITS.items():
        if name == "annotations":  # over the picture
            continue
        tried(made, applied(edit, base), ())
        assert abs(made.viewer.pixels() - plain).max() > 2, name
