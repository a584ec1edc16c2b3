"""Write a scene's file: into its original text, keeping comments and order, or from scratch.

SceneFile -> [writing] -> TOML

Differences are found table by table, not in the text: a key with an equal value stays as written.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from volspec._files import line_end, require_suffix, write_whole
from volspec._parse import parse_toml
from volspec._toml import bind_comments, set_key, toml_item
from volspec.appearance.display import is_profile
from volspec.errors import SceneError, SpectrumError
from volspec.scene.file import SceneFile, scene_file, scene_text
from volspec.scene.tables.lights import LightSpec
from volspec.scene.tables.specs import EMPTY, MaterialSpec, SpectrumNumbers
from volspec.settings import classes_in, hints, item_hint, plain
from volspec.spectra import Spectrum
from volspec.spectra.files import rebase_address, rebase_path
from volspec.spectra.library import rebase_light
from volspec.volume import bundled_volume

# Tables that get a header of their own, like the file's top-level tables; others are inline.
_HEADED = ("display", "reflectance", "filter", "spectrum")
# In the comments at the top, unless it is a URL.
_SCHEMA = re.compile(r"(?:#.*\n)*?#:schema[ \t]+(?!\w+://)(\S+)")


class Origin(Protocol):
    """A `Scene` that a file was made from."""

    path: Path
    folder: Path

    @property
    def known(self) -> Mapping[str, Spectrum]:
        """Spectra that are not on disk yet."""


def write_scene(file: SceneFile, path: str | os.PathLike[str], like: Origin | None = None) -> Path:
    """Write a scene's file atomically; it loads into the same tables again.

    Parameters
    ----------
    file : SceneFile
        The scene. Keys equal to their defaults are left out.
    path : path
        A ``.toml``, which may be there already.
    like : Scene, optional
        The scene that ``file`` was made from. Paths in ``file`` are relative to its folder, and
        are rewritten relative to the new one. If the scene's own file still exists, its text,
        comments and order are kept, and only differences are changed. Its ``known`` spectra,
        which are not on disk yet, are written as numbers.
        By default, paths are relative to the new folder and the file is written from scratch.

    Returns
    -------
    path

    Raises
    ------
    SceneError
        If the name is not ``.toml``, a mix of lights cannot be read, or the result is not a
        scene; the message names the field.
    InputError
        If the path cannot be written.

    Examples
    --------
    >>> import volspec as vs
    >>> from tempfile import TemporaryDirectory
    >>> scene = vs.Scene.load("data/scenes/engine.toml")
    >>> from dataclasses import replace
    >>> viewing = replace(scene.file.viewing.viewing, exposure=1.5)
    >>> file = replace(scene.file, viewing=replace(scene.file.viewing, viewing=viewing))
    >>> with TemporaryDirectory() as folder:
    ...     path = write_scene(file, f"{folder}/brighter.toml", scene)
    ...     vs.Scene.load(path).relight.viewing.exposure
    1.5
    """
    target = require_suffix(path, "scenes", ".toml", error=SceneError)
    text, ends = None, "\n"
    if like is not None:
        file = rebase_scene(_with_numbers(file, like.known), like.folder, target)
        text = _edit_source(file, like.path, target)
        ends = line_end(like.path) if text is not None else ends
    text = _from_scratch(file) if text is None else text
    try:
        scene_file(parse_toml(text), target)
    except ValueError as error:  # SceneError, or TOML's, such as a label's number beyond 64 bits
        problem = str(error).removeprefix(f"{target}: ")
        raise SceneError(
            f"{target}: not written, as it would not be a scene: {problem}",
            code=error.code if isinstance(error, SceneError) else "range",
        ) from error
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline=ends)
    return target


def _with_numbers(file: SceneFile, unsaved: Mapping[str, Spectrum]) -> SceneFile:
    """Return the file with numbers instead of names that only this process can look up."""

    def numbers(row: Any, *keys: str) -> Any:
        texts = {key: getattr(row, key) for key in keys if isinstance(getattr(row, key), str)}
        new = {k: SpectrumNumbers.of(unsaved[text]) for k, text in texts.items() if text in unsaved}
        return replace(row, **new)

    materials = tuple(numbers(row, "reflectance", "filter") for row in file.material)
    lights = tuple(numbers(row, "spectrum") for row in file.light)
    return replace(file, material=materials, light=lights) if unsaved else file


def rebase_scene(file: SceneFile, folder: Path, path: Path) -> SceneFile:
    """Return the same scene for a file in another folder, with paths relative to that.

    Raises SceneError if a mix of lights cannot be read.
    """
    to = path.parent
    if folder.resolve() == to.resolve():
        return file

    def material(row: MaterialSpec) -> MaterialSpec:
        names = {"reflectance": row.reflectance, "filter": row.filter}
        texts = {key: name for key, name in names.items() if isinstance(name, str)}
        return replace(row, **{k: rebase_address(name, folder, to) for k, name in texts.items()})

    def light(row: LightSpec) -> LightSpec:
        if not isinstance(row.spectrum, str):
            return row
        try:
            return replace(row, spectrum=rebase_light(row.spectrum, folder, to))
        except SpectrumError as error:
            raise SceneError(f"{path}: [[light]] {row.name}: {error}", code=error.code) from error

    volume, mark, query = file.volume.file.partition("?")
    if volume != EMPTY and (bundled_volume(volume) is None or (folder / volume).exists()):
        volume = rebase_path(volume, folder, to)
    basis, room, viewing = file.basis, file.room, file.viewing
    if viewing.filter is not None:
        viewing = replace(viewing, filter=rebase_address(viewing.filter, folder, to))
    if room is not None:
        paint = {
            name: text if text.startswith("#") else rebase_address(text, folder, to)
            for name, text in room.paint.items()
        }
        room = replace(room, file=rebase_path(room.file, folder, to), paint=paint)
    if basis.file is not None:
        basis = replace(basis, name=rebase_path(basis.file, folder, to))
    return replace(
        file,
        volume=replace(file.volume, file=f"{volume}{mark}{query}"),
        material=tuple(map(material, file.material)),
        light=tuple(map(light, file.light)),
        basis=basis,
        field=tuple(row.rebased(lambda name: rebase_path(name, folder, to)) for row in file.field),
        mesh=tuple(row.rebased(lambda name: rebase_path(name, folder, to)) for row in file.mesh),
        room=room,
        viewing=viewing,
    )


def _edit_source(file: SceneFile, source: Path, target: Path) -> str | None:
    """Return the source's text, changed to match the file; None if that is impossible."""
    from tomlkit.exceptions import TOMLKitError

    if source.suffix.lower() != ".toml":
        return None
    try:
        text = scene_text(source)
        # A key set to its default keeps its line, unless the table then contradicts itself; so does
        # one that has said its default already.
        tries: list[tuple[dict[str, Any], bool]] = [
            (plain(file, defaults=True), True),
            ({}, True),
            ({}, False),
        ]
        for defaults, keeps in tries:
            edited = _edited_once(text, file, defaults, keeps, source, target)
            if edited is not None:
                return edited
    except (ValueError, TOMLKitError, RecursionError):  # a SceneError, too
        pass
    return None


def _edited_once(
    text: str,
    file: SceneFile,
    defaults: Mapping[str, Any],
    keeps: bool,
    source: Path,
    target: Path,
) -> str | None:
    """Return the text with the file's settings; None if it does not read back the same.

    It ``keeps`` lines that say a default, or drops them.
    """
    import tomlkit

    document: Any = tomlkit.parse(text if text.endswith("\n") else f"{text}\n")
    tables = document.unwrap()
    before = plain(scene_file(tables, source)) if keeps else tables
    bind_comments(document)
    _update(document, before, plain(file), defaults)
    space = document.get("viewing", {}).get("display", {}).get("space")
    if isinstance(space, str) and is_profile(space):
        place = rebase_path(space, source.parent, target.parent)
        set_key(document["viewing"]["display"], "space", place)
    edited = _led_to_schema(tomlkit.dumps(document), source, target)
    # Unusual layouts, such as tables in pieces, may be impossible to edit.
    try:
        return edited if scene_file(parse_toml(edited), target) == file else None
    except SceneError:
        return None


def _led_to_schema(text: str, source: Path, target: Path) -> str:
    """Return the text with the path in its ``#:schema`` comment relative to the new folder."""
    match = _SCHEMA.match(text)
    if match is None or source.parent.resolve() == target.parent.resolve():
        return text
    start, end = match.span(1)
    return text[:start] + rebase_path(match[1], source.parent, target.parent) + text[end:]


def _from_scratch(file: SceneFile) -> str:
    import tomlkit

    document: Any = tomlkit.document()
    for key, value in plain(file).items():
        _set(document, key, value)
    return tomlkit.dumps(document).lstrip("\n")


def _update(
    node: Any,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    defaults: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Apply the differences of two tables to a document's table; ``defaults`` has all keys."""
    for key in dict.fromkeys((*after, *before)):
        old, new = before.get(key), after.get(key)
        if old == new:
            continue
        if new is None and key in node and isinstance(defaults.get(key), str | int | float):
            set_key(node, key, defaults[key])
        elif new is None:
            node.pop(key, None)
        elif key in node and old is None and _are_tables(node[key], new):
            # Each of its keys said its default.
            _update(node[key], dict.fromkeys(node[key], ...), new)
        elif key not in node or old is None:
            _set(node, key, new)
        elif _are_tables(old, new):
            _update(node[key], old, new, defaults.get(key) or {})
        elif _are_rows(old) and _are_rows(new):
            _update_rows(node, key, old, new)
        else:
            _set(node, key, new)


def _update_rows(
    node: Any, key: str, before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]]
) -> None:
    """Apply the differences to a list of tables; unchanged rows keep their lines."""
    from tomlkit.items import AoT

    rows, origins = node[key], _origins(before, after, _row_keys(SceneFile).get(key, ("kind",)))
    if isinstance(rows, AoT):
        old = list(rows.body)
        for row, index in zip(after, origins, strict=True):
            if index is not None:
                _update(old[index], before[index], row)
        pairs = zip(after, origins, strict=True)
        node[key] = AoT([_table(row) if i is None else old[i] for row, i in pairs], key, True)
        return
    stay = [index for index in origins if index is not None]
    if stay != sorted(stay):
        set_key(node, key, after)
        return
    for index in sorted(set(range(len(before))) - set(stay), reverse=True):
        del rows[index]
    for i, (row, index) in enumerate(zip(after, origins, strict=True)):
        if index is None:
            rows.insert(i, toml_item(row))
        elif row != before[index]:
            _update(rows[i], before[index], row)


def _origins(
    before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> list[int | None]:
    """Return each row's former index: of an equal row, else of its name, else at its place."""
    indices: list[int | None] = [None] * len(after)
    free = list(range(len(before)))

    def take(alike: Any) -> None:
        for i, row in enumerate(after):
            if indices[i] is None:
                index = next((index for index in free if alike(i, row, index)), None)
                if index is not None:
                    free.remove(index)
                    indices[i] = index

    def name(row: Mapping[str, Any]) -> list[Any]:
        return [row.get(key) for key in keys]

    take(lambda _, row, index: before[index] == row)
    take(lambda _, row, index: any(name(row)) and name(before[index]) == name(row))
    if len(before) == len(after):
        take(lambda i, row, index: index == i and before[i].get("kind") == row.get("kind"))
    return indices


@cache
def _row_keys(cls: Any) -> dict[str, tuple[str, ...]]:
    """Return the keys that identify rows, by list key, for all tables of a class."""
    keys: dict[str, tuple[str, ...]] = {}
    for field in fields(cls):
        hint = hints(cls)[field.name]
        for inner in (*classes_in(hint), *classes_in(item_hint(hint, 0))):
            if hasattr(inner, "row_keys"):
                keys[field.name] = inner.row_keys
            keys = _row_keys(inner) | keys
    return keys


def _set(node: Any, key: str, value: Any) -> None:
    """Set a value that a document lacks or has as another kind."""
    import tomlkit
    from tomlkit.items import AoT

    is_document = isinstance(node, tomlkit.TOMLDocument)
    inline = not is_document and getattr(node, "is_inline_table", lambda: False)()
    if isinstance(value, Mapping) and (is_document or key in _HEADED) and not inline:
        item: Any = _table(value)
    elif is_document and _are_rows(value):
        item = AoT([_table(row) for row in value], key, parsed=True)
    else:
        set_key(node, key, value)
        return
    if key in node:
        del node[key]
    node[key] = item


def _table(table: Mapping[str, Any]) -> Any:
    """Return a table with a header, its sub-tables last."""
    import tomlkit

    node = tomlkit.table()
    node.trivia.indent = "\n"
    for key in sorted(table, key=lambda key: key in _HEADED and isinstance(table[key], Mapping)):
        _set(node, key, table[key])
    return node


def _are_tables(*values: Any) -> bool:
    return all(isinstance(value, Mapping) for value in values)


def _are_rows(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)
