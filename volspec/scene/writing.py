"""A scene's file written: into the text it came from, whose comments and order stay, or anew.

SceneFile -> [writing] -> TOML

What differs is found table by table, not in the text: a key whose value is the same is left as
somebody wrote it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from volspec._files import line_end, write_whole
from volspec._parse import parse_toml
from volspec._tables import DisplayTable, Table, explained
from volspec._tables.written import all_keys, is_written, plain, written_keys
from volspec._toml import bind_comments, set_key, toml_item
from volspec.errors import SceneError
from volspec.scene.file import SceneFile
from volspec.scene.moving import moved_scene
from volspec.scene.reading import scene_text
from volspec.scene.spectra import SpectrumTable
from volspec.scene.versions import migrate, newest
from volspec.spectra.files import rebase_path

if TYPE_CHECKING:
    from volspec.scene.model import Scene
    from volspec.spectra import Spectrum

# Tables that get a header of their own; others stand inline, but those of the whole file.
_HEADED = (DisplayTable, SpectrumTable)
# Among the comments on top, unless it is an address in the net.
_SCHEMA = re.compile(r"(?:#.*\n)*?#:schema[ \t]+(?!\w+://)(\S+)")


def write_scene(file: SceneFile, path: str | os.PathLike[str], like: Scene | None = None) -> Path:
    """Write a scene's file, whole or not at all; it loads into the same tables again.

    Parameters
    ----------
    file : SceneFile
        What it shall say. Keys equal to their defaults are left out.
    path : path
        A ``.toml``, which may be there already.
    like : Scene, optional
        The scene that ``file`` was made from. Names of files in ``file`` start from its folder,
        and are written as they read from the new one. Where it came from a file that is still
        there, all that stands in that is kept, comments and order too, and only what differs is
        changed. Spectra that it knows and that are no files yet are written as numbers.
        Left out, names of files start from the new folder and the file is written anew.

    Returns
    -------
    path

    Raises
    ------
    SceneError
        If the name is not ``.toml``, a mix of lights cannot be read, or what it shall say is no
        scene; the message names the field.
    InputError
        If there is no writing there.

    Examples
    --------
    >>> import volspec as vs
    >>> from tempfile import TemporaryDirectory
    >>> scene = vs.Scene.load("data/scenes/engine.toml")
    >>> brighter = scene.file.viewing.model_copy(update={"exposure": 1.5})
    >>> file = scene.file.model_copy(update={"viewing": brighter})
    >>> with TemporaryDirectory() as folder:
    ...     path = write_scene(file, f"{folder}/brighter.toml", scene)
    ...     vs.Scene.load(path).relight.viewing.exposure
    1.5
    """
    target = require_toml(path)
    file = file.model_copy(update={"version": newest()})
    text, ends = None, "\n"
    if like is not None:
        file = moved_scene(_told(file, like.known), like.folder, target)
        text = _edited(file, like.path, target)
        ends = line_end(like.path) if text is not None else ends
    text = _anew(file) if text is None else text
    try:
        SceneFile.model_validate(parse_toml(text))
    except ValidationError as error:
        said = explained(error, SceneFile)
        raise SceneError(f"{target}: is not written, as it would be no scene: {said}") from error
    with write_whole(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline=ends)
    return target


def require_toml(path: str | os.PathLike[str]) -> Path:
    """Refuse a name that no scene has.

    Raises
    ------
    SceneError
    """
    target = Path(path)
    if target.suffix.lower() != ".toml":
        raise SceneError(f"{target}: scenes are TOML; name it .toml")
    return target


def _told(file: SceneFile, known: Mapping[str, Spectrum]) -> SceneFile:
    """Numbers in place of texts that only this process can look up."""

    def numbers(row: Any, *keys: str) -> Any:
        texts = {key: getattr(row, key) for key in keys if isinstance(getattr(row, key), str)}
        found = {k: SpectrumTable.of(known[text]) for k, text in texts.items() if text in known}
        return row.model_copy(update=found)

    rows = {
        "material": [numbers(row, "reflectance", "filter") for row in file.material],
        "light": [numbers(row, "spectrum") for row in file.light],
    }
    return file.model_copy(update=rows) if known else file


def _edited(file: SceneFile, source: Path, target: Path) -> str | None:
    """The source's text where it says the same, and what differs; None where there is none."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    if source.suffix.lower() != ".toml":
        return None
    try:
        said = scene_text(source)
        document = tomlkit.parse(said if said.endswith("\n") else f"{said}\n")
        migrate(document)
        before = SceneFile.model_validate(document.unwrap())
        bind_comments(document)
        _update(document, before, file)
        text = _led_to_schema(tomlkit.dumps(document), source, target)
        # Layouts that no one writes, as tables in pieces, may be beyond an editor.
        return text if SceneFile.model_validate(parse_toml(text)) == file else None
    except (ValueError, TOMLKitError, RecursionError):  # a SceneError or ValidationError, too
        return None


def _led_to_schema(text: str, source: Path, target: Path) -> str:
    """The editors' comment that names the schema leads there from the new place."""
    found = _SCHEMA.match(text)
    if found is None or source.parent.resolve() == target.parent.resolve():
        return text
    start, end = found.span(1)
    return text[:start] + rebase_path(found[1], source.parent, target.parent) + text[end:]


def _anew(file: SceneFile) -> str:
    import tomlkit

    document: Any = tomlkit.document()
    for key in written_keys(file):
        _set(document, key, getattr(file, key))
    return tomlkit.dumps(document).lstrip("\n")


def _update(node: Any, before: Table, after: Table) -> None:
    """Let a document's table say what differs."""
    for key in all_keys(after):
        old, new = getattr(before, key), getattr(after, key)
        given = key in node
        if not is_written(after, key, given):
            if given:
                del node[key]
        elif not given:
            _set(node, key, new)
        elif old == new:
            continue
        elif isinstance(old, Table) and type(old) is type(new):
            _update(node[key], old, new)
        elif _are_rows(old) and _are_rows(new):
            _update_rows(node, key, old, new)
        else:
            _set(node, key, new)


def _update_rows(node: Any, key: str, before: Sequence[Table], after: Sequence[Table]) -> None:
    """Let a list of tables say what differs; rows keep their lines as long as they are the same."""
    from tomlkit.items import AoT

    rows, kept = node[key], _continued(before, after)
    if isinstance(rows, AoT):
        old = list(rows.body)
        for row, index in zip(after, kept, strict=True):
            if index is not None:
                _update(old[index], before[index], row)
        new = [_table(row) if at is None else old[at] for row, at in zip(after, kept, strict=True)]
        node[key] = AoT(new, rows.name, parsed=True)
        return
    stay = [index for index in kept if index is not None]
    if stay != sorted(stay):
        set_key(node, key, plain(after))
        return
    for index in sorted(set(range(len(before))) - set(stay), reverse=True):
        del rows[index]
    for at, (row, index) in enumerate(zip(after, kept, strict=True)):
        if index is None:
            rows.insert(at, toml_item(plain(row)))
        elif row != before[index]:
            _update(rows[at], before[index], row)


def _continued(before: Sequence[Table], after: Sequence[Table]) -> list[int | None]:
    """Which row each one was: an equal one, one of its name, or the one in its place."""
    kept: list[int | None] = [None] * len(after)
    free = list(range(len(before)))

    def take(alike: Any) -> None:
        for at, row in enumerate(after):
            if kept[at] is None:
                found = next((index for index in free if alike(at, row, index)), None)
                if found is not None:
                    free.remove(found)
                    kept[at] = found

    take(lambda _, row, index: before[index] == row)
    take(
        lambda _, row, index: type(before[index]) is type(row) and _own(before[index]) == _own(row)
    )
    if len(before) == len(after):
        take(lambda at, row, index: index == at and type(before[index]) is type(row))
    return kept


def _own(row: Table) -> tuple[Any, ...]:
    return tuple(getattr(row, key) for key in row.row_keys)


def _set(node: Any, key: str, value: Any) -> None:
    """Put a value where a document has none, or one of another kind."""
    import tomlkit
    from tomlkit.items import AoT

    whole = isinstance(node, tomlkit.TOMLDocument)
    inline = not whole and getattr(node, "is_inline_table", lambda: False)()
    if isinstance(value, Table) and (whole or isinstance(value, _HEADED)) and not inline:
        item: Any = _table(value)
    elif whole and _are_rows(value):
        item = AoT([_table(row) for row in value], key, parsed=True)
    else:
        set_key(node, key, plain(value))
        return
    if key in node:
        del node[key]
    node[key] = item


def _table(table: Table) -> Any:
    """A table with a header, its own tables last."""
    import tomlkit

    made = tomlkit.table()
    made.trivia.indent = "\n"
    keys = sorted(written_keys(table), key=lambda key: isinstance(getattr(table, key), _HEADED))
    for key in keys:
        _set(made, key, getattr(table, key))
    return made


def _are_rows(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Table)
