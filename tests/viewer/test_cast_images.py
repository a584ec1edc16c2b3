"""Coefficient images in the viewer: relit, and never cast again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import opened
from tests.viewer._states import casts_of, frame_of, job_of, relit, restored, under
from volspec.image import CoefficientImage
from volspec.pipeline import raycast
from volspec.raycast.progressive import WHOLE, Pass
from volspec.viewer.model import camera, rules, transfer_edits
from volspec.viewer.model.history import ONE_VIEW, without_cast
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.documents import open_document

pytestmark = pytest.mark.not_quick

SIZE = (48, 32)


def image_of(state: ViewState, folder: Path) -> Path:
    """Cast a state and write the image."""
    volume = state.document.volume
    image = raycast(volume, state.transfer, state.view.camera(volume), SIZE, state.shading)
    image.save(folder / "ball.exr")
    return folder / "ball.exr"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The image of a small scene."""
    return image_of(opened(tmp_path), tmp_path)


def state_of(path: Path) -> ViewState:
    return ViewState.first(open_document(str(path)), (300, 300))


def test_an_image_is_relit_at_its_own_size(path):
    state = state_of(path)
    assert state.document.source == str(path) and state.document.caster is None
    lamp = under(state, 1)
    frame = frame_of(lamp, (640, 480))
    assert frame.shape == (SIZE[1], SIZE[0], 3)
    assert np.abs(frame - relit(CoefficientImage.load(path), lamp)).max() <= 1


def test_an_image_is_the_result_of_every_cast(path):
    state = state_of(path)
    (done,) = casts_of(job_of(state, (99, 77), Pass(4), WHOLE))
    assert done.image is state.document.image and done.cast_pass == WHOLE and done.job.size == SIZE


def test_what_would_need_a_cast_is_undone_and_lights_are_not(path):
    state = state_of(path)
    lit = under(state, 2)
    turned = camera.orbit(lit, 0.2, 0.1)
    assert turned.view != state.view
    assert without_cast(state, transfer_edits.thicken_by(turned, 0.0, 0.3)) == (lit, ONE_VIEW, "")
    assert without_cast(state, lit).state is lit
    other = ViewState.first(open_document(str(path)), state.size)
    assert rules.hold(state, other) == (other, [])  # another document


def test_reflectances_of_an_image_cast_with_materials_may_change(tmp_path):
    begun = opened(tmp_path, basis='method = "materials"')
    state = state_of(image_of(begun, tmp_path))
    basis = state.transfer.basis
    assert list(state.transfer.materials) == list(begun.transfer.materials)
    swapped = dict(zip(basis.materials, reversed(basis.materials.values()), strict=True))
    painted = replace(state.transfer, materials=swapped, basis=basis.with_reflectances(swapped))
    new = replace(state, transfer=painted)
    assert without_cast(state, new).state is new


def test_light_groups_of_an_image_are_those_of_its_lights(tmp_path):
    basis, ones = opened(tmp_path).transfer.basis, np.ones(SIZE[::-1], np.float32)
    pixels = np.random.default_rng(1).random((*SIZE[::-1], 2 * basis.size)).astype(np.float32)
    groups = {"lamp": 0.5, "sky": 0.5}
    CoefficientImage(pixels, ones, ones, basis, groups=groups).save(tmp_path / "b.exr")
    state = state_of(tmp_path / "b.exr")
    assert [group.name for group in state.shading.groups] == ["lamp", "sky"]
    assert frame_of(state).std() > 1


def test_a_session_of_an_image_is_restored(path, tmp_path):
    state = under(state_of(path), 1)
    again = restored(state, tmp_path)
    assert [row.weight for row in again.lights] == [row.weight for row in state.lights]
    np.testing.assert_array_equal(frame_of(again), frame_of(state))
