"""A session: all that the viewer's user has made, in a file from which it goes on.

    state <-> [session] <-> FILE.volspec.json

It holds the scene's tables as they were opened, so that what "the scene's own" means stays, and
every field of the state. Only the volume's voxels and the files that the scene names are not in
it: a session does not need the latter, spectra are in it as numbers.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_type_hints

from pydantic import ValidationError

from volspec._files import write_whole
from volspec._parse import parse_json, read_text
from volspec._tables import explained
from volspec.errors import InputError, SceneError
from volspec.scene.file import SceneFile
from volspec.scene.resolve import Resolver
from volspec.viewer.model.document import Document, histogram
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.session_codec import KIND, Reader, ValueFault, Writer

FORMAT = "volspec-session"
VERSION = 2
SUFFIX = ".volspec.json"
Migration = Callable[[dict[str, Any]], None]
# From version 1 to 2, by class: its name, and those of its fields, if they became others. A state
# and a document have no class name in a file.
_STATE_1 = {"seen": "relight", "kept": "saved_lights", "board": "palette", "thin": "unthickened"}
_NAMES_1: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "LightState": ("LightState", {"seen": "relight"}),
    "Board": (
        "PaletteState",
        {"wishes": "targets", "answered": "designed_for", "anew": "from_scratch"},
    ),
    "Wishes": ("DesignTargets", {}),
}


def _rename_1(data: Any) -> None:
    """Give classes and fields the names that they have from version 2 on."""
    if isinstance(data, dict):
        for part in (data.get("state"), data.get("document")):
            if isinstance(part, dict):
                _rename_keys(part, _STATE_1)
        _rename_classes(data)


def _rename_classes(data: Any) -> None:
    if isinstance(data, dict):
        kind = data.get(KIND)
        if isinstance(kind, str) and kind in _NAMES_1:
            data[KIND], fields_ = _NAMES_1[kind]
            _rename_keys(data, fields_)
    for each in data.values() if isinstance(data, dict) else data:
        if isinstance(each, dict | list):
            _rename_classes(each)


def _rename_keys(data: dict[str, Any], names: Mapping[str, str]) -> None:
    for old, new in names.items():
        if old in data:
            data[new] = data.pop(old)


MIGRATIONS: Mapping[int, Migration] = MappingProxyType({1: _rename_1})
"""From each version to the one after it: changes the data in place."""
# Of a document, what is read, made or measured again.
_REMADE = ("volume", "caster", "fault", "histogram", "file", "path")
# Of a state, what is made anew or is over: a fade would be seen again.
_PASSING = ("document", "fade")


class SessionError(InputError):
    """A session's file is missing or of a later version, or cannot be resumed."""


class BrokenSession(SessionError):
    """A session's file does not hold what a session does."""


@dataclass(frozen=True, slots=True)
class Session:
    """What a session's file says.

    Parameters
    ----------
    title : str
        Of the scene.
    path : Path
        Of the scene or the volume that was open.
    data : dict
        All of it, in the newest version.
    """

    title: str
    path: Path
    data: dict[str, Any]


def session_of(state: ViewState) -> Session:
    """What is kept of a state.

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
            "document": {
                n: writer.plain(getattr(document, n)) for n in _saved_of(Document, _REMADE)
            },
            "state": {n: writer.plain(getattr(state, n)) for n in _saved_of(ViewState, _PASSING)},
        }
    except TypeError as error:
        raise SessionError(f"{document.title}: {error}") from error
    return Session(
        document.title,
        document.path,
        {
            "format": FORMAT,
            "version": VERSION,
            "path": os.fspath(document.path),
            "file": document.file.model_dump(exclude_unset=True),
            **parts,
            "objects": writer.objects,
        },
    )


def save_session(state: ViewState, path: str | os.PathLike[str]) -> Path:
    """Write a session, whole or not at all.

    Raises
    ------
    SessionError
        If the name does not end in ``.json``.
    SceneError
        As `session_of`.
    InputError
        If nothing can be written there.
    """
    target = Path(path)
    if target.suffix.lower() != ".json":
        raise SessionError(f"{target}: sessions are JSON; name it FILE{SUFFIX}")
    data = session_of(state).data
    # Where session and scene are moved together, they find each other.
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
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise BrokenSession(f"{name}: version is {version!r:.40}; expected a number from 1")
    if version > VERSION:
        raise SessionError(
            f"{name}: is of version {version}, this volspec reads up to {VERSION}; install a later "
            "one"
        )
    for step in range(version, VERSION):
        MIGRATIONS[step](data)
    missing = [key for key in ("path", "file", "document", "state", "objects") if key not in data]
    if missing or not isinstance(data["document"], dict):
        what = missing[0] if missing else "document"
        raise BrokenSession(f"{name}: field {what!r} is missing or wrong; was it edited?")
    beside = Path(path).absolute().parent / str(data.get("beside", ""))
    # A volume may be a folder.
    found = beside if data.get("beside") and os.path.exists(beside) else Path(str(data["path"]))
    return Session(str(data["document"].get("title")), found, data)


def restore_state(session: Session, device: str | None = None, cast: bool = True) -> ViewState:
    """The state a session was saved in, with its volume read again.

    Parameters
    ----------
    session : Session
    device : str, optional
        For casts.
    cast : bool
        Whether casts will be made.

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
        kept = _read(reader, Document, data["document"], _REMADE)
        changed = _read(reader, ViewState, data["state"], _PASSING)
    except ValidationError as error:
        raise BrokenSession(f"session: file: {explained(error, SceneFile)}") from error
    except (ValueFault, TypeError) as error:
        raise BrokenSession(f"session: {error}; was it edited?") from error
    name, mark, query = file.volume.file.partition("?")
    if name == data["path"]:  # of a bare volume, which may have been moved with its session
        moved = file.volume.model_copy(update={"file": f"{session.path}{mark}{query}"})
        file = file.model_copy(update={"volume": moved})
    volume = Resolver(file, session.path).volume()
    caster, fault = make_caster(volume, device) if cast else (None, "")
    document = Document(
        **kept,
        volume=volume,
        caster=caster,
        fault=fault,
        histogram=histogram(volume),
        file=file,
        path=session.path,
    )
    return ViewState(document, **changed)


def _saved_of(kind: type, but: Sequence[str]) -> list[str]:
    """The fields of the document or the state that are written."""
    return [field.name for field in fields(kind) if field.init and field.name not in but]


def _read(reader: Reader, kind: type, data: Any, but: Sequence[str]) -> dict[str, Any]:
    """Their values; those that the file does not have yet are left to their defaults."""
    if not isinstance(data, dict):
        raise ValueFault(f"{kind.__name__} is {data!r:.60}")
    hints = _hints(kind)
    for field in fields(kind):
        bare = field.default is MISSING and field.default_factory is MISSING
        if bare and field.init and field.name not in (*but, *data):
            raise ValueFault(f"{field.name} is missing")
    return {n: reader.value(hints[n], data[n], n) for n in _saved_of(kind, but) if n in data}


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
