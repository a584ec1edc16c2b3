"""Session files: the whole state of the viewer, to be continued later.

    state <-> [session] <-> FILE.volspec.json

A session contains the scene's tables as they were opened, which commands such as reset restore,
and every field of the state. Spectra are stored as numbers; the volume's voxels are not stored.
A field that is added to the state is stored without a line here; one that a file lacks takes its
default. Objects compared by identity, such as spectra, are written once and shared again when read.
"""

from __future__ import annotations

import json
import os
import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter

from volspec._files import write_whole
from volspec._parse import parse_json, read_text
from volspec.basis import MaterialBasis, SpectralBasis, basis_from_dict
from volspec.errors import InputError, SceneError, one_line, quote
from volspec.scene import MeshCache, Resolver, SceneFile
from volspec.settings import plain, read_table, words_for
from volspec.viewer.model.document import Document, shown_step
from volspec.viewer.model.paths import name_below, relative_path
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.cast_images import is_cast_image, open_image
from volspec.viewer.work.casts import make_caster

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
# Keys for a dataclass's class name, and for the number of an object that is written once.
KIND, NUMBER = "is", "#"
_STRICT = ConfigDict(strict=True)


class SessionError(InputError):
    """A session's file is missing or of a later version, or cannot be resumed."""


class BrokenSession(SessionError):
    """A session's file is damaged or was edited by hand."""

    code = "damaged"


class ValueFault(InputError):
    """A value of a file does not fit its field; the message names the field."""


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
        problem = f"{name}: version is {quote(version)}; expected {VERSION}"
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
        volume_table = replace(file.volume, file=f"{session.path}{mark}{query}")
        file = replace(file, volume=volume_table)
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


class Writer:
    """Converts values to JSON; those compared by identity are in ``objects``, each once."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self._numbers: dict[int, int] = {}

    def as_json(self, value: Any) -> Any:
        """Return a value as JSON; raise TypeError for a type that no state contains."""
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if is_dataclass(value) and not isinstance(value, type):
            return self._object(value)
        if isinstance(value, Mapping):
            return [[self.as_json(key), self.as_json(entry)] for key, entry in value.items()]
        if isinstance(value, set | frozenset):
            return sorted((self.as_json(entry) for entry in value), key=repr)
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, Sequence):
            return [self.as_json(entry) for entry in value]
        if isinstance(value, Path):
            return str(value)
        raise TypeError(f"{type(value).__name__} cannot be saved in a session")

    def field_values(self, value: Any, but: Sequence[str] = ()) -> dict[str, Any]:
        """Return a dataclass's fields as JSON, except those in ``but``."""
        names = [field.name for field in fields(value) if field.init and field.name not in but]
        return {name: self.as_json(getattr(value, name)) for name in names}

    def _object(self, value: Any) -> dict[str, Any]:
        """Return a dataclass's fields, or its number if it is compared by identity."""
        number = self._numbers.get(id(value))
        if number is None:
            if isinstance(value, SpectralBasis | MaterialBasis):
                data = value.to_dict()
            else:
                data = {KIND: type(value).__name__, **self.field_values(value)}
            if type(value).__eq__ is not object.__eq__:  # type: ignore[comparison-overlap]  # of slots
                return data
            number = self._numbers[id(value)] = len(self.objects)
            self.objects.append(data)
        return {NUMBER: number}


class Reader:
    """Converts JSON to values, with the objects of a `Writer`."""

    def __init__(self, objects: Sequence[Any]) -> None:
        self._objects = objects
        self._instances: dict[int, Any] = {}

    def value(self, hint: Any, data: Any, where: str) -> Any:
        """Return the value of a field with annotation ``hint``; messages name it ``where``.

        Raises ValueFault if ``data`` does not fit.
        """
        origin, inner = get_origin(hint), get_args(hint)
        if origin in (Union, types.UnionType):
            return self._one_of(inner, data, where)
        if isinstance(hint, type) and is_dataclass(hint):
            return self._object(hint, data, where)
        if origin in (tuple, list, Sequence, set, frozenset):
            return self._row(origin, inner, data, where)
        if origin in (Mapping, dict):
            _require(isinstance(data, list), data, "pairs", where)
            return {
                self.value(inner[0], key, where): self.value(inner[1], entry, f"{where}.{key}")
                for key, entry in (self._row(tuple, (Any, Any), pair, where) for pair in data)
            }
        return _scalar(hint, data, where)

    def field_values(
        self, kind: type, data: Any, prefix: str = "", but: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Return the values of a dataclass's fields, except those in ``but``.

        Fields that the file lacks take their defaults. Messages put ``prefix`` before the name.
        """
        if not isinstance(data, dict):
            raise ValueFault.refused(kind.__name__, data, "expected fields", "type")
        hints, values = _hints(kind), {}
        for field in fields(kind):
            name, where = field.name, prefix + field.name
            if not field.init or name in but:
                continue
            if name in data:
                values[name] = self.value(hints[name], data[name], where)
            elif field.default is MISSING and field.default_factory is MISSING:
                raise ValueFault("is missing", code="missing", field=where)
        return values

    def _one_of(self, kinds: Sequence[Any], data: Any, where: str) -> Any:
        """Return a value of the kind that the data names, or of the first kind that fits."""
        meant = self._resolved(data)
        if isinstance(meant, dict):
            named = [kind for kind in kinds if _kind_of(meant) == getattr(kind, "__name__", "")]
            _require(bool(named), _kind_of(meant), "another kind", where)
            kinds = named
        fault: InputError | None = None
        for kind in kinds:
            try:
                return self.value(kind, data, where)
            except InputError as error:
                fault = fault or error
        raise fault or ValueFault.refused(where, data, "expected another kind", "type")

    def _row(self, origin: Any, inner: Sequence[Any], data: Any, where: str) -> Any:
        _require(isinstance(data, list), data, "a list", where)
        if origin is tuple and inner[-1] is not Ellipsis:
            _require(len(inner) == len(data), data, f"{len(inner)} values", where)
            pairs = zip(inner, data, strict=True)
            return tuple(self.value(kind, entry, where) for kind, entry in pairs)
        row = (self.value(inner[0], entry, f"{where} {i}") for i, entry in enumerate(data, start=1))
        return frozenset(row) if origin in (set, frozenset) else tuple(row)

    def _resolved(self, data: Any) -> Any:
        """Return the object that a number refers to; other data as it is."""
        number = data.get(NUMBER) if isinstance(data, dict) else None
        if isinstance(number, int) and 0 <= number < len(self._objects):
            return self._objects[number]
        return data

    def _object(self, kind: type, data: Any, where: str) -> Any:
        _require(isinstance(data, dict), data, kind.__name__, where)
        meant = self._resolved(data)
        if meant is data:
            _require(NUMBER not in data, data, "one of the objects", where)
            return self._new(kind, data, where)
        number = data[NUMBER]
        if number not in self._instances:
            self._instances[number] = self._new(kind, meant, where)
        instance = self._instances[number]
        _require(isinstance(instance, kind), type(instance).__name__, kind.__name__, where)
        return instance

    def _new(self, kind: type, data: Any, where: str) -> Any:
        """Make an object, which validates itself."""
        _require(_kind_of(data) == kind.__name__, _kind_of(data), kind.__name__, where)
        try:
            if kind in (SpectralBasis, MaterialBasis):
                return basis_from_dict(data)
            values = self.field_values(kind, data, f"{where}.")
            return kind(**values)
        except ValueFault:
            raise
        except InputError as error:
            raise ValueFault(str(error), code=error.code, field=where) from error


def _scalar(hint: Any, data: Any, where: str) -> Any:
    """Return a text, a number, a path or an array."""
    if get_origin(hint) is np.ndarray:
        _require(isinstance(data, list), data, "a list", where)
        try:
            return np.array(data, dtype=np.float64)
        except (ValueError, TypeError) as error:
            raise ValueFault.refused(where, data, "expected numbers", "type") from error
    try:
        json_type = str if hint is Path else hint
        scalar = TypeAdapter(json_type, config=_STRICT).validate_python(data)
        if isinstance(scalar, str):
            scalar.encode()  # half of a surrogate pair is not text
    except ValueError as error:
        raise ValueFault.refused(where, data, f"expected {words_for(json_type)}", "type") from error
    return Path(scalar) if hint is Path else scalar


def _kind_of(data: Any) -> str:
    """Return the class's name; for a basis, its method."""
    if isinstance(data, dict) and KIND not in data and "method" in data:
        return "MaterialBasis" if data["method"] == "materials" else "SpectralBasis"
    return str(data.get(KIND)) if isinstance(data, dict) else ""


def _require(fits: bool, data: Any, required: str, where: str) -> None:
    if not fits:
        raise ValueFault.refused(where, data, f"expected {required}", "type")


@cache
def _hints(kind: type) -> dict[str, Any]:
    # Rooms are not stored but made again; their module is only imported then.
    return get_type_hints(kind, localns={"SceneRoom": Any})
