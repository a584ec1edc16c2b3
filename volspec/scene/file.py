"""The whole scene file: every table, what must hold between them, and what is wrong in words.

TOML -> [file] -> Scene
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, get_args

from pydantic import Field, ValidationError, model_validator

from volspec.errors import nearest
from volspec.raycast import RaycastSpec
from volspec.scene.lights import GroupTable, LightTable, rows_by_name
from volspec.scene.tables import (
    BasisTable,
    CameraTable,
    MaterialTable,
    OutputTable,
    RaycastTable,
    Table,
    ViewingTable,
    VolumeTable,
)
from volspec.scene.transfer import TransferTable


class SceneFile(Table):
    """The whole file."""

    title: str = ""
    volume: VolumeTable
    material: Annotated[list[MaterialTable], Field(min_length=1)]
    transfer: TransferTable
    basis: BasisTable = BasisTable()
    camera: CameraTable = CameraTable()
    raycast: RaycastTable = RaycastTable()
    group: list[GroupTable] = Field(default_factory=list)
    light: Annotated[list[LightTable], Field(min_length=1)]
    viewing: ViewingTable = ViewingTable()
    output: OutputTable = OutputTable()

    @model_validator(mode="after")
    def _names_are_unique(self) -> SceneFile:
        for kind, rows in (("material", self.material), ("group", self.group)):
            if twice := _twice([row.name for row in rows]):
                raise ValueError(f"two [[{kind}]] are named {twice!r}; rename one")
        return self

    @model_validator(mode="after")
    def _lights_form_settings(self) -> SceneFile:
        groups = [group.name for group in self.group or RaycastSpec().groups]
        for i, row in enumerate(self.light, start=1):
            if row.group is not None and row.group not in groups:
                raise ValueError(
                    f"light.{i}.group: no [[group]] is named {row.group!r}; "
                    f"{nearest(row.group, groups)}there is {', '.join(groups)}"
                )
        for name, rows in rows_by_name(self.light).items():
            # "" stands for all groups.
            twice = _twice([row.group or "" for row in rows])
            if twice is not None:
                where = f"group {twice!r}" if twice else "all groups"
                raise ValueError(
                    f"two [[light]] are named {name!r} and shine from {where}; rename one, or "
                    "give them different groups"
                )
            lit = sum(row.has_lux for row in rows)
            if 0 < lit < len(rows):
                raise ValueError(
                    f"light {name!r}: {lit} of {len(rows)} rows have illuminance_lux or power_W; "
                    "give one of them to all rows or to none"
                )
        return self

    @model_validator(mode="after")
    def _filters_are_used(self) -> SceneFile:
        for i, row in enumerate(self.material, start=1):
            if row.filter is not None and self.transfer.points is None:
                raise ValueError(
                    f"material.{i}.filter: only [transfer] points absorb by wavelength, not "
                    f"{self.transfer.kind}; leave it out"
                )
        return self


def explained(error: ValidationError) -> str:
    """pydantic's first complaint in one line: field, what is wrong, the value."""
    first = error.errors()[0]
    # A misspelt key comes with the complaint that the right one is missing; name the former.
    first = next((e for e in error.errors() if e["type"] == "extra_forbidden"), first)
    field, tables = _place(first["loc"])
    if first["type"] == "extra_forbidden":
        known = list(tables[0].model_fields)
        guess = nearest(field.rpartition(".")[2], known)
        return f"{field}: unknown key; {guess}known: {', '.join(known)}"
    if first["type"].startswith("union_tag"):
        kinds = [_kind(table) for table in tables]
        tag = first["ctx"].get("tag")
        what = f"is {tag!r}; {nearest(tag, kinds)}give" if tag else "is missing; give"
        return f"{field}: kind {what} {', '.join(kinds)}"
    if len(first["loc"]) == 1 and first["type"] in ("missing", "too_short"):
        table = f"[[{field}]]" if field in ("material", "light") else f"[{field}]"
        return f"there is no {table}; add one"
    what = first["msg"].removeprefix("Value error, ")
    if first["type"].startswith("model_"):
        what = "give a table, { key = value, … }"
    if not field:
        return what
    told = first["type"] in ("missing", "value_error") and isinstance(first["input"], dict)
    return f"{field}: {what}" + ("" if told else f" (it is {first['input']!r:.60})")


def _place(loc: Sequence[int | str]) -> tuple[str, list[type[Table]]]:
    """Where pydantic complains, as a user would write it, and which tables it may be."""
    words: list[str] = []
    tables: list[type[Table]] = [SceneFile]
    for part in loc:
        if isinstance(part, int):
            words.append(str(part + 1))
        elif len(tables) > 1:  # pydantic says which kind it took: no word of the file
            tables = [table for table in tables if _kind(table) == part]
        elif not part.startswith("<"):
            words.append(part)
            if part in tables[0].model_fields:
                tables = _tables_in(tables[0].model_fields[part].annotation) or tables
    return ".".join(words), tables


def _kind(table: type[Table]) -> str:
    """The word that tells a table from others at its place."""
    return str(get_args(table.model_fields["kind"].annotation)[0])


def _tables_in(annotation: Any) -> list[type[Table]]:
    if inner := get_args(annotation):
        return [table for part in inner for table in _tables_in(part)]
    return [annotation] if isinstance(annotation, type) and issubclass(annotation, Table) else []


def _twice(names: Sequence[str]) -> str | None:
    """The first name that comes more than once."""
    return next((name for name in names if names.count(name) > 1), None)
