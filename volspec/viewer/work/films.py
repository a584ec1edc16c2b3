"""Films and web pages of a state, made by the exporters of the command line.

    state, settings -> [films] -> MP4, WebM, GIF, folder of frames | HTML

A film's frames are those of its preview: `volspec.viewer.model.film.frame_state`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from volspec.errors import DeviceError, ViewingError
from volspec.export import FILM_SUFFIXES, Plan, Shot, even_size, export, ffmpeg
from volspec.export.page import PageSpec, scene_views, write_page
from volspec.pipeline import Raycaster
from volspec.scene import Scene
from volspec.scene.tables import ExportSpec, Mark
from volspec.viewer.model.depth import picture_look
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.film import Film, film_steps, frame_state
from volspec.viewer.model.light_rows import light_rig, lit_names
from volspec.viewer.model.room import solve_radiosity
from volspec.viewer.model.scene_file import scene_from_state
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.outputs import (
    Destination,
    PictureSize,
    Progress,
    short_title,
    with_own_caster,
)

FRAMES = "PNG frames in a folder"
FILM_KINDS = (*FILM_SUFFIXES, FRAMES)


@dataclass(frozen=True, slots=True)
class FilmFile:
    """Settings of a film's file."""

    film: Film = field(default_factory=Film)
    kind: str = ".mp4"  # one of `FILM_KINDS`
    size: PictureSize = field(default_factory=lambda: PictureSize(even=True))
    to: Destination = field(default_factory=Destination)
    marks: tuple[Mark, ...] = ()
    title: str = ""  # in the picture; empty for the document's

    @property
    def suffix(self) -> str:
        """File name suffix; empty for a folder."""
        return "" if self.kind == FRAMES else self.kind


@dataclass(frozen=True, slots=True)
class PageFile:
    """Settings of a web page."""

    views: int = 1  # cameras around the scene
    title: str = ""  # empty for the scene's
    size: PictureSize = field(default_factory=PictureSize)
    to: Destination = field(default_factory=Destination)
    steps: bool = True  # all time steps of a series, not only the one that is shown


def possible_kinds() -> tuple[str, ...]:
    """Return the kinds of films that can be written; some need ffmpeg."""
    try:
        ffmpeg()
    except DeviceError:
        return ".gif", FRAMES
    return FILM_KINDS


def save_film(state: ViewState, file: FilmFile, progress: Progress) -> Path:
    """Cast, relight and encode a film, off the window's thread; return its path."""
    path, state = file.to.new_path(state.document, file.suffix), solve_radiosity(state)
    plan, size = film_plan(state, file.film), file.size.pixels(state.size)
    stereo = picture_look(state).stereo
    size = even_size(stereo.eye_size(size)) if stereo else size
    table = ExportSpec(fps=file.film.fps, sheet=False, annotate=file.marks, stereo=stereo)
    scene = _scene(state, table, file.title)

    def report(step: str, fraction: float) -> None:
        progress.step = "encoding" if step == "encode" else ""
        progress.report(fraction)
        progress.check()

    def make(caster: Raycaster) -> None:
        series = state.document.series
        export(scene, path, size=size, progress=report, caster=caster, plan=plan, series=series)

    with_own_caster(state.document, make)
    return path


def film_plan(state: ViewState, film: Film) -> Plan:
    """Return the frames of a film."""
    volume, shots = state.document.volume, []
    transfer = shown_transfer(state)
    for i, step in enumerate(film_steps(state.document, film)):
        now = frame_state(state, film, i)
        rig = light_rig(now.lights, now.room)
        if rig is None:
            raise ViewingError("No light is on, so there is no film to save", code="missing")
        camera = now.view.camera(volume)
        settings = transfer, lit_names(now.lights), rig, picture_look(now), step
        shots.append(Shot(f"{i:04d}", i, camera, *settings))
    return Plan(tuple(shots), ())


def save_page(state: ViewState, file: PageFile, progress: Progress) -> Path:
    """Cast a state's views and write them as a web page; return its path."""
    path, state = file.to.new_path(state.document, ".html"), solve_radiosity(state)
    marks, size = state.document.saved()[0].export.annotate, file.size.pixels(state.size)
    scene = _scene(state, ExportSpec(annotate=marks), file.title)

    def report(fraction: float) -> None:
        progress.report(fraction)
        progress.check()

    def make(caster: Raycaster) -> None:
        series = state.document.series if file.steps else None
        views = scene_views(
            scene, file.views, size=size, progress=report, caster=caster, series=series
        )
        spec = PageSpec(scene.file.title, fps=state.document.step_rate)
        write_page(path, views, scene.lights, scene.relight, spec)

    with_own_caster(state.document, make)
    return path


def _scene(state: ViewState, table: ExportSpec, title: str) -> Scene:
    """Return the scene of a state as it would be saved, with the state's own basis."""
    title = title.strip() or short_title(state.document)
    file = replace(scene_from_state(state), export=table, keyframe=(), title=title)
    _, path = state.document.saved()
    return Scene(file, path, basis=state.transfer.basis, room=state.room)
