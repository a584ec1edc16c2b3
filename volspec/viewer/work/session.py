"""Session files: the whole state of the viewer, to be continued later.

    state <-> [session] <-> FILE.volspec.json

A session contains the scene's tables as they were opened, which commands such as reset restore,
and every field of the state. Spectra are stored as numbers; the volume's voxels are not stored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from volspec._files import write_whole
from volspec._parse import parse_json, read_text
from volspec.errors import InputError, SceneError, one_line, quoted
from volspec.scene.file import SceneFile
from volspec.scene.meshes import MeshCache
from volspec.scene.resolve import Resolver
from volspec.settings import plain, read_table
from volspec.viewer.model.document import Document, shown_step
from volspec.viewer.model.paths import name_below, relative_path
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.cast_images import is_cast_image, open_image
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.session_codec import Reader, ValueFault, Writer

FORMAT = "volspec-session"
VERSION = 3
SUFFIX = ".volspec.json"
# Fields of a document that are read, made or measured again.
_REMADE = (
    "volume",
    "caster",
    "fault",
    "file",
    "path",
    "choices",
    "image",
    "room",
    "meshes",
    "series",
    "step",
    "opening",
)
# Fields of a state that are made again or not saved: a fade must not run a second time.
_PASSING = ("document", "fade", "room")


class SessionError(InputError):
    """A session's file is missing or of a later version, or cannot be resumed."""


class BrokenSession(SessionError):
    """A session's file is damaged or was edited by hand."""

    code = "damaged"


@dataclass(frozen=True, slots=True)
class Session:
    """Contents of a session's file, and the current path of its scene or volume."""

    path: Path
    data: dict[str, Any]


def session_from_state(state: ViewState) -> Session:
    """Return a state's session.

    Raises SceneError if the document has no file to be read from again.
    """
    document, (file, path) = state.document, state.document.saved()
    writer = Writer()
    try:
        parts = {
            "document": writer.field_values(document, but=_REMADE),
            "state": writer.field_values(state, but=_PASSING),
        }
    except TypeError as error:
        raise SessionError(f"{document.title}: {error}", code="unsupported") from error
    data = {
        "format": FORMAT,
        "version": VERSION,
        "path": os.fspath(path),
        "file": plain(file),
        "paint": {} if state.room is None else state.room.spec.paint,
        **parts,
        "objects": writer.objects,
    }
    return Session(path, data)


def save_session(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write a session, whole or not at all.

    Raises VolspecError if the name does not end in ``.json``, if nothing can be written there, or
    as `session_from_state` does.
    """
    target = Path(path)
    if target.suffix.lower() != ".json":
        problem = f"{target}: sessions are JSON; name it FILE{SUFFIX}"
        raise SessionError(problem, code="unsupported")
    data = session_from_state(state).data
    folder = target.absolute().parent
    # Finds the scene if both are moved together; below the session, they are sent together, too.
    data["relative_path"] = relative_path(data["path"], str(folder))
    data["path"] = name_below(data["path"], str(folder)) or data["path"]
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return target


def read_session(path: str | os.PathLike[str]) -> Session:
    """Read a session's file, without its scene and volume.

    Raises SessionError if it is missing, not a session, or of another version.
    """
    name, text = os.fspath(path), read_text(path, SessionError, f"a session (FILE{SUFFIX})")
    try:
        data = parse_json(text)
    except ValueError as error:
        raise BrokenSession(f"{name}: not a session: {error}") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        problem = f"{name}: not a session; its field 'format' is not {FORMAT!r}"
        raise BrokenSession(problem, field="format")
    version = data.get("version")
    if type(version) is not int or version < 1:
        problem = f"{name}: version is {quoted(version)}; expected {VERSION}"
        raise BrokenSession(problem, code="type", given=version)
    if version != VERSION:
        remedy = "install a later volspec" if version > VERSION else "open its scene instead"
        raise SessionError(
            f"{name}: version {version}; this volspec reads {VERSION}, {remedy}",
            code="unsupported",
        )
    kinds = {"path": str, "file": dict, "document": dict, "state": dict, "objects": list}
    for key, kind in kinds.items():
        if not isinstance(data.get(key), kind):
            raise BrokenSession(f"{name}: field {key!r} is missing or wrong; was it edited?")
    relative = data.get("relative_path")
    folder = Path(path).absolute().parent
    nearby = folder / str(relative or "")
    # A volume may be a folder.
    return Session(nearby if relative and os.path.exists(nearby) else folder / data["path"], data)


def restore_state(session: Session, device: str | None = None, cast: bool = True) -> ViewState:
    """Return a session's state, with its volume read again, and with a caster if ``cast``.

    Raises SessionError if a field is missing or wrong (the message names it), VolspecError if the
    volume cannot be read or there is no device.
    """
    data = session.data
    try:
        file = read_table(SceneFile, data["file"], SceneError, Path(session.path).parent)
        reader = Reader(data["objects"])
        of_document = reader.field_values(Document, data["document"], but=_REMADE)
        of_state = reader.field_values(ViewState, data["state"], but=_PASSING)
    except SceneError as error:
        raise BrokenSession(f"session: file: {error}", code="damaged") from error
    except (ValueFault, TypeError) as error:
        raise _broken_by(error) from error
    if not of_state["lights"]:
        raise BrokenSession("is empty; was it edited?", field="session.lights")
    if is_cast_image(os.fspath(session.path)):
        return ViewState(open_image(os.fspath(session.path)), **of_state)
    name, mark, query = file.volume.file.partition("?")
    # Of a bare volume, which may have been moved with its session.
    if name == data["path"] and os.path.isabs(name):
        moved = replace(file.volume, file=f"{session.path}{mark}{query}")
        file = replace(file, volume=moved)
    names = Resolver(file, session.path)
    try:
        volume, series = names.opened()
    except InputError as error:
        if error.code != "not-found" or session.path.suffix.lower() == ".toml":
            raise
        raise SessionError(
            f"{session.path}: the session's volume is not there",
            "put it there, or the session next to it",
            code="not-found",
        ) from error
    room = painted = names.room(of_document["transfer"].basis.grid)
    if room is not None:
        painted = room.with_paint(_paint(data))
    caster, fault = make_caster(volume, device) if cast else (None, "")
    transfer = of_state["transfer"]
    meshes = MeshCache(session.path.parent)
    meshes.caster(of_state["meshes"], transfer.materials, transfer.basis)
    document = Document(
        **of_document,
        meshes=meshes,
        volume=volume,
        caster=caster,
        fault=fault,
        series=series,
        step=shown_step(file, series),
        file=file,
        path=session.path,
        room=room,
    )
    state = ViewState(document, **of_state, room=painted)
    try:
        state.view.camera(volume)
    except InputError as error:
        raise _broken_by(error, "view") from error
    return state


def _paint(data: Mapping[str, Any]) -> dict[str, str]:
    """Return the paints of a session's room, by surface."""
    paint = data.get("paint", {})
    if not isinstance(paint, dict) or not all(isinstance(text, str) for text in paint.values()):
        raise _broken_by(ValueFault("expected names of paints", code="type", field="paint"))
    return paint


def _broken_by(error: Exception, field: str = "") -> BrokenSession:
    """Return the session error for an invalid value, from the error that the value caused."""
    if not isinstance(error, InputError):
        return BrokenSession(f"session: {one_line(error)}; was it edited?")
    problem, remedy = one_line(error.problem), f"{error.remedy}; was it edited?".removeprefix("; ")
    field = f"session.{field or error.field}"
    return BrokenSession(problem, remedy, code=error.code, field=field, given=error.given)
