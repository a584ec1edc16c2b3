"""Steps of tests with states: change, cast, show, and bring them back from a file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.image import CoefficientImage
from volspec.palette import Apart
from volspec.pipeline import relight
from volspec.raycast import ClipPlane, Directional, LightGroup
from volspec.raycast.progressive import Pass
from volspec.relight import LightRig
from volspec.spectra import Spectrum, light
from volspec.viewer.model import camera, transfer_edits
from volspec.viewer.model.light_rows import LightRow, light_rig, only_row
from volspec.viewer.model.palette_targets import DesignTargets, PaletteState
from volspec.viewer.model.quality import cast_spec
from volspec.viewer.model.state import Interface, ViewState
from volspec.viewer.work.cast_job import CastDone, CastJob
from volspec.viewer.work.casts import CastWorker
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


def worked_on(state: ViewState) -> ViewState:
    """Return a state with something of every kind changed."""
    state = transfer_edits.move_point(camera.orbit(state, 0.2, 0.1), 1, 0.8, 0.7)
    state = transfer_edits.shift(state, 0.05)
    nm = state.document.grid.wavelengths_nm
    drawn = Spectrum(nm, np.linspace(0.3, 1.7, nm.size), "drawn", {"designed": "yes"})
    rig = LightRig((drawn, light("A")), (0.5, 1.0), groups=("key", ""))
    rows = (
        *(replace(row, solo=index == 1, weight=0.25) for index, row in enumerate(state.lights)),
        LightRow("mine", "drawn by hand", rig, 0.75, muted=True),
        LightRow("3000 K", "", LightRig((light("planck:3000"),)), 0.0, kelvin=3000.0),
    )
    shading = replace(
        state.shading,
        groups=(LightGroup("key", (Directional((1, 0, 1), shadows=True),)),),
        clip_planes=(ClipPlane((6, 6, 6), (0, 1, 0)),),
        crop_voxels=((0, 9), (0, 11), (0, 11)),
    )
    display = replace(state.relight.viewing.display, gamut="reduce", mark=True)
    state = seen(state, model="CAM16", deficiency="protan", severity=0.7, display=display)
    apart = Apart(light=("day",), deficiency=("none", "deutan"), severity=0.5)
    return replace(
        state,
        lights=rows,
        shading=shading,
        other=state.lights,
        divide=0.3,
        palette=PaletteState(DesignTargets(apart=(apart,))),
        interface=Interface(dark=False, light=2, panels=frozenset({"Lights"})),
    )


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
