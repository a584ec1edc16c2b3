"""The whole scene file: every table, what must hold between them, and what is wrong in words.

TOML -> [file] -> Scene
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field, model_validator

from volspec._tables import Table
from volspec.errors import nearest
from volspec.raycast import RaycastSpec
from volspec.scene.export import ExportTable, KeyframeTable, check_export
from volspec.scene.lights import GroupTable, LightTable, rows_by_name
from volspec.scene.tables import (
    BasisTable,
    CameraTable,
    MaterialTable,
    OutputTable,
    RaycastTable,
    ViewingTable,
    VolumeTable,
)
from volspec.scene.transfer import TransferTable
from volspec.scene.versions import FIRST


class SceneFile(Table):
    """Everything a picture needs; files named in it are relative to it."""

    version: Annotated[int, Field(ge=FIRST)] = FIRST
    """Of the file's form."""
    title: str = ""
    """Caption; kept in the image."""
    volume: VolumeTable
    """What is cast."""
    material: Annotated[list[MaterialTable], Field(min_length=1)]
    """What the transfer function is made of."""
    transfer: TransferTable
    """Which value is how opaque, and of what."""
    basis: BasisTable = BasisTable()
    """Channels of the cast."""
    camera: CameraTable = CameraTable()
    """Where it is seen from."""
    raycast: RaycastTable = RaycastTable()
    """Settings of the cast."""
    group: list[GroupTable] = Field(default_factory=list)
    """Where light comes from; left out, one group of ambient light and a headlight."""
    light: Annotated[list[LightTable], Field(min_length=1)]
    """What shines."""
    viewing: ViewingTable = ViewingTable()
    """The eye, and what the picture is made for."""
    output: OutputTable = OutputTable()
    """The picture's size."""
    export: ExportTable = ExportTable()
    """Frames for `volspec export`."""
    keyframe: list[KeyframeTable] = Field(default_factory=list)
    """What holds at a time of an exported film."""

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

    @model_validator(mode="after")
    def _can_be_exported(self) -> SceneFile:
        lights = list(rows_by_name(self.light))
        check_export(self.export, self.keyframe, lights, self.camera)
        return self


def _twice(names: Sequence[str]) -> str | None:
    """The first name that comes more than once."""
    return next((name for name in names if names.count(name) > 1), None)
