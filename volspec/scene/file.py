"""A scene's file: its tables as one spec, read from disk, and an error for every fault.

TOML -> [file] -> SceneFile -> Scene
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from volspec._parse import parse_toml, read_text, toml_remedy
from volspec.errors import RaycastError, SceneError, nearest
from volspec.image import DepthEffects
from volspec.raycast import HEADLIT, LightGroup, RaycastSpec
from volspec.relight import RelightSpec
from volspec.scene.fields import FieldSpec
from volspec.scene.tables.annotation import Annotation
from volspec.scene.tables.export import ExportSpec, Keyframe, check_export
from volspec.scene.tables.lights import LightSpec, rows_by_name
from volspec.scene.tables.specs import (
    BasisSpec,
    CameraSpec,
    MaterialSpec,
    MeshSpec,
    OutputSpec,
    RoomSpec,
    VolumeSpec,
    fault,
)
from volspec.scene.tables.transfer import TransferSpec
from volspec.settings import FileFaults, plain, row_names, settings, try_table
from volspec.volume import MAX_FIELDS

VERSION: Final = 2
"""Version of the file's format."""


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneFile:
    """Everything a picture needs; paths are relative to the file."""

    version: Literal[2] = VERSION
    """Version of the file's format."""
    title: str = ""
    """Caption; stored in the image."""
    volume: VolumeSpec = field(default_factory=VolumeSpec)
    """The data; left out for meshes alone."""
    material: Annotated[tuple[MaterialSpec, ...], Field(strict=False, min_length=1)]
    """Materials of the transfer function, at least one."""
    transfer: TransferSpec = field(default_factory=TransferSpec.transparent)
    """Opacity and material by value; left out for meshes alone."""
    basis: BasisSpec = field(default_factory=BasisSpec)
    """Channels of the cast."""
    camera: CameraSpec = field(default_factory=CameraSpec)
    """The camera."""
    raycast: RaycastSpec = field(default_factory=RaycastSpec)
    """Settings of the cast."""
    group: Annotated[tuple[LightGroup, ...], Field(strict=False)] = ()
    """Light groups; default: a single group, light, of ambient light and a headlight."""
    room: RoomSpec | None = None
    """A room that the volume is in."""
    mesh: Annotated[tuple[MeshSpec, ...], Field(strict=False)] = ()
    """Surfaces in and around the volume."""
    light: Annotated[tuple[LightSpec, ...], Field(strict=False, min_length=1)]
    """Lights, at least one."""
    viewing: RelightSpec = field(default_factory=RelightSpec)
    """Viewing conditions, and the display that the picture is made for."""
    depth: DepthEffects = field(default_factory=DepthEffects)
    """Focus, fog and cuts of pictures and exports; the cast has layers."""
    output: OutputSpec = field(default_factory=OutputSpec)
    """The picture's size."""
    export: ExportSpec = field(default_factory=ExportSpec)
    """Frames for `volspec export`."""
    annotation: Annotated[tuple[Annotation, ...], Field(strict=False)] = ()
    """Labels, distances and angles, drawn over pictures, films and pages."""
    keyframe: Annotated[tuple[Keyframe, ...], Field(strict=False)] = ()
    """Settings at times of an exported film."""
    # Last, as `field` above is the function of dataclasses.
    field: Annotated[tuple[FieldSpec, ...], Field(strict=False, max_length=MAX_FIELDS - 1)] = ()
    """Further fields in the volume's space."""

    def __post_init__(self) -> None:
        for kind, names in (
            ("material", [row.name for row in self.material]),
            ("group", [row.name for row in self.group]),
            ("field", [row.name for row in self.field]),
        ):
            if (i := _twice(names)) is not None:
                problem = f"two [[{kind}]] are named {names[i]!r}"
                raise fault(f"{kind}[{i}].name", problem, "rename one", "duplicate", names[i])
        for missing in _without(plain(self)):
            raise missing
        try:
            spec, default = self.cast, RaycastSpec()
        except RaycastError as error:
            raise error.at("group") from None
        if self.room is None:
            self._check_lights([group.name for group in spec.groups])
        elif self.group:
            raise fault("group", "the light groups are those of [room]", "leave out one of them")
        elif (self.raycast.ambient, self.raycast.diffuse) != (default.ambient, default.diffuse):
            remedy = "leave ambient and diffuse out"
            raise fault("raycast", "[room] sets ambient and diffuse light", remedy)
        for i, row in enumerate(self.material):
            if row.filter is not None and self.transfer.points is None:
                problem = f"only [transfer] points absorb by wavelength, not {self.transfer.kind}"
                raise fault(f"material[{i}].filter", problem, "leave it out")
        keyed = next((i for i, key in enumerate(self.keyframe) if key.depth is not None), None)
        if not self.raycast.layers and (self.depth.changes or keyed is not None):
            where = "depth" if keyed is None else f"keyframe[{keyed}].depth"
            raise fault(where, "needs layers of opacity", "set [raycast] layers = 8", "missing")
        materials = [row.name for row in self.material]
        for j, surface in enumerate(self.mesh):
            for name in surface.used:
                if name not in materials:
                    problem = f"no [[material]] is named {name!r}"
                    remedy = f"{nearest(name, materials)}there is {', '.join(materials)}"
                    several = "materials" if name in surface.materials else "shares"
                    key = "material" if name == surface.material else several
                    raise fault(f"mesh[{j}].{key}", problem, remedy, "unknown", name)
        check_export(self.export, self.keyframe, list(rows_by_name(self.light)), self.camera)

    def _check_lights(self, groups: Sequence[str]) -> None:
        for i, row in enumerate(self.light):
            if row.group is not None and row.group not in groups:
                remedy = f"{nearest(row.group, groups)}known: {', '.join(groups)}"
                problem = f"no [[group]] is named {row.group!r}"
                raise fault(f"light[{i}].group", problem, remedy, "unknown", row.group)
        # "" means all groups.
        pairs = [(row.name, row.group or "") for row in self.light]
        if (twice := _twice(pairs)) is not None:
            name, group = pairs[twice]
            where = f"group {group!r}" if group else "all groups"
            raise fault(
                f"light[{twice}].name",
                f"two [[light]] are named {name!r} and shine from {where}",
                "rename one, or give them different groups",
                "duplicate",
                name,
            )
        for name, rows in rows_by_name(self.light).items():
            count = sum(row.has_lux for row in rows)
            if 0 < count < len(rows):
                raise fault(
                    "light",
                    f"{count} of {len(rows)} rows named {name!r} have illuminance_lux or power_W",
                    "give one of them for all rows or for none",
                    "missing",
                )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneFile) and plain(self) == plain(other)

    __hash__ = None  # type: ignore[assignment]

    @property
    def cast(self) -> RaycastSpec:
        """Settings of the cast, including the light groups."""
        return replace(self.raycast, groups=self.group or HEADLIT)


class SceneFaults(FileFaults, SceneError):
    """Faults of a scene's file."""


def scene_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a scene's file; SceneError if it cannot be read."""
    return read_text(path, SceneError, "a scene file (.toml); volspec scene new makes a volume's")


def scene_data(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the tables of a scene's file, not checked yet.

    Raises SceneError if it cannot be read, is not TOML or has another version.
    """
    text = scene_text(path)
    try:
        data = parse_toml(text)
        if "volume" not in data and ("size_m" in data or "surface" in data):
            remedy = f"run volspec room {os.fspath(path)}, or name it as file in a scene's [room]"
            raise SceneError("is a room, not a scene", remedy, code="type")
        check_version(data)
    except SceneError as error:
        raise SceneFaults(path, [error]) from None
    except ValueError as error:
        fault = SceneError(f"not valid TOML: {error}", toml_remedy(error, text), code="syntax")
        raise SceneFaults(path, [fault]) from error
    return data


def scene_file(data: Mapping[str, Any], path: str | os.PathLike[str]) -> SceneFile:
    """Return the tables as a spec, checked individually and together.

    Raises SceneFaults with every fault.
    """
    file, faults = try_table(SceneFile, data, SceneError, Path(path).parent)
    if file is None:
        missing = [e.code == "missing" for e in faults]
        index = missing.index(True) if any(missing) else len(faults)
        faults = [*faults[:index], *_without(data), *faults[index:]]
        raise SceneFaults(path, faults, row_names(data))
    return file


def _without(tables: Mapping[str, Any]) -> list[SceneError]:
    """Return errors about tables that only a scene of meshes alone can be without."""
    required = ["volume", "transfer"]
    volume = tables.get("volume", {})
    if tables.get("mesh") and isinstance(volume, Mapping) and "file" not in volume:
        required = []
    return [fault(k, "missing", f"add [{k}]", "missing") for k in required if k not in tables]


def check_version(data: Mapping[str, Any]) -> None:
    """Raise SceneError unless a file's tables are of `VERSION`, which may be left out."""
    version = data.get("version", VERSION)
    if type(version) is not int or version != VERSION:
        later = isinstance(version, int) and version > VERSION
        remedy = "install a later volspec" if later else f"write version = {VERSION}"
        text = f"this volspec reads {VERSION}; {remedy}"
        raise SceneError.refused("version", version, text, "unsupported" if later else "range")


def _twice(names: Sequence[Any]) -> int | None:
    """Return the index of the first name that repeats an earlier one."""
    return next((i for i, name in enumerate(names) if name in names[:i]), None)
