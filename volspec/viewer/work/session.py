"""Session files: everything that the viewer's user has made, to be continued later.

    state <-> [session] <-> FILE.volspec.json

A session holds the scene's tables as they were opened, so that what "the scene's own" means stays,
and every field of the state. Spectra are in it as numbers; the volume's voxels are not.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from volspec._files import write_whole
from volspec._parse import parse_json, read_text
from volspec._tables import explained
from volspec.errors import InputError, SceneError, one_line
from volspec.scene.file import SceneFile
from volspec.scene.resolve import Resolver
from volspec.viewer.model.document import Document, histogram
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.session_codec import KIND, Reader, ValueFault, Writer

FORMAT = "volspec-session"
VERSION = 2
SUFFIX = ".volspec.json"
# Fields and classes that had other names in version 1.
_FIELDS_1 = {
    "seen": "relight",
    "kept": "saved_lights",
    "board": "palette",
    "thin": "unthickened",
    "wishes": "targets",
    "answered": "designed_for",
    "anew": "from_scratch",
}
_CLASSES_1 = {"Board": "PaletteState", "Wishes": "DesignTargets"}
# Fields of a document that are read, made or measured again.
_REMADE = ("volume", "caster", "fault", "histogram", "file", "path")
# Fields of a state that are made again, or are over: a fade must not run a second time.
_PASSING = ("document", "fade")


class SessionError(InputError):
    """A session's file is missing or of a later version, or cannot be resumed."""


class BrokenSession(SessionError):
    """A session's file does not hold what a session does."""


@dataclass(frozen=True, slots=True)
class Session:
    """Contents of a session's file, and where its scene or volume is now."""

    path: Path
    data: dict[str, Any]


def session_of(state: ViewState) -> Session:
    """Return what a session saves of a state.

    Raises
    ------
    SceneError
        If the document has no file to be read from again.
    """
    document = state.document
    if document.file is None or document.path is None:
        raise SceneError(f"{document.title}: was not read from a file; no session can name it")
    writer = Writer()
    try:
        parts = {
            "document": writer.field_values(document, but=_REMADE),
            "state": writer.field_values(state, but=_PASSING),
        }
    except TypeError as error:
        raise SessionError(f"{document.title}: {error}") from error
    data = {
        "format": FORMAT,
        "version": VERSION,
        "path": os.fspath(document.path),
        "file": document.file.model_dump(exclude_unset=True),
        **parts,
        "objects": writer.objects,
    }
    return Session(document.path, data)


def save_session(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write a session, whole or not at all.

    Raises
    ------
    VolspecError
        If the name does not end in ``.json``, nothing can be written there, or as `session_of`.
    """
    target = Path(path)
    if target.suffix.lower() != ".json":
        raise SessionError(f"{target}: sessions are JSON; name it FILE{SUFFIX}")
    data = session_of(state).data
    # A session finds its scene after both were moved together.
    with suppress(ValueError):  # on another drive
        data["beside"] = os.path.relpath(data["path"], target.absolute().parent)
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return target


def read_session(path: str | os.PathLike[str]) -> Session:
    """Read a session's file, not what it names.

    Raises
    ------
    SessionError
        If it is missing, no session, or of a later version.
    """
    name, text = os.fspath(path), read_text(path, SessionError, f"a session (FILE{SUFFIX})")
    try:
        data = parse_json(text)
    except ValueError as error:
        raise BrokenSession(f"{name}: is no session: {error}") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise BrokenSession(f"{name}: is no session; its field 'format' is not {FORMAT!r}")
    version = data.get("version")
    if type(version) is not int or version < 1:
        raise BrokenSession.refused(f"{name}: version", version, "expected a number from 1", "type")
    if version > VERSION:
        raise SessionError(
            f"{name}: is of version {version}, this volspec reads up to {VERSION}; install a later "
            "one"
        )
    if version == 1:  # the scene's file has names of its own
        data |= {key: _renamed_1(part) for key, part in data.items() if key != "file"}
    kinds = {"path": str, "file": dict, "document": dict, "state": dict, "objects": list}
    for key, kind in kinds.items():
        if not isinstance(data.get(key), kind):
            raise BrokenSession(f"{name}: field {key!r} is missing or wrong; was it edited?")
    beside = Path(path).absolute().parent / str(data.get("beside", ""))
    # A volume may be a folder.
    found = beside if data.get("beside") and os.path.exists(beside) else Path(data["path"])
    return Session(found, data)


def _renamed_1(part: Any) -> Any:
    """Return a part of a file of version 1 with the names of version 2."""
    if isinstance(part, list):
        return [_renamed_1(each) for each in part]
    if not isinstance(part, dict) or "method" in part:  # a basis, which names materials
        return part
    renamed = {_FIELDS_1.get(key, key): _renamed_1(value) for key, value in part.items()}
    if KIND in renamed:
        renamed[KIND] = _CLASSES_1.get(str(renamed[KIND]), renamed[KIND])
    return renamed


def restore_state(session: Session, device: str | None = None, cast: bool = True) -> ViewState:
    """Return the state that a session saved, with its volume read again, and a caster if ``cast``.

    Raises
    ------
    SessionError
        If a field is missing or wrong; the message names it.
    VolspecError
        If the volume cannot be read, or there is no device.
    """
    data = session.data
    try:
        file = SceneFile.model_validate(data["file"], strict=False)
        reader = Reader(data["objects"])
        of_document = reader.field_values(Document, data["document"], but=_REMADE)
        of_state = reader.field_values(ViewState, data["state"], but=_PASSING)
    except ValidationError as error:
        raise BrokenSession(f"session: file: {explained(error, SceneFile)}") from error
    except (ValueFault, TypeError) as error:
        raise BrokenSession(f"session: {one_line(error)}; was it edited?") from error
    if not of_state["lights"]:
        raise BrokenSession("session: lights is empty; was it edited?")
    name, mark, query = file.volume.file.partition("?")
    if name == data["path"]:  # of a bare volume, which may have been moved with its session
        moved = file.volume.model_copy(update={"file": f"{session.path}{mark}{query}"})
        file = file.model_copy(update={"volume": moved})
    volume = Resolver(file, session.path).volume()
    caster, fault = make_caster(volume, device) if cast else (None, "")
    document = Document(
        **of_document,
        volume=volume,
        caster=caster,
        fault=fault,
        histogram=histogram(volume),
        file=file,
        path=session.path,
    )
    state = ViewState(document, **of_state)
    try:
        state.view.camera(volume)
    except InputError as error:
        raise BrokenSession(f"session: view: {one_line(error)}; was it edited?") from error
    return state
