"""The tables of a scene file, as pydantic models: what keys there are and what they may hold.

    TOML -> [tables] -> Scene

An unknown key is an error, so that a misspelt setting never passes silently.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from volspec.appearance import Viewing
from volspec.errors import nearest
from volspec.raycast import RaycastSpec
from volspec.relight import RelightSpec

# TOML has lists where Python has tuples; all else is taken as it is written.
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
_CAST, _VIEW = RaycastSpec(), Viewing()


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class VolumeTable(_Table):
    """``[volume]``: the file, and spacing where the file has none."""

    file: str
    spacing_mm: Vector | None = None


class MaterialTable(_Table):
    """``[[material]]``: a name the transfer function uses, and a reflectance."""

    name: Annotated[str, Field(min_length=1)]
    reflectance: str


class PointTable(_Table):
    """One point of the transfer function."""

    value: float
    opacity: float
    material: str | dict[str, float]

    @property
    def shares(self) -> dict[str, float]:
        """The mix by material, also where there is only one."""
        return {self.material: 1.0} if isinstance(self.material, str) else self.material


class TransferTable(_Table):
    """``[transfer]``: points, and the length over which an opacity holds."""

    points: Annotated[list[PointTable], Field(min_length=1)]
    reference_step_mm: float | None = None


class BasisTable(_Table):
    """``[basis]``: one that ships, one trained on the scene's own spectra, or its materials.

    An empty table takes ``general-7`` where that holds the scene's colours and trains where it
    does not. ``method = "materials"`` makes the materials the channels: exact under any light.
    """

    name: str | None = None
    train: Literal["scene"] | None = None
    method: Literal["virtual-sensors", "pca-sharpened", "pca", "reduced-rank", "materials"] = (
        "virtual-sensors"
    )
    size: Annotated[int, Field(ge=3, le=16)] = 7
    positive: bool = False
    grid_nm: Vector | None = None
    observer_deg: Literal[2, 10] = 2

    @model_validator(mode="after")
    def _one_source(self) -> BasisTable:
        others = sorted(self.model_fields_set - {"name"})
        if self.name is not None and others:
            raise ValueError(f"give name (a shipped basis) or {' and '.join(others)}, not both")
        if self.method == "materials" and self.model_fields_set & {"size", "positive", "train"}:
            raise ValueError('method = "materials" makes each material a channel; nothing to fit')
        return self


class CameraTable(_Table):
    """``[camera]``: an orbit around the volume, or an explicit position."""

    azimuth_deg: float = 30.0
    elevation_deg: float = 20.0
    zoom: float = 1.0
    fov_deg: float = 30.0
    orthographic: bool = False
    position_mm: Vector | None = None
    target_mm: Vector | None = None
    up: Vector = (0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _one_way(self) -> CameraTable:
        orbit = {"azimuth_deg", "elevation_deg", "zoom", "orthographic"} & self.model_fields_set
        if self.position_mm is not None and orbit:
            raise ValueError(f"give position_mm or {' and '.join(sorted(orbit))}, not both")
        return self


class RaycastTable(_Table):
    """``[raycast]``: see `volspec.RaycastSpec`."""

    step_mm: float | None = None
    ambient: float = _CAST.ambient
    diffuse: float = _CAST.diffuse
    specular: float = _CAST.specular
    shininess: int = _CAST.shininess
    flat_gradient: float = _CAST.flat_gradient
    alpha_stop: float = _CAST.alpha_stop


class LightTable(_Table):
    """``[[light]]``: a name and a spectrum in `volspec.light`'s notation.

    ``illuminance_lux`` sets the eye's adapting luminance; ``weight`` multiplies it, which
    shows at ``level = "absolute"``.
    """

    name: Annotated[str, Field(min_length=1)]
    spectrum: str
    label: str | None = None
    weight: float = 1.0
    illuminance_lux: float | None = None


class ViewingTable(_Table):
    """``[viewing]``: see `volspec.Viewing`; and the backdrop's reflectance."""

    model: str = _VIEW.model
    illuminance_lux: float = _VIEW.illuminance_lux
    L_A: float | None = _VIEW.L_A
    Y_b: float = _VIEW.Y_b
    surround: str = _VIEW.surround
    D: float | None = _VIEW.D
    exposure: float = _VIEW.exposure
    backdrop: float = 0.2
    mode: str = "componentwise"
    level: str = "relative"

    def spec(self) -> RelightSpec:
        """The settings as `volspec.relight` takes them.

        Raises
        ------
        ViewingError
            If one is out of range.
        """
        settings = self.model_dump()
        relit = {key: settings.pop(key) for key in ("backdrop", "mode", "level")}
        return RelightSpec(viewing=Viewing(**settings), **relit)


class OutputTable(_Table):
    """``[output]``: the picture's size in pixels."""

    width: Annotated[int, Field(ge=1, le=8192)] = 512
    height: Annotated[int, Field(ge=1, le=8192)] = 512


class SceneFile(_Table):
    """The whole file."""

    title: str = ""
    volume: VolumeTable
    material: Annotated[list[MaterialTable], Field(min_length=1)]
    transfer: TransferTable
    basis: BasisTable = BasisTable()
    camera: CameraTable = CameraTable()
    raycast: RaycastTable = RaycastTable()
    light: Annotated[list[LightTable], Field(min_length=1)]
    viewing: ViewingTable = ViewingTable()
    output: OutputTable = OutputTable()

    @model_validator(mode="after")
    def _names_are_unique(self) -> SceneFile:
        for kind, rows in (("material", self.material), ("light", self.light)):
            names = [row.name for row in rows]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"two [[{kind}]] are named {twice!r}; rename one")
        return self


def explained(error: ValidationError) -> str:
    """pydantic's first complaint in one line: field, what is wrong, the value."""
    first = error.errors()[0]
    # A misspelt key comes with the complaint that the right one is missing; name the former.
    first = next((e for e in error.errors() if e["type"] == "extra_forbidden"), first)
    parts = [f"{part + 1}" if isinstance(part, int) else str(part) for part in first["loc"]]
    field = ".".join(parts)
    if first["type"] == "extra_forbidden":
        return f"{field}: unknown key; {nearest(parts[-1], _known_keys())}check its spelling"
    what = first["msg"].removeprefix("Value error, ")
    if not field:
        return what
    value = "" if first["type"] == "missing" else f" (it is {first['input']!r:.60})"
    return f"{field}: {what}{value}"


def _known_keys() -> set[str]:
    return {key for table in _Table.__subclasses__() for key in table.model_fields}
