"""Frozen values as JSON and back: whatever the state's fields hold, now and later.

    state <-> [session_codec] <-> JSON

A field that is added to the state is stored without a line here; one that a file does not have yet
takes its default. Numbers come back to the last bit. What is compared by identity, as spectra and
transfer functions are, is written once and is one again when it is read.
"""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from volspec.basis import MaterialBasis, SpectralBasis, basis_from_dict
from volspec.errors import InputError

# Of a dataclass: the name of its class; of what is written once: its number among those.
KIND, NUMBER = "is", "#"


class ValueFault(InputError):
    """A value of a file is not what stands there in a state; the message says where."""


class Writer:
    """Makes JSON of values.

    Attributes
    ----------
    objects : list
        What is compared by identity, each once.
    """

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self._numbers: dict[int, int] = {}

    def plain(self, value: Any) -> Any:
        """A value as JSON has it.

        Raises
        ------
        TypeError
            If it is of a kind that no state holds.
        """
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
        raise TypeError(f"{type(value).__name__} cannot be kept in a session")

    def _object(self, value: Any) -> Any:
        if type(value).__eq__ is not object.__eq__:
            return self._fields(value)
        if id(value) not in self._numbers:
            known = isinstance(value, SpectralBasis | MaterialBasis)
            data = value.to_dict() if known else self._fields(value)
            self._numbers[id(value)] = len(self.objects)
            self.objects.append(data)
        return {NUMBER: self._numbers[id(value)]}

    def _fields(self, value: Any) -> dict[str, Any]:
        own = {f.name: self.plain(getattr(value, f.name)) for f in fields(value) if f.init}
        return {KIND: type(value).__name__, **own}


class Reader:
    """Makes values of JSON.

    Parameters
    ----------
    objects : list
        As a `Writer` has them.
    """

    def __init__(self, objects: Sequence[Any]) -> None:
        self._objects = objects
        self._made: dict[int, Any] = {}

    def value(self, hint: Any, data: Any, where: str) -> Any:
        """The value that was written.

        Parameters
        ----------
        hint : type
            What stands there, as the field's annotation says it.
        data : Any
            From JSON.
        where : str
            What messages call it.

        Raises
        ------
        ValueFault
            If ``data`` is no such value.
        """
        origin, inner = get_origin(hint), get_args(hint)
        if origin in (Union, types.UnionType):
            return self._one_of(inner, data, where)
        if isinstance(hint, type) and is_dataclass(hint):
            return self._dataclass(hint, data, where)
        if origin in (tuple, frozenset, set) or _is(origin, Sequence):
            return self._row(origin, inner, data, where)
        if _is(origin, Mapping):
            _require(isinstance(data, list), data, "pairs", where)
            return {
                self.value(inner[0], key, where): self.value(inner[1], each, f"{where}.{key}")
                for key, each in (self._row(tuple, (Any, Any), pair, where) for pair in data)
            }
        return _scalar(hint, origin, inner, data, where)

    def _one_of(self, kinds: Sequence[Any], data: Any, where: str) -> Any:
        """Of the kind that the data names, or of the first that it fits."""
        meant = self._objects_of(data)
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
        raise fault or ValueFault(f"{where} is {data!r:.60}")

    def _row(self, origin: Any, inner: Sequence[Any], data: Any, where: str) -> Any:
        _require(isinstance(data, list), data, "a list", where)
        if origin is tuple and (len(inner) != 2 or inner[1] is not Ellipsis):
            _require(len(inner) == len(data), data, f"{len(inner)} values", where)
            pairs = zip(inner, data, strict=True)
            return tuple(self.value(kind, each, where) for kind, each in pairs)
        row = (self.value(inner[0], each, f"{where} {i}") for i, each in enumerate(data, start=1))
        return frozenset(row) if origin in (set, frozenset) else tuple(row)

    def _objects_of(self, data: Any) -> Any:
        """What a number stands for."""
        number = data.get(NUMBER) if isinstance(data, dict) else None
        if isinstance(number, int) and 0 <= number < len(self._objects):
            return self._objects[number]
        return data

    def _dataclass(self, kind: type, data: Any, where: str) -> Any:
        _require(isinstance(data, dict), data, kind.__name__, where)
        meant = self._objects_of(data)
        if meant is data:
            _require(NUMBER not in data, data, "one of the objects", where)
            return self._made_of(kind, data, where)
        number = data[NUMBER]
        if number not in self._made:
            self._made[number] = self._made_of(kind, meant, where)
        made = self._made[number]
        _require(isinstance(made, kind), type(made).__name__, kind.__name__, where)
        return made

    def _made_of(self, kind: type, data: Any, where: str) -> Any:
        """An object, which checks itself; what the file does not have is as it is at first."""
        _require(_kind_of(data) == kind.__name__, _kind_of(data), kind.__name__, where)
        if kind in (SpectralBasis, MaterialBasis):
            return basis_from_dict(data)
        hints, given = _hints(kind), {}
        for field in fields(kind):
            place = f"{where}.{field.name}"
            if field.init and field.name in data:
                given[field.name] = self.value(hints[field.name], data[field.name], place)
            elif field.init and field.default is MISSING and field.default_factory is MISSING:
                raise ValueFault(f"{place} is missing")
        try:
            return kind(**given)
        except InputError as error:
            raise ValueFault(f"{where}: {error}") from error


def _scalar(hint: Any, origin: Any, inner: Sequence[Any], data: Any, where: str) -> Any:
    """Text, a number, an array."""
    if hint is Any:
        return data
    if origin is Literal:
        _require(data in inner, data, ", ".join(map(repr, inner)), where)
    elif origin is np.ndarray:
        _require(isinstance(data, list), data, "a list", where)
        return np.array(data, dtype=np.float64)
    elif hint is float:
        number = isinstance(data, int | float) and not isinstance(data, bool)
        _require(number, data, "a number", where)
        return float(data)
    elif hint is Path:
        _require(isinstance(data, str), data, "a path", where)
        return Path(data)
    else:
        _require(type(data) is hint, data, getattr(hint, "__name__", str(hint)), where)
    return data


def _kind_of(data: Any) -> str:
    """The class's name; a basis' file says its method instead."""
    if isinstance(data, dict) and KIND not in data and "method" in data:
        return "MaterialBasis" if data["method"] == "materials" else "SpectralBasis"
    return str(data.get(KIND)) if isinstance(data, dict) else ""


def _is(origin: Any, kind: type) -> bool:
    return isinstance(origin, type) and issubclass(origin, kind)


def _require(fits: bool, data: Any, wanted: str, where: str) -> None:
    if not fits:
        raise ValueFault(f"{where} is {data!r:.60}; expected {wanted}")


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
