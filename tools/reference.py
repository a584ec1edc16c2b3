"""Write docs/reference and the scenes' JSON schema from the settings.

python -m tools.reference
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from volspec._toml import toml_text
from volspec.appearance import Display
from volspec.appearance.display.hdr import Hdr
from volspec.appearance.display.spaces import ColourSpace, Transfer
from volspec.appearance.models.hunt import HuntSettings
from volspec.appearance.models.nayatani95 import NayataniSettings
from volspec.export.page.build import PageSpec
from volspec.image import DepthEffects
from volspec.mesh.grating import Grating
from volspec.palette.model import Apart
from volspec.palette.tables import (
    CellSpec,
    CriteriaSpec,
    LightMember,
    PaletteFile,
    ReflectanceMember,
)
from volspec.raycast import (
    Ambient,
    ClipPlane,
    Directional,
    Headlight,
    LightGroup,
    Point,
    RaycastSpec,
)
from volspec.relight import RelightSpec
from volspec.room.file import BoxSpec, LampSpec, RoomFile, SurfaceSpec
from volspec.room.file import MeshSpec as RoomMeshSpec
from volspec.room.model import Eye
from volspec.scene.fields import FieldSpec
from volspec.scene.file import SceneFile
from volspec.scene.schema import scene_schema_text
from volspec.scene.tables.export import (
    ExportSpec,
    KeyCamera,
    KeyDepth,
    Keyframe,
    KeyTransfer,
    KeyViewing,
    Sweep,
    Turntable,
)
from volspec.scene.tables.lights import LightSpec
from volspec.scene.tables.specs import (
    BasisSpec,
    CameraSpec,
    MaterialSpec,
    MeshSpec,
    OutputSpec,
    RoomSpec,
    SpectrumNumbers,
    VolumeSpec,
)
from volspec.scene.tables.transfer import (
    LabelSpec,
    MaskLabelSpec,
    PointSpec,
    RegionSpec,
    TransferSpec,
)
from volspec.settings import (
    FLAT,
    default_of,
    descriptions,
    file_keys,
    hints,
    is_settings,
    metadata,
    plain,
    words_for,
)
from volspec.volume.formats import FORMATS, SLICES

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "reference"
SCHEMA = ROOT / "data" / "scenes" / "scene.schema.json"
# Page: its title, and its tables by what they are called in a file.
PAGES: dict[str, tuple[str, dict[str, Any]]] = {
    "scene": (
        "Scene files",
        {
            "Top of the file": SceneFile,
            "[volume]": VolumeSpec,
            "[[material]]": MaterialSpec,
            "A spectrum as numbers": SpectrumNumbers,
            "[transfer]": TransferSpec,
            "A point, or a surface": PointSpec,
            "A region": RegionSpec,
            "A label": LabelSpec,
            "[[transfer.label]]": MaskLabelSpec,
            "[basis]": BasisSpec,
            "[camera]": CameraSpec,
            "[[light]]": LightSpec,
            "[room]": RoomSpec,
            "[[field]]": FieldSpec,
            "[[mesh]]": MeshSpec,
            "grating of a mesh": Grating,
            "[output]": OutputSpec,
        },
    ),
    "raycast": (
        "Casts",
        {
            "[raycast]": RaycastSpec,
            "A clip plane": ClipPlane,
            "[depth]": DepthEffects,
            "[[group]]": LightGroup,
            "Source ambient": Ambient,
            "Source headlight": Headlight,
            "Source directional": Directional,
            "Source point": Point,
        },
    ),
    "viewing": (
        "Viewing",
        {
            "[viewing]": RelightSpec,
            "[viewing.display]": Display,
            "[viewing.hunt]": HuntSettings,
            "[viewing.nayatani]": NayataniSettings,
            "A display's space": ColourSpace,
            "Its curve": Transfer,
        },
    ),
    "export": (
        "Exports",
        {
            "[export]": ExportSpec,
            "turntable": Turntable,
            "sweep": Sweep,
            "hdr": Hdr,
            "[[keyframe]]": Keyframe,
            "camera of a keyframe": KeyCamera,
            "transfer of a keyframe": KeyTransfer,
            "viewing of a keyframe": KeyViewing,
            "depth of a keyframe": KeyDepth,
        },
    ),
    "palette": (
        "Palettes",
        {
            "Top of the file": PaletteFile,
            "[criteria]": CriteriaSpec,
            "[[light]]": LightMember,
            "[[reflectance]]": ReflectanceMember,
            "[[cell]]": CellSpec,
            "[[apart]]": Apart,
        },
    ),
    "rooms": (
        "Rooms",
        {
            "Top of the file": RoomFile,
            "[[surface]]": SurfaceSpec,
            "[[light]]": LampSpec,
            "[[box]]": BoxSpec,
            "[[mesh]]": RoomMeshSpec,
            "[eye]": Eye,
        },
    ),
    "page": ("Pages", {"PageSpec": PageSpec}),
}
_HEAD = """# {}

<!-- Written by `python -m tools.reference` from the settings' descriptions; edit those. -->
"""


def page(name: str) -> str:
    """Return the text of a page."""
    title, tables = PAGES[name]
    return _HEAD.format(title) + "".join(_table(each, cls) for each, cls in tables.items())


def _table(title: str, cls: Any) -> str:
    heading = f"`{title}`" if title.startswith("[") else title
    lines = [f"\n## {heading}\n", " ".join((cls.__doc__ or "").split("\n\n")[0].split())]
    lines += ["", "| key | values | default | |", "|---|---|---|---|"]
    keys = file_keys(cls)
    for key, (owner, name) in keys.items():
        if not name:
            about = f"Always `{cls.kind}`." if key == "kind" else cls.file_keys[key].description
            default = "" if key == "kind" else f"`{toml_text(cls.file_keys[key].default)}`"
            lines.append(f"| `{key}` | a text | {default} | {_text(about)} *Files only.* |")
        else:
            lines.append(_row(owner, name))
    lines += [
        _row(cls, field.name, " *Python only.*")
        for field in dataclasses.fields(cls)
        if field.name not in keys and FLAT not in metadata(hints(cls)[field.name])
    ]
    return "\n".join(lines) + "\n"


def _row(cls: Any, name: str, note: str = "") -> str:
    default = default_of(cls, name)
    if default is dataclasses.MISSING:
        shown = "required"
    elif default is None or is_settings(type(default)) or default == ():
        shown = ""
    else:
        shown = f"`{' '.join(toml_text(plain(default)).split())}`"
    values = words_for(hints(cls)[name]).removesuffix(", or leave it out")
    return f"| `{name}` | {_text(values)} | {shown} | {_text(descriptions(cls)[name])}{note} |"


def _text(words: str) -> str:
    return words.replace("``", "`").replace("|", r"\|")


def formats_page() -> str:
    """Return the table of formats of volumes."""
    lines = [
        "# Formats of volumes",
        "",
        "Written by `python -m tools.reference` from `volspec/volume/formats.py`; see",
        "[formats](../formats.md).",
        "",
        "| format | endings | library | extra | what is read |",
        "|---|---|---|---|---|",
    ]
    for each in (*FORMATS, SLICES):
        endings = " ".join(f"`{suffix}`" for suffix in each.suffixes)
        library = {"zlib": "", "pydicom.pixels": "pydicom"}.get(each.library, each.library)
        extra = f"`volspec[{each.extra}]`" if each.extra else ""
        lines.append(f"| {each.name} | {endings} | {library} | {extra} | {each.note} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "formats.md").write_text(formats_page(), encoding="utf-8")
    for name in PAGES:
        (FOLDER / f"{name}.md").write_text(page(name), encoding="utf-8")
    SCHEMA.write_text(scene_schema_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
