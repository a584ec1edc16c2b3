"""What tests do with states: change them, cast and show them, and bring them back from a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.pipeline import relight
from volspec.raycast import CoefficientImage
from volspec.raycast.pace import Pass
from volspec.viewer.model.light_rows import light_rig, only_row
from volspec.viewer.model.quality import cast_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import CastDone, CastJob, CastWorker
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screenshot import render_frame
from volspec.viewer.work.session import SUFFIX, read_session, restore_state, save_session
from volspec.volume import Volume, phantom


def under(state: ViewState, light: int) -> ViewState:
    """Return the state under one of its lights alone."""
    return replace(state, lights=only_row(state.lights, light))


def seen(state: ViewState, **viewing: Any) -> ViewState:
    """Return the state in other viewing conditions."""
    changed = replace(state.relight.viewing, **viewing)
    return replace(state, relight=replace(state.relight, viewing=changed))


def of_volume(state: ViewState, volume: Volume) -> ViewState:
    """Return the state of another volume."""
    return replace(state, document=replace(state.document, volume=volume))


def save_ball(folder: Path, size: int = 16, name: str = "ball.npy") -> Path:
    """Write a ball of ``size`` voxels a side."""
    np.save(folder / name, phantom.ball(size).values)
    return folder / name


def job_of(state: ViewState, size: tuple[int, int], *passes: Pass, **more: Any) -> CastJob:
    camera = state.view.camera(state.document.volume)
    return CastJob(state.document, state.transfer, camera, cast_spec(state), size, passes, **more)


def casts_of(job: CastJob) -> list[CastDone]:
    return list(CastWorker(lambda: None)._results(job))


def frame_of(state: ViewState, size: tuple[int, int] | None = None) -> NDArray[np.int_]:
    """Return the codes of a state's picture, as it is saved."""
    return render_frame(state, size or state.size, Progress("picture")).astype(int)


def relit(image: CoefficientImage, state: ViewState) -> NDArray[np.int_]:
    """Return the codes of an image under a state's lights."""
    rig = light_rig(state.lights)
    return np.asarray(relight(image, rig, state.relight, backend="numpy")).astype(int)


def restored(state: ViewState, folder: Path, cast: bool = True) -> ViewState:
    """Return a state that was saved as a session."""
    return restore_state(read_session(save_session(state, folder / f"one{SUFFIX}")), cast=cast)
