"""Frozen dataclasses as JSON and back, field by field.

    state <-> [session_codec] <-> JSON

A field that is added to the state is stored without a line here; one that a file lacks takes its
default. Objects compared by identity, such as spectra, are written once and shared again when read.
"""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter

from volspec.basis import MaterialBasis, SpectralBasis, basis_from_dict
from volspec.errors import InputError
from volspec.settings import expected

# Keys for a dataclass's class name, and for the number of an object that is written once.
KIND, NUMBER = "is", "#"
_STRICT = ConfigDict(strict=True)


class ValueFault(InputError):
    """A value of a file does not fit its field; the message names the field."""


class Writer:
    """Converts values to JSON; those compared by identity are in ``objects``, each once."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self._numbers: dict[int, int] = {}

    def plain(self, value: Any) -> Any:
        """Return a value as JSON; raise TypeError for a type that no state contains."""
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if is_dataclass(value) and not isinstance(value, type):
            return self._object(value)
        if isinstance(value, Mapping):
            return [[self.plain(key), self.plain(each)] for key, each in value.items()]
        if isinstance(value, set | frozenset):
            return sorted((self.plain(each) for each in value), key=repr)
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, Sequence):
            return [self.plain(each) for each in value]
        if isinstance(value, Path):
            return str(value)
        raise TypeError(f"{type(value).__name__} cannot be saved in a session")

    def field_values(self, value: Any, but: Sequence[str] = ()) -> dict[str, Any]:
        """Return a dataclass's fields as JSON, except those in ``but``."""
        names = [field.name for field in fields(value) if field.init and field.name not in but]
        return {name: self.plain(getattr(value, name)) for name in names}

    def _object(self, value: Any) -> dict[str, Any]:
        """Return a dataclass's fields, or its number if it is compared by identity."""
        number = self._numbers.get(id(value))
        if number is None:
            if isinstance(value, SpectralBasis | MaterialBasis):
                data = value.to_dict()
            else:
                data = {KIND: type(value).__name__, **self.field_values(value)}
            if type(value).__eq__ is not object.__eq__:  # type: ignore[comparison-overlap]
                return data
            number = self._numbers[id(value)] = len(self.objects)
            self.objects.append(data)
        return {NUMBER: number}


class Reader:
    """Converts JSON to values, with the objects of a `Writer`."""

    def __init__(self, objects: Sequence[Any]) -> None:
        self._objects = objects
        self._made: dict[int, Any] = {}

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
                self.value(inner[0], key, where): self.value(inner[1], each, f"{where}.{key}")
                for key, each in (self._row(tuple, (Any, Any), pair, where) for pair in data)
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
            return tuple(self.value(kind, each, where) for kind, each in pairs)
        row = (self.value(inner[0], each, f"{where} {i}") for i, each in enumerate(data, start=1))
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
        if number not in self._made:
            self._made[number] = self._new(kind, meant, where)
        made = self._made[number]
        _require(isinstance(made, kind), type(made).__name__, kind.__name__, where)
        return made

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
        plain = str if hint is Path else hint
        made = TypeAdapter(plain, config=_STRICT).validate_python(data)
        if isinstance(made, str):
            made.encode()  # half of a surrogate pair is not text
    except ValueError as error:
        raise ValueFault.refused(where, data, f"expected {expected(plain)}", "type") from error
    return Path(made) if hint is Path else made


def _kind_of(data: Any) -> str:
    """Return the class's name; for a basis, its method."""
    if isinstance(data, dict) and KIND not in data and "method" in data:
        return "MaterialBasis" if data["method"] == "materials" else "SpectralBasis"
    return str(data.get(KIND)) if isinstance(data, dict) else ""


def _require(fits: bool, data: Any, wanted: str, where: str) -> None:
    if not fits:
        raise ValueFault.refused(where, data, f"expected {wanted}", "type")


@cache
def _hints(kind: type) -> dict[str, Any]:
    # Rooms are not stored but made again; their module is only imported then.
    return get_type_hints(kind, localns={"SceneRoom": Any})
