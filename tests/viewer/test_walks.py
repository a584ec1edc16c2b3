"""Random edits, undo, other documents, sizes and time steps, none of them waited for.

At rest the window's picture is what writers write and what a fresh start shows.
"""

import os
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import ClassVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from hypothesis.stateful import run_state_machine_as_test as run_walks

from tests.viewer._edits import MODULES, Drawn, drawn
from tests.viewer.test_history import TEXTS
from tools.writers import BARS, DOCUMENTS, SIZE, Studio, opened, studio, tried, without_panels
from volspec.viewer.model.commands import COMMANDS as ALL
from volspec.viewer.ui.inputs import Input

pytestmark = [
    pytest.mark.not_quick,
    pytest.mark.filterwarnings("default::volspec.errors.VolspecWarning"),
]

NAMES = sorted(DOCUMENTS)
WRITERS = "S", "copied", "fresh start", "export", "film", "session"
WAITS = st.sampled_from((0, 1, 1, 3, 8))
PLACES = st.tuples(st.integers(0, SIZE[0]), st.integers(0, SIZE[1] + BARS))
BUTTONS = st.sampled_from(("left", "middle", "right"))
# Edits; others ask for files, or end the viewer.
COMMANDS = [each.name for each in ALL if each.change is not None] + ["reload"]


class Desk:
    """One viewer for all walks, as it takes half a second to start; another after a failure."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._stack, self.failed = folder, ExitStack(), True
        self.paths: dict[str, Path] = {}

    def studio(self) -> Studio:
        """Return the viewer of the next walk, which fails until its end."""
        if self.failed:
            with suppress(Exception):
                self.close()
            self._studio, self.paths = self._stack.enter_context(
                studio(Path(mkdtemp(dir=self._folder)))
            )
        self.failed = True
        return self._studio

    def close(self) -> None:
        """End the viewer."""
        self._stack.close()


class Walk(RuleBasedStateMachine):
    """The viewer, to which anything is done while it works."""

    desk: ClassVar[Desk]

    def __init__(self) -> None:
        super().__init__()
        self.studio = self.desk.studio()
        self.paths, self.viewer = self.desk.paths, self.studio.viewer

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

    @rule(name=st.sampled_from(COMMANDS), wait=WAITS)
    def command(self, name: str, wait: int) -> None:
        self.viewer.run(name)
        self.cycles(wait)

    @rule(places=st.lists(PLACES, min_size=2, max_size=5), button=BUTTONS, wait=WAITS)
    def drag(self, places: list[tuple[int, int]], button: str, wait: int) -> None:
        """Drag, and let the window be resized in the middle of it."""
        press = Input("press", *places[0], button=button)
        self.viewer.give(press)
        for place in places:
            self.viewer.give(Input("move", *place))
            self.cycles(1)
        if wait == 3:
            self.viewer.resize((SIZE[0] + 6, SIZE[1] + BARS))
            self.cycles(1)
        self.viewer.give(Input("release", *places[-1], button=button))
        self.cycles(wait)

    @rule(loop=st.booleans(), wait=WAITS)
    def play(self, loop: bool, wait: int) -> None:
        self.viewer.run("play")
        if loop:
            self.viewer.request("loop")
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
        self.desk.failed = False


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    made = Desk(tmp_path)
    monkeypatch.setattr(Walk, "desk", made, raising=False)
    yield made
    made.close()


@pytest.mark.parametrize(
    ("walks", "steps"), [(3, 12), pytest.param(60, 30, marks=pytest.mark.slow)]
)
def test_what_is_shown_at_rest_is_what_is_written(desk, walks, steps):
    walks = int(os.environ.get("WALKS", walks))
    run_walks(
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
