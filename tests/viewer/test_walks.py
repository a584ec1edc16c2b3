"""Random edits, undo, other documents, sizes and time steps, none of them waited for.

At rest the window's picture is what writers write and what a fresh start shows.
"""

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    rule,
    run_state_machine_as_test,
)

from tests.viewer._edits import MODULES, Drawn, drawn
from tests.viewer.test_history import TEXTS
from tools.writers import BARS, DOCUMENTS, SIZE, Studio, opened, studio, tried, without_panels

pytestmark = [
    pytest.mark.not_quick,
    pytest.mark.filterwarnings("default::volspec.errors.VolspecWarning"),
]

NAMES = sorted(DOCUMENTS)
WRITERS = "S", "copied", "fresh start", "export", "film", "session"
WAITS = st.sampled_from((0, 1, 1, 3, 8))
# One viewer for all walks of this process, as it takes half a second to start.
_OPEN: dict[str, Any] = {}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with studio(tmp_path_factory.mktemp("walks")) as (made, paths):
        _OPEN.update(studio=made, paths=paths)
        yield made
    _OPEN.clear()


class Walk(RuleBasedStateMachine):
    """The viewer, to which anything is done while it works."""

    def __init__(self) -> None:
        super().__init__()
        self.studio: Studio = _OPEN["studio"]
        self.paths: dict[str, Path] = _OPEN["paths"]
        self.viewer = self.studio.viewer

    def cycles(self, count: int) -> None:
        for _ in range(count):
            self.viewer.cycle()

    @initialize(name=st.sampled_from(NAMES))
    def begin(self, name: str) -> None:
        opened(self.studio, self.paths[name])

    @rule(edit=drawn(TEXTS, *MODULES), wait=WAITS)
    def edit(self, edit: Drawn, wait: int) -> None:
        self.viewer.edit(edit)
        self.cycles(wait)

    @rule(back=st.booleans(), wait=WAITS)
    def step(self, back: bool, wait: int) -> None:
        self.viewer.step(back)
        self.cycles(wait)

    @rule(name=st.sampled_from(NAMES), wait=WAITS)
    def open(self, name: str, wait: int) -> None:
        self.viewer.app._file_commands.documents.open(str(self.paths[name]))
        self.cycles(wait)

    @rule(width=st.sampled_from((64, 80, 90)), height=st.sampled_from((48, 60)), wait=WAITS)
    def resize(self, width: int, height: int, wait: int) -> None:
        self.viewer.resize((width, height + BARS))
        self.cycles(wait)

    @rule(wait=WAITS)
    def play(self, wait: int) -> None:
        self.viewer.run("play")
        self.cycles(wait)

    def teardown(self) -> None:
        viewer = self.viewer
        viewer.cycle()
        if viewer.app._steps.playing:
            viewer.run("play")
        viewer.resize((SIZE[0], SIZE[1] + BARS))
        viewer.edit(without_panels)
        viewer.rest()
        cells = tried(self.studio, viewer.state, WRITERS)
        wrong = {name: cell for name, cell in cells.items() if not cell.agrees}
        assert not wrong, wrong


@pytest.mark.parametrize(
    ("walks", "steps"), [(5, 12), pytest.param(60, 30, marks=pytest.mark.slow)]
)
def test_what_is_shown_at_rest_is_what_is_written(desk, walks, steps):
    walks = int(os.environ.get("WALKS", walks))
    run_state_machine_as_test(
        Walk,
        settings=settings(
            max_examples=walks,
            stateful_step_count=steps,
            derandomize="WALKS" not in os.environ,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
