"""Settings described once: type, range, unit, default and description at the field.

    [settings] -> specs -> constructors, scene files, command line, JSON schema, docs/reference

`settings` makes a frozen dataclass check itself: its constructor raises a volspec error, and
reading a TOML table reports every fault, each with its path. pydantic does the checks; the
messages are made here, from the field's annotation.

Examples
--------
>>> from dataclasses import dataclass
>>> from volspec.errors import ViewingError
>>> @settings(ViewingError)
... @dataclass(frozen=True, slots=True)
... class Lamp:
...     power_W: Annotated[Positive, Unit("W")] = 40.0
>>> Lamp(power_W=-3)
Traceback (most recent call last):
volspec.errors.ViewingError: Lamp.power_W is -3; give a number above 0 (W)
>>> read_table(Lamp, {"power": 60}, ViewingError)
Traceback (most recent call last):
volspec.errors.ViewingError: power: unknown key; did you mean 'power_W'? known: power_W
>>> list(inspect.signature(Lamp).parameters)
['power_W']
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import math
import os
import re
import textwrap
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import annotated_types as limits
import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ArgsKwargs, PydanticCustomError, core_schema

from volspec._toml import toml_text
from volspec.errors import Code, InputError, nearest

Spec = TypeVar("Spec")
# Largest whole float to write as an integer.
_EXACT = 1e15
_CONFIG = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True)


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a number, for messages and reference pages."""

    name: str


@dataclass(frozen=True, slots=True)
class Hint:
    """Words on a field's values, added to its type's description; if ``whole``, replacing it."""

    text: str
    whole: bool = False


class _Marker:
    """Field metadata without a value."""


PYTHON_ONLY = _Marker()
"""Marks a field that files lack: it is specific to this machine, or elsewhere in the file."""
FLAT = _Marker()
"""Marks a field of settings whose keys are in the enclosing table of a file."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
# TOML has lists where Python has tuples; all other types must match strictly.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Vector = Annotated[tuple[Finite, Finite, Finite], Field(strict=False)]
Box = Annotated[tuple[Pair, Pair, Pair], Field(strict=False)]


def _name(text: str) -> str:
    if not text.strip():
        raise InputError("", "give a name", code="missing", given=text)
    return text


Name = Annotated[str, AfterValidator(_name)]


def settings(error: type[InputError]) -> Callable[[type[Spec]], type[Spec]]:
    """Make a frozen dataclass check its fields, and readable from tables of files.

    Fields are described by the docstrings below them and limited by their annotations. Checks
    across fields are in ``__post_init__``, which raises an `InputError` whose ``field`` is the
    field's name, or empty. The constructor raises the given class of errors.

    A class may have

    - ``from_table(table, folder)``, a static method: converts a file's table to fields,
    - ``file_keys``, {key: `pydantic.Field`}: keys only in files,
    - ``to_table(self)``: returns the table for a file, without defaults,
    - ``kind``, a text: the ``kind`` in a file if several classes are possible (`kind_of`),
    - ``row_keys``: keys that identify a row of a list, and are written first.
    """

    def decorate(cls: type[Spec]) -> type[Spec]:
        spec: Any = cls
        spec.__pydantic_config__ = _CONFIG
        spec.__get_pydantic_core_schema__ = classmethod(_core_schema)
        spec.__get_pydantic_json_schema__ = classmethod(_json_schema)
        spec.settings_error = error
        spec.__signature__ = inspect.signature(cls)
        spec.settings_adapter = _LazyAdapter()

        def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
            if args:
                placed = spec.__signature__.bind_partial(*args).arguments
                if twice := placed.keys() & kwargs:
                    raise TypeError(f"{cls.__name__}() got {min(twice)!r} twice")
                kwargs = placed | kwargs
            try:
                spec.settings_adapter.validator.validate_python(
                    ArgsKwargs((), kwargs), self_instance=self
                )
            except ValidationError as fault:
                if not _has_numpy(kwargs):
                    raise _constructor_error(fault, cls) from None
                self.__init__(**_without_numpy(kwargs))

        __init__.__doc__ = "Check the fields; see the class."
        spec.__init__ = __init__
        return cls

    return decorate


class _LazyAdapter:
    """Attribute with the class's `TypeAdapter`, made on first use: all at import would take 1 s."""

    def __get__(self, instance: object, owner: Any) -> TypeAdapter[Any]:
        owner.settings_adapter = TypeAdapter(owner)
        return owner.settings_adapter


def kind_of(value: Any) -> str:
    """Discriminate classes that have a ``kind``, tagged ``<kind>``."""
    kind = value.get("kind") if isinstance(value, Mapping) else _kind(type(value))
    return f"<{kind}>"


def _kind(cls: Any) -> str:
    kind = getattr(cls, "kind", "")
    return kind if isinstance(kind, str) else ""


def value_or_table(value: object) -> str:
    """Discriminate a single ``<value>`` from a ``<table>``."""
    return "<table>" if isinstance(value, Mapping) or is_settings(type(value)) else "<value>"


def is_settings(cls: object) -> bool:
    """Return True if `settings` made a class."""
    return isinstance(cls, type) and hasattr(cls, "settings_error")


def read_table(cls: type[Spec], table: Any, error: type[InputError], folder: object = None) -> Spec:
    """Make settings from a table of TOML or JSON; paths in it are relative to ``folder``.

    Raises the first of `try_table`'s faults, of the given class.
    """
    spec, faults = try_table(cls, table, error, folder)
    if spec is None:
        raise faults[0]
    return spec


def try_table(
    cls: type[Spec], table: Any, error: type[InputError], folder: object = None
) -> tuple[Spec | None, list[InputError]]:
    """Make settings as `read_table`; return them or None, and all faults in the table."""
    adapter: TypeAdapter[Spec] = cls.settings_adapter  # type: ignore[attr-defined]
    try:
        return adapter.validate_python(table, context={"folder": folder}), []
    except ValidationError as fault:
        return None, [f.as_error(error) for f in _faults(fault, cls)]


def plain(value: Any, defaults: bool = False) -> Any:
    """Return settings as a table of a file, without keys equal to defaults unless ``defaults``.

    Examples
    --------
    >>> from volspec.raycast import RaycastSpec
    >>> plain(RaycastSpec(ambient=0.5, specular=1.0))
    {'ambient': 0.5, 'specular': 1}
    """
    if is_settings(type(value)):
        return value.to_table() if hasattr(value, "to_table") else table_of(value, defaults)
    if isinstance(value, Mapping):
        return {key: plain(child, defaults) for key, child in value.items()}
    if isinstance(value, list | tuple):
        return [plain(child, defaults) for child in value]
    # As people write them: every float field also accepts whole numbers.
    if isinstance(value, float) and value.is_integer() and abs(value) < _EXACT:
        return int(value)
    return value


def table_of(value: Any, defaults: bool = False) -> dict[str, Any]:
    """Return the fields of settings as `plain` does, without the class's own ``to_table``."""
    cls: Any = type(value)
    table: dict[str, Any] = {"kind": cls.kind} if _kind(cls) else {}
    names = [field.name for field in dataclasses.fields(cls)]
    for name in dict.fromkeys((*getattr(cls, "row_keys", ()), *names)):
        marks = metadata(hints(cls)[name])
        converted = plain(getattr(value, name), defaults)
        written = defaults or converted != plain(default_of(cls, name))
        if FLAT in marks:
            table |= converted
        elif PYTHON_ONLY not in marks and converted is not None and written:
            table[name] = converted
    return table


def default_of(cls: type, name: str) -> Any:
    """Return a field's default; `dataclasses.MISSING` if it is required."""
    field = cls.__dataclass_fields__[name]  # type: ignore[attr-defined]
    has_factory = field.default_factory is not dataclasses.MISSING
    return field.default_factory() if has_factory else field.default


@cache
def hints(cls: Any) -> dict[str, Any]:
    """Return the annotations of a class's fields, with what `Annotated` adds."""
    return get_type_hints(cls, include_extras=True)


def plain_fields(cls: Any, *without: str) -> tuple[str, ...]:
    """Return the fields that hold numbers, words or switches, ``without`` some of them."""
    own = {name: classes_in(hint) for name, hint in hints(cls).items() if name not in without}
    return tuple(name for name, classes in own.items() if not any(map(is_settings, classes)))


@cache
def descriptions(cls: Any) -> dict[str, str]:
    """Return the docstrings below a class's fields, each as one line."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(base)))
        for field, text in pairwise(tree.body[0].body):
            documented = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
            if isinstance(field, ast.AnnAssign) and documented:
                texts[ast.unparse(field.target)] = " ".join(ast.literal_eval(text.value).split())
    return texts


@cache
def file_keys(cls: Any) -> dict[str, tuple[type, str]]:
    """Return the keys of a class's table in files: {key: (owner, field)}, ``""`` for no field."""
    keys: dict[str, tuple[type, str]] = {"kind": (cls, "")} if _kind(cls) else {}
    keys |= dict.fromkeys(getattr(cls, "file_keys", {}), (cls, ""))
    for field in dataclasses.fields(cls):
        marks = metadata(hints(cls)[field.name])
        if FLAT in marks:
            keys |= file_keys(classes_in(hints(cls)[field.name])[0])
        elif PYTHON_ONLY not in marks:
            keys[field.name] = (cls, field.name)
    return keys


def json_schema(cls: Any) -> dict[str, Any]:
    """Return the JSON schema of a class's tables in files."""
    schema = cls.settings_adapter.json_schema()
    for definition in (*schema.get("$defs", {}).values(), schema):
        if "description" in definition:  # a class docstring's first paragraph
            definition["description"] = " ".join(definition["description"].split("\n\n")[0].split())
    return schema


def _json_schema(cls: Any, source: Any, handler: Any) -> dict[str, Any]:
    """Return pydantic's schema of a class's table, without Python-only fields."""
    reference = handler(source)
    schema = handler.resolve_ref_schema(reference)
    properties: dict[str, Any] = {}
    for key, (owner, name) in file_keys(cls).items():
        if key == "kind":
            kind = {"const": cls.kind, "type": "string", "description": "Kind of source."}
            properties[key] = kind
            schema["required"] = ["kind", *schema.get("required", [])]
        elif not name:
            info: FieldInfo = cls.file_keys[key]
            properties[key] = {
                "type": "string",
                "default": info.default,
                "description": info.description,
            }
        elif owner is cls:
            properties[key] = {**schema["properties"][key], "description": descriptions(cls)[name]}
        else:
            properties[key] = json_schema(owner)["properties"][key]
    schema["properties"] = properties
    return dict(reference)


def alternatives(hint: Any) -> list[Any]:
    """Return the types that an annotation accepts, without their metadata and without None."""
    if get_origin(hint) is Annotated:
        return alternatives(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        return [alternative for part in get_args(hint) for alternative in alternatives(part)]
    return [] if hint is type(None) else [hint]


def classes_in(hint: Any) -> list[type]:
    """Return the settings classes in an annotation, except inside lists."""
    return [alternative for alternative in alternatives(hint) if is_settings(alternative)]


def choices(hint: Any) -> tuple[Any, ...]:
    """Return the values of the `Literal`s in an annotation; empty without one."""
    words = (
        get_args(alternative)
        for alternative in alternatives(hint)
        if get_origin(alternative) is Literal
    )
    return tuple(word for group in words for word in group)


def number_limits(hint: Any) -> tuple[float, float]:
    """Return the ends of a number's range, which may be open; None may replace the number.

    >>> number_limits(Annotated[float, Field(gt=0)] | None)
    (0, inf)
    """
    low, high, above, below = _limits(_number_marks(hint))
    lower, upper = (above if low is None else low), (below if high is None else high)
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def unit_of(hint: Any) -> str:
    """Return the unit of a number, which None may replace; empty without one."""
    return next((mark.name for mark in _number_marks(hint) if isinstance(mark, Unit)), "")


def _number_marks(hint: Any) -> list[Any]:
    """Return the metadata of an annotation and of its first alternative."""
    marks = metadata(hint)
    base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(base) in (Union, types.UnionType):
        marks += _number_marks(get_args(base)[0])
    return marks


_NUMBER_WORDS = {2: "two", 3: "three", 4: "four"}


def words_for(hint: Any) -> str:
    """Describe the values that an annotation accepts, in words.

    >>> words_for(Annotated[float, Field(gt=0, le=9), Unit("mm")] | None)
    'a number above 0, up to 9 (mm), or leave it out'
    >>> words_for(Literal["clip", "reduce"] | Fraction)
    'clip, reduce or a number from 0 to 1'
    """
    marks = metadata(hint)
    extra = [mark.name for mark in marks if isinstance(mark, Unit)]
    for mark in marks:
        if isinstance(mark, Hint) and mark.whole:
            return mark.text
        extra += [mark.text] if isinstance(mark, Hint) else []
    added = f" ({'; '.join(extra)})" if extra else ""
    base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(base) in (Union, types.UnionType):
        parts = get_args(base)
        words = [word for part in parts if part is not type(None) for word in _words_of(part)]
        optional = ", or leave it out" if type(None) in parts else ""
        return _join_words(words) + added + optional
    return _join_words(_words_of(base, marks)) + added


def _words_of(hint: Any, marks: Sequence[Any] = ()) -> list[str]:
    if get_origin(hint) is Annotated and not marks:
        base = get_args(hint)[0]
        return _words_of(base) if get_origin(base) is Literal else [words_for(hint)]
    inner = get_args(hint)
    if get_origin(hint) is Literal:
        return [str(word) for word in inner]
    if get_origin(hint) in (tuple, list):
        if Ellipsis in inner or get_origin(hint) is list:
            return ["a list of several" if len(inner) < 2 else "a list"]
        return [f"{_NUMBER_WORDS[len(inner)]} {'numbers' if _is_number(inner[0]) else 'values'}"]
    if get_origin(hint) in (dict, Mapping):
        return ["a table, { name = value, … }"]
    if hint in (int, float):
        return [("a whole number" if hint is int else "a number") + _range(marks)]
    names = {bool: "true or false", str: "a text"}
    return [names.get(hint, f"a {getattr(hint, '__name__', hint)}")]


def _is_number(hint: Any) -> bool:
    return (get_args(hint)[0] if get_origin(hint) is Annotated else hint) in (int, float)


def _limits(marks: Sequence[Any]) -> tuple[float | None, ...]:
    """Return the least and greatest value, and the limits that a number cannot have itself."""
    kinds = {"ge": limits.Ge, "le": limits.Le, "gt": limits.Gt, "lt": limits.Lt}
    return tuple(
        next((getattr(mark, name) for mark in marks if isinstance(mark, kind)), None)
        for name, kind in kinds.items()
    )


def _range(marks: Sequence[Any]) -> str:
    low, high, above, below = _limits(marks)
    if above is not None and below is not None:
        return f" between {above:.10g} and {below:.10g}"
    if low is not None and high is not None:
        return f" from {low:.10g} to {high:.10g}"
    start = f" of {low:.10g} or more" if low is not None else ""
    start = f" above {above:.10g}" if above is not None else start
    end = f" up to {high:.10g}" if high is not None else ""
    end = f" below {below:.10g}" if below is not None else end
    return f"{start},{end}" if start and end else start + end


def _join_words(words: Sequence[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def metadata(hint: Any) -> list[Any]:
    """Return an annotation's metadata, with each `pydantic.Field` expanded to its limits."""
    marks = []
    for mark in get_args(hint)[1:] if get_origin(hint) is Annotated else ():
        marks += mark.metadata if isinstance(mark, FieldInfo) else [mark]
    return marks


# Reading tables of files.


def _core_schema(cls: type, source: Any, handler: Any) -> Any:
    schema = handler(source)
    schema["strict"] = False  # for tables; instances of the class are used unchanged

    def prepare(value: Any, info: core_schema.ValidationInfo) -> Any:
        if not isinstance(value, Mapping):
            return value
        if info.context is None:  # constructors take settings, not tables
            raise PydanticCustomError("dataclass_type", "no table")
        return _fields_from_table(cls, value, info.context["folder"])

    return core_schema.with_info_before_validator_function(prepare, schema)


def _fields_from_table(cls: Any, table: Mapping[str, Any], folder: object) -> Mapping[str, Any]:
    keys = file_keys(cls)
    for field in dataclasses.fields(cls):
        if field.name in table and field.name not in keys:
            raise _unknown_key(cls, field.name)
    if hasattr(cls, "from_table"):
        table = cls.from_table(table, folder)
    fields = {key: value for key, value in table.items() if key != "kind" or "kind" not in keys}
    for field in dataclasses.fields(cls):
        if FLAT in metadata(hints(cls)[field.name]):
            (inner,) = classes_in(hints(cls)[field.name])
            inner_fields = {key: fields.pop(key) for key in file_keys(inner) if key in fields}
            fields[field.name] = inner_fields
    return fields


def _unknown_key(cls: type, key: str) -> InputError:
    keys = file_keys(cls)
    remedy = f"{nearest(key, keys)}known: {', '.join(keys)}"
    return InputError("unknown key", remedy, code="unknown", field=key)


# Messages of faults.

_CODES: dict[str, Code] = {
    "extra_forbidden": "unknown",
    "union_tag_invalid": "unknown",
    "union_tag_not_found": "missing",
    "missing": "missing",
    "too_short": "missing",
    "too_long": "size",
    "string_too_long": "size",
}


@dataclass(frozen=True, slots=True)
class _Fault:
    """A fault: its field, and pydantic's report of it."""

    field: str
    hint: Any
    # Classes whose key is unknown or missing, or that are possible here.
    classes: tuple[type, ...]
    account: Mapping[str, Any]

    @classmethod
    def located(cls, account: Mapping[str, Any], root: Any) -> _Fault:
        """Follow pydantic's location, which includes union tags and names of flat fields."""
        path, hint = "", root
        owners: tuple[type, ...] = (root,)
        steps = account["loc"]
        if account["type"] == "missing" and isinstance(steps[-1], int):  # tuple too short
            steps = steps[:-1]
        raised = "error" in account.get("ctx", {})  # by the class at the end, which named a field
        for index, part in enumerate(steps, 1):
            if isinstance(part, int):
                path, hint = f"{path}[{part}]", item_hint(hint, part)
                owners = tuple(classes_in(hint))
                continue
            owners = tuple(classes_in(hint)) or owners
            if part == "<value>":
                break
            if part.startswith("<"):
                kinds = [class_ for class_ in owners if f"<{_kind(class_)}>" == part]
                hint = kinds[0] if kinds else hint
                continue
            owner = next((class_ for class_ in owners if part in hints(class_)), None)
            if classes_in(hint) and (owner is not None or part is steps[-1]):
                hint = hints(owner)[part] if owner is not None else None
                if FLAT in metadata(hint) and (raised or index < len(steps)):
                    continue
            elif _is_mapping(hint) and part != "[key]":
                hint = item_hint(hint, part)
            else:  # the name of a type that pydantic tried
                continue
            path = f"{path}.{part}" if path else part
        return cls(path, hint, tuple(classes_in(hint)) or owners, account)

    @property
    def fault(self) -> str:
        """Pydantic's name for the kind of fault."""
        return str(self.account["type"]).replace("unexpected_keyword_argument", "extra_forbidden")

    @property
    def key(self) -> str:
        return self.field.rpartition(".")[2]

    def as_error(self, make: type[InputError], root: str = "") -> InputError:
        """Return the fault as an error; ``root`` is the name of the class that has the field."""
        field = f"{root}.{self.field}".strip(".") if root else self.field
        value = self.account["input"]
        cause = self.account.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            separator = "." if field and cause.field and cause.field[0] != "[" else ""
            value = value if cause.given is None and not cause.field else cause.given
            return make(
                cause.problem,
                cause.remedy,
                code=cause.code,
                field=f"{field}{separator}{cause.field}",
                given=value,
            )
        problem, remedy, code = self._words(value, bool(root))
        tagged = self.fault.startswith("union_tag")
        if tagged and isinstance(value, Mapping):
            field, value = f"{field}.kind", value.get("kind")
        return make(problem, remedy, code=code, field=field, given=value)

    def _words(self, value: Any, in_python: bool) -> tuple[str, str, Code]:
        """Return problem, remedy and code."""
        kind = self.fault
        code: Code = _CODES.get(kind, "type")
        if kind == "extra_forbidden":
            unknown = _unknown_key(self.classes[0], self.key)
            return unknown.problem, unknown.remedy, code
        if kind.startswith("union_tag") and isinstance(value, Mapping):
            kinds = [_kind(class_) for class_ in self.classes]
            guess = nearest(str(value.get("kind")), kinds)
            problem = "" if "kind" in value else "missing"
            return problem, f"{guess}give {', '.join(kinds)}", code
        if kind == "missing" and isinstance(self.account["loc"][-1], str):
            return "missing", self._example(), code
        if kind == "value_error":
            return str(self.account["ctx"]["error"]), "", "invalid"
        if kind in ("finite_number",) or kind.startswith(("greater_", "less_")):
            code = "range"
        if kind in ("missing", "too_long"):
            code = "shape"
        words = choices(self.hint)
        guess = nearest(value, map(str, words)) if isinstance(value, str) and words else ""
        if words and isinstance(value, str):
            code = "unknown"
        kinds = [_kind(c) for c in classes_in(self.hint)]
        if not in_python and kinds and all(kinds):
            return "", f"give a table, {{ kind = …, … }}, of kind {', '.join(kinds)}", code
        if not in_python and is_settings(self.hint):
            return "", "give a table, { key = value, … }", code
        if kind in ("too_short", "too_long") and _holds_many(self.hint):
            few, ends = kind == "too_short", self.account["ctx"]
            count = f"at least {ends['min_length']}" if few else f"up to {ends['max_length']}"
            return "", f"give {count}", "missing" if few else "size"
        description = words_for(self.hint)
        for cls in () if in_python else classes_in(self.hint):
            description = description.replace(f"a {cls.__name__}", "a table, { key = value, … }")
        if kind == "finite_number":
            description = description.replace("a number", "a finite number", 1)
        return "", f"{guess}give {description}", code

    def _example(self) -> str:
        table = "[[{}]]" if _holds_many(self.hint) else "[{}]"
        if "." not in self.field and (classes_in(self.hint) or _holds_many(self.hint)):
            return f"add {table.format(self.key)}"
        marks = get_args(self.hint)[1:] if get_origin(self.hint) is Annotated else ()
        examples = [
            mark.examples[0] for mark in marks if isinstance(mark, FieldInfo) and mark.examples
        ]
        return f"add {self.key} = {' '.join(toml_text(examples[0]).split()) if examples else '…'}"


def _faults(error: ValidationError, root: type) -> list[_Fault]:
    """Return each fault once, unknown keys first and without the missing keys that they meant."""
    unique: dict[str, _Fault] = {}
    for account in error.errors(include_url=False):
        fault = _Fault.located(account, root)
        # pydantic may report several types tried for one value, such as number and word.
        unique.setdefault(f"{fault.fault == 'missing'} {fault.field}", fault)
    ordered = sorted(unique.values(), key=lambda fault: fault.fault != "extra_forbidden")
    meant = set()
    for fault in ordered:
        if fault.fault == "extra_forbidden":
            parent = fault.field.removesuffix(fault.key)
            keys = file_keys(fault.classes[0])
            guess = nearest(fault.key, keys)
            meant |= {parent + key for key in keys if repr(key) in guess}
    # A list whose only row is wrong counts as empty.
    paths = [fault.field for fault in ordered]
    empty = {p for p in paths if any(other.startswith(f"{p}[") for other in paths)}
    return [
        f
        for f in ordered
        if not (f.fault == "missing" and f.field in meant)
        and not (f.fault == "too_short" and f.field in empty)
    ]


class FileFaults(InputError):
    """Faults of one file; its text is the first fault, after the file's name.

    ``rows``, {key: names}, are the names of the rows of ``[[key]]``, to name rows in messages.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        faults: Sequence[InputError],
        rows: Mapping[str, Sequence[object]] | None = None,
    ) -> None:
        first = faults[0]
        super().__init__(
            first.problem, first.remedy, code=first.code, field=first.field, given=first.given
        )
        self.faults = tuple(faults)
        self.lines = [f"{os.fspath(path)}: {_line(fault, rows or {})}" for fault in faults]

    def __str__(self) -> str:
        return self.lines[0]


def _line(error: InputError, rows: Mapping[str, Sequence[object]]) -> str:
    """Return an error's text with a row's name, or its number from 1, instead of its index."""
    match = re.fullmatch(r"(\w+)\[(\d+)\]\.?(.*)", error.field)
    if match is None:
        return str(error)
    key, index, attribute = match[1], int(match[2]), match[3]
    name = rows[key][index] if index < len(rows.get(key, ())) else None
    row = name if isinstance(name, str) and name.strip() else index + 1
    return f"[[{key}]] {row}: {error.at(attribute)}"


def row_names(tables: Mapping[str, Any]) -> dict[str, list[object]]:
    """Return the names of rows in a file's tables: {key: names}."""
    return {
        key: [row.get("name") if isinstance(row, Mapping) else None for row in rows]
        for key, rows in tables.items()
        if isinstance(rows, list)
    }


def _constructor_error(error: ValidationError, cls: Any) -> Exception:
    """Return the first fault as the class's error; a TypeError for wrong arguments."""
    fault = _faults(error, cls)[0]
    name = cls.__name__
    if len(fault.account["loc"]) == 1 and fault.account["loc"] == error.errors()[0]["loc"]:
        names = [field.name for field in dataclasses.fields(cls)]
        word = str(fault.account["loc"][0])
        if fault.fault == "extra_forbidden":
            guess = nearest(word, names).rstrip()
            return TypeError(
                f"{name}() got an unexpected keyword argument {word!r}"
                + (f"; {guess}" if guess else "")
            )
        if fault.fault == "missing":
            return TypeError(f"{name}() missing required argument {word!r}")
    cause = fault.account.get("ctx", {}).get("error")
    make = type(cause) if isinstance(cause, InputError) else cls.settings_error
    return fault.as_error(make if make is not InputError else cls.settings_error, name)


def item_hint(hint: Any, index: Any) -> Any:
    """Return the annotation of an item of a list, tuple or mapping."""
    for base in alternatives(hint):
        inner = get_args(base)
        if get_origin(base) in (dict, Mapping):
            return inner[1]
        if get_origin(base) in (tuple, list):
            alike = Ellipsis in inner or index >= len(inner)
            return inner[0 if alike else index]
    return None


def _is_mapping(hint: Any) -> bool:
    return any(get_origin(alternative) in (dict, Mapping) for alternative in alternatives(hint))


def _holds_many(hint: Any) -> bool:
    """Return True for a list of any length."""
    return any(
        get_origin(alternative) is list
        or (get_origin(alternative) is tuple and Ellipsis in get_args(alternative))
        for alternative in alternatives(hint)
    )


def _has_numpy(value: Any) -> bool:
    if isinstance(value, Mapping | list | tuple):
        return any(map(_has_numpy, value.values() if isinstance(value, Mapping) else value))
    return isinstance(value, np.generic | np.ndarray)


def _without_numpy(value: Any) -> Any:
    """Return NumPy's numbers and arrays as Python's numbers and lists."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _without_numpy(child) for key, child in value.items()}
    if type(value) in (list, tuple):
        return type(value)(_without_numpy(child) for child in value)
    return value
