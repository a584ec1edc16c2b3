"""Labels in the viewer: shown and hidden, searched, switched to grey values and back."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import read_scene, run_command
from tests.viewer._states import casts_of, job_of
from tests.volume.test_labels import blocks
from volspec.raycast.progressive import WHOLE
from volspec.scene import Scene
from volspec.transfer import TransferFunction
from volspec.viewer.model import labels, transfer_edits
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.documents import open_path
from volspec.viewer.work.probe import read

pytestmark = pytest.mark.not_quick

NAMES = "1\tliver\n2\tleft kidney\n3\tright kidney\n"


def segmentation(folder: Path, count: int = 3) -> Path:
    """Write labels 1 to ``count`` in a row, and names for three of them."""
    np.save(folder / "organs.npy", blocks(list(range(1, count + 1))))
    (folder / "organs.tsv").write_text(f"index\tname\n{NAMES}")
    return folder / "organs.npy"


@pytest.fixture
def state(tmp_path: Path) -> ViewState:
    return open_path(str(segmentation(tmp_path)), None).state


def test_a_segmentation_opens_with_its_labels(state):
    function = state.transfer
    assert function.names == {1: "liver", 2: "left kidney", 3: "right kidney"}
    assert not function.hidden and {opacity for opacity, _ in function.labels.values()} == {0.9}


@pytest.mark.filterwarnings("ignore:.*quality")
def test_the_probe_names_the_label_behind_its_boundary(state):
    (done,) = casts_of(job_of(state, (60, 60), WHOLE))
    y, x = np.nonzero(done.image.alpha > 0.5)
    pixel = x[len(x) // 2], y[len(x) // 2]
    rig, camera = light_rig(state.lights), done.job.camera
    found = read(done.image, camera, state.document.volume, rig, state.relight, pixel, (0, 0, 0))
    assert dict(found.rows)["Label"] in ("1  liver", "2  left kidney", "3  right kidney")


def test_labels_are_hidden_and_shown_and_keep_their_opacity(state):
    def hidden(state: ViewState) -> set[int]:
        return set(state.transfer.hidden)

    new = labels.toggle_label(state, 2)
    assert hidden(new) == {2} and new.transfer.labels[2][0] == 0.9
    assert Difference.between(state, new).stage == "cast"
    assert hidden(labels.toggle_label(new, 2)) == set()
    assert labels.toggle_label(state, 9) is state
    only = labels.show_only(state, 3)
    assert hidden(only) == {1, 2}
    assert hidden(labels.show_only(only, 3)) == set()
    assert hidden(run_command(only, "labels-invert").state) == {3}
    none = run_command(state, "labels-hide").state
    assert hidden(none) == {1, 2, 3}
    assert hidden(run_command(none, "labels-show").state) == set()
    assert hidden(History(state).then(only, 1).undo().present) == set()


def test_labels_are_found_by_words_of_their_names_or_numbers(state):
    for words, found in (("", (0, 1, 2)), ("KID left", (1,)), ("3", (2,)), ("spleen", ())):
        assert labels.matching_labels(state.transfer, words) == found


def test_grey_values_and_labels_are_two_views_of_one_volume(state):
    assert isinstance(run_command(state, "transfer-points").state.transfer, TransferFunction)
    surfaces = run_command(labels.toggle_label(state, 1), "transfer-surfaces").state
    assert run_command(surfaces, "transfer-labels").state.transfer is state.document.transfer
    assert isinstance(run_command(state, "preset-bone").state.transfer, TransferFunction)


def test_a_volume_of_whole_numbers_can_be_shown_as_labels(tmp_path):
    np.save(tmp_path / "mask.npy", blocks([1, 1]))
    state = open_path(str(tmp_path / "mask.npy"), None).state
    assert isinstance(state.transfer, TransferFunction)
    assert list(run_command(state, "transfer-labels").state.transfer.labels) == [1]


def test_a_scene_keeps_names_opacities_and_hidden_labels(state, tmp_path):
    new = labels.toggle_label(transfer_edits.set_opacity(state, 0, 0.25), 3)
    again = read_scene(export_scene(new, tmp_path / "organs.toml")).transfer
    assert again.names == new.transfer.names and again.hidden == {3}
    assert [look[0] for look in again.labels.values()] == [0.25, 0.9, 0.9]
    rows = Scene.load(tmp_path / "organs.toml").file.material
    assert all(isinstance(row.reflectance, str) for row in rows)


@pytest.mark.slow
def test_eyes_search_and_solo_in_the_window(window, tmp_path):
    window.resize((1000, 800))  # or the labels in question are outside of the picture
    window.open(segmentation(tmp_path, 20))
    window.front("transfer")
    whole = window.picture()
    window.click("eye 1", "eye 2")
    hidden = window.picture()
    assert np.abs(hidden - whole).mean() > 0.2
    window.click("search labels")
    window.type("right kid")
    window.rest()
    window.click("only 3")
    assert np.abs(window.picture() - hidden).mean() > 0.5
    window.click("picture")
    window.keys(*["ctrl+z"] * 3)
    assert np.abs(window.picture() - whole).mean() < 0.1
