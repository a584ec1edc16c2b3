"""Coefficient images in the viewer: relit, and never cast again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import opened
from volspec.basis import MaterialBasis
from volspec.pipeline import raycast, relight
from volspec.raycast import CoefficientImage
from volspec.viewer.model import camera, light_rows, transfer_edits
from volspec.viewer.model.history import without_cast
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import WHOLE, CastJob, CastWorker, Pass
from volspec.viewer.work.documents import open_document
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screenshot import render_frame
from volspec.viewer.work.session import read_session, restore_state, save_session

pytestmark = pytest.mark.not_quick

SIZE = (48, 32)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The image of a small scene."""
    state = opened(tmp_path)
    volume = state.document.volume
    image = raycast(volume, state.transfer, state.view.camera(volume), SIZE, state.shading)
    image.save(tmp_path / "ball.exr")
    return tmp_path / "ball.exr"


def state_of(path: Path) -> ViewState:
    return ViewState.first(open_document(str(path)), (300, 300))


def test_an_image_is_relit_at_its_own_size(path: Path) -> None:
    state = state_of(path)
    assert state.document.source == str(path) and state.document.caster is None
    lamp = replace(state, lights=light_rows.only_row(state.lights, 1))
    rig = light_rig(lamp.lights)
    frame = render_frame(lamp, (640, 480), Progress(""))
    assert frame.shape == (SIZE[1], SIZE[0], 3)
    wanted = relight(CoefficientImage.load(path), rig, lamp.relight, backend="numpy")
    assert np.abs(frame.astype(int) - np.asarray(wanted).astype(int)).max() <= 1


def test_an_image_is_the_result_of_every_cast(path: Path) -> None:
    state = state_of(path)
    job = CastJob(
        state.document,
        state.transfer,
        state.view.camera(state.document.volume),
        state.shading,
        (99, 77),
        (Pass(4), WHOLE),
    )
    (done,) = CastWorker(lambda: None)._results(job)
    assert done.image is state.document.image and done.made == WHOLE and done.job.size == SIZE


def test_what_would_need_a_cast_is_undone_and_lights_are_not(path: Path) -> None:
    state = state_of(path)
    lit = replace(state, lights=light_rows.only_row(state.lights, 2))
    turned = camera.orbit(lit, 0.2, 0.1)
    changed = transfer_edits.thicken_by(turned, 0.0, 0.3)
    assert turned.view != state.view
    assert without_cast(state, changed) == lit
    assert without_cast(state, lit) is lit
    other = ViewState.first(open_document(str(path)), state.size)
    assert without_cast(state, other) is other  # another document


def test_reflectances_of_an_image_cast_with_materials_may_change(tmp_path: Path) -> None:
    begun = opened(tmp_path, basis='method = "materials"')
    volume, view = begun.document.volume, begun.view
    image = raycast(volume, begun.transfer, view.camera(volume), SIZE, begun.shading)
    image.save(tmp_path / "ball.exr")
    state = state_of(tmp_path / "ball.exr")
    basis = state.transfer.basis
    assert isinstance(basis, MaterialBasis)
    assert list(state.transfer.materials) == list(begun.transfer.materials)
    swapped = dict(zip(basis.materials, reversed(basis.materials.values()), strict=True))
    painted = replace(state.transfer, materials=swapped, basis=basis.with_reflectances(swapped))
    new = replace(state, transfer=painted)
    assert without_cast(state, new) is new


def test_light_groups_of_an_image_are_those_of_its_lights(tmp_path: Path) -> None:
    begun = opened(tmp_path)
    basis, ones = begun.transfer.basis, np.ones(SIZE[::-1], np.float32)
    pixels = np.random.default_rng(1).random((*SIZE[::-1], 2 * basis.size)).astype(np.float32)
    groups = {"lamp": 0.5, "sky": 0.5}
    CoefficientImage(pixels, ones, ones, basis, groups=groups).save(tmp_path / "b.exr")
    state = state_of(tmp_path / "b.exr")
    assert [group.name for group in state.shading.groups] == ["lamp", "sky"]
    assert render_frame(state, SIZE, Progress("")).std() > 1


def test_a_session_of_an_image_is_restored(path: Path, tmp_path: Path) -> None:
    state = state_of(path)
    state = replace(state, lights=light_rows.only_row(state.lights, 1))
    saved = save_session(state, tmp_path / "s.volspec.json")
    again = restore_state(read_session(saved))
    assert [row.weight for row in again.lights] == [row.weight for row in state.lights]
    frames = [render_frame(each, SIZE, Progress("")) for each in (state, again)]
    np.testing.assert_array_equal(*frames)
