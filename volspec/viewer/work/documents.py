"""Opening of scenes, volumes and sessions, and the list of recent files.

    path -> [documents] -> threads -> Opened -> state

Of several requests, only the last is opened. The previous state is saved as a session.
"""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from volspec._files import is_remote
from volspec._triangles import is_mesh_file
from volspec.errors import VolspecError, VolumeError, one_line
from volspec.pipeline import Raycaster
from volspec.scene import Scene, open_fields
from volspec.scene.tables import MeshSpec
from volspec.spectra import reflectance_names
from volspec.viewer.model.choices import Dropped, NeedsChoice, address_with, scale_choice
from volspec.viewer.model.document import Document, demo
from volspec.viewer.model.light_rows import brightest_row
from volspec.viewer.model.meshes import row_for
from volspec.viewer.model.paths import (
    SPECTRA,
    check_name,
    dropped_documents,
    dropped_meshes,
    relative_path,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import Outcome, Tasks
from volspec.viewer.work.cast_images import is_cast_image, open_image
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.demonstrations import demonstration_at
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.session import SUFFIX, BrokenSession, restore_state
from volspec.viewer.work.session_store import RecentFiles, SessionStore, state_folder
from volspec.volume import (
    JOINER,
    Choice,
    Volume,
    open_volume,
    series_address,
    step_addresses,
    volume_choices,
)


def open_document(
    path: str | None,
    device: str | None = None,
    choices: tuple[Choice, ...] | None = None,
    fields: tuple[str, ...] = (),
) -> Document:
    """Open a scene, a cast image, or a volume with a scene made for it; None opens the demo.

    The ``choices`` of a volume's address are listed if they are not given; ``fields`` are files of
    the volume's further fields.

    Raises VolspecError if the file cannot be read, or a device is named that cannot cast.
    """
    if path is not None:
        check_name(path)
        if is_cast_image(path):
            return open_image(path)
    opened = demo() if path is None else Path(path)
    is_mesh = is_mesh_file(opened)
    if path is None or is_mesh or path.lower().endswith(".toml"):
        scene = Scene.from_mesh(opened) if is_mesh else Scene.load(opened)
        (volume, series), choices = scene.opened(), ()
    elif fields:
        scene, volume = _scene_of_fields((path, *fields))
        series, choices = None, ()
    else:
        volume, series = open_volume(path)
        if series is not None and len(series) == 1 and JOINER in path:
            unread = ", ".join(
                address for address in step_addresses(path) if address not in series.names
            )
            raise VolumeError(
                f"{unread}: cannot be a time step after {series.names[0]}",
                "open it alone for the reason",
                code="missing",
            )
        if choices is None:
            choices = list_choices(path, volume)
        scene = Scene.from_volume(path, volume=volume, series=series)
    # Loaded ahead, as presets would have to wait for the names.
    threading.Thread(target=reflectance_names, daemon=True).start()
    caster, fault = make_caster(volume, device)
    return Document.of(scene, volume, caster, fault, series).with_choices(choices)


def _scene_of_fields(paths: tuple[str, ...]) -> tuple[Scene, Volume]:
    """Return a scene made for volumes in one space, and the volume with the others as fields."""
    for path in paths:
        check_name(path)
    volume, files = open_fields(paths)
    scene = Scene.from_volume(files[""], volume=volume)
    folder = str(scene.path.parent)
    rows = tuple(
        replace(row, file=relative_path(files[row.name], folder)) if row.name in files else row
        for row in scene.file.field
    )
    title = " + ".join([scene.file.title, *(row.name for row in rows if row.file)])
    scene.file = replace(scene.file, title=title, field=rows)
    return scene, volume


def list_choices(path: str, volume: Volume) -> tuple[Choice, ...]:
    """Return what the address of a volume leaves open; nothing if it cannot be read.

    A file without options was read whole; only a folder may hold more, as levels.
    """
    scale = scale_choice(volume)
    if "?" not in path and not (os.path.isdir(path) or is_remote(path)):
        return scale
    try:
        # Time steps are shown by the series, or the one that is asked for alone.
        return tuple(choice for choice in volume_choices(path) if choice.key != "time") + scale
    except VolspecError:
        return scale


@dataclass(frozen=True, slots=True, eq=False)
class OpenResult:
    """A document, or a ``session`` file, that was opened.

    The path is as requested; None for the bundled demo, and for sessions saved automatically.
    """

    state: ViewState
    path: str | None = None
    session: Path | None = None
    # The document that this replaces if it is still open: edits made meanwhile stay.
    instead_of: Document | None = None

    def after(self, before: ViewState | None) -> OpenResult:
        """Return this for the current window; a session keeps its interface and chosen light."""
        if before is None:
            return self
        if self.instead_of is not None and before.document.is_of(self.instead_of):
            return replace(self, state=replace(before, document=self.state.document))
        interface = self.state.interface
        if self.session is None:
            interface = before.interface.for_another(brightest_row(self.state.lights))
        return replace(self, state=replace(self.state, size=before.size, interface=interface))


def open_path(path: str | None, device: str | None) -> OpenResult | NeedsChoice:
    """Open a scene or a volume with `open_document`, in its initial state."""
    try:
        return OpenResult(ViewState.first(open_document(path, device), (0, 0)), path)
    except VolumeError:
        if path is None or path.lower().endswith(".toml"):
            raise
        choices: tuple[Choice, ...] = ()
        with suppress(VolspecError):
            choices = volume_choices(path)
        if all(choice.chosen is not None for choice in choices):
            raise
        return NeedsChoice(path, choices)


@dataclass(frozen=True, slots=True, eq=False)
class ReadMeshes:
    """Meshes that were read to be added to a document, and messages on those that were not."""

    document: Document
    rows: tuple[MeshSpec, ...]
    errors: tuple[str, ...]


def read_meshes(state: ViewState, paths: tuple[str, ...]) -> ReadMeshes:
    """Read the files of meshes; warn of units that do not fit the volume."""
    document, rows, errors = state.document, [], []
    for path in paths:
        try:
            check_name(path)
            row = row_for(state, path)
            mesh = document.meshes.mesh(row)
            mesh.warn_of_unit(document.volume.corners_mm)
            rows.append(replace(row, own_colours=not mesh.materials))
        except VolspecError as error:
            errors.append(one_line(error))
    return ReadMeshes(document, tuple(rows), tuple(errors))


class DocumentService:
    """Opens files in the background, and saves sessions."""

    def __init__(self, tasks: Tasks, notice: Notice, device: str | None) -> None:
        self._tasks, self._notice, self._device = tasks, notice, device
        folder = state_folder()
        self._recent, self._store = RecentFiles(folder), SessionStore(folder)
        # Opened at the start, in this order, if the last session cannot be restored.
        self._fallbacks: list[str | None] = []
        self._opening = ""  # the message while a file is being opened
        self.recent = self._recent.rows()
        self.undecided: NeedsChoice | None = None  # an address of which to choose what to open
        self.dropped: Dropped | None = None  # files of which to choose what they are
        self._meshes: tuple[str, ...] = ()  # to be added to what is being opened
        self._next: tuple[str, ...] = ()  # to be opened after that
        self.problem = ""  # why nothing is open yet

    def open(self, path: str | None, notify: bool = True) -> None:
        """Start reading a scene, a volume or a session; None for the bundled demo.

        `finish_open` returns it later. If ``notify`` is False, the current message stays.
        """
        self._next = self._meshes = ()
        self._open(path, notify)

    def _open(self, path: str | None, notify: bool = True) -> None:
        if path is not None and path.lower().endswith(SUFFIX):
            self._resume(Path(path))
            return
        if notify:
            self._show_opening(f"Opening {path or 'the demo'} …")
        self._tasks.start("open", lambda: open_path(path, self._device))

    def drop(self, paths: tuple[str, ...]) -> tuple[str, ...]:
        """Open the scene or the volume that was dropped; of several, ask for their use.

        Return meshes that were dropped without one, to be added to the open document.
        """
        files, meshes = dropped_documents(paths), dropped_meshes(paths)
        if left := [path for path in paths if path not in files and path.lower().endswith(SPECTRA)]:
            names = ", ".join(Path(path).name for path in left)
            self._notice.show_warning(f"{names}: neither a volume nor a scene, left out")
        if len(files) > 1:
            self.dropped = Dropped(files, meshes)
        elif files:
            self.open(files[0])
            self._meshes = meshes
        return () if files else meshes

    def use(self, dropped: Dropped, use: str) -> None:
        """Open files that were dropped together: as fields, as steps, or one after the other."""
        paths = dropped.ordered(use)
        if use == "fields":
            self._next = self._meshes = ()
            self._show_opening(f"Opening {len(paths)} fields …")

            def opened() -> OpenResult:
                document = open_document(paths[0], self._device, fields=paths[1:])
                return OpenResult(ViewState.first(document, (0, 0)))

            self._tasks.start("open", opened)
        elif use == "steps":
            self.open(series_address(paths))
        else:
            self.open(paths[0])
            self._next = paths[1:]
        self._meshes = dropped.meshes

    def decide(self, address: str) -> None:
        """Open the address that was chosen; if it is empty, go on with the next file, if any."""
        if address:
            self._open(address)
        else:
            self._open_next()

    def _open_next(self) -> None:
        """Open the next of the files to be opened one after the other, if any."""
        if self._next:
            path, *later = self._next
            self._next = tuple(later)
            self._open(path)

    def resume_last(self, path: str | None) -> None:
        """Restore the last session; without one, open the file, the most recent one or the demo."""
        recent = [row.path for row in self._recent.rows() if row.exists]
        self._fallbacks = [path] if path is not None else [*recent[:1], None]
        session = self._store.last()
        if session is not None:
            self.resume(session)
        else:
            self._open_fallback("There is no session to restore")

    def finish_open(self, outcome: Outcome, first: bool) -> OpenResult | None:
        """Return the result of an ``open`` task; None if it failed or there is a choice to make.

        If nothing is open yet (``first``), something else is opened instead, or `problem` is set.
        """
        if isinstance(outcome.result, NeedsChoice):
            self._notice.hide(self._opening)
            self.undecided = outcome.result
            return None
        if not outcome.error:
            opened: OpenResult = outcome.result
            self.problem = ""
            return opened
        if self._next:
            self._notice.show_error(outcome.error)
            self._open_next()
            return None
        self._meshes = ()
        if first:
            # In the terminal, too, where the command was typed.
            print(f"volspec: {one_line(outcome.error)}", file=sys.stderr)
            self._open_fallback(outcome.error)
        else:
            self._notice.show_error(outcome.error)
        return None

    def begin(self, opened: OpenResult, before: ViewState | None) -> None:
        """Save the previous session, start the new document's, and list its file."""
        if before is not None:
            self.save(before)
        early = before is None and self._store.ended_early()
        self._store.begin(opened.state, opened.session)
        self._notice.hide(self._opening)
        if early and opened.session is None and not self._notice.text:
            self._notice.show_warning(
                "The last session ended early; File › Restore the last session brings it back"
            )
            self._notice.trace.note("ended-early")
        if (demonstration := demonstration_at(opened.path)) is not None:
            self._notice.show(demonstration.hint)
        elif opened.path is not None:
            self._recent.add(opened.path)
            self.recent = self._recent.rows()
            volume = opened.state.document.volume
            if volume.metadata.assumed and not self._notice.text:
                self._notice.show(f"{volume.title}: {volume.metadata}")
        self._open_next()

    def take_meshes(self) -> tuple[str, ...]:
        """Return the meshes to be added to what was opened last, once."""
        if self._next:
            return ()
        meshes, self._meshes = self._meshes, ()
        return meshes

    def tick(self, state: ViewState, now: float, moves: bool) -> None:
        """Save the session if it is due and nothing is moving that this could disturb."""
        if self._store.due(state, now) and not moves:
            self._tasks.start("session", self._store.saving(state, now))

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """Save the session at the end; after a fault it is not marked as ended."""
        if state is not None:
            self.save(state)
        if not faulty:
            self._store.end()

    def save(self, state: ViewState) -> None:
        """Save the session now; an error is only shown as a message."""
        try:
            self._store.save(state)
        except (VolspecError, OSError) as error:
            self._notice.show_error(f"The session was not saved: {error}")

    def restore(self, state: ViewState) -> None:
        """Save this session, and restore the one before."""
        self.save(state)
        last = self._store.last()
        if last is None:
            self._notice.show_warning("There is no other session to restore")
        else:
            self.resume(last)

    def reload(self, state: ViewState) -> None:
        """Read the open file again; only the view and the window stay."""
        path, fields = state.document.source, state.document.field_files
        self._show_opening("Reading the file again; only the view stays …")

        def again() -> OpenResult:
            reopened = ViewState.first(open_document(path, self._device, fields=fields), (0, 0))
            return OpenResult(replace(reopened, view=state.view), path)

        self._tasks.start("open", again)

    def choose(self, state: ViewState, key: str, value: str) -> None:
        """Open another channel, level, … of the open volume, under the same lights and view."""
        source = state.document.source
        if source is None:
            return
        path = address_with(source, {key: value})
        self._show_opening(f"Opening {path} …")
        choices = tuple(
            replace(choice, chosen=value) if choice.key == key else choice
            for choice in state.document.choices
        )

        def reopen() -> OpenResult:
            # The steps of a series may differ from another's.
            known_choices = None if key == "series" else choices
            document = open_document(path, self._device, known_choices)
            step = state.document.step
            if document.series is not None and step:
                volume, template = document.series[step], document.caster
                caster = None if template is None else Raycaster(volume, like=template)
                document = document.at_step(step, volume, caster)
            if key == "level":  # whose values mean the same, so that the transfer function stays
                opened = replace(state, document=document)
                return OpenResult(opened, instead_of=state.document)
            opened = ViewState.first(document, state.size)
            view = opened.view if key in ("series", "scale") else state.view
            lights = {name: getattr(state, name) for name in ("lights", "relight", "saved_lights")}
            return OpenResult(replace(opened, view=view, **lights))

        self._tasks.start("open", reopen)

    def clear_recent(self) -> None:
        """Clear the list of recent files."""
        self._recent.clear()
        self.recent = ()

    def resume(self, path: Path) -> None:
        """Start restoring the session in a file."""
        self._next = self._meshes = ()
        self._resume(path)

    def _resume(self, path: Path) -> None:
        def restored() -> OpenResult:
            check_name(path)
            session = self._store.read(path)
            try:
                state = restore_state(session, self._device)
            except BrokenSession as error:
                raise self._store.broken(path, error) from error
            document = state.document
            source = document.source
            if source and not source.lower().endswith(".toml") and not document.field_files:
                document = document.with_choices(list_choices(source, document.volume))
            requested = None if self._store.holds(path) else str(path)
            return OpenResult(replace(state, document=document), requested, path)

        self._show_opening("Restoring the session …")
        self._tasks.start("open", restored)

    def _open_fallback(self, error: str) -> None:
        """Open the next of `_fallbacks`, as nothing is open yet; without one, show the error."""
        if not self._fallbacks:
            self.problem = one_line(error)
            self._notice.show_error(error)
            return
        path = self._fallbacks.pop(0)
        name = "the demo" if path is None else Path(path).name
        self._notice.show_error(f"{error}; opening {name} instead")
        self.open(path, notify=False)

    def _show_opening(self, message: str) -> None:
        """Show a message until the file is open, or another message comes."""
        self._notice.show(message)
        self._opening = self._notice.text
